/* SPDX-License-Identifier: Apache-2.0 */
/* Connected parts: closedness and its reasons, orientation, cavities, duplicates, degenerates. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/parts.h"

enum {
    MAX_TRIANGLES = 4096,
};

struct soup {
    double corners[MAX_TRIANGLES][3][3];
    size_t count;
};

/* Corners of a unit cube by bits x + 2 y + 4 z, faces outward. */
static const int cube_faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                      {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                      {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};

static void add_triangle(struct soup *soup, const double a[3], const double b[3], const double c[3])
{
    assert_true(soup->count < MAX_TRIANGLES);
    memcpy(soup->corners[soup->count][0], a, 3 * sizeof(double));
    memcpy(soup->corners[soup->count][1], b, 3 * sizeof(double));
    memcpy(soup->corners[soup->count][2], c, 3 * sizeof(double));
    soup->count++;
}

/* Adds faces first .. last - 1 of a cube of edge `edge` at x, y, z; inward if turned. */
static void add_cube_faces(struct soup *soup, double x, double y, double z, double edge, int turned,
                           int first, int last)
{
    for (int t = first; t < last; t++) {
        double p[3][3];
        for (int k = 0; k < 3; k++) {
            int corner = cube_faces[t][turned && k > 0 ? 3 - k : k];
            p[k][0] = x + edge * (corner & 1);
            p[k][1] = y + edge * (corner >> 1 & 1);
            p[k][2] = z + edge * (corner >> 2 & 1);
        }
        add_triangle(soup, p[0], p[1], p[2]);
    }
}

static void add_cube(struct soup *soup, double x, double y, double z, double edge, int turned)
{
    add_cube_faces(soup, x, y, z, edge, turned, 0, 12);
}

static void find(const struct soup *soup, struct umbs_parts *parts)
{
    struct umb_error error = {0};
    enum umb_status status =
        umbs_parts_find((const double(*)[3][3])soup->corners, soup->count, parts, &error);
    assert_int_equal(status, UMB_OK);
}

static void parts_of_nothing_are_none(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 0);
    umbs_parts_finish(&parts);
}

static void cube_is_one_closed_outward_part(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 1, 2, 3, 2, 0);
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_int_equal(parts.parts[0].triangle_count, 12);
    assert_true(parts.parts[0].closed);
    assert_false(parts.parts[0].flipped);
    assert_true(parts.parts[0].volume == 8.0); /* small integers: exact in doubles */
    assert_int_equal(parts.closed_triangles, 12);
    for (int i = 0; i < 3; i++) {
        assert_true(parts.parts[0].box.min[i] == 1.0 + i);
        assert_true(parts.parts[0].box.max[i] == 3.0 + i);
    }
    char text[64];
    umbs_part_reason(&parts.parts[0], text, sizeof text);
    assert_string_equal(text, "closed");
    umbs_parts_finish(&parts);
}

static void cube_without_a_face_tells_where_the_hole_is(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube_faces(&soup, 0, 0, 0, 2, 0, 0, 10); /* without the face x = 2 */
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_false(parts.parts[0].closed);
    assert_int_equal(parts.parts[0].boundary_edges, 4);
    assert_int_equal(parts.parts[0].nonmanifold_edges, 0);
    assert_int_equal(parts.parts[0].inconsistent_edges, 0);
    assert_true(parts.parts[0].hole[0] == 2.0);
    /* A midpoint of an edge of that face: one of y and z is halfway, the other is at an end. */
    assert_true((parts.parts[0].hole[1] == 1.0) != (parts.parts[0].hole[2] == 1.0));
    char text[128];
    umbs_part_reason(&parts.parts[0], text, sizeof text);
    assert_non_null(strstr(text, "4 boundary edges (first at 2 "));
    char cut[8];
    umbs_part_reason(&parts.parts[0], cut, sizeof cut);
    assert_string_equal(cut, "4 bound");
    assert_int_equal(parts.closed_triangles, 0);
    umbs_parts_finish(&parts);
}

static void cubes_that_share_an_edge_are_one_nonmanifold_part(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 0, 0, 0, 1, 0);
    add_cube(&soup, 1, 1, 0, 1, 0); /* touches along x = 1, y = 1 */
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_int_equal(parts.parts[0].nonmanifold_edges, 1);
    assert_int_equal(parts.parts[0].boundary_edges, 0);
    assert_false(parts.parts[0].closed);
    assert_true(parts.parts[0].hole[0] == 1.0 && parts.parts[0].hole[1] == 1.0 &&
                parts.parts[0].hole[2] == 0.5);
    umbs_parts_finish(&parts);
}

static void cubes_that_share_a_vertex_stay_two_closed_parts(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 0, 0, 0, 1, 0);
    add_cube(&soup, 1, 1, 1, 1, 0);
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 2);
    assert_true(parts.parts[0].closed && parts.parts[1].closed);
    assert_int_equal(parts.part_of[0], 0);
    assert_int_equal(parts.part_of[12], 1);
    umbs_parts_finish(&parts);
}

