/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares placing in fixed point (kernel_place_avx512.h) with placing in doubles: points within
 * about 2^-32 voxels of a border, points far away, and NaNs. Voxels are random bits, so a point in
 * a wrong voxel is noticed with a probability of one half. Frames are turned, so that every sum is
 * rounded.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "make_asset.h"
#include "query/query_parts.h"

enum {
    LOG2 = 7,
    SIZE = 1 << LOG2,
    BATCH = 1024
};

static const uint32_t voxels_log2 = LOG2;

static int has_avx512(void)
{
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512cd");
#else
    return 0;
#endif
}

/* One brick of thirty-two is of random bits, all others are lit: a frustum so coarse that windows
 * go stage by stage. */
static int is_random_brick(uint32_t x, uint32_t y, uint32_t z)
{
    return ((x + 16 * y + 256 * z + 1) * 2654435761U >> 27) == 0;
}

static int sparse_voxel(const void *log2_size, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    return !is_random_brick(x / 8, y / 8, z / 8) || random_voxel(log2_size, frustum, x, y, z);
}

/* A query whose frame is turned about its middle and pushed off the origin. */
struct turned {
    struct bytes file;
    struct umb_asset *asset;
    struct umb_query query;
    struct umb__query *q;
    double turn[3][3], scale[3];
};

static void turned_make(struct turned *t, uint32_t taps)
{
    static const double none[3] = {0, 0, 0};
    const struct voxels voxels = {taps == 1 ? random_voxel : sparse_voxel, &voxels_log2, LOG2, 1};
    const struct umb_query_settings settings = {.taps = taps, .bias_mode = UMB_BIAS_NONE};
    t->file = make_packed(&voxels, 1, none);
    assert_int_equal(umb_asset_open_bytes(t->file.data, t->file.size, NULL, &t->asset, NULL),
                     UMB_OK);
    assert_int_equal(umb_query_prepare(t->asset, &settings, &t->query, NULL), UMB_OK);
    t->q = (struct umb__query *)(void *)t->query.opaque;
    assert_true(taps == 1 || t->q->log2_size - t->q->grid_log2 >= 5);
}

static void turned_finish(struct turned *t)
{
    umb_asset_close(t->asset);
    bytes_finish(&t->file);
}

/* A rotation from three random angles, other voxel sizes and another place of the frame. */
static void turn(struct turned *t, double apart, uint64_t *seed)
{
    const double a = 7 * random_unit(seed), b = 7 * random_unit(seed), c = 7 * random_unit(seed);
    const double turned[3][3] = {
        {cos(a) * cos(b), cos(a) * sin(b) * sin(c) - sin(a) * cos(c),
         cos(a) * sin(b) * cos(c) + sin(a) * sin(c)},
        {sin(a) * cos(b), sin(a) * sin(b) * sin(c) + cos(a) * cos(c),
         sin(a) * sin(b) * cos(c) - cos(a) * sin(c)},
        {-sin(b), cos(b) * sin(c), cos(b) * cos(c)},
    };
    memcpy(t->turn, turned, sizeof turned);
    for (unsigned axis = 0; axis < 3; axis++) {
        t->scale[axis] = exp(4 * random_unit(seed) - 2);
        for (unsigned k = 0; k < 3; k++) {
            t->q->world_to_voxel[axis][k] = t->scale[axis] * turned[axis][k];
            t->q->voxel_step[axis][k] = turned[axis][k] / t->scale[axis];
        }
        t->q->world_to_voxel[axis][3] = 0.5 * SIZE + apart * (random_unit(seed) - 0.5);
        t->q->direction[axis] = turned[2][axis];
    }
    t->q->no_normal_m = next_random(seed) % 2 ? random_unit(seed) : 0;
}

