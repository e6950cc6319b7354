/* SPDX-License-Identifier: Apache-2.0 */
/* Edge functions for every kind of light, by rows X, Y and W of the frustum's matrix. */
#include "bake/analysis/cut_planes.h"

uint64_t umbb_cut_bytes(const struct umbb_analysis *analysis)
{
    const struct umbs_cuts *cuts = &analysis->cuts;
    return (cuts->of != NULL ? (uint64_t)analysis->flat_count * sizeof *cuts->of : 0) +
           (uint64_t)cuts->count * (sizeof *cuts->cuts * 3 / 2 + sizeof *analysis->cut_planes) +
           (uint64_t)analysis->translucent_count *
               (2 * sizeof *analysis->translucent + 2 * sizeof *analysis->translucent_cuts);
}

/* Makes the edge functions of a world triangle for a frustum. */
static void make_plane(struct umbb_analysis *analysis, const struct umb_frustum_info *frustum,
                       const double triangle[3][3], uint32_t cut)
{
    static const int rows[3] = {0, 1, 3};
    double corners[3][3];
    for (int k = 0; k < 9; k++) {
        const double *row = frustum->world_to_voxel[rows[k % 3]], *p = triangle[k / 3];
        corners[k / 3][k % 3] = row[0] * (p[0] - analysis->origin[0]) +
                                row[1] * (p[1] - analysis->origin[1]) +
                                row[2] * (p[2] - analysis->origin[2]) + row[3];
    }
    umbb_cut_plane_find((const double(*)[3])corners, &analysis->cut_planes[cut]);
}

void umbb_cut_planes_make(struct umbb_analysis *analysis, uint32_t number, struct umbb_cuts *cuts)
{
    *cuts = (struct umbb_cuts){analysis->cuts.of, analysis->cut_planes, &analysis->cuts};
    for (size_t i = 0; analysis->cuts.of != NULL && i < analysis->count; i++) {
        if (analysis->cuts.of[i] != UMBS_CUT_NONE) {
            make_plane(analysis, &analysis->frusta[number],
                       (const double(*)[3])analysis->corners[i], analysis->cuts.of[i]);
        }
    }
}

void umbb_cut_planes_translucent(struct umbb_analysis *analysis,
                                 const struct umb_frustum_info *frustum, struct umbb_cuts *cuts)
{
    *cuts = (struct umbb_cuts){analysis->translucent_cuts, analysis->cut_planes, &analysis->cuts};
    for (size_t i = 0; i < analysis->translucent_count; i++) {
        make_plane(analysis, frustum, (const double(*)[3])analysis->translucent[i],
                   analysis->translucent_cuts[i]);
    }
}
