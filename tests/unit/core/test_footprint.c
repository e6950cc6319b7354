/* SPDX-License-Identifier: Apache-2.0 */
/* Footprints: small ones are windows, larger ones are plain means of single look-ups, and answers
 * are continuous between the two. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "footprint_kernels.h"
#include "umbrage/query.h"
#include "volume_fixture.h"

#define LOG2_SIZE 7U

enum {
    POINTS = 600,
    SAMPLES = 32
};

struct batch {
    double positions[POINTS][3];
    float normals[POINTS][3];
    float footprints[POINTS];
};

static void draw_batch(const struct volume_fixture *f, uint64_t seed, double widest_m,
                       struct batch *batch)
{
    for (size_t i = 0; i < POINTS; i++) {
        double v[3];
        for (unsigned k = 0; k < 3; k++) {
            v[k] = (random_unit(&seed) * 1.1 - 0.05) * f->size;
            batch->normals[i][k] = i % 5 == 0 ? 0 : (float)(random_unit(&seed) - 0.5);
        }
        fixture_world(f, v, batch->positions[i]);
        batch->footprints[i] = (float)(random_unit(&seed) * widest_m);
    }
}

static struct umb_points points_of(const struct batch *batch)
{
    struct umb_points points = {.positions = batch->positions,
                                .format = UMB_POINT_F64,
                                .normals = batch->normals,
                                .count = POINTS,
                                .footprints = batch->footprints};
    memcpy(points.origin, fixture_origin, sizeof fixture_origin);
    return points;
}

static void ask(const struct volume_fixture *f, const struct umb_query_settings *settings,
                const struct umb_points *points, void *values)
{
    struct umb_query query;
    struct umb_answers answers = {.values = values};
    assert_int_equal(umb_query_prepare(f->asset, settings, &query, NULL), UMB_OK);
    assert_int_equal(umb_points_check(points, NULL), UMB_OK);
    umb_query_run(&query, points, 0, points->count, &answers);
    assert_int_equal(answers.stats.points, points->count);
}

static double texel_of(const struct volume_fixture *f)
{
    double texel = 0;
    for (unsigned axis = 0; axis < 2; axis++) {
        const double *s = f->frustum.voxel_step[axis];
        texel += sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) / 2;
    }
    return texel;
}

static void footprints_up_to_the_window_are_the_window(void **state)
{
    (void)state;
    static struct batch batch;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 1, 0);
    for (uint32_t taps = 1; taps <= 9; taps += 4) {
        draw_batch(&f, taps, taps * texel_of(&f), &batch);
        for (int format = UMB_ANSWER_F32; format <= UMB_ANSWER_BIT; format++) {
            static uint8_t box[POINTS * 4], footprint[POINTS * 4];
            struct umb_query_settings settings = {.taps = taps,
                                                  .format = (enum umb_answer_format)format};
            const struct umb_points points = points_of(&batch);
            ask(&f, &settings, &points, box);
            settings.filter = UMB_FILTER_FOOTPRINT;
            ask(&f, &settings, &points, footprint);
            assert_memory_equal(box, footprint, umb_answer_bytes(settings.format, POINTS));
        }
    }
    volume_fixture_close(&f);
}

/* Computes a footprint as the header defines it: a square of the surface, lifted, with one tap at
 * each point of the lattice. */
static double plain_level(const struct volume_fixture *f, const double p[3], const float raw[3],
                          double side)
{
    struct umb_light_info light;
    double n[3] = {(double)raw[0], (double)raw[1], (double)raw[2]}, a[3], b[3], sum = 0;
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]), size = 0;
    unsigned least = 0;
    assert_int_equal(umb_asset_get_light(f->asset, 0, &light), UMB_OK);
    for (unsigned k = 0; k < 3; k++) {
        n[k] = length > 0 ? n[k] / length : -light.direction[k];
        least = fabs(n[k]) < fabs(n[least]) ? k : least;
    }
    for (unsigned k = 0; k < 3; k++) {
        a[k] = (k == least) - n[least] * n[k];
        size += a[k] * a[k];
    }
    for (unsigned k = 0; k < 3; k++) {
        a[k] /= sqrt(size);
    }
    for (unsigned k = 0; k < 3; k++) {
        b[k] = n[(k + 1) % 3] * a[(k + 2) % 3] - n[(k + 2) % 3] * a[(k + 1) % 3];
    }
    for (unsigned i = 0; i < SAMPLES; i++) {
        const double u = ((i + 0.5) / SAMPLES - 0.5) * side;
        const double v = ((i * 25 % SAMPLES + 0.5) / SAMPLES - 0.5) * side;
        double place[3];
        float value;
        for (unsigned k = 0; k < 3; k++) {
            place[k] = p[k] + u * a[k] + v * b[k] - side / 2 * light.direction[k];
        }
        struct umb_points one = {
            .positions = place, .format = UMB_POINT_F64, .normals = raw, .count = 1};
        memcpy(one.origin, fixture_origin, sizeof fixture_origin);
        ask(f, &(struct umb_query_settings){.taps = 1}, &one, &value);
        sum += (double)value;
    }
    return sum / SAMPLES;
}

