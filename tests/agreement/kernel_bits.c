/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bit-equality of the query kernels, the long form: `make kernel-bits`.
 *
 *     kernel_bits COUNT FILE...
 *
 * COUNT points of every asset's first light, near its surfaces: half of them far from one another,
 * half in the order of a picture whose pixels lie closer than voxels; half of each with normals,
 * along which the automatic bias moves them. For 1, 9 and 17 taps the
 * kernel of every instruction set, the whole batch, slices of odd lengths and threads must write
 * the same bits. The kernels must count the same nodes and bricks. Every 64th answer must equal
 * that of window_count.c, which looks up one window at a time. Tents and footprints of all widths
 * of the same points must have equal bits and counts by every kernel. Under a lamp footprints alone
 * are compared, at sample points of the asset and around them. With translucent casters tents and
 * footprints are compared.
 * Prints what it compared. Exit code 1: two answers or counts differ.
 */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "query/kernels.h"
#include "umbrage/sample.h"

#define CHUNK   65536U
#define THREADS 4U
#define STRIDE  997U /* points of a slice: no multiple of a block */

struct way {
    const char *name;
    umb__kernel_fn run;
    struct umb__kernels kernels;
};

static double points[CHUNK][3];
static float normals[CHUNK][3];
static float answers[2][CHUNK];

static uint64_t next_random(uint64_t *state)
{
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return *state >> 33;
}

static double unit(uint64_t *state)
{
    return (double)next_random(state) / (double)(UINT64_C(1) << 31);
}

/* Finds a voxel near a surface, among the voxels that the columns of a place list. */
static void near_surface(const struct umb__query *q, uint64_t *state, double v[3])
{
    const uint32_t c = q->column_level, row = q->log2_size - c;
    const double size = (double)((uint32_t)1 << q->log2_size);
    for (unsigned axis = 0; axis < 2; axis++) {
        v[axis] = unit(state) * size;
    }
    const struct umb__column column =
        q->columns[((uint32_t)v[0] >> c) + ((uint32_t)v[1] >> c << row)];
    v[2] = (column.low + (column.high - column.low + 1.0) * unit(state)) * (double)(1U << c);
}

/* The frame's axes are orthogonal, so a voxel's position is the frame's corner plus its steps along
 * the axes. */
static void put_point(const struct umb__query *q, const double v[3], double p[3])
{
    memset(p, 0, 3 * sizeof *p);
    for (unsigned k = 0; k < 3; k++) {
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] += (v[k] - q->world_to_voxel[k][3]) * q->voxel_step[k][axis];
        }
    }
}

static void make_points(const struct umb__query *q, int picture, uint64_t *state)
{
    double v[3] = {0, 0, 0};
    for (uint32_t i = 0; i < CHUNK; i++) {
        if (!picture || i % 512 == 0) {
            near_surface(q, state, v);
        } else {
            for (unsigned axis = 0; axis < 3; axis++) {
                v[axis] += unit(state) - 0.45;
            }
        }
        put_point(q, v, points[i]);
    }
}

/* Draws normals of all directions, of length 1 or nearly 1. */
static void make_normals(uint64_t *state)
{
    for (uint32_t i = 0; i < CHUNK; i++) {
        double n[3], length2 = 0;
        for (unsigned axis = 0; axis < 3; axis++) {
            n[axis] = unit(state) - 0.5;
            length2 += n[axis] * n[axis];
        }
        for (unsigned axis = 0; axis < 3; axis++) {
            normals[i][axis] = (float)(n[axis] / sqrt(length2));
        }
    }
}

static struct umb_points batch_of(const struct umb__query *q)
{
    struct umb_points batch = {.positions = points, .format = UMB_POINT_F64, .count = CHUNK};
    batch.normals = q->bias_mode == UMB_BIAS_AUTO ? normals : NULL;
    memcpy(batch.origin, q->origin, sizeof batch.origin);
    return batch;
}

/* Thread k answers the slices k, k + THREADS, ... */
struct share {
    const struct umb_query *query;
    const struct umb_points *batch;
    size_t first;
};

static void *share_run(void *user)
{
    const struct share *share = user;
    struct umb_answers own = {.values = answers[1]};
    for (size_t at = share->first * STRIDE; at < CHUNK; at += THREADS * STRIDE) {
        const size_t left = CHUNK - at;
        umb_query_run(share->query, share->batch, at, left < STRIDE ? left : STRIDE, &own);
    }
    return NULL;
}

static int threads_run(const struct umb_query *query, const struct umb_points *batch)
{
    struct share shares[THREADS];
    pthread_t ids[THREADS];
    size_t count = 0;
    for (; count < THREADS; count++) {
        shares[count] = (struct share){query, batch, count};
        if (pthread_create(&ids[count], NULL, share_run, &shares[count]) != 0) {
            break;
        }
    }
    for (size_t k = 0; k < count; k++) {
        (void)pthread_join(ids[k], NULL);
    }
    return count == THREADS;
}

