/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The placement of umbrage/gpu.h: world_to_voxel as whole numbers.
 *
 * The floats of a shader have 24 bits of precision, and its compiler may reorder operations. So the
 * shader converts a position to whole numbers, P = trunc(p 2^s), and computes V = T + sum(A P) in
 * 64 bits; the voxel is V / 2^e. s, e and A are chosen so that |P| and |A| are below 2^30. Each A
 * is off by half at most, each P by one, and by one more if the bias moves the position. With m the
 * row of voxels a metre:
 *
 *     |V / 2^e - v| <= 3/2 2^(30 - e) + 2 (|m0| + |m1| + |m2|) 2^-s + 2^-e
 *
 * The lift of the bias is computed in floats and rounded to 2^-12 voxels.
 */
#include <math.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "query/stages.h"
#include "query/voxel_walk.h"
#include "umbrage/gpu.h"

#define NUMBER_BITS 30 /* Of positions and matrices in whole numbers */
#define SHIFT_LEAST 40 /* The shader takes 8 to 28 bits of the upper half behind the point */
#define SHIFT_MOST  60
#define MARGIN      2.0 /* Positions may be so many times as far from 0 as the frustum's corners */

/* Errors of the shader's floats. The first is relative to the longest lift and the steepest slope:
 * a sum of three products, a quotient and the constants of the bias. The second is that of the
 * rounded lift, in voxels. */
#define FLOAT_ERROR 0x1p-19
#define LIFT_ERROR  0x1p-12

/* The transform from the shader's space to voxels. */
struct transform {
    double rotation[3][3]; /* From the shader's axes to those of the world */
    double world[3];       /* World position of the shader's 0, relative to the asset's origin */
    double rows[4][4];     /* From the shader's space to voxels; the last one gives W */
};

/* Binary exponents: a row's numbers count 2^-shift. */
struct scales {
    int units;    /* s */
    int shift[4]; /* e of each row */
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
    for (unsigned axis = 0; axis < 4; axis++) {
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
            reach = isfinite(p[k]) ? fmax(reach, fabs(p[k])) : INFINITY;
        }
    }
    for (unsigned i = 0; i < 4; i++) {
        reach = isfinite(t->rows[i][3]) ? reach : INFINITY;
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

/* Returns the least binary exponent such that all numbers of a row are below 2^exponent. */
static int size_of(const double row[4])
{
    int exponent;
    (void)frexp(fmax(fabs(row[0]), fmax(fabs(row[1]), fabs(row[2]))), &exponent);
    return exponent;
}

/* Chooses the scale of each row of the transform. x and y share a scale. Under a directional light
 * z has the same one, because all three are voxels. Under other lights x and y are divided by W,
 * and z and W have scales of their own. */
static enum umb_status choose_scales(const struct transform *t,
                                     const struct umb_frustum_info *frustum, bool is_lamp,
                                     struct scales *scales, struct umb_error *error)
{
    int range, size[4];
    const double reach = MARGIN * find_reach(t, frustum);
    if (!isfinite(reach)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "origin: the frustum is too far from it for numbers in doubles: give an "
                        "origin near the casters");
    }
    (void)frexp(reach, &range);
    scales->units = NUMBER_BITS - range;
    for (unsigned i = 0; i < 4; i++) {
        size[i] = size_of(t->rows[i]);
    }
    size[0] = size[1] = size[0] > size[1] ? size[0] : size[1];
    if (!is_lamp) {
        size[0] = size[1] = size[2] = size[0] > size[2] ? size[0] : size[2];
    }
    for (unsigned i = 0; i < 4; i++) {
        const int shift = scales->units + NUMBER_BITS - size[i];
        scales->shift[i] = shift < SHIFT_MOST ? shift : SHIFT_MOST;
    }
    if (scales->shift[2] < SHIFT_LEAST) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "origin: the frustum reaches %g voxels from it, must be at most %g: give "
                        "an origin near the casters",
                        ldexp(1, size[2] + range), ldexp(1, 2 * NUMBER_BITS - SHIFT_LEAST));
    }
    return UMB_OK;
}

/* Sets what shaders compute the bias from. */
static void set_bias(const struct umb_gpu_view *view, const struct umb_frustum_info *frustum,
                     const struct transform *t, bool is_lamp, struct umb_gpu_placement *p)
{
    const double(*step)[3] = frustum->voxel_step;
    const double depth = umb__length(step[2]), across = umb__length(step[0]) + umb__length(step[1]);
    const double voxels = view->bias_mode == UMB_BIAS_VOXELS ? view->bias / 3 : 0;
    const double metres = view->bias_mode == UMB_BIAS_METRES ? view->bias : 0;
    double turned[3][3];
    for (unsigned axis = 0; axis < 3; axis++) {
        turn(t, step[axis], turned[axis]);
    }
    set_vector(turned[0], p->step_x[3], p->step_x);
    if (is_lamp) {
        set_vector(turned[1], voxels * across, p->step_y);
        set_vector(turned[2], umb__dot(frustum->world_to_voxel[3], step[2]), p->step_z);
        p->light[3] = (float)(metres + voxels * depth);
    } else {
        set_vector(turned[1], umb__lift_texel(frustum), p->step_y);
        set_vector(turned[2], depth, p->step_z);
        p->light[3] = (float)(metres + voxels * (across + depth));
    }
    p->info[2] = view->bias_mode == UMB_BIAS_AUTO;
}

