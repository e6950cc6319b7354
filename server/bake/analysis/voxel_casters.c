/* SPDX-License-Identifier: Apache-2.0 */
/* From world triangles to a frustum's casters, with the edge functions of those that have holes. */
#include "bake/analysis/voxel_casters.h"

#include <stdlib.h>
#include <string.h>

#include "bake/analysis/frusta.h"
#include "bake/analysis/light_frame.h"
#include "base/try.h"
#include "tool/threads.h"

uint64_t umbb_cut_bytes(const struct umbb_analysis *analysis)
{
    const struct umbs_cuts *cuts = &analysis->cuts;
    return (cuts->of != NULL ? (uint64_t)analysis->flat_count * sizeof *cuts->of : 0) +
           (uint64_t)cuts->count * (sizeof *cuts->cuts * 3 / 2 + sizeof(struct umbb_cut_plane)) +
           (uint64_t)analysis->translucent_count *
               (2 * sizeof *analysis->translucent + 2 * sizeof *analysis->translucent_cuts);
}

/* Makes the edge functions of all casters with holes; the casters are in world space still. */
static enum umb_status make_planes(const struct umbb_analysis *analysis,
                                   const struct umb_frustum_info *frustum,
                                   struct umbb_voxel_casters *voxels, struct umb_error *error)
{
    const struct umbb_casters *world = &voxels->casters;
    const size_t count = analysis->cuts.count;
    if (voxels->cuts.of == NULL || count == 0) {
        return UMB_OK;
    }
    voxels->cuts.planes = voxels->planes = calloc(count, sizeof *voxels->planes);
    if (voxels->planes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "cut-out: memory for %zu triangles refused", count);
    }
    for (size_t i = 0; i < world->count; i++) {
        if (voxels->cuts.of[i] != UMBS_CUT_NONE) {
            double corners[3][3];
            umbb_eye_corners(frustum, analysis->origin, world->corners[i], corners);
            umbb_cut_plane_find((const double(*)[3])corners, &voxels->planes[voxels->cuts.of[i]]);
        }
    }
    return UMB_OK;
}

/* Corners that are being transformed. */
struct placing {
    const struct umb_frustum_info *frustum;
    const double *origin;
    const double (*from)[3][3];
    double (*to)[3][3];
};

static enum umb_status place_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct placing *placing = user;
    (void)error;
    if (placing->from != (const double(*)[3][3])placing->to) {
        memcpy(placing->to + first, placing->from + first, count * sizeof *placing->to);
    }
    umbb_light_frame_apply(placing->frustum, placing->origin, placing->to + first, count);
    return UMB_OK;
}

/* Transforms the corners of parallel light. */
static enum umb_status place_corners(const struct umbb_analysis *analysis,
                                     const struct umb_frustum_info *frustum,
                                     struct umbb_voxel_casters *voxels, struct umb_error *error)
{
    struct umbb_casters *casters = &voxels->casters;
    struct placing placing = {frustum, analysis->origin, casters->corners, voxels->corners};
    casters->corners = (const double(*)[3][3])voxels->corners;
    return umbu_range_run(analysis->threads > 0 ? analysis->threads : 1, casters->count, 1 << 10,
                          place_block, &placing, error);
}

/* Takes the casters from world space to the frustum's voxel space. Corners of parallel light are
 * written to the memory that `voxels` has for them; other casters are projected into new memory. */
static enum umb_status transform(const struct umbb_analysis *analysis,
                                 const struct umb_frustum_info *frustum, size_t max_bytes,
                                 struct umbb_voxel_casters *voxels, struct umb_error *error)
{
    struct umbb_casters *casters = &voxels->casters;
    struct umbb_projected *projected = &voxels->projected;
    UMB__TRY(make_planes(analysis, frustum, voxels, error));
    if (voxels->corners != NULL) {
        return place_corners(analysis, frustum, voxels, error);
    }
    const double *position = analysis->choice.lights[frustum->light].position;
    const struct umbb_eye_view view = {.frustum = frustum,
                                       .origin = analysis->origin,
                                       .reach = umbb_light_reach(&analysis->bounds, position),
                                       .max_bytes = max_bytes};
    UMB__TRY(umbb_perspective_project(casters, &view, projected, error));
    voxels->cuts.of = projected->cuts;
    casters->corners = (const double(*)[3][3])projected->corners;
    casters->kinds = projected->kinds;
    casters->count = projected->count;
    casters->depth_scale = projected->depth_scale;
    casters->depth_offset = projected->depth_offset;
    return UMB_OK;
}

