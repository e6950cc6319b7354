/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares every kernel with window_count.c, which counts one window at a time: over frusta whose
 * grids lead to bricks, to cells of level 5 and to wide nodes above, for whole blocks and partial
 * ones, and for points inside and outside.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "query/query_parts.h"

enum {
    POINTS = 2003
}; /* no multiple of a block or of four */

static const double voxel_m = 0.25;
static const double origin[3] = {1000.5, -5, 12};

struct ground {
    uint32_t size;   /* voxels a side */
    uint32_t period; /* texels after which it repeats: short ones make small assets, small grids */
    uint32_t rough;  /* a texel differs from the next by less than this */
};

/* The ground has steps of all sizes, so that windows are mixed at every level. */
static int stepped(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const struct ground *ground = user;
    (void)frustum;
    x %= ground->period;
    y %= ground->period;
    uint32_t noise = (x * 2654435761U ^ y * 40503U) >> 7;
    uint32_t height = ground->size / 4 + noise % ground->rough + (x / 32 * 3 + y / 16 * 5) % 24;
    return z < height;
}

/* Makes an asset of a ground with so many frusta. */
struct opened {
    struct bytes file;
    struct umb_asset *asset;
};

static struct opened ground_open(const struct ground *ground, uint32_t frusta)
{
    const struct voxels voxels = {stepped, ground, (uint32_t)__builtin_ctz(ground->size), frusta};
    struct opened opened = {.file = make_packed(&voxels, voxel_m, origin)};
    assert_int_equal(
        umb_asset_open_bytes(opened.file.data, opened.file.size, NULL, &opened.asset, NULL),
        UMB_OK);
    return opened;
}

static void ground_close(struct opened *opened)
{
    umb_asset_close(opened->asset);
    bytes_finish(&opened->file);
}

/* Prepares a query; returns the private form that kernels get. */
static const struct umb__query *prepare(const struct umb_asset *asset,
                                        const struct umb_query_settings *settings,
                                        struct umb_query *query)
{
    assert_int_equal(umb_query_prepare(asset, settings, query, NULL), UMB_OK);
    return (const struct umb__query *)(const void *)query->opaque;
}

struct kernel {
    const char *name;
    umb__kernel_fn run, tent;
};

enum {
    KERNELS = 4
};

/* What this processor runs. */
static size_t list_kernels(struct kernel kernels[KERNELS])
{
    size_t count = 0;
    kernels[count++] = (struct kernel){"base", umb__kernel_base, umb__tent_base};
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2")) {
        kernels[count++] = (struct kernel){"avx2", umb__kernel_avx2, umb__tent_avx2};
        if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd")) {
            kernels[count++] = (struct kernel){"avx512", umb__kernel_avx512, umb__tent_avx512};
            kernels[count++] = (struct kernel){"either, in pieces", umb__run_wide, umb__tent_wide};
        }
    }
#endif
    return count;
}

static double doubles[POINTS][3];
static float floats[POINTS][3], normals[POINTS][3];

/* In: spread: with 1 nearly all points are inside; with more, some lie beyond every side. */
static void make_points(uint32_t size, double spread, uint64_t *seed)
{
    for (size_t i = 0; i < POINTS; i++) {
        for (size_t k = 0; k < 3; k++) {
            doubles[i][k] = ((random_unit(seed) - 0.5) * spread + 0.5) * size * voxel_m;
            floats[i][k] = (float)doubles[i][k];
            normals[i][k] = (float)(random_unit(seed) * 2 - 1.5 * (k == 2));
        }
        if (i % 17 == 0) {
            memset(normals[i], 0, sizeof normals[i]);
        }
    }
}