/* Sets what only lamps have. */
static void set_lamp(const struct umb_light_info *light, const struct umb__content *content,
                     const struct transform *t, struct umb_gpu_placement *p)
{
    const bool is_one_sided = light->kind == UMB_LIGHT_RECTANGLE || light->kind == UMB_LIGHT_DISC;
    double place[3], turned[3];
    umb__subtract(light->position, content->origin, place);
    umb__subtract(place, t->world, place);
    turn(t, place, turned);
    set_vector(turned, is_one_sided, p->lamp);
    set_vector(t->rows[3], 0, p->axis);
}

/* Returns the bound of a row's error, in its own unit. */
static double error_of(const struct transform *t, const struct scales *scales, unsigned row)
{
    const double *m = t->rows[row];
    const double edge = fabs(m[0]) + fabs(m[1]) + fabs(m[2]);
    return ldexp(1.5, NUMBER_BITS - scales->shift[row]) + ldexp(2 * edge, -scales->units);
}

static void set_precision(const struct transform *t, const struct umb_frustum_info *frustum,
                          const struct scales *scales, bool is_lamp,
                          struct umb_gpu_precision *precision)
{
    const double lift = is_lamp ? 0 : umb__lift_texel(frustum);
    const double most = UMB__LIFT_TEXELS(UMB_TAPS_MAX) * lift,
                 size = ldexp(1, (int)frustum->log2_size);
    /* The move along the normal is at most as long as a window is wide. */
    const double move = (UMB_TAPS_MAX + 1) * FLOAT_ERROR;
    double across = fmax(error_of(t, scales, 0), error_of(t, scales, 1));
    double depth = error_of(t, scales, 2);
    if (is_lamp) {
        /* `far` is W at the far side, from the linear relation of depth and W. The shader's divisor
         * is cut to 31 bits. */
        const double *row = frustum->world_to_voxel[2], *axis = frustum->world_to_voxel[3];
        const double slope = umb__dot(row, axis) / umb__dot(axis, axis);
        const double far = (size - (row[3] - slope * axis[3])) / slope;
        across = (across + size * error_of(t, scales, 3)) / far + ldexp(2 * size, -NUMBER_BITS);
        depth += move * far * umb__lift_texel(frustum);
    }
    precision->across = across + move;
    /* Slopes are at most four times lift, since a steeper surface is moved along its normal. */
    precision->depth = depth + move + (is_lamp ? 0 : LIFT_ERROR) + most * FLOAT_ERROR +
                       2 * 4 * lift * (precision->across + FLOAT_ERROR);
    precision->range_m = ldexp(1, NUMBER_BITS - scales->units);
}

enum umb_status umb_gpu_place(const struct umb_asset *asset, const struct umb_gpu_view *view,
                              struct umb_gpu_placement *placement,
                              struct umb_gpu_precision *precision, struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = view->light, .bias_mode = view->bias_mode, .bias = view->bias};
    struct umb__plan plan;
    struct transform t;
    struct scales scales;
    UMB__TRY(check_view(view, error));
    UMB__TRY(umb__plan_make(asset, &settings, &plan, error));
    const bool is_lamp = plan.light->kind != UMB_LIGHT_DIRECTIONAL;
    if (view->face >= plan.light->frustum_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "face: %u, the light has %u", view->face,
                        plan.light->frustum_count);
    }
    const struct umb_frustum_info *frustum = plan.frustum + view->face;
    make_transform(view, plan.content, frustum, &t);
    UMB__TRY(choose_scales(&t, frustum, is_lamp, &scales, error));
    memset(placement, 0, sizeof *placement);
    memset(precision, 0, sizeof *precision);
    int32_t *const rows[] = {placement->row_x, placement->row_y, placement->row_z,
                             placement->row_w};
    for (unsigned i = 0; i < (is_lamp ? 4U : 3U); i++) {
        set_row(t.rows[i], scales.shift[i], scales.units, rows[i], &placement->low[i]);
    }
    placement->info[0] = scales.shift[2] - 32;
    placement->info[1] = (int32_t)(plan.light->first_frustum + view->face);
    placement->info[3] = is_lamp ? scales.shift[3] - scales.shift[0] : 0;
    placement->step_x[3] = (float)ldexp(1, scales.units);
    double direction[3];
    turn(&t, plan.light->direction, direction);
    set_vector(direction, 0, placement->light);
    set_bias(view, frustum, &t, is_lamp, placement);
    if (is_lamp) {
        set_lamp(plan.light, plan.content, &t, placement);
    }
    set_precision(&t, frustum, &scales, is_lamp, precision);
    return UMB_OK;
}
