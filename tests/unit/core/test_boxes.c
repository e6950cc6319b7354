/* SPDX-License-Identifier: Apache-2.0 */
/* Boxes and columns, compared with loops over every voxel. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "volume_fixture.h"
#include "query/volume_parts.h"

/* Computes the centre of a voxel as the header defines it. */
static double centre_at(const struct volume_fixture *f, unsigned axis, const int64_t voxel[3])
{
    double w = 0;
    for (unsigned k = 0; k < 3; k++) {
        w -= f->frustum.world_to_voxel[k][3] * f->frustum.voxel_step[k][axis];
    }
    for (unsigned k = 0; k < 3; k++) {
        w += ((double)voxel[k] + 0.5) * f->frustum.voxel_step[k][axis];
    }
    return w + fixture_origin[axis];
}

/* Tests every single voxel from low to high (inclusive), clipped to the frustum. */
static struct umb_box_answer count_plainly(const struct volume_fixture *f,
                                           const struct umb_box *box, const double low[3],
                                           const double high[3])
{
    struct umb_box_answer answer = {0, 0};
    int64_t first[3], last[3], v[3];
    for (unsigned k = 0; k < 3; k++) {
        first[k] = (int64_t)fmax(0, floor(low[k]));
        last[k] = (int64_t)fmin(f->size - 1.0, floor(high[k]));
    }
    for (v[2] = first[2]; v[2] <= last[2]; v[2]++) {
        for (v[1] = first[1]; v[1] <= last[1]; v[1]++) {
            for (v[0] = first[0]; v[0] <= last[0]; v[0]++) {
                int inside = 1;
                for (unsigned axis = 0; inside && axis < 3; axis++) {
                    double w = centre_at(f, axis, v);
                    inside = w >= box->min[axis] && w < box->max[axis];
                }
                answer.voxels += (uint64_t)inside;
                answer.lit += (uint64_t)(inside && fixture_voxel(f, v[0], v[1], v[2]));
            }
        }
    }
    return answer;
}

/* Draws a box that begins anywhere in the frustum; its sides are mostly short. */
static struct umb_box random_box(const struct volume_fixture *f, uint64_t *seed)
{
    double v[3], p[3];
    struct umb_box box;
    double longest = next_random(seed) % 50 == 0 ? 30 : 5;
    for (unsigned k = 0; k < 3; k++) {
        v[k] = (random_unit(seed) * 1.2 - 0.1) * f->size;
        v[k] = next_random(seed) % 4 == 0 ? floor(v[k]) + 0.5 : v[k]; /* a voxel's centre */
    }
    fixture_world(f, v, p);
    for (unsigned k = 0; k < 3; k++) {
        box.min[k] = p[k] + fixture_origin[k];
        box.max[k] = box.min[k] + random_unit(seed) * longest;
    }
    return box;
}

static void expect_plain_counts(voxel_fn lit, uint32_t log2_size, int turned, uint64_t seed)
{
    struct volume_fixture f;
    volume_fixture_open(&f, lit, log2_size, turned, 0);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (size_t i = 0; i < (size_t)case_count(short_count(300, 75)); i++) {
        struct umb_box box = random_box(&f, &seed);
        struct umb_box_answer got;
        struct umb_box_answers answers = {.boxes = &got};
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        for (unsigned c = 0; c < 8; c++) {
            double p[3], v[3];
            for (unsigned k = 0; k < 3; k++) {
                p[k] = (c >> k & 1 ? box.max[k] : box.min[k]) - fixture_origin[k];
            }
            fixture_voxel_of(&f, p, v);
            for (unsigned k = 0; k < 3; k++) {
                low[k] = fmin(low[k], v[k] - 3);
                high[k] = fmax(high[k], v[k] + 3);
            }
        }
        struct umb_box_answer want = count_plainly(&f, &box, low, high);
        assert_int_equal(umb_volume_boxes(&f.volume, &box, 0, 1, NULL, &answers, NULL), UMB_OK);
        if (got.lit != want.lit || got.voxels != want.voxels) {
            fail_msg("box %zu: %llu of %llu lit, not %llu of %llu", i, (unsigned long long)got.lit,
                     (unsigned long long)got.voxels, (unsigned long long)want.lit,
                     (unsigned long long)want.voxels);
        }
    }
    volume_fixture_close(&f);
}

