/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Assets baked under the static rule: their receiver mask is stored, checked and read as the format
 * page says. Points elsewhere are counted as undefined, and queries that need other voxels are
 * refused.
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

#include "format/receiver_mask.h"
#include "make_asset.h"
#include "oracle_reader.h"
#include "seal_asset.h"
#include "transmittance_fixture.h"
#include "umbrage/query.h"
#include "umbrage/volume.h"

#define LOG2_SIZE 7U
#define FRUSTA    2U
#define POINTS    5000

static const double origin[3] = {100, 200, 300};

static int slanted(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    return z < 20 + (x + 2 * y) / 4 + 10 * frustum;
}

static const struct voxels slope = {slanted, NULL, LOG2_SIZE, FRUSTA};

/* Packs the voxels with random cells. */
static struct bytes pack(uint64_t *cells, enum umb_light_kind kind, enum umb_status wanted)
{
    struct umb__octree octree;
    struct umb__content content;
    struct bytes packed = {0};
    uint8_t id[UMB_ID_BYTES];
    uint64_t random = 91;
    make_octree(&slope, &octree);
    make_content(&slope, 0.5, origin, &content);
    for (size_t i = 0; i < FRUSTA * UMB__RECEIVER_MASK_WORDS; i++) {
        cells[i] = next_random(&random);
    }
    content.receiver_mask_cells = cells;
    content.lights[1].kind = kind;
    struct umb_sink sink = bytes_sink(&packed);
    assert_int_equal(umb__pack_write(&content, &octree, &tf_digest, &sink, id, NULL), wanted);
    content.lights[1].kind = UMB_LIGHT_DIRECTIONAL;
    umb__octree_finish(&octree);
    return packed;
}

static struct umb_asset *open_asset(const struct bytes *file)
{
    struct umb_asset *asset;
    assert_int_equal(umb_asset_open_bytes(file->data, file->size, NULL, &asset, NULL), UMB_OK);
    return asset;
}

/* Decides by hand whether a point is undefined: by the cell of its voxel, read as the format page
 * describes. */
static int is_undefined(const struct oracle *oracle, uint32_t light, const double voxel[3])
{
    const double size = 1 << LOG2_SIZE;
    for (int k = 0; k < 3; k++) {
        if (!(voxel[k] >= 0) || (k < 2 && voxel[k] >= size)) {
            return 0;
        }
    }
    const double z = voxel[2] < size ? voxel[2] : size - 1;
    return !oracle_receiver_mask(oracle, light, (uint32_t)voxel[0], (uint32_t)voxel[1],
                                 (uint32_t)z);
}

static void check_points(const struct umb_asset *asset, const struct oracle *oracle, uint32_t light)
{
    static double positions[POINTS][3];
    static float answers[POINTS];
    uint64_t random = 17, undefined = 0;
    struct umb_query query;
    const struct umb_query_settings settings = {
        .light = light, .taps = 9, .bias_mode = UMB_BIAS_NONE};
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS, .origin = {0}};
    for (size_t i = 0; i < POINTS; i++) {
        double voxel[3];
        for (int k = 0; k < 3; k++) {
            positions[i][k] = origin[k] + (random_unit(&random) * 1.2 - 0.1) * 64;
            voxel[k] = (positions[i][k] - origin[k]) / 0.5;
        }
        const int wanted = is_undefined(oracle, light, voxel);
        struct umb_explanation explanation;
        umb_query_explain(&query, &points, i, &explanation);
        assert_int_equal(explanation.undefined, wanted);
        undefined += (uint64_t)wanted;
    }
    struct umb_answers out = {.values = answers};
    umb_query_run(&query, &points, 0, 1000, &out);
    umb_query_run(&query, &points, 1000, POINTS - 1000, &out);
    assert_int_equal(out.stats.undefined, undefined);
    assert_true(undefined > 1000 && undefined < POINTS - 1000);
    struct umb_query_stats sum = out.stats;
    umb_query_stats_add(&sum, &out.stats);
    assert_int_equal(sum.undefined, 2 * undefined);
}

