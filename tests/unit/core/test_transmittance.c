/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Translucent casters in assets: what is written, what the oracle reads, what queries answer, and
 * how damaged bytes are handled. The truth comes from the layers that the fixture draws.
 */
#include "transmittance_fixture.h"

#include "oracle_reader.h"
#include "query/slice_count.h"
#include "umbrage/partial.h"
#include "umbrage/query.h"

enum {
    POINTS = 100000,
};

static struct umb_query prepare(const struct umb_asset *asset,
                                const struct umb_query_settings *settings)
{
    struct umb_query query;
    struct umb_error error = {0};
    if (umb_query_prepare(asset, settings, &query, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return query;
}

/* Random points in and around the frustum, relative to fixture_origin; their voxels. */
static void make_points(double (*points)[3], double (*voxels)[3], size_t count, uint64_t seed)
{
    for (size_t i = 0; i < 3 * count; i++) {
        const double voxel = (random_unit(&seed) * 1.1 - 0.05) * TF_SIZE;
        points[i / 3][i % 3] = voxel * TF_VOXEL_M;
        voxels[i / 3][i % 3] = points[i / 3][i % 3] / TF_VOXEL_M;
    }
}

static struct umb_points batch_of(const double (*points)[3], size_t count)
{
    struct umb_points batch = {.positions = points, .format = UMB_POINT_F64, .count = count};
    memcpy(batch.origin, fixture_origin, sizeof batch.origin);
    return batch;
}

static void lists_are_what_the_page_says(void **state)
{
    (void)state;
    static const uint32_t levels[][2] = {{7, 6}, {0, 7}, {6, 0}};
    for (size_t c = 0; c < sizeof levels / sizeof levels[0]; c++) {
        struct tf_asset f;
        struct oracle oracle;
        char why[ORACLE_ERROR_SIZE];
        uint64_t seed = 5;
        size_t dimmed = 0;
        tf_open(&f, levels[c][0], levels[c][1]);
        if (!oracle_open(&oracle, f.file.data, f.file.size, why)) {
            fail_msg("%s", why);
        }
        for (size_t i = 0; i < 800; i++) {
            const uint32_t light = (uint32_t)(next_random(&seed) % TF_LIGHTS);
            const uint32_t x = (uint32_t)(next_random(&seed) % TF_SIZE);
            const uint32_t y = (uint32_t)(next_random(&seed) % TF_SIZE);
            const uint32_t z = (uint32_t)(next_random(&seed) % TF_SIZE);
            const uint32_t shift = TF_LOG2 - f.levels[light];
            long double exact;
            const uint32_t left = f.levels[light] == 0
                                      ? UMB__TRANSMITTANCE_ONE
                                      : tf_left(&f, light, x >> shift, y >> shift, z, &exact);
            assert_int_equal(oracle_transmittance(&oracle, light, x, y, z), left);
            dimmed += left < UMB__TRANSMITTANCE_ONE;
        }
        assert_true(dimmed > 60);
        oracle_close(&oracle);
        tf_close(&f);
    }
}

/* Finds the box of `taps` voxels around a voxel, at least as wide as a texel and a voxel. */
static void model_box(const struct tf_asset *f, uint32_t light, const double v[3], int32_t taps,
                      double *share, long double *exact)
{
    const uint32_t shift = TF_LOG2 - f->levels[light];
    const int32_t side = 1 << shift, box = side > 1 && side + 1 > taps ? side + 1 : taps;
    const int32_t x0 = (int32_t)floor(v[0]), y0 = (int32_t)floor(v[1]);
    const int32_t z = v[2] >= TF_SIZE ? TF_SIZE - 1 : (int32_t)v[2];
    uint64_t left = 0, lit = 0;
    long double sum = 0.0L;
    for (int32_t k = 0; k < box * box; k++) {
        const int32_t x = x0 - box / 2 + k % box, y = y0 - box / 2 + k / box;
        long double here = 1.0L;
        if (x >= 0 && y >= 0 && x < TF_SIZE && y < TF_SIZE && v[2] >= 0) {
            left +=
                tf_left(f, light, (uint32_t)x >> shift, (uint32_t)y >> shift, (uint32_t)z, &here);
        } else {
            left += UMB__TRANSMITTANCE_ONE;
        }
        sum += here;
    }
    for (int32_t k = 0; k < taps * taps; k++) {
        const int32_t x = x0 - taps / 2 + k % taps, y = y0 - taps / 2 + k / taps;
        const int inside = x >= 0 && y >= 0 && x < TF_SIZE && y < TF_SIZE && v[2] >= 0;
        lit += !inside || fixture_hills(NULL, light, (uint32_t)x, (uint32_t)y, (uint32_t)z);
    }
    const double all = (double)box * box * UMB__TRANSMITTANCE_ONE;
    const float opaque = (float)lit / (float)(taps * taps);
    *share = (double)(float)((double)opaque * ((double)left / all));
    *exact = (long double)lit / (taps * taps) * sum / (box * box);
}

/* The level at which look-ups of opaque casters stop must change neither the box of the
 * transmittance nor the move of its points. */
static void levels_leave_the_light_left_alone(void **state)
{
    (void)state;
    enum {
        COUNT = 500
    };
    static double points[COUNT][3], voxels[COUNT][3];
    static float normals[COUNT][3];
    struct tf_asset f;
    uint64_t seed = 47;
    tf_open(&f, 7, 6);
    make_points(points, voxels, COUNT, 53);
    for (size_t i = 0; i < COUNT; i++) {
        for (int k = 0; k < 3 && i % 2 == 0; k++) {
            normals[i][k] = (float)(random_unit(&seed) - 0.5);
        }
    }
    struct umb_points batch = batch_of((const double(*)[3])points, COUNT);
    batch.normals = normals;
    for (uint32_t light = 0; light < TF_LIGHTS; light++) {
        struct umb_query_settings settings = {.light = light};
        const struct umb_query fine = prepare(f.asset, &settings);
        settings.level = UMB_LEVEL_BRICK;
        const struct umb_query coarse = prepare(f.asset, &settings);
        size_t dimmed = 0;
        for (size_t i = 0; i < COUNT; i++) {
            struct umb_explanation voxel, cell;
            umb_query_explain(&fine, &batch, i, &voxel);
            umb_query_explain(&coarse, &batch, i, &cell);
            if (voxel.answer > 0 && cell.answer > 0) {
                assert_true(voxel.transmittance == cell.transmittance);
                dimmed += voxel.transmittance < 1;
            }
        }
        assert_true(dimmed > COUNT / 20);
    }
    tf_close(&f);
}

/* Answers must be the product of both: exactly by the lists, within 1e-6 by the layers. */
static void answers_are_products_of_all_hits(void **state)
{
    (void)state;
    static const int32_t taps[] = {1, 3, 9, 17};
    static double points[POINTS][3], voxels[POINTS][3];
    static float values[POINTS];
    struct tf_asset f;
    tf_open(&f, 7, 6);
    make_points(points, voxels, POINTS, 17);
    for (size_t t = 0; t < sizeof taps / sizeof taps[0]; t++) {
        for (uint32_t light = 0; light < TF_LIGHTS; light++) {
            const size_t count = taps[t] == 1 ? POINTS : 30000 / (size_t)(taps[t] * taps[t]);
            const struct umb_query_settings settings = {
                .light = light, .taps = (uint32_t)taps[t], .bias_mode = UMB_BIAS_NONE};
            const struct umb_query query = prepare(f.asset, &settings);
            const struct umb_points batch = batch_of((const double(*)[3])points, count);
            struct umb_answers answers = {.values = values};
            size_t between = 0;
            umb_query_run(&query, &batch, 0, count, &answers);
            assert_int_equal(answers.stats.points, count);
            for (size_t i = 0; i < count; i++) {
                double share;
                long double exact;
                model_box(&f, light, voxels[i], taps[t], &share, &exact);
                if ((double)values[i] != share || fabsl(values[i] - exact) > 1e-6L) {
                    fail_msg("taps %d, light %u, point %zu: %.9g, lists %.9g, layers %.9Lg",
                             (int)taps[t], light, i, (double)values[i], share, exact);
                }
                between += values[i] > 0 && values[i] < 1;
            }
            assert_true(between > count / 50);
        }
    }
    tf_close(&f);
}

/* The answer must be the same for every format of points and answers, every split and every number
 * of lights. */
static void formats_and_splits_agree(void **state)
{
    (void)state;
    enum {
        COUNT = 5000
    };
    static double points[COUNT][3], voxels[COUNT][3];
    static float normals[COUNT][3], whole[COUNT], parts[COUNT];
    static uint8_t bytes[COUNT], bits[COUNT / 8];
    struct tf_asset f;
    uint64_t seed = 3;
    tf_open(&f, 7, 6);
    make_points(points, voxels, COUNT, 23);
    for (size_t i = 0; i < COUNT; i++) {
        for (int k = 0; k < 3 && i % 2 == 0; k++) {
            normals[i][k] = (float)(random_unit(&seed) - 0.5);
        }
    }
    struct umb_points batch = batch_of((const double(*)[3])points, COUNT);
    batch.normals = normals;
    struct umb_query_settings settings = {.taps = 3};
    struct umb_query query = prepare(f.asset, &settings);
    struct umb_answers answers = {.values = whole};
    umb_query_run(&query, &batch, 0, COUNT, &answers);
    const struct umb_query_stats stats = answers.stats;
    answers = (struct umb_answers){.values = parts};
    for (size_t first = 0, n; first < COUNT; first += n) {
        n = 1 + next_random(&seed) % 700;
        n = n < COUNT - first ? n : COUNT - first;
        umb_query_run(&query, &batch, first, n, &answers);
    }
    assert_memory_equal(whole, parts, sizeof whole);
    assert_int_equal(stats.facing_away, answers.stats.facing_away);
    settings.format = UMB_ANSWER_U8;
    query = prepare(f.asset, &settings);
    answers = (struct umb_answers){.values = bytes};
    umb_query_run(&query, &batch, 0, COUNT, &answers);
    settings.format = UMB_ANSWER_BIT;
    query = prepare(f.asset, &settings);
    memset(bits, 0xff, sizeof bits);
    answers = (struct umb_answers){.values = bits};
    umb_query_run(&query, &batch, 0, COUNT, &answers);
    for (size_t i = 0; i < COUNT; i++) {
        assert_true(fabs(bytes[i] - 255.0 * (double)whole[i]) <= 0.5 + 1e-4);
        assert_int_equal(bits[i / 8] >> (i % 8) & 1, whole[i] >= 0.5F);
    }
    tf_close(&f);
}

/* A share may have been stored as a float in between or not: the result must not depend on that. */
static void bytes_and_bits_follow_from_the_float(void **state)
{
    (void)state;
    static const enum umb_answer_format formats[] = {UMB_ANSWER_U8, UMB_ANSWER_BIT};
    for (unsigned k = 0; k <= 2 * 255; k++) {
        const double ties[] = {k / 510.0, nextafter(k / 510.0, 0), nextafter(k / 510.0, 1)};
        for (unsigned t = 0; t < 3; t++) {
            for (unsigned f = 0; f < 2; f++) {
                uint8_t direct = 0, rounded = 0;
                umb__store_share(&direct, formats[f], 0, ties[t]);
                umb__store_share(&rounded, formats[f], 0, (double)(float)ties[t]);
                assert_int_equal(direct, rounded);
                assert_int_equal(direct, f == 0 ? (k + 1) / 2 : k >= 255);
            }
        }
    }
}

static void what_is_not_dimmed_keeps_its_bits(void **state)
{
    (void)state;
    enum {
        COUNT = 4000
    };
    static double points[COUNT][3], voxels[COUNT][3];
    static float normals[COUNT][3];
    static uint8_t with[4 * COUNT], without[4 * COUNT];
    struct tf_asset f;
    uint64_t seed = 9;
    tf_open(&f, 7, 0);
    make_points(points, voxels, COUNT, 29);
    for (size_t i = 0; i < COUNT; i++) { /* the corner without layers */
        points[i][0] *= 0.06;
        points[i][1] *= 0.06;
        normals[i][2] = i % 3 == 0 ? 0.0F : -1.0F;
        normals[i][1] = (float)(random_unit(&seed) - 0.5);
    }
    struct umb_points batch = batch_of((const double(*)[3])points, COUNT);
    batch.normals = normals;
    for (uint32_t light = 0; light < TF_LIGHTS; light++) { /* the second has no map at all */
        for (int format = UMB_ANSWER_F32; format <= UMB_ANSWER_BIT; format++) {
            for (uint32_t taps = 1; taps <= 17; taps += 8) {
                struct umb_query_settings settings = {
                    .light = light, .taps = taps, .format = (enum umb_answer_format)format};
                struct umb_query query = prepare(f.asset, &settings);
                struct umb_answers answers = {.values = with};
                memset(with, 0, sizeof with);
                memset(without, 0, sizeof without);
                umb_query_run(&query, &batch, 0, COUNT, &answers);
                const struct umb_query_stats stats = answers.stats;
                settings.opaque_only = 1;
                query = prepare(f.asset, &settings);
                answers = (struct umb_answers){.values = without};
                umb_query_run(&query, &batch, 0, COUNT, &answers);
                assert_memory_equal(with, without, sizeof with);
                assert_memory_equal(&stats, &answers.stats, sizeof stats);
            }
        }
    }
    tf_close(&f);
}

static void explanations_say_what_translucent_casters_left(void **state)
{
    (void)state;
    enum {
        COUNT = 500
    };
    static double points[COUNT][3], voxels[COUNT][3];
    float values[COUNT], opaque[COUNT];
    struct tf_asset f;
    tf_open(&f, 6, 7);
    make_points(points, voxels, COUNT, 31);
    const struct umb_points batch = batch_of((const double(*)[3])points, COUNT);
    struct umb_query_settings settings = {.taps = 5};
    const struct umb_query query = prepare(f.asset, &settings);
    settings.opaque_only = 1;
    const struct umb_query plain = prepare(f.asset, &settings);
    struct umb_answers answers = {.values = values};
    umb_query_run(&query, &batch, 0, COUNT, &answers);
    answers.values = opaque;
    umb_query_run(&plain, &batch, 0, COUNT, &answers);
    for (size_t i = 0; i < COUNT; i++) {
        struct umb_explanation e;
        umb_query_explain(&query, &batch, i, &e);
        assert_true((float)e.answer == values[i]);
        assert_true((float)((double)opaque[i] * e.transmittance) == values[i]);
        umb_query_explain(&plain, &batch, i, &e);
        assert_true((float)e.answer == opaque[i] && e.transmittance == 1);
    }
    tf_close(&f);
}

/* Mapped, exported and packed again, and page by page: content and answers must be the same. */
static void all_forms_of_a_file_answer_the_same(void **state)
{
    (void)state;
    enum {
        COUNT = 3000
    };
    static double points[COUNT][3], voxels[COUNT][3];
    static float truth[COUNT], values[COUNT];
    struct tf_asset f;
    tf_open(&f, 7, 6);
    make_points(points, voxels, COUNT, 37);
    const struct umb_points batch = batch_of((const double(*)[3])points, COUNT);
    const struct umb_query_settings settings = {.light = 1, .taps = 3};
    struct umb_query query = prepare(f.asset, &settings);
    struct umb_answers answers = {.values = truth};
    umb_query_run(&query, &batch, 0, COUNT, &answers);

    struct umb_asset_info info;
    umb_asset_get_info(f.asset, &info);
    assert_true(info.transmittance_bytes > 10000);
    struct umb__octree octree;
    struct umb__content content;
    struct bytes again = {0};
    struct umb_sink sink = bytes_sink(&again);
    uint8_t id[UMB_ID_BYTES];
    assert_int_equal(umb__asset_export(f.asset, &octree, &content, NULL), UMB_OK);
    assert_int_equal(content.transmittance_bytes, info.transmittance_bytes);
    assert_int_equal(umb__pack_write(&content, &octree, &tf_digest, &sink, id, NULL), UMB_OK);
    assert_int_equal(again.size, f.file.size);
    assert_memory_equal(again.data, f.file.data, again.size);
    umb__octree_finish(&octree);
    bytes_finish(&again);

    struct bytes mapped = make_mapped(&f.file);
    struct umb_asset *asset;
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL), UMB_OK);
    query = prepare(asset, &settings);
    answers.values = values;
    umb_query_run(&query, &batch, 0, COUNT, &answers);
    assert_memory_equal(truth, values, sizeof truth);
    umb_asset_close(asset);
    bytes_finish(&mapped);
    tf_close(&f);
}

