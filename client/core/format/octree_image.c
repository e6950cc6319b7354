/* SPDX-License-Identifier: Apache-2.0 */
/* See octree_image.h. */
#include "format/octree_image.h"

#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/node_pool_parts.h"
#include "format/pack_survey.h"

#define HEAD_BYTES (4 + 8 * (size_t)(UMB_LEVEL_MAX - UMB_LEVEL_BRICK))

/* Look-ups ahead of which slots are prefetched. */
#define AHEAD 16U

/* Most nodes of a level of an image: far above what memory holds. */
#define NODES_MAX (UINT32_MAX / 2)

static uint32_t child_count(const struct umb__octree_level *level)
{
    return level->count > 0 ? level->first[level->count] : 0;
}

uint64_t umb__octree_image_bytes(const struct umb__octree *octree)
{
    uint64_t bytes = HEAD_BYTES + 64 * (uint64_t)octree->brick_count;
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const struct umb__octree_level *level = &octree->level[l];
        bytes += 2 * (uint64_t)level->count + 4 * (uint64_t)child_count(level);
    }
    return bytes;
}

void umb__octree_image_write(const struct umb__octree *octree, uint8_t *to)
{
    uint8_t *head = to, *at = to + HEAD_BYTES;
    umb__store32(head, octree->brick_count);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const struct umb__octree_level *level = &octree->level[l];
        const uint32_t children = child_count(level);
        umb__store32(head + 4 + 8 * (size_t)(l - UMB_LEVEL_BRICK - 1), level->count);
        umb__store32(head + 8 + 8 * (size_t)(l - UMB_LEVEL_BRICK - 1), children);
        for (uint32_t i = 0; i < level->count; i++, at += 2) {
            umb__store16(at, level->masks[i]);
        }
        for (uint32_t i = 0; i < children; i++, at += 4) {
            umb__store32(at, level->children[i]);
        }
    }
    for (uint32_t i = 0; i < octree->brick_count; i++) {
        for (size_t z = 0; z < 8; z++, at += 8) {
            umb__store64(at, octree->bricks[i][z]);
        }
    }
}

static enum umb_status corrupt(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_CORRUPT, "octree image: %s", what);
}

/* Loads the bricks. Returns false if one is uniform. The level has its count from the beginning, so
 * that umb__pool_clear also clears the table of a level that fails. */
static bool load_bricks(struct umb__pool *pool, const uint8_t *bytes, uint32_t count)
{
    struct umb__pool_level *level = &pool->level[UMB_LEVEL_BRICK];
    uint32_t tags[AHEAD] = {0};
    level->count = count;
    for (uint32_t i = 0; i < count + AHEAD; i++) {
        if (i >= AHEAD) {
            const uint32_t tag = tags[i % AHEAD];
            level->slots.words[umb__slot_free(&level->slots, tag)] = umb__slot_word(tag, i - AHEAD);
        }
        if (i < count) {
            uint64_t *brick = pool->bricks[i], any = 0, all = UINT64_MAX;
            for (size_t z = 0; z < 8; z++) {
                brick[z] = umb__load64(bytes + 64 * (size_t)i + 8 * z);
                any |= brick[z];
                all &= brick[z];
            }
            if (any == 0 || all == UINT64_MAX) {
                return false;
            }
            tags[i % AHEAD] = umb__brick_tag(pool, brick);
            __builtin_prefetch(level->slots.words + umb__slot_place(&level->slots, tags[i % AHEAD]),
                               1);
        }
    }
    return true;
}

/* Reads a node's children behind those of the nodes before. Returns false if the node cannot be. */
static bool load_node(struct umb__pool_level *level, uint32_t node, uint16_t mask,
                      const uint8_t *children, uint32_t child_end, uint32_t below,
                      struct umb__node_key *key)
{
    const uint32_t first = level->first[node], count = umb__mask_mixed_count(mask);
    *key = (struct umb__node_key){.words = {mask}, .child_count = count};
    if ((mask & (mask >> 1) & 0x5555U) != 0 || mask == 0 || mask == 0x5555 ||
        count > child_end - first) {
        return false;
    }
    for (uint32_t c = 0; c < count; c++) {
        const uint32_t child = umb__load32(children + 4 * (size_t)(first + c));
        level->children[first + c] = key->words[1 + c] = child;
        if (child >= below) {
            return false;
        }
    }
    level->masks[node] = mask;
    level->first[node + 1] = first + count;
    return true;
}

/* Loads the nodes of a level. Returns false if one cannot be. */
static bool load_nodes(struct umb__pool *pool, uint32_t number, const uint8_t *masks,
                       uint32_t count, const uint8_t *children, uint32_t child_end)
{
    struct umb__pool_level *level = &pool->level[number];
    const uint32_t below = pool->level[number - 1].count;
    uint32_t tags[AHEAD] = {0};
    level->count = count;
    level->child_count = child_end;
    for (uint32_t i = 0; i < count + AHEAD; i++) {
        if (i >= AHEAD) {
            const uint32_t tag = tags[i % AHEAD];
            level->slots.words[umb__slot_free(&level->slots, tag)] = umb__slot_word(tag, i - AHEAD);
        }
        if (i < count) {
            struct umb__node_key key;
            if (!load_node(level, i, umb__load16(masks + 2 * (size_t)i), children, child_end, below,
                           &key)) {
                return false;
            }
            tags[i % AHEAD] = umb__key_tag(pool, &key);
            __builtin_prefetch(level->slots.words + umb__slot_place(&level->slots, tags[i % AHEAD]),
                               1);
        }
    }
    return level->first[count] == child_end;
}

