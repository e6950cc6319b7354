/* SPDX-License-Identifier: Apache-2.0 */
/*
 * An octree loaded from its image and edited: with the cuts and pages that are kept of it, packing
 * writes the bytes that it writes without. Damaged images and records are refused or harmless.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "format/pack_kept.h"
#include "make_asset.h"

#define LOG2 8U

static const double origin[3] = {84616.5, 447423.25, -3};

/* Every column ends anywhere, so that hardly two bricks are equal. */
static int noisy(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const uint64_t column = (uint64_t)frustum << 32 | x << 16 | y;
    (void)user;
    return z < (column * 0x9e3779b97f4a7c15ULL ^ 0x5bf03635) * 0xbf58476d1ce4e5b9ULL >> 56;
}

static const struct voxels voxels = {noisy, NULL, LOG2, 2};

/* What is kept of a packed octree. */
struct before {
    uint8_t *image, *kept;
    size_t image_size, kept_size;
    uint32_t counts[UMB_LEVEL_MAX + 1];
    uint32_t roots[2];
    uint32_t page_count;
};

static void keep(void *user, const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                 uint32_t page_count)
{
    struct before *before = user;
    before->page_count = page_count;
    before->image_size = (size_t)umb__octree_image_bytes(cuts->octree);
    before->kept_size = (size_t)umb__pack_kept_bytes(cuts, pages, page_count);
    before->image = malloc(before->image_size);
    before->kept = malloc(before->kept_size);
    assert_non_null(before->image);
    assert_non_null(before->kept);
    umb__octree_image_write(cuts->octree, before->image);
    umb__pack_kept_write(cuts, pages, page_count, before->kept);
    for (uint32_t l = UMB_LEVEL_BRICK; l <= UMB_LEVEL_MAX; l++) {
        before->counts[l] = umb__octree_level_count(cuts->octree, l);
    }
}

/* Packs an octree. In: before: gets what is to be kept, or NULL. */
static struct bytes pack(const struct umb__octree *octree, const struct umb__pack_kept *kept,
                         struct before *before)
{
    struct umb__content content;
    struct bytes bytes = {0};
    const struct umb_sink sink = bytes_sink(&bytes);
    uint8_t id[UMB_ID_BYTES];
    make_content(&voxels, 0.5, origin, &content);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
                                      .kept = kept,
                                      .made = before != NULL ? keep : NULL,
                                      .made_user = before};
    assert_int_equal(umb__pack_run(&job, id, NULL), UMB_OK);
    return bytes;
}

static void before_make(struct before *before)
{
    struct umb__octree octree;
    make_octree(&voxels, &octree);
    struct bytes bytes = pack(&octree, NULL, before);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(octree.roots[i].state, UMB__NODE_MIXED);
        before->roots[i] = octree.roots[i].index;
    }
    bytes_finish(&bytes);
    umb__octree_finish(&octree);
}

static void before_finish(struct before *before)
{
    free(before->image);
    free(before->kept);
}

/* Makes a node anew with another brick somewhere below. Returns its reference. */
static uint32_t edit(struct umb__pool *pool, uint32_t level, uint32_t node, uint64_t *seed)
{
    uint32_t children[8], ref, mixed = 0;
    if (level == UMB_LEVEL_BRICK) {
        uint64_t slices[8];
        memcpy(slices, pool->bricks[node], sizeof slices);
        slices[next_random(seed) % 8] ^= next_random(seed);
        assert_int_equal(umb__pool_brick(pool, slices, &ref, NULL), UMB_OK);
        return ref;
    }
    const uint32_t first = pool->level[level].first[node];
    const uint16_t mask = pool->level[level].masks[node];
    const uint32_t pick = (uint32_t)next_random(seed) % umb__mask_mixed_count(mask);
    for (unsigned c = 0; c < 8; c++) {
        const enum umb__node_state state = umb__mask_state(mask, c);
        children[c] = state == UMB__NODE_LIT ? UMB__REF_LIT : UMB__REF_SHADOWED;
        if (state == UMB__NODE_MIXED) {
            children[c] = pool->level[level].children[first + mixed];
            if (mixed++ == pick) {
                children[c] = edit(pool, level - 1, children[c], seed);
            }
        }
    }
    assert_int_equal(umb__pool_node(pool, level, children, &ref, NULL), UMB_OK);
    return ref;
}