static void points_elsewhere_are_counted_in_both_forms(void **state)
{
    (void)state;
    static uint64_t cells[FRUSTA * UMB__RECEIVER_MASK_WORDS];
    struct bytes packed = pack(cells, UMB_LIGHT_DIRECTIONAL, UMB_OK);
    struct bytes mapped = make_mapped(&packed);
    const struct bytes *const files[2] = {&packed, &mapped};
    for (int i = 0; i < 2; i++) {
        struct oracle oracle;
        char error[ORACLE_ERROR_SIZE];
        struct umb_asset *asset = open_asset(files[i]);
        struct umb_asset_info info;
        umb_asset_get_info(asset, &info);
        assert_int_equal(info.receiver_mask_bytes, sizeof cells);
        if (!oracle_open(&oracle, files[i]->data, files[i]->size, error)) {
            fail_msg("%s", error);
        }
        for (uint32_t light = 0; light < FRUSTA; light++) {
            check_points(asset, &oracle, light);
        }
        oracle_close(&oracle);
        umb_asset_close(asset);
    }
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void what_an_asset_gives_back_packs_to_the_same_bytes(void **state)
{
    (void)state;
    static uint64_t cells[FRUSTA * UMB__RECEIVER_MASK_WORDS];
    struct bytes packed = pack(cells, UMB_LIGHT_DIRECTIONAL, UMB_OK), again = {0};
    struct umb_asset *asset = open_asset(&packed);
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    assert_int_equal(umb__asset_export(asset, &octree, &content, NULL), UMB_OK);
    struct umb_sink sink = bytes_sink(&again);
    assert_int_equal(umb__pack_write(&content, &octree, &tf_digest, &sink, id, NULL), UMB_OK);
    assert_memory_equal(packed.data + UMB__HEAD_ID, id, sizeof id);
    umb__octree_finish(&octree);
    umb_asset_close(asset);
    bytes_finish(&packed);
    bytes_finish(&again);
}

static void questions_off_the_surfaces_are_refused(void **state)
{
    (void)state;
    static uint64_t cells[FRUSTA * UMB__RECEIVER_MASK_WORDS];
    struct bytes packed = pack(cells, UMB_LIGHT_DIRECTIONAL, UMB_OK);
    struct umb_asset *asset = open_asset(&packed);
    static const struct umb_query_settings refused[] = {
        {.level = 3},
        {.filter = UMB_FILTER_FOOTPRINT, .footprint_m = 1},
        {.filter = UMB_FILTER_PENUMBRA, .light_extent = 0.01},
    };
    struct umb_query query;
    struct umb_volume volume;
    for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
        assert_int_equal(umb_query_prepare(asset, &refused[i], &query, NULL), UMB_E_UNSUPPORTED);
    }
    const struct umb_query_settings tent = {.taps = 5, .filter = UMB_FILTER_TENT};
    assert_int_equal(umb_query_prepare(asset, &tent, &query, NULL), UMB_OK);
    struct umb_error error; /* maps and fog ask, too */
    assert_int_equal(umb_volume_prepare(asset, 0, &volume, &error), UMB_E_UNSUPPORTED);
    assert_non_null(strstr(error.message, "only points can be asked for"));
    umb_asset_close(asset);
    bytes_finish(&packed);
}

/* Where entry NEAR begins in a packed file. */
static size_t find_entry(const struct bytes *file)
{
    for (size_t at = UMB__HEAD_SIZE; at + 16 < file->size;) {
        if (memcmp(file->data + at, "NEAR", 4) == 0) {
            return at;
        }
        at += 16 + (size_t)((umb__load64(file->data + at + 8) + 7) & ~(uint64_t)7);
    }
    fail_msg("no entry NEAR");
    return 0;
}

