/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_VEC_H
#define UMBRAGE_SERVER_STUDY_STUDY_VEC_H
/*
 * Vector functions for cameras and rays that base/vec.h lacks. Prefix umbt_ (study). A result may
 * be written over an argument only if the function says so; nothing here can fail.
 */
#include <math.h>

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

#endif
