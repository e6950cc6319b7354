/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Maps derived from voxels: every texel, also of cascades, is compared with a march down its
 * column, and maps with the look-ups that they stand for. The KTX file is read back by the
 * specification. Failures are tested, too.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "format/asset_parts.h"
#include "umbrage/derive.h"
#include "../core/volume_fixture.h"

enum {
    LOG2_SIZE = 7,
    SIZE = 1 << LOG2_SIZE
};

static struct umb_derived *derive(const struct umb_asset *asset,
                                  const struct umb_derive_settings *settings)
{
    struct umb_derived *derived = NULL;
    struct umb_error error = {.message = ""};
    if (umb_derive(asset, settings, NULL, &derived, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return derived;
}

/* Depth of texel (x, y) of map i. */
static double texel(const struct umb_derived *derived, uint32_t i, uint32_t x, uint32_t y)
{
    struct umb_map_level level;
    float value;
    assert_int_equal(umb_map_get_level(derived->maps[i], 0, &level), UMB_OK);
    memcpy(&value, (const char *)level.texels + 4 * (x + (size_t)level.width * y), sizeof value);
    return (double)value;
}

/* First shadowed voxel of a column, SIZE if there is none or the column lies outside. */
static uint32_t march(const struct volume_fixture *f, double x, double y)
{
    uint32_t z = 0;
    if (!(x >= 0 && y >= 0 && x < SIZE && y < SIZE)) {
        return SIZE;
    }
    while (z < SIZE && fixture_voxel(f, (int64_t)x, (int64_t)y, z)) {
        z++;
    }
    return z;
}

static void every_texel_is_the_first_occluder_of_its_column(void **state)
{
    static const struct {
        uint32_t width, height;
        double rect[4];
    } cases[] = {
        {SIZE, SIZE, {0, 0, 0, 0}},          {2 * SIZE, SIZE / 2, {0, 0.25, SIZE, SIZE + 0.25}},
        {64, 32, {10.25, 3.5, 26.25, 11.5}}, {32, 32, {-30.5, 100.25, 33.5, 164.25}},
        {64, 64, {-100, -100, -50, -50}},    {1, 1, {77, 50, 78, 51}},
    };
    (void)state;
    for (int turned = 0; turned < 2; turned++) {
        struct volume_fixture f;
        volume_fixture_open(&f, turned ? fixture_noise : fixture_hills, LOG2_SIZE, turned, 0);
        for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
            struct umb_derive_settings settings = {.width = cases[c].width,
                                                   .height = cases[c].height};
            memcpy(settings.rect, cases[c].rect, sizeof settings.rect);
            struct umb_derived *derived = derive(f.asset, &settings);
            const double *rect = c < 1 ? (const double[4]){0, 0, SIZE, SIZE} : cases[c].rect;
            size_t compared = 0;
            for (uint32_t y = 0; y < settings.height; y++) {
                for (uint32_t x = 0; x < settings.width; x++) {
                    const double at_x = rect[0] + (rect[2] - rect[0]) * (x + 0.5) / settings.width;
                    const double at_y = rect[1] + (rect[3] - rect[1]) * (y + 0.5) / settings.height;
                    /* A centre on the border of voxels belongs to either, by rounding. */
                    if (at_x == floor(at_x) || at_y == floor(at_y)) {
                        continue;
                    }
                    compared++;
                    /* Distances are metres from far origins: their error is 2^-30 of the
                     * frustum. */
                    const double want = (double)march(&f, at_x, at_y) / SIZE;
                    assert_true(fabs(texel(derived, 0, x, y) - want) < 1e-6);
                }
            }
            assert_true(2 * compared > (size_t)settings.width * settings.height);
            umb_derived_destroy(derived);
        }
        volume_fixture_close(&f);
    }
}

static const struct umb_camera camera = {.eye = {1000016.5, 10, 20},
                                         .forward = {4, -3, 0},
                                         .up = {0, 0, 2},
                                         .fov_y = 0.927, /* a tangent of half of it of 0.5 */
                                         .aspect = 1.6,
                                         .near_m = 0.5,
                                         .far_m = 30};

static void cascades_hold_the_columns_of_their_texels(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    for (int fit = 0; fit < 3; fit++) {
        const struct umb_derive_settings settings = {
            .width = 64,
            .height = 64,
            .camera = &camera,
            .cascades = {.count = 3, .weight = 0.7, .fit = (enum umb_cascade_fit)fit}};
        struct umb_derived *derived = derive(f.asset, &settings);
        assert_int_equal(derived->count, 3);
        assert_true(derived->splits[0] == 0.5 && derived->splits[3] == 30);
        size_t casters = 0;
        for (uint32_t i = 0; i < 3 * 64 * 64; i++) {
            const uint32_t map = i / 4096, x = i % 64, y = i / 64 % 64;
            double begin[3], end[3];
            assert_int_equal(
                umb_map_frustum_point(&derived->frusta[map], x + 0.5, y + 0.5, 0, begin), UMB_OK);
            assert_int_equal(umb_map_frustum_point(&derived->frusta[map], x + 0.5, y + 0.5, 1, end),
                             UMB_OK);
            const double at_x = (begin[0] - fixture_origin[0]) / 0.25;
            const double at_y = (begin[1] - fixture_origin[1]) / 0.25;
            if (fabs(at_x - round(at_x)) < 1e-6 || fabs(at_y - round(at_y)) < 1e-6) {
                continue; /* on a border: rounding decides */
            }
            const uint32_t lit = march(&f, at_x, at_y);
            double want = 1;
            if (lit < SIZE) {
                want = (fixture_origin[2] + 0.25 * lit - begin[2]) / (end[2] - begin[2]);
                want = want < 0 ? 0 : want > 1 ? 1 : want;
                casters++;
            }
            assert_true(fabs(texel(derived, map, x, y) - want) < 1e-6);
        }
        assert_true(casters > 1000);
        umb_derived_destroy(derived);
    }
    volume_fixture_close(&f);
}

/* Columns of hills change once: farther than a voxel from the change, the map must answer a point
 * as the voxels do. */
static void a_derived_map_answers_as_the_voxels_do(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    const struct umb_derive_settings settings = {.width = SIZE, .height = SIZE};
    struct umb_derived *derived = derive(f.asset, &settings);
    struct umb_map_query query;
    const struct umb_map_filter filter = {.width = 1};
    assert_int_equal(umb_map_prepare(derived->maps[0], &filter, &query, NULL), UMB_OK);
    uint64_t seed = 25;
    int shadowed = 0;
    for (int i = 0; i < 20000; i++) {
        double v[3], world[3];
        float value;
        for (int k = 0; k < 3; k++) {
            v[k] = random_unit(&seed) * SIZE;
            world[k] = fixture_origin[k] + 0.25 * v[k];
        }
        const uint32_t lit = march(&f, v[0], v[1]);
        if (fabs(v[2] - lit) < 1) {
            continue;
        }
        const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = 1};
        umb_map_run(&query, &points, 0, 1, &value);
        assert_true(value == (v[2] < lit ? 1.0F : 0.0F));
        shadowed += value == 0.0F;
    }
    assert_true(shadowed > 1000);
    umb_derived_destroy(derived);
    volume_fixture_close(&f);
}

