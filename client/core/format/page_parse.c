/* SPDX-License-Identifier: Apache-2.0 */
/* The reading half of page.h. */
#include "format/page.h"

#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "format/layout.h"

static enum umb_status damaged(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_CORRUPT, "page: %s", what);
}

static bool parse_counts(const uint8_t **at, const uint8_t *end, struct umb__page *page)
{
    const uint8_t *bytes;
    for (uint32_t level = page->level_high; level >= page->level_low; level--) {
        if (!umb__take(at, end, 1, 4, &bytes)) {
            return false;
        }
        page->node_count[level] = umb__load32(bytes);
    }
    for (uint32_t level = page->level_high; level >= page->level_low && level > UMB_LEVEL_BRICK;
         level--) {
        if (!umb__take(at, end, 1, 4, &bytes)) {
            return false;
        }
        page->external_count[level] = umb__load32(bytes);
    }
    if (page->level_low == UMB_LEVEL_BRICK) {
        if (!umb__take(at, end, 1, 4, &bytes)) {
            return false;
        }
        page->leaf_count = umb__load32(bytes);
    }
    return true;
}

static bool all_below(const uint8_t *numbers, uint64_t count, unsigned width, uint64_t limit)
{
    for (uint64_t i = 0; i < count; i++) {
        if (umb__load_narrow(numbers + i * width, width) >= limit) {
            return false;
        }
    }
    return true;
}

static enum umb_status parse_nodes(const uint8_t **at, const uint8_t *end, uint32_t level,
                                   struct umb__page *page, struct umb_error *error)
{
    uint32_t nodes = page->node_count[level], externals = page->external_count[level];
    if (!umb__take(at, end, externals, 4, &page->external_pages[level]) ||
        !umb__take(at, end, externals, 4, &page->external_positions[level]) ||
        !umb__take(at, end, nodes, 2, &page->masks[level])) {
        return damaged(error, "nodes are cut");
    }
    uint64_t mixed = 0;
    for (uint32_t i = 0; i < nodes; i++) {
        uint16_t mask = umb__load16(page->masks[level] + 2 * (size_t)i);
        if ((mask & (mask >> 1) & 0x5555U) != 0) {
            return damaged(error, "a mask has a child of state 3");
        }
        mixed += umb_mask_mixed_count(mask);
    }
    uint64_t space = (uint64_t)page->node_count[level - 1] + externals;
    page->reference_count[level] = mixed;
    page->width[level] = umb__narrow_width(space);
    if (!umb__take(at, end, mixed, page->width[level], &page->references[level])) {
        return damaged(error, "references are cut");
    }
    if (!all_below(page->references[level], mixed, page->width[level], space)) {
        return damaged(error, "a reference is out of range");
    }
    return UMB_OK;
}

static enum umb_status parse_bricks(const uint8_t **at, const uint8_t *end,
                                    struct umb__page *page, struct umb_error *error)
{
    uint32_t bricks = page->node_count[UMB_LEVEL_BRICK];
    if (!umb__take(at, end, page->leaf_count, 8, &page->leaves) ||
        !umb__take(at, end, bricks, 1, &page->runs)) {
        return damaged(error, "bricks are cut");
    }
    uint64_t runs = 0;
    for (uint32_t i = 0; i < bricks; i++) {
        if ((page->runs[i] & 1) == 0) {
            return damaged(error, "a brick's first slice does not start a run");
        }
        runs += (unsigned)__builtin_popcount(page->runs[i]);
    }
    unsigned width = umb__narrow_width(page->leaf_count);
    page->width[UMB_LEVEL_BRICK] = width;
    page->reference_count[UMB_LEVEL_BRICK] = runs;
    if (!umb__take(at, end, runs, width, &page->leaf_numbers)) {
        return damaged(error, "leaf numbers are cut");
    }
    if (!all_below(page->leaf_numbers, runs, width, page->leaf_count)) {
        return damaged(error, "a leaf number is out of range");
    }
    return UMB_OK;
}

enum umb_status umb__page_parse(const uint8_t *raw, size_t size, struct umb__page *page,
                                struct umb_error *error)
{
    const uint8_t *at = raw, *end = raw + size, *head;
    memset(page, 0, sizeof *page);
    if (!umb__take(&at, end, 1, 4, &head)) {
        return damaged(error, "shorter than its head");
    }
    if (head[0] != UMB__PAGE_ENCODING) {
        return umb_fail(error, UMB_E_VERSION, "page: encoding %u, this reader knows %u", head[0],
                        UMB__PAGE_ENCODING);
    }
    page->level_high = head[1];
    page->level_low = head[2];
    if (page->level_high > UMB_LEVEL_MAX || page->level_low < UMB_LEVEL_BRICK ||
        page->level_low > page->level_high || head[3] != 0) {
        return damaged(error, "levels out of range");
    }
    if (!parse_counts(&at, end, page)) {
        return damaged(error, "counts are cut");
    }
    for (uint32_t level = page->level_high; level >= page->level_low && level > UMB_LEVEL_BRICK;
         level--) {
        enum umb_status status = parse_nodes(&at, end, level, page, error);
        if (status != UMB_OK) {
            return status;
        }
    }
    if (page->level_low == UMB_LEVEL_BRICK) {
        enum umb_status status = parse_bricks(&at, end, page, error);
        if (status != UMB_OK) {
            return status;
        }
    }
    return at == end ? UMB_OK : damaged(error, "bytes are left over");
}