/* Counts the differences between every 64th answer and window_count.c's. */
static int compare_walk(const struct umb__query *q)
{
    const uint32_t total = (uint32_t)(q->taps * q->taps);
    const struct umb_points batch = batch_of(q);
    int wrong = 0;
    for (uint32_t i = 0; i < CHUNK; i += 64) {
        struct umb_query_stats stats = {0};
        double v[3];
        if (!umb__voxel_at(q, &batch, i, v)) {
            wrong += answers[0][i] != 0;
            continue;
        }
        const struct umb__window window = umb__window_at(q, v, &stats);
        const uint32_t lit =
            window.all_lit ? total : window.outside + umb__count_window(q, &window, &stats);
        wrong += answers[0][i] != (float)lit / (float)total;
    }
    return wrong;
}

static int check_chunk(const struct umb_query *query, const struct way *ways, size_t way_count)
{
    const struct umb__query *q = (const struct umb__query *)(const void *)query->opaque;
    const struct umb_points batch = batch_of(q);
    struct umb_query_stats counted = {0};
    int wrong = 0;
    for (size_t w = 0; w < way_count; w++) {
        struct umb_answers to = {.values = answers[w > 0]};
        memset(answers[w > 0], 0xff, sizeof answers[0]);
        ways[w].run(q, &batch, 0, CHUNK, &to);
        wrong += memcmp(answers[0], answers[w > 0], sizeof answers[0]) != 0;
        counted = w == 0 ? to.stats : counted;
        wrong += memcmp(&counted, &to.stats, sizeof counted) != 0;
    }
    memset(answers[1], 0xff, sizeof answers[1]);
    wrong += !threads_run(query, &batch) || memcmp(answers[0], answers[1], sizeof answers[0]) != 0;
    return wrong + compare_walk(q);
}

/* Answers the points with one filter by every kernel. Out: number of kernels whose bits or counts
 * differ. */
static int check_filter(const struct umb_asset *asset, const struct umb_query_settings *settings,
                        const struct umb_points *batch, const struct way *ways, size_t way_count)
{
    struct umb_query_stats counted = {0};
    struct umb_query prepared;
    int wrong = 0;
    if (umb_query_prepare(asset, settings, &prepared, NULL) != UMB_OK) {
        return 1;
    }
    for (size_t w = 0; w < way_count; w++) {
        const bool tent = settings->filter == UMB_FILTER_TENT;
        struct umb__query q;
        memcpy(&q, prepared.opaque, sizeof q);
        struct umb_answers to = {.values = answers[w > 0]};
        q.kernels = &ways[w].kernels;
        memset(answers[w > 0], 0xff, sizeof answers[0]);
        (tent ? ways[w].kernels.tents : q.run)(&q, batch, 0, CHUNK, &to);
        wrong += memcmp(answers[0], answers[w > 0], sizeof answers[0]) != 0;
        counted = w == 0 ? to.stats : counted;
        wrong += memcmp(&counted, &to.stats, sizeof counted) != 0;
    }
    return wrong;
}

/* Compares the answers of tents and footprints for the points. */
static int check_filters(const struct umb_asset *asset, const struct umb_query *query,
                         const struct way *ways, size_t way_count)
{
    const struct umb__query *box = (const struct umb__query *)(const void *)query->opaque;
    const struct umb_points batch = batch_of(box);
    const double edge = umb__length(box->voxel_step[0]);
    int wrong = 0;
    for (unsigned turn = 0; turn < 6; turn++) {
        const bool tent = turn == 0;
        const struct umb_query_settings settings = {
            .taps = (uint32_t)box->taps,
            .bias_mode = box->bias_mode,
            .filter = tent ? UMB_FILTER_TENT : UMB_FILTER_FOOTPRINT,
            .footprint_m = tent ? 0 : box->taps * edge * (0.7 * (1U << 2 * turn))};
        wrong += check_filter(asset, &settings, &batch, ways, way_count);
    }
    return wrong;
}

/* Draws sample points of a lamp. In a picture, neighbours of one in 64 of them. In: edge: metres
 * between neighbours. */
static int make_lamp_points(const struct umb_asset *asset, int picture, double edge,
                            uint64_t *state)
{
    const struct umb_sample_settings settings = {.count = CHUNK, .seed = *state};
    struct umb_sample sample;
    if (umb_asset_sample(asset, &settings, &points[0][0], &sample, NULL) != UMB_OK ||
        sample.count != CHUNK) {
        return 0;
    }
    for (uint32_t i = 0; i < CHUNK && picture; i++) {
        for (unsigned axis = 0; axis < 3 && i % 64 != 0; axis++) {
            points[i][axis] = points[i - 1][axis] + (unit(state) - 0.45) * edge;
        }
    }
    make_normals(state);
    return 1;
}

