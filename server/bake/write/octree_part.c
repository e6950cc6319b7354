/* SPDX-License-Identifier: Apache-2.0 */
/* See octree_part.h. Above the tiles the octree is walked cube by cube, and new nodes are made;
 * below, each node is copied once. The depth of both walks is that of the tree. */
#include "bake/write/octree_part.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"

/* Divisor of all tiles: at most this part of them is copied. */
#define TILES_SHARE 4U

/* Most cubes of tiles to be walked: a bound of the time above the tiles. */
#define CUBES_MAX ((uint64_t)1 << 18)

/* Room of a level of the part. */
struct room {
    size_t nodes, firsts, children;
};

struct copying {
    const struct umb__octree *from;
    struct umb__octree *to;
    const struct umbb_frustum_proofs *proofs; /* of the current frustum */
    uint32_t *sums; /* [(across + 1)^2] number of wanted tiles left of and above each tile */
    uint32_t *copies[UMB_LEVEL_MAX + 1]; /* [count] number of a node's copy, plus 1; 0: none */
    struct room room[UMB_LEVEL_MAX + 1];
    size_t brick_room;
};

/* A child: its state, and its number in the part if it is mixed. */
struct child {
    enum umb__node_state state;
    uint32_t number;
};

static const struct child shadowed = {UMB__NODE_SHADOWED, 0};

/* Returns the number of tiles along a side. */
static uint32_t tiles_across(const struct umbb_frustum_proofs *proofs)
{
    return 1U << (proofs->log2_size - proofs->tile_log2);
}

/* Returns 1 if a tile or one of the eight around it was not inherited. */
static int is_wanted(const struct umbb_frustum_proofs *proofs, uint32_t x, uint32_t y)
{
    const uint32_t across = tiles_across(proofs);
    for (uint32_t ty = y > 0 ? y - 1 : 0; ty <= y + 1 && ty < across; ty++) {
        for (uint32_t tx = x > 0 ? x - 1 : 0; tx <= x + 1 && tx < across; tx++) {
            if (!proofs->inherited[(size_t)ty * across + tx]) {
                return 1;
            }
        }
    }
    return 0;
}

static uint64_t wanted_count(const struct umbb_frustum_proofs *proofs)
{
    const uint32_t across = tiles_across(proofs);
    uint64_t count = 0;
    for (uint32_t y = 0; y < across; y++) {
        for (uint32_t x = 0; x < across; x++) {
            count += (uint64_t)is_wanted(proofs, x, y);
        }
    }
    return count;
}

int umbb_octree_part_pays(const struct umbb_proofs *proofs)
{
    uint64_t tiles = 0, wanted = 0, cubes = 0;
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        const uint64_t count = wanted_count(&proofs->frusta[f]);
        tiles += proofs->frusta[f].tile_count;
        wanted += count;
        cubes += count * tiles_across(&proofs->frusta[f]);
    }
    return wanted <= tiles / TILES_SHARE && cubes <= CUBES_MAX;
}

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "self-check: no memory for the tiles to be compared");
}

/* Sums the wanted tiles of the current frustum. */
static enum umb_status sum_wanted(struct copying *c, struct umb_error *error)
{
    const uint32_t across = tiles_across(c->proofs), width = across + 1;
    free(c->sums);
    c->sums = calloc((size_t)width * width, sizeof *c->sums);
    if (c->sums == NULL) {
        return no_memory(error);
    }
    for (uint32_t y = 0; y < across; y++) {
        uint32_t row = 0;
        for (uint32_t x = 0; x < across; x++) {
            row += (uint32_t)is_wanted(c->proofs, x, y);
            c->sums[(size_t)(y + 1) * width + x + 1] = c->sums[(size_t)y * width + x + 1] + row;
        }
    }
    return UMB_OK;
}

/* Returns 1 if any tile of a square of tiles is wanted. */
static int any_wanted(const struct copying *c, uint32_t x, uint32_t y, uint32_t side)
{
    const size_t width = (size_t)tiles_across(c->proofs) + 1;
    const uint32_t *sums = c->sums;
    return sums[(y + side) * width + x + side] - sums[y * width + x + side] -
               sums[(y + side) * width + x] + sums[y * width + x] >
           0;
}

/* Appends a node. In: children: eight. Out: made: the node, or the state of all its children. */
static enum umb_status add_node(struct copying *c, uint32_t number, const struct child children[8],
                                struct child *made, struct umb_error *error)
{
    const struct umb_alloc *alloc = c->to->alloc;
    struct umb__octree_level *level = &c->to->level[number];
    struct room *room = &c->room[number];
    const uint32_t first = level->count > 0 ? level->first[level->count] : 0;
    uint32_t mask = 0, end = first;
    *made = children[0];
    int uniform = children[0].state != UMB__NODE_MIXED;
    for (unsigned i = 1; i < 8; i++) {
        uniform = uniform && children[i].state == children[0].state;
    }
    if (uniform) {
        return UMB_OK;
    }
    if (!umb__grow(alloc, &level->masks, &room->nodes, (size_t)level->count + 1,
                   sizeof *level->masks) ||
        !umb__grow(alloc, &level->first, &room->firsts, (size_t)level->count + 2,
                   sizeof *level->first) ||
        !umb__grow(alloc, &level->children, &room->children, (size_t)first + 8,
                   sizeof *level->children)) {
        return no_memory(error);
    }
    for (unsigned i = 0; i < 8; i++) {
        mask |= (uint32_t)children[i].state << (2 * i);
        if (children[i].state == UMB__NODE_MIXED) {
            level->children[end++] = children[i].number;
        }
    }
    level->masks[level->count] = (uint16_t)mask;
    level->first[level->count] = first;
    level->first[level->count + 1] = end;
    *made = (struct child){UMB__NODE_MIXED, level->count++};
    return UMB_OK;
}

