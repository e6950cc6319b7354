/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MOMENT_BOUND_H
#define UMBRAGE_CORE_MAPS_MOMENT_BOUND_H
/*
 * Bounds of the share of a distribution over -1..1 that lies before t, given 4, 6 or 8 of its
 * moments: the Chebyshev-Markov-Stieltjes bounds, which are the best that moments allow.
 *
 * Moments are the means of Chebyshev's polynomials T1..T2K. Of all distributions that have them one
 * has its mass at t and K other places only; it has the least share before t of all, and the most
 * at t. Its places are the roots of the kernel sum of pk(t) pk(z), k = 0..K, where pk are the
 * polynomials that are orthogonal under these moments, and its masses 1 / sum of pk(z)^2.
 *
 * The polynomials come from the means by the modified Chebyshev algorithm, which starts at
 * Chebyshev's own recurrence and is as well conditioned as the distribution is (powers of d lose a
 * digit a moment). A distribution of K places or fewer has no K-th polynomial; so what is solved is
 * a mixture with `bias` of the arcsine distribution, whose means are all 0: the means shrink by 1 -
 * bias, nothing more. Means that are off by e each are those of a mixture whose second part has the
 * density 1 + 2 sum of (e / bias) Tk of the arcsine's: at least a half if bias is 4 e a moment.
 * Then squared norms are at least bias 4^-k, and both bounds are off by `bias` at most.
 *
 * Source: Szego, Orthogonal polynomials, 3.41; Sack, Donovan 1971 (modified moments); Peters, Klein
 * 2015 and Muenstermann et al. 2018 (bounds for shadows, from powers).
 */
#include <stdint.h>

#define UMB__MOMENTS_MAX 8U

/* Least bias: smaller ones count as this. It keeps squared norms, which are divisors, far from the
 * least numbers. Doubles need more (umb__moment_bias). */
#define UMB__MOMENT_BIAS_MIN 0x1p-100

struct umb__moment_bound {
    double before; /* Least share that lies before t, 0..1 */
    double at;     /* Most that can lie at t; before + at is the greatest share up to t */
};

/* Returns the bias that means with errors of up to `e` need, at least what doubles need. */
double umb__moment_bias(uint32_t count, double e);

/*
 * In:  means: double[count] of T1..Tcount, each within -1..1. count: 4, 6 or 8. bias: 0..1, see
 *      UMB__MOMENT_BIAS_MIN. t: -1..1.
 * Cost: 50 to 400 additions and products, no allocation; arithmetic without libm but sqrt: the same
 *       bits everywhere.
 */
struct umb__moment_bound umb__moment_bound(const double *means, uint32_t count, double bias,
                                           double t);

#endif
