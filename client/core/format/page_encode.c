/* SPDX-License-Identifier: Apache-2.0 */
/* The writing half of page.h. */
#include "format/page.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "format/layout.h"

/* The open page. */
struct encoder {
    const struct umb_octree *octree;
    const struct umb__pack_order *order;
    uint32_t page;
    uint8_t **raw;
    size_t *capacity;
    size_t size;
    bool failed;                          /* out of memory: checked at the end */
    uint32_t level_high, level_low;
    uint32_t node_count[UMB_LEVEL_MAX + 1];
    uint64_t *externals[UMB_LEVEL_MAX + 1]; /* sorted: page << 32 | position */
    size_t external_count[UMB_LEVEL_MAX + 1];
    size_t external_capacity[UMB_LEVEL_MAX + 1];
    uint64_t *leaves;                     /* sorted */
    size_t leaf_count, leaf_capacity;
    size_t reference_count[UMB_LEVEL_MAX + 1]; /* [3]: runs of all bricks */
};

static uint8_t *append(struct encoder *e, size_t count)
{
    if (e->failed ||
        !umb__grow(e->order->alloc, e->raw, e->capacity, e->size + count, sizeof **e->raw)) {
        e->failed = true;
        return NULL;
    }
    uint8_t *at = *e->raw + e->size;
    e->size += count;
    return at;
}

static void append32(struct encoder *e, uint32_t value)
{
    uint8_t *at = append(e, 4);
    if (at) {
        umb__store32(at, value);
    }
}

