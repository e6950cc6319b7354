/* SPDX-License-Identifier: Apache-2.0 */
/* First occluders stored beside a closed DAG: they must be exact for every texel, and safe when
 * damaged. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "format/occluder_depth_build.h"
#include "volume_fixture.h"

#define LOG2_SIZE 8U
#define SIZE      (1U << LOG2_SIZE)

/* Texels row by row. */
struct map {
    uint32_t log2_size;
    int32_t *lit, *end;
};

static void map_finish(struct map *map)
{
    free(map->lit);
    free(map->end);
}

/* A city: roofs of any slope on a ground that is defined, noise, and holes to the background. */
static struct map make_city(uint32_t log2_size, uint64_t seed)
{
    const uint32_t size = 1U << log2_size;
    struct map map = {log2_size, calloc((size_t)size * size, sizeof(int32_t)),
                      calloc((size_t)size * size, sizeof(int32_t))};
    for (uint32_t y = 0; y < size; y++) {
        for (uint32_t x = 0; x < size; x++) {
            const uint64_t h = fixture_hash(x / 48 + seed, y / 40, seed);
            const double a = (double)(h % 200) / 100.0 - 1, b = (double)(h >> 8 & 255) / 80.0 - 1;
            double z = size / 2.0 + a * (x % 48) + b * (y % 40);
            int32_t depth = h >> 20 & 1 ? 40 : 0;
            if ((h >> 21) % 5 == 0) {
                z = (double)(fixture_hash(x, y, seed) % size);
            }
            int32_t lit = z < 0 ? 0 : z > size ? (int32_t)size : (int32_t)z;
            lit = (h >> 24) % 7 == 0 ? (int32_t)size : lit;
            int32_t end = lit + depth + (depth ? (int32_t)(fixture_hash(x, y, 3) % 2) * 9 : 0);
            end = end > (int32_t)size ? (int32_t)size : end;
            map.lit[y * size + x] = lit;
            map.end[y * size + x] = end;
        }
    }
    return map;
}

/* Adds the square at (x, y), blocks of texels as the bake has them. */
static void add_square(const struct map *map, uint32_t x, uint32_t y,
                       struct umb__occluder_depth *occluder_depth)
{
    int32_t lit[64][64], end[64][64];
    for (uint32_t i = 0; i < 4096; i++) {
        const uint32_t block = i / 64, tx = x * 64 + block % 8 * 8 + i % 8;
        const uint32_t ty = y * 64 + block / 8 * 8 + i % 64 / 8;
        lit[block][i % 64] = map->lit[(ty << map->log2_size) + tx];
        end[block][i % 64] = map->end[(ty << map->log2_size) + tx];
    }
    assert_int_equal(umb__occluder_depth_add(occluder_depth, x, y, (const int32_t(*)[64])lit,
                                             (const int32_t(*)[64])end, NULL),
                     UMB_OK);
}

/* In: step: odd; squares are added in steps of it. */
static void make_occluder_depth(const struct map *map, uint32_t step,
                                struct umb__occluder_depth *occluder_depth)
{
    const uint32_t across = 1U << (map->log2_size - 6), count = across * across;
    assert_int_equal(umb__occluder_depth_init(occluder_depth, NULL, map->log2_size, 1U << 26, NULL),
                     UMB_OK);
    for (uint32_t i = 0, at = 0; i < count; i++, at = (at + step) % count) {
        add_square(map, at % across, at / across, occluder_depth);
    }
}

static uint64_t join(const struct umb__occluder_depth *occluder_depth, uint32_t **words)
{
    uint64_t count;
    assert_int_equal(umb__occluder_depth_join(occluder_depth, 1, words, &count, NULL), UMB_OK);
    return count;
}

