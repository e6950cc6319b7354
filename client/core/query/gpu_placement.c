/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The placement of umbrage/gpu.h: world_to_voxel as whole numbers.
 *
 * A shader has floats of 24 bits, and its compiler may reorder them. So it takes a position to
 * whole numbers, P = trunc(p 2^s), and computes V = T + sum(A P) in 64 bits; the voxel is V / 2^e.
 * s, e and A are chosen so that |P| and |A| are below 2^30. Each A is off by half at most, each P
 * by one, and by one more if the bias moves the position. With m the row of voxels a metre:
 *
 *     |V / 2^e - v| <= 3/2 2^(30 - e) + 2 (|m0| + |m1| + |m2|) 2^-s + 2^-e
 *
 * The lift of the bias is computed in floats and rounded to 2^-12 voxels.
 */
#include <math.h>
#include <string.h>

#include "base/reserved.h"
#include "query/stages.h"
#include "query/voxel_walk.h"
#include "umbrage/gpu.h"

#define NUMBER_BITS 30 /* Of positions and matrices in whole numbers */
#define SHIFT_LEAST 40 /* The shader takes 8 to 28 bits of the upper half behind the point */
#define SHIFT_MOST  60
#define MARGIN      2.0 /* Positions may be so many times as far from 0 as the frustum's corners */

/* Errors of floats, relative to the longest lift and the steepest slope (2^-19: a sum of three
 * products, a quotient and the constants of the bias), and of the move along the normal. */
#define FLOAT_ERROR 0x1p-19
#define LIFT_ERROR  0x1p-12

/* The transform from the shader's space to voxels. */
struct transform {
    double rotation[3][3]; /* From the shader's axes to those of the world */
    double world[3];       /* World position of the shader's 0, relative to the asset's origin */
    double rows[3][4];     /* From the shader's space to voxels */
};

static enum umb_status check_view(const struct umb_gpu_view *view, struct umb_error *error)
{
    static const char *const names[] = {"origin", "to_world"};
    const double *numbers[] = {view->origin, view->to_world};
    const size_t counts[] = {3, 16};
    if (UMB__UNKNOWN(view, "view", error)) {
        return UMB_E_ARGUMENT;
    }
    for (size_t i = 0; i < 2; i++) {
        for (size_t k = 0; k < counts[i]; k++) {
            if (!isfinite(numbers[i][k])) {
                return umb_fail(error, UMB_E_ARGUMENT, "%s[%zu]: %g, must be finite", names[i], k,
                                numbers[i][k]);
            }
        }
    }
    for (size_t i = 0; view->has_to_world && i < 9; i++) {
        const double *a = view->to_world + 4 * (i / 3), *b = view->to_world + 4 * (i % 3);
        const double dot = umb__dot(a, b), wanted = i / 3 == i % 3 ? 1 : 0;
        if (!(fabs(dot - wanted) < 1e-4)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "to_world: columns %zu and %zu have the dot product %g, must be %g: "
                            "give a rotation and a move without a scale",
                            i / 3, i % 3, dot, wanted);
        }
    }
    return UMB_OK;
}

static void make_transform(const struct umb_gpu_view *view, const struct umb__content *content,
                           const struct umb_frustum_info *frustum, struct transform *t)
{
    for (unsigned k = 0; k < 3; k++) {
        for (unsigned i = 0; i < 3; i++) {
            t->rotation[i][k] = view->has_to_world ? view->to_world[4 * k + i] : i == k;
        }
        t->world[k] =
            (view->has_to_world ? view->to_world[12 + k] : view->origin[k]) - content->origin[k];
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *row = frustum->world_to_voxel[axis];
        for (unsigned k = 0; k < 3; k++) {
            t->rows[axis][k] = row[0] * t->rotation[0][k] + row[1] * t->rotation[1][k] +
                               row[2] * t->rotation[2][k];
        }
        t->rows[axis][3] = umb__affine(row, t->world);
    }
}

/* Takes a vector of the world to the shader's axes. */
static void turn(const struct transform *t, const double world[3], double out[3])
{
    for (unsigned k = 0; k < 3; k++) {
        out[k] = world[0] * t->rotation[0][k] + world[1] * t->rotation[1][k] +
                 world[2] * t->rotation[2][k];
    }
}

/* Returns the greatest coordinate of the frustum's corners in the shader's space. */
static double find_reach(const struct transform *t, const struct umb_frustum_info *frustum)
{
    double reach = 0;
    for (unsigned corner = 0; corner < 8; corner++) {
        double voxel[3], world[3], p[3];
        for (unsigned k = 0; k < 3; k++) {
            voxel[k] = corner >> k & 1 ? (double)(1U << frustum->log2_size) : 0;
        }
        umb__voxel_to_world(frustum, voxel, world);
        umb__subtract(world, t->world, world);
        turn(t, world, p);
        for (unsigned k = 0; k < 3; k++) {
            reach = fmax(reach, fabs(p[k]));
        }
    }
    return reach;
}