/* Computes the point for a place in voxel space, up to a rounding or two. */
static void unturn(const struct turned *t, const struct umb_points *points, const double v[3],
                   double p[3])
{
    for (unsigned k = 0; k < 3; k++) {
        long double sum = 0;
        for (unsigned axis = 0; axis < 3; axis++) {
            sum += (long double)t->turn[axis][k] *
                   ((long double)v[axis] - (long double)t->q->world_to_voxel[axis][3]) /
                   (long double)t->scale[axis];
        }
        sum += (long double)(t->q->direction[k] * t->q->no_normal_m);
        p[k] = (double)(sum - (long double)(points->origin[k] - t->q->origin[k]));
    }
}

/* Answers and counts must be those of the plain kernel. */
static void check_batch(const struct turned *t, const struct umb_points *points)
{
    static float values[2][BATCH];
    struct umb_answers fixed = {.values = values[0]}, plain = {.values = values[1]};
    umb__kernel_avx512(t->q, points, 0, points->count, &fixed);
    umb__kernel_base(t->q, points, 0, points->count, &plain);
    assert_memory_equal(values[0], values[1], points->count * sizeof values[0][0]);
    assert_memory_equal(&fixed.stats, &plain.stats, sizeof fixed.stats);
}

/* A coordinate of a voxel inside; every third is next to a border. */
static double near_border(uint64_t *seed)
{
    const double inside = random_unit(seed) * SIZE;
    const double units = (double)(int32_t)(next_random(seed) % 129 - 64);
    const double off = units * 0x1p-32 / (double)(1U << next_random(seed) % 8);
    return next_random(seed) % 3 == 0 ? rint(inside) + off : inside;
}

/* Points inside, and among them some with extreme coordinates, whose sums cancel, overflow or are
 * NaN. */
static void points_far_away_and_no_numbers_are_answered_as_by_doubles(void **state)
{
    static const double far[] = {1e6,  -1e6,  1e9, -1e9,     1e16,      -1e16,
                                 1e30, -1e30, 0,   INFINITY, -INFINITY, NAN};
    static double places[BATCH][3];
    static float narrow[BATCH][3];
    struct turned t;
    uint64_t seed = round_seed(20261123);
    (void)state;
    if (!has_avx512()) {
        skip();
    }
    turned_make(&t, 1);
    for (int done = 0; done < case_count(400000); done += BATCH) {
        const int floats = next_random(&seed) % 2;
        struct umb_points points = {.positions = floats ? (const void *)narrow : places,
                                    .format = floats ? UMB_POINT_F32 : UMB_POINT_F64,
                                    .count = BATCH};
        turn(&t, 1, &seed);
        for (size_t i = 0; i < BATCH; i++) {
            const double v[3] = {random_unit(&seed) * SIZE, random_unit(&seed) * SIZE,
                                 random_unit(&seed) * SIZE};
            unturn(&t, &points, v, places[i]);
            for (unsigned k = 0; k < 3 && next_random(&seed) % 100 == 0; k++) {
                /* Across the frame's z, or anywhere. */
                const double length = far[next_random(&seed) % (sizeof far / sizeof far[0])];
                for (unsigned axis = 0; axis < 3; axis++) {
                    places[i][axis] += length * (k ? t.turn[k - 1][axis] : (double)(axis == 0));
                }
            }
            for (unsigned k = 0; k < 3; k++) {
                narrow[i][k] = (float)places[i][k];
            }
        }
        check_batch(&t, &points);
    }
    turned_finish(&t);
}

/* Draws a normal of any direction; some are across the light or nearly so. In: odd: a few normals
 * have lengths at the limits, length 0 or NaN. A block with one of those is placed in doubles, so
 * they are rare: a block has mostly one at most. */
