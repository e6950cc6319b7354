/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reading a tile's result. First every number is checked; then nodes go into the pool from the
 * bricks up, so a node's children are there before the node. After the checks only lack of memory
 * can make the reading fail.
 */
#include <stdlib.h>
#include <string.h>

#include "bake/tiles/tile_code.h"
#include "base/bytes.h"
#include "base/try.h"

/* Pointers to the parts of a result, which all fit in the file. Counts are read from the file. */
struct decoder {
    const uint8_t *runs;
    uint32_t run_count;
    uint32_t top;
    uint32_t count[UMB_LEVEL_MAX + 1]; /* bricks at level 3 */
    uint32_t children[UMB_LEVEL_MAX + 1];
    const uint8_t *masks[UMB_LEVEL_MAX + 1];
    const uint8_t *refs[UMB_LEVEL_MAX + 1];
    const uint8_t *bricks;
    size_t bytes; /* size of all these parts */
};

/* Finds the parts; 0 if the counts need more bytes than there are. */
static int find_parts(struct decoder *d, const uint8_t *bytes, size_t size)
{
    const size_t head = 16 + 8 * (size_t)(d->top - UMB_LEVEL_BRICK);
    if (size < head) {
        return 0;
    }
    d->run_count = umb__load32(bytes + 8);
    d->count[UMB_LEVEL_BRICK] = umb__load32(bytes + 12);
    uint64_t at = head;
    d->runs = bytes + at;
    at += 8 * (uint64_t)d->run_count;
    for (uint32_t level = d->top; level > UMB_LEVEL_BRICK; level--) {
        const uint8_t *counts = bytes + 16 + 8 * (size_t)(level - UMB_LEVEL_BRICK - 1);
        d->count[level] = umb__load32(counts);
        d->children[level] = umb__load32(counts + 4);
        if (at > size) {
            return 0;
        }
        d->masks[level] = bytes + at;
        at += 2 * (uint64_t)d->count[level];
        if (at > size) {
            return 0;
        }
        d->refs[level] = bytes + at;
        at += 4 * (uint64_t)d->children[level];
    }
    if (at > size) {
        return 0;
    }
    d->bricks = bytes + at;
    at += 64 * (uint64_t)d->count[UMB_LEVEL_BRICK];
    d->bytes = (size_t)at;
    return at <= size;
}

/* Accepts a number; 0 if it is neither known nor the next new one. */
static int meet(uint32_t ref, uint32_t *met, uint32_t count)
{
    if (ref == *met && ref < count) {
        ++*met;
        return 1;
    }
    return ref < *met;
}

static int runs_fit(const struct decoder *d, const struct umbb_column *column)
{
    uint32_t z = column->mixed_first, met = 0;
    for (uint32_t i = 0; i < d->run_count; i++) {
        const uint32_t z_end = umb__load32(d->runs + 8 * (size_t)i);
        const uint32_t ref = umb__load32(d->runs + 8 * (size_t)i + 4);
        if (z_end <= z || z_end > column->mixed_end) {
            return 0;
        }
        if (umb__ref_state(ref) == UMB__NODE_MIXED && !meet(ref, &met, d->count[d->top])) {
            return 0;
        }
        z = z_end;
    }
    return z == column->mixed_end && met == d->count[d->top];
}

/* Checks a level: masks have valid states, children the right numbers. */
static int level_fits(const struct decoder *d, uint32_t level)
{
    uint64_t children = 0;
    for (uint32_t i = 0; i < d->count[level]; i++) {
        const uint16_t mask = umb__load16(d->masks[level] + 2 * (size_t)i);
        if ((mask & (mask >> 1) & 0x5555U) != 0) { /* state 3 */
            return 0;
        }
        children += umb__mask_mixed_count(mask);
    }
    if (children != d->children[level]) {
        return 0;
    }
    uint32_t met = 0;
    for (uint32_t i = 0; i < d->children[level]; i++) {
        const uint32_t ref = umb__load32(d->refs[level] + 4 * (size_t)i);
        if (!meet(ref, &met, d->count[level - 1])) {
            return 0;
        }
    }
    return met == d->count[level - 1];
}

