/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_UNIT_BAKE_BAKE_SOUPS_H
#define UMBRAGE_TESTS_UNIT_BAKE_BAKE_SOUPS_H
/*
 * Random casters in voxel space for the bake's tests: boxes, balls, slivers, and "soups" of loose
 * triangles; and a slow reader of octrees. Include after cmocka.h.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/build/tile_loop.h"
#include "bake/depth/depth.h"
#include "format/octree.h"
#include "bake_frustum.h"

struct soup {
    double (*corners)[3][3];
    uint8_t *kinds;
    size_t count, capacity;
    int32_t size;
    int open_on_word;                 /* see struct umbb_casters */
    double depth_scale, depth_offset; /* see struct umbb_casters; zero for parallel light */
    uint64_t random_state;
};

static inline void soup_init(struct soup *soup, int32_t size, uint64_t seed)
{
    memset(soup, 0, sizeof *soup);
    soup->size = size;
    soup->random_state = seed;
    print_message("seed %llu\n", (unsigned long long)seed);
}

static inline void soup_finish(struct soup *soup)
{
    free(soup->corners);
    free(soup->kinds);
    memset(soup, 0, sizeof *soup);
}

/* splitmix64 */
static inline uint64_t soup_bits(struct soup *soup)
{
    uint64_t z = (soup->random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

static inline double soup_unit(struct soup *soup)
{
    return (double)(soup_bits(soup) >> 11) * 0x1p-53;
}

/* Draws a coordinate within the frustum; in two cases out of four it is on a texel's centre or
 * border. */
static inline double soup_coordinate(struct soup *soup)
{
    const double value = 0.5 + soup_unit(soup) * (soup->size - 1);
    switch (soup_bits(soup) % 4) {
    case 0:
        return fmin(floor(value) + 0.5, soup->size - 0.5);
    case 1:
        return fmax(floor(value), 0.5);
    default:
        return value;
    }
}

static inline void soup_add(struct soup *soup, const double a[3], const double b[3],
                            const double c[3], enum umbb_caster kind)
{
    if (soup->count == soup->capacity) {
        soup->capacity = soup->capacity == 0 ? 256 : 2 * soup->capacity;
        soup->corners = realloc(soup->corners, soup->capacity * sizeof *soup->corners);
        soup->kinds = realloc(soup->kinds, soup->capacity);
        assert_non_null(soup->corners);
        assert_non_null(soup->kinds);
    }
    double(*v)[3] = soup->corners[soup->count];
    memcpy(v[0], a, sizeof v[0]);
    memcpy(v[1], b, sizeof v[1]);
    memcpy(v[2], c, sizeof v[2]);
    soup->kinds[soup->count++] = (uint8_t)kind;
}

/* Adds a closed triangle: outward as it is, or turned around and marked so. */
static inline void soup_add_closed(struct soup *soup, const double a[3], const double b[3],
                                   const double c[3], int flipped)
{
    soup_add(soup, a, flipped ? c : b, flipped ? b : c,
             flipped ? UMBB_CASTER_CLOSED_FLIPPED : UMBB_CASTER_CLOSED);
}

/* Adds a closed box, in which bit k of a corner's number says whether the corner is low or high on
 * axis k. Any hexahedron with plane faces is possible. */
static inline void soup_hexahedron(struct soup *soup, double v[8][3], int flipped)
{
    static const int face[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                   {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (int f = 0; f < 6; f++) {
        soup_add_closed(soup, v[face[f][0]], v[face[f][1]], v[face[f][2]], flipped);
        soup_add_closed(soup, v[face[f][0]], v[face[f][2]], v[face[f][3]], flipped);
    }
}

static inline void soup_box(struct soup *soup, const double low[3], const double high[3],
                            int flipped)
{
    double v[8][3];
    for (int i = 0; i < 8; i++) {
        for (int axis = 0; axis < 3; axis++) {
            v[i][axis] = (i >> axis) & 1 ? high[axis] : low[axis];
        }
    }
    soup_hexahedron(soup, v, flipped);
}

/* Adds an axis-aligned box, or one sheared along z so that no face is parallel to the light. */
static inline void soup_random_box(struct soup *soup)
{
    double low[3], high[3], v[8][3];
    for (int axis = 0; axis < 3; axis++) {
        const double a = soup_coordinate(soup), b = soup_coordinate(soup);
        low[axis] = fmin(a, b);
        high[axis] = fmax(a, b);
        if (!(high[axis] - low[axis] > 0.25)) {
            return;
        }
    }
    const int sheared = soup_bits(soup) % 2 == 0;
    const double sx = sheared ? 0.3 * (soup_unit(soup) - 0.5) : 0.0;
    const double sy = sheared ? 0.3 * (soup_unit(soup) - 0.5) : 0.0;
    for (int i = 0; i < 8; i++) {
        for (int axis = 0; axis < 3; axis++) {
            v[i][axis] = (i >> axis) & 1 ? high[axis] : low[axis];
        }
        v[i][0] = fmin(fmax(v[i][0] + sx * (v[i][2] - low[2]), 0.0), soup->size);
        v[i][1] = fmin(fmax(v[i][1] + sy * (v[i][2] - low[2]), 0.0), soup->size);
    }
    soup_hexahedron(soup, v, soup_bits(soup) % 3 == 0);
}

/* Adds a closed ball of rings and sectors. Its corners are computed once, so that edges match. */
static inline void soup_random_ball(struct soup *soup)
{
    enum {
        RINGS = 9,
        SIDES = 14
    };
    const double radius = 2.0 + soup_unit(soup) * soup->size * 0.2;
    double centre[3], v[RINGS + 1][SIDES][3];
    for (int axis = 0; axis < 3; axis++) {
        centre[axis] = radius + 0.5 + soup_unit(soup) * (soup->size - 1.0 - 2.0 * radius);
    }
    for (int i = 0; i <= RINGS; i++) {
        const double polar = 3.141592653589793 * i / RINGS;
        const double ring = i == 0 || i == RINGS ? 0.0 : sin(polar);
        for (int k = 0; k < SIDES; k++) {
            const double angle = 6.283185307179586 * k / SIDES;
            v[i][k][0] = centre[0] + radius * ring * cos(angle);
            v[i][k][1] = centre[1] + radius * ring * sin(angle);
            v[i][k][2] = centre[2] + radius * cos(polar);
        }
    }
    for (int i = 0; i < RINGS; i++) {
        for (int k = 0; k < SIDES; k++) {
            const int n = (k + 1) % SIDES;
            if (i > 0) {
                soup_add_closed(soup, v[i][k], v[i + 1][k], v[i][n], 0);
            }
            if (i < RINGS - 1) {
                soup_add_closed(soup, v[i][n], v[i + 1][k], v[i + 1][n], 0);
            }
        }
    }
}

static inline void soup_random_open(struct soup *soup, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        double v[3][3];
        for (int k = 0; k < 9; k++) {
            v[k / 3][k % 3] = soup_coordinate(soup);
        }
        if (i % 3 == 0) { /* small */
            for (int k = 3; k < 9; k++) {
                const double near = v[0][k % 3] + 4.0 * (soup_unit(soup) - 0.5);
                v[k / 3][k % 3] = fmin(fmax(near, 0.5), soup->size - 0.5);
            }
        } else if (i % 3 == 1 && i % 2 == 0) { /* sliver */
            memcpy(v[1], v[0], sizeof v[1]);
            v[1][0] += 1e-9 * soup_unit(soup);
            v[1][2] = soup_coordinate(soup);
        }
        soup_add(soup, v[0], v[1], v[2], UMBB_CASTER_OPEN);
    }
}

/* A bit of everything. */
static inline void soup_mixture(struct soup *soup)
{
    for (int i = 0; i < 6; i++) {
        soup_random_box(soup);
        soup_random_ball(soup);
    }
    soup_random_open(soup, 40);
}

static inline struct umbb_casters soup_casters(const struct soup *soup, int closed_rule)
{
    return (struct umbb_casters){
        .corners = (const double(*)[3][3])soup->corners,
        .kinds = soup->kinds,
        .count = soup->count,
        .size = soup->size,
        .closed_rule = closed_rule,
        .open_on_word = soup->open_on_word,
        .depth_scale = soup->depth_scale,
        .depth_offset = soup->depth_offset,
    };
}

/* Turns all depths into the q of a lamp `before` voxels before the first voxel. */
static inline void soup_before_lamp(struct soup *soup, double before)
{
    soup->depth_scale = before;
    soup->depth_offset = -before;
    for (size_t i = 0; i < 3 * soup->count; i++) {
        double *corner = soup->corners[i / 3][i % 3];
        corner[2] = before / (before + corner[2]);
    }
}

static inline uint32_t soup_log2(const struct soup *soup)
{
    return (uint32_t)__builtin_ctz((unsigned)soup->size);
}

/* Bakes a soup with the rasteriser. */
static inline void soup_bake(const struct soup *soup, int closed_rule, uint32_t tile_log2,
                             unsigned threads, struct umb__octree *octree)
{
    struct umb_error error;
    const struct umbb_casters casters = soup_casters(soup, closed_rule);
    const struct umbb_depth_options depth_options = {.tile_log2 = tile_log2, .threads = threads};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), UMB_OK);
    const struct umbb_bake_options options = {
        .log2_size = soup_log2(soup),
        .tile_log2 = tile_log2,
        .threads = threads,
        .closed_rule = closed_rule,
        .octree_max_bytes = (size_t)1 << 30,
    };
    assert_int_equal(bake_frustum(&depth, &options, octree, NULL, &error), UMB_OK);
    depth.destroy(depth.state);
}

/* Returns which of the eight voxels of a column, from z rounded down to a multiple of 8, are lit in
 * the octree: a bit for each. Descends from the root, a child at a time. */
static inline unsigned octree_eight(const struct umb__octree *octree, uint32_t x, uint32_t y,
                                    uint32_t z)
{
    const struct umb__octree_root *root = &octree->roots[0];
    if (root->state != UMB__NODE_MIXED) {
        return root->state == UMB__NODE_LIT ? 0xff : 0;
    }
    uint32_t node = root->index;
    for (uint32_t level = root->level; level > UMB_LEVEL_BRICK; level--) {
        const struct umb__octree_level *l = &octree->level[level];
        const uint32_t bit = level - 1;
        const unsigned child = ((x >> bit) & 1) + 2 * ((y >> bit) & 1) + 4 * ((z >> bit) & 1);
        assert_true(node < l->count);
        const enum umb__node_state state = umb__mask_state(l->masks[node], child);
        if (state != UMB__NODE_MIXED) {
            return state == UMB__NODE_LIT ? 0xff : 0;
        }
        uint32_t before = 0;
        for (unsigned c = 0; c < child; c++) {
            before += umb__mask_state(l->masks[node], c) == UMB__NODE_MIXED;
        }
        assert_true(l->first[node] + before < l->first[node + 1]);
        node = l->children[l->first[node] + before];
    }
    assert_true(node < octree->brick_count);
    unsigned lit = 0;
    for (unsigned k = 0; k < 8; k++) {
        lit |= (unsigned)(octree->bricks[node][k] >> ((x & 7) + 8 * (y & 7)) & 1) << k;
    }
    return lit;
}

/* Returns 1 if a voxel is lit in the octree. */
static inline int octree_voxel(const struct umb__octree *octree, uint32_t x, uint32_t y, uint32_t z)
{
    return (int)(octree_eight(octree, x, y, z) >> (z & 7) & 1);
}

#endif
