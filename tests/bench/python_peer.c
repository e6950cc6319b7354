/* SPDX-License-Identifier: Apache-2.0 */
/*
 * python_peer ASSET POINTS THREADS BATCH: the C program that bench_python.py races. Answers the raw
 * floats of the file POINTS in batches of BATCH points on THREADS threads, once for each line of
 * stdin, and prints the seconds by the clock and of processors.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <umbrage/file.h>
#include <umbrage/query.h>

struct share {
    const struct umb_query *query;
    struct umb_points points;
    float *values;
    size_t batch, first, end;
};

static double now_s(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Answers a share of the points batch by batch, as a program would that receives batches one at a
 * time. */
static void *answer(void *user)
{
    struct share *share = user;
    const float *positions = share->points.positions;
    for (size_t first = share->first; first < share->end; first += share->batch) {
        const size_t left = share->end - first, count = left < share->batch ? left : share->batch;
        const struct umb_points part = {.positions = positions + 3 * first, .count = count};
        struct umb_answers answers = {.values = share->values + first};
        struct umb_error error;
        if (umb_points_check(&part, &error) != UMB_OK) {
            abort();
        }
        umb_query_run(share->query, &part, 0, count, &answers);
    }
    return NULL;
}

int main(int argc, char **argv)
{
    struct umb_error error = {.message = "usage: python_peer ASSET POINTS THREADS BATCH"};
    const struct umb_query_settings settings = {.taps = 9};
    struct umb_file file;
    struct umb_asset *asset;
    struct umb_query query;
    if (argc != 5 || umb_asset_open_file(argv[1], NULL, &asset, &error) != UMB_OK ||
        umb_file_open(argv[2], &file, &error) != UMB_OK ||
        umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 2;
    }
    const size_t count = file.size / (3 * sizeof(float)),
                 threads = (size_t)strtoul(argv[3], NULL, 10);
    struct share shares[16];
    float *values = calloc(count, sizeof *values);
    if (values == NULL || threads < 1 || threads > 16) {
        return 2;
    }
    for (char line[8]; fgets(line, sizeof line, stdin) != NULL;) {
        pthread_t ids[16];
        const double begin = now_s(CLOCK_MONOTONIC), busy = now_s(CLOCK_PROCESS_CPUTIME_ID);
        for (size_t t = 0; t < threads; t++) {
            shares[t] = (struct share){.query = &query,
                                       .points = {.positions = file.bytes},
                                       .values = values,
                                       .batch = strtoul(argv[4], NULL, 10),
                                       .first = count * t / threads,
                                       .end = count * (t + 1) / threads};
            if (t > 0 && pthread_create(&ids[t], NULL, answer, &shares[t]) != 0) {
                return 1;
            }
        }
        answer(&shares[0]);
        for (size_t t = 1; t < threads; t++) {
            (void)pthread_join(ids[t], NULL);
        }
        (void)printf("%.9f %.9f\n", now_s(CLOCK_MONOTONIC) - begin,
                     now_s(CLOCK_PROCESS_CPUTIME_ID) - busy);
        (void)fflush(stdout);
    }
    return 0;
}
