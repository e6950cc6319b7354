/* SPDX-License-Identifier: Apache-2.0 */
/* Sample points: near the boundaries of voxels that the test made, the same bits each time. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "base/vec.h"
#include "format/receiver_mask.h"
#include "lamp_fixture.h"
#include "umbrage/sample.h"
#include "volume_fixture.h"

enum {
    POINTS = 3000
};

static double positions[3 * UMB_SAMPLE_MAX], again[3 * UMB_SAMPLE_MAX];

static struct umb_sample take(const struct umb_asset *asset, struct umb_sample_settings settings)
{
    struct umb_sample sample;
    struct umb_error error = {0};
    if (umb_asset_sample(asset, &settings, positions, &sample, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return sample;
}

/* The voxel of a point, by the transform alone. */
static void voxel_at(const struct volume_fixture *f, const double p[3], int64_t voxel[3])
{
    double v[3];
    fixture_voxel_of(f, p, v);
    for (unsigned k = 0; k < 3; k++) {
        voxel[k] = (int64_t)floor(v[k]);
        assert_in_range(voxel[k], 0, f->size - 1);
    }
}

/* Returns a bit for each axis on which a neighbour inside the frustum has the other state. */
static unsigned boundaries_at(const struct volume_fixture *f, const int64_t voxel[3])
{
    const int own = fixture_voxel(f, voxel[0], voxel[1], voxel[2]);
    unsigned axes = 0;
    for (unsigned k = 0; k < 3; k++) {
        for (int side = -1; side <= 1; side += 2) {
            int64_t other[3] = {voxel[0], voxel[1], voxel[2]};
            other[k] += side;
            if (other[k] >= 0 && other[k] < f->size &&
                fixture_voxel(f, other[0], other[1], other[2]) != own) {
                axes |= 1U << k;
            }
        }
    }
    return axes;
}

/* Queries a voxel away on each axis: the answers must not all be equal. */
static int is_mixed_around(const struct volume_fixture *f, const double p[3])
{
    double around[7][3], voxel[3];
    uint8_t values[7];
    struct umb_query_settings settings = {.bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    struct umb_query query;
    struct umb_points points = {.positions = around, .format = UMB_POINT_F64, .count = 7};
    struct umb_answers answers = {.values = values};
    memcpy(points.origin, fixture_origin, sizeof fixture_origin);
    fixture_voxel_of(f, p, voxel);
    for (unsigned i = 0; i < 7; i++) {
        double v[3] = {voxel[0], voxel[1], voxel[2]};
        if (i > 0) {
            v[(i - 1) / 2] += i % 2 ? 1 : -1;
        }
        fixture_world(f, v, around[i]);
    }
    assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, &points, 0, 7, &answers);
    uint8_t any = 0, all = 255;
    for (unsigned i = 0; i < 7; i++) {
        any |= values[i];
        all &= values[i];
    }
    return any != all;
}

static void check_points(const struct volume_fixture *f, const struct umb_sample *sample)
{
    size_t lit = 0, across = 0, aside = 0;
    for (size_t i = 0; i < sample->count; i++) {
        int64_t voxel[3];
        voxel_at(f, positions + 3 * i, voxel);
        const unsigned axes = boundaries_at(f, voxel);
        assert_int_not_equal(axes, 0);
        assert_true(is_mixed_around(f, positions + 3 * i));
        lit += (size_t)fixture_voxel(f, voxel[0], voxel[1], voxel[2]);
        across += (axes & 4) != 0;
        aside += (axes & 3) != 0;
    }
    assert_in_range(lit, sample->count * 2 / 5, sample->count * 3 / 5);
    assert_in_range(across, sample->count / 4, sample->count);
    assert_in_range(aside, sample->count / 4, sample->count);
}

static void every_point_lies_in_a_voxel_with_a_neighbour_of_the_other_state(void **state)
{
    static const voxel_fn scenes[2] = {fixture_noise, fixture_hills};
    (void)state;
    for (unsigned i = 0; i < 8; i++) {
        struct volume_fixture f;
        volume_fixture_open(&f, scenes[i % 2], 6 + i / 4, i / 2 % 2, 0);
        const struct umb_sample sample =
            take(f.asset, (struct umb_sample_settings){.count = POINTS, .seed = i});
        assert_int_equal(sample.count, POINTS);
        assert_string_equal(sample.note, "");
        assert_memory_equal(sample.origin, fixture_origin, sizeof fixture_origin);
        check_points(&f, &sample);
        volume_fixture_close(&f);
    }
}

