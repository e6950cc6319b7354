/* SPDX-License-Identifier: Apache-2.0 */
/* The places of wide nodes in a mapped file, and what may stand between them (format/view.h). */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "format/asset_parts.h"
#include "format/layout.h"
#include "make_asset.h"

static const double origin[3] = {10, 20, 30};

/* A slope: nodes of any number of mixed children. */
static int sloped(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 20 + (x * 5 + y * 3) / 9 + x / 16 * y / 16 % 13;
}

static struct bytes sloped_file(void)
{
    struct voxels voxels = {sloped, NULL, 8, 1};
    return make_packed(&voxels, 0.5, origin);
}

/* Walks the wide nodes of a view: returns the words of the next node at or behind *word, 0 at the
 * end. */
static uint64_t next_node(const struct umb__view *view, uint64_t *word)
{
    while (*word < view->node_words && view->nodes[*word] == 0 && view->nodes[*word + 1] == 0) {
        *word += 2;
    }
    return *word < view->node_words
               ? umb__wide_words((uint64_t)__builtin_popcountll(view->nodes[*word]))
               : 0;
}

static void wide_nodes_lie_in_as_few_lines_as_they_need_and_longer_ones_begin_lines(void **state)
{
    struct bytes packed = sloped_file();
    struct umb_asset *asset;
    uint64_t nodes = 0, longer = 0, gaps = 0, behind = 0;
    (void)state;
    assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, NULL, &asset, NULL), UMB_OK);
    const struct umb__view *view = &asset->view;
    assert_int_equal((uintptr_t)view->nodes % 64, 0);
    for (uint64_t word = 0, words; (words = next_node(view, &word)) != 0; word += words) {
        assert_true((word + words - 1) / 8 - word / 8 == (words - 1) / 8);
        assert_true(words <= 8 || word % 8 == 0);
        longer += words > 8;
        gaps += word - behind;
        behind = word + words;
        nodes++;
    }
    assert_true(longer > 50 && nodes > longer + 30);
    assert_true(gaps > 0 && gaps * 8 < view->node_words);
    umb_asset_close(asset);
    bytes_finish(&packed);
}

/* Makes the head's check right again. */
static void seal(struct bytes *file)
{
    uint64_t length = umb__load64(file->data + UMB__HEAD_LENGTH);
    uint8_t both[16];
    umb__store64(both, XXH3_64bits(file->data, UMB__HEAD_CHECK));
    umb__store64(both + 8, XXH3_64bits(file->data + UMB__HEAD_SIZE, length - UMB__HEAD_SIZE));
    umb__store64(file->data + UMB__HEAD_CHECK, XXH3_64bits(both, sizeof both));
}

/* Opens a mapped file in which one number of a section was changed and the checksums are right. */
static enum umb_status open_with_number(struct bytes *mapped, size_t section, uint64_t at,
                                        uint32_t value)
{
    uint64_t directory = UMB__HEAD_SIZE + umb__load64(mapped->data + UMB__HEAD_CANONICAL_LENGTH);
    uint8_t *entry = mapped->data + directory + section * UMB__SECTION_ENTRY;
    uint8_t *bytes = mapped->data + umb__load64(entry + UMB__SECTION_OFFSET);
    size_t length = (size_t)umb__load64(entry + UMB__SECTION_LENGTH);
    uint32_t before = umb__load32(bytes + 4 * at);
    struct umb_asset *asset;
    umb__store32(bytes + 4 * at, value);
    umb__store64(entry + UMB__SECTION_CHECK, XXH3_64bits(bytes, length));
    seal(mapped);
    enum umb_status status = umb_asset_open_bytes(mapped->data, mapped->size, NULL, &asset, NULL);
    umb_asset_close(asset);
    umb__store32(bytes + 4 * at, before);
    return status;
}

static void gaps_between_wide_nodes_are_pairs_of_zero_words(void **state)
{
    const size_t grid = 2, nodes = 3; /* sections */
    struct bytes packed = sloped_file(), mapped = make_mapped(&packed);
    struct umb_asset *asset;
    uint64_t word = 0, words, gap = 0, padded = 0, cell = 0;
    (void)state;
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL), UMB_OK);
    const struct umb__view *view = &asset->view;
    for (uint64_t end = 0; (words = next_node(view, &word)) != 0; word = end) {
        uint64_t count = (uint64_t)__builtin_popcountll(view->nodes[word]);
        gap = word > end ? end : gap;
        padded = count % 4 == 1 || count % 4 == 2 ? word + words - 1 : padded;
        end = word + words;
    }
    while (view->grid[cell] < UMB__CELL_FIRST) {
        cell++;
    }
    umb_asset_close(asset);
    assert_true(gap > 0 && padded > 0);
    assert_int_equal(open_with_number(&mapped, nodes, 2 * gap, 0), UMB_OK);
    assert_int_equal(open_with_number(&mapped, grid, cell, (uint32_t)gap + 3), UMB_E_CORRUPT);
    assert_int_equal(open_with_number(&mapped, nodes, 2 * padded, 1), UMB_E_CORRUPT);
    assert_int_equal(open_with_number(&mapped, nodes, 2 * padded + 1, 1), UMB_E_CORRUPT);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

/* Readers accept packed files that are not canonical; the mapped file made from one must be
 * accepted, too. */
static void a_shadowed_node_has_a_mapped_form(void **state)
{
    const struct voxels voxels = {sloped, NULL, 7, 1};
    struct umb__octree octree;
    struct umb__content content;
    struct bytes packed = {0};
    struct umb_sink sink = bytes_sink(&packed);
    struct umb_asset *asset;
    uint8_t id[UMB_ID_BYTES];
    (void)state;
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.5, origin, &content);
    struct umb__octree_level *level = &octree.level[4];
    assert_true(level->count > 0);
    memset(level->masks, 0, level->count * sizeof *level->masks);
    memset(level->first, 0, (level->count + 1) * sizeof *level->first);
    for (uint32_t i = 0; i < octree.level[5].count; i++) {
        octree.level[5].masks[i] &= 0xaaaa; /* what was lit is shadowed */
    }
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    umb__octree_finish(&octree);
    struct bytes mapped = make_mapped(&packed);
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL), UMB_OK);
    umb_asset_close(asset);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

/* A mapped file that passed a check once must not be trusted with another layout. */
static void a_mapped_file_of_another_version_is_refused_even_if_trusted(void **state)
{
    const struct umb_open_options trusting = {.trust = UMB_TRUST_VALIDATED};
    struct bytes packed = sloped_file(), mapped = make_mapped(&packed);
    struct umb_asset *asset;
    (void)state;
    assert_int_equal(umb__load16(mapped.data + UMB__HEAD_VERSION), UMB__VERSION_MAPPED);
    for (unsigned version = 0; version < 5; version++) {
        const enum umb_status wanted = version == UMB__VERSION_MAPPED ? UMB_OK : UMB_E_VERSION;
        umb__store16(mapped.data + UMB__HEAD_VERSION, (uint16_t)version);
        seal(&mapped);
        assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL),
                         wanted);
        umb_asset_close(asset);
        assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, &trusting, &asset, NULL),
                         wanted);
        umb_asset_close(asset);
    }
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(wide_nodes_lie_in_as_few_lines_as_they_need_and_longer_ones_begin_lines),
        cmocka_unit_test(gaps_between_wide_nodes_are_pairs_of_zero_words),
        cmocka_unit_test(a_shadowed_node_has_a_mapped_form),
        cmocka_unit_test(a_mapped_file_of_another_version_is_refused_even_if_trusted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
