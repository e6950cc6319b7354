/* SPDX-License-Identifier: Apache-2.0 */
/* The same for every kind of light: rows X, Y and W of the frustum's matrix. */
#include "bake/analysis/cut_planes.h"

uint64_t umbb_cut_bytes(const struct umbb_analysis *analysis)
{
    const struct umbs_cuts *cuts = &analysis->cuts;
    return (cuts->of != NULL ? (uint64_t)analysis->flat_count * sizeof *cuts->of : 0) +
           (uint64_t)cuts->count * (sizeof *cuts->cuts * 3 / 2 + sizeof *analysis->cut_planes);
}

void umbb_cut_planes_make(struct umbb_analysis *analysis, uint32_t number, struct umbb_cuts *cuts)
{
    static const int rows[3] = {0, 1, 3};
    const double(*m)[4] = (const double(*)[4])analysis->frusta[number].world_to_voxel;
    *cuts = (struct umbb_cuts){analysis->cuts.of, analysis->cut_planes, &analysis->cuts};
    for (size_t i = 0; analysis->cuts.of != NULL && i < analysis->count; i++) {
        const uint32_t cut = analysis->cuts.of[i];
        double corners[3][3];
        for (int k = 0; cut != UMBS_CUT_NONE && k < 9; k++) {
            const double *row = m[rows[k % 3]], *p = analysis->corners[i][k / 3];
            corners[k / 3][k % 3] = row[0] * (p[0] - analysis->origin[0]) +
                                    row[1] * (p[1] - analysis->origin[1]) +
                                    row[2] * (p[2] - analysis->origin[2]) + row[3];
        }
        if (cut != UMBS_CUT_NONE) {
            umbb_cut_plane_find((const double(*)[3])corners, &analysis->cut_planes[cut]);
        }
    }
}