static uint32_t word(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* Reads a file by the specification and compares every level of every layer. */
static void check_ktx2(const struct umb_derived *derived, const uint8_t *bytes, size_t size)
{
    struct umb_map_level level;
    assert_true(size > 80);
    assert_memory_equal(bytes, "\xABKTX 20\xBB\r\n\x1A\n", 12);
    const uint32_t level_count = word(bytes + 40), layers = word(bytes + 32);
    assert_int_equal(layers, derived->count > 1 ? derived->count : 0);
    assert_int_equal(word(bytes + 36), 1);
    const uint32_t dfd = word(bytes + 48), dfd_size = word(bytes + 52);
    const uint32_t kvd = word(bytes + 56), kvd_size = word(bytes + 60);
    assert_int_equal(dfd, 80 + 24 * level_count);
    assert_int_equal(word(bytes + dfd), dfd_size);
    assert_int_equal(kvd, dfd + dfd_size);
    size_t end = size;
    for (uint32_t i = 0; i < level_count; i++) {
        const uint8_t *index = bytes + 80 + 24 * i;
        const size_t offset = word(index), length = word(index + 8);
        assert_int_equal(umb_map_get_level(derived->maps[0], i, &level), UMB_OK);
        const uint32_t texel_bytes = word(bytes + dfd + 20);
        assert_int_equal(level.bytes, (size_t)level.width * level.height * texel_bytes);
        assert_int_equal(offset % (texel_bytes > 4 ? texel_bytes : 4), 0);
        assert_int_equal(length, level.bytes * derived->count);
        assert_true(offset + length <= end && offset >= kvd + kvd_size); /* smallest first */
        end = offset;
        for (uint32_t k = 0; k < derived->count; k++) {
            assert_int_equal(umb_map_get_level(derived->maps[k], i, &level), UMB_OK);
            assert_memory_equal(bytes + offset + k * level.bytes, level.texels, level.bytes);
        }
    }
    assert_int_equal(umb_map_get_level(derived->maps[0], level_count, &level), UMB_E_NOT_FOUND);
    const char *first = (const char *)bytes + kvd + 4;
    assert_string_equal(first, "KTXwriter");
    const uint8_t *second = bytes + kvd + 4 + (word(bytes + kvd) + 3) / 4 * 4;
    assert_string_equal((const char *)second + 4, "umbrage.map");
    assert_int_equal((const char *)second + 4 + word(second) - ((const char *)second + 16),
                     strlen((const char *)second + 16) + 1);
    assert_non_null(strstr((const char *)second + 16, "\"world_to_map\":["));
}

static void the_ktx_file_holds_what_was_derived(void **state)
{
    static const struct {
        struct umb_map_settings map;
        uint32_t cascades, vk_format, levels;
    } cases[] = {
        {{.technique = UMB_MAP_PCF}, 0, 100, 1},
        {{.technique = UMB_MAP_PCF, .format = UMB_MAP_U16}, 3, 70, 1},
        {{.technique = UMB_MAP_VSM, .access = UMB_MAP_MIPS, .blur = 3}, 0, 103, 7},
        {{.technique = UMB_MAP_VSM, .format = UMB_MAP_U16}, 2, 78, 1},
        {{.technique = UMB_MAP_ESM}, 0, 100, 1},
        {{.technique = UMB_MAP_EVSM, .access = UMB_MAP_MIPS}, 2, 109, 7},
        {{.technique = UMB_MAP_EVSM, .format = UMB_MAP_F16}, 0, 97, 1},
        {{.technique = UMB_MAP_MSM, .format = UMB_MAP_U16, .access = UMB_MAP_MIPS}, 0, 92, 7},
    };
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb_derive_settings settings = {.width = 64, .height = 64, .map = cases[i].map};
        settings.camera = cases[i].cascades ? &camera : NULL;
        settings.cascades = (struct umb_cascade_settings){.count = cases[i].cascades, .weight = 1};
        struct umb_derived *derived = derive(f.asset, &settings);
        struct umb_derived *twin = derive(f.asset, &settings);
        const uint8_t *bytes, *again;
        size_t size, size_again;
        assert_int_equal(umb_derived_ktx2(twin, &again, &size_again, NULL), UMB_OK);
        assert_int_equal(umb_derived_ktx2(derived, &bytes, &size, NULL), UMB_OK);
        assert_true(size == size_again && memcmp(bytes, again, size) == 0);
        assert_int_equal(umb_derived_ktx2(derived, &again, &size_again, NULL), UMB_OK);
        assert_true(again == bytes && size_again == size);
        assert_int_equal(word(bytes + 12), cases[i].vk_format);
        assert_int_equal(word(bytes + 40), cases[i].levels);
        assert_true(size <= umb_derive_bytes(&settings));
        check_ktx2(derived, bytes, size);
        umb_derived_destroy(twin);
        umb_derived_destroy(derived);
    }
    volume_fixture_close(&f);
}

