/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The shaders' walk, compiled as C, gives the answers of the core: at given voxels every count, on
 * whole and on partial assets, and with the shaders' own placement every answer whose voxel is not
 * nearer to a border than the stated bound. UMBRAGE_CASES sets the number of points (make
 * gpu-walk).
 */
#include "partial_fixture.h"

#include "query/perspective.h"
#include "umbrage/gpu.h"
#include "umbrage.cuh"

enum {
    POINTS = 2000,
    TENT = 100 /* In `filters`: a tent of so many texels less this */
};

static const int filters[] = {1, 3, 9, 17, TENT + 1, TENT + 3, TENT + 5, TENT + 9, TENT + 17, -3};

/* The array as a program keeps it on its GPU. */
struct array {
    struct umb_gpu_layout layout;
    uint4 *entries;
    uint64_t copied; /* Entries that were copied */
};

static void array_make(struct array *array, const struct umb_asset *asset, uint32_t spare)
{
    struct umb_error error = {0};
    free(array->entries);
    if (umb_gpu_layout_make(asset, spare, &array->layout, &error) != UMB_OK) {
        fail_msg("layout: %s", error.message);
    }
    array->entries = calloc(array->layout.entries, sizeof *array->entries);
}

/* Copies what changed. Entries come by a block of their own, as to a GPU. */
static void array_update(struct array *array, struct umb_partial *p)
{
    const struct umb_asset *asset = umb_partial_lower(p);
    struct umb_gpu_range ranges[3];
    if (array->entries == NULL || !umb_gpu_layout_fits(asset, &array->layout)) {
        array_make(array, asset, 400);
        umb_gpu_forget_changes(p);
        umb_gpu_write(asset, p, &array->layout, 0, array->layout.entries, &array->entries[0].x);
        array->copied += array->layout.entries;
        return;
    }
    for (size_t count = 3; count > 0;) {
        count = umb_gpu_changes(p, &array->layout, ranges, 3);
        for (size_t i = 0; i < count; i++) {
            assert_true(ranges[i].first + ranges[i].count <= array->layout.entries);
            uint4 *block = malloc(ranges[i].count * sizeof *block);
            umb_gpu_write(asset, p, &array->layout, ranges[i].first, ranges[i].count, &block->x);
            memcpy(array->entries + ranges[i].first, block, ranges[i].count * sizeof *block);
            array->copied += ranges[i].count;
            free(block);
        }
    }
}

/* Returns the settings of a filter, and the count of an all lit window. */
static struct umb_query_settings settings_of(int filter, uint32_t light, uint32_t *total)
{
    struct umb_query_settings s = {.light = light, .bias_mode = UMB_BIAS_NONE};
    const uint32_t taps = filter < 0 ? 1 : (uint32_t)filter % TENT, middle = (taps + 1) / 2;
    s.level = filter < 0 ? (uint32_t)-filter : 0;
    s.taps = filter < 0 ? 0 : taps;
    s.filter = filter > TENT ? UMB_FILTER_TENT : UMB_FILTER_BOX;
    *total = filter < 0 ? 2 : filter > TENT ? middle * middle * middle * middle : taps * taps;
    return s;
}

static uint2 count_at(const struct array *array, uint32_t frustum, int filter, int3 voxel)
{
    if (filter < 0) {
        return umbrage_count_cell(array->entries, frustum, voxel, (uint32_t)-filter);
    }
    return filter > TENT ? umbrage_count_tent(array->entries, frustum, voxel, filter - TENT)
                         : umbrage_count_box(array->entries, frustum, voxel, filter);
}