static void partial_assets_answer_the_same_when_all_is_here(void **state)
{
    (void)state;
    enum {
        COUNT = 3000
    };
    static double points[COUNT][3], voxels[COUNT][3];
    static float truth[COUNT], values[COUNT];
    struct tf_asset f;
    struct umb_partial *partial;
    struct umb_partial_stats stats;
    const struct umb_partial_options options = {.sha256 = &tf_digest,
                                                .max_memory_bytes = (uint64_t)64 << 20};
    tf_open(&f, 7, 6);
    make_points(points, voxels, COUNT, 41);
    const struct umb_points batch = batch_of((const double(*)[3])points, COUNT);
    const struct umb_query_settings settings = {.taps = 3};
    struct umb_query query = prepare(f.asset, &settings);
    struct umb_answers answers = {.values = truth};
    umb_query_run(&query, &batch, 0, COUNT, &answers);
    assert_int_equal(umb_partial_open(f.file.data, f.file.size, &options, &partial, NULL), UMB_OK);
    umb_partial_get_stats(partial, &stats);
    assert_int_equal(stats.blocks_held, stats.block_count);
    for (uint32_t page = 0; page < stats.page_count; page++) {
        uint64_t offset;
        uint32_t length;
        (void)umb_partial_locate(partial, page, &offset, &length);
        assert_int_equal(umb_partial_add(partial, page, f.file.data + offset, length, NULL),
                         UMB_OK);
    }
    assert_int_equal(umb_partial_build(partial, NULL), UMB_OK);
    struct umb_partial_answers found = {.values = values};
    assert_int_equal(umb_partial_query(partial, &settings, &batch, 0, &found, NULL), UMB_OK);
    assert_int_equal(found.exact, COUNT);
    assert_memory_equal(truth, values, sizeof truth);
    umb_partial_close(partial);
    tf_close(&f);
}

