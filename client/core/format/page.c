/* SPDX-License-Identifier: Apache-2.0 */
/* Parsing and encoding pages; see page.h. */
#include "format/page.h"

#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"

static enum umb_status damaged(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_CORRUPT, "page: %s", what);
}

/* Reads a list of numbers below a limit. */
static bool take_list(const uint8_t **at, const uint8_t *end, uint64_t count, uint64_t limit,
                      struct umb__number_list *list)
{
    const unsigned high_bits = umb__list_high_bits(limit);
    *list = (struct umb__number_list){.count = count, .high_bits = high_bits};
    return umb__take(at, end, umb__list_bytes(count, high_bits), 1, &list->bytes);
}

/* Checks the list of a page's references to nodes in other pages: they must be in ascending order,
 * with page numbers and positions below 2^32. */
static enum umb_status parse_others(const uint8_t **at, const uint8_t *end, uint32_t level,
                                    struct umb__page *page, struct umb_error *error)
{
    uint32_t *count = &page->external_count[level];
    if (!umb__take_number(at, end, count)) {
        return damaged(error, "counts are cut");
    }
    uint64_t last_page = 0, last_position = 0;
    uint32_t difference = 0;
    page->external_pages[level] = *at;
    for (uint32_t i = 0; i < *count; i++) {
        if (!umb__take_number(at, end, &difference) || (last_page += difference) > UINT32_MAX) {
            return damaged(error, "a page number is not a number or out of range");
        }
    }
    const uint8_t *pages = page->external_pages[level];
    page->external_positions[level] = *at;
    for (uint32_t i = 0; i < *count; i++) {
        const bool same = umb__next_number(&pages) == 0 && i > 0;
        if (!umb__take_number(at, end, &difference) ||
            (last_position = difference + (same ? last_position + 1 : 0)) > UINT32_MAX) {
            return damaged(error, "a position is not a number or out of range");
        }
    }
    return UMB_OK;
}

/* Finds the masks of a level in a page and counts the mixed children. Out: written: number of
 * children whose references the page holds. Returns false if a mask is cut off. */
static bool parse_masks(const uint8_t **at, const uint8_t *end, uint32_t level,
                        struct umb__page *page, uint64_t *written)
{
    const uint32_t nodes = page->node_count[level];
    if (!umb__take(at, end, nodes, 2, &page->masks[level])) {
        return false;
    }
    *written = 0;
    for (uint32_t i = 0; i < nodes; i++) {
        const unsigned mask = umb__load16(page->masks[level] + 2 * (size_t)i);
        const unsigned mixed = mask >> 1 & 0x5555U;
        page->child_count[level] += (unsigned)__builtin_popcount(mixed);
        *written += (unsigned)__builtin_popcount(mixed & ~mask);
    }
    return true;
}

static enum umb_status parse_nodes(const uint8_t **at, const uint8_t *end, uint32_t level,
                                   struct umb__page *page, struct umb_error *error)
{
    UMB__TRY(parse_others(at, end, level, page, error));
    const uint64_t limit = (uint64_t)page->node_count[level - 1] + page->external_count[level];
    uint64_t written;
    if (!parse_masks(at, end, level, page, &written)) {
        return damaged(error, "nodes are cut");
    }
    if (!take_list(at, end, written, limit, &page->references[level])) {
        return damaged(error, "references are cut");
    }
    struct umb__page_nodes nodes = umb__page_nodes(page, level);
    uint32_t greatest = 0;
    for (uint32_t i = 0; i < page->node_count[level]; i++) {
        uint16_t mask;
        uint32_t references[8];
        const unsigned count = umb__page_nodes_next(&nodes, &mask, references);
        for (unsigned c = 0; c < count; c++) {
            greatest = references[c] > greatest ? references[c] : greatest;
        }
    }
    if (nodes.next > nodes.own) {
        return damaged(error, "more next nodes than there are");
    }
    if (page->child_count[level] > 0 && greatest >= limit) {
        return damaged(error, "a reference is out of range");
    }
    return nodes.references.pending == 0 ? UMB_OK : damaged(error, "references end in no zeros");
}

static enum umb_status parse_leaves(const uint8_t **at, const uint8_t *end, struct umb__page *page,
                                    struct umb_error *error)
{
    const uint8_t *rows;
    uint64_t differ = 0;
    if (!umb__take_number(at, end, &page->leaf_count)) {
        return damaged(error, "counts are cut");
    }
    if (!umb__take(at, end, page->leaf_count, 1, &page->leaves)) {
        return damaged(error, "leaves are cut");
    }
    for (uint32_t i = 0; i < page->leaf_count; i++) {
        differ += (unsigned)__builtin_popcount(page->leaves[i]);
    }
    return umb__take(at, end, differ, 1, &rows) ? UMB_OK : damaged(error, "leaves are cut");
}

