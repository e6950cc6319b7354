/* SPDX-License-Identifier: Apache-2.0 */
/* Penumbras, compared with a search that marches every column voxel by voxel, and with a disc's
 * edge. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "format/occluder_depth_build.h"
#include "volume_fixture.h"

#define LOG2_SIZE 7U
#define SIZE      (1 << LOG2_SIZE)

enum {
    POINTS = 400
};

/* Roofs at several depths, poles, and a ground that slopes. */
static uint32_t town(uint32_t x, uint32_t y)
{
    const uint64_t h = fixture_hash(x / 24, y / 20, 5);
    if (fixture_hash(x, y, 9) % 400 == 0) {
        return 20;
    }
    return h % 3 == 0 ? 10 + (uint32_t)(h >> 8) % 70 : 100 + x / 16 + y / 32;
}

/* A wall that ends at a straight edge. */
static uint32_t wall(uint32_t x, uint32_t y)
{
    (void)y;
    return x < SIZE / 2 ? 16 : SIZE;
}

/* Nothing but a slope of one voxel a texel. */
static uint32_t slope(uint32_t x, uint32_t y)
{
    (void)y;
    return x;
}

/* The slope under a roof that ends at a straight edge along it. */
static uint32_t roofed_slope(uint32_t x, uint32_t y)
{
    return y < SIZE / 2 ? 4 : x;
}

struct columns {
    uint32_t (*depth)(uint32_t x, uint32_t y);
    uint32_t undefined; /* voxels behind the first occluder that the file holds as lit */
};

static int column_voxel(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const struct columns *columns = user;
    (void)frustum;
    return z < columns->depth(x, y) + (columns->depth(x, y) < SIZE ? columns->undefined : 0);
}

/* Makes the occluder depth map of columns that have undefined voxels behind their first occluder.
 * Returns its words, which the caller frees. */
static uint32_t *occluder_depth_of(const struct columns *columns, uint64_t *count)
{
    struct umb__occluder_depth occluder_depth;
    uint32_t *words;
    assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, LOG2_SIZE, 1U << 26, NULL),
                     UMB_OK);
    for (uint32_t square = 0; square < SIZE * SIZE / 4096; square++) {
        int32_t lit[64][64], end[64][64];
        const uint32_t x0 = square % (SIZE / 64) * 64, y0 = square / (SIZE / 64) * 64;
        for (uint32_t i = 0; i < 4096; i++) {
            const uint32_t block = i / 64;
            const uint32_t depth =
                columns->depth(x0 + block % 8 * 8 + i % 8, y0 + block / 8 * 8 + i % 64 / 8);
            lit[block][i % 64] = (int32_t)depth;
            end[block][i % 64] = (int32_t)(depth < SIZE ? depth + columns->undefined : depth);
        }
        assert_int_equal(umb__occluder_depth_add(&occluder_depth, x0 / 64, y0 / 64,
                                                 (const int32_t(*)[64])lit,
                                                 (const int32_t(*)[64])end, NULL),
                         UMB_OK);
    }
    assert_int_equal(umb__occluder_depth_join(&occluder_depth, 1, &words, count, NULL), UMB_OK);
    umb__occluder_depth_finish(&occluder_depth);
    return words;
}

struct scene {
    struct columns columns;
    struct bytes file;
    struct umb_asset *asset;
    struct umb_frustum_info frustum;
};

static void scene_open(struct scene *s, uint32_t (*depth)(uint32_t x, uint32_t y), int turned,
                       uint32_t undefined, int with_occluder_depth)
{
    *s = (struct scene){.columns = {depth, undefined}};
    const struct voxels voxels = {column_voxel, &s->columns, LOG2_SIZE, 1};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.25, fixture_origin, &content);
    content.frusta[0].closed = undefined > 0;
    if (turned) {
        fixture_turn(&content.frusta[0]);
    }
    content.occluder_depth =
        with_occluder_depth ? occluder_depth_of(&s->columns, &content.occluder_depth_words) : NULL;
    struct umb_sink sink = bytes_sink(&s->file);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK ||
        umb_asset_open_bytes(s->file.data, s->file.size, NULL, &s->asset, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(umb_asset_get_frustum(s->asset, 0, &s->frustum), UMB_OK);
    umb__octree_finish(&octree);
    umb__occluder_depth_words_free(NULL, content.occluder_depth);
}

