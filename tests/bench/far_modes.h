/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_FAR_MODES_H
#define UMBRAGE_TESTS_BENCH_FAR_MODES_H
/*
 * Ways to filter a far view, to compare footprints with the methods of Sintorn et al. 2014, section
 * 5. Both of these take two levels of detail around the width of a pixel and interpolate linearly
 * between their answers.
 *
 *   MRAA  a level is a window of `taps` texels in an asset of half the resolution of the one before
 *   VOAA  a level is the lit share of the aligned cube of 2^k voxels around the point, in one asset
 *
 * Level k of either is moved off its surface by the automatic bias of its own texels or cubes. The
 * product has neither: these are for measurements.
 */
#include "umbrage/query.h"

#define FAR_LEVELS 6 /* Assets: 16384 voxels a side, 8192 ... 512 */

/* Assets of one light, each of half the resolution of the one before. */
struct far_assets {
    struct umb_asset *level[FAR_LEVELS];
    double texel_m; /* Mean edge of a texel of the first */
};

/* Points of a view, and for each pixel the width in metres of the surface that it covers. */
struct far_points {
    struct umb_points points;
    double *widths; /* [points.count] */
};

/* The lit shares of an asset's nodes, computed when first needed. */
struct far_shares;
struct far_shares *far_shares_make(const struct umb_asset *asset);
void far_shares_free(struct far_shares *shares);

/* These functions answer all points: MRAA with a batch for each level, the other two point by
 * point. far_window: the exact lit share of the square of the pixel's width at one depth. */
void far_mraa(const struct far_assets *assets, uint32_t taps, const struct far_points *view,
              double *answers);
void far_voaa(const struct far_assets *assets, struct far_shares *shares,
              const struct far_points *view, double *answers);
void far_window(const struct far_assets *assets, const struct far_points *view, double *answers);

/* Biases that were rejected (docs/results/biases.md). */
enum far_bias {
    FAR_BY_NORMAL, /* A move along the normal alone */
    FAR_LONGER     /* The product's lift, a quarter longer where it suffices */
};

/* Answers all points with windows of 9 taps and a rejected bias. Out: values: [points.count]. */
void far_biased(const struct umb_asset *asset, enum far_bias bias, const struct far_points *view,
                float *values);

#endif
