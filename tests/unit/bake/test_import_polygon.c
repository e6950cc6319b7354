/* SPDX-License-Identifier: Apache-2.0 */
/* Ear clipping and number parsing, without files. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bake/import/polygon_clip.h"
#include "bake/import/text_number.h"

static struct umbb_polygon polygon;

static void fill(const double (*flat)[2], uint32_t count, double lift)
{
    struct umb_error error;
    assert_int_equal(umbb_polygon_reserve(&polygon, count, &error), UMB_OK);
    for (uint32_t i = 0; i < count; i++) {
        polygon.points[i][0] = flat[i][0];
        polygon.points[i][1] = flat[i][1];
        polygon.points[i][2] = lift * (flat[i][0] + 2.0 * flat[i][1]);
    }
    umbb_polygon_triangulate(&polygon, count);
}

static double twice_area(uint32_t triangle)
{
    const uint32_t *t = polygon.triangles[triangle];
    const double *a = polygon.points[t[0]];
    const double *b = polygon.points[t[1]];
    const double *c = polygon.points[t[2]];
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/* Every triangle must have the polygon's orientation, and together they must have its area: then
 * each place is covered once. */
static void expect_cover(const double (*flat)[2], uint32_t count, double area, double tolerance)
{
    double sum = 0.0;
    uint8_t used[4096] = {0};
    fill(flat, count, 0.25);
    for (uint32_t i = 0; i + 2 < count; i++) {
        double twice = twice_area(i);
        assert_true(area > 0 ? twice >= 0 : twice <= 0);
        sum += twice / 2.0;
        for (int k = 0; k < 3; k++) {
            assert_in_range(polygon.triangles[i][k], 0, count - 1);
            used[polygon.triangles[i][k]] = 1;
        }
    }
    for (uint32_t i = 0; i < count; i++) {
        assert_true(used[i]); /* no corner is left out */
    }
    if (!(fabs(sum - area) <= tolerance)) {
        print_error("area %.17g, expected %.17g\n", sum, area);
        fail();
    }
}

static void simple_polygons_are_covered_once(void **state)
{
    (void)state;
    static const double square[4][2] = {{0, 0}, {2, 0}, {2, 2}, {0, 2}};
    static const double arrow[4][2] = {{0, 0}, {4, 0}, {1, 1}, {0, 4}};
    static const double turned[4][2] = {{1, 1}, {0, 4}, {0, 0}, {4, 0}};
    static const double clockwise[4][2] = {{0, 2}, {2, 2}, {2, 0}, {0, 0}};
    static const double comb[12][2] = {{0, 0}, {7, 0}, {7, 3}, {6, 3}, {6, 1}, {4, 1},
                                       {4, 3}, {3, 3}, {3, 1}, {1, 1}, {1, 3}, {0, 3}};
    static const double straight[6][2] = {{0, 0}, {1, 0}, {2, 0}, {2, 2}, {1, 2}, {0, 2}};
    expect_cover(square, 4, 4.0, 0.0);
    expect_cover(arrow, 4, 4.0, 0.0);
    expect_cover(turned, 4, 4.0, 0.0);
    expect_cover(clockwise, 4, -4.0, 0.0);
    expect_cover(comb, 12, 13.0, 0.0); /* 7 + 3 teeth of 2: small integers, exact */
    expect_cover(straight, 6, 4.0, 0.0);
    fill(straight, 6, 0.0);
    for (uint32_t i = 0; i < 4; i++) {
        assert_true(twice_area(i) > 0.0); /* corners in a line make no flat triangle */
    }
}

static void polygon_with_a_bridge_to_its_hole_is_covered_once(void **state)
{
    (void)state;
    /* A square with a square hole, joined by an edge that is walked twice. */
    static const double ring[10][2] = {{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0},
                                       {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}};
    expect_cover(ring, 10, 12.0, 0.0);
}

static void random_stars_are_covered_once(void **state)
{
    (void)state;
    uint64_t seed = (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 200; round++) {
        double star[100][2];
        double area = 0.0;
        uint32_t count = 5 + (uint32_t)(round % 95);
        for (uint32_t i = 0; i < count; i++) {
            seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
            double radius = 0.05 + (double)(seed >> 40) / 16777216.0;
            double angle = 6.283185307179586 * (double)i / (double)count;
            star[i][0] = 1e5 + radius * cos(angle);
            star[i][1] = 5e5 + radius * sin(angle);
        }
        for (uint32_t i = 0; i < count; i++) {
            const double *a = star[i];
            const double *b = star[(i + 1) % count];
            area += ((a[0] - 1e5) * (b[1] - 5e5) - (a[1] - 5e5) * (b[0] - 1e5)) / 2.0;
        }
        /* Coordinates of 5e5 are rounded to 6e-11, over at most 100 edges of length 2. */
        expect_cover((const double(*)[2])star, count, area, 1e-7);
    }
}