/* Random voxels in and around a frustum, and points in their middles. */
static void random_voxels(const struct umb_frustum_info *frustum, size_t count, uint64_t *seed,
                          int3 *voxels, double *points)
{
    const double size = (double)(1U << frustum->log2_size);
    for (size_t i = 0; i < count; i++) {
        int32_t voxel[3];
        for (unsigned k = 0; k < 3; k++) {
            voxel[k] = (int32_t)floor(size * (random_unit(seed) * 1.4 - 0.2));
        }
        voxels[i] = make_int3(voxel[0], voxel[1], voxel[2]);
        for (unsigned axis = 0; axis < 3; axis++) {
            points[3 * i + axis] = 0;
            for (unsigned k = 0; k < 3; k++) {
                points[3 * i + axis] +=
                    (voxel[k] + 0.5 - frustum->world_to_voxel[k][3]) * frustum->voxel_step[k][axis];
            }
        }
    }
}

/* Compares the counts at given voxels with the bounds of the core. Returns how many are exact. */
static size_t compare_counts(struct partial_fixture *f, const struct array *array, size_t count,
                             uint64_t seed)
{
    int3 *voxels = calloc(count, sizeof *voxels);
    size_t exact = 0;
    for (size_t i = 0; i < sizeof filters / sizeof filters[0]; i++) {
        struct umb_error error = {0};
        struct umb_frustum_info frustum;
        uint32_t total;
        const struct umb_query_settings s = settings_of(filters[i], (uint32_t)i % 2, &total);
        assert_int_equal(umb_asset_get_frustum(f->whole, s.light, &frustum), UMB_OK);
        random_voxels(&frustum, count, &seed, voxels, f->points);
        const struct umb_points points = {
            .positions = f->points,
            .format = UMB_POINT_F64,
            .origin = {fixture_origin[0], fixture_origin[1], fixture_origin[2]},
            .count = count};
        struct umb_partial_answers answers = {.values = f->values, .low = f->low, .high = f->high};
        if (umb_partial_query(f->partial, &s, &points, 0, &answers, &error) != UMB_OK) {
            fail_msg("query: %s", error.message);
        }
        for (size_t k = 0; k < count; k++) {
            const uint2 got = count_at(array, s.light, filters[i], voxels[k]);
            const float low = (float)got.x / (float)total, high = (float)got.y / (float)total;
            if (memcmp(&low, &f->low[k], 4) != 0 || memcmp(&high, &f->high[k], 4) != 0) {
                fail_msg("filter %d, voxel %d %d %d: %g to %g, not %g to %g", filters[i],
                         voxels[k].x, voxels[k].y, voxels[k].z, (double)low, (double)high,
                         (double)f->low[k], (double)f->high[k]);
            }
            exact += got.x == got.y;
        }
    }
    free(voxels);
    return exact;
}

static void test_pages_come_and_go(void **state)
{
    struct partial_fixture f;
    struct array array = {0};
    const size_t points = (size_t)case_count(POINTS);
    uint64_t seed = round_seed(23), exact = 0;
    (void)state;
    partial_fixture_open(&f, 0);
    for (uint32_t round = 0; round < 8; round++) {
        for (uint32_t page = 0; page < f.page_count; page++) {
            const bool is_held = umb_partial_has(f.partial, page) != 0;
            const bool wanted = round == 7 || random_unit(&seed) < 0.15 * round;
            if (wanted && !is_held) {
                partial_add(&f, page);
            } else if (!wanted && is_held) {
                umb_partial_drop(f.partial, page);
            }
        }
        partial_build(&f);
        array_update(&array, f.partial);
        exact = compare_counts(&f, &array, points / 8 + 1, seed + round);
    }
    assert_int_equal(exact, (points / 8 + 1) * sizeof filters / sizeof filters[0]);
    free(array.entries);
    partial_fixture_close(&f);
}

