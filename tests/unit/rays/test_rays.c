/* SPDX-License-Identifier: Apache-2.0 */
/* Tracing, compared with a slow tracer in doubles, and the count of crossings in nested solids. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "rays/rays.h"
#include "rays/verify_light_frame.h"

typedef double triangle[3][3];

struct brute_hit {
    double distance; /* infinite if nothing was hit */
    double second;   /* distance of the next hit behind */
    double margin;   /* least barycentric distance to a border, of all triangles' planes crossed */
    uint32_t index;
};

static uint64_t random_state;

static double unit(void)
{
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(random_state >> 40) / 16777216.0;
}

static void random_direction(double d[3])
{
    double length;
    do {
        length = 0;
        for (int i = 0; i < 3; i++) {
            d[i] = 2 * unit() - 1;
            length += d[i] * d[i];
        }
    } while (length > 1 || length < 0.01);
    for (int i = 0; i < 3; i++) {
        d[i] /= sqrt(length);
    }
}

static struct umbr_rays *create(const triangle *soup, size_t count)
{
    struct umbr_rays *rays;
    struct umb_error error = {0};
    enum umb_status status = umbr_rays_build(soup, count, NULL, &rays, &error);
    if (status != UMB_OK) {
        fail_msg("create: %s", error.message);
    }
    return rays;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Moeller and Trumbore 1997, in doubles, over all triangles. */
static struct brute_hit brute(const triangle *soup, size_t count, const double o[3],
                              const double d[3])
{
    struct brute_hit best = {INFINITY, INFINITY, INFINITY, UINT32_MAX};
    for (size_t t = 0; t < count; t++) {
        double e1[3], e2[3], s[3], p[3], q[3];
        for (int i = 0; i < 3; i++) {
            e1[i] = soup[t][1][i] - soup[t][0][i];
            e2[i] = soup[t][2][i] - soup[t][0][i];
            s[i] = o[i] - soup[t][0][i];
        }
        cross(d, e2, p);
        cross(s, e1, q);
        double determinant = dot(e1, p);
        if (determinant == 0) {
            continue;
        }
        double u = dot(s, p) / determinant, v = dot(d, q) / determinant;
        double distance = dot(e2, q) / determinant;
        double inside = fmin(fmin(u, v), 1 - u - v);
        if (distance > -0.01) {
            best.margin = fmin(best.margin, fmin(fabs(inside), fabs(distance)));
        }
        if (inside < 0 || distance < 0) {
            continue;
        }
        if (distance < best.distance) {
            best.second = best.distance;
            best.distance = distance;
            best.index = (uint32_t)t;
        } else if (distance < best.second) {
            best.second = distance;
        }
    }
    return best;
}

static void random_soups_match_a_double_tracer(void **state)
{
    (void)state;
    enum {
        TRIANGLES = 200,
        RAYS = 4000
    };
    static triangle soup[TRIANGLES];
    /* At 1e6 m only the centre keeps the soup's 10 m sharp. */
    static const double places[2] = {0, 1e6};
    random_state = 11;
    print_message("seed %llu\n", (unsigned long long)random_state);
    for (int place = 0; place < 2; place++) {
        for (int t = 0; t < TRIANGLES; t++) {
            for (int k = 0; k < 9; k++) {
                soup[t][k / 3][k % 3] = 10 * unit() + places[place];
            }
        }
        struct umbr_rays *rays = create(soup, TRIANGLES);
        int hits = 0, unsure = 0;
        for (int i = 0; i < RAYS; i++) {
            double o[3], d[3];
            struct umbr_hit hit;
            for (int k = 0; k < 3; k++) {
                o[k] = 16 * unit() - 3 + places[place];
            }
            random_direction(d);
            struct brute_hit truth = brute(soup, TRIANGLES, o, d);
            umbr_nearest(rays, o, d, 0, INFINITY, &hit);
            /* Floats hold 10 m to 5e-7 m. Triangles are at least centimetres wide where the margin
             * passes, grazing ones enlarge the error: 1e-4 of a triangle is far beyond both. */
            if (truth.margin < 1e-4) {
                unsure++;
                continue;
            }
            assert_int_equal(umbr_occluded(rays, o, d, 0, INFINITY), isfinite(truth.distance));
            assert_int_equal(hit.distance >= 0, isfinite(truth.distance));
            if (!isfinite(truth.distance) || truth.second - truth.distance < 1e-3) {
                continue;
            }
            hits++;
            assert_int_equal(hit.triangle, truth.index);
            /* 1e-6 m of float error along a plane met at an angle of 1/100 or more. */
            assert_true(fabs(hit.distance - truth.distance) < 1e-3);
            assert_int_equal(umbr_occluded(rays, o, d, 0, truth.distance - 1e-3), 0);
            assert_int_equal(umbr_occluded(rays, o, d, truth.distance - 1e-3, INFINITY), 1);
        }
        assert_true(hits > RAYS / 4);
        assert_true(unsure < RAYS / 5);
        umbr_rays_destroy(rays);
    }
}

static void packets_of_eight_answer_each_ray_as_one_alone_does(void **state)
{
    (void)state;
    static const triangle one[1] = {{{0, 0, 5}, {1, 0, 5}, {0, 1, 5}}};
    static const double up[3] = {0, 0, 1};
    struct umbr_rays *rays = create(one, 1);
    double from[8][3];
    uint8_t occluded[8];
    for (int i = 0; i < 8; i++) { /* along a row that leaves the triangle between 4 and 5 */
        from[i][0] = 0.05 + 0.15 * i;
        from[i][1] = 0.3;
        from[i][2] = i == 2 ? 6 : 0; /* one begins behind it */
    }
    umbr_occluded8(rays, (const double(*)[3])from, up, 0, INFINITY, occluded);
    for (int i = 0; i < 8; i++) {
        assert_int_equal(occluded[i], i <= 4 && i != 2);
        assert_int_equal(occluded[i], umbr_occluded(rays, from[i], up, 0, INFINITY));
    }
    umbr_occluded8(rays, (const double(*)[3])from, up, 0, 4, occluded);
    assert_memory_equal(occluded, "\0\0\0\0\0\0\0\0", 8);
    umbr_occluded8(rays, (const double(*)[3])from, up, 6, 5, occluded); /* an empty range */
    assert_memory_equal(occluded, "\0\0\0\0\0\0\0\0", 8);
    umbr_rays_destroy(rays);
}

static void nearest_hit_has_the_winding_normal(void **state)
{
    (void)state;
    static const triangle one[1] = {{{0, 0, 5}, {1, 0, 5}, {0, 1, 5}}};
    static const double o[3] = {0.25, 0.25, 0}, up[3] = {0, 0, 1}, down[3] = {0, 0, -1};
    struct umbr_rays *rays = create(one, 1);
    struct umbr_hit hit;
    umbr_nearest(rays, o, up, 0, INFINITY, &hit);
    assert_true(hit.distance == 5 && hit.triangle == 0);
    assert_true(hit.normal[0] == 0 && hit.normal[1] == 0 && hit.normal[2] == 1);
    umbr_nearest(rays, o, down, 0, INFINITY, &hit);
    assert_true(hit.distance < 0);
    umbr_nearest(rays, o, up, 0, 4, &hit);
    assert_true(hit.distance < 0);
    umbr_nearest(rays, o, up, 0, -1, &hit); /* an empty range holds nothing */
    assert_true(hit.distance < 0);
    assert_false(umbr_occluded(rays, o, up, 0, -1));
    assert_false(umbr_occluded(rays, o, up, 6, 5));
    assert_true(umbr_occluded(rays, o, up, 5, 5));
    umbr_rays_destroy(rays);
}

static void no_triangles_hit_nothing(void **state)
{
    (void)state;
    static const double o[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    struct umbr_rays *rays = create(NULL, 0);
    struct umbr_hit hit;
    int winding, crossings;
    assert_false(umbr_occluded(rays, o, up, 0, INFINITY));
    umbr_nearest(rays, o, up, 0, INFINITY, &hit);
    assert_true(hit.distance < 0);
    umbr_crossings(rays, o, up, NULL, &winding, &crossings);
    assert_int_equal(winding, 0);
    assert_int_equal(crossings, 0);
    umbr_rays_destroy(rays);
    umbr_rays_destroy(NULL);
}

static void add_box(triangle *soup, size_t box, const double low[3], const double high[3])
{
    static const int faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                     {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                     {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    for (size_t t = 0; t < 12; t++) {
        for (int k = 0; k < 3; k++) {
            for (int i = 0; i < 3; i++) {
                soup[12 * box + t][k][i] = faces[t][k] >> i & 1 ? high[i] : low[i];
            }
        }
    }
}

/* Boxes of half edge 1, 2, ... about the origin. */
static struct umbr_rays *nested(triangle *soup, size_t boxes)
{
    for (size_t b = 0; b < boxes; b++) {
        double h = (double)b + 1;
        add_box(soup, b, (const double[3]){-h, -h, -h}, (const double[3]){h, h, h});
    }
    return create((const triangle *)soup, 12 * boxes);
}

static void check_winding(const struct umbr_rays *rays, const uint8_t *closed, const double o[3],
                          const double d[3], int boxes)
{
    int winding, crossings, expected = 0;
    double reach = fmax(fmax(fabs(o[0]), fabs(o[1])), fabs(o[2]));
    for (int h = 1; h <= boxes; h++) {
        expected += reach < h;
    }
    umbr_crossings(rays, o, d, closed, &winding, &crossings);
    if (winding != expected || (crossings - winding) % 2 != 0) {
        fail_msg("from %g %g %g along %g %g %g: winding %d crossings %d, not %d", o[0], o[1], o[2],
                 d[0], d[1], d[2], winding, crossings, expected);
    }
}

static void crossings_count_nested_boxes(void **state)
{
    (void)state;
    enum {
        BOXES = 6
    };
    static triangle soup[12 * BOXES];
    uint8_t closed[12 * BOXES];
    struct umbr_rays *rays = nested(soup, BOXES);
    memset(closed, 1, sizeof closed);
    random_state = 5;
    print_message("seed %llu\n", (unsigned long long)random_state);
    for (int i = 0; i < 20000; i++) {
        double o[3], d[3];
        for (int k = 0; k < 3; k++) {
            o[k] = 16 * unit() - 8;
        }
        random_direction(d);
        check_winding(rays, closed, o, d, BOXES);
    }
    umbr_rays_destroy(rays);
}

static void crossings_through_edges_and_corners_count_once(void **state)
{
    (void)state;
    enum {
        BOXES = 5
    };
    static triangle soup[12 * BOXES];
    uint8_t closed[12 * BOXES];
    struct umbr_rays *rays = nested(soup, BOXES);
    memset(closed, 1, sizeof closed);
    /* From the middle and from outside: through face diagonals (edges inside a face), box edges and
     * box corners, along all 26 directions of a grid. Starts keep off every surface. */
    for (int i = 0; i < 27; i++) {
        double d[3] = {i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1};
        double length = sqrt(dot(d, d));
        if (length == 0) {
            continue;
        }
        for (int k = 0; k < 3; k++) {
            d[k] /= length;
        }
        for (double start = -10.4; start < 10; start += 0.65) {
            const double o[3] = {start * d[0], start * d[1], start * d[2]};
            check_winding(rays, closed, o, d, BOXES);
        }
    }
    /* Axis-parallel rays that meet the diagonal of each face. */
    for (int i = -40; i <= 40; i++) {
        double h = i / 8.0 + 0.03;
        static const double z[3] = {0, 0, 1};
        check_winding(rays, closed, (const double[3]){h, h, 0.3}, z, BOXES);
        check_winding(rays, closed, (const double[3]){h, -h, 0.3}, z, BOXES);
    }
    umbr_rays_destroy(rays);
}

static void crossings_beyond_the_kept_list_are_all_counted(void **state)
{
    (void)state;
    enum {
        BOXES = 400
    };
    static triangle soup[12 * BOXES];
    static uint8_t closed[12 * BOXES];
    struct umbr_rays *rays = nested(soup, BOXES);
    memset(closed, 1, sizeof closed);
    static const double d[3] = {0.48, 0.6, 0.64};
    int winding, crossings;
    check_winding(rays, closed, (const double[3]){0.1, 0.2, 0.3}, d, BOXES);
    umbr_crossings(rays, (const double[3]){-480, -600, -640}, d, closed, &winding, &crossings);
    assert_int_equal(winding, 0);
    assert_int_equal(crossings, 2 * BOXES);
    umbr_rays_destroy(rays);
}

static void crossings_leave_out_open_triangles(void **state)
{
    (void)state;
    enum {
        BOXES = 4
    };
    static triangle soup[12 * BOXES];
    uint8_t closed[12 * BOXES];
    struct umbr_rays *rays = nested(soup, BOXES);
    int winding, crossings;
    static const double d[3] = {0.48, 0.6, 0.64};
    memset(closed, 1, sizeof closed);
    memset(closed + 12, 0, 24); /* the boxes of half edge 2 and 3 */
    umbr_crossings(rays, (const double[3]){0.1, 0.2, 0.3}, d, closed, &winding, &crossings);
    assert_int_equal(winding, 2);
    assert_int_equal(crossings, 2);
    umbr_rays_destroy(rays);
}

/* Rotates by the quaternion (1, 2, 3, 4), whose matrix is 1/15 of integers. */
static void turn_askew(double p[3])
{
    static const double m[3][3] = {{-10, 2, 11}, {10, -5, 10}, {5, 14, 2}};
    double out[3];
    for (int i = 0; i < 3; i++) {
        out[i] = dot(m[i], p) / 15;
    }
    memcpy(p, out, sizeof out);
}

/* Many long thin overlapping solids askew to the axes: builders split triangles for these. */
static void crossings_count_overlapping_bars(void **state)
{
    (void)state;
    enum {
        BARS = 300
    };
    static triangle soup[12 * BARS];
    static uint8_t closed[12 * BARS];
    double box[BARS][2][3];
    random_state = 77;
    print_message("seed %llu\n", (unsigned long long)random_state);
    for (size_t b = 0; b < BARS; b++) {
        for (size_t i = 0; i < 3; i++) {
            double half = b % 3 == i ? 50 : 0.2 + unit();
            double middle = b % 3 == i ? 0 : 80 * unit() - 40;
            box[b][0][i] = middle - half;
            box[b][1][i] = middle + half;
        }
        add_box(soup, b, box[b][0], box[b][1]);
    }
    for (size_t t = 0; t < 12 * BARS; t++) {
        for (int k = 0; k < 3; k++) {
            turn_askew(soup[t][k]);
        }
    }
    memset(closed, 1, sizeof closed);
    struct umbr_rays *rays = create((const triangle *)soup, 12 * BARS);
    for (int i = 0; i < 20000; i++) {
        double o[3], d[3];
        int winding, crossings, expected = 0, sure = 1;
        for (int k = 0; k < 3; k++) {
            o[k] = 100 * unit() - 50;
        }
        random_direction(d);
        for (size_t b = 0; b < BARS; b++) {
            double depth = INFINITY;
            for (int k = 0; k < 3; k++) {
                depth = fmin(depth, fmin(o[k] - box[b][0][k], box[b][1][k] - o[k]));
            }
            expected += depth > 0;
            sure &= fabs(depth) > 1e-4; /* floats place a 50 m coordinate within 4e-6 m */
        }
        turn_askew(o);
        umbr_crossings(rays, o, d, closed, &winding, &crossings);
        if (sure && winding != expected) {
            fail_msg("ray %d: winding %d, not %d", i, winding, expected);
        }
    }
    umbr_rays_destroy(rays);
}

/* A lamp that hangs exactly on a ceiling, as people put it. */
static void lamps_are_not_hidden_by_the_surface_they_stand_on(void **state)
{
    (void)state;
    triangle soup[2] = {{{0, 0, 2.9}, {9.3, 0, 2.9}, {9.3, 7.1, 3.3}},
                        {{0, 0, 2.9}, {9.3, 7.1, 3.3}, {0, 7.1, 3.3}}};
    struct umbr_rays *rays = create((const triangle *)soup, 2);
    const struct umb_light_info lamp = {.kind = UMB_LIGHT_POINT,
                                        .position = {3.1, 3.55, 0.5 * (2.9 + 3.3)}};
    random_state = 11;
    for (int i = 0; i < 10000; i++) {
        const double p[3] = {9 * unit(), 7 * unit(), 2.5 * unit()};
        double towards[3], distance;
        umbr_towards_light(&lamp, p, towards, &distance);
        assert_false(umbr_occluded(rays, p, towards, 0, distance));
    }
    umbr_rays_destroy(rays);
}

static void too_many_triangles_are_refused(void **state)
{
    (void)state;
    struct umbr_rays *rays;
    struct umb_error error = {0};
    assert_int_equal(umbr_rays_build(NULL, (size_t)UINT32_MAX / 3 + 1, NULL, &rays, &error),
                     UMB_E_TOO_LARGE);
    assert_null(rays);
    assert_non_null(strstr(error.message, "1431655765"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_soups_match_a_double_tracer),
        cmocka_unit_test(packets_of_eight_answer_each_ray_as_one_alone_does),
        cmocka_unit_test(nearest_hit_has_the_winding_normal),
        cmocka_unit_test(no_triangles_hit_nothing),
        cmocka_unit_test(crossings_count_nested_boxes),
        cmocka_unit_test(crossings_through_edges_and_corners_count_once),
        cmocka_unit_test(crossings_beyond_the_kept_list_are_all_counted),
        cmocka_unit_test(crossings_leave_out_open_triangles),
        cmocka_unit_test(crossings_count_overlapping_bars),
        cmocka_unit_test(lamps_are_not_hidden_by_the_surface_they_stand_on),
        cmocka_unit_test(too_many_triangles_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