static void world_boxes_count_the_voxels_whose_centres_lie_inside(void **state)
{
    (void)state;
    expect_plain_counts(fixture_noise, 7, 0, 21);
    expect_plain_counts(fixture_noise, 6, 1, 22);
    expect_plain_counts(fixture_hills, 7, 1, 23);
}

static void boxes_side_by_side_share_no_voxel_and_leave_none_out(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_noise, 6, 1, 0);
    enum {
        CUTS = 5
    };
    struct umb_box boxes[CUTS * CUTS * CUTS], whole;
    struct umb_box_answer parts[CUTS * CUTS * CUTS], all;
    struct umb_box_answers a = {.boxes = parts}, b = {.boxes = &all};
    for (unsigned k = 0; k < 3; k++) {
        whole.min[k] = fixture_origin[k] - 40;
        whole.max[k] = fixture_origin[k] + 41;
    }
    for (unsigned i = 0; i < CUTS * CUTS * CUTS; i++) {
        const unsigned at[3] = {i % CUTS, i / CUTS % CUTS, i / CUTS / CUTS};
        for (unsigned k = 0; k < 3; k++) {
            double side = whole.max[k] - whole.min[k];
            boxes[i].min[k] = whole.min[k] + side * at[k] / CUTS;
            boxes[i].max[k] = whole.min[k] + side * (at[k] + 1) / CUTS;
        }
    }
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, CUTS * CUTS * CUTS, NULL, &a, NULL),
                     UMB_OK);
    assert_int_equal(umb_volume_boxes(&f.volume, &whole, 0, 1, NULL, &b, NULL), UMB_OK);
    struct umb_box_answer sum = {0, 0};
    for (unsigned i = 0; i < CUTS * CUTS * CUTS; i++) {
        sum.lit += parts[i].lit;
        sum.voxels += parts[i].voxels;
    }
    assert_int_equal(all.voxels, 64 * 64 * 64);
    assert_int_equal(sum.voxels, all.voxels);
    assert_int_equal(sum.lit, all.lit);
    volume_fixture_close(&f);
}

static void voxel_boxes_count_exactly_and_are_clipped_to_the_frustum(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 24;
    volume_fixture_open(&f, fixture_noise, 7, 0, 0);
    for (size_t i = 0; i < (size_t)case_count(short_count(300, 75)); i++) {
        struct umb_voxel_box box;
        struct umb_box_answer got, want = {0, 0};
        struct umb_box_answers answers = {.boxes = &got};
        for (unsigned k = 0; k < 3; k++) {
            box.min[k] = (int64_t)(next_random(&seed) % 140) - 6;
            box.max[k] = box.min[k] + (int64_t)(next_random(&seed) % (i % 50 == 0 ? 130 : 20)) - 2;
        }
        if (i % 100 == 7) {
            box.min[0] = INT64_MIN;
            box.max[2] = INT64_MAX;
        }
        assert_int_equal(umb_volume_voxel_boxes(&f.volume, &box, 0, 1, NULL, &answers, NULL),
                         UMB_OK);
        int64_t low[3], high[3];
        for (unsigned k = 0; k < 3; k++) {
            low[k] = box.min[k] < 0 ? 0 : box.min[k];
            high[k] = box.max[k] > f.size ? f.size : box.max[k];
        }
        for (int64_t z = low[2]; z < high[2]; z++) {
            for (int64_t y = low[1]; y < high[1]; y++) {
                for (int64_t x = low[0]; x < high[0]; x++) {
                    want.voxels++;
                    want.lit += (uint64_t)fixture_voxel(&f, x, y, z);
                }
            }
        }
        assert_int_equal(got.voxels, want.voxels);
        assert_int_equal(got.lit, want.lit);
    }
    volume_fixture_close(&f);
}

