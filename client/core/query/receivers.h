/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_RECEIVERS_H
#define UMBRAGE_CORE_QUERY_RECEIVERS_H
/*
 * Receivers of footprints: points with their surface, light and footprint, and the two squares of
 * surface whose means give the answer. A block of 64 is kept by field, so that compilers vectorise
 * each step over the points. Every step is written once, in doubles without contraction, and gives
 * the same bits for all instruction sets.
 */
#include "query/query_parts.h"

#define UMB__RECEIVERS      64U
#define UMB__SQUARE_SAMPLES 32U /* Look-ups of a square: a rank-1 lattice over it ... */
#define UMB__SQUARE_STRIDE  25U /* ... whose generator meets edges of all directions best */

/* Receivers of a block, one in each lane. Flags are 0 or 1 in words as wide as the doubles. */
struct umb__receivers {
    uint32_t count;
    _Alignas(
        64) double p[3][UMB__RECEIVERS]; /* Position in metres, relative to the asset's origin */
    double given[3][UMB__RECEIVERS];     /* Normal as given; 0 without one */
    double normal[3][UMB__RECEIVERS];    /* Unit normal; towards the light without one */
    double light[3][UMB__RECEIVERS];     /* Unit vector in which the light travels there */
    double reach[UMB__RECEIVERS];        /* Distance in metres to the light; infinite for a sun */
    double texel_m[UMB__RECEIVERS];      /* Mean edge of a texel there, metres */
    double side[UMB__RECEIVERS];         /* Footprint, metres */
    double level_m[UMB__RECEIVERS];      /* Width in metres of the level below the footprint */
    double weight[UMB__RECEIVERS];       /* Weight of the level above the footprint, 0 to 1 */
    uint64_t has_normal[UMB__RECEIVERS];
    uint64_t window[UMB__RECEIVERS]; /* 1: the window is the answer */
    uint64_t both[UMB__RECEIVERS];   /* 1: the level below is a square, too; 0: the window */
    /* Lit samples, a bit each: of the square of the level below in the low half, of the level above
     * in the high half */
    uint64_t lit[UMB__RECEIVERS];
    double lit_count[2][UMB__RECEIVERS]; /* Number of these, below and above */
    /* For a sun: the squares of the levels below and above the footprint, in voxel space. Edges are
     * those of the square above. The square below has the same directions and is half as wide. */
    double centre[2][3][UMB__RECEIVERS];
    double edge[2][3][UMB__RECEIVERS];
    double voxel[3][UMB__RECEIVERS];  /* Where one tap is looked up */
    uint64_t tame[UMB__RECEIVERS];    /* 1: all voxel indices of samples fit into 32 bits */
    uint64_t compact[UMB__RECEIVERS]; /* 1: all samples are within four cubes on each axis */
};

/* Reads the points first .. first + count - 1 and finds their footprints and levels. Out: all
 * fields but `lit` and what follows it. */
typedef void umb__receivers_fn(const struct umb__query *query, const struct umb_points *points,
                               size_t first, uint32_t count, struct umb__receivers *receivers);

/* Answers the squares of receivers for opaque casters. Receivers whose `window` is 1 have none, and
 * those whose `both` is 0 have no square below. A sample outside the frusta is answered as a point
 * is. Out: lit, lit_count; for a sun the squares in voxel space. */
typedef void umb__squares_fn(const struct umb__query *query, struct umb__receivers *receivers,
                             struct umb_query_stats *stats);

umb__receivers_fn umb__receivers_base, umb__receivers_avx2, umb__receivers_avx512;
umb__squares_fn umb__squares_base, umb__squares_avx2, umb__squares_avx512;

/* Returns the place of a sample on an edge of its square, -1/2 to 1/2. axis: 0 or 1. */
static inline double umb__square_place(uint32_t sample, unsigned axis)
{
    const uint32_t at = axis == 0 ? sample : sample * UMB__SQUARE_STRIDE % UMB__SQUARE_SAMPLES;
    return ((double)at + 0.5) / UMB__SQUARE_SAMPLES - 0.5;
}

#endif
