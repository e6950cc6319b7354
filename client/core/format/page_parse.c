/* SPDX-License-Identifier: Apache-2.0 */
/* Parsing pages; see page.h. */
#include "format/page.h"

#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "base/try.h"
#include "format/layout.h"

static enum umb_status damaged(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_CORRUPT, "page: %s", what);
}

static bool parse_counts(const uint8_t **at, const uint8_t *end, struct umb__page *page)
{
    for (uint32_t level = page->level_high; level >= page->level_low; level--) {
        if (!umb__take_number(at, end, &page->node_count[level])) {
            return false;
        }
    }
    return true;
}

/* Reads a list of numbers below a limit. */
static bool take_list(const uint8_t **at, const uint8_t *end, uint64_t count, uint64_t limit,
                      struct umb__number_list *list)
{
    const unsigned high_bits = umb__list_high_bits(limit);
    *list = (struct umb__number_list){.count = count, .high_bits = high_bits};
    return umb__take(at, end, umb__list_bytes(count, high_bits), 1, &list->bytes);
}

/* Checks the places of nodes in other pages: ascending, with pages and positions below 2^32. */
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

/* Finds the masks of a level and counts their mixed children. Out: written: number of children
 * whose references are written. Returns false if a mask is cut off. */
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
    if (!parse_counts(&at, end, page)) {
        return damaged(error, "counts are cut");
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
