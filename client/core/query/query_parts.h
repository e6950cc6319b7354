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
#include "base/vec.h"
#include "format/transmittance.h"
#include "format/view.h"
#include "query/voxel_tree.h"
#include "umbrage/query.h"

/* Inlines a function always, so that the constants in its arguments are known in its body. */
#define UMB__INLINE static inline __attribute__((always_inline))

struct umb__query;
struct umb__kernels;

/* A function that answers the points first .. first + count - 1 as umb_query_run does: a kernel, or
 * a stage around one. */
typedef void umb__kernel(const struct umb__query *query, const struct umb_points *points,
                         size_t first, size_t count, struct umb_answers *answers);
typedef umb__kernel *umb__kernel_fn;

/* Content of struct umb_query. */
struct umb__query {
    /* Functions of the stages, from the outermost one inwards (query.c). */
    umb__kernel *run;                  /* Outermost stage */
    umb__kernel *footprint_inner;      /* Stage inside that of footprints */
    umb__kernel *receiver_mask_inner;  /* Stage inside that of the receiver mask */
    umb__kernel *transmittance_inner;  /* Stage inside that of translucent casters */
    umb__kernel *kernel;               /* Kernel, for points of parallel light, or of one face */
    const uint32_t *grid;              /* Cells of the light's frustum (format/view.h) */
    const struct umb__column *columns; /* Columns of the frustum, one a square of texels */
    const uint32_t *pieces;            /* Pieces of the columns, values like a cell's */
    const uint64_t *nodes;
    const uint64_t (*bricks)[8];
    uint32_t log2_size;    /* n: the frustum has 1 << n voxels a side */
    uint32_t grid_log2;    /* g: its grid has 1 << g cells a side */
    uint32_t column_level; /* c: a column is 1 << c texels wide */
    uint32_t frustum;      /* Number of the frustum in the asset */
    int32_t taps;          /* Width of the window in texels */
    uint32_t total; /* Sum of the weights of a window's texels: the count of an all lit one */
    uint32_t (*total_of)(int32_t taps); /* The same of windows of any width; NULL: taps * taps */
    uint32_t level;                     /* Level at which look-ups stop; 0: at the voxel */
    enum umb_filter filter;
    enum umb_bias_mode bias_mode;
    enum umb_answer_format format;
    double bias_m;      /* Bias of VOXELS and METRES: metres along the normal */
    double lift_texel;  /* Voxels of depth that are as long as a texel of parallel light is wide */
    double no_normal_m; /* Bias for points without a normal: metres towards the light */
    double world_to_voxel[3][4];
    double voxel_step[3][3];
    double direction[3]; /* Direction of the light */
    double origin[3];    /* Origin of the asset */
    /* Penumbras (penumbra.c). */
    double reach[2]; /* Texels on x and y by which the radius of the light's cone grows over one
                        voxel of depth */
    const uint32_t *occluder_depth; /* Occluder depth map; NULL: columns stay shadowed */
    uint32_t occluder_depth_root;   /* Root of the frustum in that map */
    /* Footprints (kernel_footprint.c). */
    double footprint_m;        /* Footprint in metres of points that have none of their own; used if
                                  pixel_rad is 0 */
    double eye[3], pixel_rad;  /* Eye relative to the asset's origin, and the angle of its pixels */
    double texel_m;            /* Mean edge of a texel of parallel light, metres */
    double sample_no_normal_m; /* Bias no_normal_m of a query of one tap */
    const struct umb__kernels *kernels; /* Kernels that read and answer squares */
    /* Spot and point lights (perspective.h). For these the fields about one frustum are not set. */
    const struct umb_frustum_info *faces; /* [face_count] */
    const struct umb__top *tops;          /* [face_count] */
    uint32_t face_count;                  /* Number of faces; 0: a directional light */
    uint32_t first_face;                  /* Number of the first face in the asset */
    double position[3];                /* Position of the light, relative to the asset's origin */
    const struct umb_light_info *lamp; /* The light; NULL: a directional light */
    /* Translucent casters (transmittance_stage.c). */
    const struct umb__trans *trans; /* Transmittance maps; NULL: the stage is left out */
    int32_t transmittance_taps;     /* Width in voxels of the box whose transmittance is averaged */
    int32_t transmittance_bias_taps;  /* Number of taps of a window whose bias moves the points for
                                         that box */
    double transmittance_no_normal_m; /* Bias no_normal_m for that box */
    /* The static rule (receiver_mask_stage.c). */
    const uint64_t *receiver_mask_cells; /* Mask of the frustum; NULL: the stage is left out */
};

_Static_assert(sizeof(struct umb__query) <= sizeof(struct umb_query), "opaque query is too small");

/*
 * Room for rounding beyond the exact bias: 1/64 of it, at least 0.008 voxels. Float positions err
 * by 6e-8 of their distance from the batch's origin. That is 0.004 voxels for 1 km at 65536 voxels
 * a side, where positions should be doubles anyway.
 */
#define UMB__BIAS_SLACK (65.0 / 64.0)

