/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_SHADOW_MAP16_H
#define UMBRAGE_TESTS_SHADOW_MAP16_H
/*
 * The peer of the query rows: a 16-bit shadow map of the asset's resolution, queried on the CPU as
 * fast as one core can.
 *
 * A texel holds the number of lit voxels of its column, so that an open asset and the map must give
 * the same bits. Written to win: rows padded with lit texels, so that no window is ever clipped
 * and no two rows of a window share a cache set; large pages; points transformed four at a time;
 * texels prefetched a tuned number of points ahead; windows compared sixteen texels at a time. Two
 * layouts: rows, and 8 x 4 texels a cache line (a window touches fewer lines, at more work a
 * line). The race takes the better.
 */
#include "bench_scene.h"

#define SHADOW_MAP_PAD 64 /* lit texels around the map: windows, and whole loads, stay inside */

enum shadow_map_way {
    SHADOW_MAP_PLAIN = 0, /* plain C over rows, compiled for AVX2 */
    SHADOW_MAP_ROWS,      /* by hand over rows */
    SHADOW_MAP_TILES,     /* by hand over 8 x 4 tiles */
    SHADOW_MAP_WAYS,
};

struct shadow_map {
    uint16_t *rows;  /* [side * side], side = size + 2 * SHADOW_MAP_PAD */
    uint16_t *tiles; /* [side * side]: 8 x 4 blocks, row by row */
    int32_t size, side;
    double m[3][4]; /* world minus the asset's origin to voxels */
};

/* Draws the map; 1 GiB for 16384 texels a side. */
void shadow_map_make(struct shadow_map *map, const struct bench_scene *scene);
void shadow_map_finish(struct shadow_map *map);

/* One query: answers[i] = share of the taps x taps window that is lit. */
struct shadow_map_query {
    const struct shadow_map *map;
    const float *points; /* [3 * count], relative to the asset's origin */
    size_t count;
    int taps; /* 1, 9 or 17 */
    enum shadow_map_way way;
    unsigned ahead; /* points, 1..SHADOW_MAP_AHEAD_MAX */
    float *answers; /* [count] */
};

#define SHADOW_MAP_AHEAD_MAX 64U

void shadow_map_run(const struct shadow_map_query *query);

/* Finds the quickest distance for a way by trying on a part of the points; returns its seconds a
 * point. */
double shadow_map_tune(struct shadow_map_query *query, enum shadow_map_way way);

#endif