/* Sets a row of whole numbers. In: shift: e; units: s. */
static void set_row(const double row[4], int shift, int units, int32_t out[4], uint32_t *low)
{
    for (unsigned k = 0; k < 3; k++) {
        out[k] = (int32_t)llrint(ldexp(row[k], shift - units));
    }
    const int64_t begin = (int64_t)llrint(ldexp(row[3], shift));
    *low = (uint32_t)((uint64_t)begin & UINT32_MAX);
    out[3] = (int32_t)(begin >> 32);
}

static void set_vector(const double vector[3], double fourth, float out[4])
{
    for (unsigned k = 0; k < 3; k++) {
        out[k] = (float)vector[k];
    }
    out[3] = (float)fourth;
}

/* Sets the part of the bias. */
static void set_bias(const struct umb_gpu_view *view, const struct umb_light_info *light,
                     const struct umb_frustum_info *frustum, const struct transform *t,
                     struct umb_gpu_placement *p)
{
    const double(*step)[3] = frustum->voxel_step;
    double turned[4][3], bias = 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        turn(t, step[axis], turned[axis]);
    }
    turn(t, light->direction, turned[3]);
    if (view->bias_mode == UMB_BIAS_METRES) {
        bias = view->bias;
    } else if (view->bias_mode == UMB_BIAS_VOXELS) {
        bias =
            view->bias * (umb__length(step[0]) + umb__length(step[1]) + umb__length(step[2])) / 3.0;
    }
    set_vector(turned[0], p->step_x[3], p->step_x);
    set_vector(turned[1], umb__lift_texel(frustum), p->step_y);
    set_vector(turned[2], umb__length(step[2]), p->step_z);
    set_vector(turned[3], bias, p->light);
    p->info[2] = view->bias_mode == UMB_BIAS_AUTO;
}

static void set_precision(const struct transform *t, const struct umb_frustum_info *frustum,
                          int shift, int units, struct umb_gpu_precision *precision)
{
    const double lift = umb__lift_texel(frustum), most = UMB__LIFT_TEXELS(UMB_TAPS_MAX) * lift;
    double bound = 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *m = t->rows[axis];
        const double edge = fabs(m[0]) + fabs(m[1]) + fabs(m[2]);
        bound = fmax(bound, ldexp(1.5, NUMBER_BITS - shift) + ldexp(2 * edge, -units));
    }
    /* The move along the normal is at most as long as a window is wide. */
    precision->across = bound + (UMB_TAPS_MAX + 1) * FLOAT_ERROR;
    /* Slopes are at most four times lift, since a steeper surface is moved along its normal. */
    precision->depth = precision->across + LIFT_ERROR + most * FLOAT_ERROR +
                       2 * 4 * lift * (precision->across + FLOAT_ERROR);
    precision->range_m = ldexp(1, NUMBER_BITS - units);
}

enum umb_status umb_gpu_place(const struct umb_asset *asset, const struct umb_gpu_view *view,
                              struct umb_gpu_placement *placement,
                              struct umb_gpu_precision *precision, struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = view->light, .bias_mode = view->bias_mode, .bias = view->bias};
    struct umb__plan plan;
    struct transform t;
    enum umb_status status = check_view(view, error);
    status = status == UMB_OK ? umb__plan_make(asset, &settings, &plan, error) : status;
    if (status != UMB_OK) {
        return status;
    }
    if (plan.light->kind != UMB_LIGHT_DIRECTIONAL) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "light: %u is not directional; the shaders place points of directional "
                        "lights",
                        view->light);
    }
    make_transform(view, plan.content, plan.frustum, &t);
    double largest = 0;
    for (unsigned i = 0; i < 9; i++) {
        largest = fmax(largest, fabs(t.rows[i / 3][i % 3]));
    }
    int range_log2, size_log2;
    (void)frexp(MARGIN * find_reach(&t, plan.frustum), &range_log2);
    (void)frexp(largest, &size_log2);
    const int units = NUMBER_BITS - range_log2;
    int shift = units + NUMBER_BITS - size_log2;
    shift = shift < SHIFT_MOST ? shift : SHIFT_MOST;
    if (shift < SHIFT_LEAST) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "origin: the frustum reaches %g voxels from it, must be at most %g: give "
                        "an origin near the casters",
                        ldexp(largest, range_log2), ldexp(1, 2 * NUMBER_BITS - SHIFT_LEAST));
    }
    memset(placement, 0, sizeof *placement);
    memset(precision, 0, sizeof *precision);
    set_row(t.rows[0], shift, units, placement->row_x, &placement->low[0]);
    set_row(t.rows[1], shift, units, placement->row_y, &placement->low[1]);
    set_row(t.rows[2], shift, units, placement->row_z, &placement->low[2]);
    placement->info[0] = shift - 32;
    placement->info[1] = (int32_t)plan.light->first_frustum;
    placement->step_x[3] = (float)ldexp(1, units);
    set_bias(view, plan.light, plan.frustum, &t, placement);
    set_precision(&t, plan.frustum, shift, units, precision);
    return UMB_OK;
}
