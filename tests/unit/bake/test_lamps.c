/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lamps and the surfaces around them: lamps too near to a surface must be refused, flat faces must
 * have voxels of the least depth, and the faces of a cube must leave no gap.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/frusta.h"
#include "make_asset.h"

enum {
    LOG2 = 9,
    SIZE = 1 << LOG2
};

static const double origin[3] = {0, 0, 0};

/* A floor of 10 x 10 m at z 0, a sheet above it. */
static const double room[4][3][3] = {
    {{0, 0, 0}, {10, 0, 0}, {10, 10, 0}},
    {{0, 0, 0}, {10, 10, 0}, {0, 10, 0}},
    {{0, 0, 5}, {10, 0, 5}, {10, 10, 5}},
    {{4, 4, 3}, {4, 4, 3}, {4, 4, 3}}, /* no area: no surface */
};

/* Fits a light's frusta and returns the result. In: half_deg: half the angle of a spot light's
 * cone; 0: a point light. */
static enum umb_status fit(const double (*corners)[3][3], size_t count, const double position[3],
                           const double direction[3], double half_deg,
                           struct umb_frustum_info **frusta, uint32_t *frustum_count,
                           struct umb_error *error)
{
    double cone = half_deg * 0.017453292519943295;
    struct umb_light_info light = {.name = "lamp",
                                   .kind = half_deg > 0 ? UMB_LIGHT_SPOT : UMB_LIGHT_POINT};
    struct umbb_light_choice choice = {.lights = &light, .cones = &cone, .count = 1};
    struct umbb_frusta_input input = {.fit = {corners, count, origin, LOG2, 1},
                                      .bounds = {{0, 0, 0}, {10, 10, 5}}};
    memcpy(light.position, position, sizeof light.position);
    for (int k = 0; half_deg > 0 && k < 3; k++) {
        const double *d = direction;
        light.direction[k] = d[k] / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    }
    return umbb_frusta_fit(&input, &choice, frusta, frustum_count, error);
}

struct stand {
    const char *what;
    double position[3], direction[3];
    double half_deg;
    int is_refused;
};

static void lamps_too_near_to_a_surface_are_refused_and_named(void **state)
{
    (void)state;
    static const struct stand stands[] = {
        {"on the floor", {5, 5, 0}, {0, 0, 1}, 0, 1},
        {"on its edge", {5, 0, 0}, {0, 0, 1}, 0, 1},
        {"beyond its edge", {5, -1, 0}, {0, 0, 1}, 0, 0},
        {"1e-7 m above", {5, 5, 1e-7}, {0, 0, 1}, 0, 1},
        {"1e-7 m below", {5, 5, -1e-7}, {0, 0, 1}, 0, 1},
        {"1e-6 m above", {5, 5, 1e-6}, {0, 0, 1}, 0, 0},
        {"in the corner of what has no area", {4, 4, 3}, {0, 0, 1}, 0, 0},
        {"on the floor, away from it", {5, 5, 0}, {0, 0, 1}, 60, 0},
        {"on the floor, away from it, wide", {5, 5, 0}, {0, 0, 1}, 85, 0},
        {"on the floor, along it", {5, 5, 0}, {1, 0, 0.1}, 60, 1},
        {"on the floor, into it", {5, 5, 0}, {0, 0, -1}, 60, 0},
        {"1e-7 m above, away", {5, 5, 1e-7}, {0, 0, 1}, 60, 0},
        {"1e-7 m above, into it", {5, 5, 1e-7}, {0, 0, -1}, 60, 1},
        {"under the ceiling", {5, 2, 5 - 1e-7}, {0, 0, 1}, 20, 1},
    };
    for (size_t i = 0; i < sizeof stands / sizeof stands[0]; i++) {
        const struct stand *s = &stands[i];
        struct umb_frustum_info *frusta;
        struct umb_error error = {0};
        uint32_t count;
        const enum umb_status status =
            fit(room, 4, s->position, s->direction, s->half_deg, &frusta, &count, &error);
        print_message("%s: %s\n", s->what, error.message);
        assert_int_equal(status, s->is_refused ? UMB_E_BAD_SCENE : UMB_OK);
        if (s->is_refused) {
            assert_non_null(strstr(error.message, "light 0 ('lamp') at "));
            assert_non_null(strstr(error.message, "the limit is "));
            assert_non_null(strstr(error.message, "move the light at least "));
        }
        free(frusta);
    }
}

/* Random triangles around the light. One with a point in the space that the face leaves out must be
 * refused. Not many others may be; the points tested may miss a corner in that space. */
