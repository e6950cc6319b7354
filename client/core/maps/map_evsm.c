/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Exponential variance shadow maps: Chebyshev's bound on depth warped by exp(c d), and by
 * -exp(-c' d) where asked for; the smaller of both bounds. d is -1..1.
 *
 * With everything divided by the mean, the bound needs no large numbers: with l1 = log E[e^(cd)] /
 * c and l2 = log E[e^(2cd)] / (2c), depths both, the relative variance is expm1(2c (l2 - l1)),
 * which is never below 0 (power means), and the relative distance is expm1(c (t - l1)). In log
 * space those are the channels; in linear space the channels are the moments, and their ratio is
 * taken.
 *
 * Relative variance by rounded channels: log: l2 - l1 off by 2e makes 4ce; linear: 3 times the
 * format's relative error. The floor is twice that, and never less than (c delta)^2, the variance
 * of a deviation of delta in depth, which min_variance asks for.
 * Sources: Lauritzen, McCool 2008 (both warps); Salvi 2008 (log space).
 */
#include <math.h>
#include "maps/chebyshev.h"
#include "maps/map_channels.h"

static enum umb_status exponent_check(const char *name, double exponent, double most,
                                      struct umb_error *error)
{
    if (!(exponent > 0.0 && isfinite(exponent))) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.%s is %g; it must be above 0", name,
                        exponent);
    }
    if (exponent > most) {
        return umb_fail(error, UMB_E_TOO_LARGE, "settings.%s is %g; the format holds %g", name,
                        exponent, most);
    }
    return UMB_OK;
}

static enum umb_status evsm_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    const int narrow = settings->linear ? UMB_MAP_F16 : UMB_MAP_U16;
    if (settings->format != UMB_MAP_F32 && (int)settings->format != narrow) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "settings.format: F32, or %s in %s space",
                        settings->linear ? "F16" : "U16", settings->linear ? "linear" : "log");
    }
    if (settings->access == UMB_MAP_SAT) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "settings.access: a summed-area table has no room for exponentials");
    }
    const double most =
        settings->linear ? umb_map_exponent_limit(settings->format, 2) : UMB_MAP_EXPONENT_MAX / 4;
    enum umb_status status = exponent_check("exponent", settings->exponent, most, error);
    if (status == UMB_OK && settings->negative_exponent != 0.0) {
        status = exponent_check("negative_exponent", settings->negative_exponent, most, error);
    }
    return status;
}

/* Returns the exponent of warp 0 (of d) or 1 (of -d). */
static double warp_exponent(const struct umb_map_settings *settings, uint32_t warp)
{
    return warp == 0 ? settings->exponent : settings->negative_exponent;
}

static uint32_t evsm_channels(const struct umb_map_settings *settings, double *exponent)
{
    const uint32_t count = settings->negative_exponent > 0.0 ? 4 : 2;
    for (uint32_t k = 0; k < count; k++) {
        exponent[k] =
            settings->linear ? 0.0 : warp_exponent(settings, k / 2) * (double)(1 + (k & 1));
    }
    return count;
}

static double evsm_encode(const struct umb_map_settings *settings, uint32_t k, double depth,
                          const double gain[2])
{
    (void)gain;
    const double along = k < 2 ? depth : -depth;
    return settings->linear ? exp(warp_exponent(settings, k / 2) * (double)(1 + (k & 1)) * along)
                            : along;
}

/* Returns the largest relative variance that rounding alone can cause. */
static double variance_error(const struct umb_map_settings *settings, double c)
{
    return settings->linear ? 6.0 * umb__format_error(settings->format)
                            : expm1(4.0 * c * umb__format_error(settings->format));
}

/* The bound by one warp; at: its two channels; along: the receiver's d, or -d. */
static double warp_bound(const struct umb__map_query *query, uint32_t warp, const double *at,
                         double along)
{
    const struct umb_map_settings *settings = &query->map->settings;
    const double c = warp_exponent(settings, warp);
    double variance, distance; /* Divided by the square of the mean, and by the mean */
    if (settings->linear) {
        variance = at[1] / (at[0] * at[0]) - 1.0;
        distance = exp(c * along) / at[0] - 1.0;
    } else {
        variance = expm1(2.0 * c * (at[1] - at[0]));
        distance = expm1(c * (along - at[0]));
    }
    const double deviation = 2.0 * c * sqrt(settings->min_variance);
    variance = fmax(variance, fmax(deviation * deviation, 2.0 * variance_error(settings, c)));
    /* The second warp reverses depth: lit is the lower side there. */
    return umb__chebyshev(variance, warp == 0 ? distance : -distance, query->filter.contrast);
}

static double evsm_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                          const double *at)
{
    const double depth = 2.0 * receiver->depth - 1.0;
    double visibility = warp_bound(query, 0, at, depth);
    if (query->map->settings.negative_exponent > 0.0) {
        visibility = fmin(visibility, warp_bound(query, 1, at + 2, -depth));
    }
    return visibility;
}

static double evsm_slack(const struct umb_map *map)
{
    (void)map;
    return 0.125; /* the floor is twice the error: at most half of it, times p (1 - p) <= 1/4 */
}

const struct umb__technique umb__map_evsm = {
    .name = "evsm",
    .bound = UMB_MAP_UPPER_BOUND,
    .filterable = 1,
    .check = evsm_check,
    .channels = evsm_channels,
    .encode = evsm_encode,
    .answer = evsm_answer,
    .slack = evsm_slack,
};
