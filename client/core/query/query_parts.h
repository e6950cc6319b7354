/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_QUERY_PARTS_H
#define UMBRAGE_CORE_QUERY_QUERY_PARTS_H
/*
 * A prepared query as the kernels see it, and the steps that all of them share. One source for
 * every kernel: the arithmetic of a point is written once, in double, without contraction, so that
 * all instruction sets give the same bits.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include "format/transmittance.h"
#include "format/view.h"
#include "umbrage/query.h"

struct umb__query;
typedef void (*umb__kernel_fn)(const struct umb__query *query, const struct umb_points *points,
                               size_t first, size_t count, struct umb_answers *answers);

/* Content of struct umb_query. */
struct umb__query {
    umb__kernel_fn run;        /* Outermost stage, which answers a batch (query.c) */
    umb__kernel_fn window_run; /* Outermost stage without footprints */
    umb__kernel_fn opaque_run; /* Outermost stage without footprints and translucent casters */
    umb__kernel_fn kernel;     /* Kernel, for points of parallel light, or of one face */
    const uint32_t *grid;      /* Cells of the light's frustum (format/view.h) */
    const struct umb__column *columns; /* Columns of the frustum, one a square of texels */
    const uint32_t *pieces;            /* Pieces of the columns, values like a cell's */
    const uint64_t *nodes;
    const uint64_t (*bricks)[8];
    uint32_t log2_size;    /* n: voxels a side = 1 << n */
    uint32_t grid_log2;    /* g */
    uint32_t column_level; /* c */
    uint32_t frustum;
    int32_t taps;   /* window width */
    uint32_t level; /* Level at which look-ups stop; 0: at the voxel */
    enum umb_filter filter;
    enum umb_bias_mode bias_mode;
    enum umb_answer_format format;
    double bias_m;      /* Bias of VOXELS and METRES: metres along the normal */
    double no_normal_m; /* Bias for points without a normal: metres towards the light */
    double world_to_voxel[3][4];
    double voxel_step[3][3];
    double direction[3]; /* the light's */
    double origin[3];    /* the asset's */
    /* Penumbras (penumbra.h). */
    double reach[2]; /* texels on x and y that half of the light's cone gains over one
                                    voxel of depth */
    const uint32_t *occluder_depth; /* NULL: open, columns stay shadowed */
    uint32_t occluder_depth_root;   /* of the frustum */
    /* Footprints (footprint.h). */
    double footprint_m;        /* Footprint of points without one of their own, where pixel_rad is
                                    0 */
    double eye[3], pixel_rad;  /* relative to the asset's origin */
    double texel_m;            /* mean edge of a texel; of parallel light */
    double sample_no_normal_m; /* no_normal_m of one tap */
    /* Spot and point lights (perspective.h); the fields about one frustum are then not set. */
    const struct umb_frustum_info *faces; /* [face_count] */
    const struct umb__top *tops;          /* [face_count] */
    uint32_t face_count;                  /* 0: a directional light */
    uint32_t first_face;                  /* its number in the asset */
    double position[3];                   /* of the light, relative to the asset's origin */
    /* Translucent casters (transmittance_stage.h). */
    const struct umb__trans *trans;   /* NULL: none, and the stage is left out */
    int32_t transmittance_taps;       /* Width in voxels of the box over which transmittance is
                                             averaged */
    int32_t transmittance_bias_taps;  /* Number of taps whose bias moves points for it */
    double transmittance_no_normal_m; /* The same bias for points without a normal, metres */
    /* The static rule (receiver_mask_stage.h). */
    const uint64_t *receiver_mask_cells; /* of the frustum; NULL: off, the stage is left out */
    umb__kernel_fn receiver_mask_inner;  /* what answers */
};

_Static_assert(sizeof(struct umb__query) <= sizeof(struct umb_query), "opaque query is too small");

/*
 * Room for rounding beyond the exact bias: 1/64 of it, at least 0.008 voxels. Float positions err
 * by 6e-8 of their distance from the batch's origin. That is 0.004 voxels for 1 km at 65536 voxels
 * a side, where positions should be doubles anyway.
 */