/* Rounding may put a sample on the other side of a voxel's face: only at few points, and one sample
 * at each. */
static void levels_are_means_over_squares_of_the_surface(void **state)
{
    (void)state;
    static struct batch batch;
    static float values[POINTS];
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 1, 0);
    const double texel = texel_of(&f);
    draw_batch(&f, 71, 1, &batch);
    for (unsigned level = 1; level <= 5; level++) {
        unsigned differ = 0, between = 0;
        struct umb_points points = points_of(&batch);
        /* A footprint as wide as level + 1/2 is the mean of two levels. */
        points.footprints = NULL;
        struct umb_query_settings settings = {.filter = UMB_FILTER_FOOTPRINT,
                                              .footprint_m = texel * (1U << level) * 1.5};
        ask(&f, &settings, &points, values);
        for (size_t i = 0; i < POINTS; i++) {
            const double *p = batch.positions[i];
            const float *n = batch.normals[i];
            const double want = (plain_level(&f, p, n, texel * (1U << level)) +
                                 plain_level(&f, p, n, texel * (2U << level))) /
                                2;
            const double apart = fabs((double)values[i] - want);
            assert_true(apart < 1.5 / SAMPLES);
            differ += apart > 1e-6;
            between += want > 0.1 && want < 0.9;
        }
        assert_true(differ < POINTS / 50);
        assert_true(between > POINTS / 20);
    }
    volume_fixture_close(&f);
}

static void answers_are_continuous_in_the_footprint(void **state)
{
    (void)state;
    static struct batch near, far;
    static float below[POINTS], above[POINTS];
    struct volume_fixture f;
    uint64_t seed = 72;
    unsigned moved = 0;
    volume_fixture_open(&f, fixture_noise, LOG2_SIZE, 1, 0);
    for (unsigned turn = 0; turn < 12; turn++) {
        const struct umb_query_settings settings = {.taps = 1 + 2 * (turn % 3),
                                                    .filter = UMB_FILTER_FOOTPRINT};
        draw_batch(&f, 700 + turn, 30, &near);
        far = near;
        for (size_t i = 0; i < POINTS; i++) {
            /* In every third pair the two widths lie on both sides of a level. */
            const double edge = texel_of(&f) * settings.taps * (1U << i % 6);
            near.footprints[i] = i % 3 == 0 ? (float)(edge * 0.9999) : near.footprints[i];
            far.footprints[i] = near.footprints[i] * (float)(1 + 0.1 * random_unit(&seed));
        }
        const struct umb_points first = points_of(&near), second = points_of(&far);
        ask(&f, &settings, &first, below);
        ask(&f, &settings, &second, above);
        for (size_t i = 0; i < POINTS; i++) {
            const double from = (double)near.footprints[i], to = (double)far.footprints[i];
            const double step = fabs((double)above[i] - (double)below[i]);
            assert_true(step <= 2 * (to - from) / from + 1e-6);
            moved += step > 0.001;
        }
    }
    assert_true(moved > POINTS);
    volume_fixture_close(&f);
}

/* The slope falls two voxels a texel, with nothing above it. */
static int open_slope(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z + 0.5 < 30 + 0.4 * (x + 0.5) + 0.25 * (y + 0.5);
}

