/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: what a page of a packed file holds. Source: docs/reference/umb-format.md,
 * section 5,
 * "A page, uncompressed". It requires what the page asks of writers, even where readers need not
 * check it.
 */
#include "oracle_page.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* A list of n numbers below a limit. */
struct list {
    const uint8_t *low, *high; /* NULL: cut */
    uint64_t count;
    uint32_t high_bits;
};

static uint64_t list_bit(const struct list *list, uint64_t at)
{
    return list->high[at / 8] >> (at % 8) & 1;
}

/* False if it is cut, or ends in ones. */
static int take_list(struct oracle_cursor *cursor, uint64_t count, uint64_t limit,
                     struct list *list)
{
    *list = (struct list){.count = count};
    while (limit > (uint64_t)256 << list->high_bits) {
        list->high_bits++;
    }
    const uint64_t bits = count * list->high_bits, bytes = (bits + 7) / 8;
    list->low = oracle_take_bytes(cursor, count);
    list->high = oracle_take_bytes(cursor, bytes);
    if (cursor->overrun) {
        return 0;
    }
    for (uint64_t at = bits; at < 8 * bytes; at++) {
        if (list_bit(list, at)) {
            return 0;
        }
    }
    return 1;
}

static uint64_t list_number(const struct list *list, uint64_t i)
{
    uint64_t number = list->low[i];
    for (uint32_t bit = 0; bit < list->high_bits; bit++) {
        number += list_bit(list, i * list->high_bits + bit) << (8 + bit);
    }
    return number;
}

int oracle_read_counts(struct oracle *oracle, uint32_t number, struct oracle_page *page,
                       char error[ORACLE_ERROR_SIZE])
{
    struct oracle_cursor *cursor = &page->cursor;
    *cursor = (struct oracle_cursor){.data = page->bytes, .size = page->size};
    uint64_t encoding = oracle_take(cursor, 1);
    uint64_t high = oracle_take(cursor, 1);
    uint64_t low = oracle_take(cursor, 1);
    if (encoding != 3 || high != page->high || low != page->low) {
        return oracle_refuse(
            error, "page %" PRIu32 ": encoding %" PRIu64 ", levels %" PRIu64 " to %" PRIu64, number,
            encoding, high, low);
    }
    uint64_t total = 0;
    for (uint32_t l = page->high; l >= page->low; l--) {
        page->count[l] = (uint32_t)oracle_take_number(cursor);
        page->base[l] = oracle->counts[l];
        oracle->counts[l] += page->count[l];
        total += page->count[l];
    }
    /* A node takes at least two bytes and a brick one, so counts beyond that are wrong. */
    if (cursor->overrun || total != page->nodes || total > page->size) {
        return oracle_refuse(error,
                             "page %" PRIu32 ": %" PRIu64 " nodes, the directory says "
                             "%" PRIu32,
                             number, total, page->nodes);
    }
    return 1;
}

/* All pages, and the number of the one being decoded. */
struct decoder {
    struct oracle *oracle;
    const struct oracle_page *pages;
    uint32_t number;
    struct oracle_page *page;
    char *error;
};

/* What a level of the page is decoded with. */
struct level {
    uint32_t l;
    uint64_t other_count;
    uint32_t *others; /* [other_count] numbers among all nodes of level l - 1 */
    uint8_t *used;    /* [other_count] */
    struct list references;
    uint64_t reference; /* the next one */
    uint64_t next;      /* the next node */
};

/* The page to which a link leads, by all links up to it. */
static uint64_t page_of_link(const struct decoder *d, uint64_t link)
{
    struct oracle_cursor links = d->page->links;
    int64_t page = -1;
    for (uint64_t i = 0; i <= link; i++) {
        const uint64_t folded = oracle_take_number(&links);
        page += 1 + (folded % 2 ? -(int64_t)(folded / 2) - 1 : (int64_t)(folded / 2));
    }
    return links.overrun || page < 0 ? UINT64_MAX : (uint64_t)page;
}