#define UMB__BIAS_SLACK (65.0 / 64.0)

/* Greatest distance in texels of a searched column from the receiver: a power of two. */
#define UMB__PENUMBRA_REACH_MAX ((UMB_PENUMBRA_TAPS_MAX + 1) / 2)

/* Width of the box with the area of a disc of radius 1: sqrt(pi). */
#define UMB__PENUMBRA_BOX 1.7724538509055161

#define UMB__LENGTH2_MAX 1e300 /* Largest squared normal that counts as finite */

/* Window of one point, clipped to the frustum. */
struct umb__window {
    int32_t x0, x1, y0, y1; /* inclusive, inside the frustum; empty if x0 > x1 or y0 > y1 */
    int32_t z;
    uint32_t outside; /* texels cut off: lit */
    bool all_lit;     /* no look-up needed: 1 */
};

/* Edges in voxels that the automatic bias of coarse look-ups uses: those of two cells. */
static inline double umb__coarse_steps(const struct umb__query *q)
{
    return 2.0 * (double)((uint32_t)1 << q->level);
}

static inline double umb__coordinate(const struct umb_points *points, size_t i, unsigned axis)
{
    if (points->format == UMB_POINT_F32) {
        float value;
        memcpy(&value, (const uint8_t *)points->positions + (3 * i + axis) * sizeof value,
               sizeof value);
        return (double)value;
    }
    double value;
    memcpy(&value, (const uint8_t *)points->positions + (3 * i + axis) * sizeof value,
           sizeof value);
    return value;
}

/* Makes a batch of the points first .. first + count - 1 of another. */
static inline struct umb_points umb__some_points(const struct umb_points *points, size_t first,
                                                 size_t count)
{
    const size_t scalar = points->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double);
    struct umb_points some = *points;
    some.positions = (const uint8_t *)points->positions + 3 * first * scalar;
    some.normals = points->normals ? (const uint8_t *)points->normals + 12 * first : NULL;
    some.footprints = points->footprints ? (const uint8_t *)points->footprints + 4 * first : NULL;
    some.count = count;
    return some;
}

/*
 * Moves point i off its surface. Returns false if its normal faces away from the light.
 *
 * With unit normal n the plane of the surface stays on the far side of the whole window if the
 * point moves by s >= (taps (|n.ex| + |n.ey|) + |n.ez|) / 2 along n: the window's voxel centres lie
 * within taps/2 voxels of the point in x and y and half a voxel in z, and n.(x ex + y ey + z ez) is
 * linear. s n = n * (unnormalised sum) / |n|^2, so no root is taken.
 */
static inline bool umb__move(const struct umb__query *q, const struct umb_points *points, size_t i,
                             double p[3])
{
    double n[3] = {0, 0, 0}, length2 = 0;
    if (points->normals) {
        float raw[3];
        memcpy(raw, (const uint8_t *)points->normals + 12 * i, sizeof raw);
        for (unsigned axis = 0; axis < 3; axis++) {
            n[axis] = (double)raw[axis];
        }
        length2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    }
    if (!(length2 > 0) || !(length2 <= UMB__LENGTH2_MAX)) {
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] -= q->direction[axis] * q->no_normal_m;
        }
        return true;
    }
    double facing = n[0] * q->direction[0] + n[1] * q->direction[1] + n[2] * q->direction[2];
    if (facing >= 0) {
        return false;
    }
    double scale;
    if (q->bias_mode == UMB_BIAS_AUTO) {
        double sum[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            const double *step = q->voxel_step[axis];
            sum[axis] = fabs(n[0] * step[0] + n[1] * step[1] + n[2] * step[2]);
        }
        scale = 0.5 * UMB__BIAS_SLACK * ((double)q->taps * (sum[0] + sum[1]) + sum[2]) / length2;
    } else {
        scale = q->bias_m / sqrt(length2);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] += n[axis] * scale;
    }
    return true;
}

static inline void umb__to_voxel(const struct umb__query *q, const double p[3], double v[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *m = q->world_to_voxel[axis];
        v[axis] = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
    }
}

