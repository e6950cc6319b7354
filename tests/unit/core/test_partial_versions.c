/* SPDX-License-Identifier: Apache-2.0 */
/* Pages of one version of an asset serve the next one: those with the same hash are held, and all
 * answers, bounds and marks are those of a partial asset to which the same pages were added. */
#include "partial_fixture.h"

#include "partial/partial_parts.h"
#include "seal_asset.h"

#include <zstd.h>

enum {
    LOG2_SIZE = 8,
    PAGE_BYTES = 1024,
    VERSIONS = 3,
    POINTS = 500,
};

static struct bytes files[VERSIONS]; /* The third is the first again */

/* partial_scene with another cloud over some ground. In: user: unsigned, number of the version. */
static int edited_scene(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const unsigned version = *(const unsigned *)user;
    const bool edited = version == 1 && x >= 40 && x < 56 && y >= 130 && y < 140;
    return edited ? z < 30 : partial_scene(NULL, frustum, x, y, z);
}

static struct bytes make_version(unsigned version)
{
    const struct voxels voxels = {edited_scene, &version, LOG2_SIZE, 1};
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.25, fixture_origin, &content);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
                                      .page_bytes = PAGE_BYTES};
    if (umb__pack_run(&job, id, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb__octree_finish(&octree);
    return file;
}

static int make_files(void **state)
{
    (void)state;
    files[0] = make_version(0);
    files[1] = make_version(1);
    files[2] = make_version(0);
    return 0;
}

static int drop_files(void **state)
{
    (void)state;
    for (unsigned i = 0; i < VERSIONS; i++) {
        bytes_finish(&files[i]);
    }
    return 0;
}

/* Opens a version from its head alone, without a block. */
static struct umb_partial *open_head(const struct bytes *file, uint64_t budget)
{
    const struct umb_partial_options options = {.sha256 = &test_digest, .max_memory_bytes = budget};
    struct umb_error error = {0};
    struct umb_partial *partial;
    const size_t head = (size_t)umb__load64(file->data + UMB__HEAD_LENGTH);
    if (umb_partial_open(file->data, head, &options, &partial, &error) != UMB_OK) {
        fail_msg("open: %s", error.message);
    }
    return partial;
}

static void add_block(struct umb_partial *p, const struct bytes *file, uint32_t block)
{
    struct umb_error error = {0};
    uint64_t offset;
    uint32_t length;
    umb_partial_locate_block(p, block, &offset, &length);
    if (umb_partial_add_block(p, block, file->data + offset, length, &error) != UMB_OK) {
        fail_msg("block %u: %s", block, error.message);
    }
}

static void add_blocks(struct umb_partial *p, const struct bytes *file)
{
    for (uint32_t block = 0; block < p->head.directory_count; block++) {
        if (!p->blocks[block]) {
            add_block(p, file, block);
        }
    }
}

static enum umb_status add_page(struct umb_partial *p, const struct bytes *file, uint32_t page,
                                struct umb_error *error)
{
    uint64_t offset;
    uint32_t length;
    assert_int_equal(umb_partial_locate(p, page, &offset, &length), UMB_OK);
    return umb_partial_add(p, page, file->data + offset, length, error);
}

/* Opens a version and adds each page with a chance of `share` in 16. */
static struct umb_partial *open_some(const struct bytes *file, unsigned share, uint64_t *seed)
{
    struct umb_partial *p = open_head(file, 0);
    add_blocks(p, file);
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        if (next_random(seed) % 16 < share) {
            assert_int_equal(add_page(p, file, page, NULL), UMB_OK);
        }
    }
    assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
    return p;
}

/* Marks the pages of `p` whose hashes are among those of the held pages of `old`, each of which
 * counts once. Out: expected: [p's page count]. Returns their number. */