/* Root mean square of the jump between cascades i - 1 and i at points of the view at the split. */
static double jump(const struct umb_derived *derived, uint32_t i, int matched, uint64_t seed)
{
    double sum = 0.0;
    struct umb_map_query queries[2];
    for (uint32_t k = 0; k < 2; k++) {
        const struct umb_map_filter filter = {.contrast =
                                                  matched ? derived->contrast[i - 1 + k] : 1.0};
        assert_int_equal(umb_map_prepare(derived->maps[i - 1 + k], &filter, &queries[k], NULL),
                         UMB_OK);
    }
    for (int n = 0; n < 20000; n++) {
        const double z = derived->splits[i];
        const double x = (2 * random_unit(&seed) - 1) * z * 0.8;
        const double y = (2 * random_unit(&seed) - 1) * z * 0.5;
        const double world[3] = {camera.eye[0] + 0.8 * z + 0.6 * -x,
                                 camera.eye[1] - 0.6 * z - 0.8 * x, camera.eye[2] + y};
        const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = 1};
        float values[2];
        umb_map_run(&queries[0], &points, 0, 1, &values[0]);
        umb_map_run(&queries[1], &points, 0, 1, &values[1]);
        sum += ((double)values[1] - (double)values[0]) * ((double)values[1] - (double)values[0]);
    }
    return sqrt(sum / 20000);
}