/* Blocks on a plane. */
static int blocks(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 30 + fixture_hash(x / 21, y / 21, 7) % 60;
}

/* The edges of shadows are moved to the surface: below each lit voxel lies a shadowed one. */
static void points_of_an_open_scene_lie_on_its_surface(void **state)
{
    (void)state;
    struct volume_fixture f;
    size_t edges = 0;
    volume_fixture_open(&f, blocks, 7, 1, 0);
    const struct umb_sample sample =
        take(f.asset, (struct umb_sample_settings){.count = POINTS, .seed = 1});
    for (size_t i = 0; i < sample.count; i++) {
        int64_t v[3];
        voxel_at(&f, positions + 3 * i, v);
        const int lit = fixture_voxel(&f, v[0], v[1], v[2]);
        edges += (boundaries_at(&f, v) & 3) != 0;
        if (lit) {
            assert_int_equal(fixture_voxel(&f, v[0], v[1], v[2] + 1), 0);
        }
    }
    assert_in_range(edges, POINTS / 3, POINTS * 3 / 4);
    volume_fixture_close(&f);
}

/* The samples must be the same on every machine; these bits were recorded once. */
static void the_first_points_are_those_of_the_record(void **state)
{
    static const double golden[2][3] = {
        {-0x1.e05e4b05e5b8bp+0, -0x1.e60ea35411a08p+3, 0x1.c6d9a3432f163p+3},
        {0x1.274bd56463418p+1, 0x1.fc3498878d6b8p-1, 0x1.5e887b9f64c5p+2}};
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, 7, 1, 0);
    (void)take(f.asset, (struct umb_sample_settings){.count = 100, .seed = 42});
    for (size_t i = 0; i < 2; i++) {
        for (size_t k = 0; k < 3; k++) {
            if (positions[3 * i + k] != golden[i][k]) {
                fail_msg("point %zu, axis %zu: %a", i, k, positions[3 * i + k]);
            }
        }
    }
    volume_fixture_close(&f);
}

static void seed_and_count_and_nothing_else_decide_the_points(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_asset *other;
    const struct umb_sample_settings settings = {.count = POINTS, .seed = 5, .scattered = 0.25};
    volume_fixture_open(&f, fixture_noise, 7, 1, 0);
    (void)take(f.asset, settings);
    memcpy(again, positions, sizeof again);
    assert_int_equal(umb_asset_open_bytes(f.file.data, f.file.size, NULL, &other, NULL), UMB_OK);
    (void)take(other, settings);
    assert_memory_equal(again, positions, 3 * POINTS * sizeof *positions);
    umb_asset_close(other);
    for (unsigned i = 0; i < 2; i++) {
        struct umb_sample_settings changed = settings;
        changed.seed += i == 0;
        changed.count -= i == 1;
        (void)take(f.asset, changed);
        assert_memory_not_equal(again, positions, 30 * sizeof *positions);
    }
    volume_fixture_close(&f);
}

static void a_share_of_the_points_may_lie_anywhere_in_the_bounds(void **state)
{
    (void)state;
    struct volume_fixture f;
    struct umb_asset_info info;
    volume_fixture_open(&f, fixture_hills, 6, 0, 0);
    umb_asset_get_info(f.asset, &info);
    const struct umb_sample sample =
        take(f.asset, (struct umb_sample_settings){.count = 1000, .seed = 3, .scattered = 1});
    assert_int_equal(sample.count, 1000);
    size_t low = 0;
    for (size_t i = 0; i < 3000; i++) {
        const double at = positions[i] + sample.origin[i % 3];
        assert_true(at >= info.bounds.min[i % 3] && at <= info.bounds.max[i % 3]);
        low += at < (info.bounds.min[i % 3] + info.bounds.max[i % 3]) / 2;
    }
    assert_in_range(low, 1350, 1650);
    volume_fixture_close(&f);
}

static int all_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return x < 1000 || y > z;
}