static void scene_close(struct scene *s)
{
    umb_asset_close(s->asset);
    bytes_finish(&s->file);
}

static double length3(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Finds the first shadowed voxel of a column, one voxel after the other. */
static int64_t march(const struct scene *s, int64_t x, int64_t y)
{
    int64_t z = 0;
    const struct columns open = {s->columns.depth, 0};
    while (z < SIZE && column_voxel(&open, 0, (uint32_t)x, (uint32_t)y, (uint32_t)z)) {
        z++;
    }
    return z;
}

/* The search as documented: returns the depth between a receiver and its blockers; 0 if nothing
 * blocks. */
static double plain_gap(const struct scene *s, const double v[3], const double reach[2])
{
    double gaps = 0, cover = 0;
    for (int64_t outer = 0; outer <= 1024; outer = outer ? 2 * outer : 1) {
        const int64_t inner = outer / 2, stride = outer > 4 ? outer / 4 : 1;
        for (int64_t j = -outer; j <= outer; j += stride) {
            for (int64_t i = -outer; i <= outer; i += stride) {
                const int64_t far = llabs(i) > llabs(j) ? llabs(i) : llabs(j);
                const int64_t x = (int64_t)floor(v[0]) + i, y = (int64_t)floor(v[1]) + j;
                if ((far <= inner && outer > 0) || x < 0 || x >= SIZE || y < 0 || y >= SIZE) {
                    continue;
                }
                const int64_t z = march(s, x, y);
                const double gap = v[2] - ((double)z + 0.5);
                if (z < SIZE && gap >= 0 && fabs((double)x + 0.5 - v[0]) - 0.5 <= reach[0] * gap &&
                    fabs((double)y + 0.5 - v[1]) - 0.5 <= reach[1] * gap) {
                    gaps += (double)(stride * stride) / gap;
                    cover += (double)(stride * stride) / (gap * gap);
                }
            }
        }
    }
    return cover > 0 ? gaps / cover : 0;
}

/* The box as documented: each texel counts by the part of it that a box around the receiver's texel
 * covers. */
static double plain_share(const struct scene *s, const double v[3], int64_t z, double width,
                          double height)
{
    double lit = 0, all = 0;
    const int64_t far = (int64_t)(fmax(width, height) / 2) + 2;
    for (int64_t j = -far; j <= far; j++) {
        const double row = fmin(1, fmax(0, (height + 1) / 2 - fabs((double)j)));
        for (int64_t i = -far; i <= far && row > 0; i++) {
            const double part = row * fmin(1, fmax(0, (width + 1) / 2 - fabs((double)i)));
            const int64_t x = (int64_t)floor(v[0]) + i, y = (int64_t)floor(v[1]) + j;
            const bool inside = x >= 0 && x < SIZE && y >= 0 && y < SIZE && z >= 0;
            const int64_t depth = z < SIZE ? z : SIZE - 1;
            all += part;
            lit += part * (!inside ||
                           column_voxel(&s->columns, 0, (uint32_t)x, (uint32_t)y, (uint32_t)depth));
        }
    }
    return lit / all;
}

/* What the header promises for points that are not moved; there is no lift, either. */
static double plain_penumbra(const struct scene *s, const double v[3], double extent, uint32_t taps)
{
    double reach[2], width[2];
    for (unsigned k = 0; k < 2; k++) {
        reach[k] =
            tan(extent / 2) * length3(s->frustum.voxel_step[2]) / length3(s->frustum.voxel_step[k]);
    }
    if (!(v[2] >= 0)) {
        return 1;
    }
    const double gap = plain_gap(s, v, reach);
    for (unsigned k = 0; k < 2; k++) {
        width[k] = fmax(taps, sqrt(acos(-1.0)) * reach[k] * gap);
    }
    return plain_share(s, v, (int64_t)floor(v[2]), width[0], width[1]);
}

static struct umb_query prepared(const struct scene *s, struct umb_query_settings settings)
{
    struct umb_query query;
    struct umb_error error = {0};
    settings.filter = UMB_FILTER_PENUMBRA;
    if (umb_query_prepare(s->asset, &settings, &query, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return query;
}

/* Asks one point of voxel space. */
static float ask(const struct scene *s, const struct umb_query *query, double v[3],
                 const float *normal)
{
    const struct volume_fixture frame = {.frustum = s->frustum};
    double p[3];
    float value = -1;
    fixture_world(&frame, v, p);
    fixture_voxel_of(&frame, p, v);
    struct umb_points points = {
        .positions = p, .format = UMB_POINT_F64, .normals = normal, .count = 1};
    struct umb_answers answers = {.values = &value};
    memcpy(points.origin, fixture_origin, sizeof fixture_origin);
    umb_query_run(query, &points, 0, 1, &answers);
    assert_int_equal(answers.stats.points, 1);
    return value;
}

static void penumbras_are_those_of_a_march_through_every_voxel(void **state)
{
    static const double extents[] = {0.02, 0.2, 0.9};
    uint64_t seed = 71;
    size_t half = 0;
    (void)state;
    for (int turned = 0; turned < 2; turned++) {
        struct scene s;
        scene_open(&s, town, turned, 0, 0);
        for (size_t i = 0; i < POINTS; i++) {
            const double extent = extents[i % 3];
            const uint32_t taps = i % 4 == 3 ? 5 : 1;
            const struct umb_query query =
                prepared(&s, (struct umb_query_settings){
                                 .light_extent = extent, .taps = taps, .bias_mode = UMB_BIAS_NONE});
            double v[3];
            for (unsigned k = 0; k < 3; k++) {
                v[k] = (random_unit(&seed) * 1.2 - 0.1) * SIZE;
            }
            v[2] = i % 2 ? v[2] : 95 + random_unit(&seed) * 10;
            const double got = (double)ask(&s, &query, v, NULL);
            const double want = plain_penumbra(&s, v, extent, taps);
            if (!(fabs(got - want) <= 1e-6)) {
                fail_msg("point %zu at %.17g %.17g %.17g: %.9g, must be %.9g", i, v[0], v[1], v[2],
                         got, want);
            }
            half += got > 0.05 && got < 0.95;
        }
        scene_close(&s);
    }
    assert_true(half > POINTS / 10);
}

/* A closed asset must answer as the open one, although voxels behind its occluders are undefined.
 * Its occluder depth map has the occluders; its columns alone would have them three voxels
 * deeper. */
static void the_front_of_a_closed_asset_gives_the_penumbras_of_the_open_one(void **state)
{
    struct scene open, closed;
    uint64_t seed = 72;
    (void)state;
    scene_open(&open, town, 0, 0, 0);
    scene_open(&closed, town, 0, 3, 1);
    const struct umb_query_settings settings = {.light_extent = 0.3, .bias_mode = UMB_BIAS_NONE};
    const struct umb_query of_open = prepared(&open, settings);
    const struct umb_query of_closed = prepared(&closed, settings);
    for (size_t i = 0; i < POINTS; i++) {
        double v[3] = {random_unit(&seed) * SIZE, random_unit(&seed) * SIZE, 95};
        const float value = ask(&open, &of_open, v, NULL);
        assert_true(ask(&closed, &of_closed, v, NULL) == value);
    }
    scene_close(&open);
    scene_close(&closed);
}

/* Returns the share of a disc of radius 1 on one side of a line at -1..1. */
static double disc_share(double at)
{
    at = fmax(-1, fmin(1, at));
    return 0.5 + (at * sqrt(1 - at * at) + asin(at)) / acos(-1.0);
}

static void a_straight_edge_makes_the_penumbra_of_a_disc_without_steps(void **state)
{
    struct scene s;
    (void)state;
    scene_open(&s, wall, 0, 0, 0);
    const struct umb_query query =
        prepared(&s, (struct umb_query_settings){.light_extent = 0.3, .bias_mode = UMB_BIAS_NONE});
    const double gap = 100.25 - 16.5, radius = tan(0.15) * gap;
    double last = 0, worst = 0;
    for (double x = SIZE / 2 - 20.5; x < SIZE / 2 + 20; x += 0.125) {
        double v[3] = {x, 70.3, 100.25};
        const double value = (double)ask(&s, &query, v, NULL);
        worst = fmax(worst, fabs(value - disc_share((floor(x) + 0.5 - SIZE / 2) / radius)));
        assert_true(value >= last - 1e-6);
        assert_true(value - last <= 1.2 / (sqrt(acos(-1.0)) * radius)); /* a texel of the box */
        last = value;
    }
    assert_true(last == 1);
    /* A box of the disc's area is off by at most 0.054, where it ends; and half a texel. */
    assert_true(worst <= 0.06);
    scene_close(&s);
}

static void a_slope_does_not_shadow_itself_however_wide_the_light_is(void **state)
{
    /* The slope's plane, x = z, seen from the light's side: towards smaller z and larger x. */
    static const float normal[3] = {1, 0, -1};
    struct scene s;
    uint64_t seed = 73;
    (void)state;
    scene_open(&s, slope, 0, 0, 0);
    for (uint32_t taps = 1; taps <= 9; taps += 4) {
        const struct umb_query query =
            prepared(&s, (struct umb_query_settings){.light_extent = 0.9, .taps = taps});
        for (size_t i = 0; i < 200; i++) {
            const double x = 20 + random_unit(&seed) * 90;
            double v[3] = {x, random_unit(&seed) * SIZE, x};
            const float value = ask(&s, &query, v, normal);
            if (value != 1) {
                fail_msg("taps %u at x %.9g: %.9g", taps, x, (double)value);
            }
        }
    }
    scene_close(&s);
}

/* The penumbra of an edge over a slope is that over a flat ground: the box is lifted off the slope.
 */
static void a_slope_in_a_penumbra_does_not_shadow_itself(void **state)
{
    static const float normal[3] = {1, 0, -1};
    struct scene s;
    double worst = 0;
    (void)state;
    scene_open(&s, roofed_slope, 0, 0, 0);
    const struct umb_query query = prepared(&s, (struct umb_query_settings){.light_extent = 0.3});
    for (double x = 60.25; x < 100; x += 7) {
        for (double y = SIZE / 2 - 15.5; y < SIZE / 2 + 16; y += 1) {
            double v[3] = {x, y, x};
            const double radius = tan(0.15) * (x - 0.5 - 4.5);
            const double want = disc_share((y - SIZE / 2) / radius);
            worst = fmax(worst, fabs((double)ask(&s, &query, v, normal) - want));
        }
    }
    assert_true(worst <= 0.08); /* a box for a disc: 0.054; its place and depth in whole voxels */
    scene_close(&s);
}

/* A receiver at the very centre of its column's first shadowed voxel has no gap to its blocker. Its
 * answer must be that of a receiver close by. */
static void a_receiver_at_the_centre_of_its_blocker_is_in_no_wide_penumbra(void **state)
{
    struct scene s;
    (void)state;
    scene_open(&s, wall, 0, 0, 0);
    const struct umb_query query =
        prepared(&s, (struct umb_query_settings){.light_extent = 0.3, .bias_mode = UMB_BIAS_NONE});
    for (double x = SIZE / 2 - 6.5; x < SIZE / 2; x += 1) {
        double at[3] = {x, 70.5, 16.5}, near[3] = {x, 70.5, 16.500001};
        const float value = ask(&s, &query, at, NULL);
        assert_true(at[2] == 16.5); /* the world's place of it is exact */
        assert_true(value == 0);
        assert_true(ask(&s, &query, near, NULL) == value);
    }
    scene_close(&s);
}

static void all_formats_and_splits_tell_the_same(void **state)
{
    static double positions[POINTS][3];
    static float values[POINTS], parts[POINTS];
    static uint8_t bytes[POINTS], bits[POINTS / 8];
    uint64_t seed = 74;
    struct scene s;
    (void)state;
    scene_open(&s, town, 1, 0, 0);
    const struct volume_fixture frame = {.frustum = s.frustum};
    for (size_t i = 0; i < POINTS; i++) {
        const double v[3] = {random_unit(&seed) * SIZE, random_unit(&seed) * SIZE, 90};
        fixture_world(&frame, v, positions[i]);
    }
    struct umb_points points = {.positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    memcpy(points.origin, fixture_origin, sizeof fixture_origin);
    struct umb_query_settings settings = {.light_extent = 0.2};
    struct umb_answers floats = {.values = values}, split = {.values = parts};
    struct umb_answers u8 = {.values = bytes}, one = {.values = bits};
    struct umb_query query = prepared(&s, settings);
    umb_query_run(&query, &points, 0, POINTS, &floats);
    umb_query_run(&query, &points, 0, 17, &split);
    umb_query_run(&query, &points, 17, POINTS - 17, &split);
    assert_memory_equal(values, parts, sizeof values);
    assert_memory_equal(&floats.stats, &split.stats, sizeof floats.stats);
    settings.format = UMB_ANSWER_U8;
    query = prepared(&s, settings);
    umb_query_run(&query, &points, 0, POINTS, &u8);
    settings.format = UMB_ANSWER_BIT;
    query = prepared(&s, settings);
    umb_query_run(&query, &points, 0, POINTS, &one);
    for (size_t i = 0; i < POINTS; i++) {
        assert_true(fabs(bytes[i] - 255.0 * (double)values[i]) <= 0.501);
        assert_int_equal(bits[i / 8] >> i % 8 & 1, values[i] >= 0.5F);
    }
    scene_close(&s);
}

static void what_has_no_penumbra_is_refused_with_the_reason(void **state)
{
    static const struct {
        int closed;
        struct umb_query_settings settings;
        enum umb_status status;
        const char *message;
    } cases[] = {
        {0, {.filter = UMB_FILTER_PENUMBRA}, UMB_E_UNSUPPORTED, "light 0 is 0 rad across"},
        {0, {.filter = UMB_FILTER_PENUMBRA, .light_extent = 1.5}, UMB_E_ARGUMENT, "0 to 1"},
        {0, {.filter = UMB_FILTER_PENUMBRA, .light_extent = -1}, UMB_E_ARGUMENT, "-1 rad"},
        {0, {.filter = UMB_FILTER_PENUMBRA, .light_extent = NAN}, UMB_E_ARGUMENT, "nan"},
        {0, {.light_extent = 0.1}, UMB_E_ARGUMENT, "belongs to the penumbra filter"},
        {0,
         {.filter = UMB_FILTER_PENUMBRA, .light_extent = 0.1, .level = 3},
         UMB_E_ARGUMENT,
         "filter"},
        {1, {.filter = UMB_FILTER_PENUMBRA, .light_extent = 0.1}, UMB_E_UNSUPPORTED, "front=on"},
    };
    struct scene scenes[2];
    (void)state;
    scene_open(&scenes[0], town, 0, 0, 0);
    scene_open(&scenes[1], town, 0, 3, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb_query query;
        struct umb_error error = {0};
        assert_int_equal(
            umb_query_prepare(scenes[cases[i].closed].asset, &cases[i].settings, &query, &error),
            cases[i].status);
        assert_non_null(strstr(error.message, cases[i].message));
    }
    scene_close(&scenes[0]);
    scene_close(&scenes[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(penumbras_are_those_of_a_march_through_every_voxel),
        cmocka_unit_test(the_front_of_a_closed_asset_gives_the_penumbras_of_the_open_one),
        cmocka_unit_test(a_straight_edge_makes_the_penumbra_of_a_disc_without_steps),
        cmocka_unit_test(a_slope_does_not_shadow_itself_however_wide_the_light_is),
        cmocka_unit_test(a_slope_in_a_penumbra_does_not_shadow_itself),
        cmocka_unit_test(a_receiver_at_the_centre_of_its_blocker_is_in_no_wide_penumbra),
        cmocka_unit_test(all_formats_and_splits_tell_the_same),
        cmocka_unit_test(what_has_no_penumbra_is_refused_with_the_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
