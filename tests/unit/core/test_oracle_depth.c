/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's brute force on scenes small enough to work out by hand: what lit, end, ties and
 * closed parts must be. An oracle that is wrong would prove nothing.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "oracle_depth.h"
#include "oracle_scene.h"

enum {
    SIDE = 64,
    BOX_VERTICES = 8,
    BOX_TRIANGLES = 12,
};

/* A box, outward: corner i has bit k of i as its place along axis k. */
static const uint32_t box_faces[BOX_TRIANGLES][3] = {
    {0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5},
};

static const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

struct fixture {
    struct oracle_scene scene;
    double vertices[4 * BOX_VERTICES][3];
    uint32_t triangles[4 * BOX_TRIANGLES][3];
    uint8_t closed[4 * BOX_TRIANGLES];
};

static void fixture_init(struct fixture *fixture)
{
    memset(fixture, 0, sizeof *fixture);
    fixture->scene.vertices = fixture->vertices;
    fixture->scene.triangles = fixture->triangles;
    fixture->scene.closed = fixture->closed;
}

static void add_box(struct fixture *fixture, const double low[3], const double high[3], int inward)
{
    uint32_t first = (uint32_t)fixture->scene.vertex_count;
    for (uint32_t i = 0; i < BOX_VERTICES; i++) {
        for (uint32_t k = 0; k < 3; k++) {
            fixture->vertices[first + i][k] = (i >> k) & 1 ? high[k] : low[k];
        }
    }
    fixture->scene.vertex_count += BOX_VERTICES;
    for (uint32_t i = 0; i < BOX_TRIANGLES; i++) {
        uint32_t *triangle = fixture->triangles[fixture->scene.triangle_count++];
        for (uint32_t k = 0; k < 3; k++) {
            triangle[k] = first + box_faces[i][inward ? 2 - k : k];
        }
    }
}

/* The texel (x, y) of a fixture seen along the frame `m`. */
static struct oracle_texel texel_of(const struct fixture *fixture, const double m[16], int closed,
                                    uint32_t x, uint32_t y)
{
    static const double origin[3] = {0, 0, 0};
    const struct oracle_view view = {m, origin, SIDE, closed};
    struct oracle_texel row[SIDE];
    struct oracle_depth depth;
    assert_true(oracle_depth_init(&depth, &fixture->scene, &view));
    oracle_depth_row(&depth, y, 1, row);
    oracle_depth_finish(&depth);
    return row[x];
}

static void assert_texel(struct oracle_texel texel, uint32_t lit, uint32_t end)
{
    assert_int_equal(texel.tie, 0);
    assert_int_equal(texel.lit, lit);
    assert_int_equal(texel.end, end);
}

static const double low[3] = {8.3, 8.3, 10.2}, high[3] = {40.7, 50.7, 30.9};

static void closed_box_is_undefined_from_front_to_back(void **state)
{
    (void)state;
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    /* Centres 0.5 .. 9.5 lie before 10.2, and 0.5 .. 30.5 before 30.9. */
    assert_texel(texel_of(&fixture, identity, 1, 20, 31), 10, 31);
    assert_texel(texel_of(&fixture, identity, 0, 20, 31), 10, 10);
    assert_texel(texel_of(&fixture, identity, 1, 2, 31), SIDE, SIDE);
    /* 8.3 is before the centre of texel 8 and after that of texel 7. */
    assert_texel(texel_of(&fixture, identity, 1, 8, 31), 10, 31);
    assert_texel(texel_of(&fixture, identity, 1, 7, 31), SIDE, SIDE);
}

static void mirrored_frame_keeps_fronts_and_backs(void **state)
{
    (void)state;
    static const double mirror[16] = {-1, 0, 0, SIDE, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    assert_texel(texel_of(&fixture, mirror, 1, 43, 31), 10, 31);
}

static void inward_box_is_no_closed_solid(void **state)
{
    (void)state;
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 1);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    assert_int_equal(fixture.closed[0], 0);
    assert_texel(texel_of(&fixture, identity, 1, 20, 31), 10, 10);
}

static void box_without_a_triangle_is_open_and_its_neighbour_stays_closed(void **state)
{
    (void)state;
    static const double low2[3] = {45, 45, 45}, high2[3] = {60, 60, 60};
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    fixture.scene.triangle_count--;
    add_box(&fixture, low2, high2, 0);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    for (int i = 0; i < BOX_TRIANGLES - 1; i++) {
        assert_int_equal(fixture.closed[i], 0);
    }
    for (int i = BOX_TRIANGLES - 1; i < 2 * BOX_TRIANGLES - 1; i++) {
        assert_int_equal(fixture.closed[i], 1);
    }
}

/* Four triangles meet at the common edge: the part is balanced, but no solid (umb-format.md). */
static void boxes_that_share_an_edge_are_open(void **state)
{
    (void)state;
    static const double low2[3] = {40.7, 50.7, 10.2}, high2[3] = {60.1, 60.3, 30.9};
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    add_box(&fixture, low2, high2, 0);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    for (int i = 0; i < 2 * BOX_TRIANGLES; i++) {
        assert_int_equal(fixture.closed[i], 0);
    }
}

static void triangle_without_area_opens_no_solid(void **state)
{
    (void)state;
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    uint32_t *triangle = fixture.triangles[fixture.scene.triangle_count++];
    triangle[0] = 0;
    triangle[1] = triangle[2] = 1;
    assert_true(oracle_scene_find_closed(&fixture.scene));
    assert_int_equal(fixture.closed[0], 1);
    assert_int_equal(fixture.closed[BOX_TRIANGLES], 0);
}

