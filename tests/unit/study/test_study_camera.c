/* SPDX-License-Identifier: Apache-2.0 */
/* The study's cameras: what --camera takes and refuses, the compass, and the fit. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "study/camera.h"
#include "study/study_math.h"

/* Doubles through sin and cos of degrees: a few ulp of 1. */
#define TOLERANCE 1e-12

/* The margin that the header promises around the fitted scene: 4 %. */
#define FIT_MARGIN 1.04

static void near_check(const char *what, double have, double want, double tolerance)
{
    if (!(fabs(have - want) <= tolerance)) {
        fail_msg("%s: have %.17g, want %.17g", what, have, want);
    }
}

static void parses_eye_target_and_field_of_view(void **state)
{
    (void)state;
    struct umbt_camera_request request;
    struct umb_error error;
    assert_int_equal(umbt_camera_parse("eye=1,-2.5,3e2,target=0,0,.5,fov=60", &request, &error),
                     UMB_OK);
    assert_true(request.has_eye && request.has_target && !request.has_azimuth);
    near_check("eye y", request.eye[1], -2.5, 0.0);
    near_check("eye z", request.eye[2], 300.0, 0.0);
    near_check("target z", request.target[2], 0.5, 0.0);
    near_check("fov", request.fov_deg, 60.0, 0.0);
    assert_int_equal(umbt_camera_parse("fov=20,az=-90,el=10", &request, &error), UMB_OK);
    assert_true(!request.has_eye && request.has_azimuth && request.has_elevation);
    near_check("azimuth", request.azimuth_deg, -90.0, 0.0);
}

static void refuses_cameras_that_make_no_sense(void **state)
{
    (void)state;
    static const struct {
        const char *text, *names;
    } cases[] = {
        {"", "eye=X,Y,Z"},
        {"eye", "eye=X,Y,Z"},
        {"eye=1,2", "needs 3 numbers"},
        {"eye=1,2,", "not a number"},
        {"eye=1,2,nan", "not a number"},
        {"eye=1,2,inf", "not a number"},
        {"eye=1,2, 3", "not a number"},
        {"eye=1,2,1e13", "not a number from"},
        {"eye=1,2,3;fov=3", "comma"},
        {"eye=1,2,3,", "none of"},
        {"eye=1,2,3,eye=1,2,3", "twice"},
        {"eye=1,2,3,target=1,2,3", "same point"},
        {"eye=1,2,3,az=4", "one of both"},
        {"target=1,2,3", "needs eye"},
        {"fov=0", "fov=0"},
        {"fov=151", "fov"},
        {"az=361", "az"},
        {"el=91", "el"},
        {"zoom=1", "zoom"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbt_camera_request request = {.fov_deg = 12.0};
        struct umb_error error = {0};
        const enum umb_status status = umbt_camera_parse(cases[i].text, &request, &error);
        if (status != UMB_E_ARGUMENT || strstr(error.message, cases[i].names) == NULL ||
            request.fov_deg != 12.0) {
            fail_msg("'%s': status %d, message '%s' should hold '%s'", cases[i].text, (int)status,
                     error.message, cases[i].names);
        }
    }
}

static void compass_has_north_up_the_map_in_both_conventions(void **state)
{
    (void)state;
    double v[3];
    umbt_compass_vector(0.0, 0.0, 1, v);
    near_check("z up, north y", v[1], 1.0, TOLERANCE);
    umbt_compass_vector(0.0, 0.0, 0, v);
    near_check("y up, north -z", v[2], -1.0, TOLERANCE);
    umbt_compass_vector(90.0, 0.0, 1, v);
    near_check("z up, east x", v[0], 1.0, TOLERANCE);
    umbt_compass_vector(90.0, 0.0, 0, v);
    near_check("y up, east x", v[0], 1.0, TOLERANCE);
    umbt_compass_vector(33.0, 90.0, 0, v);
    near_check("y up, above", v[1], 1.0, TOLERANCE);
    for (int z_up = 0; z_up <= 1; z_up++) {
        for (double azimuth = 0.5; azimuth < 360.0; azimuth += 41.0) {
            umbt_compass_vector(azimuth, 30.0, z_up, v);
            near_check("azimuth back", umbt_compass_azimuth(v, z_up, -1.0), azimuth, 1e-9);
        }
    }
    umbt_compass_vector(10.0, 89.5, 1, v);
    near_check("overhead", umbt_compass_azimuth(v, 1, 123.0), 123.0, 0.0);
}

/* A xorshift generator: the test prints its seed. */
static double random_unit(uint64_t *seed)
{
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    return (double)(*seed >> 11) / 9007199254740992.0;
}

/* Computes where a point falls in the picture, -1..1 across and up, and its depth in metres. */
static void project(const struct umbt_camera *camera, const double point[3], double *x, double *y,
                    double *depth)
{
    double p[3];
    umb__subtract(point, camera->eye, p);
    *depth = umb__dot(p, camera->forward);
    *x = umb__dot(p, camera->right) / (*depth * camera->tan_x);
    *y = umb__dot(p, camera->up) / (*depth * camera->tan_y);
}

#define POINTS 200

static void fit_check(uint64_t *seed, int z_up)
{
    double points[POINTS][3];
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])points, .count = POINTS, .z_up = z_up};
    struct umbt_camera_request request = {0};
    struct umbt_camera camera;
    struct umb_error error;
    const double scale[3] = {exp(9.0 * random_unit(seed) - 3.0), exp(9.0 * random_unit(seed) - 3.0),
                             exp(9.0 * random_unit(seed) - 3.0)};
    for (int k = 0; k < 3; k++) {
        subject.box.min[k] = INFINITY;
        subject.box.max[k] = -INFINITY;
        for (int i = 0; i < POINTS; i++) {
            points[i][k] = 5e5 + scale[k] * random_unit(seed);
            subject.box.min[k] = fmin(subject.box.min[k], points[i][k]);
            subject.box.max[k] = fmax(subject.box.max[k], points[i][k]);
        }
    }
    umbt_compass_vector(360.0 * random_unit(seed), 90.0 * random_unit(seed), z_up,
                        subject.to_light);
    assert_int_equal(umbt_camera_make(&request, &subject, 1280, 720, &camera, &error), UMB_OK);
    double extent_x[2] = {9.0, -9.0}, extent_y[2] = {9.0, -9.0};
    for (int i = 0; i < POINTS; i++) {
        double x = 0.0, y = 0.0, depth = 0.0;
        project(&camera, points[i], &x, &y, &depth);
        assert_true(depth > 0.0);
        extent_x[0] = fmin(extent_x[0], x);
        extent_x[1] = fmax(extent_x[1], x);
        extent_y[0] = fmin(extent_y[0], y);
        extent_y[1] = fmax(extent_y[1], y);
    }
    /* Coordinates of 5e5 leave 1e-10 m; the smallest scenes here are 0.05 m. */
    const double edge = 1.0 / FIT_MARGIN + 1e-6;
    assert_true(extent_x[0] >= -edge && extent_x[1] <= edge);
    assert_true(extent_y[0] >= -edge && extent_y[1] <= edge);
    /* The fit must be tight in the direction that limits it: the scene touches both margins. */
    const int tight_x = extent_x[1] - extent_x[0] > 2.0 / FIT_MARGIN - 1e-5;
    const int tight_y = extent_y[1] - extent_y[0] > 2.0 / FIT_MARGIN - 1e-5;
    assert_true(tight_x || tight_y);
    const double above = camera.eye[z_up ? 2 : 1] -
                         0.5 * (subject.box.min[z_up ? 2 : 1] + subject.box.max[z_up ? 2 : 1]);
    assert_true(above > 0.0);
}

