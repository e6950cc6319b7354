/* SPDX-License-Identifier: Apache-2.0 */
/* Expands pages; see expanded_page.h. */
#include "partial/expanded_page.h"

#include <string.h>

#include "base/memory.h"

/* Returns a part of the block at `*at` bytes, and moves `*at` behind the part. In: block: NULL
 * while the block is only measured. Parts begin at multiples of 8 bytes. */
static void *take(uint8_t *block, uint64_t *at, uint64_t count, size_t size)
{
    const uint64_t begin = *at;
    *at += (count * size + 7) / 8 * 8;
    return block ? block + begin : NULL;
}

/* Places the arrays of all levels in a block. Returns the bytes of the block. No sum overflows: a
 * page has at most 1 MiB, and each number counts bits or bytes of it. */
static uint64_t place_arrays(const struct umb__page *page, uint8_t *block,
                             struct umb__expanded *nodes)
{
    uint64_t bytes = sizeof *nodes;
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        struct umb__expanded_level *level = &nodes->level[l];
        const uint64_t count = page->node_count[l];
        if (count == 0) {
            continue;
        }
        level->first = take(block, &bytes, count + 1, sizeof *level->first);
        level->children = take(block, &bytes, page->child_count[l], sizeof *level->children);
        level->others = take(block, &bytes, page->external_count[l], sizeof *level->others);
        level->masks = take(block, &bytes, count, sizeof *level->masks);
        level->closed = take(block, &bytes, count, sizeof *level->closed);
        nodes->seen[l] = take(block, &bytes, count, sizeof *nodes->seen[l]);
    }
    return bytes;
}

static void fill_level(const struct umb__page *page, uint32_t l, struct umb__expanded_level *level)
{
    struct umb__page_others others = umb__page_others(page, l);
    struct umb__page_nodes reader = umb__page_nodes(page, l);
    uint32_t next = 0;
    for (uint32_t i = 0; i < page->external_count[l]; i++) {
        level->others[i] = umb__page_others_next(&others);
    }
    for (uint32_t i = 0; i < page->node_count[l]; i++) {
        uint32_t references[8];
        const unsigned count = umb__page_nodes_next(&reader, &level->masks[i], references);
        level->first[i] = next;
        for (unsigned c = 0; c < count; c++) {
            level->children[next++] = references[c];
        }
    }
    level->first[page->node_count[l]] = next;
    level->count = page->node_count[l];
}

/* Finds the nodes of a level below which everything is in the page. In: nodes: complete for the
 * level below. */
static void find_closed(struct umb__expanded *nodes, uint32_t l)
{
    struct umb__expanded_level *level = &nodes->level[l];
    const uint32_t own = umb__expanded_count(nodes, l - 1);
    const uint8_t *below = nodes->level[l - 1].closed; /* Bricks are all closed */
    for (uint32_t i = 0; i < level->count; i++) {
        uint8_t closed = 1;
        for (uint32_t c = level->first[i]; c < level->first[i + 1]; c++) {
            const uint32_t child = level->children[c];
            closed &= child < own && (l - 1 == UMB_LEVEL_BRICK || below[child]);
        }
        level->closed[i] = closed;
    }
}

struct umb__expanded *umb__expand_nodes(const struct umb__page *page, const struct umb_alloc *alloc)
{
    struct umb__expanded measured, *nodes;
    memset(&measured, 0, sizeof measured);
    uint8_t *block = umb__alloc(alloc, (size_t)place_arrays(page, NULL, &measured), 1);
    if (!block) {
        return NULL;
    }
    nodes = (void *)block;
    memset(nodes, 0, sizeof *nodes);
    (void)place_arrays(page, block, nodes);
    nodes->brick_count = page->node_count[UMB_LEVEL_BRICK];
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        if (page->node_count[l] > 0) {
            fill_level(page, l, &nodes->level[l]);
            find_closed(nodes, l);
        }
    }
    return nodes;
}

void umb__expand_bricks(const struct umb__page *page, uint64_t *leaves, uint64_t (*bricks)[8])
{
    umb__page_leaves(page, leaves);
    struct umb__page_bricks reader = umb__page_bricks(page, leaves);
    for (uint32_t i = 0; i < page->node_count[UMB_LEVEL_BRICK]; i++) {
        umb__page_bricks_next(&reader, bricks[i]);
    }
}