static void an_edited_octree_is_packed_to_the_same_bytes(void **state)
{
    struct before before;
    uint64_t seed = 7, reused = 0;
    (void)state;
    before_make(&before);
    for (int round = 0; round < 20; round++) {
        struct umb__pool pool;
        struct umb__octree octree;
        struct umb__octree_map map;
        struct umb__pack_kept kept;
        const uint32_t levels[2] = {LOG2, LOG2};
        uint32_t refs[2] = {before.roots[0], before.roots[1]};
        umb__pool_init(&pool, NULL, SIZE_MAX);
        assert_int_equal(umb__pool_load(&pool, before.image, before.image_size, NULL), UMB_OK);
        for (int i = 0; i < round; i++) {
            refs[i % 2] = edit(&pool, LOG2, refs[i % 2], &seed);
        }
        refs[1] = round == 13 ? UMB__REF_LIT : refs[1]; /* a whole frustum is removed */
        assert_int_equal(umb__pool_take(&pool, refs, levels, 2, &octree, NULL), UMB_OK);
        struct bytes loose = pack(&octree, NULL, NULL);
        assert_int_equal(umb__octree_compact(&octree, &map, NULL), UMB_OK);
        assert_int_equal(
            umb__pack_kept_read(before.kept, before.kept_size, before.counts, &map, &kept, NULL),
            UMB_OK);
        struct bytes plain = pack(&octree, NULL, NULL), fast = pack(&octree, &kept, NULL);
        assert_int_equal(fast.size, plain.size);
        assert_memory_equal(fast.data, plain.data, plain.size);
        assert_int_equal(loose.size, plain.size);
        assert_memory_equal(loose.data, plain.data, plain.size);
        reused += kept.page_count;
        assert_true(round > 0 || kept.page_count + 1 == before.page_count);
        bytes_finish(&plain);
        bytes_finish(&fast);
        bytes_finish(&loose);
        umb__pack_kept_finish(&kept);
        umb__octree_map_finish(&map);
        umb__octree_finish(&octree);
    }
    print_message("%llu pages of 20 x %u are kept\n", (unsigned long long)reused,
                  before.page_count);
    assert_true(reused > 10ULL * before.page_count);
    before_finish(&before);
}

static void a_loaded_pool_finds_the_nodes_of_the_image(void **state)
{
    struct before before;
    struct umb__octree octree;
    struct umb__pool pool;
    (void)state;
    before_make(&before);
    make_octree(&voxels, &octree);
    umb__pool_init(&pool, NULL, SIZE_MAX);
    assert_int_equal(umb__pool_load(&pool, before.image, before.image_size, NULL), UMB_OK);
    for (uint32_t i = 0; i < octree.brick_count; i++) {
        uint32_t ref;
        assert_int_equal(umb__pool_brick(&pool, octree.bricks[i], &ref, NULL), UMB_OK);
        assert_int_equal(ref, i);
    }
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= LOG2; l++) {
        for (uint32_t i = 0; i < octree.level[l].count; i++) {
            const uint32_t *next = octree.level[l].children + octree.level[l].first[i];
            uint32_t children[8], ref;
            for (unsigned c = 0; c < 8; c++) {
                const enum umb__node_state child = umb__mask_state(octree.level[l].masks[i], c);
                children[c] = child == UMB__NODE_MIXED ? *next++
                              : child == UMB__NODE_LIT ? UMB__REF_LIT
                                                       : UMB__REF_SHADOWED;
            }
            assert_int_equal(umb__pool_node(&pool, l, children, &ref, NULL), UMB_OK);
            assert_int_equal(ref, i);
        }
    }
    umb__pool_finish(&pool);
    umb__octree_finish(&octree);
    before_finish(&before);
}

/* Loads copies of exact sizes. Returns 1 if both are accepted. */
static int load_copies(const struct before *before, size_t image_size, size_t kept_size)
{
    struct umb__pool pool;
    struct umb__pack_kept kept;
    uint8_t *image = malloc(image_size + 1), *bytes = malloc(kept_size + 1);
    assert_non_null(image);
    assert_non_null(bytes);
    memcpy(image, before->image, image_size);
    memcpy(bytes, before->kept, kept_size);
    umb__pool_init(&pool, NULL, SIZE_MAX);
    const enum umb_status one = umb__pool_load(&pool, image, image_size, NULL);
    const enum umb_status two =
        umb__pack_kept_read(bytes, kept_size, before->counts, NULL, &kept, NULL);
    assert_true((one == UMB_OK || one == UMB_E_CORRUPT) && (two == UMB_OK || two == UMB_E_CORRUPT));
    umb__pack_kept_finish(&kept);
    umb__pool_finish(&pool);
    free(image);
    free(bytes);
    return one == UMB_OK && two == UMB_OK;
}