static void a_plane_is_lit_whatever_the_footprint(void **state)
{
    (void)state;
    static struct batch batch;
    static float values[POINTS];
    struct volume_fixture f;
    uint64_t seed = 73;
    volume_fixture_open(&f, open_slope, LOG2_SIZE, 1, 0);
    draw_batch(&f, 74, 20, &batch);
    /* In voxels the plane is 0.4 x + 0.25 y - z = -30. Its normal is the gradient, towards the
     * light. */
    double normal[3];
    for (unsigned k = 0; k < 3; k++) {
        const double(*m)[4] = f.frustum.world_to_voxel;
        normal[k] = 0.4 * m[0][k] + 0.25 * m[1][k] - m[2][k];
    }
    for (size_t i = 0; i < POINTS; i++) {
        const double x = random_unit(&seed) * f.size, y = random_unit(&seed) * f.size;
        const double v[3] = {x, y, 30 + 0.4 * x + 0.25 * y};
        fixture_world(&f, v, batch.positions[i]);
        for (unsigned k = 0; k < 3; k++) {
            batch.normals[i][k] = (float)normal[k];
        }
    }
    const struct umb_points points = points_of(&batch);
    ask(&f, &(struct umb_query_settings){.filter = UMB_FILTER_FOOTPRINT}, &points, values);
    for (size_t i = 0; i < POINTS; i++) {
        assert_true(values[i] == 1.0F);
    }
    volume_fixture_close(&f);
}

static void runs_of_any_length_give_the_same_bits(void **state)
{
    (void)state;
    static struct batch batch;
    static float whole[POINTS], parts[POINTS];
    static uint8_t bits[POINTS / 8 + 1], bit_parts[POINTS / 8 + 1];
    struct volume_fixture f;
    struct umb_query query, bit_query;
    volume_fixture_open(&f, fixture_noise, LOG2_SIZE, 1, 0);
    draw_batch(&f, 75, 12, &batch);
    const struct umb_points points = points_of(&batch);
    struct umb_query_settings settings = {.taps = 3, .filter = UMB_FILTER_FOOTPRINT};
    ask(&f, &settings, &points, whole);
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    settings.format = UMB_ANSWER_BIT;
    ask(&f, &settings, &points, bits);
    assert_int_equal(umb_query_prepare(f.asset, &settings, &bit_query, NULL), UMB_OK);
    for (size_t first = 0, count = 1; first < POINTS; first += count, count = count % 40 + 9) {
        const size_t left = POINTS - first;
        struct umb_answers answers = {.values = parts}, one_bits = {.values = bit_parts};
        umb_query_run(&query, &points, first, left < count ? left : count, &answers);
        umb_query_run(&bit_query, &points, first, left < count ? left : count, &one_bits);
    }
    assert_memory_equal(whole, parts, sizeof whole);
    assert_memory_equal(bits, bit_parts, POINTS / 8);
    for (size_t i = 0; i < POINTS; i++) {
        struct umb_explanation e;
        umb_query_explain(&query, &points, i, &e);
        assert_true((float)e.answer == whole[i]);
        assert_int_equal(bits[i / 8] >> i % 8 & 1, whole[i] >= 0.5F);
        assert_true(e.footprint_m == (double)batch.footprints[i]);
    }
    volume_fixture_close(&f);
}

/* Computes answers with every kernel; the counts must be the same, too. */
static void compare_kernels(const struct volume_fixture *f,
                            const struct umb_query_settings *settings,
                            const struct umb_points *points)
{
    static float values[3][POINTS];
    struct umb__kernels kernels[3];
    struct umb_query_stats first = {0};
    for (size_t k = 0, count = list_kernels(kernels); k < count; k++) {
        struct umb_query query;
        struct umb_answers answers = {.values = values[k]};
        assert_int_equal(umb_query_prepare(f->asset, settings, &query, NULL), UMB_OK);
        use_kernels(&query, &kernels[k]);
        umb_query_run(&query, points, 0, points->count, &answers);
        first = k == 0 ? answers.stats : first;
        assert_memory_equal(values[k], values[0], sizeof values[0]);
        assert_memory_equal(&answers.stats, &first, sizeof first);
    }
}

/* Squares of one texel and squares wider than the frustum, on its edges and far from it, for every
 * bias. */
static void every_kernel_gives_the_same_bits(void **state)
{
    (void)state;
    static struct batch batch;
    static const double wild[] = {0, 1e3, -1e7, 1e12, -1e30, 1e300};
    for (uint32_t log2_size = 6; log2_size <= 8; log2_size++) {
        struct volume_fixture f;
        volume_fixture_open(&f, log2_size == 7 ? fixture_hills : fixture_noise, log2_size, 1, 0);
        for (unsigned turn = 0; turn < 24; turn++) {
            struct umb_query_settings settings = {.taps = 1 + 2 * (turn % 3),
                                                  .bias_mode = (enum umb_bias_mode)(turn % 4),
                                                  .bias = 1.5,
                                                  .filter = UMB_FILTER_FOOTPRINT};
            draw_batch(&f, 7000 + turn, 0.3 * (1U << turn % 12), &batch);
            for (size_t i = 0; i < POINTS && turn % 5 == 0; i += 7) {
                batch.positions[i][i % 3] += wild[i % 6];
            }
            struct umb_points points = points_of(&batch);
            compare_kernels(&f, &settings, &points);
            points.footprints = points.normals = NULL;
            memcpy(settings.eye, fixture_origin, sizeof settings.eye);
            settings.pixel_rad = 0.01 * (1U << turn % 7);
            compare_kernels(&f, &settings, &points);
        }
        volume_fixture_close(&f);
    }
}

