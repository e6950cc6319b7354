/* SPDX-License-Identifier: Apache-2.0 */
/* See first_occluder.h. */
#include "query/first_occluder.h"

#include "format/occluder_depth.h"

/* Finds the first shadowed voxel of a column by bisection. In: high: a shadowed voxel. The search
 * ends on any tree, because the range shrinks. */
static uint32_t first_shadowed(struct umb__occluders *s, uint32_t x, uint32_t y, uint32_t high)
{
    uint32_t low = 0, probe = s->last < high ? s->last : high / 2;
    while (low < high) {
        const struct umb__place place = umb__tree_locate(&s->tree, x, y, probe, &s->read);
        const uint32_t side = (uint32_t)1 << place.level, from = probe & -side;
        const uint32_t lit = place.brick ? umb__brick_depth(place.brick, x, y, 0)
                             : place.lit ? side
                                         : 0;
        if (lit == 0) {
            high = from;
        } else if (lit == side) {
            low = from + side;
        } else {
            return from + lit < high ? from + lit : high;
        }
        probe = low + (high - low) / 2;
    }
    return high;
}

static bool find(struct umb__occluders *s, uint32_t x, uint32_t y, uint32_t limit, uint32_t *depth)
{
    if (s->occluder_depth != NULL &&
        umb__occluder_depth_find(s->occluder_depth, s->occluder_depth_root, s->tree.log2_size, x, y,
                                 depth)) {
        return *depth <= limit;
    }
    const struct umb__place place = umb__tree_locate(&s->tree, x, y, limit, &s->read);
    if (place.brick ? umb__brick_voxel(place.brick, x, y, limit) : place.lit) {
        return false;
    }
    *depth = first_shadowed(s, x, y, limit);
    return true;
}

bool umb__first_occluder(struct umb__occluders *occluders, uint32_t x, uint32_t y, uint32_t limit,
                         uint32_t *depth)
{
    const bool found = find(occluders, x, y, limit, depth);
    occluders->last = found ? *depth : occluders->last;
    return found;
}
