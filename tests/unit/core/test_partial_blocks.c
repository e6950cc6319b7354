/* SPDX-License-Identifier: Apache-2.0 */
/* A directory of several blocks: each is fetched when pages of it matter, and verified by
 * itself. */
#include "partial_fixture.h"
#include "seal_asset.h"

static const struct umb_query_settings one_tap = {.taps = 1};

static struct partial_fixture f; /* of two blocks; each test leaves its file as it was */

static int open_fixture(void **state)
{
    (void)state;
    partial_fixture_open_size(&f, 9, 0);
    return f.page_count > UMB__BLOCK_PAGES ? 0 : -1;
}

static int close_fixture(void **state)
{
    (void)state;
    partial_fixture_close(&f);
    return 0;
}

/* Opens from the head alone, or with the first block behind it. */
static void reopen(bool with_block)
{
    const struct umb_partial_options options = {.sha256 = &test_digest};
    const size_t head = (size_t)umb__load64(f.file.data + UMB__HEAD_LENGTH);
    struct umb_error error = {0};
    struct umb_file_head facts;
    assert_int_equal(umb_file_read_head(f.file.data, UMB_FILE_HEAD_BYTES, &facts, &error), UMB_OK);
    const size_t front = (size_t)facts.open_bytes;
    assert_int_equal(front, head + umb__load32(f.file.data + UMB__HEAD_FIRST_BLOCK));
    assert_true(front >= head + (size_t)UMB__BLOCK_PAGES * UMB__PAGE_ENTRY);
    umb_partial_close(f.partial);
    if (umb_partial_open(f.file.data, with_block ? front : head, &options, &f.partial, &error) !=
        UMB_OK) {
        fail_msg("%s", error.message);
    }
}

static enum umb_status add_block(uint32_t block, struct umb_error *error)
{
    uint64_t offset;
    uint32_t length;
    umb_partial_locate_block(f.partial, block, &offset, &length);
    uint8_t *exact = malloc(length); /* ASan sees the first byte too many */
    memcpy(exact, f.file.data + offset, length);
    enum umb_status status = umb_partial_add_block(f.partial, block, exact, length, error);
    free(exact);
    return status;
}

static void expect_block(uint32_t block, enum umb_status wanted, const char *words)
{
    struct umb_error error = {0};
    const enum umb_status status = add_block(block, &error);
    if (status != wanted || (wanted != UMB_OK && !strstr(error.message, words))) {
        fail_msg("block %u: %s: %s", block, umb_status_name(status), error.message);
    }
}

static void blocks_and_pages_come_as_a_view_needs_them(void **state)
{
    (void)state;
    struct umb_partial_stats stats;
    struct umb_error error = {0};
    const struct umb_partial_view view = {.light = UINT32_MAX};
    for (int with_block = 0; with_block < 2; with_block++) {
        reopen(with_block != 0);
        for (;;) {
            uint32_t blocks[64], pages[64];
            partial_build(&f);
            (void)partial_compare(&f, &one_tap, 300, 0);
            assert_int_equal(umb_partial_want(f.partial, &view, 0, &error), UMB_OK);
            const size_t block_count = umb_partial_missing_blocks(f.partial, 0, blocks, 64);
            const size_t page_count = umb_partial_missing(f.partial, pages, 64, 0);
            for (size_t i = 0; i < page_count; i++) { /* only such as can be asked for */
                partial_add(&f, pages[i]);
            }
            for (size_t i = 0; i < block_count; i++) {
                expect_block(blocks[i], UMB_OK, "");
            }
            if (block_count + page_count == 0) {
                break;
            }
        }
        umb_partial_get_stats(f.partial, &stats);
        assert_int_equal(stats.pages_held, f.page_count);
        assert_int_equal(stats.blocks_held, stats.block_count);
        assert_int_equal(partial_compare(&f, &one_tap, 20000, 0), 20000);
    }
}

static void a_page_waits_for_its_block(void **state)
{
    (void)state;
    struct umb_error error = {0};
    uint64_t offset = 1;
    uint32_t length = 1, list[64];
    struct umb_partial_stats stats;
    reopen(true);
    (void)umb_partial_locate(f.partial, UMB__BLOCK_PAGES, &offset, &length);
    assert_true(offset == 0 && length == 0);
    assert_int_equal(umb_partial_add(f.partial, UMB__BLOCK_PAGES, f.file.data, 100, &error),
                     UMB_E_STATE);
    assert_non_null(strstr(error.message, "page 32 of the file: block 1 of the directory"));
    assert_int_equal(umb_partial_missing_blocks(f.partial, 0, list, 64), 0); /* nothing is wanted */
    umb_partial_get_stats(f.partial, &stats);
    assert_int_equal(umb_partial_missing_blocks(f.partial, 1, list, 64), stats.block_count - 1);
    assert_int_equal(list[0], 1);
}

