/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Finds the first occluder of a column. A walk goes along the light's axis from cube to cube,
 * crosses each lit cube in one step, and stops at the first shadowed voxel. It ends, since each
 * step goes at least one brick further. In frusta baked under the closed rule, undefined voxels may
 * come before that voxel; for those columns the occluder depth map has the answer.
 */
#include "format/occluder_depth.h"
#include "query/volume_parts.h"

/* Returns the number of lit voxels before the first shadowed one of a column. */
static uint32_t lit_depth(const struct umb__tree *tree, uint32_t x, uint32_t y,
                          struct umb_volume_stats *stats)
{
    uint32_t size = (uint32_t)1 << tree->log2_size, z = 0;
    while (z < size) {
        struct umb__place place = umb__tree_locate(tree, x, y, z, stats);
        uint32_t side = (uint32_t)1 << place.level;
        if (place.brick) {
            uint32_t slice = umb__brick_depth(place.brick, x, y, z & 7);
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

enum umb_status umb_volume_check_columns(const struct umb_volume *volume, struct umb_error *error)
{
    const struct umb__volume v = umb__volume_of(volume);
    if (v.closed && !v.occluder_depth) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "light %u was baked under the closed rule, which leaves out the "
                        "depth of first occluders; bake with --effect front=on, or --closed off",
                        v.light);
    }
    return UMB_OK;
}

/* A point in voxel space, and the length of a voxel of depth there. */
struct spot {
    uint32_t face;
    double at[3];  /* Place in voxel space; far outside if no face covers the point */
    double step_m; /* Metres along the light a voxel of depth */
};

/* Places a point under a spot or point light in the face along whose axis p is farthest. Along the
 * ray of the point, distances in metres are proportional to W. */
static struct spot spot_of(const struct umb__volume *v, const double p[3])
{
    struct spot spot = {.at = {-1, -1, 0}};
    double best = 0, scale, offset, ray[3];
    for (uint32_t i = 0; i < v->face_count; i++) {
        double w = umb__affine(v->faces[i].world_to_voxel[3], p);
        if (w > best) {
            best = w;
            spot.face = i;
        }
    }
    if (!(best > 0)) {
        return spot;
    }
    const double(*m)[4] = v->faces[spot.face].world_to_voxel;
    umb__face_depth(&v->faces[spot.face], &scale, &offset);
    umb__subtract(p, v->position, ray);
    spot.at[0] = umb__affine(m[0], p) / best;
    spot.at[1] = umb__affine(m[1], p) / best;
    spot.at[2] = umb__affine(m[2], p);
    spot.step_m = scale * umb__length(ray) / best;
    return spot;
}

static struct umb_column_answer ask_column(const struct umb__volume *v, const struct spot *spot,
                                           struct umb_volume_stats *stats)
{
    const struct umb__tree tree = umb__volume_tree(v, spot->face);
    const uint32_t size = (uint32_t)1 << tree.log2_size;
    const double *at = spot->at;
    struct umb_column_answer answer = {.lit = size, .distance_m = INFINITY};
    /* False also for NaN, which then covers no voxel. */
    bool inside = at[0] >= 0 && at[0] < size && at[1] >= 0 && at[1] < size;
    answer.outside = !inside;
    if (inside) {
        const uint32_t x = (uint32_t)at[0], y = (uint32_t)at[1];
        if (v->occluder_depth == NULL ||
            !umb__occluder_depth_find(v->occluder_depth, v->occluder_depth_roots[spot->face],
                                      tree.log2_size, x, y, &answer.lit)) {
            answer.lit = lit_depth(&tree, x, y, stats);
        }
    }
    if (answer.lit < size) {
        answer.distance_m = ((double)answer.lit - at[2]) * spot->step_m;
    }
    return answer;
}

void umb_volume_columns(const struct umb_volume *volume, const struct umb_points *points,
                        size_t first, size_t count, struct umb_column_answers *answers)
{
    const struct umb__volume v = umb__volume_of(volume);
    const double step_m = umb__length(v.voxel_step[2]);
    for (size_t i = first; i < first + count; i++) {
        double p[3];
        struct spot spot = {.step_m = step_m};
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] = points->origin[axis] - v.origin[axis] + umb__coordinate(points, i, axis);
        }
        if (v.face_count > 0) {
            spot = spot_of(&v, p);
        } else {
            umb__volume_to_voxel(&v, p, spot.at);
        }
        answers->columns[i] = ask_column(&v, &spot, &answers->stats);
    }
}
