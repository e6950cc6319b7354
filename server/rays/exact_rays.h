/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_EXACT_RAYS_H
#define UMBRAGE_SERVER_RAYS_EXACT_RAYS_H
/*
 * Ray tracing in doubles, for verify.h where floats are too coarse.
 *
 * Embree's hierarchy only names triangles whose padded boxes a ray meets; each is then tested in
 * doubles, relative to the ray's start. Watertight: both triangles of an edge compute the side on
 * which a ray passes it from the same two corners, with opposite signs bit for bit. A ray that
 * passes the edge within rounding error hits both.
 *
 * Precision: 2^-48 of the distance across the ray, whatever the scene's coordinates and sizes;
 * along the ray the same, divided by the cosine to the triangle's normal.
 * Cost: two to four times a ray in floats. About 100 bytes a triangle in addition to the corners.
 * Threads: immutable once created; any thread may trace.
 */
#include <stddef.h>
#include <stdint.h>
#include "scene/scene_alpha.h"

struct umbr_exact; /* opaque */

/* A ray from `from`, relative to `origin`, along a unit direction, up to far_m. */
struct umbr_exact_ray {
    const double *origin; /* [3] metres, world */
    double from[3];       /* metres, relative to origin */
    double direction[3];  /* unit */
    double far_m;         /* metres: length of the ray; may be infinite */
};

/* The nearest hit. */
struct umbr_exact_hit {
    double distance;   /* metres; negative if nothing was hit */
    uint32_t triangle; /* UINT32_MAX if nothing was hit */
    int leaving;       /* 1 if the ray meets the back of the triangle, by its winding */
};

/* Computes a sphere around all corners: centre is the middle of their bounding box, radius the
 * distance in metres from there to the box's corners. */
void umbr_sphere_of(const double (*corners)[3][3], size_t count, double centre[3], double *radius);

/*
 * Builds the hierarchy.
 *
 * In:    corners: double[count][3][3], world; borrowed until destroyed. cuts: see struct
 *        umbr_rays_options; NULL = every triangle is whole. threads: 0 = all.
 * Fails: E_NO_MEMORY, E_INTERNAL (Embree gives no device).
 */
UMB_CHECKED enum umb_status umbr_exact_create(const double (*corners)[3][3], size_t count,
                                              const struct umbs_cuts *cuts, unsigned threads,
                                              struct umbr_exact **out, struct umb_error *error);
void umbr_exact_destroy(struct umbr_exact *exact);

/* 1 if any triangle lies on the ray. */
int umbr_exact_occluded(const struct umbr_exact *exact, const struct umbr_exact_ray *ray);

void umbr_exact_nearest(const struct umbr_exact *exact, const struct umbr_exact_ray *ray,
                        struct umbr_exact_hit *hit);

/* Returns back-facing minus front-facing hits of closed triangles: above 0 inside a solid. */
int umbr_exact_winding(const struct umbr_exact *exact, const struct umbr_exact_ray *ray,
                       const uint8_t *closed);

/* Returns 1 if a ray passes through a triangle at these weights of its second and third corner: a
 * hole of a cut-out, a triangle that casts nothing, or a translucent one. */
int umbr_is_hole(const struct umbs_cuts *cuts, uint32_t triangle, double second, double third);

#endif
