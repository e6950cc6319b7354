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
#include "umbrage/query.h"

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

/* Points of a query: double[3 * count] in world space, and float[3 * count] or NULL. */
static inline struct umb_points umbt_points_at(const double *positions, const float *normals,
                                               size_t count)
{
    return (struct umb_points){
        .positions = positions, .format = UMB_POINT_F64, .normals = normals, .count = count};
}

/* Order of two doubles, for qsort. */
static inline int umbt_compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

#define UMBT_SPREAD_STEADY 0.03 /* a time with a larger spread is measured again */
#define UMBT_SPREAD_MAX    0.15 /* a time with a larger spread is marked as unsteady */
#define UMBT_LEAST_RUNS    3    /* runs that decide the spread */

/*
 * Time of a computation: the least of several runs. Interrupts, a neighbour on the core and cold
 * caches only add to the CPU time of equal work, so the least run is the nearest to the truth.
 */
struct umbt_time {
    double ns;
    double spread; /* (third least - least) / least: how well the least is confirmed */
};

/* Sorts times of equal runs and returns their least. In: count: at least UMBT_LEAST_RUNS. */
static inline struct umbt_time umbt_least(double *ns, size_t count)
{
    qsort(ns, count, sizeof *ns, umbt_compare_doubles);
    const double spread = ns[0] > 0.0 ? (ns[UMBT_LEAST_RUNS - 1] - ns[0]) / ns[0] : 0.0;
    return (struct umbt_time){ns[0], spread};
}

#endif