static int compare_u64(const void *a, const void *b)
{
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

static size_t sort_unique(uint64_t *values, size_t count)
{
    if (count == 0) {
        return 0;
    }
    qsort(values, count, sizeof *values, compare_u64);
    size_t kept = 1;
    for (size_t i = 1; i < count; i++) {
        if (values[i] != values[kept - 1]) {
            values[kept++] = values[i];
        }
    }
    return kept;
}

/* Index of a value that is there. */
static uint32_t index_in(const uint64_t *values, size_t count, uint64_t value)
{
    size_t low = 0, high = count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (values[middle] < value) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return (uint32_t)low;
}

static void push(struct encoder *e, uint64_t **values, size_t *count, size_t *capacity,
                 uint64_t value)
{
    if (e->failed || !umb__grow(e->order->alloc, values, capacity, *count + 1, sizeof **values)) {
        e->failed = true;
        return;
    }
    (*values)[(*count)++] = value;
}

static uint64_t external_key(const struct encoder *e, uint32_t level, uint32_t index)
{
    return (uint64_t)e->order->page_of[level][index] << 32 | e->order->position_of[level][index];
}

/* First pass: counts, nodes in other pages, distinct slices. */
static void collect(struct encoder *e)
{
    size_t end = e->order->page_first[e->page + 1];
    e->level_high = UMB_LEVEL_BRICK;
    e->level_low = UMB_LEVEL_MAX;
    for (size_t s = e->order->page_first[e->page]; s < end; s++) {
        struct umb__node_ref node = e->order->sequence[s];
        e->node_count[node.level]++;
        e->level_high = node.level > e->level_high ? node.level : e->level_high;
        e->level_low = node.level < e->level_low ? node.level : e->level_low;
        if (node.level == UMB_LEVEL_BRICK) {
            const uint64_t *brick = e->octree->bricks[node.index];
            for (size_t z = 0; z < 8; z++) {
                if (z == 0 || brick[z] != brick[z - 1]) {
                    push(e, &e->leaves, &e->leaf_count, &e->leaf_capacity, brick[z]);
                    e->reference_count[UMB_LEVEL_BRICK]++;
                }
            }
            continue;
        }
        const struct umb_octree_level *level = &e->octree->level[node.level];
        for (uint32_t c = level->first[node.index]; c < level->first[node.index + 1]; c++) {
            uint32_t child = level->children[c];
            e->reference_count[node.level]++;
            if (e->order->page_of[node.level - 1][child] != e->page) {
                push(e, &e->externals[node.level], &e->external_count[node.level],
                     &e->external_capacity[node.level], external_key(e, node.level - 1, child));
            }
        }
    }
    e->leaf_count = sort_unique(e->leaves, e->leaf_count);
    for (size_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        e->external_count[level] = sort_unique(e->externals[level], e->external_count[level]);
    }
}

static void write_counts(struct encoder *e)
{
    uint8_t *head = append(e, 4);
    if (head) {
        head[0] = UMB__PAGE_ENCODING;
        head[1] = (uint8_t)e->level_high;
        head[2] = (uint8_t)e->level_low;
        head[3] = 0;
    }
    for (uint32_t level = e->level_high; level >= e->level_low; level--) {
        append32(e, e->node_count[level]);
    }
    for (uint32_t level = e->level_high; level >= e->level_low && level > UMB_LEVEL_BRICK;
         level--) {
        append32(e, (uint32_t)e->external_count[level]);
    }
    if (e->level_low == UMB_LEVEL_BRICK) {
        append32(e, (uint32_t)e->leaf_count);
    }
}

/* Writes a node's references at `at` and returns where they end. */
static uint8_t *write_references(const struct encoder *e, uint32_t node_level, uint32_t index,
                                 unsigned width, uint8_t *at)
{
    const struct umb_octree_level *level = &e->octree->level[node_level];
    for (uint32_t c = level->first[index]; c < level->first[index + 1]; c++) {
        uint32_t child = level->children[c];
        uint32_t number = e->order->position_of[node_level - 1][child];
        if (e->order->page_of[node_level - 1][child] != e->page) {
            number = e->node_count[node_level - 1] +
                     index_in(e->externals[node_level], e->external_count[node_level],
                              external_key(e, node_level - 1, child));
        }
        umb__store_narrow(at, number, width);
        at += width;
    }
    return at;
}

static void write_nodes(struct encoder *e, uint32_t node_level)
{
    for (size_t i = 0; i < e->external_count[node_level]; i++) {
        append32(e, (uint32_t)(e->externals[node_level][i] >> 32));
    }
    for (size_t i = 0; i < e->external_count[node_level]; i++) {
        append32(e, (uint32_t)e->externals[node_level][i]);
    }
    unsigned width = umb__narrow_width((uint64_t)e->node_count[node_level - 1] +
                                       e->external_count[node_level]);
    size_t mask_bytes = 2 * (size_t)e->node_count[node_level];
    uint8_t *mask = append(e, mask_bytes + width * e->reference_count[node_level]);
    if (!mask) {
        return;
    }
    uint8_t *reference = mask + mask_bytes;
    size_t end = e->order->page_first[e->page + 1];
    for (size_t s = e->order->page_first[e->page]; s < end; s++) {
        struct umb__node_ref node = e->order->sequence[s];
        if (node.level == node_level) {
            umb__store16(mask, e->octree->level[node_level].masks[node.index]);
            mask += 2;
            reference = write_references(e, node_level, node.index, width, reference);
        }
    }
}

/* Writes one brick's leaf numbers at `at`; returns where they end, and its runs. */
static uint8_t *write_brick(const struct encoder *e, const uint64_t *brick, unsigned width,
                            uint8_t *at, uint8_t *runs)
{
    unsigned bits = 0;
    for (unsigned z = 0; z < 8; z++) {
        if (z == 0 || brick[z] != brick[z - 1]) {
            bits |= 1U << z;
            umb__store_narrow(at, index_in(e->leaves, e->leaf_count, brick[z]), width);
            at += width;
        }
    }
    *runs = (uint8_t)bits;
    return at;
}

static void write_bricks(struct encoder *e)
{
    unsigned width = umb__narrow_width(e->leaf_count);
    size_t leaf_bytes = 8 * e->leaf_count, bricks = e->node_count[UMB_LEVEL_BRICK];
    uint8_t *leaves = append(e, leaf_bytes + bricks + width * e->reference_count[UMB_LEVEL_BRICK]);
    if (!leaves) {
        return;
    }
    for (size_t i = 0; i < e->leaf_count; i++) {
        umb__store64(leaves + 8 * i, e->leaves[i]);
    }
    uint8_t *runs = leaves + leaf_bytes, *numbers = runs + bricks;
    size_t end = e->order->page_first[e->page + 1];
    for (size_t s = e->order->page_first[e->page]; s < end; s++) {
        struct umb__node_ref node = e->order->sequence[s];
        if (node.level == UMB_LEVEL_BRICK) {
            numbers = write_brick(e, e->octree->bricks[node.index], width, numbers, runs++);
        }
    }
}

enum umb_status umb__page_encode(const struct umb_octree *octree,
                                 const struct umb__pack_order *order, uint32_t page,
                                 uint8_t **raw, size_t *capacity, size_t *size,
                                 struct umb_error *error)
{
    struct encoder e = {
        .octree = octree, .order = order, .page = page, .raw = raw, .capacity = capacity};
    collect(&e);
    write_counts(&e);
    for (uint32_t level = e.level_high; level >= e.level_low && level > UMB_LEVEL_BRICK; level--) {
        write_nodes(&e, level);
    }
    if (e.level_low == UMB_LEVEL_BRICK) {
        write_bricks(&e);
    }
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(order->alloc, e.externals[level]);
    }
    umb__free(order->alloc, e.leaves);
    *size = e.size;
    if (e.failed) {
        return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for page %u", page);
    }
    if (e.size > UMB__PAGE_RAW_MAX) {
        return umb_fail(error, UMB_E_INTERNAL, "packing: page %u takes %zu bytes, at most %u", page,
                        e.size, UMB__PAGE_RAW_MAX);
    }
    return UMB_OK;
}
