/* SPDX-License-Identifier: Apache-2.0 */
/* Edge functions, and drawing by them (cut_out.h). */
#include "bake/depth/cut_out.h"

#include <math.h>

#include "base/vec.h"

void umbb_cut_plane_find(const double corners[3][3], struct umbb_cut_plane *plane)
{
    double moved[3][3];
    for (int axis = 0; axis < 2; axis++) {
        /* With a corner as anchor the functions do not suffer cancellation far from texel 0. */
        const double anchor = corners[0][2] > 0.0 ? corners[0][axis] / corners[0][2] : 0.0;
        plane->anchor[axis] = fabs(anchor) <= UMBB_COORDINATE_MAX ? anchor : 0.0;
    }
    for (int k = 0; k < 3; k++) {
        moved[k][0] = corners[k][0] - plane->anchor[0] * corners[k][2];
        moved[k][1] = corners[k][1] - plane->anchor[1] * corners[k][2];
        moved[k][2] = corners[k][2];
    }
    for (int k = 0; k < 3; k++) {
        umb__cross(moved[(k + 1) % 3], moved[(k + 2) % 3], plane->edge[k]);
    }
}

static double unit(double value)
{
    return value > 0.0 ? (value < 1.0 ? value : 1.0) : 0.0; /* a NaN becomes 0 */
}

/* Texture coordinates of a cut at the centre of a texel. */
static void place(const struct umbb_cuts *cuts, uint32_t cut, int32_t x, int32_t y, double at[2])
{
    const struct umbb_cut_plane *plane = &cuts->planes[cut];
    const float(*uv)[2] = cuts->table->cuts[cut].uv;
    const double px = ((double)x + 0.5) - plane->anchor[0];
    const double py = ((double)y + 0.5) - plane->anchor[1];
    double weight[3], sum = 0.0;
    for (int k = 0; k < 3; k++) {
        weight[k] = plane->edge[k][0] * px + plane->edge[k][1] * py + plane->edge[k][2];
        sum += weight[k];
    }
    for (int k = 0; k < 3; k++) {
        weight[k] = sum != 0.0 ? unit(weight[k] / sum) : (weight[k] > 0.0 ? 1.0 : 0.0);
    }
    sum = weight[0] + weight[1] + weight[2];
    if (!(sum > 0.0)) { /* seen edge on, beyond doubles: uses its first corner */
        weight[0] = sum = 1.0;
    }
    for (int k = 0; k < 2; k++) {
        at[k] = (weight[0] * (double)uv[0][k] + weight[1] * (double)uv[1][k] +
                 weight[2] * (double)uv[2][k]) /
                sum;
    }
}

int umbb_cut_casts(const struct umbb_cuts *cuts, uint32_t cut, int32_t x, int32_t y)
{
    double at[2];
    place(cuts, cut, x, y, at);
    return umbs_cut_keeps(cuts->table, cut, at[0], at[1]);
}

double umbb_cut_takes(const struct umbb_cuts *cuts, uint32_t cut, int32_t x, int32_t y)
{
    double at[2];
    place(cuts, cut, x, y, at);
    return umbs_cut_opacity(cuts->table, cut, at[0], at[1]);
}
