/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_SHADOW_MAP16_H
#define UMBRAGE_SERVER_STUDY_SHADOW_MAP16_H
/*
 * A peer of the study and of the query benchmarks: a 16-bit shadow map of an asset's resolution,
 * with percentage closer filtering on the CPU as fast as one core can do it.
 *
 *     umbt_map16_init(&map, log2_size, frustum.world_to_voxel, &error);   all lit
 *     umbt_map16_put(&map, x, y, lit);                                    a block of columns each
 *     umbt_map16_tune(&query, UMBT_MAP16_ROWS);
 *     umbt_map16_run(&query);
 *
 * A texel holds the number of lit voxels of its column, so an open asset and the map must give the
 * same bits. It is written for speed. Rows are padded with lit texels, so that no window is ever
 * clipped and no two rows of a window share a cache set. It uses large pages, transforms points
 * four at a time, prefetches texels a tuned number of points ahead, and compares windows sixteen
 * texels at a time. There are two layouts: rows, and 8 x 4 texels a cache line (a window touches
 * fewer lines, with more work a line). Tuning takes the faster one.
 *
 * Machine: AVX2; see umbt_map16_supported.
 * Threads: any number may query one map; only one may make it.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBT_MAP16_PAD 64 /* lit texels around the map: windows, and whole loads, stay inside */

enum umbt_map16_way {
    UMBT_MAP16_PLAIN = 0, /* plain C over rows, compiled for AVX2 */
    UMBT_MAP16_ROWS,      /* intrinsics over rows */
    UMBT_MAP16_TILES,     /* intrinsics over 8 x 4 tiles */
    UMBT_MAP16_WAYS,
};

struct umbt_map16 {
    uint16_t *rows;  /* [side * side], side = size + 2 * UMBT_MAP16_PAD */
    uint16_t *tiles; /* [side * side]: 8 x 4 blocks, row by row */
    int32_t size, side;
    double m[3][4]; /* rows of the transform from world, less the asset's origin, to voxels */
};

/* Returns 1 if program and processor have AVX2; else only umbt_map16_finish may be called. */
int umbt_map16_supported(void);

/* Makes a map of lit texels; 1 GiB for 16384 a side. In: log2_size: 3..14. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_map16_init(struct umbt_map16 *map, uint32_t log2_size,
                                            const double world_to_voxel[3][4],
                                            struct umb_error *error);

/* Sets 8 x 8 texels, row by row, from texel (x, y) on, both multiples of 8. */
void umbt_map16_put(struct umbt_map16 *map, uint32_t x, uint32_t y, const int32_t lit[64]);

/* Frees a layout; the map then answers the ways of the other layout. */
void umbt_map16_drop(struct umbt_map16 *map, int tiles);

/* Bytes of the layouts in memory. */
uint64_t umbt_map16_bytes(const struct umbt_map16 *map);

void umbt_map16_finish(struct umbt_map16 *map);

/* A query: answers[i] is the lit share of the taps x taps window around point i. */
struct umbt_map16_query {
    const struct umbt_map16 *map;
    const float *points; /* [3 * count], relative to the asset's origin */
    size_t count;
    int taps; /* 1, 3, 5, 9 or 17 */
    enum umbt_map16_way way;
    unsigned ahead; /* prefetch distance in points, 1..UMBT_MAP16_AHEAD_MAX; set by tuning */
    float *answers; /* [count] */
};

#define UMBT_MAP16_AHEAD_MAX 64U

void umbt_map16_run(const struct umbt_map16_query *query);

/* Sets the query's way, and the prefetch distance that is fastest for it, found by timing a part of
 * the points with each distance. Returns the time of a point in seconds. */
double umbt_map16_tune(struct umbt_map16_query *query, enum umbt_map16_way way);

#endif
