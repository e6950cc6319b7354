/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writing and reading a tile's result (tile_code.h).
 *
 * Writing: one walk from the runs down numbers the nodes, a second writes them in that order.
 * Reading: first every number is checked; then nodes go into the pool from the bricks up, so a
 * node's children are there before the node. After the checks only lack of memory can make the
 * reading fail.
 */
#include "bake/tiles/tile_code.h"

#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/try.h"

static uint32_t squares_across(const struct umbb_tile_shape *shape)
{
    return ((uint32_t)1 << shape->tile_log2) / UMB__OCCLUDER_DEPTH_SIDE;
}

/* The words of the tile's square with that number; NULL if it has none. */
static const uint32_t *square_of(const struct umbb_tile_shape *shape, uint32_t number)
{
    const uint32_t across = squares_across(shape);
    return umb__occluder_depth_square(shape->occluder_depth,
                                      shape->occluder_depth_x + number % across,
                                      shape->occluder_depth_y + number / across);
}

/* Bytes of the part of first occluders; 0 if they are not kept. */
static uint64_t squares_bytes(const struct umbb_tile_shape *shape)
{
    if (shape->occluder_depth == NULL) {
        return 0;
    }
    const uint32_t count = squares_across(shape) * squares_across(shape);
    uint64_t words = 1;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *square = square_of(shape, i);
        words += square != NULL ? 1 + (uint64_t)square[0] : 0;
    }
    return 4 * words;
}

static void put_squares(const struct umbb_tile_shape *shape, uint8_t *at)
{
    const uint32_t count = squares_across(shape) * squares_across(shape);
    uint8_t *next = at + 4;
    uint32_t squares = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *square = square_of(shape, i);
        if (square == NULL) {
            continue;
        }
        squares++;
        umb__store32(next, i);
        next += 4;
        for (uint32_t w = 0; w < square[0]; w++, next += 4) {
            umb__store32(next, square[w]);
        }
    }
    umb__store32(at, squares);
}

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

static enum umb_status encoder_init(struct encoder *e, size_t max_bytes, struct umb_error *error)
{
    uint64_t bytes = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= e->top; level++) {
        bytes += 2 * sizeof(uint32_t) * (uint64_t)e->pool->level[level].count;
    }
    if (bytes > max_bytes) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: numbering the nodes of a tile needs %llu MiB, %zu are left",
                        (unsigned long long)(bytes >> 20), max_bytes >> 20);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= e->top; level++) {
        const size_t count = (size_t)e->pool->level[level].count + 1;
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
    const uint64_t wanted = nodes + squares_bytes(e->shape);
    *bytes = wanted > max_bytes ? NULL : malloc((size_t)wanted);
    if (*bytes == NULL) {
        return umb_fail(error, wanted > max_bytes ? UMB_E_LIMIT : UMB_E_NO_MEMORY,
                        "--memory: a tile's result of %llu MiB: %zu are left",
                        (unsigned long long)(wanted >> 20), max_bytes >> 20);
    }
    put_all(e, *bytes);
    if (e->shape->occluder_depth != NULL) {
        put_squares(e->shape, *bytes + nodes);
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

/* 1 if the words are exactly the part. In: count: at least 1. */
static int is_whole(const struct umbb_tile_shape *shape, const uint32_t *words, size_t count)
{
    const uint32_t across = squares_across(shape);
    size_t at = 1;
    uint32_t least = 0; /* least number of the next square */
    for (uint32_t i = 0; i < words[0]; i++) {
        if (count - at < 2 || words[at] < least || words[at] >= across * across ||
            words[at + 1] > count - at - 1 ||
            !umb__occluder_depth_square_fits(shape->log2_size, words + at + 1, words[at + 1])) {
            return 0;
        }
        least = words[at] + 1;
        at += 1 + words[at + 1];
    }
    return at == count;
}

/* Reads and checks the part of first occluders. Out: words: malloced: the part as numbers of this
 * machine. */
static enum umb_status read_squares(const struct umbb_tile_shape *shape, const uint8_t *bytes,
                                    size_t size, uint32_t **words, struct umb_error *error)
{
    *words = NULL;
    if (size < 4 || size % 4 != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "tile result: no first occluders");
    }
    uint32_t *read = malloc(size);
    if (read == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "tile result: memory for %zu bytes refused", size);
    }
    for (size_t i = 0; i < size / 4; i++) {
        read[i] = umb__load32(bytes + 4 * i);
    }
    if (!is_whole(shape, read, size / 4)) {
        free(read);
        return umb_fail(error, UMB_E_CORRUPT, "tile result: malformed first occluders");
    }
    *words = read;
    return UMB_OK;
}

