/* SPDX-License-Identifier: Apache-2.0 */
/* Pages from a hostile server must be refused with the page named, and the held pages must stay
 * valid. */
#include "partial_fixture.h"
#include "format/directory.h"
#include "seal_asset.h"
#include <zstd.h>

static const struct umb_query_settings one_tap = {.taps = 1};

static void expect_refused(struct umb_partial *partial, uint32_t page, const uint8_t *bytes,
                           size_t size, enum umb_status wanted, const char *words)
{
    struct umb_error error = {0};
    uint8_t *exact = malloc(size ? size : 1); /* ASan sees the first byte too many */
    memcpy(exact, bytes, size);
    const enum umb_status status = umb_partial_add(partial, page, exact, size, &error);
    free(exact);
    if (status != wanted || !strstr(error.message, words)) {
        fail_msg("page %u: %s: %s, wanted %s and '%s'", page, umb_status_name(status),
                 error.message, umb_status_name(wanted), words);
    }
    assert_false(umb_partial_has(partial, page) && wanted != UMB_E_EXISTS);
}

static void spoilt_swapped_repeated_and_unknown_pages_are_refused_by_number(void **state)
{
    (void)state;
    struct partial_fixture f;
    uint32_t length;
    char name[32];
    uint64_t seed = 5;
    partial_fixture_open(&f, 0);
    for (uint32_t page = 0; page < f.page_count; page++) {
        const uint8_t *stored = partial_page(&f, page, &length);
        uint8_t *copy = malloc(length);
        (void)snprintf(name, sizeof name, "page %u ", page);
        for (unsigned i = 0; i < 50; i++) {
            memcpy(copy, stored, length);
            copy[next_random(&seed) % length] ^= (uint8_t)(1 << i % 8);
            expect_refused(f.partial, page, copy, length, UMB_E_CORRUPT, name);
        }
        expect_refused(f.partial, page, stored, length - 1, UMB_E_CORRUPT, name);
        expect_refused(f.partial, page, stored, 0, UMB_E_CORRUPT, name);
        free(copy);
        uint32_t other_length;
        const uint8_t *other = partial_page(&f, (page + 1) % f.page_count, &other_length);
        expect_refused(f.partial, page, other, other_length, UMB_E_CORRUPT, name);
        partial_add(&f, page);
        expect_refused(f.partial, page, stored, length, UMB_E_EXISTS, name);
    }
    expect_refused(f.partial, f.page_count, f.file.data, 10, UMB_E_ARGUMENT, "page");
    partial_build(&f);
    assert_int_equal(partial_compare(&f, &one_tap, 5000, 0), 5000);
    partial_fixture_close(&f);
}

static void a_head_that_is_not_its_id_is_refused(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_error error;
    struct umb_partial *partial;
    partial_fixture_open(&f, 0);
    const size_t directory = UMB__HEAD_SIZE + umb__load64(f.file.data + UMB__HEAD_CANONICAL_LENGTH);
    const uint8_t id[UMB_ID_BYTES] = {1, 2, 3};
    struct umb_partial_options options = {.sha256 = &test_digest, .id = id};
    assert_int_equal(umb_partial_open(f.file.data, f.file.size, &options, &partial, &error),
                     UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "another asset"));
    options.id = NULL;
    for (size_t i = 0; i < UMB_ID_BYTES; i++) {
        uint8_t *hash = f.file.data + directory + UMB__BLOCK_HASH + i;
        *hash ^= 0x10;
        seal_asset(&f.file, false);
        assert_int_equal(umb_partial_open(f.file.data, f.file.size, &options, &partial, &error),
                         UMB_E_CORRUPT);
        assert_non_null(strstr(error.message, "id"));
        assert_null(partial);
        *hash ^= 0x10;
    }
    seal_asset(&f.file, false);
    const size_t head = (size_t)umb__load64(f.file.data + UMB__HEAD_LENGTH);
    for (size_t size = 0; size < head; size += size < 200 ? 1 : 101) {
        uint8_t *exact = malloc(size ? size : 1);
        memcpy(exact, f.file.data, size);
        assert_int_not_equal(umb_partial_open(exact, size, &options, &partial, &error), UMB_OK);
        free(exact);
    }
    partial_fixture_close(&f);
}