static enum umb_status parse_bricks(const uint8_t **at, const uint8_t *end, struct umb__page *page,
                                    struct umb_error *error)
{
    const uint32_t bricks = page->node_count[UMB_LEVEL_BRICK];
    struct umb__number_list *numbers = &page->references[UMB_LEVEL_BRICK];
    UMB__TRY(parse_leaves(at, end, page, error));
    if (!umb__take(at, end, bricks, 1, &page->runs)) {
        return damaged(error, "bricks are cut");
    }
    uint64_t runs = 0;
    for (uint32_t i = 0; i < bricks; i++) {
        if ((page->runs[i] & 1) == 0) {
            return damaged(error, "a brick's first slice does not start a run");
        }
        runs += (unsigned)__builtin_popcount(page->runs[i]);
    }
    if (!take_list(at, end, runs, page->leaf_count, numbers)) {
        return damaged(error, "leaf numbers are cut");
    }
    struct umb__list_reader reader = umb__list_read(numbers);
    uint32_t greatest = 0;
    for (uint64_t i = 0; i < runs; i++) {
        const uint32_t number = umb__list_next(&reader);
        greatest = number > greatest ? number : greatest;
    }
    if (runs > 0 && greatest >= page->leaf_count) {
        return damaged(error, "a leaf number is out of range");
    }
    return reader.pending == 0 ? UMB_OK : damaged(error, "leaf numbers end in no zeros");
}

enum umb_status umb__page_parse(const uint8_t *raw, size_t size, struct umb__page *page,
                                struct umb_error *error)
{
    const uint8_t *at = raw, *end = raw + size, *head;
    memset(page, 0, sizeof *page);
    if (!umb__take(&at, end, 1, 3, &head)) {
        return damaged(error, "shorter than its head");
    }
    if (head[0] != UMB__PAGE_ENCODING) {
        return umb_fail(error, UMB_E_VERSION, "page: encoding %u, this reader knows %u%s", head[0],
                        UMB__PAGE_ENCODING,
                        head[0] < UMB__PAGE_ENCODING
                            ? "; made by an earlier version: bake the scene again"
                            : "; made by a later version");
    }
    page->level_high = head[1];
    page->level_low = head[2];
    if (page->level_high > UMB_LEVEL_MAX || page->level_low < UMB_LEVEL_BRICK ||
        page->level_low > page->level_high) {
        return damaged(error, "levels out of range");
    }
    /* Levels that the page lacks read as empty, from a valid address. */
    page->leaves = at;
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        page->references[level].bytes = at;
    }
    for (uint32_t level = page->level_high; level >= page->level_low; level--) {
        if (!umb__take_number(&at, end, &page->node_count[level])) {
            return damaged(error, "counts are cut");
        }
    }
    for (uint32_t level = page->level_high; level >= page->level_low && level > UMB_LEVEL_BRICK;
         level--) {
        UMB__TRY(parse_nodes(&at, end, level, page, error));
    }
    if (page->level_low == UMB_LEVEL_BRICK) {
        UMB__TRY(parse_bricks(&at, end, page, error));
    }
    return at == end ? UMB_OK : damaged(error, "bytes are left over");
}

void umb__page_leaves(const struct umb__page *page, uint64_t *leaves)
{
    const uint8_t *row = page->leaves + page->leaf_count;
    uint64_t leaf = 0;
    for (uint32_t i = 0; i < page->leaf_count; i++) {
        for (unsigned rows = page->leaves[i]; rows != 0;) {
            const unsigned y = 31U - (unsigned)__builtin_clz(rows);
            leaf = (leaf & ~((uint64_t)0xff << (8 * y))) | (uint64_t)*row++ << (8 * y);
            rows &= ~(1U << y);
        }
        leaves[i] = leaf;
    }
}

/* --- encoding --------------------------------------------------------------------------------- */

/* The open page. */
struct writer {
    const struct umb__octree *octree;
    const struct umb__pack_order *order;
    struct umb__page_encoder *e;
    uint32_t page;
    bool failed; /* True once memory was short; checked at the end */
    uint32_t level_high, level_low;
    uint32_t node_count[UMB_LEVEL_MAX + 1];
    /* [node_count] Octree numbers, in the order of the page */
    const uint32_t *nodes[UMB_LEVEL_MAX + 1];
};