static int is_parallel(const struct umbb_analysis *analysis, const struct umb_frustum_info *frustum)
{
    return analysis->choice.lights[frustum->light].kind == UMB_LIGHT_DIRECTIONAL;
}

/* Gives parallel light memory for its corners: the analysis's own, or a copy's. */
static enum umb_status take_corners(struct umbb_analysis *analysis,
                                    struct umbb_voxel_casters *voxels, struct umb_error *error)
{
    if (!analysis->keeps_corners) {
        voxels->corners = analysis->corners;
        analysis->corners = NULL;
        return UMB_OK;
    }
    voxels->lender = analysis;
    voxels->corners = analysis->copy != NULL
                          ? analysis->copy
                          : malloc((analysis->count + 1) * sizeof *analysis->copy);
    analysis->copy = NULL;
    return voxels->corners != NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "bake: memory for %zu triangles refused",
                          analysis->count);
}

enum umb_status umbb_voxel_casters_make(struct umbb_analysis *analysis,
                                        const struct umbs_scene_view *view, uint32_t number,
                                        size_t max_bytes, struct umbb_voxel_casters *voxels,
                                        struct umb_error *error)
{
    const struct umb_frustum_info *frustum = &analysis->frusta[number];
    *voxels = (struct umbb_voxel_casters){.cuts = {analysis->cuts.of, NULL, &analysis->cuts}};
    UMB__TRY(umbb_analysis_need_corners(analysis, view, error));
    voxels->casters = (struct umbb_casters){
        .corners = (const double(*)[3][3])analysis->corners,
        .kinds = analysis->kinds,
        .count = analysis->count,
        .size = (int32_t)1 << frustum->log2_size,
        .closed_rule = frustum->closed,
        .cuts = &voxels->cuts,
        .open_on_word = analysis->open_on_word > 0,
    };
    if (is_parallel(analysis, frustum)) {
        UMB__TRY(take_corners(analysis, voxels, error));
    }
    return transform(analysis, frustum, max_bytes, voxels, error);
}

enum umb_status umbb_voxel_casters_translucent(const struct umbb_analysis *analysis,
                                               const struct umb_frustum_info *frustum,
                                               size_t max_bytes, struct umbb_voxel_casters *voxels,
                                               struct umb_error *error)
{
    const size_t count = analysis->translucent_count, bytes = count * sizeof *voxels->corners;
    const int parallel = is_parallel(analysis, frustum);
    _Static_assert(UMBB_CASTER_OPEN == 0, "zeroed kinds are open");
    *voxels = (struct umbb_voxel_casters){
        .cuts = {analysis->translucent_cuts, NULL, &analysis->cuts},
        .open = calloc(count, 1),
        .corners = parallel ? malloc(bytes) : NULL,
    };
    if (voxels->open == NULL || (parallel && voxels->corners == NULL)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: %zu bytes refused", bytes);
    }
    if (parallel) {
        memcpy(voxels->corners, analysis->translucent, bytes);
    }
    voxels->casters = (struct umbb_casters){
        .corners = (const double(*)[3][3])(parallel ? voxels->corners : analysis->translucent),
        .kinds = voxels->open,
        .count = count,
        .size = (int32_t)1 << frustum->log2_size,
        .cuts = &voxels->cuts,
    };
    return transform(analysis, frustum, max_bytes, voxels, error);
}

void umbb_voxel_casters_finish(struct umbb_voxel_casters *voxels)
{
    if (voxels->lender != NULL) {
        voxels->lender->copy = voxels->corners;
    } else {
        free(voxels->corners);
    }
    free(voxels->planes);
    free(voxels->open);
    umbb_projected_finish(&voxels->projected);
    memset(voxels, 0, sizeof *voxels);
}
