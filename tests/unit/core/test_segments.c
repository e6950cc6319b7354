/* SPDX-License-Identifier: Apache-2.0 */
/* Lit intervals of segments, compared with a march through every voxel and with points. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "volume_fixture.h"

enum {
    INTERVALS = 600,
    FEW = 20000
};

/* One axis of the march: the planes of the frustum, in the order they are passed. */
struct march_axis {
    double start, inverse;
    int step;
    int32_t size, passed; /* planes passed so far, of size + 1 */
};

static double plane_at(const struct march_axis *a, int32_t nth)
{
    int32_t plane = a->step > 0 ? nth : a->size - nth;
    return ((double)plane - a->start) * a->inverse;
}

static int64_t march_index(struct march_axis *a, double t)
{
    if (a->step == 0) {
        double floored = floor(a->start);
        return floored < 0 ? -1 : floored > a->size ? a->size : (int64_t)floored;
    }
    while (a->passed <= a->size && plane_at(a, a->passed) <= t) {
        a->passed++;
    }
    return a->step > 0 ? a->passed - 1 : a->size - a->passed;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The header's definition, evaluated voxel by voxel. Returns the number of intervals. */
static size_t march(const struct volume_fixture *f, const double v[2][3],
                    struct umb_interval intervals[INTERVALS], double *lit)
{
    static double at[3 * 300 + 2];
    struct march_axis axes[3];
    size_t count = 1, found = 0;
    at[0] = 0;
    for (unsigned k = 0; k < 3; k++) {
        double slope = v[1][k] - v[0][k];
        const double slower = slope != 0 ? 1 / slope : INFINITY;
        axes[k] = (struct march_axis){v[0][k], slower, 0, (int32_t)f->size, 0};
        axes[k].step = isfinite(slower) ? (slope > 0 ? 1 : -1) : 0;
        for (int32_t n = 0; axes[k].step != 0 && n <= axes[k].size; n++) {
            double t = plane_at(&axes[k], n);
            if (t > 0 && t < 1) {
                at[count++] = t;
            }
        }
    }
    qsort(at, count, sizeof at[0], by_value);
    at[count] = 1;
    int before = 0;
    *lit = 0;
    for (size_t i = 0; i < count; i++) {
        int64_t x = march_index(&axes[0], at[i]), y = march_index(&axes[1], at[i]);
        int now = fixture_voxel(f, x, y, march_index(&axes[2], at[i]));
        if (at[i] == at[i + 1]) {
            continue; /* two planes at once: the voxel between them is not entered */
        }
        if (now && !before) {
            intervals[found].begin = at[i];
        } else if (!now && before) {
            intervals[found].end = at[i];
            *lit += intervals[found].end - intervals[found].begin;
            found++;
        }
        before = now;
    }
    if (before) {
        intervals[found].end = 1;
        *lit += 1 - intervals[found].begin;
        found++;
    }
    return found;
}

/* Draws ends in voxels: anywhere, on voxel boundaries, along axes, through corners, very near each
 * other, very far away. */
static void random_ends(uint64_t *seed, double size, double v[2][3])
{
    uint64_t kind = next_random(seed) % 8;
    for (unsigned k = 0; k < 3; k++) {
        v[0][k] = (random_unit(seed) * 1.4 - 0.2) * size;
        v[1][k] = (random_unit(seed) * 1.4 - 0.2) * size;
        if (kind == 1 || kind == 2) { /* whole and half voxels: many planes meet at once */
            v[0][k] = floor(v[0][k] * 2) / 2;
            v[1][k] = floor(v[1][k] * 2) / 2;
        }
    }
    unsigned axis = (unsigned)(next_random(seed) % 3);
    double length = (double)(next_random(seed) % 200) - 100;
    for (unsigned k = 0; k < 3; k++) {
        if (kind == 3) {
            v[0][k] = floor(v[0][k]);
            v[1][k] = v[0][k] + (next_random(seed) % 2 ? length : -length);
        } else if (kind == 4 && k != axis) {
            v[1][k] = v[0][k];
        } else if (kind == 5) {
            v[1][k] = v[0][k] + (random_unit(seed) - 0.5) * 1e-3;
        } else if (kind == 6) {
            v[1][k] = v[0][k] + (random_unit(seed) - 0.5) * 1e7;
        }
    }
    if (next_random(seed) % 200 == 0) {
        memcpy(v[1], v[0], sizeof v[1]);
    }
}

static void expect_march(const struct volume_fixture *f, const double p[2][3], size_t number)
{
    static struct umb_interval found[INTERVALS], marched[INTERVALS];
    struct umb_segment_answer answer;
    struct umb_segments segments = {.ends = p, .format = UMB_POINT_F64, .count = 1};
    struct umb_segment_answers answers = {
        .segments = &answer, .intervals = found, .interval_max = INTERVALS};
    double v[2][3], q[2][3], lit;
    memcpy(segments.origin, fixture_origin, sizeof fixture_origin);
    for (unsigned e = 0; e < 2; e++) {
        memcpy(q[e], p[e], sizeof q[e]);
        fixture_voxel_of(f, q[e], v[e]);
    }
    umb_volume_segments(&f->volume, &segments, 0, 1, &answers);
    size_t count = march(f, v, marched, &lit);
    int same = count == answer.interval_count && lit == answer.lit;
    for (size_t i = 0; same && i < count; i++) {
        same = found[i].begin == marched[i].begin && found[i].end == marched[i].end;
    }
    if (!same) {
        fail_msg("case %zu: %.17g %.17g %.17g to %.17g %.17g %.17g: %zu stretches, %.17g lit; the "
                 "march has %zu, %.17g",
                 number, v[0][0], v[0][1], v[0][2], v[1][0], v[1][1], v[1][2],
                 (size_t)answer.interval_count, answer.lit, count, lit);
    }
}

static void expect_marches(voxel_fn lit, uint32_t log2_size, int turned, uint64_t seed)
{
    struct volume_fixture f;
    volume_fixture_open(&f, lit, log2_size, turned, 0);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (size_t i = 0; i < (size_t)case_count(short_count(FEW, FEW / 4)); i++) {
        double v[2][3], p[2][3];
        random_ends(&seed, f.size, v);
        fixture_world(&f, v[0], p[0]);
        fixture_world(&f, v[1], p[1]);
        expect_march(&f, p, i);
    }
    volume_fixture_close(&f);
}

static void intervals_equal_a_march_through_every_voxel(void **state)
{
    (void)state;
    expect_marches(fixture_noise, 7, 0, 11);
}

static void intervals_equal_a_march_in_a_turned_frame(void **state)
{
    (void)state;
    expect_marches(fixture_noise, 6, 1, 12);
    expect_marches(fixture_hills, 7, 1, 13);
}

static void segments_beyond_the_reach_of_doubles_still_end_and_agree(void **state)
{
    (void)state;
    struct volume_fixture f;
    static const double far[] = {1e15, -1e17, 3e18, 1e300, -1e306, 1e-310, -1e-300, 5};
    uint64_t seed = 14;
    volume_fixture_open(&f, fixture_noise, 6, 0, 0);
    for (size_t i = 0; i < 4000; i++) {
        double p[2][3];
        for (unsigned k = 0; k < 6; k++) {
            p[k / 3][k % 3] = far[next_random(&seed) % 8] * random_unit(&seed);
        }
        expect_march(&f, p, i);
    }
    volume_fixture_close(&f);
}

static void points_within_intervals_are_lit_and_others_shadowed(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 15;
    volume_fixture_open(&f, fixture_noise, 7, 1, 0);
    struct umb_query query;
    struct umb_query_settings settings = {.taps = 1, .bias_mode = UMB_BIAS_NONE};
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    for (size_t i = 0; i < 5000; i++) {
        static struct umb_interval found[INTERVALS];
        struct umb_segment_answer answer;
        double v[2][3], p[2][3], at[3], t = random_unit(&seed);
        random_ends(&seed, f.size, v);
        fixture_world(&f, v[0], p[0]);
        fixture_world(&f, v[1], p[1]);
        struct umb_segments segments = {.ends = p, .format = UMB_POINT_F64, .count = 1};
        struct umb_segment_answers answers = {
            .segments = &answer, .intervals = found, .interval_max = INTERVALS};
        memcpy(segments.origin, fixture_origin, sizeof fixture_origin);
        umb_volume_segments(&f.volume, &segments, 0, 1, &answers);
        int inside = 0, near = 0;
        for (size_t k = 0; k < answer.interval_count; k++) {
            inside |= t >= found[k].begin && t < found[k].end;
            near |= fabs(t - found[k].begin) < 1e-9 || fabs(t - found[k].end) < 1e-9;
        }
        double span = fabs(v[1][0] - v[0][0]) + fabs(v[1][1] - v[0][1]) + fabs(v[1][2] - v[0][2]);
        if (near || span < 1) {
            continue; /* rounding decides there */
        }
        for (unsigned k = 0; k < 3; k++) {
            at[k] = p[0][k] + t * (p[1][k] - p[0][k]);
        }
        float value = 0;
        struct umb_points points = {.positions = at, .format = UMB_POINT_F64, .count = 1};
        struct umb_answers point = {.values = &value};
        memcpy(points.origin, fixture_origin, sizeof fixture_origin);
        umb_query_run(&query, &points, 0, 1, &point);
        assert_int_equal(inside, value == 1.0F);
    }
    volume_fixture_close(&f);
}

static void intervals_that_do_not_fit_are_counted_and_added_up(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_noise, 7, 0, 0);
    const float ends[6] = {-1, 3, 2, 40, 29, 31};
    struct umb_interval all[INTERVALS], two[3] = {{7, 7}, {7, 7}, {7, 7}};
    struct umb_segment_answer whole, part, none;
    struct umb_segments segments = {.ends = ends, .count = 1};
    struct umb_segment_answers a = {
        .segments = &whole, .intervals = all, .interval_max = INTERVALS};
    struct umb_segment_answers b = {.segments = &part, .intervals = two, .interval_max = 2};
    struct umb_segment_answers c = {.segments = &none};
    memcpy(segments.origin, fixture_origin, sizeof fixture_origin);
    umb_volume_segments(&f.volume, &segments, 0, 1, &a);
    umb_volume_segments(&f.volume, &segments, 0, 1, &b);
    umb_volume_segments(&f.volume, &segments, 0, 1, &c);
    assert_true(whole.interval_count > 3);
    assert_memory_equal(&whole, &part, sizeof whole);
    assert_memory_equal(&whole, &none, sizeof whole);
    assert_memory_equal(all, two, 2 * sizeof all[0]);
    assert_true(two[2].begin == 7);
    double length = sqrt(41.0 * 41 + 26 * 26 + 29 * 29);
    assert_true(fabs(whole.lit_m - whole.lit * length) < 1e-9);
    volume_fixture_close(&f);
}