static void what_a_face_leaves_out_is_refused(void **state)
{
    (void)state;
    uint64_t seed = round_seed(31);
    int left_out = 0, refused = 0;
    for (int n = 0; n < case_count(20000); n++) {
        struct umbb_eye eye = {
            .axes = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, .tangent = 1, .reach = 16};
        const double near = eye.reach * UMBB_NEAR_SHARE;
        const double tangent = umbb_guarded_tangent(1, LOG2);
        double v[1][3][3];
        int seen = 0;
        const double scale = near * (next_random(&seed) % 4 == 0 ? 100 : 3);
        for (int i = 0; i < 9; i++) {
            v[0][i / 3][i % 3] = scale * (2 * random_unit(&seed) - 1);
        }
        const struct umbb_fit triangle = {(const double(*)[3][3])v, 1, origin, LOG2, 1};
        struct umbb_contact contact;
        for (int i = 0; i < 2000 && !seen; i++) {
            const double b = random_unit(&seed), c = (1 - b) * random_unit(&seed);
            double p[3];
            for (int k = 0; k < 3; k++) {
                p[k] = v[0][0][k] + b * (v[0][1][k] - v[0][0][k]) + c * (v[0][2][k] - v[0][0][k]);
            }
            seen = p[2] > 0 && p[2] < near && fabs(p[0]) < tangent * p[2] &&
                   fabs(p[1]) < tangent * p[2];
        }
        const int found = umbb_lamp_contact(&triangle, &eye, &contact);
        assert_true(found || !seen);
        if (found) { /* its nearest place is one that the face's tip may hold */
            assert_true(contact.distance < near * sqrt(1 + 2 * tangent * tangent));
        }
        left_out += seen;
        refused += found;
    }
    print_message("%d left out, %d refused\n", left_out, refused);
    assert_true(left_out > case_count(20000) / 50 && refused < 2 * left_out);
}

static void flat_faces_have_voxels_that_coordinates_resolve(void **state)
{
    (void)state;
    for (int n = 0; n < 6; n++) {
        const double position[3] = {3.1, 4.7, pow(10, -n)};
        struct umb_frustum_info *frusta;
        struct umb_error error;
        uint32_t count;
        int flat = 0;
        assert_int_equal(fit(room, 4, position, position, 0, &frusta, &count, &error), UMB_OK);
        for (uint32_t i = 0; i < count; i++) {
            const double *z = frusta[i].voxel_step[2];
            const double depth = sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2]);
            assert_true(depth >= 5 * UMBB_VOXEL_SHARE * (1 - 1e-12));
            flat += depth < 5 * UMBB_VOXEL_SHARE * (1 + 1e-12);
        }
        assert_true(n < 4 || flat > 0);
        free(frusta);
    }
}

/* A box around the lamp. Each direction in a wide spot light, and every direction of a point light,
 * must be in the face along whose axis it goes farthest. */
static void faces_of_a_cube_leave_no_gap(void **state)
{
    (void)state;
    static double box[12][3][3];
    static const double position[3] = {5, 5, 2.5};
    uint64_t seed = round_seed(32);
    for (int t = 0; t < 12; t++) { /* two triangles a side */
        const int axis = t / 4, side = t / 2 % 2;
        for (int k = 0; k < 3; k++) {
            const int corner = k == 0 ? 0 : k + t % 2; /* of four, in a ring */
            box[t][k][axis] = side ? 5 : -5;
            box[t][k][(axis + 1) % 3] = corner == 1 || corner == 2 ? 5 : -5;
            box[t][k][(axis + 2) % 3] = corner >= 2 ? 5 : -5;
            for (int i = 0; i < 3; i++) {
                box[t][k][i] += position[i];
            }
        }
    }
    for (int n = 0; n < 40; n++) {
        struct umb_frustum_info *frusta;
        struct umb_error error;
        uint32_t count;
        double direction[3];
        for (int k = 0; k < 3; k++) {
            direction[k] = 2 * random_unit(&seed) - 1;
        }
        const int is_point = n % 4 == 0;
        assert_int_equal(fit((const double(*)[3][3])box, 12, position, direction, is_point ? 0 : 80,
                             &frusta, &count, &error),
                         UMB_OK);
        assert_int_equal(count, is_point ? 6 : 5);
        for (int i = 0; i < 2000; i++) {
            double p[3], ahead = 0, most = 0, at[2] = {-1, -1};
            for (int k = 0; k < 3; k++) {
                p[k] = position[k] + 2 * random_unit(&seed) - 1;
                ahead += (p[k] - position[k]) * direction[k];
            }
            for (uint32_t f = 0; f < count; f++) {
                const double(*m)[4] = frusta[f].world_to_voxel;
                double row[4];
                for (int r = 0; r < 4; r++) {
                    row[r] = m[r][0] * p[0] + m[r][1] * p[1] + m[r][2] * p[2] + m[r][3];
                }
                if (row[3] > most) {
                    most = row[3];
                    at[0] = row[0] / most;
                    at[1] = row[1] / most;
                }
            }
            assert_true((!is_point && ahead <= 0) ||
                        (at[0] >= 8 && at[0] <= SIZE - 8 && at[1] >= 8 && at[1] <= SIZE - 8));
        }
        free(frusta);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lamps_too_near_to_a_surface_are_refused_and_named),
        cmocka_unit_test(what_a_face_leaves_out_is_refused),
        cmocka_unit_test(flat_faces_have_voxels_that_coordinates_resolve),
        cmocka_unit_test(faces_of_a_cube_leave_no_gap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