static void every_texel_before_something_undefined_is_exact(void **state)
{
    (void)state;
    for (uint32_t log2_size = 6; log2_size <= 10; log2_size++) {
        struct map map = make_city(log2_size, 7 + log2_size);
        struct umb__occluder_depth occluder_depth;
        uint32_t *words;
        make_occluder_depth(&map, 1, &occluder_depth);
        const uint64_t count = join(&occluder_depth, &words);
        const struct umb_frustum_info frustum = {.log2_size = log2_size, .closed = 1};
        assert_int_equal(umb__occluder_depth_check(words, count, &frustum, 1, NULL), UMB_OK);
        size_t undefined = 0;
        for (uint32_t i = 0; i < 1U << (2 * log2_size); i++) {
            uint32_t lit = UINT32_MAX;
            const bool found = umb__occluder_depth_find(
                words, words[0], log2_size, i & ((1U << log2_size) - 1), i >> log2_size, &lit);
            if (found) {
                assert_int_equal(lit, map.lit[i]);
            } else {
                assert_int_equal(map.end[i], map.lit[i]);
            }
            undefined += map.end[i] > map.lit[i];
        }
        assert_true(undefined > 100);
        umb__occluder_depth_words_free(NULL, words);
        umb__occluder_depth_finish(&occluder_depth);
        map_finish(&map);
    }
}

static void equal_texels_give_equal_words_in_any_order(void **state)
{
    (void)state;
    struct map map = make_city(9, 3);
    struct umb__occluder_depth one, two;
    uint32_t *first, *second;
    make_occluder_depth(&map, 1, &one);
    make_occluder_depth(&map, 37, &two);
    const uint64_t count = join(&one, &first);
    assert_int_equal(join(&two, &second), count);
    assert_memory_equal(first, second, count * sizeof *first);
    umb__occluder_depth_words_free(NULL, first);
    umb__occluder_depth_words_free(NULL, second);
    umb__occluder_depth_finish(&one);
    umb__occluder_depth_finish(&two);
    map_finish(&map);
}

/* A roof of one slope over many squares takes a few words a square, not a number a texel. */
static void a_plane_takes_a_few_words_a_square(void **state)
{
    (void)state;
    static const double slopes[][2] = {{0, 0}, {0.37, -0.21}, {-1.9, 0.6}, {1.0 / 3, 1.0 / 7}};
    for (size_t s = 0; s < sizeof slopes / sizeof slopes[0]; s++) {
        struct map map = make_city(9, 1);
        for (uint32_t i = 0; i < 1U << 18; i++) {
            const double z = 256.2718281828 + slopes[s][0] * ((i & 511) - 256.0) / 4 +
                             slopes[s][1] * ((i >> 9) - 256.0) / 4;
            map.lit[i] = (int32_t)ceil(z - 0.5);
            map.end[i] = map.lit[i] + 20;
        }
        struct umb__occluder_depth occluder_depth;
        uint32_t *words;
        make_occluder_depth(&map, 1, &occluder_depth);
        /* root, the one node, a reference and mostly a plane for each of 64 squares */
        assert_in_range(join(&occluder_depth, &words), 1 + 2 + 64 * 5, 1 + 2 + 64 * 12);
        umb__occluder_depth_words_free(NULL, words);
        umb__occluder_depth_finish(&occluder_depth);
        map_finish(&map);
    }
}

static void nothing_undefined_takes_no_record(void **state)
{
    (void)state;
    struct map map = make_city(8, 5);
    memcpy(map.end, map.lit, sizeof(int32_t) << 16);
    struct umb__occluder_depth occluder_depth;
    uint32_t *words;
    make_occluder_depth(&map, 1, &occluder_depth);
    assert_int_equal(join(&occluder_depth, &words), 1);
    assert_int_equal(words[0], 0);
    umb__occluder_depth_words_free(NULL, words);
    umb__occluder_depth_finish(&occluder_depth);
    map_finish(&map);
}