/* Makes room for at most `most` further bytes of the page. Returns the address of these bytes; NULL
 * if out of memory. */
static uint8_t *reserve(struct writer *w, size_t most)
{
    struct umb__page_encoder *e = w->e;
    if (w->failed || !umb__grow(w->order->alloc, &e->raw, &e->raw_capacity, e->raw_size + most,
                                sizeof *e->raw)) {
        w->failed = true;
        return NULL;
    }
    return e->raw + e->raw_size;
}

/* Counts the bytes written up to `end` as part of the page. */
static void keep(struct writer *w, const uint8_t *end)
{
    w->e->raw_size = (size_t)(end - w->e->raw);
}

/* Distance in nodes or children at which memory is prefetched. */
#define AHEAD 16U

/* Finds the page's nodes of each level. */
static void find_nodes(struct writer *w)
{
    w->level_high = UMB_LEVEL_BRICK;
    w->level_low = UMB_LEVEL_MAX;
    w->e->node_count = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        const uint32_t *begins = w->order->begins[level] + w->page;
        w->nodes[level] = w->order->nodes[level] + begins[0];
        w->node_count[level] = begins[1] - begins[0];
        w->e->node_count += w->node_count[level];
        if (w->node_count[level] > 0) {
            w->level_high = level;
            w->level_low = level < w->level_low ? level : w->level_low;
        }
    }
}

static void write_counts(struct writer *w)
{
    uint8_t *at = reserve(w, 3 + UMB__NUMBER_BYTES_MAX * (UMB_LEVEL_MAX + 1));
    if (!at) {
        return;
    }
    *at++ = UMB__PAGE_ENCODING;
    *at++ = (uint8_t)w->level_high;
    *at++ = (uint8_t)w->level_low;
    for (uint32_t level = w->level_high; level >= w->level_low; level--) {
        at = umb__put_number(at, w->node_count[level]);
    }
    keep(w, at);
}

/* Makes room for at most `most` references of a level, and empties the table. Returns false if out
 * of memory. */
static bool begin_table(struct writer *w, size_t most)
{
    struct umb__page_encoder *e = w->e;
    if (w->failed ||
        !umb__grow(w->order->alloc, &e->references, &e->references_capacity, most + 1,
                   sizeof *e->references) ||
        !umb__grow(w->order->alloc, &e->positions, &e->positions_capacity, most + 1,
                   sizeof *e->positions) ||
        !umb__value_set_begin(&e->table, w->order->alloc, most)) {
        w->failed = true;
    }
    return !w->failed;
}

static bool sort_table(struct writer *w)
{
    w->failed = w->failed || !umb__value_set_sort(&w->e->table, w->order->alloc);
    return !w->failed;
}

/* Bit of a reference to the table. References without it are positions in the page. */
#define IN_TABLE 0x80000000U

/* Lists the children of a level's nodes, in their order, and returns their number. */
static size_t list_children(struct writer *w, uint32_t node_level)
{
    const struct umb__octree_level *level = &w->octree->level[node_level];
    const uint32_t *nodes = w->nodes[node_level];
    const uint32_t count = w->node_count[node_level];
    uint32_t *reference = w->e->references;
    for (uint32_t i = 0; i < count; i++) {
        if (i + 2 * AHEAD < count) {
            __builtin_prefetch(level->first + nodes[i + 2 * AHEAD]);
            __builtin_prefetch(level->masks + nodes[i + 2 * AHEAD]);
        }
        if (i + AHEAD < count) {
            __builtin_prefetch(level->children + level->first[nodes[i + AHEAD]]);
        }
        for (uint32_t c = level->first[nodes[i]]; c < level->first[nodes[i] + 1]; c++) {
            *reference++ = level->children[c];
        }
    }
    return (size_t)(reference - w->e->references);
}

/* Replaces children by their positions in the page, for an independent page, which holds all of
 * them. The set numbers nodes in the order of their addition, which is their order in the page.
 * Returns false if out of memory. */
static bool number_own(struct writer *w, uint32_t node_level, size_t count)
{
    struct umb__value_set *own = &w->e->own;
    const uint32_t *below = w->nodes[node_level - 1];
    if (!umb__value_set_begin(own, w->order->alloc, w->node_count[node_level - 1])) {
        return false;
    }
    for (uint32_t i = 0; i < w->node_count[node_level - 1]; i++) {
        (void)umb__value_set_add(own, below[i]);
    }
    for (size_t i = 0; i < count; i++) {
        w->e->references[i] = umb__value_set_add(own, w->e->references[i]);
    }
    return true;
}

