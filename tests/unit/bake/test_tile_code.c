/* SPDX-License-Identifier: Apache-2.0 */
/* Tile results as bytes, and the folder that holds them: encoding is canonical, bytes are checked,
 * and the folder's size stays within its limit. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <fcntl.h>
#include <time.h>

#include "bake/build/tile_occluder_depth.h"
#include "bake/tiles/tile_cache.h"
#include "bake/tiles/tile_code.h"
#include "bake_soups.h"
#include "tile_folders.h"

#define LOG2_SIZE 7U
#define LEFT      ((size_t)1 << 30)

static const struct umbb_tile_shape shape = {.log2_size = LOG2_SIZE, .tile_log2 = LOG2_SIZE};

/* Builds a soup's only tile into a pool and encodes it. In: occluder_depth: NULL, or empty. */
static uint8_t *encode_occluder_depth(struct umb__pool *pool, uint64_t seed,
                                      struct umb__occluder_depth *occluder_depth, size_t *size)
{
    struct umb_error error;
    struct soup soup;
    soup_init(&soup, 1 << LOG2_SIZE, seed);
    soup_mixture(&soup);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    const struct umbb_depth_options options = {.tile_log2 = LOG2_SIZE, .threads = 1};
    struct umbb_depth depth;
    struct umbb_tile tile;
    struct umbb_runs runs = {0};
    assert_int_equal(umbb_depth_raster_create(&casters, &options, &depth, &error), UMB_OK);
    assert_int_equal(umbb_tile_init(&tile, LOG2_SIZE, 1, &error), UMB_OK);
    assert_int_equal(depth.begin(depth.state, 0, &tile, &error), UMB_OK);
    depth.block(depth.state, 0, 0, &tile, 0, 0);
    umbb_tile_pyramid(&tile);
    struct umbb_tile_result result = {
        .max_lit = tile.max_lit[LOG2_SIZE][0],
        .min_end = tile.min_end[LOG2_SIZE][0],
    };
    const struct umbb_square whole = {tile.log2_size, {0, 0}};
    assert_int_equal(umbb_column_of_square(pool, &tile, &whole, &runs, &result.column, &error),
                     UMB_OK);
    struct umbb_tile_shape with_depths = shape;
    with_depths.occluder_depth = occluder_depth;
    if (occluder_depth != NULL) {
        assert_int_equal(umbb_tile_occluder_depth(&tile, occluder_depth, &error), UMB_OK);
    }
    uint8_t *bytes;
    const struct umbb_tile_nodes nodes = {pool, &runs, LEFT};
    assert_int_equal(umbb_tile_encode(&with_depths, &nodes, &result, &bytes, size, &error), UMB_OK);
    umbb_runs_finish(&runs);
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
    soup_finish(&soup);
    return bytes;
}

static uint8_t *encode_soup(struct umb__pool *pool, uint64_t seed, size_t *size)
{
    return encode_occluder_depth(pool, seed, NULL, size);
}

static void equal_results_are_equal_bytes_whatever_the_pool_held(void **state)
{
    (void)state;
    struct umb__pool alone, shared;
    umb__pool_init(&alone, NULL, LEFT);
    umb__pool_init(&shared, NULL, LEFT);
    size_t size, other_size;
    free(encode_soup(&shared, 812, &other_size));
    uint8_t *one = encode_soup(&alone, 811, &size);
    uint8_t *two = encode_soup(&shared, 811, &other_size);
    assert_int_equal(size, other_size);
    assert_memory_equal(one, two, size);

    /* Decoding into a third pool and encoding again must give the same bytes. */
    struct umb__pool third;
    struct umb_error error;
    struct umbb_runs runs = {0};
    struct umbb_tile_result result;
    umb__pool_init(&third, NULL, LEFT);
    const struct umbb_tile_nodes nodes = {&third, &runs, LEFT};
    assert_int_equal(umbb_tile_decode(&shape, one, size, &nodes, &result, &error), UMB_OK);
    assert_int_equal(third.level[UMB_LEVEL_BRICK].count, alone.level[UMB_LEVEL_BRICK].count);
    uint8_t *again;
    assert_int_equal(umbb_tile_encode(&shape, &nodes, &result, &again, &other_size, &error),
                     UMB_OK);
    assert_int_equal(size, other_size);
    assert_memory_equal(one, again, size);
    umbb_runs_finish(&runs);
    umb__pool_finish(&alone);
    umb__pool_finish(&shared);
    umb__pool_finish(&third);
    free(one);
    free(two);
    free(again);
}