static void boxes_that_are_no_boxes_are_named_and_do_no_harm(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_error error;
    struct umb_box boxes[2] = {{{0, 0, 0}, {1, 1, 1}}, {{0, 5, 0}, {1, 4, 1}}};
    struct umb_box_answer got[2];
    struct umb_box_answers answers = {.boxes = got};
    volume_fixture_open(&f, fixture_noise, 6, 1, 0);
    assert_int_equal(umb_boxes_check(boxes, 2, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "boxes[1].min.y: 5"));
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, 2, NULL, &answers, NULL), UMB_OK);
    assert_int_equal(got[1].voxels, 0);
    boxes[1].max[1] = NAN;
    assert_int_equal(umb_boxes_check(boxes, 2, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "boxes[1].max.y: nan"));
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, 2, NULL, &answers, NULL), UMB_OK);
    boxes[1] = (struct umb_box){{-1.7e308, -1.7e308, -INFINITY}, {1.7e308, 1.7e308, INFINITY}};
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, 2, NULL, &answers, NULL), UMB_OK);
    assert_int_equal(got[1].voxels, 64 * 64 * 64);
    volume_fixture_close(&f);
}

/* A watch that counts its calls, and gives up a box after a limit of steps. It checks that the
 * first answer's counts never fall. */
struct patience {
    uint64_t limit, last;
    unsigned asked;
    const struct umb_box_answer *answer; /* or NULL */
    uint64_t counted;
};

static int is_patient(void *user, uint64_t steps)
{
    struct patience *p = user;
    p->asked++;
    p->last = steps;
    if (p->answer != NULL) {
        assert_true(p->answer->voxels > p->counted && p->answer->lit <= p->answer->voxels);
        p->counted = p->answer->voxels;
    }
    return steps < p->limit;
}

static void a_box_is_given_up_when_it_takes_too_many_steps(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct patience patience = {.limit = UINT64_MAX};
    struct umb_box boxes[2] = {{{-15, -15, -15}, {15, 15, 15}}, {{0, 0, 0}, {1, 1, 1}}};
    struct umb_box_answer free_of_it[2], got[2];
    struct umb_box_answers plain = {.boxes = free_of_it};
    struct umb_box_answers answers = {.boxes = got};
    const struct umb_box_watch watch = {is_patient, &patience};
    volume_fixture_open(&f, fixture_noise, 8, 1, 0);
    for (unsigned i = 0; i < 2; i++) {
        for (unsigned k = 0; k < 3; k++) {
            boxes[i].min[k] += 5 + fixture_origin[k];
            boxes[i].max[k] += 5 + fixture_origin[k];
        }
    }
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, 2, NULL, &plain, NULL), UMB_OK);
    patience.answer = &got[0];
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, 2, &watch, &answers, NULL), UMB_OK);
    assert_memory_equal(got, free_of_it, sizeof got);
    assert_true(patience.counted > 0 && patience.counted < got[0].voxels);
    assert_true(patience.asked >= 1 && patience.last >= UMB_BOX_STEPS);
    patience = (struct patience){.limit = 0};
    assert_int_equal(umb_volume_boxes(&f.volume, boxes, 0, 2, &watch, &answers, NULL), UMB_OK);
    assert_int_equal(patience.asked, 1);
    assert_true(got[0].voxels == UINT64_MAX);
    assert_memory_equal(&got[1], &free_of_it[1], sizeof got[1]);
    volume_fixture_close(&f);
}

/* A tree with one node in each level, which the node above has as all eight children: 2^(3n) voxels
 * in a kilobyte. The lowest node has only lit and shadowed children, no bricks. */