static void segments_that_are_not_finite_are_named_and_do_no_harm(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_error error;
    double ends[2][6] = {{1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, NAN, 6}};
    struct umb_segment_answer out[2];
    struct umb_segments segments = {.ends = ends, .format = UMB_POINT_F64, .count = 2};
    struct umb_segment_answers answers = {.segments = out};
    volume_fixture_open(&f, fixture_noise, 6, 0, 0);
    assert_int_equal(umb_segments_check(&segments, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "segments[1].y1: nan"));
    umb_volume_segments(&f.volume, &segments, 0, 2, &answers);
    ends[1][4] = INFINITY;
    umb_volume_segments(&f.volume, &segments, 0, 2, &answers);
    ends[1][4] = -1.7e308;
    ends[1][1] = 1.7e308;
    assert_int_equal(umb_segments_check(&segments, &error), UMB_OK);
    umb_volume_segments(&f.volume, &segments, 0, 2, &answers);
    assert_true(out[1].lit == 1);
    segments.origin[2] = NAN;
    assert_int_equal(umb_segments_check(&segments, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "origin.z"));
    volume_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(intervals_equal_a_march_through_every_voxel),
        cmocka_unit_test(intervals_equal_a_march_in_a_turned_frame),
        cmocka_unit_test(segments_beyond_the_reach_of_doubles_still_end_and_agree),
        cmocka_unit_test(points_within_intervals_are_lit_and_others_shadowed),
        cmocka_unit_test(intervals_that_do_not_fit_are_counted_and_added_up),
        cmocka_unit_test(segments_that_are_not_finite_are_named_and_do_no_harm),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
