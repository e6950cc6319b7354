/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Tests the oracle's reader with the real writer: files of random voxels, packed and mapped,
 * compared at every voxel with the array they were made from; and wrong files, which the oracle
 * must refuse.
 *
 * The harness packs with a substitute for SHA-256. reseal() replaces its hashes by the real page
 * hashes and the real id, by docs/reference/umb-format.md section 4, as the oracle checks them.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <inttypes.h>
#include <openssl/evp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "make_asset.h"
#include "oracle_reader.h"

enum {
    ID_AT = 48,
    CHECK_AT = 120,
    BLOCK_AT = 128,
    ENTRY_SIZE = 64,
    BLOCK_PAGES = 32,
    BLOCK_ENTRY_SIZE = 48,
    POOL_BRICKS = 32, /* bricks that stand in many places, so that merging has work */
};

static const double origin[3] = {431000.25, -17.5, 6200000.0};

/* Voxels of all frusta, a byte each. */
struct grid {
    uint32_t log2_size, frustum_count;
    uint8_t *lit;
    uint64_t random;
    uint64_t pool[POOL_BRICKS][8];
};

static size_t voxel_index(const struct grid *grid, uint32_t frustum, const uint32_t at[3])
{
    uint32_t n = grid->log2_size;
    return ((((size_t)frustum << n | at[2]) << n | at[1]) << n) | at[0];
}

static int grid_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const struct grid *grid = user;
    const uint32_t at[3] = {x, y, z};
    return grid->lit[voxel_index(grid, frustum, at)];
}

/* Draws random slices; half of the bricks have runs of equal slices. */
static void random_brick(struct grid *grid, uint64_t slices[8])
{
    int runs = (next_random(&grid->random) >> 40) & 1;
    for (int z = 0; z < 8; z++) {
        int repeat = z > 0 && runs && (next_random(&grid->random) >> 40) % 3 != 0;
        slices[z] = repeat ? slices[z - 1] : next_random(&grid->random);
    }
}

static void fill_brick(struct grid *grid, uint32_t frustum, const uint32_t at[3])
{
    uint64_t own[8];
    uint64_t choice = next_random(&grid->random) >> 40;
    const uint64_t *slices = grid->pool[choice / 2 % POOL_BRICKS];
    if (choice % 2 == 0) {
        random_brick(grid, own);
        slices = own;
    }
    for (uint32_t i = 0; i < 512; i++) {
        const uint32_t voxel[3] = {at[0] + i % 8, at[1] + i / 8 % 8, at[2] + i / 64};
        grid->lit[voxel_index(grid, frustum, voxel)] = (slices[i / 64] >> (i % 64)) & 1;
    }
}

/* Draws a cube of 2^level voxels: uniform, or eight children. The whole frustum is always split. */
static void fill_cube(struct grid *grid, uint32_t frustum, uint32_t level, const uint32_t at[3])
{
    uint64_t choice = next_random(&grid->random) >> 40;
    if (level < grid->log2_size && choice % 4 == 0) {
        uint32_t side = (uint32_t)1 << level;
        for (uint32_t i = 0; i < side * side; i++) {
            const uint32_t row[3] = {at[0], at[1] + i % side, at[2] + i / side};
            memset(grid->lit + voxel_index(grid, frustum, row), (int)(choice / 4 % 2), side);
        }
    } else if (level == 3) {
        fill_brick(grid, frustum, at);
    } else {
        uint32_t half = (uint32_t)1 << (level - 1);
        for (uint32_t c = 0; c < 8; c++) {
            const uint32_t child[3] = {at[0] + (c & 1) * half, at[1] + (c >> 1 & 1) * half,
                                       at[2] + (c >> 2) * half};
            fill_cube(grid, frustum, level - 1, child);
        }
    }
}

