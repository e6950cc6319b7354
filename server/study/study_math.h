/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_MATH_H
#define UMBRAGE_SERVER_STUDY_STUDY_MATH_H
/*
 * Vectors and statistics for the study, beside base/vec.h. A result may be written over an argument
 * only if the function says so; nothing here can fail.
 */
#include <math.h>
#include <stdlib.h>

#include "base/vec.h"

/* out = a + t b; out may be a or b. */
static inline void umbt_along(const double a[3], double t, const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++) {
        out[k] = a[k] + t * b[k];
    }
}

/* Scales a to unit length and returns its old length. If that is 0 or not finite, a is
 * unchanged. */
static inline double umbt_normalize(double a[3])
{
    const double length = umb__length(a);
    if (length > 0.0 && isfinite(length)) {
        for (int k = 0; k < 3; k++) {
            a[k] /= length;
        }
    }
    return length;
}

/* A vector of floats as doubles. */
static inline void umbt_widen(const float from[3], double to[3])
{
    for (int k = 0; k < 3; k++) {
        to[k] = (double)from[k];
    }
}

/* Computes a triangle's normal by winding, whose length is twice the triangle's area. */
static inline void umbt_triangle_cross(const double corners[3][3], double out[3])
{
    double a[3], b[3];
    umb__subtract(corners[1], corners[0], a);
    umb__subtract(corners[2], corners[0], b);
    umb__cross(a, b, out);
}

/* Order of two doubles, for qsort. */
static inline int umbt_compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/*
 * Sorts times of equal runs and returns their median.
 *
 * In:  count: odd, at least 5.
 * Out: spread: (largest - least) / median. The outermost run on each side is left out, because it
 *      is attributed to the machine.
 */
static inline double umbt_median(double *seconds, size_t count, double *spread)
{
    qsort(seconds, count, sizeof *seconds, umbt_compare_doubles);
    const double middle = seconds[count / 2];
    *spread = middle > 0.0 ? (seconds[count - 2] - seconds[1]) / middle : 0.0;
    return middle;
}

#endif
