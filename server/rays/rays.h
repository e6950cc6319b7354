/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_RAYS_H
#define UMBRAGE_SERVER_RAYS_RAYS_H
/*
 * Ray tracing with Embree 3 (robust mode): the reference for bakes and studies. It is independent
 * of the bake's coverage predicate: Embree intersects the triangles itself.
 *
 * Precision: Embree works in float. Triangles are passed relative to the centre of the scene, so a
 * ray is off by some 2^-22 of the scene's radius, at most by umbr_rays_error_m. If that is too
 * coarse, umbr_rays_exact has rays in doubles.
 * Threads: a built scene is immutable; any thread may trace.
 */
#include <stddef.h>
#include <stdint.h>
#include "scene/scene_alpha.h"
#include "rays/exact_rays.h"

struct umbr_rays; /* opaque */

struct umbr_hit {
    double distance;  /* along the unit direction, metres; negative if nothing was hit */
    double normal[3]; /* unit, geometric, by the triangle's winding */
    uint32_t triangle;
};

/* Options of building the hierarchy. If zeroed, it is built for many rays, with all processors. */
struct umbr_rays_options {
    int quick;        /* 1: built several times as fast, traced about a third slower */
    unsigned threads; /* threads of the build; 0 = all */
    /* Cuts of triangles with holes; `of` is in the order of the triangles. Rays ignore cut-out
     * texels, triangles that cast nothing, and translucent triangles. Borrowed until destroyed;
     * NULL = every triangle is whole. */
    const struct umbs_cuts *cuts;
};

/*
 * Builds the hierarchy over world triangles.
 *
 * In:    corners: double[count][3][3]; after the call only umbr_rays_exact reads them, so they must
 *        last as long as calls of umbr_rays_exact are possible. options: may be NULL.
 * Fails: E_NO_MEMORY, E_TOO_LARGE (above 1431655765 triangles), E_INTERNAL (Embree's message).
 * Cost:  about 1 us a triangle quick, 3 otherwise, on one processor.
 */
UMB_CHECKED enum umb_status umbr_rays_build(const double (*corners)[3][3], size_t count,
                                            const struct umbr_rays_options *options,
                                            struct umbr_rays **out, struct umb_error *error);

void umbr_rays_destroy(struct umbr_rays *rays);

/* Returns the greatest distance in metres from an edge or corner at which a ray may pass on the
 * wrong side: 2^-20 of the scene's radius. Start, direction, corners and the intersection itself
 * each have an error of 2^-24 of up to two diameters. */
double umbr_rays_error_m(const struct umbr_rays *rays);

/*
 * Gets the hierarchy of the same triangles for rays in doubles, which `rays` owns. The first call,
 * on any thread, builds the hierarchy.
 *
 * Fails: the errors of umbr_exact_create; *exact is NULL then.
 */
UMB_CHECKED enum umb_status umbr_rays_exact(const struct umbr_rays *rays,
                                            const struct umbr_exact **exact,
                                            struct umb_error *error);

/*
 * Returns 1 if any triangle lies on the ray from `from` along unit `direction`, between near and
 * far metres.
 *
 * In: from, direction: finite. near_m: below 0 counts as 0. far_m: may be infinite; a range with
 *     far_m < near_m is empty.
 */
int umbr_occluded(const struct umbr_rays *rays, const double from[3], const double direction[3],
                  double near_m, double far_m);

/* Does umbr_occluded for a packet of eight rays of one direction. occluded: 0 or 1 for each ray. */
void umbr_occluded8(const struct umbr_rays *rays, const double (*from)[3],
                    const double direction[3], double near_m, double far_m, uint8_t occluded[8]);

/* Nearest hit, with the same arguments. */
void umbr_nearest(const struct umbr_rays *rays, const double from[3], const double direction[3],
                  double near_m, double far_m, struct umbr_hit *hit);

/* A place where a ray crosses a surface. */
struct umbr_crossing {
    double distance;      /* metres */
    double second, third; /* weights of the triangle's second and third corner, 0..1 */
    uint32_t triangle;
    int leaving; /* 1 if the ray meets the back of the triangle, by its winding */
};

/* Visits a crossing; returns 0 to end the walk. */
typedef int (*umbr_crossing_fn)(void *user, const struct umbr_crossing *crossing);

/*
 * Visits the crossings of a ray up to far_m, the nearest first, in any number. A ray through an
 * edge or a corner that facets share crosses there once for each side that it meets.
 *
 * In: only: uint8[triangle count], not 0 for the triangles that count; NULL = all.
 */
void umbr_each_crossing(const struct umbr_rays *rays, const double from[3],
                        const double direction[3], double far_m, const uint8_t *only,
                        umbr_crossing_fn visit, void *user);

/*
 * Sums up the crossings of a whole ray, to test whether a point is inside a closed solid.
 *
 * In:    closed: uint8[triangle count], not 0 for triangles of a closed part.
 * Out:   winding: back-facing minus front-facing crossings of closed triangles: > 0 inside.
 *        crossings: all hits of closed triangles. A ray through an edge or a corner that facets
 *        share crosses there once.
 * Not guaranteed: a point within float rounding of a surface may count as either side.
 * Caveat: facing is by winding as built; turn parts that umbs_parts_find calls `flipped` first.
 */
void umbr_crossings(const struct umbr_rays *rays, const double from[3], const double direction[3],
                    const uint8_t *closed, int *winding, int *crossings);

#endif