static void nearest_back_face_ends_overlapping_solids(void **state)
{
    (void)state;
    static const double low2[3] = {9.1, 9.1, 20.0}, high2[3] = {39.2, 49.3, 25.8};
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    add_box(&fixture, low2, high2, 0);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    assert_texel(texel_of(&fixture, identity, 1, 20, 31), 10, 26);
}

/* A sheet before a solid makes everything behind it shadowed. */
static void open_sheet_before_a_solid_closes_nothing(void **state)
{
    (void)state;
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, low, high, 0);
    uint32_t first = (uint32_t)fixture.scene.vertex_count;
    static const double sheet[3][3] = {{-50, -50, 5.0}, {200, -50, 5.0}, {-50, 200, 5.0}};
    memcpy(fixture.vertices[first], sheet, sizeof sheet);
    fixture.scene.vertex_count += 3;
    uint32_t *triangle = fixture.triangles[fixture.scene.triangle_count++];
    for (uint32_t k = 0; k < 3; k++) {
        triangle[k] = first + k;
    }
    assert_true(oracle_scene_find_closed(&fixture.scene));
    assert_texel(texel_of(&fixture, identity, 1, 20, 31), 5, 5);
    /* If the sheet is in the voxel index of the solid's front, the solid's interior is undefined
     * all the same. */
    for (uint32_t k = 0; k < 3; k++) {
        fixture.vertices[first + k][2] = 9.8;
    }
    assert_texel(texel_of(&fixture, identity, 1, 20, 31), 10, 31);
}

static void centres_on_edges_and_depths_on_centres_are_ties(void **state)
{
    (void)state;
    static const double on_edge[3] = {8.5, 8.3, 10.2}, on_centre[3] = {8.3, 8.3, 10.5};
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, on_edge, high, 0);
    assert_int_equal(texel_of(&fixture, identity, 0, 8, 31).tie, 1);
    assert_int_equal(texel_of(&fixture, identity, 0, 9, 31).tie, 0);
    assert_int_equal(texel_of(&fixture, identity, 0, 7, 31).tie, 0);
    fixture_init(&fixture);
    add_box(&fixture, on_centre, high, 0);
    assert_int_equal(texel_of(&fixture, identity, 0, 20, 31).tie, 1);
    assert_int_equal(texel_of(&fixture, identity, 0, 2, 31).tie, 0);
}

static void depths_beyond_the_frustum_are_cut(void **state)
{
    (void)state;
    static const double before[3] = {8.3, 8.3, -5.2}, behind[3] = {40.7, 50.7, 90.1};
    struct fixture fixture;
    fixture_init(&fixture);
    add_box(&fixture, before, behind, 0);
    assert_true(oracle_scene_find_closed(&fixture.scene));
    assert_texel(texel_of(&fixture, identity, 1, 20, 31), 0, SIDE);
}

/* Writes a scene file, reads it, and removes it; 0 if it was refused. */
static int read_text(const char *ending, const char *text, struct oracle_scene *scene)
{
    char path[128], error[ORACLE_SCENE_ERROR_SIZE];
    const char *folder = getenv("TMPDIR");
    int length = snprintf(path, sizeof path, "%s/umb_oracle_%ld%s",
                          folder != NULL ? folder : "/tmp", (long)getpid(), ending);
    assert_in_range(length, 1, sizeof path - 1);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, strlen(text), file), strlen(text));
    assert_int_equal(fclose(file), 0);
    int good = oracle_scene_read(scene, path, error);
    assert_int_equal(remove(path), 0);
    return good;
}

static void obj_is_read_with_doubles_and_backward_numbers(void **state)
{
    (void)state;
    struct oracle_scene scene;
    assert_true(read_text(".obj",
                          "# x\nv 6200000.001 -2 3\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n"
                          "f 1//1 2//1 3//1\nf -1 -2 -3\n",
                          &scene));
    assert_int_equal(scene.vertex_count, 3);
    assert_int_equal(scene.triangle_count, 2);
    assert_true(scene.vertices[0][0] == 6200000.001);
    assert_int_equal(scene.triangles[1][0], 2);
    assert_int_equal(scene.triangles[1][2], 0);
    oracle_scene_finish(&scene);
}

static void scenes_of_another_kind_are_refused(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3 4\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"};
    struct oracle_scene scene;
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        assert_false(read_text(".obj", texts[i], &scene));
        oracle_scene_finish(&scene);
    }
    assert_false(read_text(".ply", "ply\nformat ascii 1.0\nend_header\n", &scene));
    oracle_scene_finish(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_box_is_undefined_from_front_to_back),
        cmocka_unit_test(mirrored_frame_keeps_fronts_and_backs),
        cmocka_unit_test(inward_box_is_no_closed_solid),
        cmocka_unit_test(box_without_a_triangle_is_open_and_its_neighbour_stays_closed),
        cmocka_unit_test(boxes_that_share_an_edge_are_open),
        cmocka_unit_test(triangle_without_area_opens_no_solid),
        cmocka_unit_test(nearest_back_face_ends_overlapping_solids),
        cmocka_unit_test(open_sheet_before_a_solid_closes_nothing),
        cmocka_unit_test(centres_on_edges_and_depths_on_centres_are_ties),
        cmocka_unit_test(depths_beyond_the_frustum_are_cut),
        cmocka_unit_test(obj_is_read_with_doubles_and_backward_numbers),
        cmocka_unit_test(scenes_of_another_kind_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
