/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The kernels for the target's baseline instruction set, for tests/bench/web_race.py:
 *
 *     base_kernels FILE POINTS
 *
 * POINTS is raw floats, x y z nx ny nz each. Reads lines "box|tent|footprint TAPS" and answers
 * each with two numbers: nanoseconds a point of CPU time, a mean of several passes, and the least
 * pass by the wall clock.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "query/kernels.h"

#define FOOTPRINT_M 2.5 /* Side of a footprint, metres */
#define PASSES      10U /* Passes over the points: the CPU clock may tick every 10 ms */

struct batch {
    struct umb_points points;
    float *positions, *normals, *values;
};

static int read_points(const char *path, struct batch *batch)
{
    FILE *file = fopen(path, "rb");
    float six[6];
    size_t capacity = 1 << 22, count = 0;
    batch->positions = malloc(capacity * 3 * sizeof(float));
    batch->normals = malloc(capacity * 3 * sizeof(float));
    batch->values = malloc(capacity * sizeof(float));
    if (!file || !batch->positions || !batch->normals || !batch->values) {
        return 0;
    }
    while (count < capacity && fread(six, sizeof six, 1, file) == 1) {
        memcpy(batch->positions + 3 * count, six, 3 * sizeof *six);
        memcpy(batch->normals + 3 * count++, six + 3, 3 * sizeof *six);
    }
    (void)fclose(file);
    batch->points = (struct umb_points){
        .positions = batch->positions, .normals = batch->normals, .count = count};
    return count > 0;
}

static double clock_ns(clockid_t clock)
{
    struct timespec now;
    (void)clock_gettime(clock, &now);
    return (double)now.tv_sec * 1e9 + (double)now.tv_nsec;
}

/* Prints the nanoseconds a point: CPU time, a mean of the passes, and the wall clock's least. */
static void measure(const struct umb_asset *asset, const struct batch *batch, const char *filter,
                    unsigned taps)
{
    static const struct umb__kernels base = {umb__kernel_base, umb__tent_base, umb__kernel_coarse,
                                             umb__receivers_base, umb__squares_base};
    const int is_tent = strcmp(filter, "tent") == 0, is_wide = strcmp(filter, "footprint") == 0;
    const struct umb_query_settings settings = {.taps = taps,
                                                .filter = is_tent   ? UMB_FILTER_TENT
                                                          : is_wide ? UMB_FILTER_FOOTPRINT
                                                                    : UMB_FILTER_BOX,
                                                .footprint_m = is_wide ? FOOTPRINT_M : 0};
    struct umb_answers answers = {.values = batch->values};
    struct umb_query query;
    struct umb_error error;
    struct umb__query q;
    if (umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        exit(1);
    }
    memcpy(&q, query.opaque, sizeof q);
    q.kernels = &base;
    const unsigned passes = is_wide ? 1 : PASSES;
    const double begin = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    double least = INFINITY;
    for (unsigned i = 0; i < passes; i++) {
        const double first = clock_ns(CLOCK_MONOTONIC);
        (is_tent   ? umb__tent_base
         : is_wide ? q.run
                   : umb__kernel_base)(&q, &batch->points, 0, batch->points.count, &answers);
        least = fmin(least, clock_ns(CLOCK_MONOTONIC) - first);
    }
    const double cpu = (clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin) / passes;
    const double count = (double)batch->points.count;
    printf("%.3f %.3f\n", cpu / count, least / count);
    (void)fflush(stdout);
}

int main(int argc, char **argv)
{
    struct umb_asset *asset;
    struct batch batch;
    char filter[12];
    unsigned taps;
    if (argc != 3 || umb_asset_open_file(argv[1], NULL, &asset, NULL) != UMB_OK ||
        !read_points(argv[2], &batch)) {
        (void)fprintf(stderr, "usage: base_kernels FILE POINTS\n");
        return 2;
    }
    while (scanf("%11s %u", filter, &taps) == 2) {
        measure(asset, &batch, filter, taps);
    }
    umb_asset_close(asset);
    return 0;
}
