/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_LAMP_BIAS_H
#define UMBRAGE_CORE_QUERY_LAMP_BIAS_H
/*
 * Moves of points off their surface under spot and point lights. What is the same for all points
 * of a plane in one face is computed first, the rest for each point: alone (perspective.c) or in
 * lanes (kernel_lamp_squares.h), with the same bits.
 */
#include "query/query_parts.h"

#define UMB__FAR_VOXELS 1e9 /* A place beyond every frustum, and far from the limits of int32_t */

/* Returns row i of the face's transform at p: X, Y, Z or W. */
static inline double umb__face_row(const struct umb_frustum_info *face, unsigned i,
                                   const double p[3])
{
    return umb__affine(face->world_to_voxel[i], p);
}

/* Returns the face along whose axis p is farthest; 0 if p lies behind the light for all faces. Out:
 * w: the distance along that axis. */
static inline uint32_t umb__face_of(const struct umb__query *q, const double p[3], double *w)
{
    uint32_t best = 0;
    *w = umb__face_row(&q->faces[0], 3, p);
    for (uint32_t i = 1; i < q->face_count; i++) {
        const double other = umb__face_row(&q->faces[i], 3, p);
        if (other > *w) {
            *w = other;
            best = i;
        }
    }
    return best;
}

/* Returns v within -limit..limit. NaN becomes -limit. */
static inline double umb__within(double v, double limit)
{
    return v > -limit ? (v < limit ? v : limit) : -limit;
}

/* Returns the sum of the edges of a face's texels where W = 1. */
static inline double umb__texel_edges(const struct umb_frustum_info *face)
{
    return umb__length(face->voxel_step[0]) + umb__length(face->voxel_step[1]);
}

/* Ways to find the length of a move. */
enum umb__lamp_move {
    UMB__MOVE_NORMAL,   /* Automatic, along the normal */
    UMB__MOVE_TO_LIGHT, /* Automatic, of points without a normal */
    UMB__MOVE_EDGES,    /* A number of voxels */
    UMB__MOVE_METRES    /* A given length */
};

struct umb__lamp_bias {
    enum umb__lamp_move move;
    double metres;    /* METRES, and number of voxels for EDGES */
    double width;     /* NORMAL: depth that the window gains across the normal, where W = 1 */
    double rest;      /* NORMAL: 1 less the growth of the window with the move; at least 1/4 */
    double thickness; /* NORMAL: of a slice or cell, in W */
    double to_light;  /* TO_LIGHT: length of the move where the distance is W */
    double edges;     /* EDGES: umb__texel_edges */
    double depth;     /* EDGES: depth of a voxel, metres */
};

/* In: normal: unit normal; NULL: points without one. */
UMB__INLINE void umb__lamp_bias_make(const struct umb__query *q,
                                     const struct umb_frustum_info *face, const double *normal,
                                     struct umb__lamp_bias *b)
{
    const double *axis = face->world_to_voxel[3];
    /* A coarse look-up needs two cells, as under parallel light (query.c). */
    const double steps = q->level > 0 ? umb__coarse_steps(q) : 1, taps = (double)q->taps * steps;
    *b = (struct umb__lamp_bias){.move = UMB__MOVE_METRES};
    switch (q->bias_mode) {
    case UMB_BIAS_AUTO:
        b->thickness = umb__dot(axis, face->voxel_step[2]) * steps;
        if (normal == NULL) {
            /* (2 taps + 1) / (2 sqrt(3)) voxels of depth, as for parallel light. */
            b->move = UMB__MOVE_TO_LIGHT;
            b->to_light =
                UMB__BIAS_SLACK * (2.0 * q->taps + 1.0) / (2.0 * sqrt(3.0)) * b->thickness;
        } else {
            const double across = fabs(umb__dot(normal, face->voxel_step[0])) +
                                  fabs(umb__dot(normal, face->voxel_step[1]));
            const double growth = 0.5 * taps * across * umb__dot(normal, axis);
            const double rest = growth > 0 ? 1.0 - growth : 1.0;
            b->move = UMB__MOVE_NORMAL;
            b->width = taps * across;
            b->rest = rest > 0.25 ? rest : 0.25;
        }
        break;
    case UMB_BIAS_VOXELS:
        b->move = UMB__MOVE_EDGES;
        b->metres = q->bias_m;
        b->edges = umb__texel_edges(face);
        b->depth = umb__length(face->voxel_step[2]);
        break;
    case UMB_BIAS_METRES:
        b->metres = q->bias_m;
        break;
    case UMB_BIAS_NONE:
        break;
    }
}

/*
 * Returns the length in metres of a move along the unit normal n after which the plane of the
 * surface is behind the whole window.
 *
 * In the moved point's slice of depth, which is a plane across the axis, a voxel is exactly W times
 * step[0] or step[1] wide. Along the ray it is (p - position) / W times the slice's thickness, and
 * over all texels of the window the ray leans by half the window's width. The move by s changes W
 * by s times the part of n along the axis: hence the division.
 *
 * In: along: length along n from the light to the point, of either sign. w: W there.
 */
UMB__INLINE double umb__bias_undivided(const struct umb__lamp_bias *b, double along, double w)
{
    return 0.5 * UMB__BIAS_SLACK *
           (b->width * w + (fabs(along) / w + 0.5 * b->width) * b->thickness);
}

UMB__INLINE double umb__bias_along_normal(const struct umb__lamp_bias *b, double along, double w)
{
    return umb__bias_undivided(b, along, w) / b->rest;
}

UMB__INLINE double umb__bias_to_light(const struct umb__lamp_bias *b, double distance, double w)
{
    return b->to_light * distance / w;
}

UMB__INLINE double umb__bias_of_edges(const struct umb__lamp_bias *b, double w)
{
    return b->metres * ((w * b->edges + b->depth) / 3.0);
}

/* In: along: as above. distance: to the light. */
static inline double umb__lamp_bias_at(const struct umb__lamp_bias *b, double along,
                                       double distance, double w)
{
    switch (b->move) {
    case UMB__MOVE_NORMAL:
        return umb__bias_along_normal(b, along, w);
    case UMB__MOVE_TO_LIGHT:
        return umb__bias_to_light(b, distance, w);
    case UMB__MOVE_EDGES:
        return umb__bias_of_edges(b, w);
    case UMB__MOVE_METRES:
        break;
    }
    return b->metres;
}

#endif