/* Lit and shadowed voxels meet only at the faces of uniform cells. */
static int half_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return x < 64 || y >= 64 || z < 32;
}

static void a_light_without_boundaries_gives_no_point_and_says_so(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, all_lit, 6, 1, 0);
    struct umb_sample sample = take(f.asset, (struct umb_sample_settings){.count = 10});
    assert_int_equal(sample.count, 0);
    assert_non_null(strstr(sample.note, "light 0 has no shadow boundary"));
    sample = take(f.asset, (struct umb_sample_settings){.count = 10, .scattered = 0.5});
    assert_int_equal(sample.count, 5);
    assert_non_null(strstr(sample.note, "no shadow boundary"));
    volume_fixture_close(&f);
}

static void boundaries_between_uniform_cells_are_found(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, half_lit, 7, 1, 0);
    const struct umb_sample sample = take(f.asset, (struct umb_sample_settings){.count = POINTS});
    assert_int_equal(sample.count, POINTS);
    for (size_t i = 0; i < sample.count; i++) {
        int64_t voxel[3];
        voxel_at(&f, positions + 3 * i, voxel);
        assert_int_not_equal(boundaries_at(&f, voxel), 0);
    }
    volume_fixture_close(&f);
}

/* Packs hills under the static rule. */
static struct umb_asset *static_asset(const uint64_t *cells)
{
    const struct voxels hills = {fixture_hills, NULL, 7, 1};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_asset *asset;
    struct bytes file = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&hills, &octree);
    make_content(&hills, 0.25, fixture_origin, &content);
    content.receiver_mask_cells = (uint64_t *)(uintptr_t)cells;
    struct umb_sink sink = bytes_sink(&file);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    umb__octree_finish(&octree);
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    bytes_finish(&file);
    return asset;
}

static void points_of_static_assets_are_defined(void **state)
{
    static uint64_t cells[UMB__RECEIVER_MASK_WORDS];
    static float values[POINTS];
    const struct umb_query_settings settings = {.bias_mode = UMB_BIAS_NONE};
    struct umb_answers answers = {.values = values};
    struct umb_query query;
    (void)state;
    for (size_t i = 0; i < UMB__RECEIVER_MASK_WORDS; i++) {
        cells[i] = fixture_hash(i, 1, 2) & fixture_hash(i, 3, 4);
    }
    struct umb_asset *asset = static_asset(cells);
    struct umb_sample sample = take(asset, (struct umb_sample_settings){.count = POINTS});
    assert_in_range(sample.count, POINTS * 9 / 10, POINTS);
    assert_int_equal(sample.count < POINTS, strstr(sample.note, "were not found") != NULL);
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = sample.count};
    memcpy(points.origin, sample.origin, sizeof points.origin);
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, &points, 0, points.count, &answers);
    assert_int_equal(answers.stats.undefined, 0);
    umb_asset_close(asset);
    memset(cells, 0, sizeof cells);
    asset = static_asset(cells);
    sample = take(asset, (struct umb_sample_settings){.count = 7});
    assert_int_equal(sample.count, 0);
    assert_non_null(
        strstr(sample.note, "light 0 has no shadow boundary in a cell that holds receivers"));
    umb_asset_close(asset);
}