/* Where the others stand, and so their numbers. */
static int decode_others(const struct decoder *d, struct level *level)
{
    struct oracle_cursor positions = d->page->cursor;
    uint64_t link = 0, page = 0, position = 0;
    for (uint64_t k = 0; k < level->other_count; k++) {
        (void)oracle_take_number(&positions);
    }
    for (uint64_t k = 0; k < level->other_count; k++) {
        const uint64_t links = oracle_take_number(&d->page->cursor);
        position = oracle_take_number(&positions) + (k > 0 && links == 0 ? position + 1 : 0);
        link += links;
        page = k > 0 && links == 0 ? page : page_of_link(d, link);
        if (positions.overrun || page >= d->oracle->page_count || page == d->number ||
            position >= d->pages[page].count[level->l - 1]) {
            return oracle_refuse(
                d->error, "page %" PRIu32 ": level %" PRIu32 ": other %" PRIu64 " is not there",
                d->number, level->l, k);
        }
        level->others[k] = (uint32_t)(d->pages[page].base[level->l - 1] + position);
    }
    d->page->cursor = positions;
    return 1;
}

/* A child that is mixed. */
static int decode_child(const struct decoder *d, struct level *level, int is_next, uint32_t *child)
{
    const uint64_t own = d->page->count[level->l - 1];
    uint64_t r = level->next;
    if (!is_next) {
        r = list_number(&level->references, level->reference++);
    }
    if ((is_next ? r >= own : r == level->next && r < own) || r >= own + level->other_count) {
        return oracle_refuse(d->error,
                             "page %" PRIu32 ": level %" PRIu32 ": a child is %s node %" PRIu64,
                             d->number, level->l, is_next ? "the next" : "by reference", r);
    }
    if (r >= own) {
        level->used[r - own] = 1;
        *child = level->others[r - own];
    } else {
        level->next = r >= level->next ? r + 1 : level->next;
        *child = (uint32_t)(d->page->base[level->l - 1] + r);
    }
    return 1;
}

/* In: mask: as it stands in the page. */
static int decode_node(const struct decoder *d, struct level *level, uint32_t mask,
                       struct oracle_node *node)
{
    for (uint32_t c = 0; c < 8; c++) {
        const uint32_t state = (mask >> (2 * c)) & 3;
        node->mask = (uint16_t)(node->mask | (state == 3 ? 2 : state) << (2 * c));
        if (state >= 2 && !decode_child(d, level, state == 3, &node->child[c])) {
            return 0;
        }
    }
    return 1;
}

static int decode_nodes(const struct decoder *d, struct level *level)
{
    struct oracle_page *page = d->page;
    const uint32_t l = level->l;
    const uint8_t *masks = oracle_take_bytes(&page->cursor, 2 * (uint64_t)page->count[l]);
    uint64_t references = 0;
    for (uint64_t i = 0; masks != NULL && i < 8 * (uint64_t)page->count[l]; i++) {
        references += (oracle_number(masks + i / 8 * 2, 2) >> (i % 8 * 2) & 3) == 2;
    }
    if (!take_list(&page->cursor, references, page->count[l - 1] + level->other_count,
                   &level->references)) {
        return oracle_refuse(d->error, "page %" PRIu32 ": level %" PRIu32 " does not end well",
                             d->number, l);
    }
    for (uint64_t i = 0; i < page->count[l]; i++) {
        struct oracle_node *node = &d->oracle->nodes[l][page->base[l] + i];
        if (!decode_node(d, level, (uint32_t)oracle_number(masks + 2 * i, 2), node)) {
            return 0;
        }
    }
    for (uint64_t k = 0; k < level->other_count; k++) {
        if (!level->used[k]) {
            return oracle_refuse(d->error,
                                 "page %" PRIu32 ": level %" PRIu32 ": other %" PRIu64
                                 " is not referred to",
                                 d->number, l, k);
        }
    }
    return 1;
}

static int decode_level(const struct decoder *d, uint32_t l)
{
    struct level level = {.l = l, .other_count = oracle_take_number(&d->page->cursor)};
    if (d->page->cursor.overrun || level.other_count > d->page->size) {
        return oracle_refuse(d->error, "page %" PRIu32 ": level %" PRIu32 ": %" PRIu64 " others",
                             d->number, l, level.other_count);
    }
    level.others = calloc((size_t)level.other_count + 1, sizeof *level.others);
    level.used = calloc((size_t)level.other_count + 1, 1);
    int good =
        (level.others != NULL && level.used != NULL) || oracle_refuse(d->error, "out of memory");
    good = good && decode_others(d, &level) && decode_nodes(d, &level);
    free(level.others);
    free(level.used);
    return good;
}