static void damage_is_refused_or_harmless(void **state)
{
    struct before before;
    uint64_t seed = 11;
    int refused = 0;
    (void)state;
    before_make(&before);
    assert_true(load_copies(&before, before.image_size, before.kept_size));
    for (int i = 0; i < 60; i++) {
        assert_false(
            load_copies(&before, next_random(&seed) % before.image_size, before.kept_size));
        assert_false(
            load_copies(&before, before.image_size, next_random(&seed) % before.kept_size));
        const int which = i % 2;
        const size_t size = which ? before.image_size : before.kept_size;
        uint8_t *at =
            (which ? before.image : before.kept) + next_random(&seed) % (i % 3 == 0 ? 64 : size);
        const uint8_t bit = (uint8_t)(1U << next_random(&seed) % 8);
        *at ^= bit;
        refused += !load_copies(&before, before.image_size, before.kept_size);
        *at ^= bit;
    }
    print_message("%d of 60 flipped bits were refused\n", refused);
    assert_true(refused > 10);
    before_finish(&before);
}

/* What a forger writes into the arrays of the cuts. */
enum forgery {
    NO_CUT,
    PARTS_WITHOUT_CHILDREN,
    NO_PAGES
};

/* Changes the arrays of all nodes: sums, parts and bytes; or leaves out the pages. */
static void forge(struct before *before, enum forgery what)
{
    uint8_t *at = before->kept + 4 + 4 * (size_t)(UMB_LEVEL_MAX - UMB_LEVEL_BRICK);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const size_t bytes = 4 * (size_t)before->counts[l];
        if (what != NO_PAGES) {
            memset(at, 0, bytes);
        }
        at += bytes;
        if (l >= UMB__CUT_LOWEST) {
            if (what != NO_PAGES) {
                memset(at, what == NO_CUT ? 0 : 0xff, bytes);
            }
            at += 2 * bytes;
        }
    }
    if (what == NO_PAGES) {
        memset(at, 0, 8);
        before->kept_size = (size_t)(at + 8 - before->kept);
    }
}

/* Packs the octree edited once, with what is kept of it. */
static enum umb_status pack_forged(const struct before *before, struct umb_error *error)
{
    struct umb__pool pool;
    struct umb__octree octree;
    struct umb__octree_map map;
    struct umb__pack_kept kept;
    struct umb__content content;
    struct bytes bytes = {0};
    const struct umb_sink sink = bytes_sink(&bytes);
    const uint32_t levels[2] = {LOG2, LOG2};
    uint64_t seed = 19;
    uint8_t id[UMB_ID_BYTES];
    make_content(&voxels, 0.5, origin, &content);
    umb__pool_init(&pool, NULL, SIZE_MAX);
    assert_int_equal(umb__pool_load(&pool, before->image, before->image_size, NULL), UMB_OK);
    const uint32_t refs[2] = {edit(&pool, LOG2, before->roots[0], &seed), before->roots[1]};
    assert_int_equal(umb__pool_take(&pool, refs, levels, 2, &octree, NULL), UMB_OK);
    assert_int_equal(umb__octree_compact(&octree, &map, NULL), UMB_OK);
    assert_int_equal(
        umb__pack_kept_read(before->kept, before->kept_size, before->counts, &map, &kept, NULL),
        UMB_OK);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
                                      .kept = &kept};
    const enum umb_status status = umb__pack_run(&job, id, error);
    assert_true(status == UMB_OK || bytes.size == 0);
    bytes_finish(&bytes);
    umb__pack_kept_finish(&kept);
    umb__octree_map_finish(&map);
    umb__octree_finish(&octree);
    return status;
}

/* Without a limit of the nodes of a page, NO_CUT would never end. */
static void false_cuts_end_in_an_error(void **state)
{
    static const char *const told[] = {"cuts that no octree has", "cuts that no octree has",
                                       "is missing"};
    struct umb_error error;
    struct before before;
    (void)state;
    before_make(&before);
    assert_int_equal(pack_forged(&before, &error), UMB_OK);
    before_finish(&before);
    for (enum forgery what = NO_CUT; what <= NO_PAGES; what++) {
        before_make(&before);
        forge(&before, what);
        assert_int_equal(pack_forged(&before, &error), UMB_E_CORRUPT);
        assert_non_null(strstr(error.message, told[what]));
        before_finish(&before);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_edited_octree_is_packed_to_the_same_bytes),
        cmocka_unit_test(a_loaded_pool_finds_the_nodes_of_the_image),
        cmocka_unit_test(damage_is_refused_or_harmless),
        cmocka_unit_test(false_cuts_end_in_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