static void spoilt_repeated_and_unknown_blocks_are_refused_by_number(void **state)
{
    (void)state;
    uint64_t offset, seed = 11;
    uint32_t length;
    reopen(true);
    umb_partial_locate_block(f.partial, 1, &offset, &length);
    for (unsigned i = 0; i < 200; i++) {
        uint8_t *byte = f.file.data + offset + next_random(&seed) % length;
        *byte ^= (uint8_t)(1 << i % 8);
        expect_block(1, UMB_E_CORRUPT, "block 1");
        *byte ^= (uint8_t)(1 << i % 8);
    }
    struct umb_error error = {0};
    assert_int_equal(
        umb_partial_add_block(f.partial, 1, f.file.data + offset - length, length, &error),
        UMB_E_CORRUPT);
    assert_int_equal(umb_partial_add_block(f.partial, 1, f.file.data + offset, 64, &error),
                     UMB_E_CORRUPT);
    assert_int_equal(umb_partial_add_block(f.partial, 1000, f.file.data, 64, &error),
                     UMB_E_ARGUMENT);
    expect_block(0, UMB_E_EXISTS, "block 0");
    expect_block(1, UMB_OK, "");
}

/* A server may send any lengths and checksums, but cannot change a hash. */
static void a_block_with_right_checks_and_wrong_hashes_is_refused(void **state)
{
    (void)state;
    uint64_t offset;
    uint32_t length;
    umb_partial_locate_block(f.partial, 1, &offset, &length);
    uint8_t *entry = f.file.data + offset + length - UMB__PAGE_ENTRY; /* the last page's */
    entry[UMB__PAGE_HASH + 3] ^= 4;
    seal_asset(&f.file, false);
    reopen(true);
    expect_block(1, UMB_E_CORRUPT, "block 1 is not what its hash says");
    entry[UMB__PAGE_HASH + 3] ^= 4;
    umb__store64(entry, umb__load64(entry) + 1);
    seal_asset(&f.file, false);
    reopen(true);
    expect_block(1, UMB_E_CORRUPT, "is not where it should be");
    umb__store64(entry, umb__load64(entry) - 1);
    umb__store64(f.file.data + UMB__HEAD_BLOCKS, f.file.size - 100);
    seal_asset(&f.file, false);
    struct umb_partial *partial;
    struct umb_error error = {0};
    const struct umb_partial_options options = {.sha256 = &test_digest};
    assert_int_equal(umb_partial_open(f.file.data, f.file.size, &options, &partial, &error),
                     UMB_E_CORRUPT);
    umb__store64(f.file.data + UMB__HEAD_BLOCKS, offset);
    seal_asset(&f.file, false);
}

static void a_saved_file_keeps_the_blocks_it_has(void **state)
{
    (void)state;
    struct bytes saved = {0};
    struct umb_sink sink = bytes_sink(&saved);
    struct umb_error error = {0};
    struct umb_partial_stats stats;
    uint64_t offset;
    uint32_t length;
    reopen(false);
    expect_block(1, UMB_OK, "");
    partial_add(&f, UMB__BLOCK_PAGES);
    partial_add(&f, UMB__BLOCK_PAGES + 1);
    assert_int_equal(umb_partial_save(f.partial, &sink, &error), UMB_OK);
    umb_partial_close(f.partial);
    const struct umb_partial_options options = {.sha256 = &test_digest};
    if (umb_partial_open_saved(saved.data, saved.size, &options, &f.partial, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb_partial_get_stats(f.partial, &stats);
    assert_int_equal(stats.blocks_held, 1);
    assert_int_equal(stats.pages_held, 2);
    (void)umb_partial_locate(f.partial, 0, &offset, &length);
    assert_int_equal(length, 0);
    /* A page whose block the file leaves out. */
    const size_t numbers = 40 + (size_t)umb__load64(saved.data + 16);
    umb__store32(saved.data + numbers + 4, 5);
    umb__store64(saved.data + 24, XXH3_64bits(saved.data + 32, numbers + 12 - 32));
    struct umb_partial *other;
    assert_int_equal(umb_partial_open_saved(saved.data, saved.size, &options, &other, &error),
                     UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "page 5"));
    bytes_finish(&saved);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_and_pages_come_as_a_view_needs_them),
        cmocka_unit_test(a_page_waits_for_its_block),
        cmocka_unit_test(spoilt_repeated_and_unknown_blocks_are_refused_by_number),
        cmocka_unit_test(a_block_with_right_checks_and_wrong_hashes_is_refused),
        cmocka_unit_test(a_saved_file_keeps_the_blocks_it_has),
    };
    return cmocka_run_group_tests(tests, open_fixture, close_fixture);
}