static void fitted_camera_sees_every_point_and_wastes_no_room(void **state)
{
    (void)state;
    uint64_t seed = 0x9e3779b97f4a7c15ULL;
    print_message("seed %llx\n", (unsigned long long)seed);
    for (int i = 0; i < 200; i++) {
        fit_check(&seed, i % 2);
    }
}

static void fit_survives_a_single_point_and_a_line_along_the_view(void **state)
{
    (void)state;
    double line[2][3] = {{0.0, 0.0, 0.0}, {0.0, 0.0, 10.0}};
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])line, .count = 2, .z_up = 1, .to_light = {0.0, 0.0, 1.0}};
    subject.box.max[2] = 10.0;
    struct umbt_camera_request request = {.has_elevation = 1, .elevation_deg = 90.0};
    struct umbt_camera camera;
    struct umb_error error;
    assert_int_equal(umbt_camera_make(&request, &subject, 64, 64, &camera, &error), UMB_OK);
    assert_true(camera.eye[2] > 10.0);
    near_check("upright picture", umb__length(camera.up), 1.0, TOLERANCE);
    subject.count = 1;
    subject.box.max[2] = 0.0;
    assert_int_equal(umbt_camera_make(&request, &subject, 64, 64, &camera, &error), UMB_OK);
    assert_true(isfinite(camera.eye[2]) && camera.eye[2] > 0.0);
}

static void rays_run_from_the_top_left_to_the_bottom_right(void **state)
{
    (void)state;
    struct umbt_camera_subject subject = {.z_up = 1, .to_light = {0.0, 0.0, 1.0}};
    struct umbt_camera_request request;
    struct umbt_camera camera;
    struct umb_error error;
    double d[3];
    assert_int_equal(umbt_camera_parse("eye=0,-10,0,target=0,0,0,fov=90", &request, &error),
                     UMB_OK);
    assert_int_equal(umbt_camera_make(&request, &subject, 200, 100, &camera, &error), UMB_OK);
    umbt_camera_ray(&camera, 0.5, 0.5, d);
    near_check("centre", d[1], 1.0, TOLERANCE);
    umbt_camera_ray(&camera, 0.0, 0.0, d);
    near_check("left: twice as wide as high", d[0] / d[1], -2.0, 1e-9);
    near_check("top", d[2] / d[1], 1.0, 1e-9);
    umbt_camera_ray(&camera, 1.0, 1.0, d);
    near_check("right", d[0] / d[1], 2.0, 1e-9);
    near_check("bottom", d[2] / d[1], -1.0, 1e-9);
    near_check("unit", umb__length(d), 1.0, TOLERANCE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parses_eye_target_and_field_of_view),
        cmocka_unit_test(refuses_cameras_that_make_no_sense),
        cmocka_unit_test(compass_has_north_up_the_map_in_both_conventions),
        cmocka_unit_test(fitted_camera_sees_every_point_and_wastes_no_room),
        cmocka_unit_test(fit_survives_a_single_point_and_a_line_along_the_view),
        cmocka_unit_test(rays_run_from_the_top_left_to_the_bottom_right),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
