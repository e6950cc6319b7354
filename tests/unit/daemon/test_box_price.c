/* SPDX-License-Identifier: Apache-2.0 */
/* Bricks that a box's sides cut: the estimate is compared with bricks counted one by one. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "daemon/work/volume_query_work.h"

#define LOG2_SIZE 10
#define ACROSS    (1 << LOG2_SIZE >> 3)
#define FAR       16.0 /* metres: more than a brick's diagonal */

/* Voxels of these edges, turned about z and then about x. */
static struct umb_frustum_info frustum_of(const double edges[3], double about_z, double about_x)
{
    struct umb_frustum_info f = {.log2_size = LOG2_SIZE};
    const double c = cos(about_z), s = sin(about_z), p = cos(about_x), q = sin(about_x);
    const double axes[3][3] = {{c, s * p, s * q}, {-s, c * p, c * q}, {0, -q, p}};
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            f.voxel_step[i][k] = edges[i] * axes[i][k];
        }
    }
    return f;
}

/* World place of a voxel's first corner. Voxel 0 lies at the origin. */
static void world_of(const struct umb_frustum_info *f, const int voxel[3], double world[3])
{
    for (int k = 0; k < 3; k++) {
        world[k] = 0;
        for (int j = 0; j < 3; j++) {
            world[k] += f->voxel_step[j][k] * voxel[j];
        }
    }
}

/* Returns whether a brick has corners on both sides of the box's surface; 0 for a brick far
 * away. */
static int is_cut(const struct umb_frustum_info *f, const int brick[3], const struct umb_box *box)
{
    int inside = 0;
    for (int i = 0; i < 8; i++) {
        const int voxel[3] = {8 * (brick[0] + (i & 1)), 8 * (brick[1] + (i >> 1 & 1)),
                              8 * (brick[2] + (i >> 2))};
        double world[3];
        int here = 1;
        world_of(f, voxel, world);
        for (int k = 0; k < 3; k++) {
            here &= world[k] >= box->min[k] && world[k] < box->max[k];
            if (fabs(world[k] - 0.5 * (box->min[k] + box->max[k])) >
                box->max[k] - box->min[k] + FAR) {
                return 0;
            }
        }
        inside += here;
    }
    return inside > 0 && inside < 8;
}

static double counted(const struct umb_frustum_info *f, const struct umb_box *box)
{
    double cut = 0;
    for (int i = 0; i < ACROSS * ACROSS * ACROSS; i++) {
        const int brick[3] = {i % ACROSS, i / ACROSS % ACROSS, i / ACROSS / ACROSS};
        cut += is_cut(f, brick, box);
    }
    return cut;
}

/* A cube of `edge` metres about the frustum's middle. */
static struct umb_box box_of(const struct umb_frustum_info *f, double edge)
{
    struct umb_box box;
    for (int k = 0; k < 3; k++) {
        double middle = 0;
        for (int i = 0; i < 3; i++) {
            middle += f->voxel_step[i][k] * (1 << LOG2_SIZE) / 2;
        }
        box.min[k] = middle - 0.5 * edge;
        box.max[k] = middle + 0.5 * edge;
    }
    return box;
}

static void boxes_are_priced_by_the_bricks_that_their_sides_cut(void **state)
{
    (void)state;
    static const double edges[][3] = {{1, 1, 1}, {1, 1, 0.25}, {0.5, 1, 0.25}};
    static const double turns[][2] = {{0, 0}, {0.6, 0.9}};
    for (size_t i = 0; i < 6; i++) {
        const struct umb_frustum_info f =
            frustum_of(edges[i % 3], turns[i / 3][0], turns[i / 3][1]);
        const struct umb_box box = box_of(&f, 130);
        const double bricks = umbd_box_bricks(&f, &box), truth = counted(&f, &box);
        if (!(fabs(bricks - truth) <= 0.1 * truth)) {
            fail_msg("case %zu: %g bricks, %g counted", i, bricks, truth);
        }
    }
}

static void no_box_costs_more_than_the_frustum(void **state)
{
    (void)state;
    const struct umb_frustum_info f = frustum_of((const double[3]){1, 1, 0.05}, 0.6, 0.9);
    const double most = 6.0 * ACROSS * ACROSS;
    const struct umb_box huge = {{-1e9, -1e9, -1e9}, {1e9, 1e9, 1e9}};
    const struct umb_box none = {{NAN, 0, 0}, {1, 1, 1}};
    assert_true(umbd_box_bricks(&f, &huge) == most);
    assert_true(umbd_box_bricks(&f, &none) == most);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_are_priced_by_the_bricks_that_their_sides_cut),
        cmocka_unit_test(no_box_costs_more_than_the_frustum),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
