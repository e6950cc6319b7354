/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SMALL_BAKE_H
#define UMBRAGE_SERVER_BAKE_SMALL_BAKE_H
/* Bakes of a scene at low resolutions, whose costs tell those of the bake itself. */
#include "bake/analysis/analysis.h"
#include "bake/memory_plan.h"

/* Costs of packing into pages of one size. */
struct umbb_page_costs {
    double bytes;  /* bytes of the file; 0: unknown */
    double copies; /* estimated bytes of the pages, over those of the nodes, each once */
};

/*
 * Costs of a bake. The bytes of levels and of first occluders depend on scene, lights, rule and
 * resolution alone. Packed bytes also depend on the machine's zstd, so nothing in an asset may
 * depend on them.
 */
struct umbb_costs {
    double seconds; /* processor time of baking and packing, on this machine */
    double octree_bytes;
    /* [level] Estimated bytes of the nodes of a level before compression, each node once. */
    double level_bytes[UMB_LEVEL_MAX + 1];
    double depth_bytes; /* map of first occluders; 0 unless the job asks for it */
    /* The rest is 0 unless the job asks for it: */
    double packed_bytes;
    /* Packed into pages of UMB__PAGE_BYTES and of UMB__PAGE_BYTES_SHARED. The file has large pages
     * if copies of small ones exceed UMB__PAGE_COPIES_MAX; small ones are then unknown. */
    struct umbb_page_costs small_pages, large_pages;
};

struct umbb_small_job {
    struct umbb_analysis *analysis; /* fitted to the resolution of the last small bake */
    const struct umbs_scene_view *view;
    const struct umbb_options *options;
    struct umbb_memory_input memory; /* input of the memory plan; log2_size, tile_log2 are set */
    int occluder_depth;              /* 1: with the map of first occluders */
    int packed;                      /* 1: with packed bytes */
};

/* Divides the memory for a bake of the job at another resolution. Fails: as umbb_memory_divide. */
UMB_CHECKED enum umb_status umbb_small_divide(const struct umbb_small_job *job, uint32_t log2_size,
                                              struct umbb_memory_plan *plan,
                                              struct umb_error *error);

/* Fits the frusta to another resolution. Fails: as umbb_analysis_need_corners, _refit. */
UMB_CHECKED enum umb_status umbb_small_fit(const struct umbb_small_job *job, uint32_t log2_size,
                                           struct umb_error *error);

/*
 * Bakes at 2^log2_size voxels a side, under the closed rule if the analysis has it on.
 *
 * Fails: the errors of umbb_small_fit, umbb_memory_divide and umbb_bake_frusta.
 */
UMB_CHECKED enum umb_status umbb_small_bake(const struct umbb_small_job *job, uint32_t log2_size,
                                            struct umbb_costs *costs, struct umb_error *error);

#endif
