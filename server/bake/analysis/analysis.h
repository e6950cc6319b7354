/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_ANALYSIS_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_ANALYSIS_H
/*
 * Analysis of a scene for its shadows: world triangles, closed parts, bounds, the lights.
 *
 *     umbb_analysis_run(&scene->view, &options, &analysis, &error);
 *     for each frustum: umbb_analysis_to_world, then umbb_analysis_to_voxels or _project, bake
 *     umbb_analysis_to_world, umbb_analysis_orient, verify
 *     umbb_analysis_finish(&analysis);
 *
 * World triangles become voxel triangles in place, and are flattened again from the scene for the
 * next frustum: two copies would double the memory of a bake.
 */
#include <stddef.h>
#include <stdint.h>
#include "bake/analysis/light_choice.h"
#include "bake/analysis/perspective_frame.h"
#include "scene/scene_alpha.h"

struct umbb_cut_plane;

/* Share of the opaque casters' area that closed parts must have for the closed rule to be worth it.
 * An asset's bytes belong to surfaces, and the rule saves at most about that share of them.
 * Measured on real scenes at 4096: 0.3 % of the area saves 0.4 %, 1.1 % nothing, 5.7 % 5.6 %, 22 %
 * 10 %, 85 % 54 % (docs/results/effects.md). */
#define UMBB_CLOSED_SHARE 0.025

/* Bytes a triangle takes at the peak (search for parts; or ray tracing for verification). */
#define UMBB_TRIANGLE_BYTES 280U

/* Reason why a flattened triangle was dropped. */
enum umbb_dropped {
    UMBB_KEPT = 0,
    UMBB_DROPPED = 1,
    UMBB_TRANSLUCENT = 2,
};

struct umbb_analysis {
    /* [count] Corners in world space, or in voxel space after umbb_analysis_to_voxels. In world
     * space the translucent triangles follow. */
    double (*corners)[3][3];
    uint8_t *kinds;    /* [count] enum umbb_caster */
    uint8_t *dropped;  /* [flat_count] enum umbb_dropped of each flattened triangle */
    size_t count;      /* opaque triangles that can cast */
    size_t flat_count; /* number before dropping */
    size_t degenerate_count;
    size_t duplicate_count; /* triangles with the three corners of an earlier one */
    size_t part_count, closed_part_count;
    size_t flipped_part_count; /* closed parts that wound inward and were turned around */
    size_t closed_triangles;
    double area_m2, closed_area_m2; /* area of the opaque casters, and of those in closed parts */
    int closed_declined;   /* 1: there are closed parts, but their share of the area is too small */
    char open_reason[256]; /* reason why the largest open part is open; may be empty */
    size_t open_reason_part; /* number of that part */
    int closed_rule;
    int z_up;
    struct umb_box bounds;       /* bounds of the casters */
    double origin[3];            /* centre of the bounds in whole metres */
    double (*translucent)[3][3]; /* [translucent_count] world: casters without voxels */
    uint32_t *translucent_cuts;  /* [translucent_count] their numbers in cuts */
    size_t translucent_count;
    struct umbs_cuts cuts; /* `of` is indexed as corners; triangles that cast nothing are dropped */
    struct umbb_cut_plane *cut_planes; /* [cuts.count] (cut_planes.h) */
    size_t gone_count;                 /* dropped triangles below their cut-off all over */
    int in_world;                      /* 1 if the corners are in world space */
    struct umbb_light_choice choice;
    struct umb_frustum_info *frusta; /* [frustum_count], in the order of lights */
    uint32_t frustum_count;
};

/*
 * Analyses a scene.
 *
 * Fails: E_BAD_SCENE (no triangle with an area, coordinates out of range), E_LIMIT (--memory),
 *        E_NO_MEMORY, as umbb_lights_choose. analysis is zeroed then.
 */
UMB_CHECKED enum umb_status umbb_analysis_run(const struct umbs_scene_view *view,
                                              const struct umbb_options *options,
                                              struct umbb_analysis *analysis,
                                              struct umb_error *error);
void umbb_analysis_finish(struct umbb_analysis *analysis);

/* Fits the frusta of all lights to another resolution; the corners must be in world space.
 * Fails: as umbb_frusta_fit; there are no frusta then. */
UMB_CHECKED enum umb_status umbb_analysis_refit(struct umbb_analysis *analysis, uint32_t log2_size,
                                                struct umb_error *error);

/* Moves the corners from world space to the voxel space of a directional light's frustum. */
void umbb_analysis_to_voxels(struct umbb_analysis *analysis, uint32_t frustum);

/* Projects the part of the casters that a spot or point light's frustum sees; the corners stay in
 * world space.
 * In: cuts: of umbb_cut_planes_make for that frustum.
 * Out, Fails: as umbb_perspective_project. */
UMB_CHECKED enum umb_status umbb_analysis_project(const struct umbb_analysis *analysis,
                                                  uint32_t frustum, const struct umbb_cuts *cuts,
                                                  size_t max_bytes,
                                                  struct umbb_projected *projected,
                                                  struct umb_error *error);

/* Moves the corners to world space, from the scene unless they are there. Fails: E_NO_MEMORY,
 * E_INTERNAL. */
UMB_CHECKED enum umb_status umbb_analysis_to_world(struct umbb_analysis *analysis,
                                                   const struct umbs_scene_view *view,
                                                   struct umb_error *error);

/* Turns inward-winding closed parts around, since rays tell the inside by the winding. The corners
 * must be in world space. */
void umbb_analysis_orient(struct umbb_analysis *analysis);

#endif