/* Compares the footprints of a lamp, from a texel wide to wider than its faces. */
static int check_lamp(const struct umb_asset *asset, const struct way *ways, size_t way_count,
                      size_t count)
{
    uint64_t state = 20261123;
    int wrong = 0;
    for (size_t chunk = 0; chunk * CHUNK < count; chunk++) {
        const double edge = 0.01 * (double)(1U << chunk % 12);
        if (!make_lamp_points(asset, (int)(chunk % 2), edge, &state)) {
            return 1;
        }
        for (unsigned turn = 0; turn < 6; turn++) {
            struct umb_points batch = {.positions = points,
                                       .format = UMB_POINT_F64,
                                       .normals = turn < 3 ? normals : NULL,
                                       .count = CHUNK};
            const struct umb_query_settings settings = {
                .taps = 1 + 4 * (turn % 3),
                .bias_mode = turn == 5 ? UMB_BIAS_VOXELS : UMB_BIAS_AUTO,
                .bias = turn == 5 ? 1.5 : 0,
                .filter = UMB_FILTER_FOOTPRINT,
                .footprint_m = edge * (double)(1 + 20 * turn)};
            struct umb_asset_info info;
            umb_asset_get_info(asset, &info);
            memcpy(batch.origin, info.origin, sizeof batch.origin);
            wrong += check_filter(asset, &settings, &batch, ways, way_count);
        }
    }
    return wrong;
}

/* Compares windows, tents and footprints of a sun. */
static int check_sun(const struct umb_asset *asset, const struct way *ways, size_t way_count,
                     size_t count, struct umb_error *error)
{
    uint64_t state = 20261121;
    int wrong = 0;
    for (uint32_t taps = 1; taps <= 17; taps += 8) {
        struct umb_query queries[2]; /* of points without and with normals */
        for (unsigned k = 0; k < 2; k++) {
            const struct umb_query_settings settings = {
                .taps = taps, .bias_mode = k == 0 ? UMB_BIAS_NONE : UMB_BIAS_AUTO};
            if (umb_query_prepare(asset, &settings, &queries[k], error) != UMB_OK) {
                (void)fprintf(stderr, "%s\n", error->message);
                return 1;
            }
        }
        for (size_t chunk = 0; chunk * CHUNK < count; chunk++) {
            const struct umb_query *query = &queries[chunk / 2 % 2];
            const struct umb__query *q = (const struct umb__query *)(const void *)query->opaque;
            make_points(q, (int)(chunk % 2), &state);
            make_normals(&state);
            /* Kernels know opaque casters only; a stage adds the translucent ones. */
            wrong += q->trans == NULL ? check_chunk(query, ways, way_count) : 0;
            wrong += check_filters(asset, query, ways, way_count);
        }
    }
    return wrong;
}

static int check_asset(const char *path, size_t count)
{
    struct way ways[3] = {{"base",
                           umb__kernel_base,
                           {.tents = umb__tent_base,
                            .receivers = umb__receivers_base,
                            .squares = umb__squares_base}}};
    size_t way_count = 1;
    struct umb_asset *asset;
    struct umb_error error;
    int wrong = 0;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2")) {
        ways[way_count++] = (struct way){"avx2",
                                         umb__kernel_avx2,
                                         {.tents = umb__tent_avx2,
                                          .receivers = umb__receivers_avx2,
                                          .squares = umb__squares_avx2}};
        if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd")) {
            ways[way_count++] = (struct way){"avx512",
                                             umb__kernel_avx512,
                                             {.tents = umb__tent_avx512,
                                              .receivers = umb__receivers_avx512,
                                              .squares = umb__squares_avx512}};
        }
    }
#endif
    if (umb_asset_open_file(path, NULL, &asset, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s: %s\n", path, error.message);
        return 1;
    }
    struct umb_light_info light;
    const bool known = umb_asset_get_light(asset, 0, &light) == UMB_OK;
    const bool lamp = known && light.kind != UMB_LIGHT_DIRECTIONAL;
    if (lamp) {
        wrong = check_lamp(asset, ways, way_count, count);
    } else {
        wrong = check_sun(asset, ways, way_count, count, &error);
    }
    umb_asset_close(asset);
    printf("%s: %s, %zu points each, %s and %s: %s\n", path,
           lamp ? "footprints of a lamp" : "1, 9 and 17 taps, tents, footprints, slices, threads",
           (count + CHUNK - 1) / CHUNK * CHUNK, ways[0].name, ways[way_count - 1].name,
           wrong ? "DIFFERENT" : "equal bits");
    return wrong != 0;
}

int main(int argc, char **argv)
{
    if (argc < 3) {
        (void)fprintf(stderr, "usage: kernel_bits COUNT FILE...\n");
        return 2;
    }
    int failed = 0;
    for (int i = 2; i < argc; i++) {
        failed |= check_asset(argv[i], strtoul(argv[1], NULL, 10));
    }
    return failed;
}
