/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_ANALYSIS_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_ANALYSIS_H
/*
 * Analysis of a scene for its shadows: world triangles, closed parts, bounds, the lights.
 *
 *     umbb_analysis_run(&scene->view, &options, &analysis, &error);
 *     umbb_analysis_need_corners(&analysis, &scene->view, &error);   before reading corners
 *     umbb_analysis_finish(&analysis);
 *
 * If memory is short, the world corners exist once, because two copies would double the memory of a
 * bake. Other objects then move them out of the analysis (voxel_casters.h,
 * umbb_analysis_take_turned), and the next reader has the scene flattened again.
 */
#include <stddef.h>
#include <stdint.h>
#include "bake/analysis/light_choice.h"
#include "bake/analysis/perspective_frame.h"
#include "scene/scene_alpha.h"

/* Share of --memory that copies of the corners may take. */
#define UMBB_COPIES_SHARE 16U

/* Bytes a triangle takes at the peak (search for parts; or ray tracing for verification). */
#define UMBB_TRIANGLE_BYTES 280U

/* Reason why a flattened triangle was dropped. */
enum umbb_dropped {
    UMBB_KEPT = 0,
    UMBB_DROPPED = 1,
    UMBB_TRANSLUCENT = 2,
};

/* Costs and savings of the closed rule, as the plan states them. */
struct umbb_closed_price {
    int known;            /* 0: the rule was not in question */
    int exact;            /* 1: the bytes are those of bakes at the wanted resolution */
    uint32_t sample_log2; /* otherwise log2 of the voxels a side of the largest sample */
    double saved;         /* share of the nodes' bytes that the rule saves; may be negative */
    double factor;        /* the bytes are within this factor of the forecast; 1: exact */
    double open_bytes, closed_bytes; /* packed bytes under each rule; 0: not asked for */
};

/* Forecast of the bytes of voxels and transmittance maps, with sharp BLEND materials
 * (scene_alpha.h) as they are, and as cut-outs. */
struct umbb_sharp_price {
    int known; /* 0: not asked for */
    double blend_bytes, cut_bytes;
};

struct umbb_analysis {
    /* [count + translucent_count] World corners, the opaque casters' first; NULL after a move. */
    double (*corners)[3][3];
    /* 1: the corners stay in the analysis, and casters in voxel space are copies, in `copy` between
     * two frusta. 0: memory is short, and the corners are moved. */
    int keeps_corners;
    double (*copy)[3][3];    /* [count + translucent_count] working memory; NULL: none, or in use */
    unsigned threads;        /* threads that may pass over the triangles */
    uint8_t *kinds;          /* [count] enum umbb_caster */
    uint8_t *dropped;        /* [flat_count] enum umbb_dropped of each flattened triangle */
    size_t count;            /* opaque triangles that can cast */
    size_t flat_count;       /* number before dropping */
    size_t degenerate_count; /* triangles without an area */
    size_t duplicate_count;  /* triangles with the three corners of an earlier one */
    size_t part_count, closed_part_count;
    size_t open_on_word;       /* open parts that --closed on treats as closed */
    size_t flipped_part_count; /* closed parts that wound inward and were turned around */
    size_t closed_triangles;
    char open_reason[256];   /* reason why the largest open part is open; may be empty */
    size_t open_reason_part; /* number of the largest open part */
    /* 1: the closed rule applies. Until umbb_closed_choose has decided, 1 means that it is
     * possible. */
    int closed_rule;
    struct umbb_closed_price closed_price;
    struct umbb_sharp_price sharp_price;
    int z_up;
    const char *up_reason;       /* static words: what told z_up */
    struct umb_box bounds;       /* bounds of the casters */
    double origin[3];            /* centre of the bounds in whole metres */
    double (*translucent)[3][3]; /* [translucent_count] world: casters without voxels */
    uint32_t *translucent_cuts;  /* [translucent_count] their numbers in cuts */
    size_t translucent_count;
    struct umbs_cuts cuts; /* `of` is indexed as corners; triangles that cast nothing are dropped */
    size_t gone_count;     /* dropped triangles below their cut-off all over */
    struct umbb_light_choice choice;
    struct umb_frustum_info *frusta; /* [frustum_count], in the order of lights */
    uint32_t frustum_count;
};

/*
 * Analyses a scene.
 *
 * Fails: E_BAD_SCENE (no triangle with an area, coordinates out of range), E_LIMIT (--memory),
 *        E_NO_MEMORY, and the errors of umbb_lights_choose. analysis is zeroed on failure.
 */
UMB_CHECKED enum umb_status umbb_analysis_run(const struct umbs_scene_view *view,
                                              const struct umbb_options *options,
                                              struct umbb_analysis *analysis,
                                              struct umb_error *error);
void umbb_analysis_finish(struct umbb_analysis *analysis);

/* Makes the world corners again from the scene. Does nothing if the analysis still has them. Fails:
 * E_NO_MEMORY, E_INTERNAL. */
UMB_CHECKED enum umb_status umbb_analysis_need_corners(struct umbb_analysis *analysis,
                                                       const struct umbs_scene_view *view,
                                                       struct umb_error *error);

/* Fits the frusta of all lights to another resolution. The analysis must have its corners. Fails:
 * the errors of umbb_frusta_fit; the analysis then has no frusta. */
UMB_CHECKED enum umb_status umbb_analysis_refit(struct umbb_analysis *analysis, uint32_t log2_size,
                                                struct umb_error *error);

/* Turns the closed rule on or off, in the analysis and its frusta. The kinds of casters stay:
 * without the rule they are not read. */
void umbb_analysis_rule(struct umbb_analysis *analysis, int closed);

/* Moves the corners out of the analysis, which must have them. Closed parts that wind inwards
 * are turned around, because rays tell the inside by the winding. Returns corners [count], for
 * free(). */
double (*umbb_analysis_take_turned(struct umbb_analysis *analysis))[3][3];

#endif
