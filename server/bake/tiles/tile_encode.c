/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writing a tile's result: one walk from the runs down numbers the nodes, a second writes them in
 * that order.
 */
#include <stdlib.h>
#include <string.h>

#include "bake/tiles/tile_code.h"
#include "base/bytes.h"
#include "base/try.h"

/* Nodes of one level that the walk has met. */
struct met {
    uint32_t *numbers; /* [nodes of the pool] own number + 1; 0 = not met */
    uint32_t *order;   /* [count] the pool's numbers */
    uint32_t count;
    uint64_t children; /* mixed children of all met nodes */
};

struct encoder {
    const struct umbb_tile_shape *shape;
    const struct umbb_tile_result *result;
    const struct umb__pool *pool;
    const struct umbb_column_run *runs; /* the column's */
    size_t run_count;
    uint32_t top; /* the tile's level */
    struct met met[UMB_LEVEL_MAX + 1];
};

static uint32_t pool_count(const struct umb__pool *pool, uint32_t level)
{
    return level == UMB_LEVEL_BRICK ? pool->brick_count : pool->level[level].count;
}

static enum umb_status encoder_init(struct encoder *e, size_t max_bytes, struct umb_error *error)
{
    uint64_t bytes = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= e->top; level++) {
        bytes += 2 * sizeof(uint32_t) * (uint64_t)pool_count(e->pool, level);
    }
    if (bytes > max_bytes) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: numbering the nodes of a tile needs %llu MiB, %zu are left",
                        (unsigned long long)(bytes >> 20), max_bytes >> 20);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= e->top; level++) {
        const size_t count = (size_t)pool_count(e->pool, level) + 1;
        struct met *met = &e->met[level];
        met->numbers = calloc(count, sizeof *met->numbers); /* pages come as they are touched */
        met->order = malloc(count * sizeof *met->order);
        if (met->numbers == NULL || met->order == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "tile: memory to number %zu nodes refused",
                            count);
        }
    }
    return UMB_OK;
}

static void encoder_finish(struct encoder *e)
{
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        free(e->met[level].numbers);
        free(e->met[level].order);
    }
}

static void meet(struct met *met, uint32_t ref)
{
    if (met->numbers[ref] == 0) {
        met->order[met->count++] = ref;
        met->numbers[ref] = met->count;
    }
}

/* Numbers all nodes that the runs lead to. */
static void number_nodes(struct encoder *e)
{
    for (size_t i = 0; i < e->run_count; i++) {
        if (umb__ref_state(e->runs[i].ref) == UMB__NODE_MIXED) {
            meet(&e->met[e->top], e->runs[i].ref);
        }
    }
    for (uint32_t number = e->top; number > UMB_LEVEL_BRICK; number--) {
        const struct umb__pool_level *level = &e->pool->level[number];
        struct met *met = &e->met[number];
        for (uint32_t i = 0; i < met->count; i++) {
            const uint32_t node = met->order[i];
            for (uint32_t c = level->first[node]; c < level->first[node + 1]; c++) {
                meet(&e->met[number - 1], level->children[c]);
            }
            met->children += level->first[node + 1] - level->first[node];
        }
    }
}

static uint64_t encoded_bytes(const struct encoder *e)
{
    uint64_t bytes = 16 + 8 * (uint64_t)(e->top - UMB_LEVEL_BRICK) + 8 * (uint64_t)e->run_count;
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= e->top; level++) {
        bytes += 2 * (uint64_t)e->met[level].count + 4 * e->met[level].children;
    }
    return bytes + 64 * (uint64_t)e->met[UMB_LEVEL_BRICK].count;
}

static uint8_t *put32(uint8_t *at, uint32_t value)
{
    umb__store32(at, value);
    return at + 4;
}

static uint8_t *put_level(const struct encoder *e, uint32_t number, uint8_t *at)
{
    const struct umb__pool_level *level = &e->pool->level[number];
    const struct met *met = &e->met[number];
    for (uint32_t i = 0; i < met->count; i++, at += 2) {
        umb__store16(at, level->masks[met->order[i]]);
    }
    for (uint32_t i = 0; i < met->count; i++) {
        const uint32_t node = met->order[i];
        for (uint32_t c = level->first[node]; c < level->first[node + 1]; c++) {
            at = put32(at, e->met[number - 1].numbers[level->children[c]] - 1);
        }
    }
    return at;
}

static void put_all(const struct encoder *e, uint8_t *at)
{
    at = put32(at, (uint32_t)e->result->max_lit);
    at = put32(at, (uint32_t)e->result->min_end);
    at = put32(at, (uint32_t)e->run_count);
    at = put32(at, e->met[UMB_LEVEL_BRICK].count);
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= e->top; level++) {
        at = put32(at, e->met[level].count);
        at = put32(at, (uint32_t)e->met[level].children); /* fits: a pool cannot hold more */
    }
    for (size_t i = 0; i < e->run_count; i++) {
        const uint32_t ref = e->runs[i].ref;
        at = put32(at, e->runs[i].z_end);
        at = put32(at,
                   umb__ref_state(ref) == UMB__NODE_MIXED ? e->met[e->top].numbers[ref] - 1 : ref);
    }
    for (uint32_t level = e->top; level > UMB_LEVEL_BRICK; level--) {
        at = put_level(e, level, at);
    }
    for (uint32_t i = 0; i < e->met[UMB_LEVEL_BRICK].count; i++) {
        const uint64_t *slices = e->pool->bricks[e->met[UMB_LEVEL_BRICK].order[i]];
        for (int z = 0; z < 8; z++, at += 8) {
            umb__store64(at, slices[z]);
        }
    }
}

/* Numbers the nodes and writes them to malloced bytes. In: max_bytes: limit of the bytes. */
static enum umb_status encode(struct encoder *e, size_t max_bytes, uint8_t **bytes, size_t *size,
                              struct umb_error *error)
{
    UMB__TRY(encoder_init(e, max_bytes, error));
    number_nodes(e);
    const uint64_t nodes = encoded_bytes(e);
    const uint64_t wanted = nodes + umbb_tile_occluder_depth_bytes(e->shape);
    *bytes = wanted > max_bytes ? NULL : malloc((size_t)wanted);
    if (*bytes == NULL) {
        return umb_fail(error, wanted > max_bytes ? UMB_E_LIMIT : UMB_E_NO_MEMORY,
                        "--memory: a tile's result of %llu MiB: %zu are left",
                        (unsigned long long)(wanted >> 20), max_bytes >> 20);
    }
    put_all(e, *bytes);
    if (e->shape->occluder_depth != NULL) {
        umbb_tile_occluder_depth_put(e->shape, *bytes + nodes);
    }
    *size = (size_t)wanted;
    return UMB_OK;
}

enum umb_status umbb_tile_encode(const struct umbb_tile_shape *shape,
                                 const struct umbb_tile_nodes *nodes,
                                 const struct umbb_tile_result *result, uint8_t **bytes,
                                 size_t *size, struct umb_error *error)
{
    const struct umbb_column_run *runs = nodes->runs->items;
    struct encoder e = {
        .shape = shape,
        .result = result,
        .pool = nodes->pool,
        .runs = runs == NULL ? NULL : runs + result->column.run_first,
        .run_count = result->column.run_count,
        .top = shape->tile_log2,
    };
    *bytes = NULL;
    *size = 0;
    const enum umb_status status = encode(&e, nodes->max_bytes / 2, bytes, size, error);
    encoder_finish(&e);
    return status;
}
