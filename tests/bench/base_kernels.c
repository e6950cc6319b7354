/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The kernels for the target's baseline instruction set, for tests/bench/web_race.py:
 *
 *     base_kernels FILE POINTS
 *
 * POINTS is raw floats, x y z nx ny nz each. Reads lines "box|tent TAPS" and answers each with the
 * nanoseconds of CPU time a point of one pass over the points.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "query/kernels.h"

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

static double cpu_ns(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec * 1e9 + (double)now.tv_nsec;
}

static double measure(const struct umb_asset *asset, const struct batch *batch, const char *filter,
                      unsigned taps)
{
    const int is_tent = strcmp(filter, "tent") == 0;
    const struct umb_query_settings settings = {
        .taps = taps, .filter = is_tent ? UMB_FILTER_TENT : UMB_FILTER_BOX};
    struct umb_answers answers = {.values = batch->values};
    struct umb_query query;
    struct umb_error error;
    struct umb__query q;
    if (umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        exit(1);
    }
    memcpy(&q, query.opaque, sizeof q);
    const double begin = cpu_ns();
    (is_tent ? umb__tent_base : umb__kernel_base)(&q, &batch->points, 0, batch->points.count,
                                                  &answers);
    return (cpu_ns() - begin) / (double)batch->points.count;
}

int main(int argc, char **argv)
{
    struct umb_asset *asset;
    struct batch batch;
    char filter[8];
    unsigned taps;
    if (argc != 3 || umb_asset_open_file(argv[1], NULL, &asset, NULL) != UMB_OK ||
        !read_points(argv[2], &batch)) {
        (void)fprintf(stderr, "usage: base_kernels FILE POINTS\n");
        return 2;
    }
    while (scanf("%7s %u", filter, &taps) == 2) {
        printf("%.3f\n", measure(asset, &batch, filter, taps));
        (void)fflush(stdout);
    }
    umb_asset_close(asset);
    return 0;
}