/* Where a page's entry stands in the file. */
static size_t entry_offset(const struct umb__head *head, uint32_t page)
{
    return (size_t)umb__block_offset(head, page / UMB__BLOCK_PAGES) +
           (size_t)(page % UMB__BLOCK_PAGES) * UMB__PAGE_ENTRY;
}

/* A link into a page whose block is not held yet is checked against these counts only. With a
 * position of 2^32 - 1 the number of nodes needed, one more, would overflow to 0. */
static void a_head_that_counts_more_nodes_than_have_numbers_is_refused(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_error error = {0};
    struct umb_partial *partial;
    const struct umb_partial_options options = {.sha256 = &test_digest};
    partial_fixture_open(&f, 0);
    uint8_t *at = f.file.data + UMB__HEAD_SIZE;
    while (umb__load32(at) != UMB__TAG_COUNTS) {
        at += UMB__ENTRY_HEAD + (umb__load64(at + 8) + 7) / 8 * 8;
    }
    umb__store64(at + UMB__ENTRY_HEAD + 8, UINT32_MAX); /* of level 4 */
    seal_asset(&f.file, true);
    assert_int_equal(umb_partial_open(f.file.data, f.file.size, &options, &partial, &error),
                     UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "counts: level 4"));
    partial_fixture_close(&f);
}

/* Replaces a page by other bytes; everything behind it moves. Makes all checksums right. In:
 * with_hash: true: also the page's hash, and with it the hash of the block and the asset's id. */
static void replace_page(struct bytes *file, uint32_t number, const uint8_t *raw, size_t raw_length,
                         bool with_hash)
{
    struct umb__head head;
    assert_int_equal(umb__head_parse(file->data, file->size, &head, NULL), UMB_OK);
    const struct umb__page_entry entry = umb__directory_load(&head, number);
    const size_t room = ZSTD_compressBound(raw_length);
    uint8_t *stored = malloc(room);
    const size_t length = ZSTD_compress(stored, room, raw, raw_length, 1);
    const size_t tail = (size_t)entry.offset + entry.stored_length;
    struct bytes made = {.data = malloc(file->size + room)};
    memcpy(made.data, file->data, (size_t)entry.offset);
    memcpy(made.data + entry.offset, stored, length);
    memcpy(made.data + entry.offset + length, file->data + tail, file->size - tail);
    made.size = made.capacity = file->size - entry.stored_length + length;
    if (number < UMB__BLOCK_PAGES && head.blocks_offset > 0) {
        head.blocks_offset += length - entry.stored_length;
        umb__store64(made.data + UMB__HEAD_BLOCKS, head.blocks_offset);
    }
    uint8_t *entry_at = made.data + entry_offset(&head, number);
    umb__store32(entry_at + UMB__PAGE_STORED_LENGTH, (uint32_t)length);
    umb__store32(entry_at + UMB__PAGE_RAW_LENGTH, (uint32_t)raw_length);
    umb__store64(entry_at + UMB__PAGE_CHECK, XXH3_64bits(stored, length));
    if (with_hash) {
        const void *part = raw;
        test_digest.digest(test_digest.user, &part, &raw_length, 1, entry_at + UMB__PAGE_HASH);
    }
    for (uint32_t later = number + 1; later < head.page_count; later++) {
        uint8_t *at_later = made.data + entry_offset(&head, later);
        umb__store64(at_later, umb__load64(at_later) - entry.stored_length + length);
    }
    umb__store64(made.data + UMB__HEAD_FILE_LENGTH, made.size);
    free(stored);
    bytes_finish(file);
    *file = made;
    seal_asset(file, with_hash);
}

/* Exchanges lit and shadowed for one uniform child in the page; false if there is none. */
static bool turn_child(const struct umb__page *page)
{
    for (uint32_t level = UMB_LEVEL_MAX; level > UMB_LEVEL_BRICK; level--) {
        for (uint32_t node = 0; node < page->node_count[level]; node++) {
            uint8_t *at = (uint8_t *)(uintptr_t)page->masks[level] + 2 * (size_t)node;
            for (unsigned c = 0; c < 8; c++) {
                const uint16_t mask = umb__load16(at);
                if (umb__mask_state(mask, c) < UMB__NODE_MIXED) {
                    umb__store16(at, (uint16_t)(mask ^ 1U << (2 * c)));
                    return true;
                }
            }
        }
    }
    return false;
}