static void contrasts_of_cascades_hide_their_seams(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    struct umb_derive_settings settings = {
        .width = 64,
        .height = 64,
        .camera = &camera,
        .map = {.technique = UMB_MAP_VSM, .blur = 9},
        .match_contrast = 1,
        .cascades = {.count = 3, .weight = 0.7, .fit = UMB_CASCADE_SCENE, .blend = 0.125}};
    struct umb_derived *derived = derive(f.asset, &settings);
    const uint8_t *bytes;
    size_t size;
    assert_true(derived->contrast[0] == 1.0);
    /* Matching a seam changes its layer's contrast and may worsen the next seam, but the sum must
     * fall. */
    double before = 0.0, after = 0.0;
    for (uint32_t i = 1; i < 3; i++) {
        const double one = jump(derived, i, 0, 8 + i), two = jump(derived, i, 1, 8 + i);
        print_message("seam %u: C = %.3f, jump %.4f, then %.4f\n", i, derived->contrast[i], one,
                      two);
        before += one * one;
        after += two * two;
    }
    assert_true(after < 0.8 * before);
    assert_int_equal(umb_derived_ktx2(derived, &bytes, &size, NULL), UMB_OK);
    const char *json = (const char *)bytes + word(bytes + 56) + 4 +
                       (word(bytes + word(bytes + 56)) + 3) / 4 * 4 + 16;
    assert_non_null(strstr(json, "\"blend\":0.125"));
    for (uint32_t i = 0; i < 3; i++) {
        json = strstr(json, "\"contrast\":");
        assert_non_null(json);
        json += strlen("\"contrast\":");
        assert_true(strtod(json, NULL) == derived->contrast[i]);
    }
    umb_derived_destroy(derived);
    settings.match_contrast = 0;
    settings.contrast = 2.5;
    derived = derive(f.asset, &settings);
    assert_true(derived->contrast[0] == 2.5 && derived->contrast[2] == 2.5);
    umb_derived_destroy(derived);
    const struct umb_derive_settings bad[] = {
        {.width = 8, .height = 8, .contrast = 2},
        {.width = 8, .height = 8, .contrast = 2, .map = {.technique = UMB_MAP_MSM}},
        {.width = 8, .height = 8, .contrast = (double)NAN, .map = {.technique = UMB_MAP_VSM}},
        {.width = 8, .height = 8, .contrast = 2e6, .map = {.technique = UMB_MAP_VSM}},
        {.width = 8, .height = 8, .match_contrast = 1, .map = {.technique = UMB_MAP_VSM}},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct umb_error error;
        assert_int_equal(umb_derive(f.asset, &bad[i], NULL, &derived, &error),
                         i < 2 ? UMB_E_UNSUPPORTED : UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "contrast"));
    }
    volume_fixture_close(&f);
}

/* What is alive and its peak; each block carries its size in front. */
struct held {
    size_t live, peak;
};

enum {
    HELD_HEAD = 16
};

static void *held_resize(void *user, void *block, size_t bytes)
{
    struct held *m = user;
    uint8_t *old = block != NULL ? (uint8_t *)block - HELD_HEAD : NULL;
    size_t before = 0;
    if (old != NULL) {
        memcpy(&before, old, sizeof before);
    }
    m->live += bytes - before;
    m->peak = m->live > m->peak ? m->live : m->peak;
    if (bytes == 0) {
        free(old);
        return NULL;
    }
    uint8_t *fresh = realloc(old, bytes + HELD_HEAD);
    assert_non_null(fresh);
    memcpy(fresh, &bytes, sizeof bytes);
    return fresh + HELD_HEAD;
}

