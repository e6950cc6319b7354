/* SPDX-License-Identifier: Apache-2.0 */
/* The position of the sun, and the voxels of a frame. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <math.h>
#include <string.h>

#include "bake/analysis/light_frame.h"
#include "make_asset.h"

static uint64_t random_state;

/* splitmix64, as a number in -1..1 */
static double random_signed(void)
{
    uint64_t z = (random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-52 - 1.0;
}

static void sine_and_cosine_are_those_of_the_library(void **state)
{
    (void)state;
    for (int i = -7200; i <= 7200; i++) {
        double s, c;
        const double degrees = 0.1 * i;
        umbb_sin_cos_degrees(degrees, &s, &c);
        /* 3e-15: degrees * pi / 180 of the library's way is rounded, up to 720 degrees. */
        assert_true(fabs(s - sin(degrees * 0.017453292519943295)) < 3e-15);
        assert_true(fabs(c - cos(degrees * 0.017453292519943295)) < 3e-15);
    }
    for (int quarter = -8; quarter <= 8; quarter++) {
        double s, c;
        umbb_sin_cos_degrees(90.0 * quarter, &s, &c);
        static const double sines[] = {0.0, 1.0, 0.0, -1.0};
        assert_true(s == sines[(quarter + 8) % 4]);
        assert_true(c == sines[(quarter + 9) % 4]);
    }
}

static void sun_directions_follow_compass_and_up_axis(void **state)
{
    (void)state;
    static const struct {
        double azimuth, elevation;
        int z_up;
        double travels[3];
    } cases[] = {
        {0, 90, 1, {0, 0, -1}},  {0, 90, 0, {0, -1, 0}}, {0, 0, 1, {0, -1, 0}},
        {90, 0, 1, {-1, 0, 0}},  {180, 0, 1, {0, 1, 0}}, {270, 0, 1, {1, 0, 0}},
        {-90, 0, 1, {1, 0, 0}},  {0, 0, 0, {0, 0, 1}},   {90, 0, 0, {-1, 0, 0}},
        {180, 0, 0, {0, 0, -1}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        double d[3];
        umbb_sun_direction(cases[i].azimuth, cases[i].elevation, cases[i].z_up, d);
        for (int k = 0; k < 3; k++) {
            assert_true(d[k] == cases[i].travels[k]);
            assert_false(signbit(d[k]) && d[k] == 0.0); /* no -0: texts stay canonical */
        }
    }
    double d[3];
    umbb_sun_direction(135.0, 45.0, 1, d);
    assert_true(fabs(d[0] + 0.5) < 1e-15 && fabs(d[1] - 0.5) < 1e-15);
    assert_true(fabs(d[2] + sqrt(0.5)) < 1e-15);
}

/* Fits random triangles; checks that all corners lie inside and that the frame's fields are
 * right. */
static void check_fit(const double direction[3], const double centre[3], const double spread[3],
                      uint32_t log2_size)
{
    enum {
        COUNT = 40
    };
    double world[COUNT][3][3], voxel[COUNT][3][3];
    double origin[3];
    for (int k = 0; k < 3; k++) {
        origin[k] = rint(centre[k]);
    }
    for (int i = 0; i < COUNT * 9; i++) {
        world[i / 9][i / 3 % 3][i % 3] = centre[i % 3] + spread[i % 3] * random_signed();
    }
    memcpy(voxel, world, sizeof voxel);
    struct umb_frustum_info frustum;
    struct umb_error error;
    const struct umbb_fit fit = {(const double(*)[3][3])world, COUNT, origin, log2_size, 1};
    assert_int_equal(umbb_light_frame_fit(&fit, direction, &frustum, &error), UMB_OK);
    umbb_light_frame_apply(&frustum, origin, voxel, COUNT);
    const double size = (double)(1U << log2_size);
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {0, 0, 0};
    for (int i = 0; i < COUNT * 9; i++) {
        const double v = voxel[i / 9][i / 3 % 3][i % 3];
        assert_true(v >= 0.5 && v <= size - 0.5);
        low[i % 3] = fmin(low[i % 3], v);
        high[i % 3] = fmax(high[i % 3], v);
    }
    for (int axis = 0; axis < 3; axis++) {
        /* A fitted frame must fill each axis, unless the scene is flat along it. */
        assert_true(high[axis] - low[axis] > 0.9 * (size - 2.0) || spread[2] == 0.0);
        /* A step of one voxel along an axis must move by one on that axis and by nothing on the
         * others. */
        for (int other = 0; other < 3; other++) {
            double moved = 0.0;
            for (int k = 0; k < 3; k++) {
                moved += frustum.world_to_voxel[other][k] * frustum.voxel_step[axis][k];
            }
            /* Rows scale up to 1024 times apart: rounding of 1e-16 grows as much. */
            assert_true(fabs(moved - (other == axis ? 1.0 : 0.0)) < 1e-11);
        }
        /* z runs along the light. */
        double along = 0.0;
        for (int k = 0; k < 3; k++) {
            along += frustum.voxel_step[2][k] * direction[k];
        }
        assert_true(along > 0.0);
    }
    /* Right handed: x cross y points along z. */
    const double(*s)[3] = frustum.voxel_step;
    double turn = 0.0;
    for (int k = 0; k < 3; k++) {
        turn += (s[0][(k + 1) % 3] * s[1][(k + 2) % 3] - s[0][(k + 2) % 3] * s[1][(k + 1) % 3]) *
                s[2][k];
    }
    assert_true(turn > 0.0);
}

static void frames_hold_all_casters_for_any_direction(void **state)
{
    (void)state;
    random_state = 42;
    print_message("seed 42\n");
    static const double axes[6][3] = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                      {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
    for (int i = 0; i < 200; i++) {
        double direction[3] = {random_signed(), random_signed(), random_signed()};
        if (i < 6) {
            memcpy(direction, axes[i], sizeof direction);
        }
        assert_true(umbb_direction_normalise(direction));
        const double centre[3] = {1e7 * random_signed(), 1e6 * random_signed(),
                                  100.0 * random_signed()};
        const double spread[3] = {500.0, 300.0, 100.0};
        check_fit(direction, centre, spread, 6 + (uint32_t)i % 13);
    }
}

/* Directions anywhere; along an axis or within 0.01 degrees or 1e-9 of it, from every side; with
 * components that are equal. */
static void hard_direction(int round, double direction[3])
{
    static const double near_axis[] = {0.0, 1.7453292519943296e-4, 1e-9, 1e-17, 4.9e-324};
    for (int k = 0; k < 3; k++) {
        direction[k] = random_signed();
    }
    if (round % 3 == 0) {
        const int axis = round / 3 % 3;
        const double lean = near_axis[round / 9 % 5];
        direction[axis] = random_signed() < 0 ? -1.0 : 1.0;
        direction[(axis + 1) % 3] *= lean;
        direction[(axis + 2) % 3] *= lean;
    } else if (round % 3 == 1) {
        direction[1] = round & 4 ? direction[0] : -direction[0];
        direction[2] = round & 8 ? direction[0] : direction[2];
    }
}

/* Computes lengths and angles in long doubles. A squared length has six roundings of a direction
 * that was normalised; the third axis is the product of two directions and has four roundings of
 * its own: sixteen at most. */
static void axes_are_units_at_right_angles_for_any_direction(void **state)
{
    (void)state;
    random_state = 44;
    print_message("seed 44\n");
    long double worst = 0;
    for (int i = 0; i < case_count(1000000); i++) {
        double w[3], axes[3][3];
        hard_direction(i, w);
        if (!umbb_direction_normalise(w)) {
            continue;
        }
        umbb_light_axes(w, axes);
        for (int a = 0; a < 3; a++) {
            for (int b = a; b < 3; b++) {
                long double product = a == b ? -1 : 0;
                for (int k = 0; k < 3; k++) {
                    product += (long double)axes[a][k] * (long double)axes[b][k];
                }
                worst = fmaxl(worst, fabsl(product));
            }
        }
        assert_memory_equal(axes[2], w, sizeof w);
    }
    print_message("worst %.2Lg\n", worst);
    assert_true(worst < 16 * 0x1p-53L);
}

static void flat_scenes_get_voxels_of_some_depth(void **state)
{
    (void)state;
    random_state = 43;
    print_message("seed 43\n");
    const double down[3] = {0, 0, -1}, centre[3] = {5, 5, 5}, spread[3] = {100, 100, 0};
    check_fit(down, centre, spread, 14);
}

static void coordinates_out_of_reach_are_refused(void **state)
{
    (void)state;
    const double down[3] = {0, 0, -1}, origin[3] = {0, 0, 0};
    const double bad[] = {1e13, -1e300, NAN, INFINITY};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        const double corners[1][3][3] = {{{0, 0, 0}, {1, bad[i], 0}, {0, 1, 0}}};
        struct umb_error error;
        assert_int_equal(umbb_world_check(corners, 1, &error), UMB_E_BAD_SCENE);
        assert_non_null(strstr(error.message, "beyond 1e+12 metres"));
    }
    const double point[1][3][3] = {{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}};
    struct umb_frustum_info frustum;
    struct umb_error error;
    const struct umbb_fit fit = {point, 1, origin, 10, 1};
    assert_int_equal(umbb_light_frame_fit(&fit, down, &frustum, &error), UMB_E_BAD_SCENE);
}

static void directions_without_length_are_refused(void **state)
{
    (void)state;
    double zero[3] = {0, 0, 0}, wild[3] = {INFINITY, 0, 0}, lost[3] = {NAN, NAN, NAN};
    assert_false(umbb_direction_normalise(zero));
    assert_false(umbb_direction_normalise(wild));
    assert_false(umbb_direction_normalise(lost));
    double huge[3] = {3e200, 0, -4e200};
    assert_true(umbb_direction_normalise(huge));
    assert_true(fabs(huge[0] - 0.6) < 1e-15 && fabs(huge[2] + 0.8) < 1e-15);
}

/* Many blocks of triangles, with zeros of both signs as extremes. */
static void the_fit_is_the_same_for_any_number_of_threads(void **state)
{
    enum {
        MANY = 200000
    };
    const double origin[3] = {1, -2, 0}, directions[2][3] = {{0.48, -0.6, 0.64}, {0, 0, -1}};
    double(*corners)[3][3] = malloc(MANY * sizeof *corners);
    uint64_t bits = 1;
    struct umb_error error;
    (void)state;
    assert_non_null(corners);
    for (size_t i = 0; i < (size_t)MANY * 9; i++) {
        bits = bits * UINT64_C(6364136223846793005) + 1;
        const double value = (double)(bits >> 40) - 0x1p23;
        corners[i / 9][i / 3 % 3][i % 3] = i % 3 < 2 ? value : value < 0 ? -0.0 : 0.0;
    }
    for (int d = 0; d < 2; d++) {
        struct umb_frustum_info one, other;
        struct umbb_fit fit = {(const double(*)[3][3])corners, MANY, origin, 12, 1};
        assert_int_equal(umbb_light_frame_fit(&fit, directions[d], &one, &error), UMB_OK);
        for (fit.threads = 0; fit.threads < 6; fit.threads++) {
            assert_int_equal(umbb_light_frame_fit(&fit, directions[d], &other, &error), UMB_OK);
            assert_memory_equal(&one, &other, sizeof one);
        }
    }
    free(corners);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_fit_is_the_same_for_any_number_of_threads),
        cmocka_unit_test(sine_and_cosine_are_those_of_the_library),
        cmocka_unit_test(sun_directions_follow_compass_and_up_axis),
        cmocka_unit_test(frames_hold_all_casters_for_any_direction),
        cmocka_unit_test(axes_are_units_at_right_angles_for_any_direction),
        cmocka_unit_test(flat_scenes_get_voxels_of_some_depth),
        cmocka_unit_test(coordinates_out_of_reach_are_refused),
        cmocka_unit_test(directions_without_length_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
