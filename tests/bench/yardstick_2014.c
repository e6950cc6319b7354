/* SPDX-License-Identifier: Apache-2.0 */
/* The bytes of 2014; see yardstick_2014.h. Merging of equal nodes is the core's pool. */
#include "yardstick_2014.h"

#include <stdlib.h>
#include <string.h>
#include "bake/build/brick_slices.h"
#include "bench_report.h"
#include "format/node_pool.h"

#define NODE_BYTES    4U
#define POINTER_BYTES 4U
#define LEAF_BYTES    8U

struct build {
    struct umb__pool pool;
    uint32_t log2_size;
    uint32_t across;   /* tiles a side */
    uint32_t *columns; /* [across^3] the tiles' cubes: x + across * (y + across * z) */
};

static void must(enum umb_status status, const struct umb_error *error)
{
    bench_must(status, error, "2014 octree");
}

/* One slice under the rule of 2014. */
static uint64_t slice_fill(uint64_t visible, uint64_t allowed)
{
    return visible != 0 && allowed == UINT64_MAX ? UINT64_MAX : visible;
}

static uint32_t brick_make(struct build *build, const struct umbb_tile *tile, size_t block,
                           int32_t z0)
{
    const int32_t *lit = tile->lit + block * 64, *end = tile->end + block * 64;
    const struct umbb_slicer *slicer = umbb_slicer(umbb_vectors_best());
    uint64_t slices[8];
    struct umb_error error;
    uint32_t ref;
    uint64_t visible[8], allowed[8];
    slicer->above(lit, z0, visible);
    slicer->above(end, z0, allowed);
    for (size_t z = 0; z < 8; z++) {
        slices[z] = slice_fill(visible[z], allowed[z]);
    }
    must(umb__pool_brick(&build->pool, slices, &ref, &error), &error);
    return ref;
}

/* The cube of `level` at square (x, y) of the tile and depth z, all in cubes of that level. */
static uint32_t cube_make(struct build *build, const struct umbb_tile *tile, uint32_t level,
                          size_t x, size_t y, size_t z)
{
    const size_t square = y * ((size_t)1 << (tile->log2_size - level)) + x;
    const int64_t z0 = (int64_t)(z << level), z1 = (int64_t)((z + 1) << level);
    if (z0 >= tile->max_lit[level][square]) {
        return UMB__REF_SHADOWED; /* or undefined: the neighbours behind are shadowed */
    }
    if (z1 <= tile->min_end[level][square]) {
        return UMB__REF_LIT;
    }
    if (level == UMB_LEVEL_BRICK) {
        return brick_make(build, tile, square, (int32_t)z0);
    }
    uint32_t children[8], ref;
    struct umb_error error;
    for (size_t c = 0; c < 8; c++) {
        children[c] = cube_make(build, tile, level - 1, 2 * x + (c & 1), 2 * y + (c >> 1 & 1),
                                2 * z + (c >> 2));
    }
    must(umb__pool_node(&build->pool, level, children, &ref, &error), &error);
    return ref;
}

static void tile_take(void *user, const struct umbb_tile *tile)
{
    struct build *build = user;
    const size_t x = (size_t)(tile->x0 >> tile->log2_size),
                 y = (size_t)(tile->y0 >> tile->log2_size);
    for (size_t z = 0; z < build->across; z++) {
        build->columns[x + build->across * (y + build->across * z)] =
            cube_make(build, tile, tile->log2_size, 0, 0, z);
    }
}

/* Joins the cubes of the tiles into the root. */
static uint32_t root_make(struct build *build)
{
    struct umb_error error;
    uint32_t level = BENCH_TILE_LOG2;
    for (size_t n = build->across; n > 1; n /= 2) {
        level++;
        const size_t half = n / 2;
        for (size_t i = 0; i < half * half * half; i++) { /* written at or before what is read */
            const size_t x = 2 * (i % half), y = 2 * (i / half % half), z = 2 * (i / half / half);
            uint32_t children[8];
            for (size_t c = 0; c < 8; c++) {
                children[c] =
                    build->columns[x + (c & 1) + n * (y + (c >> 1 & 1) + n * (z + (c >> 2)))];
            }
            must(umb__pool_node(&build->pool, level, children, &build->columns[i], &error), &error);
        }
    }
    return build->columns[0];
}

static int compare_words(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static void bricks_count(const struct umb__octree *octree, struct yardstick_2014 *result)
{
    uint64_t *leaves = calloc((size_t)octree->brick_count * 8 + 1, sizeof *leaves);
    size_t count = 0;
    if (leaves == NULL) {
        bench_fail("2014 leaves: out of memory");
    }
    for (size_t i = 0; i < (size_t)octree->brick_count * 8; i++) {
        const uint64_t leaf = octree->bricks[i / 8][i % 8];
        if (leaf != 0 && leaf != UINT64_MAX) {
            leaves[count++] = leaf;
        }
    }
    result->bytes += (uint64_t)octree->brick_count * NODE_BYTES + count * POINTER_BYTES;
    qsort(leaves, count, sizeof *leaves, compare_words);
    for (size_t i = 0; i < count; i++) {
        result->leaves += i == 0 || leaves[i] != leaves[i - 1];
    }
    result->bytes += result->leaves * LEAF_BYTES;
    result->bricks = octree->brick_count;
    free(leaves);
}

void yardstick_2014_octree(const struct bench_scene *scene, int closed_rule,
                           struct umb__octree *octree)
{
    struct umb_error error;
    struct build build = {.log2_size = scene->frustum.log2_size};
    build.across = 1U << (build.log2_size - BENCH_TILE_LOG2);
    umb__pool_init(&build.pool, NULL, SIZE_MAX);
    build.columns =
        calloc((size_t)build.across * build.across * build.across, sizeof *build.columns);
    if (build.columns == NULL) {
        bench_fail("2014 octree: out of memory");
    }
    bench_tiles(scene, closed_rule, tile_take, &build);
    const uint32_t root = root_make(&build);
    must(umb__pool_take(&build.pool, &root, &build.log2_size, 1, octree, &error), &error);
    umb__pool_finish(&build.pool);
    free(build.columns);
}

struct yardstick_2014 yardstick_2014_count(const struct bench_scene *scene, int closed_rule)
{
    struct yardstick_2014 result = {0};
    struct umb__octree octree;
    yardstick_2014_octree(scene, closed_rule, &octree);
    for (uint32_t level = 4; level <= UMB_LEVEL_MAX; level++) {
        const struct umb__octree_level *l = &octree.level[level];
        result.nodes += l->count;
        if (l->count > 0) {
            result.bytes +=
                (uint64_t)l->count * NODE_BYTES + (uint64_t)l->first[l->count] * POINTER_BYTES;
        }
    }
    bricks_count(&octree, &result);
    umb__octree_finish(&octree);
    bench_say("%s %s: %llu bytes in the encoding of 2014 (%llu nodes, %llu bricks, %llu leaves)",
              scene->name, closed_rule ? "closed" : "open", (unsigned long long)result.bytes,
              (unsigned long long)result.nodes, (unsigned long long)result.bricks,
              (unsigned long long)result.leaves);
    return result;
}