/* A wall along a spiral: nearly all corners block each other, and only two are ears at a time. */
static void long_spirals_are_covered_once(void **state)
{
    (void)state;
    enum {
        SIDE = 1500
    };
    static double wall[2 * SIDE][2];
    double area = 0.0;
    for (int i = 0; i < SIDE; i++) {
        double angle = 0.05 * i;
        double radius = 1.0 + 0.01 * i;
        wall[i][0] = radius * cos(angle);
        wall[i][1] = radius * sin(angle);
        wall[2 * SIDE - 1 - i][0] = (radius + 0.2) * cos(angle);
        wall[2 * SIDE - 1 - i][1] = (radius + 0.2) * sin(angle);
    }
    for (int i = 0; i < 2 * SIDE; i++) {
        const double *a = wall[i];
        const double *b = wall[(i + 1) % (2 * SIDE)];
        area += (a[0] * b[1] - a[1] * b[0]) / 2.0;
    }
    assert_true(area < -100.0);
    /* Sums of 3000 terms up to 300, each rounded to 2^-53 of itself. */
    expect_cover((const double(*)[2])wall, 2 * SIDE, area, 1e-8);
}

static void any_polygon_gives_two_triangles_less_than_corners(void **state)
{
    (void)state;
    static const double cross[4][2] = {{0, 0}, {1, 1}, {1, 0}, {0, 1}};
    static const double point[5][2] = {{3, 3}, {3, 3}, {3, 3}, {3, 3}, {3, 3}};
    static const double line[6][2] = {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {2, 2}, {1, 1}};
    static const double star[5][2] = {{0, 3}, {2, -2}, {-3, 1}, {3, 1}, {-2, -2}};
    fill(cross, 4, 0.0);
    fill(point, 5, 0.0);
    fill(line, 6, 1.0);
    fill(star, 5, 0.0); /* The clipping must end and write three triangles; nothing is said about
                           their shape */
    uint64_t seed = 1;
    double(*random)[2] = malloc(2000 * sizeof(*random));
    assert_non_null(random);
    for (int i = 0; i < 4000; i++) {
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        random[i / 2][i % 2] = (double)(seed >> 60);
    }
    fill((const double(*)[2])random, 2000, 0.5); /* self-crossing, many repeats */
    for (uint32_t i = 0; i < 1998; i++) {
        assert_in_range(polygon.triangles[i][2], 0, 1999);
    }
    free(random);
    struct umb_error error = {0};
    assert_int_equal(umbb_polygon_reserve(&polygon, 65537, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "limit 65536"));
    umbb_polygon_finish(&polygon);
}

/* Corners anywhere: each edge crosses thousands of others. */
static void crossing_polygons_of_many_corners_stop_at_their_budget(void **state)
{
    (void)state;
    enum {
        CORNERS = 40000
    };
    uint64_t seed = 12;
    double(*random)[2] = malloc(CORNERS * sizeof(*random));
    assert_non_null(random);
    for (int i = 0; i < 2 * CORNERS; i++) {
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        random[i / 2][i % 2] = (double)(seed >> 40);
    }
    for (uint32_t count = 20000; count <= CORNERS; count += 20000) {
        fill((const double(*)[2])random, count, 0.5);
        for (uint32_t i = 0; i + 2 < count; i++) {
            assert_in_range(polygon.triangles[i][0], 0, count - 1);
        }
    }
    /* One such polygon took 33 s when each ear was tested against every corner. */
    const uint32_t rough = polygon.rough;
    free(random);
    umbb_polygon_finish(&polygon);
    assert_int_equal(rough, 2);
    assert_int_equal(polygon.rough, 0);
}

/* The outline of an island, with the greatest number of corners, all different. */
static void large_simple_polygons_are_covered_once_within_budget(void **state)
{
    (void)state;
    enum {
        CORNERS = 65536
    };
    uint64_t seed = (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)seed);
    double(*island)[2] = malloc(CORNERS * sizeof(*island));
    assert_non_null(island);
    double area = 0.0;
    double sum = 0.0;
    for (int i = 0; i < CORNERS; i++) {
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        double angle = 6.283185307179586 * i / CORNERS;
        double radius = 1000.0 + 200.0 * sin(7.0 * angle) + 5.0 * (double)(seed >> 40) / 16777216.0;
        island[i][0] = radius * cos(angle);
        island[i][1] = radius * sin(angle);
    }
    for (int i = 0; i < CORNERS; i++) {
        const double *a = island[i];
        const double *b = island[(i + 1) % CORNERS];
        area += (a[0] * b[1] - a[1] * b[0]) / 2.0;
    }
    fill((const double(*)[2])island, CORNERS, 0.25);
    for (uint32_t i = 0; i + 2 < CORNERS; i++) {
        assert_true(twice_area(i) >= 0.0);
        sum += twice_area(i) / 2.0;
    }
    assert_int_equal(polygon.rough, 0);
    /* 65534 terms up to 3e6, each rounded to 2^-53 of itself. */
    assert_true(fabs(sum - area) <= 1e-4);
    free(island);
    umbb_polygon_finish(&polygon);
}

