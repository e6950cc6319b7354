/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_ANALYSIS_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_ANALYSIS_H
/*
 * What a scene holds, as far as its shadows go: world triangles, closed parts, bounds, the lights.
 *
 *     umbb_analysis_run(&scene->view, &options, &analysis, &error);
 *     for each frustum: umbb_analysis_to_world, then umbb_analysis_to_voxels or _project, bake
 *     umbb_analysis_to_world, umbb_analysis_orient, verify
 *     umbb_analysis_finish(&analysis);
 *
 * World triangles become voxel triangles in place and are taken from the scene again for the next
 * frustum: two copies would double what a bake needs.
 */
#include <stddef.h>
#include <stdint.h>
#include "bake/analysis/light_choice.h"
#include "bake/analysis/perspective_frame.h"
#include "scene/scene_alpha.h"

struct umbb_cut_plane;

/* Share of the opaque casters' area that closed parts must have for the closed rule to be worth it.
 * Bytes are those of surfaces, and what the rule saves is about that share of them at most:
 * measured on real scenes at 4096, 0.3 % of the area saves 0.4 %, 1.1 % nothing, 5.7 % 5.6 %, 22 %
 * 10 %, 85 % 54 % (docs/results/effects.md). */
#define UMBB_CLOSED_SHARE 0.025

/* Bytes a triangle takes at the worst moment (parts found; or traced for verification). */
#define UMBB_TRIANGLE_BYTES 280U

/* What became of a flattened triangle. */
enum umbb_dropped {
    UMBB_KEPT = 0,
    UMBB_DROPPED = 1,
    UMBB_TRANSLUCENT = 2,
};

struct umbb_analysis {
    /* [count]; world, or voxel space after umbb_analysis_to_voxels. In world space the translucent
     * triangles follow. */
    double (*corners)[3][3];
    uint8_t *kinds;    /* [count] enum umbb_caster */
    uint8_t *dropped;  /* [flat_count] enum umbb_dropped of each flattened triangle */
    size_t count;      /* opaque triangles that can cast */
    size_t flat_count; /* before dropping */
    size_t degenerate_count;
    size_t duplicate_count; /* same three corners as an earlier one */
    size_t part_count, closed_part_count;
    size_t flipped_part_count; /* closed parts wound inward and turned around */
    size_t closed_triangles;
    double area_m2, closed_area_m2; /* of opaque casters, and of those that closed parts have */
    int closed_declined;     /* parts are closed, but with a share of the area that saves nothing */
    char open_reason[256];   /* why the largest part that is not closed is not; may be empty */
    size_t open_reason_part; /* its number */
    int closed_rule;
    int z_up;
    struct umb_box bounds;       /* of the casters */
    double origin[3];            /* centre of the bounds in whole metres */
    double (*translucent)[3][3]; /* [translucent_count] world: casters that are in no voxel */
    uint32_t *translucent_cuts;  /* [translucent_count] their numbers in cuts */
    size_t translucent_count;
    struct umbs_cuts cuts;             /* `of` as corners; what casts nothing is dropped */
    struct umbb_cut_plane *cut_planes; /* [cuts.count] (cut_planes.h) */
    size_t gone_count;                 /* dropped: all of them below their cut-off */
    int in_world;                      /* what space the corners are in */
    struct umbb_light_choice choice;
    struct umb_frustum_info *frusta; /* [frustum_count], in the order of lights */
    uint32_t frustum_count;
};

/*
 * Looks at a scene.
 *
 * Fails: E_BAD_SCENE (no triangle with an area, coordinates out of reach), E_LIMIT (--memory),
 *        E_NO_MEMORY, what umbb_lights_choose fails with. analysis is zeroed then.
 */
UMB_CHECKED enum umb_status umbb_analysis_run(const struct umbs_scene_view *view,
                                              const struct umbb_options *options,
                                              struct umbb_analysis *analysis,
                                              struct umb_error *error);
void umbb_analysis_finish(struct umbb_analysis *analysis);

/* Fits the frusta of all lights to another resolution; the corners must be in world space.
 * Fails: what fitting fails with; there are no frusta then. */
UMB_CHECKED enum umb_status umbb_analysis_refit(struct umbb_analysis *analysis, uint32_t log2_size,
                                                struct umb_error *error);

/* Moves the corners, which are in world space, to the voxel space of a directional light's
 * frustum. */
void umbb_analysis_to_voxels(struct umbb_analysis *analysis, uint32_t frustum);

/* Projects what a spot or point light's frustum sees of the corners, which stay in world space.
 * In: cuts: of umbb_cut_planes_make for that frustum.
 * Out, Fails: as umbb_perspective_project. */
UMB_CHECKED enum umb_status umbb_analysis_project(const struct umbb_analysis *analysis,
                                                  uint32_t frustum, const struct umbb_cuts *cuts,
                                                  size_t max_bytes,
                                                  struct umbb_projected *projected,
                                                  struct umb_error *error);

/* Gets the corners in world space, from the scene unless they are. Fails: E_NO_MEMORY, E_INTERNAL.
 */
UMB_CHECKED enum umb_status umbb_analysis_to_world(struct umbb_analysis *analysis,
                                                   const struct umbs_scene_view *view,
                                                   struct umb_error *error);

/* Turns the closed parts that wind inward around, since rays tell inside by the winding. The
 * corners must be in world space. */
void umbb_analysis_orient(struct umbb_analysis *analysis);

#endif