/* The server can choose the directory's XXH3. Only its SHA-256 ties a page to the id. */
static void a_page_with_right_checks_and_a_wrong_hash_is_refused(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb__head head;
    unsigned forged = 0;
    partial_fixture_open(&f, 0);
    ZSTD_DCtx *zstd = ZSTD_createDCtx();
    for (uint32_t number = 0; number < f.page_count; number++) {
        struct bytes lie = {0};
        struct umb_sink sink = bytes_sink(&lie);
        assert_int_equal(sink.write(sink.user, f.file.data, f.file.size), UMB_OK);
        assert_int_equal(umb__head_parse(lie.data, lie.size, &head, NULL), UMB_OK);
        struct umb__page_entry entry = umb__directory_load(&head, number);
        umb__directory_links(&head, &entry, NULL);
        uint8_t *raw = malloc(entry.raw_length);
        struct umb__page page;
        assert_int_equal(umb__page_expand(zstd, lie.data + entry.offset, &entry, raw, NULL),
                         UMB_OK);
        assert_int_equal(umb__page_open(raw, &entry, &page, NULL), UMB_OK);
        if (turn_child(&page)) {
            uint8_t id[UMB_ID_BYTES];
            memcpy(id, head.id, sizeof id);
            replace_page(&lie, number, raw, entry.raw_length, false);
            struct partial_fixture g = {.file = lie, .partial = partial_open(&lie, 0)};
            assert_memory_equal(umb_partial_head(g.partial) + UMB__HEAD_ID, id, sizeof id);
            uint32_t length;
            const uint8_t *stored = partial_page(&g, number, &length);
            expect_refused(g.partial, number, stored, length, UMB_E_CORRUPT,
                           "not what its hash says");
            umb_partial_close(g.partial);
            forged++;
        }
        free(raw);
        bytes_finish(&lie);
    }
    assert_true(forged > f.page_count / 2);
    ZSTD_freeDCtx(zstd);
    partial_fixture_close(&f);
}

/* Rewrites the page that has links to others so that one link is wrong and all checksums are right.
 * Returns the page's number. */
static uint32_t spoil_link(struct bytes *file, uint32_t *target)
{
    struct umb__head head;
    struct umb_error error = {0};
    assert_int_equal(umb__head_parse(file->data, file->size, &head, &error), UMB_OK);
    ZSTD_DCtx *zstd = ZSTD_createDCtx();
    for (uint32_t number = head.page_count; number-- > 0;) {
        struct umb__page_entry entry = umb__directory_load(&head, number);
        umb__directory_links(&head, &entry, NULL);
        uint8_t *raw = malloc(entry.raw_length);
        struct umb__page page;
        assert_int_equal(umb__page_expand(zstd, file->data + entry.offset, &entry, raw, &error),
                         UMB_OK);
        assert_int_equal(umb__page_open(raw, &entry, &page, &error), UMB_OK);
        uint32_t level = UMB_LEVEL_MAX;
        while (level > UMB_LEVEL_BRICK && page.external_count[level] == 0) {
            level--;
        }
        if (level == UMB_LEVEL_BRICK) {
            free(raw);
            continue;
        }
        struct umb__page_others others = umb__page_others(&page, level), last = others;
        for (uint32_t i = 0; i < page.external_count[level]; i++) {
            last = others;
            (void)umb__page_others_next(&others);
        }
        *target = others.place.page;
        /* Of another level, or beyond this one's. */
        const uint32_t position = umb__directory_load(&head, *target).records - 1;
        const bool same = !last.first && last.place.page == *target;
        const uint8_t *rest = others.position_at;
        uint8_t *lie = malloc(entry.raw_length + UMB__NUMBER_BYTES_MAX);
        const size_t before = (size_t)(last.position_at - raw);
        memcpy(lie, raw, before);
        uint8_t *end =
            umb__put_number(lie + before, position - (same ? last.place.position + 1 : 0));
        memcpy(end, rest, entry.raw_length - (size_t)(rest - raw));
        const size_t raw_length = (size_t)(end - lie) + entry.raw_length - (size_t)(rest - raw);
        free(raw);
        raw = lie;
        replace_page(file, number, raw, raw_length, true);
        free(raw);
        ZSTD_freeDCtx(zstd);
        return number;
    }
    fail_msg("no page refers to another");
    return 0;
}

