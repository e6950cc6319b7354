/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_CHANNELS_H
#define UMBRAGE_CORE_MAPS_MAP_CHANNELS_H
/*
 * Images of averaged texels: blurred when built, and filtered by bilinear, trilinear or box filters
 * in queries. A channel's value v is a number of -1..1. With an exponent e > 0 the channel is a
 * logarithm: v stands for exp(e v), and averaging is log-sum-exp, which neither overflows nor
 * underflows.
 *
 * Summed-area tables hold sums of round(v 2^40) in 64-bit integers that wrap around. The sum over a
 * box is a difference of four entries. It is exact for a table of any size if the box's own sum is
 * below 2^63, that is for boxes of up to 2896 x 2896 texels. Tables of floats would lose accuracy:
 * with 2^20 texels of 24-bit moments, 4 bits of a small box's sum are left.
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

/* Averages all channels around (x, y) in texels. In: level: mip level, for MIPS. width: width of
 * the box in texels, for SAT. Out: out: double[channels->count]. */
void umb__channels_fetch(const struct umb__channels *channels, double x, double y, double level,
                         double width, double *out);

/* Returns the mean of values by weights whose sum is 1. A channel with an exponent is averaged as a
 * logarithm. In: count: 1..64. */
double umb__channel_mean(double exponent, const double *values, const double *weights,
                         size_t count);

/* Returns the texels a side of mip level `level`: `side` halved so many times, at least 1. */
static inline uint32_t umb__level_side(uint32_t side, uint32_t level)
{
    return side >> level > 0 ? side >> level : 1;
}

#endif