static void numbers_are_what_strtod_makes_of_them(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "0",
        "-0",
        "1",
        "+1.5",
        "123456789.123456789",
        "0.1",
        "1e22",
        "1e23",
        "9007199254740993",
        "4.35",
        "1e-22",
        "2.2250738585072011e-308",
        "1.7976931348623157e308",
        "1e999",
        "-inf",
        "5.",
        ".5",
        "1e+5",
        "1E-5",
        "000000000000000000000001.5",
        "0.00000000000000000000000012",
        "3.14159265358979323846264338327950288",
        "8.5e-10",
        "447423.0123456789",
        "0x1.8p1",
    };
    for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++) {
        double got;
        double expected = strtod(texts[i], NULL);
        struct umbb_cursor cursor = {texts[i], texts[i] + strlen(texts[i])};
        assert_int_equal(umbb_take_double(&cursor, &got), 1);
        if (memcmp(&got, &expected, sizeof(got)) != 0) {
            print_error("'%s' is %.17g, not %.17g\n", texts[i], got, expected);
            fail();
        }
        assert_ptr_equal(cursor.at, cursor.end);
    }
    static const char *const none[] = {"", " ", "x", "-", ".", "1x", "1.2.3", "e5", "--1", "1e5x"};
    for (size_t i = 0; i < sizeof(none) / sizeof(none[0]); i++) {
        double got;
        struct umbb_cursor cursor = {none[i], none[i] + strlen(none[i])};
        assert_int_equal(umbb_take_double(&cursor, &got), 0);
    }
}

static void random_numbers_are_what_strtod_makes_of_them(void **state)
{
    (void)state;
    uint64_t seed = (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 100000; round++) {
        char text[64];
        double got;
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        int digits = (int)(seed >> 60);
        double value = ldexp((double)(int64_t)seed, -(int)((seed >> 20) % 90));
        (void)snprintf(text, sizeof(text), round % 2 ? "%.*f" : "%.*e", digits, value);
        struct umbb_cursor cursor = {text, text + strlen(text)};
        double expected = strtod(text, NULL);
        assert_int_equal(umbb_take_double(&cursor, &got), 1);
        if (memcmp(&got, &expected, sizeof(got)) != 0) {
            print_error("'%s' is %.17g, not %.17g\n", text, got, expected);
            fail();
        }
    }
}

/* Texts that are nearly numbers: the reader and strtod must agree on what is accepted, and on its
 * value. */
static void random_texts_are_numbers_when_strtod_says_so(void **state)
{
    (void)state;
    static const char alphabet[] = "0011223456789999..eE+--+xXinfnaIN0p";
    uint64_t seed = (uint64_t)time(NULL);
    size_t numbers = 0;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 300000; round++) {
        char text[32];
        char *end;
        double got;
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        size_t length = 1 + (size_t)(seed >> 33) % (round % 2 ? 8 : 30);
        for (size_t i = 0; i < length; i++) {
            seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
            /* Mostly digits, or few texts would be numbers. */
            text[i] = (seed >> 60) < 9 ? (char)('0' + (seed >> 40) % 10)
                                       : alphabet[(seed >> 40) % (sizeof(alphabet) - 1)];
        }
        text[length] = '\0';
        struct umbb_cursor cursor = {text, text + length};
        double expected = strtod(text, &end);
        int is_number = end == text + length;
        numbers += (size_t)is_number;
        int taken = umbb_take_double(&cursor, &got);
        if (taken != is_number || (taken && memcmp(&got, &expected, sizeof(got)) != 0)) {
            print_error("'%s': %d %.17g, strtod %d %.17g\n", text, taken, got, is_number, expected);
            fail();
        }
        assert_ptr_equal(cursor.at, cursor.end);
    }
    assert_true(numbers > 10000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(simple_polygons_are_covered_once),
        cmocka_unit_test(polygon_with_a_bridge_to_its_hole_is_covered_once),
        cmocka_unit_test(random_stars_are_covered_once),
        cmocka_unit_test(long_spirals_are_covered_once),
        cmocka_unit_test(any_polygon_gives_two_triangles_less_than_corners),
        cmocka_unit_test(crossing_polygons_of_many_corners_stop_at_their_budget),
        cmocka_unit_test(large_simple_polygons_are_covered_once_within_budget),
        cmocka_unit_test(numbers_are_what_strtod_makes_of_them),
        cmocka_unit_test(random_numbers_are_what_strtod_makes_of_them),
        cmocka_unit_test(random_texts_are_numbers_when_strtod_says_so),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