static void links_to_nodes_that_are_not_there_are_refused_by_whoever_comes_second(void **state)
{
    (void)state;
    struct partial_fixture f;
    uint32_t target = 0, length;
    char name[32];
    partial_fixture_open(&f, 0);
    const uint32_t liar = spoil_link(&f.file, &target);
    for (int liar_first = 0; liar_first < 2; liar_first++) {
        const uint32_t order[2] = {liar_first ? liar : target, liar_first ? target : liar};
        umb_partial_close(f.partial);
        f.partial = partial_open(&f.file, 0);
        const uint8_t *first = partial_page(&f, order[0], &length);
        struct umb_error error = {0};
        (void)snprintf(name, sizeof name, "page %u ", order[0]);
        if (umb_partial_add(f.partial, order[0], first, length, &error) != UMB_OK) {
            assert_non_null(strstr(error.message, name)); /* found from the directory alone */
            continue;
        }
        const uint8_t *second = partial_page(&f, order[1], &length);
        (void)snprintf(name, sizeof name, "page %u ", order[1]);
        expect_refused(f.partial, order[1], second, length, UMB_E_CORRUPT, name);
        partial_build(&f); /* and what is there still answers */
    }
    partial_fixture_close(&f);
}

/* Fails every allocation from the n-th on. */
struct failing {
    size_t left;
};

static void *failing_resize(void *user, void *block, size_t bytes)
{
    struct failing *failing = user;
    if (bytes == 0) {
        free(block);
        return NULL;
    }
    if (failing->left == 0) {
        return NULL;
    }
    failing->left--;
    return realloc(block, bytes);
}

static void memory_that_runs_out_is_an_error_and_nothing_else(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_error error;
    partial_fixture_open(&f, 0);
    for (size_t n = 0;; n += n < 40 ? 1 : 7) {
        struct failing failing = {.left = n};
        const struct umb_alloc alloc = {failing_resize, &failing};
        const struct umb_partial_options options = {.sha256 = &test_digest, .alloc = &alloc};
        struct umb_partial *partial;
        enum umb_status status =
            umb_partial_open(f.file.data, f.file.size, &options, &partial, &error);
        for (uint32_t page = 0; page < 3 && status == UMB_OK; page++) {
            uint32_t length;
            const uint8_t *stored = partial_page(&f, page, &length);
            status = umb_partial_add(partial, page, stored, length, &error);
        }
        if (status == UMB_OK) {
            status = umb_partial_build(partial, &error);
        }
        for (uint32_t page = 3; page < 6 && status == UMB_OK; page++) { /* Others in their place */
            uint32_t length;
            const uint8_t *stored = partial_page(&f, page, &length);
            umb_partial_drop(partial, page - 2);
            status = umb_partial_add(partial, page, stored, length, &error);
            status = status == UMB_OK ? umb_partial_build(partial, &error) : status;
        }
        umb_partial_close(partial);
        if (failing.left > 0) {
            assert_int_equal(status, UMB_OK);
            break;
        }
        assert_true(n < 2000);
        assert_true(status == UMB_E_NO_MEMORY || status == UMB_E_TOO_LARGE || status == UMB_OK);
    }
    partial_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spoilt_swapped_repeated_and_unknown_pages_are_refused_by_number),
        cmocka_unit_test(a_page_with_right_checks_and_a_wrong_hash_is_refused),
        cmocka_unit_test(a_head_that_is_not_its_id_is_refused),
        cmocka_unit_test(a_head_that_counts_more_nodes_than_have_numbers_is_refused),
        cmocka_unit_test(links_to_nodes_that_are_not_there_are_refused_by_whoever_comes_second),
        cmocka_unit_test(memory_that_runs_out_is_an_error_and_nothing_else),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