static enum umb_status check_all(struct decoder *d, const struct umbb_tile_shape *shape,
                                 const uint8_t *bytes, size_t size, struct umbb_tile_result *result,
                                 struct umb_error *error)
{
    if (!find_parts(d, bytes, size) || (shape->occluder_depth == NULL && d->bytes != size)) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "tile result: its size is not what its counts ask for");
    }
    const uint32_t voxels = (uint32_t)1 << shape->log2_size;
    const uint32_t max_lit = umb__load32(bytes), min_end = umb__load32(bytes + 4);
    if (max_lit > voxels || min_end > voxels) {
        return umb_fail(error, UMB_E_CORRUPT, "tile result: depths beyond the frustum");
    }
    *result = (struct umbb_tile_result){
        .max_lit = (int32_t)max_lit,
        .min_end = (int32_t)min_end,
        .column = umbb_column_bounds(d->top, (int32_t)max_lit, (int32_t)min_end),
    };
    if (!runs_fit(d, &result->column)) {
        return umb_fail(error, UMB_E_CORRUPT, "tile result: runs that do not fit the column");
    }
    for (uint32_t level = d->top; level > UMB_LEVEL_BRICK; level--) {
        if (!level_fits(d, level)) {
            return umb_fail(error, UMB_E_CORRUPT, "tile result: nodes that do not fit each other");
        }
    }
    return UMB_OK;
}

/* Adds all bricks to the pool; keeps their refs. */
static enum umb_status add_bricks(const struct decoder *d, struct umb__pool *pool, uint32_t *to,
                                  struct umb_error *error)
{
    for (uint32_t i = 0; i < d->count[UMB_LEVEL_BRICK]; i++) {
        uint64_t slices[8];
        for (size_t z = 0; z < 8; z++) {
            slices[z] = umb__load64(d->bricks + 64 * (size_t)i + 8 * z);
        }
        UMB__TRY(umb__pool_brick(pool, slices, &to[i], error));
    }
    return UMB_OK;
}

/* Adds all nodes of a level to the pool. In: below: refs of the level below. */
static enum umb_status add_nodes(const struct decoder *d, uint32_t level, struct umb__pool *pool,
                                 const uint32_t *below, uint32_t *to, struct umb_error *error)
{
    const uint8_t *next = d->refs[level];
    for (uint32_t i = 0; i < d->count[level]; i++) {
        const uint16_t mask = umb__load16(d->masks[level] + 2 * (size_t)i);
        uint32_t children[8];
        for (unsigned c = 0; c < 8; c++) {
            const enum umb__node_state state = umb__mask_state(mask, c);
            children[c] = state == UMB__NODE_LIT ? UMB__REF_LIT : UMB__REF_SHADOWED;
            if (state == UMB__NODE_MIXED) {
                children[c] = below[umb__load32(next)];
                next += 4;
            }
        }
        UMB__TRY(umb__pool_node(pool, level, children, &to[i], error));
    }
    return UMB_OK;
}

/* Adds all levels. Out: top: the refs of the tile's level, malloced. */
static enum umb_status add_all(const struct decoder *d, struct umb__pool *pool, uint32_t **top,
                               struct umb_error *error)
{
    uint32_t *below = NULL;
    enum umb_status status = UMB_OK;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= d->top && status == UMB_OK; level++) {
        uint32_t *refs = malloc(((size_t)d->count[level] + 1) * sizeof *refs);
        if (refs == NULL) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "tile result: memory for %u nodes refused",
                              d->count[level]);
        } else if (level == UMB_LEVEL_BRICK) {
            status = add_bricks(d, pool, refs, error);
        } else {
            status = add_nodes(d, level, pool, below, refs, error);
        }
        free(below);
        below = refs;
    }
    *top = below;
    return status;
}

enum umb_status umbb_tile_decode(const struct umbb_tile_shape *shape, const uint8_t *bytes,
                                 size_t size, const struct umbb_tile_nodes *nodes,
                                 struct umbb_tile_result *result, struct umb_error *error)
{
    struct umbb_runs *runs = nodes->runs;
    struct decoder d = {.top = shape->tile_log2};
    UMB__TRY(check_all(&d, shape, bytes, size, result, error));
    uint32_t *occluder_depth = NULL, *top;
    if (shape->occluder_depth != NULL) {
        UMB__TRY(umbb_tile_occluder_depth_read(shape, bytes + d.bytes, size - d.bytes,
                                               &occluder_depth, error));
    }
    enum umb_status status = add_all(&d, nodes->pool, &top, error);
    if (status == UMB_OK && occluder_depth != NULL) {
        status = umbb_tile_occluder_depth_add(shape, occluder_depth, error);
    }
    free(occluder_depth);
    result->column.run_first = runs->count;
    for (uint32_t i = 0; i < d.run_count && status == UMB_OK; i++) {
        const uint32_t ref = umb__load32(d.runs + 8 * (size_t)i + 4);
        status = umbb_runs_push(runs, result->column.run_first, umb__load32(d.runs + 8 * (size_t)i),
                                umb__ref_state(ref) == UMB__NODE_MIXED ? top[ref] : ref, error);
    }
    result->column.run_count = runs->count - result->column.run_first;
    free(top);
    return status;
}