/* Longest lift of the automatic bias in texels, for a window of `taps` texels. It suffices for all
 * surfaces that the light meets at 26 degrees or more (docs/decisions/0002-automatic-bias.md). */
#define UMB__LIFT_TEXELS(taps) (2.0 * (double)(taps)-0.5)

#define UMB__LENGTH2_MAX 1e300 /* Largest squared normal that counts as finite */

/* Window of one point, clipped to the frustum. */
struct umb__window {
    int32_t x0, x1, y0, y1; /* inclusive, inside the frustum; empty if x0 > x1 or y0 > y1 */
    int32_t z;
    uint32_t outside; /* texels cut off: lit */
    bool all_lit;     /* no look-up needed: 1 */
};

/* Returns the edge in voxels that the automatic bias of coarse look-ups uses: two cells. */
static inline double umb__coarse_steps(const struct umb__query *q)
{
    return 2.0 * (double)((uint32_t)1 << q->level);
}

/* Returns the longest lift of the automatic bias in voxels of depth. Coarse look-ups have none,
 * which keeps their bound. */
static inline double umb__longest_lift(const struct umb__query *q)
{
    return q->level > 0 ? 0 : UMB__LIFT_TEXELS(q->taps) * q->lift_texel;
}

/* Reads number `index` of an unaligned array of floats or doubles. */
static inline double umb__scalar_at(const void *array, enum umb_point_format format, size_t index)
{
    if (format == UMB_POINT_F32) {
        float value;
        memcpy(&value, (const uint8_t *)array + index * sizeof value, sizeof value);
        return (double)value;
    }
    double value;
    memcpy(&value, (const uint8_t *)array + index * sizeof value, sizeof value);
    return value;
}

static inline double umb__coordinate(const struct umb_points *points, size_t i, unsigned axis)
{
    return umb__scalar_at(points->positions, points->format, 3 * i + axis);
}

/* Returns the squared length of point i's normal; n becomes the normal, or 0 without one. */
static inline double umb__normal(const struct umb_points *points, size_t i, double n[3])
{
    n[0] = n[1] = n[2] = 0;
    if (!points->normals) {
        return 0;
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        n[axis] = umb__scalar_at(points->normals, UMB_POINT_F32, 3 * i + axis);
    }
    return umb__dot(n, n);
}

/* Returns whether a vector of this squared length counts as a normal. */
static inline bool umb__is_normal(double length2)
{
    return length2 > 0 && length2 <= UMB__LENGTH2_MAX;
}

/* Makes a batch of the points first .. first + count - 1 of another batch. */
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
 * Shift of a look-up in depth, in voxels. The receiver's plane falls by slope[0] and slope[1]
 * voxels of depth for each texel on x and y. The shift counts from the plane's depth at the centre
 * of the point's texel.
 */
struct umb__lift {
    double depth;    /* Towards the light */
    double slope[2]; /* 0: the shift counts from the point's own depth */
};

/*
 * Sets the lift of the automatic bias for a point with normal n, and returns the move along n, in
 * units of n, that it needs beside the lift.
 *
 * The plane of the surface must stay on the far side of the whole window: the centres of its voxels
 * lie within taps/2 voxels of the point in x and y and half a voxel in z, and n.(x ex + y ey + z
 * ez) is linear. So a look-up must move by s >= (taps (|n.ex| + |n.ey|) + |n.ez|) / 2 along n. A
 * lift along the light by s / |n.ez| voxels of depth does the same and displaces no edge of a
 * shadow. If the lift starts from the plane's depth at the centre of the window, taps - 1 suffice
 * in place of taps. A surface that grazes the light would need a long lift. It gets the longest
 * lift allowed, and moves along n for the rest: s n = n * (sum for the unscaled normal) / |n|^2, so
 * no root is taken.
 */
static inline double umb__lift_auto(const struct umb__query *q, const double n[3], double length2,
                                    struct umb__lift *lift)
{
    double along[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        along[axis] = umb__dot(n, q->voxel_step[axis]);
    }
    const double taps = (double)q->taps, follows = q->taps > 1 ? 1 : 0;
    const double across = fabs(along[0]) + fabs(along[1]), depth = fabs(along[2]);
    const double most = umb__longest_lift(q);
    const double need = 0.5 * UMB__BIAS_SLACK * (taps * across + depth);
    const double rest = need - most * depth;
    if (rest > 0) {
        *lift = (struct umb__lift){most, {0, 0}};
        return rest / length2;
    }
    lift->depth = 0.5 * UMB__BIAS_SLACK * ((taps - follows) * across + depth) / depth;
    lift->slope[0] = follows * along[0] / depth;
    lift->slope[1] = follows * along[1] / depth;
    return 0;
}

/* Moves point i off its surface, and sets the lift of its look-up. Returns false if its normal
 * faces away from the light. */