/* A page costs its own bytes, and those of the nodes that refer to it. */
static void test_page_costs_its_bytes(void **state)
{
    struct partial_fixture f;
    struct array array = {0};
    (void)state;
    partial_fixture_open(&f, 0);
    for (uint32_t page = 0; page < f.page_count; page++) {
        partial_add(&f, page);
    }
    partial_build(&f);
    array_update(&array, f.partial);
    assert_int_equal(array.copied, array.layout.entries);
    array_update(&array, f.partial);
    assert_int_equal(array.copied, array.layout.entries); /* Nothing changed */
    const uint32_t last = f.page_count - 1;
    struct umb_partial_page page;
    assert_int_equal(umb_partial_get_page(f.partial, last, &page), UMB_OK);
    umb_partial_drop(f.partial, last);
    partial_build(&f);
    array_update(&array, f.partial);
    partial_add(&f, last);
    partial_build(&f);
    array.copied = 0;
    array_update(&array, f.partial);
    assert_int_equal(compare_counts(&f, &array, POINTS / 8, 8),
                     POINTS / 8 * (sizeof filters / sizeof filters[0]));
    /* Each node or brick takes 64 bytes and a gap; references to it as much. */
    assert_in_range(array.copied, 1, (uint64_t)page.node_count * 4 * 20);
    free(array.entries);
    partial_fixture_close(&f);
}

/* --- placement -------------------------------------------------------------------------------- */

/* Returns the distance to the nearest whole number. */
static double to_border(double v)
{
    return fabs(v - nearbyint(v));
}

/* A view, and its points in doubles and floats. */
struct placed {
    struct umb_gpu_view view;
    struct umb_gpu_placement bytes;
    struct umb_gpu_precision precision;
    UmbragePlacement at;
    double origin[3]; /* World position of the shader's 0 */
};

static void place(struct placed *p, const struct umb_asset *asset)
{
    struct umb_error error = {0};
    if (umb_gpu_place(asset, &p->view, &p->bytes, &p->precision, &error) != UMB_OK) {
        fail_msg("place: %s", error.message);
    }
    memcpy(&p->at, &p->bytes, sizeof p->at);
    memcpy(p->origin, p->view.has_to_world ? p->view.to_world + 12 : p->view.origin,
           sizeof p->origin);
}

/* Takes a vector of the shader's space to world axes, in doubles. */
static void to_world_axes(const struct placed *p, float3 v, double out[3])
{
    const double in[3] = {(double)v.x, (double)v.y, (double)v.z};
    for (unsigned i = 0; i < 3; i++) {
        out[i] = in[i];
        if (p->view.has_to_world) {
            const double *m = p->view.to_world;
            out[i] = m[i] * in[0] + m[4 + i] * in[1] + m[8 + i] * in[2];
        }
    }
}

/* Returns true if the core's own rounding of the normal, or the change between two ways of the
 * bias, may decide otherwise than floats do. */
static bool is_at_branch(const struct umb__query *q, const double n[3])
{
    double along[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        along[axis] = umb__dot(n, q->voxel_step[axis]);
    }
    const double across = fabs(along[0]) + fabs(along[1]), depth = fabs(along[2]);
    const double need = 0.5 * UMB__BIAS_SLACK * (q->taps * across + depth);
    const double most = umb__longest_lift(q) * depth;
    return fabs(need - most) < 1e-5 * need ||
           fabs(umb__dot(n, q->direction)) < 1e-5 * umb__length(n);
}

/* Compares one placed point with the core's. Returns 1 if the voxels differ. */
static int compare_place(const struct placed *p, const struct umb__query *q, float3 position,
                         float3 normal, int taps)
{
    double world[3], n[3], v[3];
    float n_float[3];
    uint32_t frustum;
    to_world_axes(p, position, world);
    to_world_axes(p, normal, n);
    for (unsigned k = 0; k < 3; k++) {
        n_float[k] = (float)n[k];
    }
    const struct umb_points points = {.positions = world,
                                      .format = UMB_POINT_F64,
                                      .origin = {p->origin[0], p->origin[1], p->origin[2]},
                                      .normals = n_float,
                                      .count = 1};
    const bool faces = umb__look_up_at(q, &points, 0, v, &frustum);
    const int4 got = umbrage_place(p->at, position, normal, taps);
    if (umb__is_normal(umb__dot(n, n)) && is_at_branch(q, n)) {
        return 0;
    }
    assert_int_equal(got.w, faces ? 0 : 2);
    if (!faces) {
        return 0;
    }
    const int32_t voxel[3] = {got.x, got.y, got.z};
    int differ = 0;
    for (unsigned k = 0; k < 3; k++) {
        const double bound = k < 2 ? p->precision.across : p->precision.depth;
        /* Depth follows the plane from the texel's centre: another texel, another depth. */
        const bool other_texel = k == 2 && differ;
        if ((double)voxel[k] != floor(v[k])) {
            differ = 1;
            if (to_border(v[k]) > bound && !other_texel) {
                fail_msg("%d taps, axis %u: voxel %d for %.9g, bound %g", taps, k, voxel[k], v[k],
                         bound);
            }
        }
    }
    return differ;
}

