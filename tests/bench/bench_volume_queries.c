/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Measures what segments, columns and boxes cost: in process, nanoseconds a record on one thread;
 * over a daemon, microseconds a call for one record and for many.
 *
 *     bench_volume_queries FILE [ADDRESS ASSET]      the asset is that of the file
 *
 * Records are drawn in the casters' box: segments as long as a tenth and as all of it, columns
 * anywhere, boxes of eight voxels a side. The least of three runs counts.
 */
#define _POSIX_C_SOURCE 200809L /* clocks */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "umbrage/volume_queries.h"

enum {
    MANY = 10000,
    RUNS = 3,
    CALLS = 2000
};

struct bench {
    struct umb_asset_info info;
    struct umb_volume volume;
    struct umb_client *client; /* NULL: in process */
    struct umb_volume_query volume_query;
    double (*ends)[6];
    struct umb_segment_answer *segments;
    struct umb_column_answer *columns;
    struct umb_box_answer *boxes;
    struct umb_box *corners;
    uint64_t seed;
};

enum kind {
    SEGMENTS,
    COLUMNS,
    BOXES
};

/* In process the thread's CPU time is measured, with a daemon the wall-clock time. */
static double now_s(const struct bench *bench)
{
    struct timespec now;
    (void)clock_gettime(bench->client ? CLOCK_MONOTONIC : CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double next_unit(struct bench *bench)
{
    uint64_t z = bench->seed += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

/* Makes pairs of points. `length` says how far the second point is from the first on each axis. */
static void draw(struct bench *bench, const double length_m[3])
{
    for (size_t i = 0; i < MANY; i++) {
        for (size_t k = 0; k < 3; k++) {
            const double low = bench->info.bounds.min[k], high = bench->info.bounds.max[k];
            bench->ends[i][k] = low + next_unit(bench) * (high - low);
            bench->ends[i][3 + k] =
                bench->ends[i][k] + (next_unit(bench) < 0.5 ? -1 : 1) * length_m[k];
        }
    }
}

static void demand(enum umb_status status, const struct umb_error *error)
{
    if (status != UMB_OK) {
        (void)fprintf(stderr, "bench_volume_queries: %s\n", error->message);
        exit(1);
    }
}

static void ask(struct bench *bench, enum kind kind, size_t count)
{
    struct umb_error error = {0};
    const struct umb_segments pairs = {
        .ends = bench->ends, .format = UMB_POINT_F64, .count = count};
    /* Columns use every second end point. */
    const struct umb_points points = {
        .positions = bench->ends, .format = UMB_POINT_F64, .count = count};
    struct umb_segment_answers segments = {.segments = bench->segments};
    struct umb_column_answers columns = {.columns = bench->columns};
    struct umb_box_answers boxes = {.boxes = bench->boxes};
    if (kind == SEGMENTS && bench->client) {
        demand(umb_client_segments(bench->client, &bench->volume_query, &pairs, &segments, NULL,
                                   NULL, &error),
               &error);
    } else if (kind == SEGMENTS) {
        umb_volume_segments(&bench->volume, &pairs, 0, count, &segments);
    } else if (kind == COLUMNS && bench->client) {
        demand(umb_client_columns(bench->client, &bench->volume_query, &points, &columns, NULL,
                                  NULL, &error),
               &error);
    } else if (kind == COLUMNS) {
        umb_volume_columns(&bench->volume, &points, 0, count, &columns);
    } else if (bench->client) {
        umb_boxes_from_corners(&pairs, 0, count, bench->corners);
        demand(umb_client_boxes(bench->client, &bench->volume_query, bench->corners, count, &boxes,
                                NULL, NULL, &error),
               &error);
    } else {
        umb_boxes_from_corners(&pairs, 0, count, bench->corners);
        demand(umb_volume_boxes(&bench->volume, bench->corners, 0, count, NULL, &boxes, &error),
               &error);
    }
}

/* Returns the least time in seconds, of some runs, that `calls` calls of `count` records take. */
static double least_s(struct bench *bench, enum kind kind, size_t count, size_t calls)
{
    double least = INFINITY;
    for (int run = 0; run < RUNS; run++) {
        const double from = now_s(bench);
        for (size_t i = 0; i < calls; i++) {
            ask(bench, kind, count);
        }
        least = fmin(least, now_s(bench) - from);
    }
    return least;
}

static void measure(struct bench *bench, const char *name, enum kind kind, const double length_m[3],
                    struct umb_client *client)
{
    draw(bench, length_m);
    bench->client = NULL;
    const double here_s = least_s(bench, kind, MANY, 1);
    printf("%-34s %10.0f ns", name, 1e9 * here_s / MANY);
    if (client != NULL) {
        bench->client = client;
        printf(", a call of one %6.1f us, of %d %8.2f ms",
               1e6 * least_s(bench, kind, 1, CALLS) / CALLS, MANY,
               1e3 * least_s(bench, kind, MANY, 1));
    }
    printf("\n");
}

int main(int argc, char **argv)
{
    struct bench bench = {.seed = 1};
    struct umb_error error = {0};
    struct umb_asset *asset;
    struct umb_client *client = NULL;
    struct umb_frustum_info frustum;
    double tenth[3], whole[3], few[3], edges[3];
    if (argc != 2 && argc != 4) {
        (void)fprintf(stderr, "usage: bench_volume_queries FILE [ADDRESS ASSET]\n");
        return 2;
    }
    demand(umb_asset_open_file(argv[1], NULL, &asset, &error), &error);
    umb_asset_get_info(asset, &bench.info);
    demand(umb_volume_prepare(asset, 0, &bench.volume, &error), &error);
    demand(umb_volume_check_columns(&bench.volume, &error), &error);
    if (argc == 4) {
        demand(umb_client_open(argv[2], NULL, &client, &error), &error);
        bench.volume_query.asset = argv[3];
    }
    bench.ends = calloc(MANY, sizeof *bench.ends);
    bench.segments = calloc(MANY, sizeof *bench.segments);
    bench.columns = calloc(MANY, sizeof *bench.columns);
    bench.boxes = calloc(MANY, sizeof *bench.boxes);
    bench.corners = calloc(MANY, sizeof *bench.corners);
    if (!bench.ends || !bench.segments || !bench.columns || !bench.boxes || !bench.corners ||
        umb_asset_get_frustum(asset, 0, &frustum) != UMB_OK) {
        return 1;
    }
    umb_frustum_voxel_edges(&frustum, edges);
    for (size_t k = 0; k < 3; k++) {
        whole[k] = bench.info.bounds.max[k] - bench.info.bounds.min[k];
        tenth[k] = 0.1 * whole[k];
        few[k] = 8 * edges[k];
    }
    measure(&bench, "segments of a tenth of the scene", SEGMENTS, tenth, client);
    measure(&bench, "segments across the scene", SEGMENTS, whole, client);
    measure(&bench, "columns", COLUMNS, tenth, client);
    measure(&bench, "boxes of 8 voxels a side", BOXES, few, client);
    umb_client_close(client);
    umb_asset_close(asset);
    free(bench.ends);
    free(bench.segments);
    free(bench.columns);
    free(bench.boxes);
    free(bench.corners);
    return 0;
}
