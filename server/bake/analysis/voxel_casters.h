/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_VOXEL_CASTERS_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_VOXEL_CASTERS_H
/*
 * The casters of one frustum in its voxel space, made from an analysis.
 *
 *     for each frustum: umbb_voxel_casters_make(&job, number, &voxels, &error);
 *                       depth paths read voxels.casters
 *                       umbb_voxel_casters_finish(&voxels);
 *
 * Parallel light transforms a copy of the analysis's world corners. If memory is short, it moves
 * them into the object and transforms them in place; the analysis then has no corners until the
 * next umbb_analysis_need_corners. Spot and point lights get projected copies of what they see.
 */
#include "bake/analysis/analysis.h"
#include "bake/depth/cut_out.h"

/* The object must not be moved: `casters` points into it. */
struct umbb_voxel_casters {
    struct umbb_casters casters; /* without marks; borrows from the analysis too */
    struct umbb_cuts cuts;
    struct umbb_cut_plane *planes; /* [cuts.table->count] edge functions in this frustum, or NULL */
    double (*corners)[3][3];       /* parallel light */
    struct umbb_analysis *lender;  /* owner of these corners; NULL: the object itself */
    struct umbb_projected projected; /* spot and point lights */
    uint8_t *open;                   /* kinds of translucent casters: all open */
};

/* Bytes of an analysis's cut-out casters and of their edge functions in one frustum. */
uint64_t umbb_cut_bytes(const struct umbb_analysis *analysis);

/*
 * Makes the opaque casters of frustum `number`.
 *
 * In:    view: the analysed scene. max_bytes: limit of projected triangles.
 * Out:   voxels: to be finished after any result.
 * Fails: the errors of umbb_analysis_need_corners; E_NO_MEMORY, E_LIMIT (max_bytes).
 */
UMB_CHECKED enum umb_status umbb_voxel_casters_make(struct umbb_analysis *analysis,
                                                    const struct umbs_scene_view *view,
                                                    uint32_t number, size_t max_bytes,
                                                    struct umbb_voxel_casters *voxels,
                                                    struct umb_error *error);

/* Makes the translucent casters of a frustum, whose matrix may be scaled. The analysis need not
 * have its corners. Otherwise works like umbb_voxel_casters_make. */
UMB_CHECKED enum umb_status umbb_voxel_casters_translucent(const struct umbb_analysis *analysis,
                                                           const struct umb_frustum_info *frustum,
                                                           size_t max_bytes,
                                                           struct umbb_voxel_casters *voxels,
                                                           struct umb_error *error);

void umbb_voxel_casters_finish(struct umbb_voxel_casters *voxels);

#endif
