/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Exponential shadow maps: visibility min(1, E[exp(c z)] / exp(c t)).
 *
 * In log space a channel is log(E[exp(c z)]) / c, a depth again: any c is possible, and nothing can
 * overflow. A stored depth that is off by e changes an answer by the factor exp(c e). In linear
 * space a channel is exp(c z) itself, as a GPU filters it, and c is bounded by the format.
 * Depths are 0..1 here, since only their differences count.
 * Sources: Annen et al. 2008; Salvi 2008 (filtering in log space).
 */
#include <math.h>
#include "maps/map_half.h"
#include "maps/map_channels.h"

double umb_map_exponent_limit(enum umb_map_format format, int moments)
{
    if ((format != UMB_MAP_F32 && format != UMB_MAP_F16) || (moments != 1 && moments != 2)) {
        return 0.0;
    }
    /* log of the greatest number, less 0.1 so that rounding and filter weights stay inside: the
     * channel exp(moments c d), where d is at most 1 for ESM and for the warps of EVSM. */
    const double most = format == UMB_MAP_F32 ? 3.402823e38 : UMB__HALF_MAX;
    return (log(most) - 0.1) / (double)moments;
}

static enum umb_status esm_check(const struct umb_map_settings *settings, struct umb_error *error)
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
        settings->linear ? umb_map_exponent_limit(settings->format, 1) : UMB_MAP_EXPONENT_MAX;
    if (!(settings->exponent > 0.0 && isfinite(settings->exponent))) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.exponent is %g; it must be above 0",
                        settings->exponent);
    }
    if (settings->exponent > most) {
        return umb_fail(error, UMB_E_TOO_LARGE, "settings.exponent is %g; the format holds %g",
                        settings->exponent, most);
    }
    return UMB_OK;
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
    /* Linear: a relative error of the format (twice its absolute one below 1). */
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