/* Computes a tent around v as the header defines it, texel by texel. */
static uint32_t tent_alone(const struct umb__query *q, const double v[3])
{
    const int32_t half = q->taps / 2;
    struct umb_query_stats stats = {0};
    struct umb__query one = *q;
    uint32_t sum = 0;
    one.taps = 1;
    for (int32_t j = -half; j <= half; j++) {
        for (int32_t i = -half; i <= half; i++) {
            const double at[3] = {floor(v[0]) + i + 0.5, floor(v[1]) + j + 0.5, v[2]};
            const struct umb__window texel = umb__window_at(&one, at, &stats);
            const uint32_t lit =
                texel.all_lit ? 1 : texel.outside + umb__count_window(&one, &texel, &stats);
            sum += lit * (uint32_t)((half + 1 - abs(i)) * (half + 1 - abs(j)));
        }
    }
    return sum;
}

/* Computes what the kernels must answer for point i, with the point alone. */
static uint32_t lit_alone(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    struct umb_query_stats stats = {0};
    double v[3];
    if (!umb__voxel_at(q, points, i, v)) {
        return 0;
    }
    if (q->filter == UMB_FILTER_TENT) {
        return tent_alone(q, v);
    }
    struct umb__window window = umb__window_at(q, v, &stats);
    return window.all_lit ? (uint32_t)(q->taps * q->taps)
                          : window.outside + umb__count_window(q, &window, &stats);
}

/* Points in the order of a picture whose pixels lie closer than voxels: most are in the brick of
 * the point before, many in its voxel; some jump, some face away, some are outside. */
static void make_picture(uint32_t size, double pixel_voxels, uint64_t *seed)
{
    double at[3] = {0.5 * size, 0.5 * size, 0.45 * size};
    for (size_t i = 0; i < POINTS; i++) {
        const int jumps = i % 211 == 0;
        for (size_t k = 0; k < 3; k++) {
            const double step = (random_unit(seed) - 0.4) * pixel_voxels;
            at[k] = jumps ? random_unit(seed) * size : at[k] + step;
            at[k] = at[k] > 1.01 * size ? 0.3 * size : at[k];
            doubles[i][k] = at[k] * voxel_m;
            floats[i][k] = (float)doubles[i][k];
            normals[i][k] =
                (float)(random_unit(seed) - (k == 2 ? 1.0 - (double)(i / 40 % 3 == 0) : 0.5));
        }
    }
}

/* Pixels of a plane in packets of 4 x 2, as pictures are rendered: the border of two bricks crosses
 * the rows of a packet, and blocks next to one another lie in the same cubes, or in the next. */
static void make_plane(uint32_t size, double pixel_voxels, uint64_t *seed)
{
    double right[3], down[3], corner[3];
    for (size_t k = 0; k < 3; k++) {
        right[k] = (random_unit(seed) - 0.5) * pixel_voxels * (k != 2);
        down[k] = (random_unit(seed) - 0.5) * pixel_voxels;
        corner[k] = (0.25 + 0.5 * random_unit(seed)) * size;
    }
    for (size_t i = 0; i < POINTS; i++) {
        const double column = (double)(4 * (i / 8 % 64) + i % 4);
        const double row = (double)(2 * (i / 512) + i / 4 % 2);
        for (size_t k = 0; k < 3; k++) {
            const double place = corner[k] + column * right[k] + row * down[k];
            doubles[i][k] = (place < 0 ? 0 : place < size ? place : size - 1) * voxel_m;
            floats[i][k] = (float)doubles[i][k];
        }
        memcpy(normals[i], (const float[3]){0, 0, -1}, sizeof normals[i]);
    }
}

static void check_batch(const struct umb__query *q, const struct umb_points *points)
{
    static float values[KERNELS][POINTS];
    struct umb_query_stats stats[KERNELS];
    struct kernel kernels[KERNELS];
    const bool tent = q->filter == UMB_FILTER_TENT;
    size_t count = list_kernels(kernels);
    for (size_t k = 0; k < count; k++) {
        struct umb_answers answers = {.values = values[k]};
        (tent ? kernels[k].tent : kernels[k].run)(q, points, 0, POINTS, &answers);
        stats[k] = answers.stats;
        assert_memory_equal(values[k], values[0], sizeof values[0]);
        assert_memory_equal(&stats[k], &stats[0], sizeof stats[0]);
    }
    const uint32_t m = (uint32_t)(q->taps + 1) / 2;
    const float total = (float)(tent ? m * m * m * m : (uint32_t)(q->taps * q->taps));
    for (size_t i = 0; i < POINTS; i += tent ? 19 : 1) {
        assert_true(values[0][i] == (float)lit_alone(q, points, i) / total);
    }
}

