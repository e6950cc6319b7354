/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_VEC_H
#define UMBRAGE_CORE_BASE_VEC_H
/* Three-component vectors of doubles. Nothing here can fail. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

static inline bool umb__all_finite(const double *values, size_t count)
{
    bool finite = true;
    for (size_t i = 0; i < count; i++) {
        finite = finite && isfinite(values[i]);
    }
    return finite;
}

static inline double umb__dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Returns row . p + row[3]: one row of an affine transform. */
static inline double umb__affine(const double row[4], const double p[3])
{
    return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
}

/* Computes a x b. In: out: not a or b. */
static inline void umb__cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Computes a - b. In: out: may be a or b. */
static inline void umb__subtract(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++) {
        out[k] = a[k] - b[k];
    }
}

/* Computes a triangle's normal by its winding, whose length is twice the triangle's area. */
static inline void umb__triangle_cross(const double corners[3][3], double out[3])
{
    double a[3], b[3];
    umb__subtract(corners[1], corners[0], a);
    umb__subtract(corners[2], corners[0], b);
    umb__cross(a, b, out);
}

static inline double umb__length(const double a[3])
{
    return sqrt(umb__dot(a, a));
}

static inline void umb__scale(double s, double a[3])
{
    for (int k = 0; k < 3; k++) {
        a[k] *= s;
    }
}

/* Scales a vector to unit length. A vector without direction is unchanged; then returns 0. */
static inline int umb__unit(double a[3])
{
    const double length = umb__length(a);
    if (!(length > 0.0 && isfinite(length))) {
        return 0;
    }
    umb__scale(1.0 / length, a);
    return 1;
}

/* Finds two unit vectors u and v, perpendicular to the unit vector `w` and to each other. u is also
 * perpendicular to the world axis along which w is shortest. */
static inline void umb__across(const double w[3], double u[3], double v[3])
{
    double helper[3] = {0.0, 0.0, 0.0};
    int least = 0;
    for (int i = 1; i < 3; i++) {
        least = fabs(w[i]) < fabs(w[least]) ? i : least;
    }
    helper[least] = 1.0;
    umb__cross(helper, w, u);
    (void)umb__unit(u); /* The length of u is at least sqrt(2/3) */
    umb__cross(w, u, v);
}

#endif
