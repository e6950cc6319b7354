/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_FOOTPRINT_H
#define UMBRAGE_CORE_QUERY_FOOTPRINT_H
/*
 * Footprints: how much of the light reaches the patch of a surface that a pixel sees.
 *
 * Level 0 of a point is its window of `taps` texels, as without a footprint. Level k > 0 is the
 * mean of one-tap look-ups spread over a square of its surface, 2^k windows wide: the plane through
 * the point across its normal, lifted towards the light by half the square's side where the bias is
 * automatic. A footprint between the widths of two levels is their linear interpolation, so that an
 * answer is continuous in it: with f1 < f2 answers differ by at most 2 (f2 - f1) / f1.
 *
 * Why a plane and not a wider window, coarser voxels (MRAA) or occupancies of nodes (VOAA) as in
 * Sintorn et al. 2014, section 5: all of these lie at one depth and need a bias as long as they are
 * wide, which is most of their error; docs/results/techniques.md has the figures. The lift takes
 * the place of that bias: it goes along the light, so that no edge is displaced, and clears what a
 * surface does within a pixel.
 */
#include "query/query_parts.h"

#define UMB__FOOTPRINT_SAMPLES 32U /* look-ups a level: a rank-1 lattice over the square ... */
#define UMB__FOOTPRINT_STRIDE  25U /* ... whose generator meets edges of all directions best */

/* Narrowest cosine between a normal and the way to the eye that makes a pixel's patch longer. */
#define UMB__FOOTPRINT_GRAZING 0.0625

/* As umb_query_run promises, of queries whose filter is UMB_FILTER_FOOTPRINT. */
void umb__footprint_run(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers);

/* Returns the footprint of point i in metres; 0 if it has none that is above 0. */
double umb__footprint_of(const struct umb__query *query, const struct umb_points *points, size_t i);

#endif
