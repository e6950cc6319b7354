/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Convolution shadow maps: the comparison of a texel's depth z with the receiver's depth t as a
 * Fourier series of M terms,
 *
 *     [z >= t] ~ 1/2 + sum over k = 1..M of 2/w_k sin(w_k (z - t)),   w_k = (2k - 1) pi.
 *
 * The addition theorem splits each term into functions of z and functions of t. Those of z, sin and
 * cos of w_k z, are the 2M channels and can be averaged over texels. The series is a square wave of
 * period 2; depths are 0..1, so that one period holds every difference z - t.
 *
 * At z = t the series is 1/2 for any M, so a receiver on the very surface that the map sees would
 * be half dark. Therefore the answer is twice the series, clamped to 1. It is right where the
 * receiver lies on the deepest surface under the filter, and it falls to 0 within 1/(2M) of depth
 * behind an occluder.
 *
 * A truncated series overshoots by 9 % of the step beside each edge, for any number of terms
 * (Gibbs). The factor exp(-damping (k/M)^2) of term k trades overshoot for a wider slope; damping 2
 * leaves at most half of the overshoot.
 *
 * The sines of odd multiples of an angle a come from the recurrence s_(k+1) = 2 cos(2a) s_k -
 * s_(k-1), where s_k = sin((2k - 1) a), and the cosines likewise. Its rounding error grows with k^2
 * and stays below 2e-13 for the greatest M (docs/explained/numerics-maps.md).
 * Source: Annen et al. 2007.
 */
#include "maps/map_parts.h"

static const double pi = 3.14159265358979323846;

static enum umb_status convolution_check(const struct umb_map_settings *settings,
                                         struct umb_error *error)
{
    if (settings->terms < 1 || settings->terms > UMB_MAP_TERMS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.terms is %u; it must be 1..%d",
                        settings->terms, UMB_MAP_TERMS_MAX);
    }
    return umb__check_number("settings.damping", settings->damping, 0.0, 100.0, error);
}

/* Computes channel 2j, the sine of term j + 1, or channel 2j + 1, its cosine. */
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

/* Returns the error of an answer if each channel is off by at most `error`. Term k has two channels
 * and the factor 2 / w_k, so the series is off by at most the sum of 2 error * 2 / w_k. The answer
 * is twice the series. */
static double convolution_slack(const struct umb_map *map)
{
    const double error = umb__channel_error(&map->settings);
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
    .plain = "Fourier terms",
    .check = convolution_check,
    .channels_a_term = 2,
    .encode = convolution_encode,
    .answer = convolution_answer,
    .slack = convolution_slack,
};
