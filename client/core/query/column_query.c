/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The first occluder of a column: down the light's axis from cube to cube, over lit ones in one
 * step, to the first shadowed voxel. Ends: each step goes at least one brick further. In closed
 * frusta the front knows the columns where something undefined comes before that voxel.
 */
#include "format/front.h"
#include "query/volume_parts.h"

/* First shadowed slice of a column in a brick, from slice z on; 8 if there is none. */
static uint32_t first_shadowed(const uint64_t brick[8], uint32_t x, uint32_t y, uint32_t z)
{
    while (z < 8 && umb__brick_voxel(brick, x, y, z)) {
        z++;
    }
    return z;
}

static uint32_t lit_depth(const struct umb__tree *tree, uint32_t x, uint32_t y,
                          struct umb_volume_stats *stats)
{
    uint32_t size = (uint32_t)1 << tree->log2_size, z = 0;
    while (z < size) {
        struct umb__place place = umb__tree_locate(tree, x, y, z, stats);
        uint32_t side = (uint32_t)1 << place.level;
        if (place.brick) {
            uint32_t slice = first_shadowed(place.brick, x, y, z & 7);
            if (slice < 8) {
                return (z & ~(uint32_t)7) + slice;
            }
        } else if (!place.lit) {
            return z;
        }
        z = (z & -side) + side;
    }
    return size;
}

enum umb_status umb_columns_check(const struct umb_volume *volume, struct umb_error *error)
{
    const struct umb__volume v = umb__volume_of(volume);
    if (v.closed && !v.front) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "columns: light %u was baked under the closed rule, which leaves out the "
                        "depth of first occluders; bake with --effect front=on, or --closed off",
                        v.light);
    }
    return UMB_OK;
}

void umb_columns_run(const struct umb_volume *volume, const struct umb_points *points, size_t first,
                     size_t count, struct umb_column_answers *answers)
{
    const struct umb__volume v = umb__volume_of(volume);
    const double *step = v.voxel_step[2];
    const double step_m = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
    const uint32_t size = (uint32_t)1 << v.tree.log2_size;
    for (size_t i = first; i < first + count; i++) {
        double p[3], at[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] = points->origin[axis] - v.origin[axis] +
                      umb__scalar_at(points->positions, points->format, 3 * i + axis);
        }
        umb__volume_to_voxel(&v, p, at);
        struct umb_column_answer answer = {.lit = size, .distance_m = INFINITY};
        /* False for NaN too, which then touches nothing. */
        bool inside = at[0] >= 0 && at[0] < size && at[1] >= 0 && at[1] < size;
        answer.outside = !inside;
        if (inside) {
            const uint32_t x = (uint32_t)at[0], y = (uint32_t)at[1];
            if (v.front == NULL ||
                !umb__front_find(v.front, v.front_root, v.tree.log2_size, x, y, &answer.lit)) {
                answer.lit = lit_depth(&v.tree, x, y, &answers->stats);
            }
        }
        if (answer.lit < size) {
            answer.distance_m = ((double)answer.lit - at[2]) * step_m;
        }
        answers->columns[i] = answer;
    }
}
