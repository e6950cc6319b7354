/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Moment shadow maps: the least share of a distribution of depth that must lie before the
 * receiver's depth t, given the distribution's first four moments b1..b4 (Hamburger's moment
 * problem). The visibility is 1 minus that share.
 *
 * Channels are the means t1..t4 of Chebyshev's polynomials T1..T4 of depth in -1..1. All four are
 * within -1..1 and use a 16-bit format's range evenly, unlike the means of powers. The moments
 * follow from the channels by
 *     b1 = t1, b2 = (1 + t2)/2, b3 = (3 t1 + t3)/4, b4 = (3 + 4 t2 + t4)/8,
 * and no moment is further off than the channels are.
 *
 * The distribution with the least share before t has its mass at t and at the two roots of a
 * quadratic. The coefficients c of the quadratic solve B c = (1, t, t^2), where B is the Hankel
 * matrix of (1, b1, .. b4). B is singular if the texels have only one or two depths, which is just
 * where shadows usually are, and rounding then makes B indefinite. Two steps prevent that. The
 * moments are first moved by the share `bias` towards b* = (0, 3/8, 0, 9/32), the moments of a
 * distribution far from singular: mass 1/4 at -sqrt(3/4), 1/2 at 0 and 1/4 at sqrt(3/4). And the
 * pivots of B's Cholesky factors are held above `bias` / 32, less than the move leaves them.
 *
 * A bias of 16 e is enough for channels that are off by e. The moved moments are those of a mixture
 * (1 - bias) F + bias G, where F is the true distribution and G takes up the rounding: the moments
 * of G differ from b* by at most (1, 1/2, 1, 5/8) / 16. With these the pivots of G are still at
 * least 1/3 and 1/20, so G is a distribution. The answer is then a valid bound for the mixture, and
 * it is off by at most `bias` for F.
 * Source: Peters, Klein 2015.
 */
#include "maps/map_parts.h"
#include "maps/moment_bound.h"

static double default_bias(const struct umb_map_settings *settings)
{
    return settings->access == UMB_MAP_SAT ? 1e-9 : 16.0 * umb__format_error(settings->format);
}

static double bias_of(const struct umb_map_settings *settings)
{
    return settings->moment_bias > 0.0 ? fmax(settings->moment_bias, UMB__MOMENT_BIAS_MIN)
                                       : default_bias(settings);
}

static enum umb_status msm_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    return umb__check_number("settings.moment_bias", settings->moment_bias, 0.0, 1.0, error);
}

static double msm_encode(const struct umb_map_settings *settings, uint32_t k, double depth,
                         const double gain[2])
{
    (void)settings;
    (void)gain;
    const double square = depth * depth;
    switch (k) {
    case 0:
        return depth;
    case 1:
        return 2.0 * square - 1.0;
    case 2:
        return (4.0 * square - 3.0) * depth;
    default:
        return (8.0 * square - 8.0) * square + 1.0;
    }
}

/* Computes the moments b1..b4 from the channels, moved towards b* by the share `bias`. */
static void moments_of(const double *at, double bias, double b[4])
{
    static const double inner[4] = {0.0, 0.375, 0.0, 0.28125};
    b[0] = at[0];
    b[1] = 0.5 + 0.5 * at[1];
    b[2] = 0.75 * at[0] + 0.25 * at[2];
    b[3] = 0.375 + 0.5 * at[1] + 0.125 * at[3];
    for (int k = 0; k < 4; k++) {
        b[k] += bias * (inner[k] - b[k]);
    }
}

/* Solves B c = (1, t, t^2) with the factors B = L D L^T. The pivots in D are at least `least`. */
static void hankel_solve(const double b[4], double t, double least, double c[3])
{
    const double d22 = fmax(b[1] - b[0] * b[0], least);
    const double l32 = (b[2] - b[0] * b[1]) / d22;
    const double d33 = fmax(b[3] - b[1] * b[1] - l32 * l32 * d22, least);
    const double y1 = t - b[0];
    const double y2 = t * t - b[1] - l32 * y1;
    c[2] = y2 / d33;
    c[1] = y1 / d22 - l32 * c[2];
    c[0] = 1.0 - b[0] * c[1] - b[1] * c[2];
}

/* Finds the roots z2 <= z3 of c2 z^2 + c1 z + c0 without cancellation; 0 if they are not real. */
static int roots_find(const double c[3], double roots[2])
{
    const double square = c[1] * c[1] - 4.0 * c[0] * c[2];
    if (!(square >= 0.0)) {
        return 0;
    }
    const double q = -0.5 * (c[1] + copysign(sqrt(square), c[1]));
    /* q is 0 only if c1 = 0 and c0 c2 = 0. */
    if (q == 0.0 || c[2] == 0.0) {
        return 0;
    }
    const double a = q / c[2], other = c[0] / q;
    roots[0] = fmin(a, other);
    roots[1] = fmax(a, other);
    return 1;
}

/* Returns the least share of the distribution before t. */
static double share_before(const double b[4], double t, double least)
{
    double c[3], z[2];
    hankel_solve(b, t, least, c);
    if (!roots_find(c, z)) {
        /* Up to rounding the distribution is the single depth b1. */
        return t > b[0] ? 1.0 : 0.0;
    }
    if (t <= z[0]) {
        return 0.0;
    }
    if (t <= z[1]) {
        return (t * z[1] - b[0] * (t + z[1]) + b[1]) / ((z[1] - z[0]) * (t - z[0]));
    }
    return 1.0 - (z[0] * z[1] - b[0] * (z[0] + z[1]) + b[1]) / ((t - z[0]) * (t - z[1]));
}

static double msm_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                         const double *at)
{
    double b[4];
    const double bias = bias_of(&query->map->settings);
    moments_of(at, bias, b);
    const double before = share_before(b, 2.0 * receiver->depth - 1.0, 0.03125 * bias);
    return isnan(before) ? 0.0 : 1.0 - fmin(fmax(before, 0.0), 1.0);
}

static double msm_slack(const struct umb_map *map)
{
    const double bias = bias_of(&map->settings);
    /* With a bias below what rounding needs, answers are no bounds. */
    return bias < default_bias(&map->settings) ? 1.0 : fmin(bias, 1.0);
}

const struct umb__technique umb__map_msm = {
    .name = "msm",
    .bound = UMB_MAP_UPPER_BOUND,
    .filterable = 1,
    .plain = "moments",
    .check = msm_check,
    .channel_count = 4,
    .encode = msm_encode,
    .answer = msm_answer,
    .slack = msm_slack,
};
