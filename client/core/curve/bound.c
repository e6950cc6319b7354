/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The largest distance of a look-up from its point. With e the world vectors of a voxel
 * (orthogonal), a window of t x t x 1 voxels and a cell of c = 1 << level voxels:
 *
 *   bias     s = k (t (|n.ex| + |n.ey|) + |n.ez|) <= k d for a unit normal n, where d is the
 *            diagonal of the window and k = 65/128 (query_parts.h), by Cauchy and Schwarz; coarse
 *            look-ups have cells in place of voxels and k = 65/64. Under parallel light a point
 *            moves by l <= L metres towards the light and by s - l c along n, with c the cosine
 *            between the two. The square of the whole move is s^2 + l^2 (1 - c^2) <= s^2 + L^2.
 *            Points without a normal move by a length of their own (query.c, perspective.c).
 *   look-up  the centre of a voxel of the window is at most d / 2 from the moved point; a boundary
 *            within the point's cell at most its diagonal.
 */
#include <math.h>

#include "format/asset_parts.h"
#include "query/query_parts.h"
#include "umbrage/curve.h"

/* Computes the edges in metres of the box that a look-up reaches: a window across the light and one
 * voxel along it; or one cell. */
static void reach_edges(const struct umb_frustum_info *frustum, uint32_t level, uint32_t taps,
                        double edges[3])
{
    const double cell = (double)((uint32_t)1 << level);
    umb_frustum_voxel_edges(frustum, edges);
    edges[0] *= cell * (taps > 0 ? taps : 1);
    edges[1] *= cell * (taps > 0 ? taps : 1);
    edges[2] *= cell;
}

/* Adds the effect of a perspective frustum's slanted rays. A step along such a ray is longer than a
 * step along the axis. Voxels grow along the ray, and perspective.c divides the bias by that
 * growth. */
static double slant(const struct umb_frustum_info *frustum, uint32_t taps, double *growth)
{
    const double *ex = frustum->voxel_step[0], *ey = frustum->voxel_step[1];
    const double half = (double)((uint32_t)1 << frustum->log2_size) / 2;
    const double square =
        umb__dot(ex, ex) + umb__dot(ey, ey); /* Squared diagonal of a texel where W = 1 */
    const double rest = 1.0 - 0.5 * (taps > 0 ? taps : 1) * sqrt(square);
    *growth = 1.0 / (rest > 0.25 ? rest : 0.25);
    return sqrt(1.0 + half * half * square);
}

/* Finds the largest distance of a look-up from its point: the longest automatic bias plus half
 * the reach of a window or cell. */
static void parts_of(const struct umb_frustum_info *frustum, uint32_t level, uint32_t taps,
                     double *bias, double *look_up)
{
    double edges[3], growth = 1.0;
    const double width = taps > 0 ? taps : 1, no_normal = (2.0 * width + 1.0) / (2.0 * sqrt(3.0));
    reach_edges(frustum, level, taps, edges);
    if (umb__is_perspective(frustum)) {
        edges[2] *= slant(frustum, taps, &growth);
        /* The ray is oblique to the window, so the longest reach is the sum of the edges, not the
         * diagonal of a box. */
        *look_up = 0.5 * (edges[0] + edges[1] + edges[2]);
    } else {
        *look_up = 0.5 * sqrt(umb__dot(edges, edges));
    }
    *bias = UMB__BIAS_SLACK * fmax(*look_up * growth, no_normal * edges[2]);
    if (level == 0 && !umb__is_perspective(frustum)) {
        const double lift = UMB__LIFT_TEXELS(width) * (edges[0] + edges[1]) / (2.0 * width);
        *bias = sqrt(*bias * *bias + lift * lift);
    }
    if (level > 0) {
        *bias *= 2.0;
        *look_up *= 2.0;
    }
}

double umb_frustum_bound_m(const struct umb_frustum_info *frustum, uint32_t level, uint32_t taps)
{
    double bias, look_up;
    parts_of(frustum, level, taps, &bias, &look_up);
    return bias + look_up;
}

static double settings_bound(const struct umb_frustum_info *frustum,
                             const struct umb_query_settings *settings, uint32_t taps)
{
    double bias, look_up, edges[3];
    parts_of(frustum, settings->level, taps, &bias, &look_up);
    umb_frustum_voxel_edges(frustum, edges);
    switch (settings->bias_mode) {
    case UMB_BIAS_AUTO:
        break;
    case UMB_BIAS_VOXELS:
        bias = settings->bias * (edges[0] + edges[1] + edges[2]) / 3.0;
        break;
    case UMB_BIAS_METRES:
        bias = settings->bias;
        break;
    case UMB_BIAS_NONE:
        bias = 0;
        break;
    }
    return bias + look_up;
}

double umb_query_bound_m(const struct umb_asset *asset, const struct umb_query_settings *settings)
{
    const struct umb__content *content = &asset->canonical.content;
    struct umb_query query;
    if (!umb_filter_get_info(settings->filter)->is_window ||
        umb_query_prepare(asset, settings, &query, NULL) != UMB_OK) {
        return 0;
    }
    const struct umb_light_info *light = &content->lights[settings->light];
    double bound = 0;
    for (uint32_t i = 0; i < light->frustum_count; i++) {
        bound = fmax(bound, settings_bound(&content->frusta[light->first_frustum + i], settings,
                                           umb_query_taps(&query)));
    }
    return bound;
}