/* Adds the squares that were read to the occluder depth map. */
static enum umb_status add_squares(const struct umbb_tile_shape *shape, const uint32_t *words,
                                   struct umb_error *error)
{
    const uint32_t across = squares_across(shape);
    const uint32_t *next = words + 1;
    for (uint32_t i = 0; i < words[0]; i++, next += 1 + next[1]) {
        UMB__TRY(umb__occluder_depth_add_square(
            shape->occluder_depth, shape->occluder_depth_x + next[0] % across,
            shape->occluder_depth_y + next[0] / across, next + 1, error));
    }
    return UMB_OK;
}

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
    const uint8_t *at = bytes, *const end = bytes + size, *head;
    if (!umb__take(&at, end, 2 + d->top - UMB_LEVEL_BRICK, 8, &head)) {
        return 0;
    }
    d->run_count = umb__load32(head + 8);
    d->count[UMB_LEVEL_BRICK] = umb__load32(head + 12);
    int fits = umb__take(&at, end, d->run_count, 8, &d->runs);
    for (uint32_t level = d->top; level > UMB_LEVEL_BRICK && fits; level--) {
        const uint8_t *counts = head + 16 + 8 * (size_t)(level - UMB_LEVEL_BRICK - 1);
        d->count[level] = umb__load32(counts);
        d->children[level] = umb__load32(counts + 4);
        fits = umb__take(&at, end, d->count[level], 2, &d->masks[level]) &&
               umb__take(&at, end, d->children[level], 4, &d->refs[level]);
    }
    fits = fits && umb__take(&at, end, d->count[UMB_LEVEL_BRICK], 64, &d->bricks);
    d->bytes = (size_t)(at - bytes);
    return fits;
}

/* Accepts a number; 0 if it is neither known nor the next new one. */
static int is_next(uint32_t ref, uint32_t *met, uint32_t count)
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
        if (umb__ref_state(ref) == UMB__NODE_MIXED && !is_next(ref, &met, d->count[d->top])) {
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
        if (!is_next(ref, &met, d->count[level - 1])) {
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

void umbb_tile_parsed_clear(struct umbb_tile_parsed *parsed)
{
    umb__pool_clear(&parsed->pool);
    free(parsed->top);
    free(parsed->occluder_depth);
    parsed->top = NULL;
    parsed->occluder_depth = NULL;
    parsed->runs = NULL;
    parsed->run_count = 0;
}

void umbb_tile_parsed_finish(struct umbb_tile_parsed *parsed)
{
    free(parsed->top);
    free(parsed->occluder_depth);
    umb__pool_finish(&parsed->pool);
    memset(parsed, 0, sizeof *parsed);
}

enum umb_status umbb_tile_parse(const struct umbb_tile_shape *shape, const uint8_t *bytes,
                                size_t size, struct umbb_tile_parsed *parsed,
                                struct umb_error *error)
{
    struct decoder d = {.top = shape->tile_log2};
    umbb_tile_parsed_clear(parsed);
    UMB__TRY(check_all(&d, shape, bytes, size, &parsed->result, error));
    if (shape->occluder_depth != NULL) {
        UMB__TRY(
            read_squares(shape, bytes + d.bytes, size - d.bytes, &parsed->occluder_depth, error));
    }
    parsed->runs = d.runs;
    parsed->run_count = d.run_count;
    return add_all(&d, &parsed->pool, &parsed->top, error);
}

enum umb_status umbb_tile_join(const struct umbb_tile_shape *shape,
                               const struct umbb_tile_parsed *parsed,
                               const struct umbb_tile_nodes *nodes,
                               struct umb__pool_numbers *numbers, struct umbb_tile_result *result,
                               struct umb_error *error)
{
    struct umbb_runs *runs = nodes->runs;
    *result = parsed->result;
    UMB__TRY(umb__pool_merge(nodes->pool, &parsed->pool, shape->tile_log2, numbers, error));
    if (parsed->occluder_depth != NULL) {
        UMB__TRY(add_squares(shape, parsed->occluder_depth, error));
    }
    result->column.run_first = runs->count;
    for (uint32_t i = 0; i < parsed->run_count; i++) {
        const uint8_t *run = parsed->runs + 8 * (size_t)i;
        const uint32_t ref = umb__load32(run + 4);
        const uint32_t number =
            umb__ref_state(ref) == UMB__NODE_MIXED ? numbers->refs[parsed->top[ref]] : ref;
        UMB__TRY(umbb_runs_push(runs, result->column.run_first, umb__load32(run), number, error));
    }
    result->column.run_count = runs->count - result->column.run_first;
    return UMB_OK;
}

enum umb_status umbb_tile_decode(const struct umbb_tile_shape *shape, const uint8_t *bytes,
                                 size_t size, const struct umbb_tile_nodes *nodes,
                                 struct umbb_tile_result *result, struct umb_error *error)
{
    struct umbb_tile_parsed parsed = {.run_count = 0};
    struct umb__pool_numbers numbers = {0};
    umb__pool_init_loose(&parsed.pool, NULL, SIZE_MAX);
    enum umb_status status = umbb_tile_parse(shape, bytes, size, &parsed, error);
    if (status == UMB_OK) {
        status = umbb_tile_join(shape, &parsed, nodes, &numbers, result, error);
    }
    umbb_tile_parsed_finish(&parsed);
    umb__pool_numbers_finish(&numbers);
    return status;
}
