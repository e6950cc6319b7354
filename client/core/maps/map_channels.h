/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_CHANNELS_H
#define UMBRAGE_CORE_MAPS_MAP_CHANNELS_H
/*
 * Images of averaged texels: blurred when built, and filtered by bilinear, trilinear or box filters
 * in queries. A channel is a number of -1..1, or, with an exponent e > 0, a logarithm: it stands
 * for exp(e v), and averaging is log-sum-exp, which can neither overflow nor underflow.
 *
 * Summed-area tables hold sums of round(v 2^40) in 64-bit integers that wrap around. The sum of a
 * box is a difference of four of them and exact, whatever the size of the table, as long as the box
 * itself is below 2^63: up to 2896 x 2896 texels. (Tables of floats lose as many bits as the
 * corner's sum is longer than the box's: with 2^20 texels of 24-bit moments 4 bits are left.)
 * Source: Crow 1984; Lauritzen 2007 (tables of integers for variance maps).
 */
#include "maps/map_parts.h"

/*
 * Encodes, blurs and stores all channels of all texels.
 *
 * Fails: E_NO_MEMORY; E_ARGUMENT (MIPS and sides that are no powers of two).
 */
UMB_CHECKED enum umb_status umb__channels_init(struct umb__channels *channels,
                                               const struct umb_map *map,
                                               const struct umb__texels *texels,
                                               struct umb_error *error);
void umb__channels_finish(struct umb__channels *channels, const struct umb_map *map);

/* Averaged channels around (x, y) in texels; `level` for MIPS, `width` in texels for SAT.
 * out: double[channels->count]. */
void umb__channels_fetch(const struct umb__channels *channels, double x, double y, double level,
                         double width, double *out);

/* Mean of values with weights that add to 1, by a channel's exponent. In: count: 1..64. */
double umb__channel_mean(double exponent, const double *values, const double *weights,
                         size_t count);

#endif
