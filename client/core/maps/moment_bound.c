/* SPDX-License-Identifier: Apache-2.0 */
/* Bounds of a distribution from its moments; see moment_bound.h. */
#include "maps/moment_bound.h"

#include <math.h>
#include <string.h>

#define DEGREE_MAX (UMB__MOMENTS_MAX / 2)
/* Largest distance of a root from 0; a root farther away is moved to this distance. The mass of a
 * place z is at most the squared norm of the last polynomial divided by (z - 1)^2K. At this
 * distance the mass is below 2e-13 for K = 2, and below 4e-11 for larger K: negligible. */
#define FAR   1024.0 /* For quadratic polynomials */
#define REACH 32.0   /* Limit for larger K: it shortens the search for their roots */

/* Monic orthogonal polynomials: p0 = 1, p(k+1) = (z - centre[k]) pk - pull[k] p(k-1). */
struct polynomials {
    uint32_t degree;               /* Degree K of the last polynomial */
    double centre[DEGREE_MAX];     /* Coefficients for k = 0..K-1 */
    double pull[DEGREE_MAX];       /* Coefficients for k = 1..K-1 */
    double square[DEGREE_MAX + 1]; /* Squared norms of p0..pK */
};

double umb__moment_bias(uint32_t count, double e)
{
    static const double least[] = {1e-9, 1e-8, 1e-7}; /* For 4, 6 and 8 moments */
    return fmin(fmax(4.0 * (double)count * e, least[count / 2 - 2]), 1.0);
}

/* Computes the polynomials by the modified Chebyshev algorithm. Row k holds the means of pk Tl for
 * l = k..2K - k, where Tl is scaled to be monic. */
static void polynomials_make(const double *means, uint32_t count, double bias,
                             struct polynomials *p)
{
    double last[UMB__MOMENTS_MAX + 1] = {0}, row[UMB__MOMENTS_MAX + 1] = {1.0};
    double next[UMB__MOMENTS_MAX + 1] = {0};
    double scale = 1.0 - bias, least = 0.5 * bias;
    p->degree = count / 2;
    for (uint32_t l = 1; l <= count; l++, scale *= 0.5) {
        row[l] = scale * means[l - 1];
    }
    p->square[0] = 1.0;
    p->centre[0] = row[1];
    for (uint32_t k = 1; k <= p->degree; k++) {
        least *= 0.25; /* Half of the least squared norm of the mixture: bias 4^-k / 2 */
        const double pull = k > 1 ? p->square[k - 1] / p->square[k - 2] : 0.0;
        for (uint32_t l = k; l <= count - k; l++) {
            const double own = l == 1 ? 0.5 : 0.25; /* From the recurrence of the monic Tl */
            next[l] = row[l + 1] - p->centre[k - 1] * row[l] + own * row[l - 1] - pull * last[l];
        }
        p->square[k] = fmax(next[k], least);
        if (k < p->degree) {
            p->pull[k] = p->square[k] / p->square[k - 1];
            p->centre[k] = next[k + 1] / p->square[k] - row[k] / p->square[k - 1];
        }
        memcpy(last, row, sizeof last);
        memcpy(row, next, sizeof row);
    }
}

/* Computes the values of p0..pK at z. */
static void values_at(const struct polynomials *p, double z, double *values)
{
    values[0] = 1.0;
    values[1] = z - p->centre[0];
    for (uint32_t k = 1; k < p->degree; k++) {
        values[k + 1] = (z - p->centre[k]) * values[k] - p->pull[k] * values[k - 1];
    }
}

/* Returns the mass at a place z of the distribution that attains the bounds (moment_bound.h). */
static double mass_at(const struct polynomials *p, double z)
{
    double values[DEGREE_MAX + 1], sum = 0.0;
    values_at(p, z, values);
    for (uint32_t k = 0; k <= p->degree; k++) {
        sum += values[k] * values[k] / p->square[k];
    }
    return 1.0 / sum;
}

/* Computes the coefficients c[0..K] of the kernel of t as a polynomial in z, multiplied by the
 * squared norm of pK. */
static void kernel_make(const struct polynomials *p, double t, double *c)
{
    double values[DEGREE_MAX + 1], power[DEGREE_MAX + 1][DEGREE_MAX + 1] = {{1.0}};
    values_at(p, t, values);
    memset(c, 0, (DEGREE_MAX + 1) * sizeof *c);
    for (uint32_t k = 0; k <= p->degree; k++) {
        const double weight = values[k] * (p->square[p->degree] / p->square[k]);
        for (uint32_t j = 0; j <= k; j++) {
            if (k > 0) {
                power[k][j] = (j > 0 ? power[k - 1][j - 1] : 0.0) -
                              p->centre[k - 1] * power[k - 1][j] -
                              (k > 1 ? p->pull[k - 1] * power[k - 2][j] : 0.0);
            }
            c[j] += weight * power[k][j];
        }
    }
}