static uint32_t expect_shared(struct umb_partial *p, const struct umb_partial *old, bool *expected)
{
    bool *used = calloc(old->head.page_count, sizeof *used);
    uint32_t count = 0;
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        expected[page] = false;
        for (uint32_t i = 0; i < old->head.page_count && !expected[page]; i++) {
            if (!used[i] && umb_partial_has(old, i) &&
                memcmp(umb__directory_hash(&p->head, page), umb__directory_hash(&old->head, i),
                       UMB_ID_BYTES) == 0) {
                used[i] = expected[page] = true;
                count++;
            }
        }
    }
    free(used);
    return count;
}

static void compare(struct umb_partial *one, struct umb_partial *other, uint64_t *seed)
{
    static float values[2][4][POINTS];
    static double positions[3 * POINTS];
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_partial *const parts[] = {one, other};
    const struct umb_partial_view all = {.light = UINT32_MAX};
    for (size_t i = 0; i < 3 * (size_t)POINTS; i++) {
        positions[i] = fixture_origin[i % 3] + random_unit(seed) * 66 - 1;
    }
    for (uint32_t taps = 1; taps <= 9; taps += 8) {
        const struct umb_query_settings settings = {.taps = taps};
        for (unsigned k = 0; k < 2; k++) {
            struct umb_partial_answers answers = {
                values[k][0], values[k][1], values[k][2], values[k][3], 0, 0, {0}, {0}};
            assert_int_equal(umb_partial_want(parts[k], &all, 0, NULL), UMB_OK);
            assert_int_equal(umb_partial_query(parts[k], &settings, &points, 1, &answers, NULL),
                             UMB_OK);
        }
        assert_memory_equal(values[0], values[1], sizeof values[0]);
        for (uint32_t page = 0; page < one->head.page_count; page++) {
            assert_memory_equal(&one->pages[page].benefit, &other->pages[page].benefit,
                                sizeof(double));
        }
    }
}

/* Adds the held pages of `p` to a fresh partial asset, and compares the two. */
static void compare_with_fresh(struct umb_partial *p, const struct bytes *file, uint64_t *seed)
{
    struct umb_partial *fresh = open_head(file, 0);
    add_blocks(fresh, file);
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        if (umb_partial_has(p, page)) {
            assert_int_equal(add_page(fresh, file, page, NULL), UMB_OK);
        }
    }
    assert_int_equal(umb_partial_build(fresh, NULL), UMB_OK);
    assert_int_equal(fresh->held_bytes, p->held_bytes);
    compare(p, fresh, seed);
    umb_partial_close(fresh);
}

static void shared_pages_are_held_and_answer_as_fresh_ones(void **state)
{
    (void)state;
    for (unsigned round = 0; round < 6; round++) {
        uint64_t seed = round_seed(round + 1);
        struct umb_partial *old = open_some(&files[0], 6 + 2 * round, &seed);
        struct umb_partial *p = open_head(&files[1], 0);
        bool *expected = calloc(p->head.page_count, sizeof *expected);
        const uint32_t before = round % 2 ? p->head.directory_count / 2 : 0;
        for (uint32_t block = 0; block < before; block++) {
            add_block(p, &files[1], block);
        }
        const uint32_t held = old->held_count;
        struct umb_partial *whole = open_head(&files[1], 0); /* has all hashes */
        add_blocks(whole, &files[1]);
        const uint32_t shared = expect_shared(whole, old, expected);
        assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
        assert_int_equal(old->held_count, 0);
        assert_non_null(umb_partial_lower(old)); /* still answers */
        umb_partial_close(old);
        assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
        add_blocks(p, &files[1]);
        assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
        for (uint32_t page = 0; page < p->head.page_count; page++) {
            assert_int_equal(umb_partial_has(p, page), expected[page]);
        }
        struct umb_partial_stats stats;
        umb_partial_get_stats(p, &stats);
        assert_int_equal(stats.pages_inherited, shared);
        assert_true(shared > held / 2 && shared < held); /* an edit of a part */
        compare_with_fresh(p, &files[1], &seed);
        free(expected);
        umb_partial_close(whole);
        umb_partial_close(p);
    }
}

