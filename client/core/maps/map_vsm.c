/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Variance shadow maps (VSM), and layered ones (LVSM).
 *
 * Channels are the mean m1 and the mean square m2 of depth d in -1..1. The variance m2 - m1^2
 * subtracts two large numbers; with centred depths the square's rounding error is four times
 * smaller than with depths of 0..1. A layered map has both channels for each of its slices of
 * depth, in which d is stretched to -1..1 and clamped. A receiver reads the slice that it lies in;
 * an occluder of another slice appears at one end of it.
 *
 * If both channels are off by e, the variance is off by at most e + 2 e + e^2, since |d| <= 1. The
 * floor of the variance is twice that error, so that a plane, whose variance is 0, cannot flicker.
 *
 * Sources: Donnelly, Lauritzen 2006 (moments, bound); Lauritzen 2007 (floor; second moment of a
 * plane in a texel, 0.25 (gx^2 + gy^2): a deviation of half a texel); Lauritzen, McCool 2008
 * (layers).
 */
#include "maps/map_channels.h"

/* Returns the least variance of depths in -1..1. */
static double variance_floor(const struct umb_map_settings *settings)
{
    return fmax(4.0 * settings->min_variance, 8.0 * umb__channel_error(settings));
}

static double second_moment(double depth, const double gain[2])
{
    return depth * depth + fmin(0.25 * (gain[0] * gain[0] + gain[1] * gain[1]), 1.0);
}

static double bound(const struct umb__map_query *query, const double moments[2], double depth)
{
    const double variance =
        fmax(moments[1] - moments[0] * moments[0], variance_floor(&query->map->settings));
    return umb__chebyshev(variance, depth - moments[0], query->filter.contrast);
}

static double vsm_encode(const struct umb_map_settings *settings, uint32_t k, double depth,
                         const double gain[2])
{
    (void)settings;
    return k == 0 ? depth : second_moment(depth, gain);
}

/*
 * Returns the width of the receiver's penumbra in texels. It follows from the mean depth of the
 * blockers, which in turn follows from the mean depth under the widest filter: mean = lit * depth +
 * (1 - lit) * blockers, if the share `lit` of the filter lies at the receiver's depth.
 * Source: Yang et al. 2010 (variance soft shadow mapping).
 */
static double penumbra_width(const struct umb__map_query *query,
                             const struct umb__receiver *receiver)
{
    double at[2];
    const double width = umb__penumbra_texels(query, receiver, query->map->nearest);
    const double depth = 2.0 * receiver->depth - 1.0;
    umb__channels_fetch(&query->map->channels, receiver->x, receiver->y, 0.0, width, at);
    const double lit = bound(query, at, depth);
    if (!(lit < 1.0)) {
        return 1.0;
    }
    const double blockers = (at[0] - lit * depth) / (1.0 - lit);
    return umb__penumbra_texels(query, receiver, fmax(0.5 * blockers + 0.5, query->map->nearest));
}

static double vsm_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                         const double *at)
{
    double moments[2] = {at[0], at[1]};
    if (query->filter.light_size > 0.0 && !query->map->settings.keep_depth) {
        const double width = penumbra_width(query, receiver);
        umb__channels_fetch(&query->map->channels, receiver->x, receiver->y, 0.0, width, moments);
    }
    return bound(query, moments, 2.0 * receiver->depth - 1.0);
}

/*
 * Returns how far rounding can push an answer below Chebyshev's bound. Let e be the channels'
 * error. Rounding lowers the variance by up to 3 e, and the floor is 8 e, so a true variance of 11
 * e may count as 8 e. The bound's derivative by the logarithm of the variance is p (1 - p) <= 1/4;
 * times log(11/8) that is 0.0796. The error e of the mean adds at most 0.65 e / sqrt(8 e).
 */
static double vsm_slack(const struct umb_map *map)
{
    return 0.0797 + 0.23 * sqrt(umb__channel_error(&map->settings));
}

const struct umb__technique umb__map_vsm = {
    .name = "vsm",
    .bound = UMB_MAP_UPPER_BOUND,
    .filterable = 1,
    .plain = "moments",
    .channel_count = 2,
    .encode = vsm_encode,
    .answer = vsm_answer,
    .slack = vsm_slack,
};

static enum umb_status lvsm_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    if (settings->terms < 1 || settings->terms > UMB_MAP_TERMS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.terms: %u layers; it must be 1..%d",
                        settings->terms, UMB_MAP_TERMS_MAX);
    }
    return UMB_OK;
}

/* Stretches a depth so that slice `slice` of `count` becomes -1..1, and clamps it. */
static double slice_depth(double depth, uint32_t slice, uint32_t count)
{
    const double stretched = (depth + 1.0) * (double)count - 2.0 * (double)slice - 1.0;
    return fmin(fmax(stretched, -1.0), 1.0);
}

static double lvsm_encode(const struct umb_map_settings *settings, uint32_t k, double depth,
                          const double gain[2])
{
    const double in_slice = slice_depth(depth, k / 2, settings->terms);
    const double interval = fabs(in_slice) < 1.0 ? (double)settings->terms : 0.0;
    const double stretched[2] = {interval * gain[0], interval * gain[1]};
    return (k & 1) == 0 ? in_slice : second_moment(in_slice, stretched);
}

static double lvsm_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                          const double *at)
{
    const uint32_t count = query->map->settings.terms;
    const double scaled = fmin(receiver->depth, 1.0) * (double)count;
    const uint32_t slice = scaled < (double)count ? (uint32_t)scaled : count - 1;
    return bound(query, at + 2 * (size_t)slice,
                 slice_depth(2.0 * receiver->depth - 1.0, slice, count));
}

const struct umb__technique umb__map_lvsm = {
    .name = "lvsm",
    .bound = UMB_MAP_UPPER_BOUND,
    .filterable = 1,
    .plain = "moments",
    .check = lvsm_check,
    .channels_a_term = 2,
    .encode = lvsm_encode,
    .answer = lvsm_answer,
    .slack = vsm_slack,
};