/* A map of two lists, byte by byte. */
static void the_bytes_of_a_small_map_stay(void **state)
{
    (void)state;
    static const uint8_t golden[] = {
        6,                                        /* 2^6 texels a side */
        0x02, 0,    0,    0,    0,    0, 0, 0x80, /* blocks 1 and 63 */
        0x03, 0,    0,    0,    0,    0, 0, 0,    /* texels 8, 0 and 9, 0 */
        0x51, 0xff, 0xff, 0x3f,                   /* z 10, half; another follows */
        0x84, 0x04, 0xff, 0xff, 0x1f,             /* z 140, a quarter */
        0x03,                                     /* z 10 and the same half; another follows */
        0x2a,                                     /* z 21, the same quarter */
        0,    0,    0,    0,    0,    0, 0, 0x80, /* texel 63, 63 */
        0x2c, 0x00,                               /* z 4, 6 before that of the list before; 2^-21 */
    };
    static const struct umb__transmittance_drop first[] = {{10, 1 << 20}, {140, 1 << 19}};
    static const struct umb__transmittance_drop second[] = {{10, 1 << 20}, {21, 1 << 19}},
                                                last[] = {{4, 1}};
    static struct umb__transmittance_list lists[64 * 64];
    const uint8_t level = 6;
    struct umb__transmittance_bytes bytes = {0};
    lists[8] = (struct umb__transmittance_list){first, 2};
    lists[9] = (struct umb__transmittance_list){second, 2};
    lists[64 * 64 - 1] = (struct umb__transmittance_list){last, 1};
    assert_int_equal(umb__transmittance_append(&bytes, &level, 1, SIZE_MAX, NULL), UMB_OK);
    assert_int_equal(umb__transmittance_square(&bytes, lists, SIZE_MAX, NULL), UMB_OK);
    assert_int_equal(bytes.count, sizeof golden);
    assert_memory_equal(bytes.data, golden, sizeof golden);
    umb__transmittance_bytes_finish(&bytes);
}