enum umb_status umb__pool_load(struct umb__pool *pool, const uint8_t *bytes, size_t size,
                               struct umb_error *error)
{
    const uint8_t *at = bytes, *const end = bytes + size, *head, *part, *children;
    const uint8_t *masks_of[UMB_LEVEL_MAX + 1], *children_of[UMB_LEVEL_MAX + 1];
    if (!umb__take(&at, end, HEAD_BYTES, 1, &head)) {
        return corrupt(error, "cut");
    }
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const uint8_t *counts = head + 4 + 8 * (size_t)(l - UMB_LEVEL_BRICK - 1);
        if (umb__load32(counts) > NODES_MAX ||
            !umb__take(&at, end, umb__load32(counts), 2, &part) ||
            !umb__take(&at, end, umb__load32(counts + 4), 4, &children)) {
            return corrupt(error, "its size is not what its counts ask for");
        }
        masks_of[l] = part;
        children_of[l] = children;
    }
    const uint32_t bricks = umb__load32(head);
    if (bricks > NODES_MAX || !umb__take(&at, end, bricks, 64, &part) || at != end) {
        return corrupt(error, "its size is not what its counts ask for");
    }
    UMB__TRY(umb__pool_reserve(pool, UMB_LEVEL_BRICK, bricks, 0, error));
    if (bricks > 0 && !load_bricks(pool, part, bricks)) {
        return corrupt(error, "a uniform brick");
    }
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const uint8_t *counts = head + 4 + 8 * (size_t)(l - UMB_LEVEL_BRICK - 1);
        const uint32_t nodes = umb__load32(counts), count = umb__load32(counts + 4);
        if (nodes == 0 && count == 0) {
            continue;
        }
        UMB__TRY(umb__pool_reserve(pool, l, nodes, count, error));
        if (nodes == 0 || !load_nodes(pool, l, masks_of[l], nodes, children_of[l], count)) {
            return corrupt(error, "nodes that do not fit each other");
        }
    }
    return UMB_OK;
}

/* Numbers the reached nodes of a level. */
static void number_level(const struct umb__octree *octree, const struct umb__pack_survey *survey,
                         uint32_t level, uint32_t *numbers)
{
    uint32_t next = 0;
    for (uint32_t i = 0; i < umb__octree_level_count(octree, level); i++) {
        numbers[i] = umb__pack_reached(survey, level, i) ? next++ : UINT32_MAX;
    }
}

/* Moves the reached nodes of a level together. */
static void compact_level(struct umb__octree_level *level, const uint32_t *numbers,
                          const uint32_t *below)
{
    uint32_t count = 0, end = 0;
    for (uint32_t i = 0; i < level->count; i++) {
        const uint32_t first = level->first[i], last = level->first[i + 1];
        if (numbers[i] == UINT32_MAX) {
            continue;
        }
        level->masks[count] = level->masks[i];
        level->first[count++] = end; /* entry i + 1 is read before it is overwritten */
        for (uint32_t c = first; c < last; c++) {
            level->children[end++] = below[level->children[c]];
        }
    }
    if (level->first != NULL) {
        level->first[count] = end;
    }
    level->count = count;
}

static void compact_bricks(struct umb__octree *octree, const uint32_t *numbers)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < octree->brick_count; i++) {
        if (numbers[i] != UINT32_MAX) {
            memmove(octree->bricks[count++], octree->bricks[i], sizeof *octree->bricks);
        }
    }
    octree->brick_count = count;
}

enum umb_status umb__octree_compact(struct umb__octree *octree, struct umb__octree_map *map,
                                    struct umb_error *error)
{
    struct umb__pack_survey survey;
    *map = (struct umb__octree_map){.alloc = octree->alloc};
    UMB__TRY(umb__pack_survey(octree, &survey, error));
    bool complete = true;
    for (uint32_t l = UMB_LEVEL_BRICK; l <= UMB_LEVEL_MAX && complete; l++) {
        const size_t count = umb__octree_level_count(octree, l);
        map->numbers[l] = umb__alloc(octree->alloc, count + 1, sizeof *map->numbers[l]);
        complete = map->numbers[l] != NULL;
        if (complete) {
            number_level(octree, &survey, l, map->numbers[l]);
        }
    }
    umb__pack_survey_finish(&survey);
    if (!complete) {
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: no memory to number its nodes");
    }
    compact_bricks(octree, map->numbers[UMB_LEVEL_BRICK]);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        compact_level(&octree->level[l], map->numbers[l], map->numbers[l - 1]);
    }
    for (uint32_t i = 0; i < octree->root_count; i++) {
        struct umb__octree_root *root = &octree->roots[i];
        if (root->state == UMB__NODE_MIXED) {
            root->index = map->numbers[root->level][root->index];
        }
    }
    return UMB_OK;
}

void umb__octree_map_finish(struct umb__octree_map *map)
{
    for (size_t l = 0; l <= UMB_LEVEL_MAX; l++) {
        umb__free(map->alloc, map->numbers[l]);
        map->numbers[l] = NULL;
    }
}