static void damaged_entries_are_refused_by_reader_and_oracle(void **state)
{
    (void)state;
    static uint64_t cells[FRUSTA * UMB__RECEIVER_MASK_WORDS];
    struct bytes packed = pack(cells, UMB_LIGHT_DIRECTIONAL, UMB_OK);
    const size_t at = find_entry(&packed);
    assert_int_equal(umb__load32(packed.data + at + 4), 1); /* must be understood */
    for (int damage = 0; damage < 2; damage++) {
        struct oracle oracle;
        struct umb_asset *asset;
        char error[ORACLE_ERROR_SIZE];
        if (damage == 0) { /* half of it: an unknown entry that may be skipped follows */
            umb__store64(packed.data + at + 8, sizeof cells / 2 - 16);
            memset(packed.data + at + sizeof cells / 2, 0, 16);
            memcpy(packed.data + at + sizeof cells / 2, "xxxx", 4);
            umb__store64(packed.data + at + sizeof cells / 2 + 8, sizeof cells / 2);
        } else { /* none of it */
            umb__store64(packed.data + at + 8, 0);
            memset(packed.data + at + 16, 0, 16);
            memcpy(packed.data + at + 16, "xxxx", 4);
            umb__store64(packed.data + at + 24, sizeof cells - 16);
        }
        seal_asset(&packed, true);
        assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, NULL, &asset, NULL),
                         UMB_E_CORRUPT);
        assert_int_equal(oracle_open(&oracle, packed.data, packed.size, error), 0);
        assert_memory_equal(error, "NEAR", 4);
        oracle_close(&oracle);
    }
    bytes_finish(&packed);
    struct bytes none = pack(cells, UMB_LIGHT_SPOT, UMB_E_ARGUMENT);
    bytes_finish(&none);
}

/* 64 MiB, whole: cells of 2048 frusta are as much, so that with the lights they are more. */
static void a_block_longer_than_readers_take_is_not_written(void **state)
{
    (void)state;
    enum {
        LIGHTS = 2048
    };
    struct umb__octree octree;
    struct umb__content content;
    struct bytes packed = {0};
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    make_octree(&slope, &octree);
    make_content(&slope, 0.5, origin, &content);
    struct umb__octree many = octree;
    struct umb_light_info *lights = calloc(LIGHTS, sizeof *lights);
    struct umb_frustum_info *frusta = calloc(LIGHTS, sizeof *frusta);
    many.roots = calloc(LIGHTS, sizeof *many.roots);
    content.receiver_mask_cells =
        calloc((size_t)LIGHTS * UMB__RECEIVER_MASK_WORDS, sizeof *content.receiver_mask_cells);
    assert_true(lights && frusta && many.roots && content.receiver_mask_cells);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        lights[i] = content.lights[0];
        lights[i].first_frustum = i;
        (void)snprintf(lights[i].name, sizeof lights[i].name, "sun%u", i);
        frusta[i] = content.frusta[0];
        frusta[i].light = i;
        many.roots[i] = octree.roots[0];
    }
    content.lights = lights;
    content.frusta = frusta;
    content.light_count = content.frustum_count = many.root_count = LIGHTS;
    struct umb_sink sink = bytes_sink(&packed);
    assert_int_equal(umb__pack_write(&content, &many, &tf_digest, &sink, id, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "canonical block"));
    assert_true(packed.size == 0);
    bytes_finish(&packed);
    free(content.receiver_mask_cells);
    free(many.roots);
    free(frusta);
    free(lights);
    umb__octree_finish(&octree);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_elsewhere_are_counted_in_both_forms),
        cmocka_unit_test(what_an_asset_gives_back_packs_to_the_same_bytes),
        cmocka_unit_test(questions_off_the_surfaces_are_refused),
        cmocka_unit_test(damaged_entries_are_refused_by_reader_and_oracle),
        cmocka_unit_test(a_block_longer_than_readers_take_is_not_written),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