/* Decodes a copy in a block of its exact size. A refusal must not change the pool. */
static enum umb_status decode_copy(const uint8_t *bytes, size_t size)
{
    struct umb__pool pool;
    struct umb_error error;
    struct umbb_runs runs = {0};
    struct umbb_tile_result result;
    uint8_t *copy = malloc(size > 0 ? size : 1);
    assert_non_null(copy);
    memcpy(copy, bytes, size);
    umb__pool_init(&pool, NULL, LEFT);
    const struct umbb_tile_nodes nodes = {&pool, &runs, LEFT};
    const enum umb_status status = umbb_tile_decode(&shape, copy, size, &nodes, &result, &error);
    if (status != UMB_OK) {
        assert_int_equal(status, UMB_E_CORRUPT);
        assert_int_equal(pool.bytes, 0);
        assert_int_equal(runs.count, 0);
    }
    umbb_runs_finish(&runs);
    umb__pool_finish(&pool);
    free(copy);
    return status;
}

static void every_prefix_and_flipped_byte_is_refused_or_harmless(void **state)
{
    (void)state;
    struct umb__pool pool;
    umb__pool_init(&pool, NULL, LEFT);
    size_t size;
    uint8_t *bytes = encode_soup(&pool, 813, &size);
    umb__pool_finish(&pool);
    assert_int_equal(decode_copy(bytes, size), UMB_OK);
    const size_t bricks = size - 64 * (size_t)(bytes[12] | bytes[13] << 8 | bytes[14] << 16);
    size_t refused = 0, tried = 0;
    for (size_t length = 0; length < size; length += length < 300 ? 1 : 97) {
        assert_int_equal(decode_copy(bytes, length), UMB_E_CORRUPT);
    }
    for (size_t at = 3; at <= 7;
         at += 4) { /* the two depths at the occluder depth map, beyond the frustum */
        bytes[at] ^= 0x40;
        assert_int_equal(decode_copy(bytes, size), UMB_E_CORRUPT);
        bytes[at] ^= 0x40;
    }
    for (size_t at = 0; at < bricks; at += at < 300 ? 1 : 37) {
        for (int bit = 0; bit < 8; bit += 3) {
            bytes[at] ^= (uint8_t)(1 << bit);
            refused += decode_copy(bytes, size) != UMB_OK;
            bytes[at] ^= (uint8_t)(1 << bit);
            tried++;
        }
    }
    /* The remaining cases decode to other trees of the same form. */
    assert_in_range(refused, tried / 2, tried);
    free(bytes);
}

/* Decodes a copy in a block of its exact size, first occluders included, into an occluder depth map
 * of 16 tiles. A refusal must not change it. */
static enum umb_status decode_occluder_depth(const uint8_t *bytes, size_t size,
                                             struct umb__occluder_depth *occluder_depth)
{
    struct umb__pool pool;
    struct umb_error error;
    struct umbb_runs runs = {0};
    struct umbb_tile_result result;
    const struct umbb_tile_shape with_depths = {.log2_size = LOG2_SIZE + 2,
                                                .tile_log2 = LOG2_SIZE,
                                                .occluder_depth = occluder_depth,
                                                .occluder_depth_x = 4,
                                                .occluder_depth_y = 6};
    uint8_t *copy = malloc(size > 0 ? size : 1);
    assert_non_null(copy);
    memcpy(copy, bytes, size);
    umb__pool_init(&pool, NULL, LEFT);
    assert_int_equal(umb__occluder_depth_init(occluder_depth, NULL, LOG2_SIZE + 2, LEFT, &error),
                     UMB_OK);
    const struct umbb_tile_nodes nodes = {&pool, &runs, LEFT};
    const enum umb_status status =
        umbb_tile_decode(&with_depths, copy, size, &nodes, &result, &error);
    if (status != UMB_OK) {
        assert_int_equal(status, UMB_E_CORRUPT);
        assert_int_equal(pool.bytes, 0);
        assert_int_equal(occluder_depth->count, 0);
    }
    umbb_runs_finish(&runs);
    umb__pool_finish(&pool);
    free(copy);
    return status;
}