/* Checks an entry; if it passes, expands and queries it. Returns 1 if it passes. */
static int try_bytes(const uint8_t *bytes, size_t size)
{
    static const struct umb_frustum_info frusta[2] = {{.log2_size = 7}, {.log2_size = 7}};
    uint8_t *exact = malloc(size + (size == 0)); /* of exactly that size, for ASan */
    struct umb__trans trans;
    memcpy(exact, bytes, size);
    const enum umb_status status = umb__transmittance_check(exact, size, frusta, 2, NULL);
    assert_int_equal(umb__transmittance_load(exact, size, frusta, 2, NULL, &trans, NULL), status);
    free(exact);
    if (status != UMB_OK) {
        assert_int_equal(status, UMB_E_CORRUPT);
        assert_null(trans.maps);
        return 0;
    }
    for (uint32_t i = 0; i < 2; i++) {
        for (uint32_t z = 0; z < 128 && trans.maps[i].level > 0; z += 3) {
            const struct umb__transmittance_window window = {z / 2, 127 - z / 3, 0, 127, z};
            const uint64_t voxels = (uint64_t)(window.x1 - window.x0 + 1) * 128;
            assert_true(umb__transmittance_lost(&trans, &trans.maps[i], 7, &window) <=
                        voxels * UMB__TRANSMITTANCE_ONE);
        }
    }
    umb__transmittance_finish(&trans, NULL);
    return 1;
}

