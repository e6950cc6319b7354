/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Exponential shadow maps (ESM) and exponential variance shadow maps (EVSM).
 *
 * ESM: visibility is min(1, E[exp(c z)] / exp(c t)), with z the texels' depths, t the receiver's,
 * both 0..1, and c the exponent. EVSM: Chebyshev's bound on depth warped by exp(c d), where d is
 * depth in -1..1; with a negative exponent c' also the bound on -exp(-c' d), and the smaller of the
 * two.
 *
 * In log space a channel is log(E[exp(c z)]) / c, a depth again: any c is possible, and nothing can
 * overflow. A stored depth that is off by e changes an ESM answer by the factor exp(c e). In linear
 * space a channel is exp(c z) itself, as a GPU filters it, and the format bounds c.
 *
 * EVSM divides everything by the mean, so that the bound needs no large numbers. Let l1 =
 * log(E[exp(c d)]) / c and l2 = log(E[exp(2 c d)]) / (2 c), both depths. The variance divided by
 * the square of the mean is expm1(2 c (l2 - l1)), which is never below 0 (power means). The
 * distance divided by the mean is expm1(c (t - l1)). In log space l1 and l2 are the channels. In
 * linear space the channels are the two moments, and the code takes their ratio.
 *
 * Rounding of EVSM's relative variance: in log space, channels off by e each make l2 - l1 off by
 * 2 e and the variance by 4 c e; in linear space the error is 3 times the format's relative error.
 * The floor of the variance is twice that error, and at least (c delta)^2, the variance of a
 * deviation of delta in depth, which min_variance asks for.
 * Sources: Annen et al. 2008 (ESM); Salvi 2008 (filtering in log space); Lauritzen, McCool 2008
 * (both warps).
 */
#include "base/try.h"
#include "maps/map_half.h"
#include "maps/map_parts.h"

double umb_map_exponent_limit(enum umb_map_format format, int moments)
{
    if ((format != UMB_MAP_F32 && format != UMB_MAP_F16) || (moments != 1 && moments != 2)) {
        return 0.0;
    }
    /* The greatest channel value is exp(moments * c), since depth is at most 1. Its logarithm stays
     * 0.1 below that of the format's greatest number, as room for rounding and filter weights. */
    const double most = format == UMB_MAP_F32 ? 3.402823e38 : UMB__HALF_MAX;
    return (log(most) - 0.1) / (double)moments;
}

static enum umb_status format_check(const struct umb_map_settings *settings,
                                    struct umb_error *error)
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
    return UMB_OK;
}

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

static enum umb_status esm_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    UMB__TRY(format_check(settings, error));
    const double most =
        settings->linear ? umb_map_exponent_limit(settings->format, 1) : UMB_MAP_EXPONENT_MAX;
    return exponent_check("exponent", settings->exponent, most, error);
}

static uint32_t esm_channels(const struct umb_map_settings *settings, double *exponent)
{
    exponent[0] = settings->linear ? 0.0 : settings->exponent;
    return 1;
}

static double esm_encode(const struct umb_map_settings *settings, uint32_t k, double depth,
                         const double gain[2])
{
    (void)k;
    (void)gain;
    depth = 0.5 * depth + 0.5;
    return settings->linear ? exp(settings->exponent * depth) : depth;
}

static double esm_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                         const double *at)
{
    const struct umb_map_settings *settings = &query->map->settings;
    const double c = settings->exponent;
    const double ratio = settings->linear ? at[0] * exp(-c * receiver->depth)
                                          : exp(fmin(c * (at[0] - receiver->depth), 0.0));
    return fmin(ratio, 1.0);
}

static double esm_slack(const struct umb_map *map)
{
    const struct umb_map_settings *settings = &map->settings;
    /* In linear space: the format's relative error is twice its absolute error below 1. */
    return settings->linear ? 2.0 * umb__format_error(settings->format)
                            : expm1(settings->exponent * umb__format_error(settings->format));
}

const struct umb__technique umb__map_esm = {
    .name = "esm",
    .bound = UMB_MAP_UPPER_BOUND,
    .filterable = 1,
    .check = esm_check,
    .channels = esm_channels,
    .encode = esm_encode,
    .answer = esm_answer,
    .slack = esm_slack,
};

static enum umb_status evsm_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    UMB__TRY(format_check(settings, error));
    const double most =
        settings->linear ? umb_map_exponent_limit(settings->format, 2) : UMB_MAP_EXPONENT_MAX / 4;
    UMB__TRY(exponent_check("exponent", settings->exponent, most, error));
    return settings->negative_exponent != 0.0
               ? exponent_check("negative_exponent", settings->negative_exponent, most, error)
               : UMB_OK;
}

/* Returns the exponent of warp 0 (of d) or 1 (of -d). */
static double warp_exponent(const struct umb_map_settings *settings, uint32_t warp)
{
    return warp == 0 ? settings->exponent : settings->negative_exponent;
}

static uint32_t evsm_channels(const struct umb_map_settings *settings, double *exponent)
{
    const uint32_t count = settings->negative_exponent > 0.0 ? 4 : 2;
    for (uint32_t k = 0; k < count && !settings->linear; k++) {
        exponent[k] = warp_exponent(settings, k / 2) * (double)(1 + (k & 1));
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

/* Returns the bound on visibility that one warp gives. In: at: the warp's two channels. along: the
 * receiver's depth d in -1..1; for warp 1, -d. */
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
    /* Warp 1 reverses depth: lit is the lower side there. */
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
    /* The floor is twice the variance's error, so that error is at most half of the variance. The
     * bound's derivative p (1 - p) is at most 1/4, and 1/2 times 1/4 is 0.125. */
    return 0.125;
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