static void pixels_cover_more_of_a_surface_that_leans_away(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_query query;
    struct umb_explanation e;
    volume_fixture_open(&f, fixture_noise, 6, 0, 0);
    const struct umb_query_settings settings = {
        .filter = UMB_FILTER_FOOTPRINT,
        .eye = {fixture_origin[0], fixture_origin[1], fixture_origin[2] + 10},
        .pixel_rad = 0.01};
    /* A surface seen at a right angle, at 60 degrees, along the surface, and without a normal. */
    static const float normals[4][3] = {{0, 0, 3}, {0.8660254F, 0, 0.5F}, {1, 0, 0}, {0, 0, 0}};
    static const double sides[4] = {0.1, 0.1 * 1.41421356237, 0.4, 0.1};
    static const double positions[4][3] = {{0}};
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .normals = normals, .count = 4};
    memcpy(points.origin, fixture_origin, sizeof fixture_origin);
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    for (size_t i = 0; i < 4; i++) {
        umb_query_explain(&query, &points, i, &e);
        assert_true(fabs(e.footprint_m - sides[i]) < 1e-7);
    }
    volume_fixture_close(&f);
}

static void footprints_out_of_range_are_named(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_query query;
    struct umb_error error;
    volume_fixture_open(&f, fixture_noise, 6, 0, 0);
    const struct {
        struct umb_query_settings settings;
        const char *words;
    } cases[] = {
        {{.filter = UMB_FILTER_FOOTPRINT, .footprint_m = -1}, "footprint_m: -1, must be 0 to"},
        {{.filter = UMB_FILTER_FOOTPRINT, .footprint_m = NAN}, "footprint_m: nan"},
        {{.filter = UMB_FILTER_FOOTPRINT, .footprint_m = 1e7}, "footprint_m: 1e+07"},
        {{.filter = UMB_FILTER_FOOTPRINT, .pixel_rad = 1.5}, "pixel_rad: 1.5, must be 0 to 1"},
        {{.filter = UMB_FILTER_FOOTPRINT, .pixel_rad = NAN}, "pixel_rad: nan"},
        {{.filter = UMB_FILTER_FOOTPRINT, .pixel_rad = 0.1, .footprint_m = 2}, "give one of both"},
        {{.filter = UMB_FILTER_FOOTPRINT, .eye = {0, INFINITY, 0}}, "eye.y: inf"},
        {{.filter = UMB_FILTER_FOOTPRINT, .level = 3}, "level: 3 beside filter"},
        {{.pixel_rad = 0.1}, "pixel_rad: 0.1 belongs to the footprint filter"},
        {{.filter = (enum umb_filter)5}, "filter: 5, unknown"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(umb_query_prepare(f.asset, &cases[i].settings, &query, &error),
                         UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, cases[i].words));
    }
    const float positions[2][3] = {{0}}, bad[3][2] = {{0, -1}, {0, NAN}, {1, INFINITY}};
    for (size_t i = 0; i < 3; i++) {
        const struct umb_points points = {.positions = positions, .count = 2, .footprints = bad[i]};
        float values[2];
        struct umb_answers answers = {.values = values};
        assert_int_equal(umb_points_check(&points, &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "footprints[1]: "));
        const struct umb_query_settings settings = {.filter = UMB_FILTER_FOOTPRINT};
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, &error), UMB_OK);
        umb_query_run(&query, &points, 0, 2, &answers); /* without meaning, without harm */
    }
    volume_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(footprints_up_to_the_window_are_the_window),
        cmocka_unit_test(levels_are_means_over_squares_of_the_surface),
        cmocka_unit_test(answers_are_continuous_in_the_footprint),
        cmocka_unit_test(a_plane_is_lit_whatever_the_footprint),
        cmocka_unit_test(runs_of_any_length_give_the_same_bits),
        cmocka_unit_test(every_kernel_gives_the_same_bits),
        cmocka_unit_test(pixels_cover_more_of_a_surface_that_leans_away),
        cmocka_unit_test(footprints_out_of_range_are_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