static struct bytes shared_nodes(uint32_t log2_size)
{
    static const double origin[3] = {0, 0, 0};
    const struct voxels voxels = {.log2_size = log2_size, .frustum_count = 1};
    static uint16_t mixed = 0xaaaa, lit_and_shadowed = 0x1111;
    uint32_t first[2] = {0, 8}, none[2] = {0, 0}, children[8] = {0};
    struct umb__octree_root root = {UMB__NODE_MIXED, log2_size, 0};
    struct umb__octree octree = {.root_count = 1, .roots = &root};
    struct umb__content content;
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    uint8_t id[UMB_ID_BYTES];
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= log2_size; level++) {
        const int lowest = level == UMB_LEVEL_BRICK + 1;
        octree.level[level] = (struct umb__octree_level){
            .count = 1,
            .masks = lowest ? &lit_and_shadowed : &mixed,
            .first = lowest ? none : first,
            .children = children,
        };
    }
    make_content(&voxels, 1, origin, &content);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    return file;
}

/* In such a tree a box must be counted if the resolution bounds its steps, and refused
 * otherwise. */
static void a_box_without_a_watch_has_a_limit(void **state)
{
    static const uint32_t sizes[] = {11, 13};
    (void)state;
    for (size_t i = 0; i < (size_t)short_count(2, 1); i++) { /* the second takes 2^30 steps */
        const int64_t size = (int64_t)1 << sizes[i];
        const struct umb_voxel_box boxes[2] = {{{0, 0, 0}, {16, 16, 16}},
                                               {{0, 0, 0}, {size, size, size}}};
        struct umb_box_answer got[2] = {{0, 0}, {0, 0}};
        struct umb_box_answers answers = {.boxes = got};
        struct bytes file = shared_nodes(sizes[i]);
        struct umb_asset *asset;
        struct umb_volume volume;
        struct umb_error error = {0};
        assert_true(file.size < 10000);
        assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, &error), UMB_OK);
        assert_int_equal(umb_volume_prepare(asset, 0, &volume, &error), UMB_OK);
        const enum umb_status status =
            umb_volume_voxel_boxes(&volume, boxes, 0, 2, NULL, &answers, &error);
        assert_int_equal(got[0].voxels, 16 * 16 * 16);
        assert_int_equal(got[0].lit, got[0].voxels / 2);
        if (i == 0) {
            assert_int_equal(status, UMB_OK);
            assert_int_equal(got[1].voxels, size * size * size);
            assert_int_equal(got[1].lit, got[1].voxels / 2);
        } else {
            assert_int_equal(status, UMB_E_LIMIT);
            assert_int_equal(got[1].voxels, UINT64_MAX);
            assert_non_null(strstr(error.message, "boxes[1]: takes more than 1073741824 steps"));
            assert_non_null(strstr(error.message, "8192 voxels a side"));
        }
        umb_asset_close(asset);
        bytes_finish(&file);
    }
}

static void corners_make_boxes_in_either_order(void **state)
{
    (void)state;
    struct umb_error error;
    struct umb_box boxes[1];
    float ends[12] = {0, 0, 0, 0, 0, 0, 1, 5, 3, 2, 4, 6};
    struct umb_segments corners = {.ends = ends, .origin = {10, 20, 30}, .count = 2};
    umb_boxes_from_corners(&corners, 1, 1, boxes);
    assert_true(boxes[0].min[0] == 11 && boxes[0].max[0] == 12);
    assert_true(boxes[0].min[1] == 24 && boxes[0].max[1] == 25);
    assert_true(boxes[0].min[2] == 33 && boxes[0].max[2] == 36);
    assert_int_equal(umb__corners_check(&corners, &error), UMB_OK);
    ends[10] = INFINITY;
    assert_int_equal(umb__corners_check(&corners, &error), UMB_E_ARGUMENT);
    assert_string_equal(error.message, "boxes[1].y1: inf, must be finite");
}