/* Divides, and limits the quotient to -FAR..FAR. Never divides by zero. */
static double quotient(double above, double below)
{
    return fabs(above) < FAR * fabs(below) ? above / below
                                           : copysign(FAR, above) * copysign(1.0, below);
}

/* Finds the roots of c0 + c1 z + c2 z^2 in rising order, without cancellation. The roots are real,
 * up to rounding. */
static void quadratic_roots(const double *c, double roots[2])
{
    const double square = fmax(c[1] * c[1] - 4.0 * c[0] * c[2], 0.0);
    const double q = -0.5 * (c[1] + copysign(sqrt(square), c[1]));
    const double a = quotient(q, c[2]), b = quotient(c[0], q);
    roots[0] = fmin(a, b);
    roots[1] = fmax(a, b);
}

/* Computes value and slope of a polynomial. */
static double horner(const double *c, uint32_t degree, double z, double *slope)
{
    double value = c[degree];
    *slope = 0.0;
    for (uint32_t k = degree; k > 0; k--) {
        *slope = *slope * z + value;
        value = value * z + c[k - 1];
    }
    return value;
}

/* Finds the root between two places where the polynomial has different signs: by Newton's steps,
 * or by bisection if such a step leaves the range. If rounding leaves no change of sign, returns
 * the end with the value nearer to 0. */
static double root_between(const double *c, uint32_t degree, double low, double high)
{
    double slope;
    const double first = horner(c, degree, low, &slope), last = horner(c, degree, high, &slope);
    if ((first > 0.0) == (last > 0.0)) {
        return fabs(first) < fabs(last) ? low : high;
    }
    double z = 0.5 * (low + high);
    for (int i = 0; i < 64; i++) {
        const double value = horner(c, degree, z, &slope);
        if ((value > 0.0) == (first > 0.0)) {
            low = z;
        } else {
            high = z;
        }
        const double step = slope != 0.0 ? value / slope : INFINITY;
        const double next = z - step > low && z - step < high ? z - step : 0.5 * (low + high);
        if (fabs(next - z) <= 1e-14 * fmax(fabs(z), 1.0)) {
            return next;
        }
        z = next;
    }
    return z;
}

static double within(double z)
{
    return fmin(fmax(z, -REACH), REACH);
}

/* Computes the derivative of a polynomial that has degree `to`. */
static void derive(const double *c, uint32_t degree, uint32_t to, double *out)
{
    memcpy(out, c, (degree + 1) * sizeof *c);
    for (uint32_t d = degree; d > to; d--) {
        for (uint32_t k = 0; k < d; k++) {
            out[k] = (double)(k + 1) * out[k + 1];
        }
    }
}

/* Finds all roots of a polynomial of degree 2 to 4 that has only real ones: the roots of a
 * polynomial lie between those of its derivative. */
static void roots_find(const double *c, uint32_t degree, double *roots)
{
    double derived[DEGREE_MAX + 1], inner[DEGREE_MAX];
    derive(c, degree, 2, derived);
    quadratic_roots(derived, roots);
    for (uint32_t d = 3; d <= degree; d++) {
        derive(c, degree, d, derived);
        memcpy(inner, roots, (d - 1) * sizeof *roots);
        for (uint32_t i = 0; i < d; i++) {
            roots[i] = root_between(derived, d, i > 0 ? within(inner[i - 1]) : -REACH,
                                    i + 1 < d ? within(inner[i]) : REACH);
        }
    }
}

struct umb__moment_bound umb__moment_bound(const double *means, uint32_t count, double bias,
                                           double t)
{
    struct polynomials p;
    double c[DEGREE_MAX + 1], roots[DEGREE_MAX];
    polynomials_make(means, count, fmax(bias, UMB__MOMENT_BIAS_MIN), &p);
    kernel_make(&p, t, c);
    roots_find(c, p.degree, roots);
    struct umb__moment_bound bound = {0.0, mass_at(&p, t)};
    for (uint32_t i = 0; i < p.degree; i++) {
        bound.before += roots[i] < t ? mass_at(&p, roots[i]) : 0.0;
    }
    bound.before = fmin(bound.before, 1.0);
    bound.at = fmin(bound.at, 1.0 - bound.before);
    return bound;
}