static void first_occluders_are_kept_word_by_word_and_damage_is_refused(void **state)
{
    (void)state;
    struct umb__pool pool;
    struct umb_error error;
    struct umb__occluder_depth occluder_depth, other;
    size_t size, plain_size;
    umb__pool_init(&pool, NULL, LEFT);
    free(encode_soup(&pool, 814, &plain_size));
    assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, LOG2_SIZE, LEFT, &error),
                     UMB_OK);
    uint8_t *bytes = encode_occluder_depth(&pool, 814, &occluder_depth, &size);
    umb__pool_finish(&pool);
    assert_true(size > plain_size + 1000);
    assert_int_equal(decode_occluder_depth(bytes, size, &other), UMB_OK);
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t *one = umb__occluder_depth_square(&occluder_depth, i % 2, i / 2);
        const uint32_t *two = umb__occluder_depth_square(&other, 4 + i % 2, 6 + i / 2);
        assert_int_equal(one == NULL, two == NULL);
        if (one != NULL) {
            assert_memory_equal(one, two, one[0] * sizeof *one);
        }
    }
    umb__occluder_depth_finish(&other);
    umb__occluder_depth_finish(&occluder_depth);
    assert_int_equal(decode_copy(bytes, size), UMB_E_CORRUPT); /* where none are expected */
    for (size_t length = plain_size; length < size; length += length < plain_size + 200 ? 1 : 31) {
        assert_int_equal(decode_occluder_depth(bytes, length, &other), UMB_E_CORRUPT);
        umb__occluder_depth_finish(&other);
    }
    size_t refused = 0, tried = 0;
    for (size_t at = plain_size; at < size; at += at < plain_size + 200 ? 1 : 37, tried++) {
        const uint8_t bit = (uint8_t)(1U << at % 8);
        bytes[at] ^= bit;
        refused += decode_occluder_depth(bytes, size, &other) != UMB_OK;
        umb__occluder_depth_finish(&other);
        bytes[at] ^= bit;
    }
    assert_in_range(refused, tried / 4, tried); /* what is left are other depths */
    free(bytes);
}

/* Key number n of the tests below. */
static void make_key(uint8_t key[UMB_ID_BYTES], unsigned n)
{
    memset(key, 0, UMB_ID_BYTES);
    key[0] = (uint8_t)n;
    key[31] = 0xab;
}

/* Sleeps longer than a tick of the clock of files, so that times of use differ. */
static void pause_a_little(void)
{
    const struct timespec pause = {0, 20000000};
    (void)nanosleep(&pause, NULL);
}

static void put(struct umbb_tile_cache *cache, unsigned n)
{
    /* Hard to compress, so that sizes are known. */
    static uint8_t bytes[100000];
    uint64_t bits = 88172645463325252ULL + n;
    for (size_t i = 0; i < sizeof bytes; i++) {
        bits ^= bits << 13;
        bits ^= bits >> 7;
        bits ^= bits << 17;
        bytes[i] = (uint8_t)bits;
    }
    uint8_t key[UMB_ID_BYTES];
    struct umb_error error;
    make_key(key, n);
    assert_int_equal(umbb_tile_cache_write(cache, key, bytes, sizeof bytes, &error), UMB_OK);
    pause_a_little();
}

static int has(struct umbb_tile_cache *cache, unsigned n)
{
    uint8_t key[UMB_ID_BYTES], *bytes;
    size_t size;
    struct umb_error error;
    make_key(key, n);
    assert_int_equal(umbb_tile_cache_read(cache, key, LEFT, &bytes, &size, &error), UMB_OK);
    const int found = bytes != NULL;
    assert_true(!found || size == 100000);
    free(bytes);
    return found;
}

