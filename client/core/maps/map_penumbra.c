/* SPDX-License-Identifier: Apache-2.0 */
/* Penumbra widths; see map_penumbra.h. */
#include "maps/map_penumbra.h"

#include <math.h>

double umb__penumbra_texels(const struct umb__map_query *query,
                            const struct umb__receiver *receiver, double blocker_depth)
{
    const struct umb_map_frustum *frustum = &query->map->frustum;
    const double limit = query->filter.width;
    const double behind_m = (receiver->depth - blocker_depth) * frustum->depth_m;
    double width_m = query->filter.light_size * behind_m;
    if (frustum->directional) {
        width_m = 2.0 * tan(0.5 * query->filter.light_size) * behind_m;
    } else {
        const double distance_m = frustum->near_m + blocker_depth * frustum->depth_m;
        if (!(distance_m > 0.0)) {
            return limit;
        }
        width_m /= distance_m;
    }
    const double texels = width_m * receiver->texels_per_m;
    if (!(texels > 1.0)) {
        return 1.0;
    }
    return texels < limit ? texels : limit;
}