static float random_float(uint64_t *seed, double reach)
{
    return (float)((random_unit(seed) * 2 - 1) * reach);
}

static void test_placement(void **state)
{
    struct partial_fixture f;
    uint64_t seed = round_seed(99);
    const int count = case_count(20 * POINTS);
    int differ = 0;
    (void)state;
    partial_fixture_open(&f, 0);
    for (int i = 0; i < 8; i++) {
        const double turn = 1.1 * i, tilt = 0.7 * i;
        struct umb_error error = {0};
        struct umb_query query;
        struct umb__query q;
        struct placed p = {.view = {.light = (uint32_t)i % 2, .has_to_world = i % 4 > 1}};
        const double m[16] = {cos(turn),
                              0,
                              -sin(turn),
                              0,
                              sin(turn) * sin(tilt),
                              cos(tilt),
                              cos(turn) * sin(tilt),
                              0,
                              sin(turn) * cos(tilt),
                              -sin(tilt),
                              cos(turn) * cos(tilt),
                              0,
                              fixture_origin[0] + 3,
                              fixture_origin[1] + 30,
                              fixture_origin[2] + 9,
                              1};
        memcpy(p.view.to_world, m, sizeof m);
        for (unsigned k = 0; k < 3; k++) {
            p.view.origin[k] = fixture_origin[k] + 5.1 * k;
        }
        const struct umb_query_settings s = {.light = p.view.light,
                                             .taps = (uint32_t)(1 + 4 * (i % 5))};
        assert_int_equal(umb_query_prepare(f.whole, &s, &query, &error), UMB_OK);
        memcpy(&q, query.opaque, sizeof q);
        place(&p, f.whole);
        assert_true(p.precision.across < 0x1p-12);
        assert_true(p.precision.depth < 0x1p-8);
        for (int k = 0; k < count / 8; k++) {
            const float3 position = make_float3(random_float(&seed, 60), random_float(&seed, 60),
                                                random_float(&seed, 60));
            const float size = k % 3 == 0 ? 0.0F : k % 3 == 1 ? 1.0F : 0.01F;
            const float3 normal =
                make_float3(size * random_float(&seed, 1), size * random_float(&seed, 1),
                            size * random_float(&seed, 1));
            differ += compare_place(&p, &q, position, normal, q.taps);
        }
    }
    print_message("%d of %d points differ at a border\n", differ, count);
    assert_in_range(differ, 0, count / 100);
    partial_fixture_close(&f);
}

