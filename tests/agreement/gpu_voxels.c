/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writes where the core looks points up, for tests of shaders:
 *
 *     gpu_voxels ASSET POINTS LIGHT TAPS LEVEL FILE    POINTS: float x y z nx ny nz each
 *
 * FILE: for each point int32 x, y, z of its voxel, 1 if it faces away, then two floats: distances
 * in voxels to the nearest border on x and y, and in depth. Points at which the bias changes from
 * one way to the other have distances of 0.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "query/perspective.h"
#include "umbrage/asset.h"

struct place {
    int32_t voxel[3], faces_away;
    float across, depth;
};

static double to_border(double v)
{
    return fabs(v - nearbyint(v));
}

/* Returns true where floats may choose the other way of the automatic bias. */
static bool is_at_branch(const struct umb__query *q, const float normal[3])
{
    const double n[3] = {(double)normal[0], (double)normal[1], (double)normal[2]};
    double along[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        along[axis] = umb__dot(n, q->voxel_step[axis]);
    }
    const double across = fabs(along[0]) + fabs(along[1]);
    const double need = 0.5 * UMB__BIAS_SLACK * (q->taps * across + fabs(along[2]));
    const double most = umb__longest_lift(q) * fabs(along[2]);
    return fabs(need - most) < 1e-5 * need || fabs(umb__dot(n, q->direction)) < 1e-5;
}

static struct place place_of(const struct umb__query *q, const float point[6])
{
    const struct umb_points points = {.positions = point, .normals = point + 3, .count = 1};
    struct place place = {.voxel = {0}};
    double v[3];
    uint32_t frustum;
    place.faces_away = !umb__look_up_at(q, &points, 0, v, &frustum);
    for (unsigned k = 0; k < 3 && !place.faces_away; k++) {
        place.voxel[k] = (int32_t)fmin(fmax(floor(v[k]), -1e9), 1e9);
    }
    if (!place.faces_away && !is_at_branch(q, point + 3)) {
        place.across = (float)fmin(to_border(v[0]), to_border(v[1]));
        place.depth = (float)to_border(v[2]);
    }
    return place;
}

int main(int argc, char **argv)
{
    struct umb_asset *asset = NULL;
    struct umb_query query;
    struct umb__query q;
    struct umb_error error = {0};
    if (argc != 7) {
        fprintf(stderr, "usage: gpu_voxels ASSET POINTS LIGHT TAPS LEVEL FILE\n");
        return 2;
    }
    const struct umb_query_settings settings = {.light = (uint32_t)strtoul(argv[3], NULL, 10),
                                                .taps = (uint32_t)strtoul(argv[4], NULL, 10),
                                                .level = (uint32_t)strtoul(argv[5], NULL, 10)};
    if (umb_asset_open_file(argv[1], NULL, &asset, &error) != UMB_OK ||
        umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    memcpy(&q, query.opaque, sizeof q);
    FILE *in = fopen(argv[2], "rb"), *out = fopen(argv[6], "wb");
    float point[6];
    bool good = in != NULL && out != NULL;
    while (good && fread(point, sizeof point, 1, in) == 1) {
        const struct place place = place_of(&q, point);
        good = fwrite(&place, sizeof place, 1, out) == 1;
    }
    good = good && fclose(out) == 0;
    umb_asset_close(asset);
    return good ? 0 : 1;
}