/* Returns 1 if both versions have the same hash of a block. */
static bool is_same_block(const struct umb_partial *a, const struct umb_partial *b, uint32_t block)
{
    return memcmp(a->head.directory + (size_t)block * UMB__BLOCK_ENTRY + UMB__BLOCK_HASH,
                  b->head.directory + (size_t)block * UMB__BLOCK_ENTRY + UMB__BLOCK_HASH,
                  UMB_ID_BYTES) == 0;
}

/* Blocks that did not change stand at other places of the file, or their pages do. Those up to the
 * first change and from the last one on are held at once, the others when a neighbour is. */
static void blocks_that_did_not_change_are_not_read(void **state)
{
    (void)state;
    for (unsigned round = 0; round < 4; round++) {
        uint64_t seed = round_seed(round + 81);
        struct umb_partial *old = open_some(&files[0], 8, &seed);
        struct umb_partial *p = open_head(&files[1], 0),
                           *reference = open_some(&files[0], 0, &seed);
        const uint32_t count = p->head.directory_count;
        uint32_t same = 0, read = 0;
        assert_int_equal(count, old->head.directory_count);
        assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
        umb_partial_close(old);
        for (uint32_t b = 0; b < count && is_same_block(p, reference, b); b++) {
            assert_non_null(p->blocks[b]);
        }
        for (uint32_t b = count; b-- > 0 && is_same_block(p, reference, b);) {
            assert_non_null(p->blocks[b]);
        }
        for (uint32_t b = 0; b < count; b++) {
            same += is_same_block(p, reference, b);
        }
        uint32_t list[64], listed;
        while ((listed = (uint32_t)umb_partial_missing_blocks(p, 1, list, 64)) > 0) {
            const uint32_t b = list[next_random(&seed) % listed];
            assert_false(is_same_block(p, reference, b)); /* the others follow from it */
            add_block(p, &files[1], b);
            read++;
        }
        assert_int_equal(p->block_count, count);
        assert_true(same > 0 && read > 0);
        assert_int_equal(read + same, count);
        for (uint32_t b = 0; b < count; b++) {
            uint64_t offset;
            uint32_t length;
            umb_partial_locate_block(p, b, &offset, &length);
            assert_memory_equal(p->blocks[b], files[1].data + offset, length);
        }
        assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
        compare_with_fresh(p, &files[1], &seed);
        umb_partial_close(reference);
        umb_partial_close(p);
    }
}

static void pages_that_a_version_has_not_wait_for_the_next(void **state)
{
    (void)state;
    uint64_t seed = round_seed(21);
    struct umb_partial *first = open_some(&files[0], 16, &seed);
    struct umb_partial *second = open_head(&files[1], 0);
    struct umb_partial *third = open_head(&files[2], 0);
    assert_int_equal(umb_partial_inherit(second, first, NULL), UMB_OK);
    assert_true(second->spare_bytes > 0);
    assert_int_equal(umb_partial_inherit(third, second, NULL), UMB_OK);
    assert_int_equal(second->spare_bytes, 0);
    assert_int_equal(second->held_count, 0);
    umb_partial_close(first);
    umb_partial_close(second);
    add_blocks(third, &files[2]);
    assert_int_equal(third->held_count, third->head.page_count); /* nothing is to be read */
    assert_int_equal(third->spare_bytes, 0);
    assert_int_equal(umb_partial_build(third, NULL), UMB_OK);
    compare_with_fresh(third, &files[2], &seed);
    umb_partial_close(third);
}

/* Gives a held page another zstd frame, as a file of another version of zstd would have. */
static void pack_again(struct umb_partial *p, uint32_t page)
{
    struct umb__held *held = &p->pages[page];
    const uint32_t raw_length = umb__directory_load(&p->head, page).raw_length;
    const size_t room = ZSTD_compressBound(raw_length);
    uint8_t *raw = malloc(raw_length), *made = malloc(room);
    assert_int_equal(ZSTD_decompress(raw, raw_length, held->stored, held->stored_length),
                     raw_length);
    const size_t size = ZSTD_compress(made, room, raw, raw_length, -5);
    assert_false(ZSTD_isError(size) || size == held->stored_length);
    uint8_t *stored = p->alloc.resize(p->alloc.user, NULL, size);
    memcpy(stored, made, size);
    (void)p->alloc.resize(p->alloc.user, held->stored, 0);
    held->stored = stored;
    p->held_bytes += size - held->stored_length;
    held->stored_length = (uint32_t)size;
    free(raw);
    free(made);
}

