/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares penumbras and footprints of the shaders, compiled as C, with those of the core:
 *
 *     gpu_answers ASSET POINTS FILTER TAPS WIDTH    POINTS: float x y z nx ny nz each
 *
 * FILTER: penumbra, WIDTH: angular diameter in radians; or footprint, WIDTH: metres. Prints the
 * number of points, and of those neither lit nor shadowed; the greatest difference and the number
 * of differences above 2^-12 with the core's placement (penumbras only); the same with the shaders'
 * own placement.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "query/perspective.h"
#include "umbrage/asset.h"
#include "umbrage/gpu.h"
#include "umbrage.cuh"

#define SAME 0x1p-12 /* Floats and doubles, where both read the same voxels */

struct race {
    struct umb_asset *asset;
    struct umb_query query;
    struct umb__query q;
    uint4 *entries;
    UmbragePlacement at;
    int taps;
    float width;
    bool is_penumbra;
};

/* Differences from the core. */
struct differences {
    double greatest;
    unsigned long count;
    unsigned long between; /* Number of points that are neither lit nor shadowed */
};

static void add_difference(struct differences *differences, float2 got, float expected)
{
    const double differ =
        fmax(fabs((double)got.x - (double)expected), fabs((double)got.y - (double)expected));
    differences->greatest = fmax(differences->greatest, differ);
    differences->count += !(differ <= SAME);
    differences->between += expected > 0 && expected < 1;
}

/* Answers a penumbra at the place in voxels that the core computes. */
static float2 answer_alike(const struct race *r, const struct umb_points *points, float3 normal)
{
    double v[3];
    uint32_t frustum;
    if (!umb__look_up_at(&r->q, points, 0, v, &frustum)) {
        return make_float2(0, 0);
    }
    const UmbrageLook look = {
        .voxel = make_int3((int)floor(v[0]), (int)floor(v[1]), (int)floor(v[2])),
        .part = make_float3((float)(v[0] - floor(v[0])), (float)(v[1] - floor(v[1])),
                            (float)(v[2] - floor(v[2])))};
    return umbrage_penumbra_at(r->entries, r->at, look, umbrage_slope(r->at, normal), r->taps,
                               r->width);
}

static void compare(const struct race *r, const float point[6], struct differences *alike,
                    struct differences *own)
{
    const struct umb_points points = {.positions = point, .normals = point + 3, .count = 1};
    const float3 position = make_float3(point[0], point[1], point[2]);
    const float3 normal = make_float3(point[3], point[4], point[5]);
    float expected;
    struct umb_answers answers = {.values = &expected};
    umb_query_run(&r->query, &points, 0, 1, &answers);
    if (r->is_penumbra) {
        add_difference(alike, answer_alike(r, &points, normal), expected);
        add_difference(own,
                       umbrage_penumbra(r->entries, r->at, position, normal, r->taps, r->width),
                       expected);
    } else {
        add_difference(own,
                       umbrage_footprint(r->entries, r->at, position, normal, r->taps, r->width),
                       expected);
    }
}

static enum umb_status open_race(struct race *r, char **argv, struct umb_error *error)
{
    struct umb_query_settings settings = {.taps = (uint32_t)strtoul(argv[4], NULL, 10)};
    const struct umb_gpu_view view = {.light = 0};
    struct umb_gpu_placement placement;
    struct umb_gpu_precision precision;
    struct umb_gpu_layout layout;
    r->taps = (int)settings.taps;
    r->width = strtof(argv[5], NULL);
    r->is_penumbra = strcmp(argv[3], "penumbra") == 0;
    settings.filter = r->is_penumbra ? UMB_FILTER_PENUMBRA : UMB_FILTER_FOOTPRINT;
    *(r->is_penumbra ? &settings.light_extent : &settings.footprint_m) = (double)r->width;
    if (umb_asset_open_file(argv[1], NULL, &r->asset, error) != UMB_OK ||
        umb_query_prepare(r->asset, &settings, &r->query, error) != UMB_OK ||
        umb_gpu_layout_make(r->asset, 0, &layout, error) != UMB_OK ||
        umb_gpu_place(r->asset, &view, &placement, &precision, error) != UMB_OK) {
        return error->status;
    }
    memcpy(&r->q, r->query.opaque, sizeof r->q);
    memcpy(&r->at, &placement, sizeof r->at);
    r->entries = malloc((size_t)layout.entries * sizeof *r->entries);
    if (r->entries == NULL) {
        return UMB_E_NO_MEMORY;
    }
    umb_gpu_write(r->asset, NULL, &layout, 0, layout.entries, &r->entries->x);
    return UMB_OK;
}

int main(int argc, char **argv)
{
    struct race r = {.asset = NULL};
    struct umb_error error = {0};
    struct differences alike = {0, 0, 0}, own = {0, 0, 0};
    unsigned long count = 0;
    float point[6];
    if (argc != 6) {
        fprintf(stderr, "usage: gpu_answers ASSET POINTS penumbra|footprint TAPS WIDTH\n");
        return 2;
    }
    if (open_race(&r, argv, &error) != UMB_OK) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    FILE *in = fopen(argv[2], "rb");
    while (in != NULL && fread(point, sizeof point, 1, in) == 1) {
        compare(&r, point, &alike, &own);
        count++;
    }
    printf("%lu %lu %.3g %lu %.3g %lu\n", count, own.between, alike.greatest, alike.count,
           own.greatest, own.count);
    free(r.entries);
    umb_asset_close(r.asset);
    return count > 0 && fclose(in) == 0 ? 0 : 1;
}