/* Clips one axis of the window; returns the number of texels left. */
static inline int32_t umb__clip(double v, int32_t half, int32_t size, int32_t *low, int32_t *high)
{
    int32_t centre = (int32_t)floor(v);
    *low = centre - half < 0 ? 0 : centre - half;
    *high = centre + half >= size ? size - 1 : centre + half;
    return *high >= *low ? *high - *low + 1 : 0;
}

/* Turns a voxel-space position into the window to look up; counts what is outside. */
static inline struct umb__window umb__window_at(const struct umb__query *q, const double v[3],
                                                struct umb_query_stats *stats)
{
    struct umb__window w = {0};
    int32_t size = (int32_t)1 << q->log2_size, half = q->taps / 2;
    double s = (double)size;
    bool outside = !(v[0] >= 0 && v[0] < s && v[1] >= 0 && v[1] < s);
    stats->outside += outside;
    /* Also true for NaN, which then covers no texel. */
    if (!(v[0] > -32 && v[0] < s + 32 && v[1] > -32 && v[1] < s + 32)) {
        w.all_lit = true;
        return w;
    }
    if (!(v[2] >= 0)) {
        stats->before += !outside;
        w.all_lit = true;
        return w;
    }
    bool behind = v[2] >= s;
    stats->behind += behind && !outside;
    w.z = behind ? size - 1 : (int32_t)v[2];
    int32_t width = umb__clip(v[0], half, size, &w.x0, &w.x1);
    int32_t height = umb__clip(v[1], half, size, &w.y0, &w.y1);
    w.outside = (uint32_t)(q->taps * q->taps - width * height);
    w.all_lit = width * height == 0;
    return w;
}

static inline void umb__store_answer(void *values, enum umb_answer_format format, size_t i,
                                     uint32_t lit, uint32_t total)
{
    switch (format) {
    case UMB_ANSWER_F32: {
        float value = (float)lit / (float)total;
        memcpy((uint8_t *)values + i * sizeof value, &value, sizeof value);
        break;
    }
    case UMB_ANSWER_U8:
        ((uint8_t *)values)[i] = (uint8_t)((2 * 255 * lit + total) / (2 * total));
        break;
    case UMB_ANSWER_BIT: {
        /* The first point of a byte also clears the seven bits behind it, which may be beyond the
         * batch: old bits of the caller's memory are never answered. */
        uint8_t *byte = (uint8_t *)values + i / 8;
        unsigned before = *byte & ((1U << (i % 8)) - 1U);
        *byte = (uint8_t)(before | (unsigned)(lit * 2 >= total) << (i % 8));
        break;
    }
    }
}

/* Returns the lit texels of a window, clipped to the frustum. */
uint32_t umb__count_window(const struct umb__query *q, const struct umb__window *window,
                           struct umb_query_stats *stats);

/* The kernels: one source (kernel_body.h), compiled for each instruction set. */
void umb__kernel_base(const struct umb__query *query, const struct umb_points *points, size_t first,
                      size_t count, struct umb_answers *answers);
void umb__kernel_avx2(const struct umb__query *query, const struct umb_points *points, size_t first,
                      size_t count, struct umb_answers *answers);
void umb__kernel_avx512(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers);
/* Runs a batch with umb__kernel_avx512, a short one with umb__kernel_avx2 (wide_run.c). */
void umb__run_wide(const struct umb__query *query, const struct umb_points *points, size_t first,
                   size_t count, struct umb_answers *answers);

/* The kernel of the tent filter (kernel_tent.c). It counts in integers, so one serves all
 * machines. */
void umb__kernel_tent(const struct umb__query *query, const struct umb_points *points, size_t first,
                      size_t count, struct umb_answers *answers);

/* The kernel of penumbras (penumbra.h). */
void umb__kernel_penumbra(const struct umb__query *query, const struct umb_points *points,
                          size_t first, size_t count, struct umb_answers *answers);

/* The kernel of look-ups that stop at a level (kernel_coarse_body.h). */
void umb__kernel_coarse(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers);
void umb__kernel_coarse_avx2(const struct umb__query *query, const struct umb_points *points,
                             size_t first, size_t count, struct umb_answers *answers);

#endif