static void inward_cube_is_flipped(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 0, 0, 0, 1, 1);
    add_cube(&soup, 5, 0, 0, 1, 0);
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 2);
    assert_true(parts.parts[0].closed && parts.parts[0].flipped);
    assert_true(parts.parts[0].volume == -1.0);
    assert_false(parts.parts[1].flipped);
    umbs_parts_finish(&parts);
}

static void cavity_inside_a_solid_is_left_alone(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 0, 0, 0, 4, 0);
    add_cube(&soup, 1, 1, 1, 1, 1);
    add_cube(&soup, 3.5, 0, 0, 1, 1); /* sticks out: no cavity */
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 3);
    assert_false(parts.parts[0].flipped);
    assert_true(parts.parts[1].closed);
    assert_false(parts.parts[1].flipped);
    assert_true(parts.parts[2].flipped);
    umbs_parts_finish(&parts);
}

/* Compares with the definition itself, box by box, on many random boxes. */
static void cavities_among_many_solids_match_direct_comparison(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    uint64_t seed = 20260101;
    print_message("seed %llu\n", (unsigned long long)seed);
    soup.count = 0;
    for (int i = 0; i < 300; i++) {
        double v[4];
        for (int k = 0; k < 4; k++) {
            seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
            v[k] = (double)(seed >> 40) / 16777216.0;
        }
        add_cube(&soup, 8 * v[0], 8 * v[1], 8 * v[2], 0.1 + (i % 7 == 0 ? 3 : 0.3) * v[3],
                 i % 7 != 0 && i % 2);
    }
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 300);
    size_t cavities = 0;
    for (size_t i = 0; i < 300; i++) {
        const struct umbs_part *a = &parts.parts[i];
        int held = 0;
        for (size_t j = 0; j < 300; j++) {
            const struct umbs_part *b = &parts.parts[j];
            held |= b->volume > 0 && a->box.min[0] >= b->box.min[0] &&
                    a->box.min[1] >= b->box.min[1] && a->box.min[2] >= b->box.min[2] &&
                    a->box.max[0] <= b->box.max[0] && a->box.max[1] <= b->box.max[1] &&
                    a->box.max[2] <= b->box.max[2];
        }
        assert_int_equal(a->flipped, a->volume < 0 && !held);
        cavities += a->volume < 0 && held;
    }
    assert_true(cavities > 5); /* else the test would prove nothing */
    umbs_parts_finish(&parts);
}

static void moebius_strip_has_an_inconsistent_edge(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    /* Five triangles i, i+1, i+2 modulo 5, wound alike: the smallest Moebius strip. */
    static const double p[5][3] = {{0, 0, 0}, {1, 0, 0.5}, {2, 1, 1}, {1, 2, 0}, {-1, 1, 2}};
    soup.count = 0;
    for (int i = 0; i < 5; i++) {
        int second = i % 2 ? (i + 2) % 5 : (i + 1) % 5;
        int third = i % 2 ? (i + 1) % 5 : (i + 2) % 5;
        add_triangle(&soup, p[i], p[second], p[third]);
    }
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_int_equal(parts.parts[0].boundary_edges, 5);
    assert_int_equal(parts.parts[0].inconsistent_edges, 1);
    assert_false(parts.parts[0].closed);
    umbs_parts_finish(&parts);
}

static void cube_with_one_turned_triangle_is_inconsistent_not_open(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube_faces(&soup, 0, 0, 0, 1, 0, 0, 11);
    add_cube_faces(&soup, 0, 0, 0, 1, 1, 11, 12);
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_int_equal(parts.parts[0].inconsistent_edges, 3);
    assert_int_equal(parts.parts[0].boundary_edges, 0);
    assert_false(parts.parts[0].closed);
    char text[128];
    umbs_part_reason(&parts.parts[0], text, sizeof text);
    assert_non_null(strstr(text, "3 edges used twice in one direction (first at "));
    umbs_parts_finish(&parts);
}

static void duplicates_count_whatever_their_corner_order(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    static const double a[3] = {0, 0, 0}, b[3] = {1, 0, 0}, c[3] = {0, 1, 0}, d[3] = {0, 0, 1};
    soup.count = 0;
    add_triangle(&soup, a, b, c);
    add_triangle(&soup, b, c, a);
    add_triangle(&soup, c, b, a);
    add_triangle(&soup, a, b, d);
    find(&soup, &parts);
    assert_int_equal(parts.duplicate_triangles, 2);
    assert_int_equal(parts.part_count, 1);
    assert_int_equal(parts.parts[0].nonmanifold_edges, 3);
    umbs_parts_finish(&parts);
}

