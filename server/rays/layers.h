/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_LAYERS_H
#define UMBRAGE_SERVER_RAYS_LAYERS_H
/*
 * Translucent surfaces along rays. umbr_rays passes through them; here are the places where a ray
 * meets them, and the light that they leave.
 *
 * The triangles are those that a table of cuts marks as translucent, in a hierarchy of their own.
 * The absorbed share at a place is the table's (umbs_cut_opacity), so bakes and rays agree about
 * it. The order, the depths and the products are computed here, independently of the bake.
 *
 * Threads: immutable once built; any thread may trace.
 */
#include "rays/rays.h"

struct umbr_layers; /* opaque */

/* A place where a ray meets a translucent surface. */
struct umbr_layer {
    double distance;   /* metres along the unit direction */
    double opacity;    /* share of the light that the surface absorbs there, above 0 to 1 */
    uint32_t triangle; /* index in the scene */
};

/*
 * Builds the hierarchy over a scene's translucent triangles.
 *
 * In:    corners: double[count][3][3], world; read by this call only. cuts: borrowed until
 *        destroyed. threads: 0 = all.
 * Out:   out: NULL if no triangle is translucent, which every function here takes as no surface.
 * Fails: the errors of umbr_rays_build.
 */
UMB_CHECKED enum umb_status umbr_layers_build(const double (*corners)[3][3], size_t count,
                                              const struct umbs_cuts *cuts, unsigned threads,
                                              struct umbr_layers **out, struct umb_error *error);

void umbr_layers_destroy(struct umbr_layers *layers); /* NULL is allowed */

/*
 * Finds the surfaces that a ray meets up to far_m, the nearest first. Surfaces that are clear at
 * the place are left out. The list ends where less than `least` of the light is left, or with `max`
 * surfaces.
 *
 * Out: found: struct umbr_layer[max]. Returns their number.
 */
size_t umbr_layers_find(const struct umbr_layers *layers, const double from[3],
                        const double direction[3], double far_m, double least,
                        struct umbr_layer *found, size_t max);

/* Returns the share of light that all surfaces up to far_m let through: 0..1, their product. */
double umbr_layers_pass(const struct umbr_layers *layers, const double from[3],
                        const double direction[3], double far_m);

#endif