static void make_grid(struct grid *grid, uint32_t log2_size, uint32_t frustum_count, uint64_t seed)
{
    const uint32_t zero[3] = {0, 0, 0};
    *grid = (struct grid){.log2_size = log2_size, .frustum_count = frustum_count, .random = seed};
    grid->lit = calloc((size_t)frustum_count << (3 * log2_size), 1);
    assert_non_null(grid->lit);
    for (int i = 0; i < POOL_BRICKS; i++) {
        random_brick(grid, grid->pool[i]);
    }
    for (uint32_t i = 0; i < frustum_count; i++) {
        fill_cube(grid, i, log2_size, zero);
    }
}

static uint64_t number_at(const uint8_t *bytes, uint32_t width)
{
    uint64_t value = 0;
    for (uint32_t i = 0; i < width; i++) {
        value |= (uint64_t)bytes[i] << (8 * i);
    }
    return value;
}

static void put_number(uint8_t *bytes, uint64_t value)
{
    for (uint32_t i = 0; i < 8; i++) {
        bytes[i] = (uint8_t)(value >> (8 * i));
    }
}

static void sha256(const void *bytes, size_t size, uint8_t out[32])
{
    assert_int_equal(EVP_Digest(bytes, size, out, NULL, EVP_sha256(), NULL), 1);
}

/* Makes the head's checksum right again. */
static void reseal_check(struct bytes *file)
{
    uint8_t both[16];
    put_number(both, XXH3_64bits(file->data, CHECK_AT));
    put_number(both + 8, XXH3_64bits(file->data + BLOCK_AT,
                                     (size_t)number_at(file->data + 24, 8) - BLOCK_AT));
    put_number(file->data + CHECK_AT, XXH3_64bits(both, sizeof both));
}

/* Bytes of all blocks before a block. */
static uint64_t end_before(const struct bytes *file, uint32_t block)
{
    const uint8_t *table = file->data + BLOCK_AT + number_at(file->data + 32, 8);
    return block == 0 ? 0 : number_at(table + (uint64_t)(block - 1) * BLOCK_ENTRY_SIZE + 8, 8);
}

/* Where a block begins: the first one follows the head, all others stand together. */
static uint8_t *block_of(const struct bytes *file, uint32_t block)
{
    return file->data + (block == 0 ? number_at(file->data + 24, 8)
                                    : number_at(file->data + 88, 8) + end_before(file, block) -
                                          end_before(file, 1));
}

/* Writes the real hash of a page into its entry. */
static void reseal_page(const struct bytes *file, uint8_t *entry)
{
    size_t stored = (size_t)number_at(entry + 8, 4), size = (size_t)number_at(entry + 12, 4);
    uint8_t *page = malloc(size);
    assert_non_null(page);
    assert_int_equal(ZSTD_decompress(page, size, file->data + number_at(entry, 8), stored), size);
    sha256(page, size, entry + 32);
    free(page);
}

/* Writes the real hashes of all pages and blocks, the real id, and the checksums that cover
 * them. */