static void no_more_bytes_are_held_than_told(void **state)
{
    const struct {
        uint32_t width, height, cascades;
        struct umb_map_settings map;
    } cases[] = {
        {4, 4, 8, {.technique = UMB_MAP_VSM}}, /* with its contrasts matched */
        {1, 1, 0, {.technique = UMB_MAP_PCF}},
        {16384, 1, 0, {.technique = UMB_MAP_PCF, .format = UMB_MAP_U16}},
        {16384, 2, 0, {.technique = UMB_MAP_VSM}},
        {8192, 1, 0, {.technique = UMB_MAP_MSM, .access = UMB_MAP_MIPS}},
        {256, 256, 0, {.technique = UMB_MAP_EVSM, .access = UMB_MAP_MIPS}},
        {64, 64, 8, {.technique = UMB_MAP_EVSM, .access = UMB_MAP_MIPS}},
        {4, 4, 8, {.technique = UMB_MAP_PCF}},
    };
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct held meter = {0};
        const struct umb_alloc alloc = {held_resize, &meter};
        struct umb_derive_settings settings = {
            .width = cases[i].width, .height = cases[i].height, .map = cases[i].map};
        settings.camera = cases[i].cascades ? &camera : NULL;
        settings.cascades = (struct umb_cascade_settings){.count = cases[i].cascades, .weight = 1};
        settings.match_contrast = i == 0;
        struct umb_derived *derived;
        const uint8_t *bytes;
        size_t size;
        struct umb_error error = {0};
        if (umb_derive(f.asset, &settings, &alloc, &derived, &error) != UMB_OK) {
            fail_msg("case %zu: %s", i, error.message);
        }
        assert_int_equal(umb_derived_ktx2(derived, &bytes, &size, NULL), UMB_OK);
        if (meter.peak > umb_derive_bytes(&settings)) {
            fail_msg("case %zu: %zu bytes held, %llu told", i, meter.peak,
                     (unsigned long long)umb_derive_bytes(&settings));
        }
        umb_derived_destroy(derived);
        assert_int_equal(meter.live, 0);
    }
    volume_fixture_close(&f);
}

static int give_up(void *user)
{
    return --*(int *)user == 0;
}

static void lights_with_a_position_are_refused_with_and_without_a_camera(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    struct umb_light_info *light = &f.asset->canonical.content.lights[0];
    light->kind = UMB_LIGHT_POINT;
    memset(light->direction, 0, sizeof light->direction);
    for (int with_camera = 0; with_camera < 2; with_camera++) {
        const struct umb_derive_settings settings = {.width = 8,
                                                     .height = 8,
                                                     .camera = &camera,
                                                     .cascades = {.count = (uint32_t)with_camera}};
        struct umb_derived *derived;
        struct umb_error error = {.message = ""};
        assert_int_equal(umb_derive(f.asset, &settings, NULL, &derived, &error), UMB_E_UNSUPPORTED);
        assert_non_null(strstr(error.message, "light: 0 is not directional"));
    }
    volume_fixture_close(&f);
}

