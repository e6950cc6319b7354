/* SPDX-License-Identifier: Apache-2.0 */
/* See pack_kept.h. */
#include "format/pack_kept.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"

#define PAGE_BYTES (16 + (size_t)UMB__PAGE_ENTRY)
#define CUT_BYTES  ((size_t)8)

/* Arrays of a level: sums, and from the level of cuts on parts and bytes. */
static uint32_t arrays_of(uint32_t level)
{
    return level >= UMB__CUT_LOWEST ? 3 : 1;
}

static uint32_t stored_length(const struct umb__kept_page *page)
{
    return umb__load32(page->entry + UMB__PAGE_STORED_LENGTH);
}

uint64_t umb__pack_kept_bytes(const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                              uint32_t page_count)
{
    uint64_t bytes = 4 + 8;
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        bytes += 4 + 4 * (uint64_t)arrays_of(l) * cuts->octree->level[l].count;
    }
    for (uint32_t i = 0; i < page_count; i++) {
        if (pages[i].page.level > 0) {
            bytes += PAGE_BYTES + CUT_BYTES * pages[i].cut_count + stored_length(&pages[i]);
        }
    }
    return bytes;
}

static uint8_t *put32(uint8_t *at, uint32_t value)
{
    umb__store32(at, value);
    return at + 4;
}

static uint8_t *put_array(uint8_t *at, const uint32_t *values, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        at = put32(at, values[i]);
    }
    return at;
}

/* Writes the entry of a page, without its place in the file. */
static uint8_t *put_page(uint8_t *at, const struct umb__kept_page *page)
{
    at = put32(at, page->page.level);
    at = put32(at, page->page.node);
    at = put32(at, page->page.part);
    at = put32(at, page->cut_count);
    memcpy(at, page->entry, UMB__PAGE_ENTRY);
    umb__store64(at + UMB__PAGE_OFFSET, 0);
    umb__store16(at + UMB__PAGE_LINKS, 0);
    return at + UMB__PAGE_ENTRY;
}

void umb__pack_kept_write(const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                          uint32_t page_count, uint8_t *to)
{
    uint8_t *at = put32(to, cuts->page_bytes);
    uint32_t kept = 0, links = 0;
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        at = put32(at, cuts->octree->level[l].count);
    }
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const uint32_t count = cuts->octree->level[l].count;
        at = put_array(at, cuts->sums[l], count);
        if (l >= UMB__CUT_LOWEST) {
            at = put_array(at, cuts->parts[l], count);
            at = put_array(at, cuts->bytes[l], count);
        }
    }
    for (uint32_t i = 0; i < page_count; i++) {
        kept += pages[i].page.level > 0;
        links += pages[i].page.level > 0 ? pages[i].cut_count : 0;
    }
    at = put32(put32(at, kept), links);
    for (uint32_t i = 0; i < page_count; i++) {
        at = pages[i].page.level > 0 ? put_page(at, &pages[i]) : at;
    }
    for (uint32_t i = 0; i < page_count; i++) {
        for (uint32_t c = 0; pages[i].page.level > 0 && c < pages[i].cut_count; c++) {
            at = put32(put32(at, pages[i].cuts[c].level), pages[i].cuts[c].index);
        }
    }
    for (uint32_t i = 0; i < page_count; i++) {
        if (pages[i].page.level > 0) {
            memcpy(at, pages[i].stored, stored_length(&pages[i]));
            at += stored_length(&pages[i]);
        }
    }
}

static enum umb_status corrupt(struct umb_error *error)
{
    return umb_fail(error, UMB_E_CORRUPT, "kept pages: malformed");
}

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "kept pages: out of memory");
}

/* Returns the new number of a node; UINT32_MAX: removed. */
static uint32_t renumber(const struct umb__octree_map *map, uint32_t level, uint32_t node)
{
    return map ? map->numbers[level][node] : node;
}

/* Reads an array of a level. Returns NULL if out of memory. */
static uint32_t *read_array(const uint8_t *bytes, const struct umb__octree_map *map, uint32_t level,
                            uint32_t count)
{
    uint32_t *values = umb__alloc(NULL, (size_t)count + 1, sizeof *values);
    uint32_t next = 0;
    for (uint32_t i = 0; values && i < count; i++) {
        if (renumber(map, level, i) != UINT32_MAX) {
            values[next++] = umb__load32(bytes + 4 * (size_t)i);
        }
    }
    return values;
}

/* Number of the nodes that are left. */
static uint32_t left_of(const struct umb__octree_map *map, uint32_t level, uint32_t count)
{
    uint32_t left = 0;
    for (uint32_t i = 0; i < count; i++) {
        left += renumber(map, level, i) != UINT32_MAX;
    }
    return left;
}

static enum umb_status read_levels(const uint8_t **at, const uint8_t *end, const uint32_t *counts,
                                   const struct umb__octree_map *map, struct umb__pack_kept *kept,
                                   struct umb_error *error)
{
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const uint8_t *arrays;
        const size_t count = counts[l];
        if (!umb__take(at, end, count * arrays_of(l), 4, &arrays)) {
            return corrupt(error);
        }
        kept->counts[l] = left_of(map, l, counts[l]);
        kept->sums[l] = read_array(arrays, map, l, counts[l]);
        bool complete = kept->sums[l] != NULL;
        if (l >= UMB__CUT_LOWEST) {
            kept->parts[l] = read_array(arrays + 4 * count, map, l, counts[l]);
            kept->bytes[l] = read_array(arrays + 8 * count, map, l, counts[l]);
            complete = complete && kept->parts[l] && kept->bytes[l];
        }
        if (!complete) {
            return no_memory(error);
        }
    }
    return UMB_OK;
}