static void reseal(struct bytes *file)
{
    size_t block = (size_t)number_at(file->data + 32, 8);
    uint32_t pages = (uint32_t)number_at(file->data + 80, 4);
    uint32_t blocks = (uint32_t)number_at(file->data + 40, 4);
    size_t hashed = block + (size_t)blocks * 32;
    uint8_t *identity = malloc(hashed);
    assert_non_null(identity);
    memcpy(identity, file->data + BLOCK_AT, block);
    for (uint32_t b = 0; b < blocks; b++) {
        uint8_t *entries = block_of(file, b);
        const size_t size = (size_t)(end_before(file, b + 1) - end_before(file, b));
        uint8_t *stated = file->data + BLOCK_AT + block + (size_t)b * BLOCK_ENTRY_SIZE;
        uint32_t rest = pages - b * BLOCK_PAGES, count = rest < BLOCK_PAGES ? rest : BLOCK_PAGES;
        const size_t links = size - (size_t)count * ENTRY_SIZE;
        uint8_t *hashed_too = malloc(34 * (size_t)count + links);
        assert_non_null(hashed_too);
        for (uint32_t i = 0; i < count; i++) {
            const uint8_t *entry = entries + (size_t)i * ENTRY_SIZE;
            reseal_page(file, entries + (size_t)i * ENTRY_SIZE);
            memcpy(hashed_too + 32 * (size_t)i, entry + 32, 32);
            memcpy(hashed_too + 32 * (size_t)count + 2 * (size_t)i, entry + 26, 2);
        }
        memcpy(hashed_too + 34 * (size_t)count, entries + (size_t)count * ENTRY_SIZE, links);
        put_number(stated, XXH3_64bits(entries, size));
        sha256(hashed_too, 34 * (size_t)count + links, stated + 16);
        free(hashed_too);
        memcpy(identity + block + (size_t)b * 32, stated + 16, 32);
    }
    sha256(identity, hashed, file->data + ID_AT);
    free(identity);
    reseal_check(file);
}

static struct bytes pack(const struct grid *grid)
{
    const struct voxels voxels = {grid_lit, grid, grid->log2_size, grid->frustum_count};
    struct bytes file = make_packed(&voxels, 0.25, origin);
    reseal(&file);
    return file;
}

static void open_good(struct oracle *oracle, const struct bytes *file)
{
    char error[ORACLE_ERROR_SIZE];
    if (!oracle_open(oracle, file->data, file->size, error)) {
        fail_msg("refused: %s", error);
    }
}

static void compare_all(const struct grid *grid, const struct oracle *oracle)
{
    uint32_t side = (uint32_t)1 << grid->log2_size;
    assert_int_equal(oracle->frustum_count, grid->frustum_count);
    for (uint32_t f = 0; f < grid->frustum_count; f++) {
        assert_int_equal(oracle->frusta[f].n, grid->log2_size);
        for (size_t i = 0; i < (size_t)1 << (3 * grid->log2_size); i++) {
            uint32_t x = (uint32_t)i % side, y = (uint32_t)(i / side) % side;
            uint32_t z = (uint32_t)(i / side / side);
            int wanted = grid_lit(grid, f, x, y, z);
            int found = oracle_voxel(oracle, f, x, y, z);
            if (found != wanted) {
                fail_msg("frustum %" PRIu32 " voxel %" PRIu32 ",%" PRIu32 ",%" PRIu32
                         ": %d, not %d",
                         f, x, y, z, found, wanted);
            }
        }
    }
}

static void check_both_forms(uint32_t log2_size, uint32_t frustum_count, uint64_t seed)
{
    struct grid grid;
    struct oracle oracle;
    print_message("seed %" PRIu64 "\n", seed);
    make_grid(&grid, log2_size, frustum_count, seed);
    struct bytes packed = pack(&grid);
    struct bytes mapped = make_mapped(&packed);
    open_good(&oracle, &packed);
    assert_int_equal(oracle.form, ORACLE_PACKED);
    assert_memory_equal(oracle.origin, origin, sizeof origin);
    compare_all(&grid, &oracle);
    oracle_close(&oracle);
    open_good(&oracle, &mapped);
    assert_int_equal(oracle.form, ORACLE_MAPPED);
    assert_memory_equal(oracle.id, packed.data + ID_AT, 32);
    compare_all(&grid, &oracle);
    oracle_close(&oracle);
    bytes_finish(&mapped);
    bytes_finish(&packed);
    free(grid.lit);
}

static void five_lights_of_64_voxels_are_read_back_equal(void **state)
{
    (void)state;
    check_both_forms(6, 5, 20140101);
}

static void three_lights_of_128_voxels_are_read_back_equal(void **state)
{
    (void)state;
    check_both_forms(7, 3, 20140102);
}

static void two_lights_of_256_voxels_are_read_back_equal(void **state)
{
    (void)state;
    check_both_forms(8, 2, 20140103);
}