static void fan_of_many_triangles_on_one_edge_counts_once(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    static const double a[3] = {0, 0, 0}, b[3] = {0, 0, 1};
    soup.count = 0;
    for (int i = 0; i < 2000; i++) {
        const double c[3] = {1 + i % 1000, 1, 0}; /* each c twice, in a row of 1000 */
        add_triangle(&soup, a, b, c);
    }
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_int_equal(parts.parts[0].nonmanifold_edges, 1);
    assert_int_equal(parts.parts[0].inconsistent_edges, 2000);
    assert_int_equal(parts.duplicate_triangles, 1000);
    umbs_parts_finish(&parts);
}

static void degenerate_triangles_belong_to_no_part(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    static const double a[3] = {0, 0, 0}, b[3] = {1, 1, 1}, c[3] = {2, 2, 2}, d[3] = {3, 0, 0};
    soup.count = 0;
    add_triangle(&soup, a, a, d); /* equal corners */
    add_cube(&soup, 10, 0, 0, 1, 0);
    add_triangle(&soup, a, b, c); /* on a line */
    add_triangle(&soup, a, b, b);
    find(&soup, &parts);
    assert_int_equal(parts.degenerate_count, 3);
    assert_int_equal(parts.part_count, 1);
    assert_true(parts.part_of[0] == UINT32_MAX);
    assert_true(parts.part_of[13] == UINT32_MAX);
    assert_int_equal(parts.part_of[1], 0);
    assert_int_equal(parts.closed[0], 0);
    assert_int_equal(parts.closed[1], 1);
    assert_int_equal(parts.duplicate_triangles, 0);
    umbs_parts_finish(&parts);
}

static void minus_zero_and_zero_are_one_vertex(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 0, 0, 0, 1, 0);
    for (size_t t = 0; t < soup.count; t += 2) {
        for (int k = 0; k < 9; k++) {
            double *value = &soup.corners[t][k / 3][k % 3];
            *value = *value == 0 ? -0.0 : *value;
        }
    }
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 1);
    assert_true(parts.parts[0].closed);
    umbs_parts_finish(&parts);
}

static void large_coordinates_keep_the_volume(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube(&soup, 1e7, 5e6, 100, 1, 0); /* exact in doubles, so is the volume about the centre */
    find(&soup, &parts);
    assert_true(parts.parts[0].volume == 1.0);
    umbs_parts_finish(&parts);
}

static void parts_follow_the_order_of_first_triangles(void **state)
{
    (void)state;
    static struct soup soup;
    struct umbs_parts parts;
    soup.count = 0;
    add_cube_faces(&soup, 9, 0, 0, 1, 0, 0, 6);
    add_cube(&soup, 0, 0, 0, 1, 0);
    add_cube_faces(&soup, 9, 0, 0, 1, 0, 6, 12);
    add_cube(&soup, 3, 0, 0, 1, 0);
    find(&soup, &parts);
    assert_int_equal(parts.part_count, 3);
    assert_true(parts.parts[0].box.min[0] == 9 && parts.parts[1].box.min[0] == 0 &&
                parts.parts[2].box.min[0] == 3);
    assert_int_equal(parts.part_of[18], 0);
    umbs_parts_finish(&parts);
}

static void too_many_triangles_are_refused_before_any_work(void **state)
{
    (void)state;
    struct umbs_parts parts;
    struct umb_error error = {0};
    enum umb_status status = umbs_parts_find(NULL, (size_t)1431655765, &parts, &error);
    assert_int_equal(status, UMB_E_TOO_LARGE);
    assert_non_null(strstr(error.message, "1431655764"));
    assert_null(parts.parts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_of_nothing_are_none),
        cmocka_unit_test(cube_is_one_closed_outward_part),
        cmocka_unit_test(cube_without_a_face_tells_where_the_hole_is),
        cmocka_unit_test(cubes_that_share_an_edge_are_one_nonmanifold_part),
        cmocka_unit_test(cubes_that_share_a_vertex_stay_two_closed_parts),
        cmocka_unit_test(inward_cube_is_flipped),
        cmocka_unit_test(cavity_inside_a_solid_is_left_alone),
        cmocka_unit_test(cavities_among_many_solids_match_direct_comparison),
        cmocka_unit_test(moebius_strip_has_an_inconsistent_edge),
        cmocka_unit_test(cube_with_one_turned_triangle_is_inconsistent_not_open),
        cmocka_unit_test(duplicates_count_whatever_their_corner_order),
        cmocka_unit_test(fan_of_many_triangles_on_one_edge_counts_once),
        cmocka_unit_test(degenerate_triangles_belong_to_no_part),
        cmocka_unit_test(minus_zero_and_zero_are_one_vertex),
        cmocka_unit_test(large_coordinates_keep_the_volume),
        cmocka_unit_test(parts_follow_the_order_of_first_triangles),
        cmocka_unit_test(too_many_triangles_are_refused_before_any_work),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