/* Replaces each child by its position in the page or, if it is in another page, by its number in
 * the table. */
static void number_all(struct writer *w, uint32_t node_level, size_t count)
{
    const uint32_t *ordinals = w->order->ordinals[node_level - 1];
    const uint32_t begin = w->order->begins[node_level - 1][w->page];
    const uint32_t own = w->node_count[node_level - 1];
    uint32_t *references = w->e->references;
    for (size_t i = 0; i < count; i++) {
        if (i + AHEAD < count) {
            __builtin_prefetch(ordinals + references[i + AHEAD]);
        }
        const uint32_t ordinal = ordinals[references[i]];
        references[i] = ordinal - begin < own
                            ? ordinal - begin
                            : IN_TABLE | umb__value_set_add(&w->e->table, ordinal);
    }
}

/* Writes the places of the table's nodes, which are all in other pages: first the page numbers,
 * then the positions. */
static uint8_t *put_externals(const struct writer *w, uint32_t level, uint8_t *at)
{
    const struct umb__value_set *table = &w->e->table;
    uint32_t *positions = w->e->positions;
    struct umb__node_place last = {0, 0};
    for (size_t i = 0; i < table->count; i++) {
        if (i + 2 * AHEAD < table->count) {
            __builtin_prefetch(w->order->hints[level] +
                               table->values[i + 2 * AHEAD] / UMB__PACK_HINT);
        }
        if (i + AHEAD < table->count) {
            const uint32_t page = w->order->hints[level][table->values[i + AHEAD] / UMB__PACK_HINT];
            __builtin_prefetch(w->order->begins[level] + page + 1);
        }
        const struct umb__node_place place =
            umb__pack_place(w->order, level, (uint32_t)table->values[i]);
        const bool same = i > 0 && place.page == last.page;
        at = umb__put_number(at, place.page - last.page);
        positions[i] = same ? place.position - last.position - 1 : place.position;
        last = place;
    }
    for (size_t i = 0; i < table->count; i++) {
        at = umb__put_number(at, positions[i]);
    }
    return at;
}

/* Writes the masks, which mark the children that are the next nodes (page.h). Moves the references
 * of all other children to the front of the list, as they are written, and returns their number. */
static size_t put_masks(const struct writer *w, uint32_t node_level, uint8_t *at)
{
    const uint16_t *masks = w->octree->level[node_level].masks;
    const uint32_t own = w->node_count[node_level - 1];
    const uint32_t *rank = w->e->table.rank, *reference = w->e->references;
    uint32_t *written = w->e->references;
    uint32_t next = 0;
    for (uint32_t i = 0; i < w->node_count[node_level]; i++, at += 2) {
        unsigned mask = masks[w->nodes[node_level][i]];
        for (unsigned mixed = mask >> 1 & 0x5555U; mixed != 0; mixed &= mixed - 1) {
            const uint32_t to = *reference++;
            const bool is_next = to == next;
            mask |= is_next ? mixed & -mixed : 0;
            *written = to & IN_TABLE ? own + rank[to & ~IN_TABLE] : to;
            written += !is_next;
            next = to >= next && to < own ? to + 1 : next;
        }
        umb__store16(at, (uint16_t)mask);
    }
    return (size_t)(written - w->e->references);
}

static void write_nodes(struct writer *w, uint32_t node_level)
{
    const struct umb__value_set *table = &w->e->table;
    const uint32_t nodes = w->node_count[node_level], own = w->node_count[node_level - 1];
    if (!begin_table(w, 8 * (size_t)nodes)) {
        return;
    }
    const size_t children = list_children(w, node_level);
    if (w->page >= w->order->alone_from) {
        w->failed = !number_own(w, node_level, children);
    } else {
        number_all(w, node_level, children);
    }
    if (!sort_table(w)) {
        return;
    }
    const unsigned high_bits = umb__list_high_bits((uint64_t)own + table->count);
    uint8_t *at = reserve(w, UMB__NUMBER_BYTES_MAX * (1 + 2 * table->count) + 2 * (size_t)nodes +
                                 (size_t)umb__list_bytes(children, high_bits));
    if (!at) {
        return;
    }
    at = umb__put_number(at, (uint32_t)table->count);
    at = put_externals(w, node_level - 1, at);
    const size_t written = put_masks(w, node_level, at);
    at += 2 * (size_t)nodes;
    keep(w, umb__put_list(at, w->e->references, written, high_bits));
}

