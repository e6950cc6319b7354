/* SPDX-License-Identifier: Apache-2.0 */
/* Clips by one plane after the other; each may add one corner. */
#include "bake/analysis/eye_clip.h"

#include <string.h>

enum {
    PLANES = 5,
};

/* Distance of a point inside plane number `plane`, negative outside. */
static double inside(const struct umbb_pyramid *pyramid, int plane, const double p[3])
{
    switch (plane) {
    case 0:
        return p[2] - pyramid->near;
    case 1:
        return p[0] - pyramid->low[0] * p[2];
    case 2:
        return pyramid->high[0] * p[2] - p[0];
    case 3:
        return p[1] - pyramid->low[1] * p[2];
    default:
        return pyramid->high[1] * p[2] - p[1];
    }
}

/* Computes the place where the edge from a to b crosses the plane. in, out: distances of a and b
 * from the plane: above 0 for a, which is inside, below 0 for b. */
static void cut(const double a[3], const double b[3], double in, double out, double to[3])
{
    const double share = in / (in - out);
    for (int k = 0; k < 3; k++) {
        to[k] = a[k] + share * (b[k] - a[k]);
    }
}

static void cut_polygon(const struct umbb_pyramid *pyramid, int plane,
                        const struct umbb_polygon *from, struct umbb_polygon *to)
{
    to->count = 0;
    for (size_t i = 0; i < from->count; i++) {
        const double *a = from->corners[i], *b = from->corners[(i + 1) % from->count];
        const double in_a = inside(pyramid, plane, a), in_b = inside(pyramid, plane, b);
        if (in_a >= 0.0) {
            memcpy(to->corners[to->count++], a, sizeof to->corners[0]);
        }
        if (in_a >= 0.0 && in_b < 0.0) {
            cut(a, b, in_a, in_b, to->corners[to->count++]);
        } else if (in_a < 0.0 && in_b >= 0.0) {
            cut(b, a, in_b, in_a, to->corners[to->count++]);
        }
    }
}

void umbb_eye_clip(const struct umbb_pyramid *pyramid, const double triangle[3][3],
                   struct umbb_polygon *polygon)
{
    polygon->count = 3;
    memcpy(polygon->corners, triangle, 9 * sizeof(double));
    for (int plane = 0; plane < PLANES && polygon->count > 0; plane++) {
        int outside = 0;
        for (size_t i = 0; i < polygon->count; i++) {
            outside += inside(pyramid, plane, polygon->corners[i]) < 0.0;
        }
        if (outside == (int)polygon->count) {
            polygon->count = 0;
        } else if (outside > 0) {
            const struct umbb_polygon before = *polygon;
            cut_polygon(pyramid, plane, &before, polygon);
        }
    }
    polygon->count = polygon->count < 3 ? 0 : polygon->count;
}
