/* SPDX-License-Identifier: Apache-2.0 */
/* Races footprints and tents with boxes; see bench_filters.h. In a run each query answers all
 * points, one right after the other, on one core, in CPU time of the thread. */
#include "bench_filters.h"

#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "bench_machine.h"
#include "bench_report.h"
#include "umbrage/query.h"

#define BENCH "query"

enum {
    BOX_9,
    BOX_17,
    TENT_9,
    TENT_17,
    FOOTPRINTS, /* The first of four footprints ... */
    QUERIES = FOOTPRINTS + 4,
    FILTER_TEXELS =
        24 /* ... and the width of the second, in texels; each is twice the one before */
};

static void queries_prepare(const struct bench_scene *scene, const struct bench_asset *asset,
                            struct umb_query queries[QUERIES])
{
    const double(*step)[3] = scene->frustum.voxel_step;
    const double texel_m = (umb__length(step[0]) + umb__length(step[1])) / 2;
    for (int k = 0; k < QUERIES; k++) {
        struct umb_query_settings settings = {.taps = 9};
        struct umb_error error;
        if (k >= FOOTPRINTS) {
            settings.filter = UMB_FILTER_FOOTPRINT;
            settings.footprint_m = texel_m * FILTER_TEXELS / 2 * (1 << (k - FOOTPRINTS));
        } else {
            settings.filter = k < TENT_9 ? UMB_FILTER_BOX : UMB_FILTER_TENT;
            settings.taps = k == BOX_9 || k == TENT_9 ? 9 : 17;
        }
        bench_must(umb_query_prepare(asset->asset, &settings, &queries[k], &error), &error,
                   "filters");
    }
}

void bench_filters_race(const char *name, const struct bench_scene *scene,
                        const struct bench_asset *asset, const struct bench_points *points)
{
    static const struct {
        const char *figure;
        int ours, box;
    } rows[] = {{"footprint_vs_pcf9", FOOTPRINTS + 1, BOX_9},
                {"tent_vs_box", TENT_9, BOX_9},
                {"tent17_vs_box17", TENT_17, BOX_17}};
    enum {
        ROWS = sizeof rows / sizeof rows[0]
    };
    struct umb_query queries[QUERIES];
    struct bench_samples times[QUERIES] = {0}, ratios[ROWS] = {0};
    struct umb_points batch = {.positions = points->surface,
                               .normals = points->normals,
                               .format = UMB_POINT_F32,
                               .count = points->count};
    float *values = calloc(points->count, sizeof *values);
    if (values == NULL) {
        bench_fail("%zu answers: out of memory", points->count);
    }
    memcpy(batch.origin, scene->origin, sizeof batch.origin);
    queries_prepare(scene, asset, queries);
    while (times[0].count < BENCH_RUNS) {
        double seconds[QUERIES];
        for (int k = 0; k < QUERIES; k++) {
            struct umb_answers answers = {.values = values};
            const double start = bench_cpu_s();
            umb_query_run(&queries[k], &batch, 0, points->count, &answers);
            seconds[k] = (bench_cpu_s() - start) / (double)points->count;
            bench_add(&times[k], seconds[k]);
        }
        for (int r = 0; r < ROWS; r++) {
            bench_add(&ratios[r], seconds[rows[r].ours] / seconds[rows[r].box]);
        }
    }
    /* A pixel nearer to the camera is narrower than a window; its footprint is then the window. */
    for (int r = strcmp(points->name, "gbuffer-overview") == 0 ? 0 : 1; r < ROWS; r++) {
        bench_row(BENCH, name, rows[r].figure, "lower", &ratios[r]);
    }
    bench_say("%s: ns a point with normals: boxes of 9 and 17 taps %.1f %.1f, tents %.1f %.1f, "
              "footprints of %d, %d, %d and %d texels %.1f %.1f %.1f %.1f",
              name, 1e9 * bench_median(&times[BOX_9]), 1e9 * bench_median(&times[BOX_17]),
              1e9 * bench_median(&times[TENT_9]), 1e9 * bench_median(&times[TENT_17]),
              FILTER_TEXELS / 2, FILTER_TEXELS, 2 * FILTER_TEXELS, 4 * FILTER_TEXELS,
              1e9 * bench_median(&times[FOOTPRINTS]), 1e9 * bench_median(&times[FOOTPRINTS + 1]),
              1e9 * bench_median(&times[FOOTPRINTS + 2]),
              1e9 * bench_median(&times[FOOTPRINTS + 3]));
    free(values);
}