/* Divides the page's bricks into runs of equal slices, and finds the leaf of each run: the mask of
 * one slice. Returns the number of runs. */
static size_t list_leaves(struct writer *w)
{
    const uint32_t *nodes = w->nodes[UMB_LEVEL_BRICK];
    const uint32_t bricks = w->node_count[UMB_LEVEL_BRICK];
    uint32_t *reference = w->e->references;
    for (uint32_t i = 0; i < bricks; i++) {
        if (i + AHEAD < bricks) {
            __builtin_prefetch(w->octree->bricks[nodes[i + AHEAD]]);
        }
        const uint64_t *brick = w->octree->bricks[nodes[i]];
        w->e->runs[i] = (uint8_t)umb__brick_runs(brick);
        for (unsigned runs = w->e->runs[i]; runs != 0; runs &= runs - 1) {
            *reference++ = umb__value_set_add(&w->e->table, brick[__builtin_ctz(runs)]);
        }
    }
    return (size_t)(reference - w->e->references);
}

/* Writes the table's leaves: for each leaf the bits of the rows that differ from the leaf before,
 * then all these rows. One byte after them may be overwritten. */
static uint8_t *put_leaves(const struct umb__value_set *table, uint8_t *at)
{
    uint8_t *row = at + table->count;
    uint64_t last = 0;
    for (size_t i = 0; i < table->count; i++) {
        const uint64_t leaf = table->values[i], changed = leaf ^ last;
        unsigned differ = 0;
        for (unsigned y = 8; y-- > 0;) {
            const bool differs = (changed >> (8 * y) & 0xff) != 0;
            *row = (uint8_t)(leaf >> (8 * y));
            row += differs;
            differ |= (unsigned)differs << y;
        }
        at[i] = (uint8_t)differ;
        last = leaf;
    }
    return row;
}

static void write_bricks(struct writer *w)
{
    struct umb__page_encoder *e = w->e;
    const struct umb__value_set *table = &e->table;
    const size_t bricks = w->node_count[UMB_LEVEL_BRICK];
    if (!umb__grow(w->order->alloc, &e->runs, &e->runs_capacity, bricks, 1)) {
        w->failed = true;
        return;
    }
    if (!begin_table(w, 8 * bricks)) {
        return;
    }
    const size_t count = list_leaves(w);
    if (!sort_table(w)) {
        return;
    }
    const unsigned high_bits = umb__list_high_bits(table->count);
    uint8_t *at = reserve(w, UMB__NUMBER_BYTES_MAX + 9 * table->count + 1 + bricks +
                                 (size_t)umb__list_bytes(count, high_bits));
    if (!at) {
        return;
    }
    at = umb__put_number(at, (uint32_t)table->count);
    at = put_leaves(table, at);
    memcpy(at, e->runs, bricks);
    for (size_t i = 0; i < count; i++) {
        e->references[i] = table->rank[e->references[i]];
    }
    keep(w, umb__put_list(at + bricks, e->references, count, high_bits));
}

enum umb_status umb__page_encode(struct umb__page_encoder *encoder,
                                 const struct umb__octree *octree,
                                 const struct umb__pack_order *order, uint32_t page,
                                 struct umb_error *error)
{
    struct writer w = {.octree = octree, .order = order, .e = encoder, .page = page};
    encoder->raw_size = 0;
    find_nodes(&w);
    write_counts(&w);
    for (uint32_t level = w.level_high; level >= w.level_low && level > UMB_LEVEL_BRICK; level--) {
        write_nodes(&w, level);
    }
    if (w.level_low == UMB_LEVEL_BRICK && !w.failed) {
        write_bricks(&w);
    }
    if (w.failed) {
        return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for page %u", page);
    }
    if (encoder->raw_size > UMB__PAGE_RAW_MAX) {
        return umb_fail(error, UMB_E_INTERNAL, "packing: page %u takes %zu bytes, at most %u", page,
                        encoder->raw_size, UMB__PAGE_RAW_MAX);
    }
    return UMB_OK;
}

void umb__page_encoder_finish(struct umb__page_encoder *encoder, const struct umb_alloc *alloc)
{
    umb__free(alloc, encoder->raw);
    umb__free(alloc, encoder->references);
    umb__free(alloc, encoder->positions);
    umb__free(alloc, encoder->runs);
    umb__value_set_finish(&encoder->table, alloc);
    umb__value_set_finish(&encoder->own, alloc);
    memset(encoder, 0, sizeof *encoder);
}