static void make_normal(const struct turned *t, int odd, uint64_t *seed, float normal[3])
{
    static const double lengths[] = {1, 1, 0.51, 1.99, 0.4999999, 0.5000001, 1.999999, 2.000001};
    const int limit = odd && next_random(seed) % 100 == 0;
    double n[3], length2 = 0;
    const double across = next_random(seed) % 8 == 0
                              ? (double)(int32_t)(next_random(seed) % 65 - 32) * 0x1p-26
                              : 2 * random_unit(seed) - 1;
    const double angle = 7 * random_unit(seed), side = sqrt(fmax(0, 1 - across * across));
    for (unsigned k = 0; k < 3; k++) {
        n[k] = cos(angle) * side * t->turn[0][k] + sin(angle) * side * t->turn[1][k] +
               across * t->turn[2][k];
        length2 += n[k] * n[k];
    }
    const double length = lengths[next_random(seed) % 4 + (limit ? 4 : 0)];
    for (unsigned k = 0; k < 3; k++) {
        normal[k] = (float)(n[k] * length / sqrt(length2));
    }
    if (odd && next_random(seed) % 100 == 0) {
        static const float values[] = {0, 1e-30F, 1e30F, INFINITY, NAN};
        const float value = values[next_random(seed) % 5];
        normal[0] = normal[1] = normal[2] = value;
    }
}

/* Moves p so that the bias ends at the old p, up to a rounding or two. In: v: p in voxel space. */
static void unmove(const struct turned *t, const float normal[3], const double v[3], double p[3])
{
    const struct umb__query *q = t->q;
    struct umb__lift lift = {0, {0, 0}};
    double n[3], length2 = 0, scale = 0;
    for (unsigned k = 0; k < 3; k++) {
        n[k] = (double)normal[k];
        length2 += n[k] * n[k];
    }
    if (!(length2 > 0.01 && length2 < 100)) {
        return;
    }
    scale = q->bias_mode == UMB_BIAS_AUTO ? umb__lift_auto(q, n, length2, &lift)
                                          : q->bias_m / sqrt(length2);
    const double shift = umb__lift_depth(&lift, v);
    for (unsigned k = 0; k < 3; k++) {
        p[k] -= n[k] * scale + q->direction[k] * q->no_normal_m + shift * q->voxel_step[2][k];
    }
}

/* As near_border, but as near as floats are to doubles. */
static double within_floats_of_border(uint64_t *seed)
{
    const double units = (double)(int32_t)(next_random(seed) % 129 - 64);
    const double off = units * 0x1p-32 * (double)(1U << next_random(seed) % 12);
    return rint(random_unit(seed) * SIZE) + off;
}

/* With normals: some points have a coordinate next to a border, as near as floats can be. */
static void beside_borders(uint64_t *seed, int sides, int with_normals, double v[3])
{
    (void)sides;
    for (unsigned k = 0; k < 3; k++) {
        v[k] = !with_normals                  ? near_border(seed)
               : next_random(seed) % 100 == 0 ? within_floats_of_border(seed)
                                              : (0.01 + 0.98 * random_unit(seed)) * SIZE;
    }
}

/* A place in or beside a brick of random bits, which is at the frustum's sides only if `sides` says
 * so; some points have a coordinate next to a border, as near as doubles can be, or with normals as
 * floats can be. */
static void near_random_brick(uint64_t *seed, int sides, int with_normals, double v[3])
{
    uint32_t brick[3];
    do {
        for (unsigned k = 0; k < 3; k++) {
            brick[k] = (uint32_t)(sides ? next_random(seed) % 16 : 2 + next_random(seed) % 12);
        }
    } while (!is_random_brick(brick[0], brick[1], brick[2]));
    for (unsigned k = 0; k < 3; k++) {
        v[k] = 8 * brick[k] + (k < 2 ? 16 * random_unit(seed) - 4 : 8 * random_unit(seed));
        if (next_random(seed) % 256 == 0) {
            const double units = (double)(int32_t)(next_random(seed) % 129 - 64);
            const double far = (double)(1U << next_random(seed) % 12);
            v[k] = rint(v[k]) + units * 0x1p-32 * (with_normals ? far : 1 / far);
        }
    }
}

/* Batches of points, with normals and without, whose places in voxel space `place` chooses. With
 * windows, some points of some blocks face away from the light. */