static void uniform_lights_are_read_back_equal(void **state)
{
    (void)state;
    struct grid grid = {.log2_size = 6, .frustum_count = 2};
    size_t cube = (size_t)1 << 18;
    grid.lit = calloc(2, cube);
    assert_non_null(grid.lit);
    memset(grid.lit + cube, 1, cube);
    struct bytes packed = pack(&grid);
    struct bytes mapped = make_mapped(&packed);
    const struct bytes *const files[2] = {&packed, &mapped};
    for (int i = 0; i < 2; i++) {
        struct oracle oracle;
        open_good(&oracle, files[i]);
        assert_int_equal(oracle.frusta[0].root_state, 0);
        assert_int_equal(oracle.frusta[1].root_state, 1);
        compare_all(&grid, &oracle);
        oracle_close(&oracle);
    }
    bytes_finish(&mapped);
    bytes_finish(&packed);
    free(grid.lit);
}

static void voxels_outside_the_frustum_have_no_answer(void **state)
{
    (void)state;
    struct grid grid;
    struct oracle oracle;
    make_grid(&grid, 6, 1, 7);
    struct bytes packed = pack(&grid);
    open_good(&oracle, &packed);
    assert_int_equal(oracle_voxel(&oracle, 0, 64, 0, 0), -1);
    assert_int_equal(oracle_voxel(&oracle, 0, 0, UINT32_MAX, 0), -1);
    assert_int_equal(oracle_voxel(&oracle, 0, 0, 0, 64), -1);
    assert_int_equal(oracle_voxel(&oracle, 1, 0, 0, 0), -1);
    oracle_close(&oracle);
    bytes_finish(&packed);
    free(grid.lit);
}

/* Opens bytes that must be refused; the message must contain `reason`. */
static void assert_refused(const uint8_t *bytes, size_t size, const char *reason)
{
    struct oracle oracle;
    char error[ORACLE_ERROR_SIZE];
    if (oracle_open(&oracle, bytes, size, error)) {
        fail_msg("accepted; expected a refusal that says '%s'", reason);
    }
    if (strstr(error, reason) == NULL) {
        fail_msg("refused with '%s', expected '%s'", error, reason);
    }
    oracle_close(&oracle);
}

static struct bytes small_file(void)
{
    struct grid grid;
    make_grid(&grid, 6, 2, 99);
    struct bytes packed = pack(&grid);
    free(grid.lit);
    return packed;
}

/* Makes a block's checksum right, and then the head's. */
static void reseal_block_check(struct bytes *file)
{
    uint8_t *stated = file->data + BLOCK_AT + number_at(file->data + 32, 8);
    size_t pages = (size_t)number_at(file->data + 80, 4);
    assert_true(pages <= BLOCK_PAGES);
    put_number(stated, XXH3_64bits(block_of(file, 0), pages * ENTRY_SIZE));
    reseal_check(file);
}

static void reader_refuses_hashes_that_are_not_those_of_pages_or_blocks(void **state)
{
    (void)state;
    struct bytes file = small_file();
    uint8_t *hash = block_of(&file, 0) + 32;
    hash[5] ^= 0x10;
    assert_refused(file.data, file.size, "page 0: SHA-256 differs");
    hash[5] ^= 0x10;
    hash[-16] ^= 0x01; /* XXH3 of the stored bytes */
    assert_refused(file.data, file.size, "page 0: XXH3");
    hash[-16] ^= 0x01;
    uint8_t *block = file.data + BLOCK_AT + number_at(file.data + 32, 8);
    block[0] ^= 0x01;
    reseal_check(&file);
    assert_refused(file.data, file.size, "block 0: XXH3");
    reseal_block_check(&file);
    block[8 + 31] ^= 0x01;
    reseal_check(&file);
    assert_refused(file.data, file.size, "id: ");
    bytes_finish(&file);
}