static inline bool umb__move(const struct umb__query *q, const struct umb_points *points, size_t i,
                             double p[3], struct umb__lift *lift)
{
    double n[3];
    const double length2 = umb__normal(points, i, n);
    *lift = (struct umb__lift){0, {0, 0}};
    if (!umb__is_normal(length2)) {
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] -= q->direction[axis] * q->no_normal_m;
        }
        return true;
    }
    if (umb__dot(n, q->direction) >= 0) {
        return false;
    }
    const double scale = q->bias_mode == UMB_BIAS_AUTO ? umb__lift_auto(q, n, length2, lift)
                                                       : q->bias_m / sqrt(length2);
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] += n[axis] * scale;
    }
    return true;
}

/* Returns the shift in depth, in voxels, of the look-up at v. */
static inline double umb__lift_depth(const struct umb__lift *lift, const double v[3])
{
    return lift->slope[0] * (0.5 - (v[0] - floor(v[0]))) +
           lift->slope[1] * (0.5 - (v[1] - floor(v[1]))) - lift->depth;
}

static inline void umb__to_voxel(const struct umb__query *q, const double p[3], double v[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        v[axis] = umb__affine(q->world_to_voxel[axis], p);
    }
}

/* Computes the position of point i in metres, relative to the asset's origin. */
static inline void umb__position(const struct umb__query *q, const struct umb_points *points,
                                 size_t i, double p[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] = points->origin[axis] - q->origin[axis] + umb__coordinate(points, i, axis);
    }
}

/* Computes the voxel-space position at which point i is looked up under a directional light.
 * Returns false if its normal faces away; v is then not set. */
static inline bool umb__voxel_at(const struct umb__query *q, const struct umb_points *points,
                                 size_t i, double v[3])
{
    double p[3];
    struct umb__lift lift;
    umb__position(q, points, i, p);
    if (!umb__move(q, points, i, p, &lift)) {
        return false;
    }
    umb__to_voxel(q, p, v);
    if (points->normals != NULL) {
        v[2] += umb__lift_depth(&lift, v);
    }
    return true;
}

static inline struct umb__tree umb__tree_of(const struct umb__query *q)
{
    return (struct umb__tree){.grid = q->grid,
                              .nodes = q->nodes,
                              .bricks = q->bricks,
                              .log2_size = q->log2_size,
                              .grid_log2 = q->grid_log2};
}

/* Clips one axis of the window; returns the number of texels left. */
static inline int32_t umb__clip(double v, int32_t half, int32_t size, int32_t *low, int32_t *high)
{
    int32_t centre = (int32_t)floor(v);
    *low = centre - half < 0 ? 0 : centre - half;
    *high = centre + half >= size ? size - 1 : centre + half;
    return *high >= *low ? *high - *low + 1 : 0;
}

/* Counts a voxel-space position in stats if it is outside the frustum. */
static inline void umb__count_place(const double v[3], uint32_t log2_size,
                                    struct umb_query_stats *stats)
{
    const double size = (double)((uint32_t)1 << log2_size);
    const bool outside = !(v[0] >= 0 && v[0] < size && v[1] >= 0 && v[1] < size);
    stats->outside += outside;
    stats->before += !outside && !(v[2] >= 0);
    stats->behind += !outside && v[2] >= size;
}

/* Computes the window of a voxel-space position. Counts the point in stats if it is outside. */
static inline struct umb__window umb__window_at(const struct umb__query *q, const double v[3],
                                                struct umb_query_stats *stats)
{
    struct umb__window w = {0};
    int32_t size = (int32_t)1 << q->log2_size, half = q->taps / 2;
    double s = (double)size;
    umb__count_place(v, q->log2_size, stats);
    /* Also true for NaN, which then covers no texel. */
    if (!(v[0] > -32 && v[0] < s + 32 && v[1] > -32 && v[1] < s + 32)) {
        w.all_lit = true;
        return w;
    }
    if (!(v[2] >= 0)) {
        w.all_lit = true;
        return w;
    }
    const bool behind = v[2] >= s;
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
        /* The first point of a byte also clears the bits of the seven points after it. These may
         * lie beyond the batch, so bits of the caller's memory never appear as answers. */
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

/* Returns the weight of the lit texels of a tent around v; texels outside the frustum are lit. In:
 * window: the window of v. */
uint32_t umb__weigh_tent(const struct umb__query *q, const double v[3],
                         const struct umb__window *window, struct umb_query_stats *stats);

/* Kernels of windows: one source (kernel_body.h), compiled for each instruction set. */
umb__kernel umb__kernel_base, umb__kernel_avx2, umb__kernel_avx512, umb__kernel_simd128;
umb__kernel umb__tent_base, umb__tent_avx2, umb__tent_avx512, umb__tent_simd128;

/* Run a batch with a kernel for AVX-512, a short one with a kernel for AVX2. */
umb__kernel umb__run_wide, umb__tent_wide;

/* Kernels of look-ups that stop at a level (kernel_coarse_body.h). */
umb__kernel umb__kernel_coarse, umb__kernel_coarse_avx2, umb__kernel_coarse_simd128;

/* Kernel of penumbras (penumbra.c). */
umb__kernel umb__kernel_penumbra;

#endif
