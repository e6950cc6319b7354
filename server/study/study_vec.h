/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_VEC_H
#define UMBRAGE_SERVER_STUDY_STUDY_VEC_H
/*
 * Three-component vectors of doubles for the study's cameras and rays. Prefix umbt_ (study).
 * Results may be written over an argument where it says so; nothing here can fail.
 */
#include <math.h>

static inline double umbt_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out must not be a or b. */
static inline void umbt_cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out may be a or b. */
static inline void umbt_subtract(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++) {
        out[k] = a[k] - b[k];
    }
}

/* out = a + t b; out may be a or b. */
static inline void umbt_along(const double a[3], double t, const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++) {
        out[k] = a[k] + t * b[k];
    }
}

static inline double umbt_length(const double a[3])
{
    return sqrt(umbt_dot(a, a));
}

/* Scales a to unit length; returns its old length, and leaves it alone if that is 0 or not finite.
 */
static inline double umbt_normalize(double a[3])
{
    const double length = umbt_length(a);
    if (length > 0.0 && isfinite(length)) {
        for (int k = 0; k < 3; k++) {
            a[k] /= length;
        }
    }
    return length;
}

#endif
