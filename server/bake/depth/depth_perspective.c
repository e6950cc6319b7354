/* SPDX-License-Identifier: Apache-2.0 */
/* Preparing triangles of spot and point lights. */
#include "bake/depth/depth_perspective.h"

/* Greatest width of a sliver, in texels over size^2. */
#define SLIVER 0x1p-49

void umbb_perspective_steady(const struct umbb_rays *rays, const double corners[3][3],
                             struct umbb_coverage *coverage)
{
    const double(*v)[3] = corners;
    double longest[3] = {0.0, 0.0, 0.0}, square = 0.0;
    for (int i = 0; i < 3; i++) {
        const double *a = v[i], *b = v[(i + 1) % 3];
        const double x = b[0] - a[0], y = b[1] - a[1];
        if (x * x + y * y > square) {
            square = x * x + y * y;
            longest[0] = x;
            longest[1] = y;
            longest[2] = b[2] - a[2];
        }
    }
    const double area =
        (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]) - (v[1][1] - v[0][1]) * (v[2][0] - v[0][0]);
    const double width = SLIVER * rays->size * rays->size;
    if (area * area < width * width * square) {
        coverage->gradient_x = longest[2] * longest[0] / square;
        coverage->gradient_y = longest[2] * longest[1] / square;
    }
}

int umbb_perspective_prepare(const struct umbb_casters *casters, size_t triangle,
                             struct umbb_coverage *coverage)
{
    const struct umbb_rays rays = umbb_rays_of(casters);
    if (!umbb_coverage_prepare(casters->corners[triangle], casters->size, coverage)) {
        return 0;
    }
    if (umbb_rays_meet(&rays)) {
        umbb_perspective_steady(&rays, casters->corners[triangle], coverage);
    }
    return 1;
}
