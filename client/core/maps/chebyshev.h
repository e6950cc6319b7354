/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_CHEBYSHEV_H
#define UMBRAGE_CORE_MAPS_CHEBYSHEV_H
/*
 * The one-sided Chebyshev inequality: of a distribution with mean mu and variance s2, the share at
 * or beyond t > mu is at most s2 / (s2 + (t - mu)^2).
 *
 * `contrast` is the constant C of Fu and Liu 2013, s2 / (s2 + C (t - mu)^2); 1 is the inequality
 * itself.
 */

/* In: variance: > 0. distance: t - mu; at most 0 means lit. Returns 0..1, 1 when lit. */
static inline double umb__chebyshev(double variance, double distance, double contrast)
{
    if (!(distance > 0.0)) {
        return 1.0;
    }
    /* distance may be infinite, variance cannot: x / inf is the right limit, 0. */
    return variance / (variance + contrast * distance * distance);
}

#endif
