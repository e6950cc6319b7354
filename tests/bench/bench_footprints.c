/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Races footprints with windows of 9 taps of the same asset, for lamps and translucent casters;
 * bench-query races them for suns.
 *
 *     bench_footprints [NAME FILE POINTS TEXELS]...
 *
 * POINTS: six floats a point, place and unit normal (`umbrage points --normals`). Those that face
 * light 0 of the asset FILE count. TEXELS: width of a point's footprint in the texels at the point.
 * Each case gives two rows: NAME-gbuffer, the points in the order of the file, and NAME-scattered.
 * In a run each query answers all points, one right after the other, on one core, in CPU time of
 * the thread.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "bench_machine.h"
#include "bench_report.h"
#include "umbrage/query.h"

#define BENCH  "query"
#define FACING 0.2 /* least cosine with the light, as in pictures that are compared with rays */

enum {
    WORDS = 4, /* of a case */
    TAPS = 9
};

struct faces {
    struct umb_light_info light;
    struct umb_frustum_info frusta[6];
    double origin[3];
};

/* Points that face the light; a place in the arrays is three floats. */
struct batch {
    float *places, *normals, *widths, *values;
    size_t count;
};

static void faces_read(const struct umb_asset *asset, struct faces *faces)
{
    struct umb_asset_info info;
    struct umb_error none = {0};
    umb_asset_get_info(asset, &info);
    memcpy(faces->origin, info.origin, sizeof faces->origin);
    bench_must(umb_asset_get_light(asset, 0, &faces->light), &none, "light 0");
    for (uint32_t i = 0; i < faces->light.frustum_count; i++) {
        const uint32_t index = faces->light.first_frustum + i;
        bench_must(umb_asset_get_frustum(asset, index, &faces->frusta[i]), &none, "frustum");
    }
}

/* Returns the width of a texel at a point in metres, in the frustum that answers for the point. */
static double texel_m(const struct faces *faces, const double point[3])
{
    double local[3], farthest = 0, width = 0;
    umb__subtract(point, faces->origin, local);
    for (uint32_t i = 0; i < faces->light.frustum_count; i++) {
        const struct umb_frustum_info *face = &faces->frusta[i];
        const double w = umb__affine(face->world_to_voxel[3], local);
        if (w > farthest) {
            farthest = w;
            width = w * (umb__length(face->voxel_step[0]) + umb__length(face->voxel_step[1])) / 2;
        }
    }
    return width;
}

static int is_facing(const struct umb_light_info *light, const double point[3],
                     const double normal[3])
{
    double away[3];
    if (light->kind == UMB_LIGHT_DIRECTIONAL) {
        memcpy(away, light->direction, sizeof away);
    } else {
        umb__subtract(point, light->position, away);
    }
    return -umb__dot(normal, away) > FACING * umb__length(away);
}

static void batch_read(const char *path, const struct faces *faces, double texels,
                       struct batch *batch)
{
    float row[6];
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        bench_fail("%s cannot be read", path);
    }
    const size_t most = (size_t)ftell(file) / sizeof row;
    rewind(file);
    batch->places = calloc(most + 1, 3 * sizeof(float));
    batch->normals = calloc(most + 1, 3 * sizeof(float));
    batch->widths = calloc(most + 1, sizeof(float));
    batch->values = calloc(most + 1, sizeof(float));
    if (!batch->places || !batch->normals || !batch->widths || !batch->values) {
        bench_fail("%zu points: out of memory", most);
    }
    while (batch->count < most && fread(row, sizeof row, 1, file) == 1) {
        const double point[3] = {row[0], row[1], row[2]}, normal[3] = {row[3], row[4], row[5]};
        const size_t i = batch->count;
        if (is_facing(&faces->light, point, normal)) {
            memcpy(batch->places + 3 * i, row, 3 * sizeof row[0]);
            memcpy(batch->normals + 3 * i, row + 3, 3 * sizeof row[0]);
            batch->widths[i] = (float)(texels * texel_m(faces, point));
            batch->count++;
        }
    }
    (void)fclose(file);
    if (batch->count < 1000) {
        bench_fail("%s: %zu points face the light", path, batch->count);
    }
}

static void batch_finish(struct batch *batch)
{
    free(batch->places);
    free(batch->normals);
    free(batch->widths);
    free(batch->values);
}

static void swap(float *values, size_t a, size_t b, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        const float value = values[size * a + k];
        values[size * a + k] = values[size * b + k];
        values[size * b + k] = value;
    }
}

/* Puts the points into a random order, always the same. */
static void batch_scatter(struct batch *batch)
{
    uint64_t state = 1;
    for (size_t i = batch->count - 1; i > 0; i--) {
        state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        const size_t other = (size_t)((state >> 33) % (i + 1));
        swap(batch->places, i, other, 3);
        swap(batch->normals, i, other, 3);
        swap(batch->widths, i, other, 1);
    }
}

static void race(const char *name, const struct umb_asset *asset, const struct batch *batch)
{
    struct umb_query queries[2];
    struct umb_error error;
    struct bench_samples ratios = {0}, ns[2] = {{.count = 0}};
    const struct umb_points points = {.positions = batch->places,
                                      .normals = batch->normals,
                                      .footprints = batch->widths,
                                      .format = UMB_POINT_F32,
                                      .count = batch->count};
    for (int k = 0; k < 2; k++) {
        const struct umb_query_settings settings = {
            .taps = k == 0 ? TAPS : 1, /* footprints as pictures ask them */
            .filter = k == 0 ? UMB_FILTER_BOX : UMB_FILTER_FOOTPRINT};
        bench_must(umb_query_prepare(asset, &settings, &queries[k], &error), &error, name);
    }
    while (ratios.count < BENCH_RUNS_MAX) {
        double seconds[2];
        for (int k = 0; k < 2; k++) {
            struct umb_points asked = points;
            asked.footprints = k == 0 ? NULL : points.footprints;
            struct umb_answers answers = {.values = batch->values};
            const double start = bench_cpu_s();
            umb_query_run(&queries[k], &asked, 0, batch->count, &answers);
            seconds[k] = bench_cpu_s() - start;
            bench_add(&ns[k], 1e9 * seconds[k] / (double)batch->count);
        }
        bench_add(&ratios, seconds[1] / seconds[0]);
    }
    bench_row(BENCH, name, "footprint_vs_pcf9", "lower", &ratios);
    bench_say("%s: %zu points, 9 taps %.1f ns, footprints %.1f ns", name, batch->count,
              bench_median(&ns[0]), bench_median(&ns[1]));
}

static void run(char **words)
{
    struct umb_asset *asset;
    struct umb_error error;
    struct faces faces;
    struct batch batch = {0};
    bench_must(umb_asset_open_file(words[1], NULL, &asset, &error), &error, words[1]);
    faces_read(asset, &faces);
    batch_read(words[2], &faces, strtod(words[3], NULL), &batch);
    race(bench_text("%s-gbuffer", words[0]), asset, &batch);
    batch_scatter(&batch);
    race(bench_text("%s-scattered", words[0]), asset, &batch);
    batch_finish(&batch);
    umb_asset_close(asset);
}

int main(int argc, char **argv)
{
    if (argc == 1 || argc % WORDS != 1) {
        (void)fprintf(stderr, "usage: bench_footprints [NAME FILE POINTS TEXELS]...\n");
        return 2;
    }
    (void)bench_pin(0);
    for (int i = 1; i < argc; i += WORDS) {
        run(argv + i);
    }
    return 0;
}
