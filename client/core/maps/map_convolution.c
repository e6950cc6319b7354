/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Convolution shadow maps: the step of the depth comparison as a Fourier series,
 *
 *     [z >= t] ~ 1/2 + sum over k = 1..M of 2/w_k sin(w_k (z - t)),   w_k = (2k - 1) pi,
 *
 * split by the addition theorem into functions of z, which are the 2M channels (sine and cosine of
 * w_k z) and can be averaged, and functions of t. Depths are 0..1: the square wave's period of 2
 * then holds every difference.
 *
 * At the step itself the series is 1/2, whatever M: a receiver on the very surface that the map
 * sees would be half dark. The answer is therefore twice the series, clamped to 1, which is the lit
 * share where the receiver lies on the deepest surface of its filter, and falls to 0 within 1/(2M)
 * of depth behind an occluder.
 *
 * A truncated series rings: it overshoots by 9 % of the step beside each edge, however many terms
 * (Gibbs). Damping term k by exp(-damping (k/M)^2) trades the overshoot for a wider slope; at 2
 * half of it and less is left.
 *
 * Sines of odd multiples come by the recurrence s_(k+1) = 2 cos(2a) s_k - s_(k-1), whose error
 * grows with k^2: below 2e-13 for the greatest M (docs/explained/numerics-maps.md).
 * Source: Annen et al. 2007.
 */
#include <math.h>
#include "maps/map_channels.h"

static const double pi = 3.14159265358979323846;

static enum umb_status convolution_check(const struct umb_map_settings *settings,
                                         struct umb_error *error)
{
    if (settings->format != UMB_MAP_F32 && settings->format != UMB_MAP_U16) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "settings.format: Fourier terms are F32 or U16");
    }
    if (settings->terms < 1 || settings->terms > UMB_MAP_TERMS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.terms is %u; it must be 1..%d",
                        settings->terms, UMB_MAP_TERMS_MAX);
    }
    if (!(settings->damping >= 0.0 && settings->damping <= 100.0)) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.damping is %g; it must be 0..100",
                        settings->damping);
    }
    return UMB_OK;
}

static uint32_t convolution_channels(const struct umb_map_settings *settings, double *exponent)
{
    for (uint32_t k = 0; k < 2 * settings->terms; k++) {
        exponent[k] = 0.0;
    }
    return 2 * settings->terms;
}

/* Channel 2k is the sine, 2k + 1 the cosine of term k. */
static double convolution_encode(const struct umb_map_settings *settings, uint32_t k, double depth,
                                 const double gain[2])
{
    (void)settings;
    (void)gain;
    const double angle = (double)(2 * (k / 2) + 1) * pi * (0.5 * depth + 0.5);
    return (k & 1) == 0 ? sin(angle) : cos(angle);
}

static double convolution_answer(const struct umb__map_query *query,
                                 const struct umb__receiver *receiver, const double *at)
{
    const struct umb_map_settings *settings = &query->map->settings;
    const double m = (double)settings->terms;
    const double a = pi * fmin(receiver->depth, 1.0);
    const double twice = 2.0 * cos(2.0 * a);
    double s = sin(a), c = cos(a), s_before = -s, c_before = c;
    double sum = 0.5;
    for (uint32_t k = 0; k < settings->terms; k++) {
        const double order = (double)(k + 1) / m;
        const double weight =
            2.0 / ((double)(2 * k + 1) * pi) *
            (settings->damping > 0.0 ? exp(-settings->damping * order * order) : 1.0);
        const size_t i = 2 * (size_t)k;
        sum += weight * (at[i] * c - at[i + 1] * s);
        const double s_next = twice * s - s_before, c_next = twice * c - c_before;
        s_before = s;
        c_before = c;
        s = s_next;
        c = c_next;
    }
    return fmin(fmax(2.0 * sum, 0.0), 1.0);
}

/* Each term's channels are off by e: twice the sum of 2/w_k times 2e. */
static double convolution_slack(const struct umb_map *map)
{
    const double error =
        map->settings.access == UMB_MAP_SAT ? 0x1p-41 : umb__format_error(map->settings.format);
    double sum = 0.0;
    for (uint32_t k = 0; k < map->settings.terms; k++) {
        sum += 2.0 / ((double)(2 * k + 1) * pi);
    }
    return 4.0 * error * sum + 1e-12;
}

const struct umb__technique umb__map_convolution = {
    .name = "convolution",
    .bound = UMB_MAP_ESTIMATE,
    .filterable = 1,
    .check = convolution_check,
    .channels = convolution_channels,
    .encode = convolution_encode,
    .answer = convolution_answer,
    .slack = convolution_slack,
};