/* Copies a brick. */
static enum umb_status copy_brick(struct copying *c, uint32_t brick, struct umb_error *error)
{
    struct umb__octree *to = c->to;
    if (!umb__grow(to->alloc, &to->bricks, &c->brick_room, (size_t)to->brick_count + 1,
                   sizeof *to->bricks)) {
        return no_memory(error);
    }
    memcpy(to->bricks[to->brick_count], c->from->bricks[brick], sizeof *to->bricks);
    c->copies[UMB_LEVEL_BRICK][brick] = ++to->brick_count;
    return UMB_OK;
}

/* Copies a node and all below it. */
static enum umb_status copy_node(struct copying *c, uint32_t level, uint32_t node,
                                 struct umb_error *error)
{
    const struct umb__octree_level *nodes = &c->from->level[level];
    struct child children[8], made;
    if (c->copies[level][node] != 0) {
        return UMB_OK;
    }
    if (level == UMB_LEVEL_BRICK) {
        return copy_brick(c, node, error);
    }
    const uint32_t *next = nodes->children + nodes->first[node];
    for (unsigned i = 0; i < 8; i++) {
        children[i] = (struct child){umb__mask_state(nodes->masks[node], i), 0};
        if (children[i].state == UMB__NODE_MIXED) {
            UMB__TRY(copy_node(c, level - 1, *next, error));
            children[i].number = c->copies[level - 1][*next++] - 1;
        }
    }
    UMB__TRY(add_node(c, level, children, &made, error));
    c->copies[level][node] = made.number + 1; /* a canonical node is not uniform */
    return UMB_OK;
}

/* Copies the wanted part of a mixed node. In: x, y: its first tile. */
static enum umb_status copy_cube(struct copying *c, uint32_t level, uint32_t node, uint32_t x,
                                 uint32_t y, struct child *made, struct umb_error *error)
{
    const struct umb__octree_level *nodes = &c->from->level[level];
    struct child children[8];
    if (level == c->proofs->tile_log2) {
        UMB__TRY(copy_node(c, level, node, error));
        *made = (struct child){UMB__NODE_MIXED, c->copies[level][node] - 1};
        return UMB_OK;
    }
    const uint32_t half = 1U << (level - 1 - c->proofs->tile_log2);
    const uint32_t *next = nodes->children + nodes->first[node];
    for (unsigned i = 0; i < 8; i++) {
        const uint32_t cx = x + (i & 1) * half, cy = y + (i >> 1 & 1) * half;
        const enum umb__node_state state = umb__mask_state(nodes->masks[node], i);
        const uint32_t number = state == UMB__NODE_MIXED ? *next++ : 0;
        const int wanted = any_wanted(c, cx, cy, half);
        children[i] = wanted ? (struct child){state, 0} : shadowed;
        if (wanted && state == UMB__NODE_MIXED) {
            UMB__TRY(copy_cube(c, level - 1, number, cx, cy, &children[i], error));
        }
    }
    return add_node(c, level, children, made, error);
}

/* Makes the part with everything allocated. */
static enum umb_status copy_frusta(struct copying *c, const struct umbb_proofs *proofs,
                                   struct umb_error *error)
{
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        const struct umb__octree_root *root = &c->from->roots[f];
        struct child made = {root->state, 0};
        c->proofs = &proofs->frusta[f];
        UMB__TRY(sum_wanted(c, error));
        if (!any_wanted(c, 0, 0, tiles_across(c->proofs))) {
            made = shadowed;
        } else if (root->state == UMB__NODE_MIXED) {
            UMB__TRY(copy_cube(c, root->level, root->index, 0, 0, &made, error));
        }
        c->to->roots[f] = (struct umb__octree_root){made.state, root->level, made.number};
    }
    return UMB_OK;
}

enum umb_status umbb_octree_part(const struct umb__octree *octree, const struct umbb_proofs *proofs,
                                 struct umb__octree *part, struct umb_error *error)
{
    struct copying c = {.from = octree, .to = part};
    *part = (struct umb__octree){.alloc = octree->alloc, .root_count = octree->root_count};
    part->roots = umb__alloc_zeroed(octree->alloc, octree->root_count, sizeof *part->roots);
    int complete = part->roots != NULL;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        const size_t count = umb__octree_level_count(octree, level);
        c.copies[level] = calloc(count + 1, sizeof *c.copies[level]); /* touched where used */
        complete = complete && c.copies[level] != NULL;
    }
    const enum umb_status status = complete ? copy_frusta(&c, proofs, error) : no_memory(error);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        free(c.copies[level]);
    }
    free(c.sums);
    return status;
}