static void fronts_that_are_too_large_are_refused_with_a_way_out(void **state)
{
    (void)state;
    struct umb_error error = {0};
    struct umb__occluder_depth occluder_depth;
    assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, 19, 1U << 20, &error),
                     UMB_E_UNSUPPORTED);
    umb__occluder_depth_finish(&occluder_depth);
    struct map map = make_city(6, 2);
    int32_t noise[64][64], deep[64][64];
    for (uint32_t i = 0; i < 4096; i++) {
        noise[i / 64][i % 64] = (int32_t)(fixture_hash(i, 1, 1) % 64);
        deep[i / 64][i % 64] = 64;
    }
    assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, 6, 64, NULL), UMB_OK);
    assert_int_equal(umb__occluder_depth_add(&occluder_depth, 0, 0, (const int32_t(*)[64])noise,
                                             (const int32_t(*)[64])deep, &error),
                     UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "front=off"));
    umb__occluder_depth_finish(&occluder_depth);
    map_finish(&map);
    /* The words of the squares alone fit the limit; with the references to them, for each level,
     * they do not. */
    map = make_city(10, 2);
    assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, 10, 1U << 26, NULL), UMB_OK);
    add_square(&map, 5, 5, &occluder_depth);
    const size_t squares = occluder_depth.count;
    assert_true(squares > 0);
    umb__occluder_depth_finish(&occluder_depth);
    assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, 10, 4 * squares, NULL),
                     UMB_OK);
    add_square(&map, 5, 5, &occluder_depth);
    uint32_t *words;
    uint64_t count;
    assert_int_equal(umb__occluder_depth_join(&occluder_depth, 1, &words, &count, &error),
                     UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "front=off"));
    assert_null(words);
    umb__occluder_depth_finish(&occluder_depth);
    map_finish(&map);
}

/* Damaged words must be refused, or still give depths inside the frustum without reading anything
 * else. */
static void damaged_words_do_no_harm(void **state)
{
    (void)state;
    struct map map = make_city(8, 11);
    struct umb__occluder_depth occluder_depth;
    uint32_t *good;
    uint64_t seed = 77;
    make_occluder_depth(&map, 1, &occluder_depth);
    const uint64_t count = join(&occluder_depth, &good);
    const struct umb_frustum_info frustum = {.log2_size = 8, .closed = 1};
    const struct umb_frustum_info open = {.log2_size = 8};
    assert_int_equal(umb__occluder_depth_check(good, count, &open, 1, NULL), UMB_E_CORRUPT);
    for (uint64_t shorter = 0; shorter < count; shorter += 1 + shorter / 64) {
        uint32_t *cut = malloc(shorter * sizeof *cut + 1); /* of exactly that size, for ASan */
        memcpy(cut, good, shorter * sizeof *cut);
        assert_int_equal(umb__occluder_depth_check(cut, shorter, &frustum, 1, NULL), UMB_E_CORRUPT);
        free(cut);
    }
    uint32_t *longer = malloc((count + 1) * sizeof *longer);
    memcpy(longer, good, count * sizeof *longer);
    longer[count] = 0;
    assert_int_equal(umb__occluder_depth_check(longer, count + 1, &frustum, 1, NULL),
                     UMB_E_CORRUPT);
    free(longer);
    size_t refused = 0;
    for (size_t i = 0; i < 1500; i++) {
        uint32_t *bad = malloc(count * sizeof *bad), lit = 0;
        memcpy(bad, good, count * sizeof *bad);
        const uint64_t flips = 1 + next_random(&seed) % 3;
        for (uint64_t k = 0; k < flips; k++) {
            /* half of them near the root */
            const uint64_t word = next_random(&seed) % (k % 2 ? count : count / 64 + 1);
            bad[word] ^= 1U << next_random(&seed) % 32;
        }
        if (umb__occluder_depth_check(bad, count, &frustum, 1, NULL) != UMB_OK) {
            refused++;
            free(bad);
            continue;
        }
        for (uint32_t t = 0; t < 1U << 16; t += 7) {
            if (umb__occluder_depth_find(bad, bad[0], 8, t & 255, t >> 8, &lit)) {
                assert_true(lit <= 256);
            }
        }
        free(bad);
    }
    assert_true(refused > 500);
    umb__occluder_depth_words_free(NULL, good);
    umb__occluder_depth_finish(&occluder_depth);
    map_finish(&map);
}

/* --- in an asset ---------------------------------------------------------------------------- */

/* In a closed bake a column changes anywhere between lit and end; here hashes of 4x4 texels say
 * where. */
static int stored_voxel(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)frustum;
    const struct map *map = user;
    const uint32_t lit = (uint32_t)map->lit[y * SIZE + x], end = (uint32_t)map->end[y * SIZE + x];
    return z < lit + fixture_hash(x / 4, y / 4, 9) % (end - lit + 1);
}