static void damaged_bytes_are_refused_or_do_no_harm(void **state)
{
    (void)state;
    struct tf_asset f;
    struct umb__transmittance_bytes good;
    uint64_t seed = 43;
    size_t refused = 0;
    tf_open(&f, 6, 7);
    tf_write(&f, &good);
    assert_true(try_bytes(good.data, good.count));
    for (size_t shorter = 0; shorter < good.count; shorter += 1 + shorter / 20) {
        assert_false(try_bytes(good.data, shorter));
    }
    for (int i = 0; i < 150; i++) {
        const size_t at = i < 60 ? (size_t)i % 40 : next_random(&seed) % good.count;
        const uint8_t before = good.data[at];
        good.data[at] ^= (uint8_t)(1U << next_random(&seed) % 8);
        refused += !try_bytes(good.data, good.count);
        good.data[at] = before;
    }
    assert_true(refused > 60);
    /* longer than need be, or behind the end */
    static const uint8_t bad[][20] = {
        {0, 6, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0x80, 0x00},
        {0, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0},
        {0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0},
        {0, 6, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_false(try_bytes(bad[i], sizeof bad[i]));
    }
    umb__transmittance_bytes_finish(&good);
    tf_close(&f);
}

static void writers_are_held_to_what_readers_take(void **state)
{
    (void)state;
    const struct voxels voxels = {fixture_hills, NULL, 6, 1};
    struct umb__octree octree;
    struct umb__content content;
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    uint8_t id[UMB_ID_BYTES], wrong[] = {7};
    struct umb__transmittance_bytes bytes = {0};
    static struct umb__transmittance_list none[64 * 64];
    make_octree(&voxels, &octree);
    make_content(&voxels, 1, fixture_origin, &content);
    content.transmittance = wrong;
    content.transmittance_bytes = 1;
    assert_int_not_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    assert_int_equal(umb__transmittance_square(&bytes, none, 7, NULL), UMB_E_LIMIT);
    umb__transmittance_bytes_finish(&bytes);
    umb__octree_finish(&octree);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_are_what_the_page_says),
        cmocka_unit_test(answers_are_products_of_all_hits),
        cmocka_unit_test(levels_leave_the_light_left_alone),
        cmocka_unit_test(formats_and_splits_agree),
        cmocka_unit_test(bytes_and_bits_follow_from_the_float),
        cmocka_unit_test(what_is_not_dimmed_keeps_its_bits),
        cmocka_unit_test(explanations_say_what_translucent_casters_left),
        cmocka_unit_test(all_forms_of_a_file_answer_the_same),
        cmocka_unit_test(partial_assets_answer_the_same_when_all_is_here),
        cmocka_unit_test(the_bytes_of_a_small_map_stay),
        cmocka_unit_test(damaged_bytes_are_refused_or_do_no_harm),
        cmocka_unit_test(writers_are_held_to_what_readers_take),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