/* The leaves of a page, in memory of their own. */
static int decode_leaves(const struct decoder *d, uint64_t count, uint64_t *leaves)
{
    struct oracle_cursor *cursor = &d->page->cursor;
    const uint8_t *differ = oracle_take_bytes(cursor, count);
    for (uint64_t i = 0; !cursor->overrun && i < count; i++) {
        uint64_t leaf = 0;
        for (int y = 7; y >= 0; y--) {
            const uint64_t before = i > 0 ? leaves[i - 1] >> (8 * y) & 255 : 0;
            const int differs = differ[i] >> y & 1;
            const uint64_t row = differs ? oracle_take(cursor, 1) : before;
            if (differs && row == before) {
                return oracle_refuse(d->error, "page %" PRIu32 ": leaf %" PRIu64 ": an equal row",
                                     d->number, i);
            }
            leaf |= row << (8 * y);
        }
        if (i > 0 && leaf <= leaves[i - 1]) {
            return oracle_refuse(d->error, "page %" PRIu32 ": leaf %" PRIu64 " does not ascend",
                                 d->number, i);
        }
        leaves[i] = leaf;
    }
    return !cursor->overrun ||
           oracle_refuse(d->error, "page %" PRIu32 ": leaves run over its end", d->number);
}

/* The bricks' slices, from their runs. */
static int decode_slices(const struct decoder *d, uint64_t leaf_count, const uint64_t *leaves)
{
    struct oracle_page *page = d->page;
    const uint8_t *runs = oracle_take_bytes(&page->cursor, page->count[3]);
    uint64_t numbers = 0, n = 0;
    for (uint64_t i = 0; runs != NULL && i < 8 * (uint64_t)page->count[3]; i++) {
        numbers += runs[i / 8] >> (i % 8) & 1;
    }
    struct list list;
    if (!take_list(&page->cursor, numbers, leaf_count, &list)) {
        return oracle_refuse(d->error, "page %" PRIu32 ": bricks do not end well", d->number);
    }
    for (uint64_t i = 0; i < 8 * (uint64_t)page->count[3]; i++) {
        uint64_t *slice = &d->oracle->bricks[page->base[3] + i / 8].slice[i % 8];
        if (!(runs[i / 8] >> (i % 8) & 1)) {
            if (i % 8 == 0) {
                return oracle_refuse(d->error,
                                     "page %" PRIu32 ": runs of brick %" PRIu64 " lack bit 0",
                                     d->number, i / 8);
            }
            *slice = slice[-1];
            continue;
        }
        const uint64_t number = list_number(&list, n++);
        if (number >= leaf_count || (i % 8 > 0 && leaves[number] == slice[-1])) {
            return oracle_refuse(d->error, "page %" PRIu32 ": leaf %" PRIu64 " of %" PRIu64,
                                 d->number, number, leaf_count);
        }
        *slice = leaves[number];
    }
    return 1;
}

static int decode_bricks(const struct decoder *d)
{
    const uint64_t count = oracle_take_number(&d->page->cursor);
    if (d->page->cursor.overrun || count > d->page->size) {
        return oracle_refuse(d->error, "page %" PRIu32 ": %" PRIu64 " leaves", d->number, count);
    }
    uint64_t *leaves = calloc((size_t)count + 1, sizeof *leaves);
    int good = leaves != NULL || oracle_refuse(d->error, "out of memory");
    good = good && decode_leaves(d, count, leaves) && decode_slices(d, count, leaves);
    free(leaves);
    return good;
}

int oracle_decode_page(struct oracle *oracle, struct oracle_page *pages, uint32_t number,
                       char error[ORACLE_ERROR_SIZE])
{
    const struct decoder decoder = {oracle, pages, number, &pages[number], error};
    for (uint32_t l = decoder.page->high; l >= decoder.page->low && l >= 4; l--) {
        if (!decode_level(&decoder, l)) {
            return 0;
        }
    }
    if (decoder.page->low == 3 && !decode_bricks(&decoder)) {
        return 0;
    }
    const struct oracle_cursor *cursor = &decoder.page->cursor;
    if (cursor->overrun || cursor->at != cursor->size) {
        return oracle_refuse(error, "page %" PRIu32 ": %" PRIu64 " bytes used of %" PRIu64, number,
                             cursor->at, cursor->size);
    }
    return 1;
}
