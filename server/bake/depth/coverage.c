/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Preparing a triangle for the predicate: canonical order, edge slopes, depth gradients.
 *
 * Invariant: everything but `odd` is a function of the set of corners, not of their order. Scan
 * conversion goes by rows of sample centres. Depth is computed from an anchor, because incremental
 * depth differed between tilings, and clamped, because slopes of grazing triangles reach 1e6 (both
 * measured).
 */
#include "bake/depth/coverage.h"

#include <math.h>

/* 1 if corner a comes after corner b in canonical order. */
static int comes_after(const double a[3], const double b[3])
{
    if (a[1] != b[1]) {
        return a[1] > b[1];
    }
    if (a[0] != b[0]) {
        return a[0] > b[0];
    }
    return a[2] > b[2];
}

static double edge_slope(const double a[3], const double b[3])
{
    return a[1] < b[1] ? (b[0] - a[0]) / (b[1] - a[1]) : 0.0;
}

static double clamp(double value, double low, double high)
{
    value = value > low ? value : low;
    return value < high ? value : high;
}

/* Smallest integer n with n + 0.5 >= value. */
static int32_t first_centre(double value)
{
    return (int32_t)ceil(value - 0.5);
}

int umbb_coverage_prepare(const double corners[3][3], int32_t size, struct umbb_coverage *coverage)
{
    const double *v[3] = {corners[0], corners[1], corners[2]};
    int odd = 0; /* 1 if sorting reversed the winding */
    for (int pass = 0; pass < 3; pass++) {
        const int i = pass == 1 ? 1 : 0;
        if (comes_after(v[i], v[i + 1])) {
            const double *swap = v[i];
            v[i] = v[i + 1];
            v[i + 1] = swap;
            odd = !odd;
        }
    }
    coverage->row_first = first_centre(v[0][1]);
    coverage->row_last = first_centre(v[2][1]) - 1;
    if (coverage->row_first > coverage->row_last) {
        return 0;
    }
    const double ux = v[1][0] - v[0][0], uy = v[1][1] - v[0][1], uz = v[1][2] - v[0][2];
    const double wx = v[2][0] - v[0][0], wy = v[2][1] - v[0][1], wz = v[2][2] - v[0][2];
    const double area = ux * wy - uy * wx; /* twice the signed projected area */
    if (v[0][0] == v[1][0] && v[1][0] == v[2][0]) {
        return 0; /* a wall along the light and across the rows: all its crossings are equal */
    }
    coverage->odd = odd;
    coverage->facing = (area < 0.0) != odd;
    double gx = 0.0, gy = 0.0;
    if (area != 0.0) {
        gx = (uz * wy - uy * wz) / area;
        gy = (ux * wz - uz * wx) / area;
    }
    if (!isfinite(gx) || !isfinite(gy)) { /* a sliver beyond doubles: uses its anchor's depth */
        gx = 0.0;
        gy = 0.0;
    }
    for (int i = 0; i < 3; i++) {
        coverage->x[i] = v[i][0];
        coverage->y[i] = v[i][1];
    }
    coverage->slope[0] = edge_slope(v[0], v[1]);
    coverage->slope[1] = edge_slope(v[1], v[2]);
    coverage->slope[2] = edge_slope(v[0], v[2]);
    coverage->anchor_z = v[0][2];
    coverage->gradient_x = gx;
    coverage->gradient_y = gy;
    coverage->z_min = clamp(fmin(fmin(v[0][2], v[1][2]), v[2][2]), 0.0, size);
    coverage->z_max = clamp(fmax(fmax(v[0][2], v[1][2]), v[2][2]), 0.0, size);
    return 1;
}