static void reader_refuses_id_that_is_not_the_contents(void **state)
{
    (void)state;
    struct bytes file = small_file();
    file.data[ID_AT + 31] ^= 0x80;
    reseal_check(&file);
    assert_refused(file.data, file.size, "id: ");
    bytes_finish(&file);
}

/* The writer's digest is a substitute, so a file that was not resealed must be refused. */
static void reader_refuses_hashes_of_another_kind(void **state)
{
    (void)state;
    struct grid grid;
    make_grid(&grid, 6, 1, 5);
    const struct voxels voxels = {grid_lit, &grid, grid.log2_size, grid.frustum_count};
    struct bytes file = make_packed(&voxels, 0.25, origin);
    assert_refused(file.data, file.size, "SHA-256 differs");
    bytes_finish(&file);
    free(grid.lit);
}

static void reader_refuses_changed_block_under_a_good_check(void **state)
{
    (void)state;
    struct bytes file = small_file();
    file.data[BLOCK_AT + 16] ^= 0x01; /* last bit of the origin */
    reseal_check(&file);
    assert_refused(file.data, file.size, "id: ");
    bytes_finish(&file);
}

static void reader_refuses_every_flipped_bit(void **state)
{
    (void)state;
    struct bytes packed = small_file();
    struct bytes mapped = make_mapped(&packed);
    const struct bytes *const files[2] = {&packed, &mapped};
    uint64_t random = 31;
    for (int i = 0; i < 2; i++) {
        size_t head = (size_t)number_at(files[i]->data + 24, 8);
        for (size_t k = 0; k < head + 500; k++) {
            /* The whole head first, then anywhere. */
            size_t at = k < head ? k : (size_t)(next_random(&random) >> 20) % files[i]->size;
            uint8_t bit = (uint8_t)(1u << (next_random(&random) >> 61));
            files[i]->data[at] ^= bit;
            assert_refused(files[i]->data, files[i]->size, "");
            files[i]->data[at] ^= bit;
        }
    }
    bytes_finish(&mapped);
    bytes_finish(&packed);
}

static void reader_refuses_every_prefix(void **state)
{
    (void)state;
    struct bytes packed = small_file();
    for (size_t size = 0; size < packed.size; size += size < 256 ? 1 : 97) {
        uint8_t *exact = malloc(size + 1); /* so that ASan sees the end */
        assert_non_null(exact);
        memcpy(exact + 1, packed.data, size);
        assert_refused(exact + 1, size, "");
        free(exact);
    }
    bytes_finish(&packed);
}

static void reader_refuses_another_major_version_and_takes_any_minor(void **state)
{
    (void)state;
    struct oracle oracle;
    struct bytes file = small_file();
    file.data[10] = 77;
    reseal_check(&file);
    open_good(&oracle, &file);
    oracle_close(&oracle);
    file.data[8] = 1;
    reseal_check(&file);
    assert_refused(file.data, file.size, "major version: 1");
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(five_lights_of_64_voxels_are_read_back_equal),
        cmocka_unit_test(three_lights_of_128_voxels_are_read_back_equal),
        cmocka_unit_test(two_lights_of_256_voxels_are_read_back_equal),
        cmocka_unit_test(uniform_lights_are_read_back_equal),
        cmocka_unit_test(voxels_outside_the_frustum_have_no_answer),
        cmocka_unit_test(reader_refuses_hashes_that_are_not_those_of_pages_or_blocks),
        cmocka_unit_test(reader_refuses_id_that_is_not_the_contents),
        cmocka_unit_test(reader_refuses_hashes_of_another_kind),
        cmocka_unit_test(reader_refuses_changed_block_under_a_good_check),
        cmocka_unit_test(reader_refuses_every_flipped_bit),
        cmocka_unit_test(reader_refuses_every_prefix),
        cmocka_unit_test(reader_refuses_another_major_version_and_takes_any_minor),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