static void assert_columns(const struct umb_asset *asset, const struct map *map)
{
    struct umb_volume volume;
    struct umb_frustum_info frustum;
    assert_int_equal(umb_volume_prepare(asset, 0, &volume, NULL), UMB_OK);
    assert_int_equal(umb_volume_check_columns(&volume, NULL), UMB_OK);
    assert_int_equal(umb_asset_get_frustum(asset, 0, &frustum), UMB_OK);
    for (uint32_t i = 0; i < SIZE * SIZE; i += 3) {
        const double p[3] = {(i % SIZE + 0.5) * 0.25, (i / SIZE + 0.5) * 0.25, 1.25};
        struct umb_column_answer got;
        struct umb_column_answers answers = {.columns = &got};
        struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
        memcpy(points.origin, fixture_origin, sizeof fixture_origin);
        umb_volume_columns(&volume, &points, 0, 1, &answers);
        assert_int_equal(got.outside, 0);
        assert_int_equal(got.lit, map->lit[i]);
        if (got.lit < SIZE) {
            assert_true(fabs(got.distance_m - (map->lit[i] - 5) * 0.25) < 1e-6);
        } else {
            assert_true(isinf(got.distance_m));
        }
    }
}

static void columns_of_closed_assets_with_a_front_are_those_of_open_ones(void **state)
{
    (void)state;
    struct map map = make_city(LOG2_SIZE, 21);
    struct voxels voxels = {stored_voxel, &map, LOG2_SIZE, 1};
    struct umb__octree octree, again_octree;
    struct umb__content content, again;
    struct umb__occluder_depth occluder_depth;
    struct bytes packed = {0}, second = {0};
    uint8_t id[UMB_ID_BYTES], second_id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.25, fixture_origin, &content);
    content.frusta[0].closed = 1;
    make_occluder_depth(&map, 1, &occluder_depth);
    content.occluder_depth_words = join(&occluder_depth, &content.occluder_depth);
    struct umb_sink sink = bytes_sink(&packed), second_sink = bytes_sink(&second);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    struct umb_asset *asset;
    struct umb_asset_info info;
    assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, NULL, &asset, NULL), UMB_OK);
    umb_asset_get_info(asset, &info);
    assert_int_equal(info.occluder_depth_bytes, content.occluder_depth_words * 4);
    assert_columns(asset, &map);
    /* what an asset gives back packs to the same bytes */
    assert_int_equal(umb__asset_export(asset, &again_octree, &again, NULL), UMB_OK);
    assert_int_equal(
        umb__pack_write(&again, &again_octree, &test_digest, &second_sink, second_id, NULL),
        UMB_OK);
    assert_memory_equal(id, second_id, sizeof id);
    umb__octree_finish(&again_octree);
    umb_asset_close(asset);
    /* and the mapped form answers the same */
    struct bytes mapped = make_mapped(&packed);
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL), UMB_OK);
    assert_columns(asset, &map);
    umb_asset_close(asset);
    /* another depth is another identity */
    content.occluder_depth[content.occluder_depth_words - 1] ^= 1;
    bytes_finish(&second);
    second_sink = bytes_sink(&second);
    if (umb__pack_write(&content, &octree, &test_digest, &second_sink, second_id, NULL) == UMB_OK) {
        assert_memory_not_equal(id, second_id, sizeof id);
    }
    content.occluder_depth[0] = 5; /* leads nowhere */
    assert_int_equal(
        umb__pack_write(&content, &octree, &test_digest, &second_sink, second_id, NULL),
        UMB_E_ARGUMENT);
    umb__octree_finish(&octree);
    umb__occluder_depth_words_free(NULL, content.occluder_depth);
    umb__occluder_depth_finish(&occluder_depth);
    bytes_finish(&packed);
    bytes_finish(&second);
    bytes_finish(&mapped);
    map_finish(&map);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_texel_before_something_undefined_is_exact),
        cmocka_unit_test(equal_texels_give_equal_words_in_any_order),
        cmocka_unit_test(a_plane_takes_a_few_words_a_square),
        cmocka_unit_test(nothing_undefined_takes_no_record),
        cmocka_unit_test(fronts_that_are_too_large_are_refused_with_a_way_out),
        cmocka_unit_test(damaged_words_do_no_harm),
        cmocka_unit_test(columns_of_closed_assets_with_a_front_are_those_of_open_ones),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