static void what_cannot_be_derived_is_named(void **state)
{
    (void)state;
    struct volume_fixture f, closed;
    int rows = 5;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    volume_fixture_open(&closed, fixture_hills, LOG2_SIZE, 0, 1);
    const struct {
        struct umb_derive_settings settings;
        enum umb_status status;
        const char *named;
        int closed;
    } cases[] = {
        {{.width = 0, .height = 8}, UMB_E_ARGUMENT, "width, height: 0 x 8", 0},
        {{.width = 16385, .height = 8}, UMB_E_ARGUMENT, "16385 x 8", 0},
        {{.width = 16384, .height = 16384}, UMB_E_TOO_LARGE, "67108864", 0},
        {{.width = 8, .height = 8, .light = 1},
         UMB_E_NOT_FOUND,
         "light: 1, the asset's lights are 0 to 0",
         0},
        {{.width = 8, .height = 8, .rect = {0, 0, NAN, 1}}, UMB_E_ARGUMENT, "rect[2]", 0},
        {{.width = 8, .height = 8, .rect = {0, 0, 1e9, 1}}, UMB_E_ARGUMENT, "rect[2]", 0},
        {{.width = 8, .height = 8, .rect = {5, 5, 5, 9}}, UMB_E_ARGUMENT, "rect: 5,5", 0},
        {{.width = 8, .height = 8, .map = {.technique = UMB_MAP_DEEP}},
         UMB_E_UNSUPPORTED,
         "deep",
         0},
        {{.width = 8, .height = 8, .map = {.technique = (enum umb_map_technique)99}},
         UMB_E_UNSUPPORTED,
         "technique",
         0},
        {{.width = 8, .height = 8, .map = {.format = UMB_MAP_U24}}, UMB_E_UNSUPPORTED, "format", 0},
        {{.width = 12, .height = 8, .map = {.technique = UMB_MAP_VSM, .access = UMB_MAP_MIPS}},
         UMB_E_ARGUMENT,
         "12",
         0},
        {{.width = 8, .height = 4, .camera = &camera, .cascades = {.count = 2}},
         UMB_E_ARGUMENT,
         "8 x 4",
         0},
        {{.width = 8, .height = 8, .cascades = {.count = 2}}, UMB_E_ARGUMENT, "camera: NULL", 0},
        {{.width = 8, .height = 8, .camera = &camera, .cascades = {.count = 9}},
         UMB_E_ARGUMENT,
         "cascades.count is 9",
         0},
        {{.width = 8, .height = 8, .camera = &camera, .cascades = {.count = 2, .weight = 2}},
         UMB_E_ARGUMENT,
         "weight",
         0},
        {{.width = 8,
          .height = 8,
          .camera = &camera,
          .cascades = {.count = 1},
          .rect = {0, 0, 1, 1}},
         UMB_E_ARGUMENT,
         "rect",
         0},
        {{.width = 8, .height = 8, .cancelled = give_up, .cancel_user = &rows},
         UMB_E_CANCELLED,
         "row 4",
         0},
        {{.width = 8, .height = 8}, UMB_E_UNSUPPORTED, "front", 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb_derived *derived = (struct umb_derived *)(uintptr_t)1;
        struct umb_error error = {.message = ""};
        const struct umb_asset *asset = cases[i].closed ? closed.asset : f.asset;
        assert_int_equal(umb_derive(asset, &cases[i].settings, NULL, &derived, &error),
                         cases[i].status);
        assert_null(derived);
        if (strstr(error.message, cases[i].named) == NULL) {
            fail_msg("'%s' does not say '%s'", error.message, cases[i].named);
        }
    }
    volume_fixture_close(&closed);
    volume_fixture_close(&f);
}

struct meter {
    size_t left, blocks;
};

static void *metered(void *user, void *block, size_t bytes)
{
    struct meter *meter = user;
    if (bytes == 0) {
        meter->blocks -= block != NULL;
        free(block);
        return NULL;
    }
    if (meter->left == 0) {
        return NULL;
    }
    meter->left--;
    void *grown = realloc(block, bytes);
    meter->blocks += block == NULL && grown != NULL;
    return grown;
}

static void without_memory_nothing_is_left_behind(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, fixture_hills, LOG2_SIZE, 0, 0);
    const struct umb_derive_settings settings = {
        .width = 16,
        .height = 16,
        .map = {.technique = UMB_MAP_EVSM, .access = UMB_MAP_MIPS},
        .camera = &camera,
        .cascades = {.count = 2}};
    enum umb_status status = UMB_E_NO_MEMORY;
    size_t room = 0;
    for (; status != UMB_OK; room++) {
        struct meter meter = {room, 0};
        const struct umb_alloc alloc = {metered, &meter};
        struct umb_derived *derived;
        const uint8_t *bytes = NULL;
        size_t size;
        status = umb_derive(f.asset, &settings, &alloc, &derived, NULL);
        if (status == UMB_OK) {
            status = umb_derived_ktx2(derived, &bytes, &size, NULL);
            umb_derived_destroy(derived);
        }
        assert_true(status == UMB_OK || status == UMB_E_NO_MEMORY);
        assert_int_equal(meter.blocks, 0);
        assert_true(room < 100);
    }
    assert_true(room > 10);
    volume_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_texel_is_the_first_occluder_of_its_column),
        cmocka_unit_test(cascades_hold_the_columns_of_their_texels),
        cmocka_unit_test(a_derived_map_answers_as_the_voxels_do),
        cmocka_unit_test(the_ktx_file_holds_what_was_derived),
        cmocka_unit_test(contrasts_of_cascades_hide_their_seams),
        cmocka_unit_test(no_more_bytes_are_held_than_told),
        cmocka_unit_test(lights_with_a_position_are_refused_with_and_without_a_camera),
        cmocka_unit_test(what_cannot_be_derived_is_named),
        cmocka_unit_test(without_memory_nothing_is_left_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