static void the_cache_drops_what_was_used_longest_ago(void **state)
{
    (void)state;
    char folder[64];
    struct umb_error error;
    struct umbb_tile_cache cache;
    folder_make(folder);
    assert_int_equal(umbb_tile_cache_open(&cache, folder, 1050000, &error), UMB_OK);
    for (unsigned n = 0; n < 10; n++) {
        put(&cache, n);
    }
    assert_int_equal(folder_each(folder, NULL), 10);
    assert_true(has(&cache, 0));
    pause_a_little();
    put(&cache, 10); /* 1 and 2 go: a tenth is free again */
    assert_int_equal(has(&cache, 0), 1);
    assert_int_equal(has(&cache, 1), 0);
    assert_int_equal(has(&cache, 2), 0);
    assert_int_equal(has(&cache, 3), 1);
    assert_int_equal(has(&cache, 10), 1);
    assert_int_equal(folder_each(folder, NULL), 9);
    assert_in_range(cache.bytes, 900000, 1050000);
    umbb_tile_cache_close(&cache);

    /* A smaller limit must hold as soon as the folder is opened. */
    assert_int_equal(umbb_tile_cache_open(&cache, folder, 450000, &error), UMB_OK);
    assert_int_equal(folder_each(folder, NULL), 4);
    umbb_tile_cache_close(&cache);
    folder_remove(folder);
}

static void touch(const char *folder, const char *name, time_t age_s)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fclose(file);
    const struct timespec when[2] = {{time(NULL) - age_s, 0}, {time(NULL) - age_s, 0}};
    assert_int_equal(utimensat(AT_FDCWD, path, when, 0), 0);
}

#define NAME "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef.umbt"

static void opening_removes_old_temporaries_of_its_own_and_nothing_else(void **state)
{
    (void)state;
    char folder[64];
    struct umb_error error;
    struct umbb_tile_cache cache;
    folder_make(folder);
    touch(folder, ".tmp." NAME ".1234.0.abc", 3600);
    touch(folder, ".tmp." NAME ".1235.0.abc", 1);
    touch(folder, ".tmp.other.umb.1235.0.abc", 3600);
    touch(folder, "notes.txt", 3600);
    touch(folder, NAME, 3600);
    assert_int_equal(umbb_tile_cache_open(&cache, folder, 1 << 20, &error), UMB_OK);
    assert_int_equal(folder_each(folder, NULL), 4);
    umbb_tile_cache_close(&cache);
    folder_remove(folder);
}

static void a_result_under_another_name_is_refused(void **state)
{
    (void)state;
    char folder[64], from[256], to[256], text[UMB_ID_TEXT_SIZE];
    uint8_t key[UMB_ID_BYTES];
    struct umb_error error;
    struct umbb_tile_cache cache;
    folder_make(folder);
    assert_int_equal(umbb_tile_cache_open(&cache, folder, UINT64_MAX, &error), UMB_OK);
    put(&cache, 1);
    make_key(key, 1);
    umb_id_to_text(key, text);
    snprintf(from, sizeof from, "%s/%s.umbt", folder, text);
    make_key(key, 2);
    umb_id_to_text(key, text);
    snprintf(to, sizeof to, "%s/%s.umbt", folder, text);
    assert_int_equal(rename(from, to), 0);
    assert_int_equal(has(&cache, 2), 0);
    assert_int_equal(cache.damaged, 1);
    assert_int_equal(folder_each(folder, NULL), 0);
    umbb_tile_cache_close(&cache);
    folder_remove(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_results_are_equal_bytes_whatever_the_pool_held),
        cmocka_unit_test(first_occluders_are_kept_word_by_word_and_damage_is_refused),
        cmocka_unit_test(every_prefix_and_flipped_byte_is_refused_or_harmless),
        cmocka_unit_test(the_cache_drops_what_was_used_longest_ago),
        cmocka_unit_test(opening_removes_old_temporaries_of_its_own_and_nothing_else),
        cmocka_unit_test(a_result_under_another_name_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