/* Compares the kernels for all biases and forms of points, on one asset's last light. */
static void check_filter(const struct umb_asset *asset, uint32_t light, enum umb_filter filter,
                         uint32_t taps)
{
    for (int mode = UMB_BIAS_AUTO; mode <= UMB_BIAS_NONE; mode++) {
        struct umb_query_settings settings = {
            .light = light, .taps = taps, .bias_mode = (enum umb_bias_mode)mode, .bias = 1.5};
        settings.filter = filter;
        struct umb_query query;
        const struct umb__query *q = prepare(asset, &settings, &query);
        for (int form = 0; form < 4; form++) {
            struct umb_points points = {.positions =
                                            form & 1 ? (const void *)floats : (const void *)doubles,
                                        .format = form & 1 ? UMB_POINT_F32 : UMB_POINT_F64,
                                        .normals = form & 2 ? normals : NULL,
                                        .count = POINTS};
            memcpy(points.origin, origin, sizeof origin);
            check_batch(q, &points);
        }
    }
}

static void check_asset(const struct umb_asset *asset, uint32_t light, uint32_t taps)
{
    check_filter(asset, light, UMB_FILTER_BOX, taps);
    check_filter(asset, light, UMB_FILTER_TENT, taps);
}

/* Builds, checks that the grid leads to nodes of `cell_level`, and compares. */
static void check_frusta(const struct ground *ground, uint32_t frusta, uint32_t cell_level)
{
    struct opened opened = ground_open(ground, frusta);
    struct umb_query query;
    struct umb_query_settings settings = {.light = 0};
    uint64_t seed = 20261121;
    const struct umb__query *q = prepare(opened.asset, &settings, &query);
    assert_int_equal(q->log2_size - q->grid_log2, cell_level);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        make_points(ground->size, taps % 4 == 1 ? 0.9 : 1.2, &seed);
        check_asset(opened.asset, frusta - 1, taps);
        make_picture(ground->size, taps % 4 == 1 ? 0.4 : 1.6, &seed);
        check_asset(opened.asset, frusta - 1, taps);
    }
    ground_close(&opened);
}

static void kernels_agree_where_the_grid_leads_to_bricks(void **state)
{
    (void)state;
    check_frusta(&(struct ground){64, 64, 40}, 1, 3);
}

static void kernels_agree_where_the_grid_leads_to_level_five(void **state)
{
    (void)state;
    check_frusta(&(struct ground){256, 256, 3}, 1, 5);
}

static void kernels_agree_where_wide_nodes_stand_above_level_five(void **state)
{
    (void)state;
    check_frusta(&(struct ground){128, 32, 2}, 8, 7);
}

