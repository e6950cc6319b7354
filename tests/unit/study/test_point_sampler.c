/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The study's sample points, on two overlapping closed cubes: every point's place is known by
 * arithmetic, without a ray.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/bytes.h"
#include "study/point_sampler.h"

#define CUBES 2
#define COUNT 20000U

/* Low and high corners; the second cube's low half is inside the first. */
static const double cubes[CUBES][2][3] = {
    {{0.0, 0.0, 0.0}, {2.0, 2.0, 2.0}},
    {{1.0, 0.5, 0.5}, {3.0, 1.5, 1.5}},
};

/* Points are exact to doubles, and to Embree's floats when a camera saw them. */
#define EXACT 1e-12
#define SEEN  1e-5

static void cube_add(const double cube[2][3], double (*corners)[3][3])
{
    static const int faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                     {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                     {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    for (size_t i = 0; i < 36; i++) {
        for (size_t k = 0; k < 3; k++) {
            corners[i / 3][i % 3][k] = cube[faces[i / 3][i % 3] >> k & 1][k];
        }
    }
}

static void scene_make(struct umbt_scene *scene, size_t cube_count)
{
    struct umb_error error;
    memset(scene, 0, sizeof *scene);
    scene->path = "cubes";
    scene->count = 12 * cube_count;
    scene->corners = calloc(scene->count, sizeof *scene->corners);
    assert_non_null(scene->corners);
    for (size_t i = 0; i < cube_count; i++) {
        cube_add(cubes[i], scene->corners + 12 * i);
    }
    for (size_t k = 0; k < 3; k++) {
        scene->box.min[k] = cubes[0][0][k];
        scene->box.max[k] = fmax(cubes[0][1][k], cube_count > 1 ? cubes[1][1][k] : 0.0);
    }
    scene->diagonal_m = sqrt(9.0 + 4.0 + 4.0);
    assert_int_equal(
        umbs_parts_find((const double(*)[3][3])scene->corners, scene->count, &scene->parts, &error),
        UMB_OK);
    assert_int_equal(scene->parts.closed_triangles, scene->count);
    assert_int_equal(umbr_rays_build((const double(*)[3][3])scene->corners, scene->count, NULL,
                                     &scene->rays, &error),
                     UMB_OK);
}

static void scene_drop(struct umbt_scene *scene)
{
    umbr_rays_destroy(scene->rays);
    umbs_parts_finish(&scene->parts);
    free(scene->corners);
}

/* How deep a point lies inside a cube: negative outside. */
static double depth_in(const double cube[2][3], const double point[3])
{
    double depth = INFINITY;
    for (int k = 0; k < 3; k++) {
        depth = fmin(depth, fmin(point[k] - cube[0][k], cube[1][k] - point[k]));
    }
    return depth;
}

static struct umbt_point_set sample(const struct umbt_scene *scene, enum umbt_point_kind kind,
                                    uint64_t seed, unsigned threads)
{
    const struct umbt_point_request request = {.scene = scene,
                                               .kind = kind,
                                               .count = COUNT,
                                               .seed = seed,
                                               .reach_m = 0.25,
                                               .threads = threads,
                                               .quiet = 1};
    struct umbt_point_set set;
    struct umb_error error = {0};
    if (umbt_points_sample(&request, &set, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(set.count, COUNT);
    return set;
}

static void surface_points_lie_on_what_can_be_seen_evenly(void **state)
{
    (void)state;
    struct umbt_scene scene;
    scene_make(&scene, CUBES);
    struct umbt_point_set set = sample(&scene, UMBT_POINT_SURFACE, 3, 2);
    size_t on_top = 0;
    for (size_t i = 0; i < set.count; i++) {
        const double *p = set.positions[i];
        const double a = depth_in(cubes[0], p), b = depth_in(cubes[1], p);
        if (!(fabs(fmax(a, b)) <= EXACT)) {
            fail_msg("point %zu at %.17g %.17g %.17g is %g and %g deep", i, p[0], p[1], p[2], a, b);
        }
        on_top += p[2] == 2.0;
        if (p[2] == 2.0) {
            assert_true(set.normals[i][2] == 1.0F);
        }
    }
    /* Visible areas: 24 - 1 of the big cube; of the small one 4 half sides (4) and an end (1); 4 of
     * these lie on top. The limits are five standard deviations of a binomial distribution. */
    const double share = 4.0 / 28.0, want = share * COUNT;
    const double tolerance = 5.0 * sqrt(want * (1.0 - share));
    if (!(fabs((double)on_top - want) <= tolerance)) {
        fail_msg("%zu points on top, want %.0f within %.0f", on_top, want, tolerance);
    }
    umbt_point_set_finish(&set);
    scene_drop(&scene);
}

static void near_and_free_points_lie_outside_solids(void **state)
{
    (void)state;
    struct umbt_scene scene;
    scene_make(&scene, CUBES);
    struct umbt_point_set near = sample(&scene, UMBT_POINT_NEAR, 4, 2);
    struct umbt_point_set loose = sample(&scene, UMBT_POINT_FREE, 4, 2);
    for (size_t i = 0; i < COUNT; i++) {
        const double n =
            fmax(depth_in(cubes[0], near.positions[i]), depth_in(cubes[1], near.positions[i]));
        const double f =
            fmax(depth_in(cubes[0], loose.positions[i]), depth_in(cubes[1], loose.positions[i]));
        const struct umb_box *box = &scene.box;
        /* A point within float rounding of a face may count as either side (rays.h). */
        assert_true(n <= 1e-6 && n >= -0.25 - EXACT);
        assert_true(f <= 1e-6);
        for (int k = 0; k < 3; k++) {
            assert_true(loose.positions[i][k] >= box->min[k] &&
                        loose.positions[i][k] <= box->max[k]);
        }
    }
    umbt_point_set_finish(&near);
    umbt_point_set_finish(&loose);
    scene_drop(&scene);
}

static void a_seed_gives_the_same_points_on_any_number_of_threads(void **state)
{
    (void)state;
    struct umbt_scene scene;
    scene_make(&scene, CUBES);
    struct umbt_point_set one = sample(&scene, UMBT_POINT_SURFACE, 5, 1);
    struct umbt_point_set three = sample(&scene, UMBT_POINT_SURFACE, 5, 3);
    struct umbt_point_set other = sample(&scene, UMBT_POINT_SURFACE, 6, 1);
    assert_memory_equal(one.positions, three.positions, COUNT * sizeof *one.positions);
    assert_memory_equal(one.normals, three.normals, COUNT * sizeof *one.normals);
    assert_int_equal(one.candidates, three.candidates);
    assert_memory_not_equal(one.positions, other.positions, COUNT * sizeof *one.positions);
    umbt_point_set_finish(&one);
    umbt_point_set_finish(&three);
    umbt_point_set_finish(&other);
    scene_drop(&scene);
}

static void free_points_are_refused_where_nothing_is_free(void **state)
{
    (void)state;
    struct umbt_scene scene;
    scene_make(&scene, 1); /* the box is the cube */
    const struct umbt_point_request request = {
        .scene = &scene, .kind = UMBT_POINT_FREE, .count = 100000, .threads = 2, .quiet = 1};
    struct umbt_point_set set;
    struct umb_error error = {0};
    assert_int_equal(umbt_points_sample(&request, &set, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "outside closed solids"));
    assert_null(set.positions);
    scene_drop(&scene);
}

static enum umb_status view(const struct umbt_scene *scene, const char *camera_text, size_t count,
                            struct umbt_point_set *set, struct umb_error *error)
{
    struct umbt_camera_request camera = {0};
    const struct umbt_camera_subject subject = {.points =
                                                    (const double(*)[3])(void *)scene->corners,
                                                .count = 3 * scene->count,
                                                .box = scene->box,
                                                .z_up = 1,
                                                .to_light = {0.0, 0.6, 0.8}};
    const struct umbt_pixel_request request = {.scene = scene,
                                               .camera = &camera,
                                               .subject = &subject,
                                               .size = {64, 36},
                                               .count = count,
                                               .threads = 2};
    if (camera_text != NULL) {
        assert_int_equal(umbt_camera_parse(camera_text, &camera, error), UMB_OK);
    }
    return umbt_points_of_pixels(&request, set, error);
}

static void a_view_gives_as_many_points_as_asked_for(void **state)
{
    (void)state;
    struct umbt_scene scene;
    struct umbt_point_set set;
    struct umb_error error = {0};
    scene_make(&scene, CUBES);
    assert_int_equal(view(&scene, NULL, 0, &set, &error), UMB_OK);
    assert_true(set.count > 0 && set.count < 64 * 36);
    umbt_point_set_finish(&set);
    assert_int_equal(view(&scene, "az=90,el=0", 5000, &set, &error), UMB_OK);
    assert_int_equal(set.count, 5000);
    for (size_t i = 0; i < set.count; i++) {
        const double a = depth_in(cubes[0], set.positions[i]);
        const double b = depth_in(cubes[1], set.positions[i]);
        assert_true(fabs(fmax(a, b)) <= SEEN);
        assert_true(set.normals[i][0] >= 0.0F); /* the camera stands in the east */
    }
    umbt_point_set_finish(&set);
    scene_drop(&scene);
}

static void a_view_from_inside_or_at_nothing_is_refused(void **state)
{
    (void)state;
    struct umbt_scene scene;
    struct umbt_point_set set;
    struct umb_error error = {0};
    scene_make(&scene, CUBES);
    assert_int_equal(view(&scene, "eye=0.5,0.5,0.5", 0, &set, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "inside a closed solid"));
    assert_int_equal(view(&scene, "eye=9,9,9,target=99,99,99", 0, &set, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "sees the scene"));
    assert_null(set.positions);
    scene_drop(&scene);
}

/* Writes two points; returns the file's bytes. */
static size_t file_bytes(enum umbt_point_file_format format, int normals, uint8_t *bytes,
                         size_t size)
{
    double positions[2][3] = {{1.1, 2.0, 3.0}, {-4.0, 1e7 + 0.1, 0.0}};
    float unit[2][3] = {{0.0F, 0.0F, 1.0F}, {1.0F, 0.0F, 0.0F}};
    const struct umbt_point_set set = {.count = 2, .positions = positions, .normals = unit};
    char path[] = "/tmp/umbrage-points-XXXXXX";
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    (void)close(fd);
    const struct umbt_point_file file = {
        .path = path, .format = format, .normals = normals, .origin = {1.0, 0.0, 0.0}};
    uint64_t written = 0;
    struct umb_error error = {0};
    assert_int_equal(umbt_point_file_write(&file, &set, &written, &error), UMB_OK);
    FILE *in = fopen(path, "rb");
    assert_non_null(in);
    const size_t count = fread(bytes, 1, size, in);
    (void)fclose(in);
    (void)unlink(path);
    assert_int_equal(count, written);
    return count;
}

static void files_hold_the_points_less_the_origin(void **state)
{
    (void)state;
    uint8_t bytes[512];
    float narrow;
    assert_int_equal(file_bytes(UMBT_POINT_FILE_F64, 0, bytes, sizeof bytes), 48);
    assert_true(umb__load_f64(bytes) == 1.1 - 1.0 && umb__load_f64(bytes + 32) == 1e7 + 0.1);
    assert_int_equal(file_bytes(UMBT_POINT_FILE_F32, 1, bytes, sizeof bytes), 48);
    memcpy(&narrow, bytes + 24, sizeof narrow);
    assert_true(narrow == -5.0F);
    memcpy(&narrow, bytes + 20, sizeof narrow);
    assert_true(narrow == 1.0F);
    const size_t length = file_bytes(UMBT_POINT_FILE_TEXT, 1, bytes, sizeof bytes - 1);
    bytes[length] = '\0';
    char *end = NULL;
    assert_true(strtod((const char *)bytes, &end) == 1.1 - 1.0);
    assert_non_null(strstr(end, " 2 3 0 0 1\n-5 "));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surface_points_lie_on_what_can_be_seen_evenly),
        cmocka_unit_test(near_and_free_points_lie_outside_solids),
        cmocka_unit_test(a_seed_gives_the_same_points_on_any_number_of_threads),
        cmocka_unit_test(free_points_are_refused_where_nothing_is_free),
        cmocka_unit_test(a_view_gives_as_many_points_as_asked_for),
        cmocka_unit_test(a_view_from_inside_or_at_nothing_is_refused),
        cmocka_unit_test(files_hold_the_points_less_the_origin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