static void check_batches(uint32_t taps, int count,
                          void (*place)(uint64_t *seed, int sides, int with_normals, double v[3]),
                          uint64_t *seed)
{
    static double places[BATCH][3];
    static float narrow[BATCH][3], normals[BATCH][3];
    struct turned t;
    turned_make(&t, taps);
    for (int done = 0; done < count; done += BATCH) {
        const int floats = next_random(seed) % 3 == 0, with_normals = next_random(seed) % 2;
        const int odd = next_random(seed) % 4 == 0, sides = next_random(seed) % 4 == 0;
        struct umb_points points = {.positions = floats ? (const void *)narrow : places,
                                    .format = floats ? UMB_POINT_F32 : UMB_POINT_F64,
                                    .normals = with_normals ? normals : NULL,
                                    .count = BATCH};
        turn(&t, (double)(1U << next_random(seed) % 20), seed);
        t.q->bias_mode = next_random(seed) % 3 ? UMB_BIAS_AUTO : UMB_BIAS_METRES;
        t.q->bias_m = t.q->bias_mode == UMB_BIAS_AUTO ? 0 : 4 * random_unit(seed) - 1;
        t.q->lift_texel = next_random(seed) % 4 ? 2 * random_unit(seed) : 0;
        for (unsigned k = 0; k < 3; k++) {
            points.origin[k] = next_random(seed) % 2 ? 100 * random_unit(seed) : 0;
        }
        for (size_t i = 0; i < BATCH; i++) {
            double v[3];
            place(seed, sides, with_normals, v);
            unturn(&t, &points, v, places[i]);
            if (with_normals) {
                make_normal(&t, odd, seed, normals[i]);
                for (unsigned k = 0; k < 3 && taps > 1 && i / 16 % 4 == 1; k++) {
                    normals[i][k] = (float)t.q->direction[k];
                }
                unmove(&t, normals[i], v, places[i]);
            }
            for (unsigned k = 0; k < 3; k++) {
                narrow[i][k] = (float)places[i][k];
            }
        }
        check_batch(&t, &points);
    }
    turned_finish(&t);
}

static void points_beside_borders_fall_into_the_voxels_of_doubles(void **state)
{
    uint64_t seed = round_seed(20261122);
    (void)state;
    if (!has_avx512()) {
        skip();
    }
    check_batches(1, case_count(800000), beside_borders, &seed);
}

/* Inside and cut by the frustum's sides. */
static void windows_begin_at_the_texels_of_doubles(void **state)
{
    uint64_t seed = round_seed(20261126);
    (void)state;
    if (!has_avx512()) {
        skip();
    }
    for (uint32_t taps = 3; taps <= 17; taps += 2) {
        check_batches(taps, case_count(80000), near_random_brick, &seed);
    }
}

/* A frame that a file may have, though no bake makes it: all axes have the same direction.
 * Coordinates across that direction change a sum only by rounding. */
static void points_far_across_a_flat_frame_are_answered_as_by_doubles(void **state)
{
    static double places[BATCH][3];
    struct turned t;
    uint64_t seed = round_seed(20261124);
    (void)state;
    if (!has_avx512()) {
        skip();
    }
    turned_make(&t, 1);
    for (int done = 0; done < case_count(100000); done += BATCH) {
        struct umb_points points = {.positions = places, .format = UMB_POINT_F64, .count = BATCH};
        turn(&t, 1, &seed);
        for (unsigned axis = 1; axis < 3; axis++) {
            memcpy(t.q->world_to_voxel[axis], t.q->world_to_voxel[0], 3 * sizeof(double));
        }
        for (size_t i = 0; i < BATCH; i++) {
            const double across = 1e14 * random_unit(&seed), along = random_unit(&seed);
            for (unsigned k = 0; k < 3; k++) {
                places[i][k] = across * t.turn[1][k] + along * t.turn[0][k];
            }
        }
        check_batch(&t, &points);
    }
    turned_finish(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_beside_borders_fall_into_the_voxels_of_doubles),
        cmocka_unit_test(windows_begin_at_the_texels_of_doubles),
        cmocka_unit_test(points_far_away_and_no_numbers_are_answered_as_by_doubles),
        cmocka_unit_test(points_far_across_a_flat_frame_are_answered_as_by_doubles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
