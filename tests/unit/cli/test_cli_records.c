/* SPDX-License-Identifier: Apache-2.0 */
/* The progress of boxes: about how many voxels each box will hold. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "cli/cli_record_progress.h"

static const double origin[3] = {4e6, -2e5, 30};

/* A frustum of 64 voxels a side, half a metre along x and y and a quarter along z, turned about the
 * z axis, with its corner at the origin. */
static struct umb_frustum_info turned_frustum(double degrees)
{
    const double c = cos(degrees * acos(-1) / 180), s = sin(degrees * acos(-1) / 180);
    return (struct umb_frustum_info){
        .log2_size = 6,
        .world_to_voxel = {{2 * c, 2 * s, 0, 1}, {-2 * s, 2 * c, 0, 2}, {0, 0, 4, 3}, {0, 0, 0, 1}},
        .voxel_step = {{c / 2, s / 2, 0}, {-s / 2, c / 2, 0}, {0, 0, 0.25}},
    };
}

/* Counts the voxels one by one. */
static double count_plainly(const struct umb_frustum_info *f, const struct umb_box *box)
{
    unsigned count = 0;
    for (unsigned i = 0; i < 64 * 64 * 64; i++) {
        const double at[3] = {i % 64 + 0.5, i / 64 % 64 + 0.5, i / 4096 + 0.5};
        unsigned inside = 1;
        for (unsigned axis = 0; axis < 3; axis++) {
            double w = origin[axis];
            for (unsigned k = 0; k < 3; k++) {
                w += f->voxel_step[k][axis] * (at[k] - f->world_to_voxel[k][3]);
            }
            inside &= w >= box->min[axis] && w < box->max[axis];
        }
        count += inside;
    }
    return count;
}

static void a_box_is_known_by_how_many_voxels_it_will_hold(void **state)
{
    static const double corners[][6] = {
        {-1e9, -1e9, -1e9, 1e9, 1e9, 1e9}, /* all of the frustum */
        {0, 5, 1, 8, 15, 9},               /* some of it, */
        {-100, 5, 1, 8, 100, 9},           /* reaching over its sides, */
        {2, 6, -100, 9, 17, 100},          /* above and below, */
        {-100, -100, 3, 100, 100, 3.5},    /* flat */
    };
    (void)state;
    for (unsigned i = 0; i < 3 * sizeof corners / sizeof corners[0]; i++) {
        const struct umb_frustum_info f = turned_frustum(i % 3 * 30.0 - 25);
        struct umb_box box;
        for (unsigned k = 0; k < 3; k++) {
            box.min[k] = origin[k] + corners[i / 3][k];
            box.max[k] = origin[k] + corners[i / 3][3 + k];
        }
        const double exact = count_plainly(&f, &box), got = umbc_box_voxels(&f, origin, &box);
        if (!(exact > 0 && fabs(got - exact) < 0.1 * exact)) {
            fail_msg("box %u: %g voxels, not %g", i, got, exact);
        }
    }
}

static void a_box_beside_the_frustum_holds_none(void **state)
{
    (void)state;
    const struct umb_frustum_info f = turned_frustum(10);
    const struct umb_box beside = {{0, 0, 0}, {1, 1, 1}};
    assert_true(umbc_box_voxels(&f, origin, &beside) == 0);
    const struct umb_box flat = {{4e6, -2e5, 31}, {4e6 + 1, -2e5 + 1, 31}};
    assert_true(umbc_box_voxels(&f, origin, &flat) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_box_is_known_by_how_many_voxels_it_will_hold),
        cmocka_unit_test(a_box_beside_the_frustum_holds_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