static void a_page_in_another_zstd_frame_is_held_but_not_saved(void **state)
{
    (void)state;
    uint64_t seed = round_seed(31);
    struct umb_partial *old = open_some(&files[0], 16, &seed);
    struct umb_partial *p = open_head(&files[2], 0), *again;
    const struct umb_partial_options options = {.sha256 = &test_digest};
    struct bytes saved = {0};
    const struct umb_sink sink = bytes_sink(&saved);
    struct umb_error error = {0};
    const uint32_t page = 7 % old->head.page_count, pages = old->head.page_count;
    pack_again(old, page);
    assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
    umb_partial_close(old);
    add_blocks(p, &files[2]);
    assert_int_equal(p->held_count, pages);
    assert_true(umb__partial_free_raw(p)); /* the build uncompresses that frame again */
    assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
    assert_int_equal(umb_partial_save(p, &sink, NULL), UMB_OK);
    if (umb_partial_open_saved(saved.data, saved.size, &options, &again, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(again->held_count, pages - 1);
    assert_false(umb_partial_has(again, page));
    assert_int_equal(add_page(again, &files[2], page, NULL), UMB_OK);
    assert_int_equal(umb_partial_build(again, NULL), UMB_OK);
    compare(p, again, &seed);
    umb_partial_drop(p, page);
    assert_int_equal(add_page(p, &files[2], page, NULL), UMB_OK);
    assert_int_equal(p->held_bytes, again->held_bytes);
    umb_partial_close(p);
    umb_partial_close(again);
    bytes_finish(&saved);
}

/* Returns the entry of a page in a file. */
static uint8_t *entry_of(const struct umb_partial *p, struct bytes *file, uint32_t page)
{
    uint64_t offset;
    uint32_t length;
    umb_partial_locate_block(p, page / UMB__BLOCK_PAGES, &offset, &length);
    return file->data + offset + (size_t)(page % UMB__BLOCK_PAGES) * UMB__PAGE_ENTRY;
}

static void a_directory_that_claims_hashes_gets_no_page_it_does_not_describe(void **state)
{
    (void)state;
    uint64_t seed = round_seed(41);
    struct umb_partial *old = open_some(&files[0], 16, &seed);
    struct bytes forged = {0};
    const struct umb_sink sink = bytes_sink(&forged);
    assert_int_equal(sink.write(sink.user, files[0].data, files[0].size), UMB_OK);
    /* Every page of the file claims to be one page. */
    const uint32_t claimed = old->head.page_count - 1, pages = old->head.page_count;
    uint8_t hash[UMB_ID_BYTES];
    memcpy(hash, umb__directory_hash(&old->head, claimed), sizeof hash);
    for (uint32_t page = 0; page < pages; page++) {
        memcpy(entry_of(old, &forged, page) + UMB__PAGE_HASH, hash, sizeof hash);
    }
    seal_asset(&forged, true);
    struct umb_partial *p = open_head(&forged, 0);
    assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
    umb_partial_close(old);
    add_blocks(p, &forged);
    assert_true(p->inherited <= 1); /* the page is tried once */
    for (uint32_t page = 0; page < pages; page++) {
        struct umb_error error = {0};
        if (!umb_partial_has(p, page) && page != claimed) {
            assert_int_equal(add_page(p, &forged, page, &error), UMB_E_CORRUPT);
        }
    }
    assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
    umb_partial_close(p);
    bytes_finish(&forged);
}

/* The entry of a page describes it wrongly: as such a page would be refused when read, it is not
 * taken over. */
static void a_page_whose_entry_lies_is_not_taken_over(void **state)
{
    (void)state;
    static const struct {
        size_t at;
        uint8_t flip;
    } lies[] = {{12, 1}, {12, 128}, {24, 1}, {25, 2}, {28, 1}, {30, 4}};
    for (size_t i = 0; i < sizeof lies / sizeof lies[0]; i++) {
        uint64_t seed = round_seed(51);
        struct umb_partial *old = open_some(&files[0], 16, &seed);
        struct bytes forged = {0};
        const struct umb_sink sink = bytes_sink(&forged);
        const uint32_t page = old->head.page_count / 2, held = old->held_count;
        assert_int_equal(sink.write(sink.user, files[0].data, files[0].size), UMB_OK);
        entry_of(old, &forged, page)[lies[i].at] ^= lies[i].flip;
        seal_asset(&forged, true);
        struct umb_partial *p = open_head(&forged, 0);
        assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
        umb_partial_close(old);
        for (uint32_t block = 0; block < p->head.directory_count; block++) {
            uint64_t offset;
            uint32_t length;
            umb_partial_locate_block(p, block, &offset, &length);
            (void)!umb_partial_add_block(p, block, forged.data + offset, length, NULL);
        }
        assert_false(umb_partial_has(p, page));
        assert_true(p->held_count < held);
        assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
        umb_partial_close(p);
        bytes_finish(&forged);
    }
}

static void a_memory_budget_holds_while_pages_are_taken_over(void **state)
{
    (void)state;
    uint64_t seed = round_seed(61);
    struct umb_partial *whole = open_some(&files[1], 16, &seed);
    const uint64_t peak = whole->meter.peak;
    umb_partial_close(whole);
    for (unsigned tenths = 3; tenths <= 10; tenths++) {
        struct umb_partial *old = open_some(&files[0], 16, &seed);
        struct umb_partial *p = open_head(&files[1], peak * tenths / 10);
        struct umb_partial_stats stats;
        assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
        umb_partial_close(old);
        for (uint32_t block = 0; block < p->head.directory_count; block++) {
            if (!p->blocks[block]) {
                add_block(p, &files[1], block);
            }
            assert_int_equal(umb_partial_build(p, NULL), UMB_OK);
        }
        umb_partial_get_stats(p, &stats);
        assert_true(stats.memory_peak_bytes <= peak * tenths / 10);
        assert_true(stats.pages_held > 0 || tenths < 5);
        compare_with_fresh(p, &files[1], &seed);
        umb_partial_close(p);
    }
}

static void wrong_partners_are_refused(void **state)
{
    (void)state;
    uint64_t seed = round_seed(71);
    const struct umb_alloc other = {.resize = NULL};
    struct umb_partial *old = open_some(&files[0], 8, &seed);
    struct umb_partial *p = open_head(&files[1], 0);
    const uint32_t held = old->held_count;
    assert_int_equal(umb_partial_inherit(p, p, NULL), UMB_E_ARGUMENT);
    const struct umb_alloc *const own = p->meter.inner;
    p->meter.inner = &other;
    assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_E_ARGUMENT);
    p->meter.inner = own;
    assert_int_equal(old->held_count, held);
    assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_OK);
    assert_int_equal(umb_partial_inherit(p, old, NULL), UMB_E_STATE);
    umb_partial_close(old);
    umb_partial_close(p); /* with pages that no entry named */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shared_pages_are_held_and_answer_as_fresh_ones),
        cmocka_unit_test(blocks_that_did_not_change_are_not_read),
        cmocka_unit_test(pages_that_a_version_has_not_wait_for_the_next),
        cmocka_unit_test(a_page_in_another_zstd_frame_is_held_but_not_saved),
        cmocka_unit_test(a_directory_that_claims_hashes_gets_no_page_it_does_not_describe),
        cmocka_unit_test(a_page_whose_entry_lies_is_not_taken_over),
        cmocka_unit_test(a_memory_budget_holds_while_pages_are_taken_over),
        cmocka_unit_test(wrong_partners_are_refused),
    };
    return cmocka_run_group_tests(tests, make_files, drop_files);
}