/* Answers of the shaders' functions are those of the core, but for points near a border. */
static void test_answers(void **state)
{
    struct partial_fixture f;
    struct array array = {0};
    uint64_t seed = round_seed(5);
    uint32_t total;
    size_t wrong = 0;
    (void)state;
    partial_fixture_open(&f, 0);
    array_make(&array, f.whole, 0);
    umb_gpu_write(f.whole, NULL, &array.layout, 0, array.layout.entries, &array.entries->x);
    for (size_t i = 0; i < sizeof filters / sizeof filters[0]; i++) {
        const int filter = filters[i];
        struct umb_error error = {0};
        struct umb_query query;
        struct placed p = {.view = {.light = (uint32_t)i % 2}};
        memcpy(p.view.origin, fixture_origin, sizeof p.view.origin);
        place(&p, f.whole);
        struct umb_query_settings s = settings_of(filter, p.view.light, &total);
        s.bias_mode = UMB_BIAS_AUTO;
        assert_int_equal(umb_query_prepare(f.whole, &s, &query, &error), UMB_OK);
        for (size_t k = 0; k < POINTS; k++) {
            float position[3], value;
            for (unsigned axis = 0; axis < 3; axis++) {
                position[axis] = (float)f.points[3 * k + axis];
            }
            const struct umb_points points = {.positions = position,
                                              .origin = {p.origin[0], p.origin[1], p.origin[2]},
                                              .normals = f.normals + 3 * k,
                                              .count = 1};
            struct umb_answers answers = {.values = &value};
            umb_query_run(&query, &points, 0, 1, &answers);
            const float3 at = make_float3(position[0], position[1], position[2]);
            const float3 n =
                make_float3(f.normals[3 * k], f.normals[3 * k + 1], f.normals[3 * k + 2]);
            const float2 got =
                filter < 0      ? umbrage_coarse(array.entries, p.at, at, n, (uint32_t)-filter)
                : filter > TENT ? umbrage_tent(array.entries, p.at, at, n, filter - TENT)
                                : umbrage_box(array.entries, p.at, at, n, filter);
            wrong += memcmp(&got.x, &value, 4) != 0 || memcmp(&got.y, &value, 4) != 0;
        }
    }
    (void)seed;
    assert_in_range(wrong, 0, POINTS * (sizeof filters / sizeof filters[0]) / 500);
    free(array.entries);
    partial_fixture_close(&f);
}

static void expect_refused(const struct umb_asset *asset, const struct umb_gpu_view *view,
                           enum umb_status status, const char *words)
{
    struct umb_gpu_placement placement;
    struct umb_gpu_precision precision;
    struct umb_error error = {0};
    assert_int_equal(umb_gpu_place(asset, view, &placement, &precision, &error), status);
    if (strstr(error.message, words) == NULL) {
        fail_msg("\"%s\" is not in \"%s\"", words, error.message);
    }
}

static void test_refusals(void **state)
{
    struct partial_fixture f;
    (void)state;
    partial_fixture_open(&f, 0);
    expect_refused(f.whole, &(struct umb_gpu_view){.light = 9}, UMB_E_NOT_FOUND, "light: 9");
    expect_refused(f.whole, &(struct umb_gpu_view){.face = 1}, UMB_E_ARGUMENT,
                   "face: 1, the light has 1");
    expect_refused(f.whole, &(struct umb_gpu_view){.origin = {0, NAN, 0}}, UMB_E_ARGUMENT,
                   "origin[1]");
    expect_refused(f.whole, &(struct umb_gpu_view){.origin = {1e12, 0, 0}}, UMB_E_ARGUMENT,
                   "origin: the frustum reaches");
    expect_refused(f.whole, &(struct umb_gpu_view){.origin = {1.5e308, 1.5e308, 0}}, UMB_E_ARGUMENT,
                   "origin: the frustum is too far");
    expect_refused(f.whole,
                   &(struct umb_gpu_view){.has_to_world = 1, .to_world = {2, 0, 0, 0, 0, 1}},
                   UMB_E_ARGUMENT, "to_world: columns 0 and 0");
    expect_refused(f.whole, &(struct umb_gpu_view){.bias_mode = UMB_BIAS_METRES, .bias = -1},
                   UMB_E_ARGUMENT, "bias: -1");
    expect_refused(f.whole, &(struct umb_gpu_view){.reserved = {1}}, UMB_E_ARGUMENT, "reserved");
    partial_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pages_come_and_go), cmocka_unit_test(test_page_costs_its_bytes),
        cmocka_unit_test(test_placement),         cmocka_unit_test(test_answers),
        cmocka_unit_test(test_refusals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