/* Checks faces and voxels by the fixture's own definition of a lamp. */
static void points_of_a_lamp_lie_at_boundaries_of_the_face_that_answers(void **state)
{
    (void)state;
    uint64_t seed = 8;
    unsigned faces = 0;
    for (int i = 0; i < 4; i++) {
        struct plane plane = {.normal = {0.6, 0, 0.8}, .distance = 2 + 3 * random_unit(&seed)};
        plane.normal[0] = i % 2 ? -0.6 : 0.6;
        struct umb_asset *asset = make_asset(&plane);
        const struct umb_sample sample =
            take(asset, (struct umb_sample_settings){.count = POINTS, .seed = (uint64_t)i});
        assert_in_range(sample.count, POINTS * 19 / 20, POINTS);
        for (size_t k = 0; k < sample.count; k++) {
            double along[3], axes[3][3];
            uint32_t face = 0;
            for (int axis = 0; axis < 3; axis++) {
                along[axis] = positions[3 * k + (size_t)axis] + origin[axis] - eye[axis];
            }
            for (uint32_t axis = 1; axis < 3; axis++) {
                face = fabs(along[axis]) > fabs(along[face]) ? axis : face;
            }
            const double w = fabs(along[face]);
            face = 2 * face + (along[face] < 0);
            face_axes(face, axes);
            const double u = umb__dot(axes[0], along) / (w * tangent);
            const double v = umb__dot(axes[1], along) / (w * tangent);
            const uint32_t voxel[3] = {(uint32_t)((u + 1) / 2 * SIZE),
                                       (uint32_t)((v + 1) / 2 * SIZE),
                                       (uint32_t)((w - near_w) / (far_w - near_w) * SIZE)};
            int differs = 0;
            for (int n = 0; n < 6; n++) {
                uint32_t other[3] = {voxel[0], voxel[1], voxel[2]};
                other[n / 2] += n % 2 ? 1U : UINT32_MAX;
                differs |= other[n / 2] < SIZE &&
                           before_plane(&plane, face, other[0], other[1], other[2]) !=
                               before_plane(&plane, face, voxel[0], voxel[1], voxel[2]);
            }
            assert_true(differs);
            faces |= 1U << face;
        }
        umb_asset_close(asset);
    }
    assert_true(__builtin_popcount(faces) >= 3);
}

static int is_late(void *user)
{
    return ++*(int *)user > 3;
}

static void bad_settings_are_named_and_a_sample_can_be_cancelled(void **state)
{
    static const struct {
        struct umb_sample_settings settings;
        enum umb_status status;
        const char *words;
    } rows[] = {
        {{.count = 0}, UMB_E_ARGUMENT, "count: 0, must be 1 to 65536"},
        {{.count = UMB_SAMPLE_MAX + 1}, UMB_E_ARGUMENT, "count: 65537, must be 1 to 65536"},
        {{.count = 1, .scattered = 1.5}, UMB_E_ARGUMENT, "scattered: 1.5, must be 0 to 1"},
        {{.count = 1, .scattered = -0.5}, UMB_E_ARGUMENT, "scattered: -0.5, must be 0 to 1"},
        {{.count = 1, .scattered = NAN}, UMB_E_ARGUMENT, "scattered: nan"},
        {{.count = 1, .light = 9}, UMB_E_NOT_FOUND, "light: 9"},
        {{.count = 1, .reserved = {0, 1}}, UMB_E_ARGUMENT, "settings.reserved[1]"},
    };
    (void)state;
    struct volume_fixture f;
    struct umb_sample sample;
    int calls = 0;
    volume_fixture_open(&f, fixture_hills, 6, 0, 0);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct umb_error error = {0};
        assert_int_equal(umb_asset_sample(f.asset, &rows[i].settings, positions, &sample, &error),
                         rows[i].status);
        assert_non_null(strstr(error.message, rows[i].words));
        assert_int_equal(sample.count, 0);
    }
    const struct umb_sample_settings settings = {
        .count = UMB_SAMPLE_MAX, .cancelled = is_late, .cancel_user = &calls};
    assert_int_equal(umb_asset_sample(f.asset, &settings, positions, &sample, NULL),
                     UMB_E_CANCELLED);
    (void)take(f.asset, (struct umb_sample_settings){.count = 1});
    (void)take(f.asset, (struct umb_sample_settings){.count = UMB_SAMPLE_MAX});
    volume_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_point_lies_in_a_voxel_with_a_neighbour_of_the_other_state),
        cmocka_unit_test(points_of_an_open_scene_lie_on_its_surface),
        cmocka_unit_test(the_first_points_are_those_of_the_record),
        cmocka_unit_test(seed_and_count_and_nothing_else_decide_the_points),
        cmocka_unit_test(a_share_of_the_points_may_lie_anywhere_in_the_bounds),
        cmocka_unit_test(a_light_without_boundaries_gives_no_point_and_says_so),
        cmocka_unit_test(boundaries_between_uniform_cells_are_found),
        cmocka_unit_test(points_of_static_assets_are_defined),
        cmocka_unit_test(points_of_a_lamp_lie_at_boundaries_of_the_face_that_answers),
        cmocka_unit_test(bad_settings_are_named_and_a_sample_can_be_cancelled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