static void columns_end_at_their_first_shadowed_voxel(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 25;
    volume_fixture_open(&f, fixture_hills, 7, 1, 0);
    const double *step = f.frustum.voxel_step[2];
    double step_m = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
    for (size_t i = 0; i < (size_t)case_count(short_count(20000, 5000)); i++) {
        double v[3], p[3];
        uint32_t want = 0;
        for (unsigned k = 0; k < 3; k++) {
            v[k] = floor((random_unit(&seed) * 1.2 - 0.1) * f.size) + 0.5;
        }
        int outside = v[0] < 0 || v[0] >= f.size || v[1] < 0 || v[1] >= f.size;
        while (want < f.size &&
               fixture_voxel(&f, (int64_t)floor(v[0]), (int64_t)floor(v[1]), want)) {
            want++;
        }
        fixture_world(&f, v, p);
        struct umb_column_answer got;
        struct umb_column_answers answers = {.columns = &got};
        struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
        memcpy(points.origin, fixture_origin, sizeof fixture_origin);
        umb_volume_columns(&f.volume, &points, 0, 1, &answers);
        assert_int_equal(got.outside, outside);
        assert_int_equal(got.lit, want);
        if (want == f.size) {
            assert_true(isinf(got.distance_m));
        } else {
            assert_true(fabs(got.distance_m - (want - v[2]) * step_m) < 1e-6);
        }
    }
    volume_fixture_close(&f);
}

static void closed_frusta_refuse_columns_and_open_ones_do_not(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_error error;
    volume_fixture_open(&f, fixture_hills, 6, 0, 0);
    assert_int_equal(umb_volume_check_columns(&f.volume, &error), UMB_OK);
    struct umb_volume none;
    assert_int_equal(umb_volume_prepare(f.asset, 1, &none, &error), UMB_E_NOT_FOUND);
    assert_non_null(strstr(error.message, "light: 1"));
    volume_fixture_close(&f);
    volume_fixture_open(&f, fixture_hills, 6, 0, 1);
    assert_int_equal(umb_volume_check_columns(&f.volume, &error), UMB_E_UNSUPPORTED);
    assert_non_null(strstr(error.message, "--closed off"));
    volume_fixture_close(&f);
}

static void columns_of_points_that_are_not_finite_touch_nothing(void **state)
{
    (void)state;
    struct volume_fixture f;
    const float bad[3][3] = {{NAN, 1, 1}, {1, INFINITY, 1}, {1e30F, -1e30F, 3}};
    struct umb_column_answer got[3];
    struct umb_column_answers answers = {.columns = got};
    struct umb_points points = {.positions = bad, .count = 3};
    volume_fixture_open(&f, fixture_hills, 6, 1, 0);
    umb_volume_columns(&f.volume, &points, 0, 3, &answers);
    assert_int_equal(got[0].outside + got[1].outside + got[2].outside, 3);
    volume_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(world_boxes_count_the_voxels_whose_centres_lie_inside),
        cmocka_unit_test(boxes_side_by_side_share_no_voxel_and_leave_none_out),
        cmocka_unit_test(voxel_boxes_count_exactly_and_are_clipped_to_the_frustum),
        cmocka_unit_test(boxes_that_are_no_boxes_are_named_and_do_no_harm),
        cmocka_unit_test(a_box_is_given_up_when_it_takes_too_many_steps),
        cmocka_unit_test(a_box_without_a_watch_has_a_limit),
        cmocka_unit_test(corners_make_boxes_in_either_order),
        cmocka_unit_test(columns_end_at_their_first_shadowed_voxel),
        cmocka_unit_test(closed_frusta_refuse_columns_and_open_ones_do_not),
        cmocka_unit_test(columns_of_points_that_are_not_finite_touch_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