/* Reads a number of a cut node. Returns false if it cannot be one. */
static bool read_node(const uint8_t *at, const uint32_t *counts, const struct umb__octree_map *map,
                      struct umb__node_ref *node)
{
    node->level = umb__load32(at);
    node->index = umb__load32(at + 4);
    if (node->level < UMB__CUT_LOWEST || node->level > UMB_LEVEL_MAX ||
        node->index >= counts[node->level]) {
        return false;
    }
    node->index = renumber(map, node->level, node->index);
    return true;
}

/* Reads a page with its cuts and bytes. Returns 0 if it cannot be; -1 if its node is removed.
 * In and out: cut_at, stored_at: of the page, then of the next. */
static int read_page(const uint8_t *at, const uint8_t *end, const uint8_t **cut_at,
                     const uint8_t *cut_end, const uint8_t **stored_at, const uint32_t *counts,
                     const struct umb__octree_map *map, struct umb__node_ref *cuts,
                     struct umb__kept_page *page)
{
    struct umb__node_ref node;
    const uint8_t *links;
    *page =
        (struct umb__kept_page){.entry = at + 16, .cuts = cuts, .cut_count = umb__load32(at + 12)};
    if (!read_node(at, counts, map, &node) ||
        !umb__take(cut_at, cut_end, page->cut_count, CUT_BYTES, &links) ||
        !umb__take(stored_at, end, stored_length(page), 1, &page->stored)) {
        return 0;
    }
    page->page = (struct umb__pack_page){node.level, node.index, umb__load32(at + 8)};
    for (uint32_t c = 0; c < page->cut_count; c++) {
        if (!read_node(links + CUT_BYTES * c, counts, map, &cuts[c]) ||
            (node.index != UINT32_MAX && cuts[c].index == UINT32_MAX)) {
            return 0;
        }
    }
    return node.index == UINT32_MAX ? -1 : 1;
}

/* Order of kept pages. */
static int compare_pages(const void *a, const void *b)
{
    const struct umb__pack_page *one = &((const struct umb__kept_page *)a)->page;
    const struct umb__pack_page *two = &((const struct umb__kept_page *)b)->page;
    if (one->level != two->level) {
        return one->level < two->level ? -1 : 1;
    }
    if (one->node != two->node) {
        return one->node < two->node ? -1 : 1;
    }
    return (one->part > two->part) - (one->part < two->part);
}

static enum umb_status read_pages(const uint8_t *at, const uint8_t *end, const uint32_t *counts,
                                  const struct umb__octree_map *map, struct umb__pack_kept *kept,
                                  struct umb_error *error)
{
    const uint8_t *head, *pages, *cut_at;
    if (!umb__take(&at, end, 1, 8, &head) ||
        !umb__take(&at, end, umb__load32(head), PAGE_BYTES, &pages) ||
        !umb__take(&at, end, umb__load32(head + 4), CUT_BYTES, &cut_at)) {
        return corrupt(error);
    }
    const uint32_t page_count = umb__load32(head);
    const uint8_t *const cut_first = cut_at, *const cut_end = at;
    kept->pages = umb__alloc(NULL, (size_t)page_count + 1, sizeof *kept->pages);
    kept->cuts = umb__alloc(NULL, (size_t)umb__load32(head + 4) + 1, sizeof *kept->cuts);
    if (!kept->pages || !kept->cuts) {
        return no_memory(error);
    }
    for (uint32_t i = 0; i < page_count; i++) {
        struct umb__node_ref *cuts = kept->cuts + (size_t)(cut_at - cut_first) / CUT_BYTES;
        const int read = read_page(pages + i * PAGE_BYTES, end, &cut_at, cut_end, &at, counts, map,
                                   cuts, &kept->pages[kept->page_count]);
        if (read == 0) {
            return corrupt(error);
        }
        kept->page_count += read > 0;
    }
    qsort(kept->pages, kept->page_count, sizeof *kept->pages, compare_pages);
    return at == end ? UMB_OK : corrupt(error);
}

enum umb_status umb__pack_kept_read(const uint8_t *bytes, size_t size,
                                    const uint32_t counts[UMB_LEVEL_MAX + 1],
                                    const struct umb__octree_map *map, struct umb__pack_kept *kept,
                                    struct umb_error *error)
{
    const uint8_t *at = bytes, *const end = bytes + size, *head;
    memset(kept, 0, sizeof *kept);
    if (!umb__take(&at, end, 1 + UMB_LEVEL_MAX - UMB_LEVEL_BRICK, 4, &head)) {
        return corrupt(error);
    }
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        if (umb__load32(head + 4 * (size_t)(l - UMB_LEVEL_BRICK)) != counts[l]) {
            return corrupt(error);
        }
    }
    kept->page_bytes = umb__load32(head);
    UMB__TRY(read_levels(&at, end, counts, map, kept, error));
    return read_pages(at, end, counts, map, kept, error);
}

void umb__pack_kept_finish(struct umb__pack_kept *kept)
{
    for (size_t l = 0; l <= UMB_LEVEL_MAX; l++) {
        umb__free(NULL, kept->sums[l]);
        umb__free(NULL, kept->parts[l]);
        umb__free(NULL, kept->bytes[l]);
    }
    umb__free(NULL, kept->pages);
    umb__free(NULL, kept->cuts);
    memset(kept, 0, sizeof *kept);
}

const struct umb__kept_page *umb__pack_kept_find(const struct umb__pack_kept *kept,
                                                 const struct umb__pack_page *page)
{
    const struct umb__kept_page wanted = {.page = *page};
    return page->level == 0 || kept->page_count == 0
               ? NULL
               : bsearch(&wanted, kept->pages, kept->page_count, sizeof *kept->pages,
                         compare_pages);
}