static void check_planes(const struct ground *ground)
{
    struct opened opened = ground_open(ground, 1);
    struct umb_query_settings settings = {.taps = 1, .bias_mode = UMB_BIAS_NONE};
    struct umb_points points = {.positions = doubles, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_query query;
    uint64_t seed = 20261123;
    memcpy(points.origin, origin, sizeof origin);
    const struct umb__query *q = prepare(opened.asset, &settings, &query);
    for (int round = 0; round < 140; round++) {
        make_plane(ground->size, 0.05 * (double)(1U << round % 7), &seed);
        check_batch(q, &points);
    }
    ground_close(&opened);
}

static void kernels_agree_on_planes_that_a_camera_sees(void **state)
{
    (void)state;
    check_planes(&(struct ground){64, 64, 40});
    check_planes(&(struct ground){256, 256, 3});
    check_planes(&(struct ground){256, 64, 30});
}

/* Shared look-ups are read once, which must not show in any answer. */
static void neighbours_in_one_brick_share_a_look_up(void **state)
{
    (void)state;
    struct ground ground = {256, 256, 3};
    struct opened opened = ground_open(&ground, 1);
    struct kernel kernels[KERNELS];
    uint64_t seed = 11;
    static double mixed[POINTS][3];
    make_picture(ground.size, 0.2, &seed);
    for (size_t i = 0; i < POINTS; i++) {
        memcpy(mixed[i], doubles[i * 1009 % POINTS], sizeof mixed[i]);
    }
    struct umb_points picture = {.positions = doubles, .format = UMB_POINT_F64, .count = POINTS};
    memcpy(picture.origin, origin, sizeof origin);
    struct umb_points shuffled = picture;
    shuffled.positions = mixed;
    for (uint32_t taps = 1; taps <= 17; taps += 8) {
        struct umb_query_settings settings = {.taps = taps, .bias_mode = UMB_BIAS_NONE};
        struct umb_query query;
        const struct umb__query *q = prepare(opened.asset, &settings, &query);
        for (size_t k = 0, count = list_kernels(kernels); k < count; k++) {
            static float values[POINTS];
            struct umb_answers far = {.values = values}, near = {.values = values};
            kernels[k].run(q, &picture, 0, POINTS, &near);
            kernels[k].run(q, &shuffled, 0, POINTS, &far);
            assert_true(4 * near.stats.nodes < far.stats.nodes);
        }
    }
    ground_close(&opened);
}

/* A block is answered repeatedly: cells that are in the cache must count as if they were searched
 * again. */
static void check_known_cells(const struct ground *ground, uint32_t frusta)
{
    struct opened opened = ground_open(ground, frusta);
    struct kernel kernels[KERNELS];
    uint64_t seed = 20261130;
    make_picture(ground->size, 0.2, &seed);
    for (size_t i = 0; i < POINTS; i++) {
        memcpy(doubles[i], doubles[i % 64], sizeof doubles[i]);
        doubles[i][2] = (0.25 * ground->size + 8.5) * voxel_m; /* where cells are mixed */
    }
    struct umb_points points = {.positions = doubles, .format = UMB_POINT_F64, .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    for (uint32_t taps = 3; taps <= UMB_TAPS_MAX; taps += 2) {
        struct umb_query_settings settings = {.taps = taps, .bias_mode = UMB_BIAS_NONE};
        struct umb_query query;
        const struct umb__query *q = prepare(opened.asset, &settings, &query);
        for (size_t k = 0, count = list_kernels(kernels); k < count; k++) {
            static float values[POINTS];
            struct umb_answers once = {.values = values}, often = {.values = values};
            kernels[k].run(q, &points, 0, 64, &once);
            kernels[k].run(q, &points, 0, (size_t)12 * 64, &often);
            assert_int_equal(often.stats.nodes, 12 * once.stats.nodes);
            assert_int_equal(often.stats.bricks, 12 * once.stats.bricks);
        }
    }
    ground_close(&opened);
}

static void nodes_of_known_cells_are_counted_as_if_found_again(void **state)
{
    (void)state;
    check_known_cells(&(struct ground){256, 256, 3}, 1);
    check_known_cells(&(struct ground){128, 32, 2}, 8);
}

/* Fills the stack with values that look like voxels far away, where the next call has its
 * variables. */
static __attribute__((noinline)) void litter_stack(void)
{
    volatile uint8_t rubbish[16384];
    for (size_t i = 0; i < sizeof rubbish; i++) {
        rubbish[i] = 0x7f;
    }
}

static void what_a_block_has_no_points_for_is_not_looked_up(void **state)
{
    (void)state;
    struct ground ground = {64, 64, 40};
    struct opened opened = ground_open(&ground, 1);
    struct umb_query_settings settings = {.light = 0};
    struct umb_query query;
    struct kernel kernels[KERNELS];
    uint64_t seed = 7;
    const struct umb__query *q = prepare(opened.asset, &settings, &query);
    struct umb_points points = {.positions = doubles, .format = UMB_POINT_F64, .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    make_points(ground.size, 0.9, &seed);
    for (size_t k = 0, kernel_count = list_kernels(kernels); k < kernel_count; k++) {
        for (size_t count = 1; count <= 65; count++) {
            float values[65];
            struct umb_answers answers = {.values = values};
            litter_stack();
            kernels[k].run(q, &points, 0, count, &answers);
            for (size_t i = 0; i < count; i++) {
                assert_true(values[i] == (float)lit_alone(q, &points, i));
            }
        }
    }
    ground_close(&opened);
}

/* Eight cubes of 8192 voxels, with one brick each, in the same place of every cube. */
struct far_bricks {
    struct umb__column columns[4];
    uint32_t pieces[8];
    uint64_t nodes[8 * 5 * 3], bricks[8][8];
};

/* A query of one tap whose voxels are the points' coordinates. */
static struct umb__query far_bricks_make(struct far_bricks *far, uint64_t *seed)
{
    struct umb__query q = {.total = 1,
                           .columns = far->columns,
                           .pieces = far->pieces,
                           .nodes = far->nodes,
                           .bricks = (const uint64_t(*)[8])far->bricks,
                           .log2_size = 14,
                           .column_level = 13,
                           .taps = 1,
                           .format = UMB_ANSWER_F32};
    for (uint32_t k = 0; k < 4; k++) {
        far->columns[k] = (struct umb__column){.first = 2 * k, .low = 0, .high = 1};
    }
    for (uint32_t cube = 0; cube < 8; cube++) {
        far->pieces[cube] = UMB__CELL_FIRST + 15 * cube;
        for (uint32_t at = 15 * cube; at < 15 * cube + 15; at += 3) {
            const uint32_t below[2] = {at + 3 < 15 * cube + 15 ? at + 3 : cube, 0};
            far->nodes[at] = 1; /* the first child is mixed, the others are shadowed */
            far->nodes[at + 1] = 0;
            memcpy(&far->nodes[at + 2], below, sizeof below);
        }
        for (unsigned z = 0; z < 8; z++) {
            far->bricks[cube][z] = next_random(seed);
        }
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        q.world_to_voxel[axis][axis] = 1;
    }
    return q;
}

/* Runs of two to seven points. The bricks of a block differ only in coordinate bits that no key of
 * a brick has. */
static void equal_places_of_cubes_far_apart_are_different_bricks(void **state)
{
    (void)state;
    struct far_bricks far;
    struct kernel kernels[KERNELS];
    uint64_t seed = 20261127;
    const struct umb__query q = far_bricks_make(&far, &seed);
    const struct umb_points points = {
        .positions = doubles, .format = UMB_POINT_F64, .count = POINTS};
    static float truth[POINTS], values[POINTS];
    uint32_t cube = 0;
    for (size_t i = 0, next = 0; i < POINTS; i++) {
        if (i == next) {
            cube = (uint32_t)(next_random(&seed) >> 32 & 7);
            next += 2 + (next_random(&seed) >> 32) % 6;
        }
        uint32_t v[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            v[axis] = (uint32_t)(next_random(&seed) >> 32 & 7);
        }
        truth[i] = (float)(far.bricks[cube][v[2]] >> (v[0] + 8 * v[1]) & 1);
        doubles[i][0] = v[0] + 8192.0 * (cube >> 1 & 1) + 0.5;
        doubles[i][1] = v[1] + 8192.0 * (cube >> 2) + 0.5;
        doubles[i][2] = v[2] + 8192.0 * (cube & 1) + 0.5;
    }
    for (size_t k = 0, count = list_kernels(kernels); k < count; k++) {
        struct umb_answers answers = {.values = values};
        kernels[k].run(&q, &points, 0, POINTS, &answers);
        assert_memory_equal(values, truth, sizeof truth);
    }
}

/* Every kernel writes these points' one-bit answers into bytes that two runs share. */
static void check_shared_bytes(const struct umb__query *q)
{
    const size_t bytes = POINTS / 8 + 1;
    struct umb_points points = {.positions = doubles, .format = UMB_POINT_F64, .count = POINTS};
    struct kernel kernels[KERNELS];
    static uint8_t alone[POINTS / 8 + 1], bits[POINTS / 8 + 1];
    memcpy(points.origin, origin, sizeof origin);
    for (size_t i = 0; i < POINTS; i++) {
        umb__store_answer(alone, UMB_ANSWER_BIT, i, lit_alone(q, &points, i), 1);
    }
    for (size_t k = 0, count = list_kernels(kernels); k < count; k++) {
        for (size_t first = 0; first < 64; first++) {
            struct umb_answers answers = {.values = bits};
            memset(bits, 0xff, bytes);
            kernels[k].run(q, &points, 0, first, &answers);
            kernels[k].run(q, &points, first, POINTS - first, &answers);
            assert_memory_equal(bits, alone, bytes);
        }
    }
}

static const struct umb_query_settings one_bit = {
    .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_BIT};

/* Blocks that are answered at once stand between scattered blocks, which are answered later. A byte
 * that two blocks share must still be written in the order of the points. */
static void answers_of_a_bit_may_begin_within_a_byte(void **state)
{
    (void)state;
    const struct ground ground = {256, 256, 3};
    struct opened opened = ground_open(&ground, 1);
    struct umb_query query;
    uint64_t seed = 20261128;
    static double picture[POINTS][3];
    const struct umb__query *q = prepare(opened.asset, &one_bit, &query);
    make_picture(ground.size, 0.2, &seed);
    memcpy(picture, doubles, sizeof picture);
    make_points(ground.size, 0.9, &seed);
    for (size_t i = 0; i < POINTS; i++) {
        if (i / 150 % 2 == 0) {
            memcpy(doubles[i], picture[i], sizeof doubles[i]);
        }
    }
    check_shared_bytes(q);
    ground_close(&opened);
}

/* Blocks scattered over the frustum stand among blocks scattered over one small cube, whose points
 * have a common node, at which a shorter descent might begin. */
static void bits_of_blocks_in_one_cube_are_in_the_order_of_points(void **state)
{
    (void)state;
    const struct ground ground = {128, 32, 2};
    struct opened opened = ground_open(&ground, 8);
    struct umb_query query;
    uint64_t seed = 20261129;
    const struct umb__query *q = prepare(opened.asset, &one_bit, &query);
    assert_true(q->column_level > 5);
    make_points(ground.size, 0.9, &seed);
    for (size_t i = 0; i < POINTS; i++) {
        for (size_t k = 0; k < 3 && i / 150 % 2 == 0; k++) {
            doubles[i][k] = (32 + 32 * random_unit(&seed)) * voxel_m;
        }
    }
    check_shared_bytes(q);
    ground_close(&opened);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(kernels_agree_where_the_grid_leads_to_bricks),
        cmocka_unit_test(kernels_agree_where_the_grid_leads_to_level_five),
        cmocka_unit_test(kernels_agree_where_wide_nodes_stand_above_level_five),
        cmocka_unit_test(kernels_agree_on_planes_that_a_camera_sees),
        cmocka_unit_test(neighbours_in_one_brick_share_a_look_up),
        cmocka_unit_test(nodes_of_known_cells_are_counted_as_if_found_again),
        cmocka_unit_test(what_a_block_has_no_points_for_is_not_looked_up),
        cmocka_unit_test(equal_places_of_cubes_far_apart_are_different_bricks),
        cmocka_unit_test(answers_of_a_bit_may_begin_within_a_byte),
        cmocka_unit_test(bits_of_blocks_in_one_cube_are_in_the_order_of_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
