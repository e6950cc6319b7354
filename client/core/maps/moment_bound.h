/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MOMENT_BOUND_H
#define UMBRAGE_CORE_MAPS_MOMENT_BOUND_H
/*
 * Bounds of the share of a distribution over -1..1 that lies before a place t, given 4, 6 or 8 of
 * its moments: the Chebyshev-Markov-Stieltjes bounds, which are the best that moments allow.
 *
 * The moments are the means of Chebyshev's polynomials T1..T2K. Among all distributions with these
 * means, there is one that has mass only at t and at K other places. This distribution has the
 * least share before t, and the most at t. Let p0..pK be the polynomials that are orthonormal under
 * these means. The K places are the roots in z of the kernel p0(t) p0(z) + ... + pK(t) pK(z), and
 * the mass at a place z is
 * 1 / (p0(z)^2 + ... + pK(z)^2).
 *
 * The modified Chebyshev algorithm computes the polynomials from the means. It starts at
 * Chebyshev's own recurrence and is as well conditioned as the distribution is; powers of depth
 * would lose a digit with each moment.
 *
 * A distribution of K places or fewer has no K-th polynomial. Therefore the code solves a mixture
 * with the share `bias` of the arcsine distribution, whose means are all 0: it multiplies the means
 * by 1 - bias, nothing more. If each mean is off by e, the means are those of a mixture whose
 * second part has, relative to the arcsine distribution, the density 1 + 2 sum of (e / bias) Tk.
 * That density is at least a half if bias is 4 e for each moment. Then the squared norm of the k-th
 * monic polynomial is at least bias 4^-k, and both bounds are off by `bias` at most.
 *
 * Source: Szego, Orthogonal polynomials, 3.41; Sack, Donovan 1971 (modified moments); Peters, Klein
 * 2015 and Muenstermann et al. 2018 (bounds for shadows, from powers).
 */
#include <stdint.h>

#define UMB__MOMENTS_MAX 8U

/* Least bias; a smaller one counts as this. It keeps squared norms, which are divisors, far above
 * the least double. Accurate bounds need more (umb__moment_bias). */
#define UMB__MOMENT_BIAS_MIN 0x1p-100

struct umb__moment_bound {
    double before; /* Least share that lies before t, 0..1 */
    double at;     /* Greatest share that can lie at t; before + at is the greatest share up to t */
};

/* Returns the bias needed by `count` means with errors of up to `e`, and at least the bias that the
 * rounding of doubles needs. */
double umb__moment_bias(uint32_t count, double e);

/*
 * Computes both bounds at t.
 *
 * In:  means: double[count] of T1..Tcount, each within -1..1. count: 4, 6 or 8. bias: 0..1, see
 *      UMB__MOMENT_BIAS_MIN. t: -1..1.
 * Cost: 50 to 400 additions and products, no allocation; arithmetic without libm but sqrt: the same
 *       bits everywhere.
 */
struct umb__moment_bound umb__moment_bound(const double *means, uint32_t count, double bias,
                                           double t);

#endif
