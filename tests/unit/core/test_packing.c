/* SPDX-License-Identifier: Apache-2.0 */
/* The writers: what their bytes depend on, what they refuse, and what is left after a failure. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include <zstd.h>

#include "format/asset_parts.h"
#include "format/directory.h"
#include "make_asset.h"

static const double origin[3] = {84616.5, 447423.25, -3};

/* Rough ground with a slab above it: several levels of mixed nodes, few equal ones. */
static int rough(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    uint32_t height = 60 + (x * 7 + y * 3 + frustum * 11) % 23 + (x / 32 * 5 + y / 32 * 11) % 40;
    return x > 30 && x < 70 && y > 20 && y < 41 ? z < 33 : z < height;
}

static const struct voxels three_suns = {rough, NULL, 7, 3};

static void shuffle(uint32_t *order, uint32_t count, uint64_t *seed)
{
    for (uint32_t i = 0; i < count; i++) {
        order[i] = i;
    }
    for (uint32_t i = count; i > 1; i--) {
        uint32_t k = (uint32_t)(next_random(seed) % i), swapped = order[k];
        order[k] = order[i - 1];
        order[i - 1] = swapped;
    }
}

static void *block_of(size_t count, size_t size)
{
    void *block = calloc(count + 1, size);
    assert_non_null(block);
    return block;
}

/* Renumbers a level: node i gets the number to[i], and its children's numbers are mapped by
 * below[...]. */
static void renumber_level(struct umb__octree_level *level, const uint32_t *to,
                           const uint32_t *below)
{
    uint32_t children = level->count > 0 ? level->first[level->count] : 0;
    struct umb__octree_level fresh = {
        .count = level->count,
        .masks = block_of(level->count, sizeof *fresh.masks),
        .first = block_of(level->count, sizeof *fresh.first),
        .children = block_of(children, sizeof *fresh.children),
    };
    for (uint32_t i = 0; i < level->count; i++) {
        fresh.masks[to[i]] = level->masks[i];
        fresh.first[to[i] + 1] = level->first[i + 1] - level->first[i];
    }
    for (uint32_t i = 0; i < level->count; i++) {
        fresh.first[i + 1] += fresh.first[i];
    }
    for (uint32_t i = 0; i < level->count; i++) {
        for (uint32_t c = level->first[i]; c < level->first[i + 1]; c++) {
            fresh.children[fresh.first[to[i]] + c - level->first[i]] = below[level->children[c]];
        }
    }
    free(level->masks);
    free(level->first);
    free(level->children);
    *level = fresh;
}

/* The same tree under random numbers. */
static void renumber(struct umb__octree *octree, uint64_t *seed)
{
    uint32_t *below = block_of(octree->brick_count, sizeof *below);
    uint64_t(*bricks)[8] = block_of(octree->brick_count, sizeof *bricks);
    shuffle(below, octree->brick_count, seed);
    for (uint32_t i = 0; i < octree->brick_count; i++) {
        memcpy(bricks[below[i]], octree->bricks[i], sizeof *bricks);
    }
    free(octree->bricks);
    octree->bricks = bricks;
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        uint32_t *to = block_of(octree->level[l].count, sizeof *to);
        shuffle(to, octree->level[l].count, seed);
        renumber_level(&octree->level[l], to, below);
        for (uint32_t i = 0; i < octree->root_count; i++) {
            struct umb__octree_root *root = &octree->roots[i];
            if (root->level == l && root->state == UMB__NODE_MIXED) {
                root->index = to[root->index];
            }
        }
        free(below);
        below = to;
    }
    free(below);
}

static void equal_trees_under_other_numbers_give_equal_files(void **state)
{
    struct bytes whole = make_packed(&three_suns, 0.5, origin);
    uint64_t seed = 20140803;
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 5; round++) {
        struct umb__octree octree;
        struct umb__content content;
        struct bytes again = {0};
        struct umb_sink sink = bytes_sink(&again);
        uint8_t id[UMB_ID_BYTES];
        make_octree(&three_suns, &octree);
        make_content(&three_suns, 0.5, origin, &content);
        renumber(&octree, &seed);
        assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
        assert_int_equal(again.size, whole.size);
        assert_memory_equal(again.data, whole.data, whole.size);
        umb__octree_finish(&octree);
        bytes_finish(&again);
    }
    bytes_finish(&whole);
}

/* Three helpers that take the pages from the last to the first. */
/* Bumps of which every other one comes again each 64 voxels. */
static int repeated(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    uint64_t bump = (uint64_t)(x % 64) << 32 | (y % 64) << 1 | 1;
    if (x / 8 % 2 == 0) {
        bump = (uint64_t)x << 32 | (uint64_t)frustum << 20 | y << 1 | 1;
    }
    bump *= 0x9e3779b97f4a7c15U;
    return z < 100 + next_random(&bump) % 40;
}

/* Six cubes of 32 noisy voxels a side, in any mixture: copies would be most of a file. */
static int mixed_up(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    uint64_t which = (uint64_t)(x / 32 + 8 * (y / 32) + 64 * (z / 32)) + 512 * frustum + 1;
    (void)user;
    (void)next_random(&which);
    uint64_t seed = (next_random(&which) >> 33) % 6 + 1;
    seed = (seed << 18 | (x % 32) << 12 | (y % 32) << 6 | z % 32) * 0x9e3779b97f4a7c15U;
    (void)next_random(&seed);
    return (int)(next_random(&seed) >> 40 & 1);
}

/* Counts the nodes of all pages of a file, copies included. Returns how many pages have bricks and
 * refer to other pages. */
static uint32_t count_nodes(const struct bytes *file, uint64_t found[UMB_LEVEL_MAX + 1])
{
    struct umb__head head;
    uint32_t referring = 0;
    uint8_t *raw = block_of(UMB__PAGE_RAW_MAX, 1);
    ZSTD_DCtx *zstd = ZSTD_createDCtx();
    assert_int_equal(umb__head_parse(file->data, file->size, &head, NULL), UMB_OK);
    for (uint32_t number = 0; number < head.page_count; number++) {
        struct umb__page_entry entry = umb__directory_load(&head, number);
        umb__directory_links(&head, &entry, NULL);
        struct umb__page page;
        uint32_t others = 0;
        assert_int_equal(umb__page_expand(zstd, file->data + entry.offset, &entry, raw, NULL),
                         UMB_OK);
        assert_int_equal(umb__page_open(raw, &entry, &page, NULL), UMB_OK);
        for (size_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
            others += page.external_count[level];
            found[level] += page.node_count[level];
        }
        referring += page.level_low == UMB_LEVEL_BRICK && others > 0;
    }
    ZSTD_freeDCtx(zstd);
    free(raw);
    return referring;
}

/* Opens a file; the exported octree must have as many nodes as the file states. */
static void expect_counts(const struct bytes *file, uint64_t counts[UMB_LEVEL_MAX + 1])
{
    struct umb_asset *asset;
    struct umb__octree octree;
    struct umb__content content;
    assert_int_equal(umb_asset_open_bytes(file->data, file->size, NULL, &asset, NULL), UMB_OK);
    assert_int_equal(umb__asset_export(asset, &octree, &content, NULL), UMB_OK);
    memcpy(counts, asset->canonical.counts, sizeof asset->canonical.counts);
    assert_int_equal(octree.brick_count, counts[UMB_LEVEL_BRICK]);
    for (size_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        assert_int_equal(octree.level[level].count, counts[level]);
    }
    umb__octree_finish(&octree);
    umb_asset_close(asset);
}

static void pages_with_bricks_stand_alone_and_their_copies_become_one_node_again(void **state)
{
    const struct voxels voxels = {repeated, NULL, 8, 2};
    struct bytes file = make_packed(&voxels, 0.5, origin);
    uint64_t found[UMB_LEVEL_MAX + 1] = {0}, counts[UMB_LEVEL_MAX + 1];
    (void)state;
    assert_int_equal(count_nodes(&file, found), 0);
    expect_counts(&file, counts);
    assert_true(found[UMB_LEVEL_BRICK] > counts[UMB_LEVEL_BRICK]); /* there are copies ... */
    assert_int_equal(found[7], counts[7]);                         /* ... but of no root */
    bytes_finish(&file);
}

/* Bytes of the longest page, uncompressed. */
static uint32_t longest_page(const struct bytes *file)
{
    struct umb__head head;
    uint32_t longest = 0;
    assert_int_equal(umb__head_parse(file->data, file->size, &head, NULL), UMB_OK);
    for (uint32_t number = 0; number < head.page_count; number++) {
        const uint32_t length = umb__directory_load(&head, number).raw_length;
        longest = length > longest ? length : longest;
    }
    return longest;
}

static void trees_that_share_much_have_larger_pages(void **state)
{
    const struct voxels voxels = {mixed_up, NULL, 8, 2}, others = {repeated, NULL, 8, 2};
    struct bytes file = make_packed(&voxels, 0.5, origin),
                 other = make_packed(&others, 0.5, origin);
    uint64_t found[UMB_LEVEL_MAX + 1] = {0}, counts[UMB_LEVEL_MAX + 1];
    (void)state;
    assert_int_equal(count_nodes(&file, found), 0);
    expect_counts(&file, counts);
    assert_true(found[UMB_LEVEL_BRICK] < 2 * counts[UMB_LEVEL_BRICK]);
    assert_true(longest_page(&file) > 2 * longest_page(&other));
    bytes_finish(&file);
    bytes_finish(&other);
}

/* A rough floor; user: where a single voxel is turned around, or NULL. */
static int edited_floor(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const uint32_t *edit = user;
    uint64_t seed = ((uint64_t)x << 20 | y) * 0x9e3779b97f4a7c15U + 1;
    (void)frustum;
    (void)next_random(&seed);
    const int lit = z < 60 + x / 4 + (uint32_t)(next_random(&seed) >> 40) % 24;
    return edit && edit[0] == x && edit[1] == y && edit[2] == z ? !lit : lit;
}

/* Counts the pages of a file that another one lacks. */
static uint32_t new_pages(const struct bytes *file, const struct bytes *old)
{
    struct umb__head head, before;
    uint32_t count = 0;
    assert_true(umb__head_parse(file->data, file->size, &head, NULL) == UMB_OK &&
                umb__head_parse(old->data, old->size, &before, NULL) == UMB_OK);
    for (uint32_t page = 0; page < head.page_count; page++) {
        uint32_t i = 0;
        while (i < before.page_count &&
               memcmp(umb__directory_hash(&head, page), umb__directory_hash(&before, i),
                      UMB_ID_BYTES) != 0) {
            i++;
        }
        count += i == before.page_count;
    }
    return count;
}

/* An edit of a voxel moves no cut that is not on the way from the voxel to the root. */
static void an_edit_changes_only_pages_on_the_way_to_the_root(void **state)
{
    const struct voxels voxels = {edited_floor, NULL, 8, 1};
    struct bytes file = make_packed(&voxels, 0.5, origin);
    uint64_t seed = 5 + (state == NULL);
    assert_true(umb__load32(file.data + UMB__HEAD_PAGES) > 12);
    for (int i = 0; i < 6; i++) {
        const uint32_t edit[3] = {(uint32_t)(next_random(&seed) >> 40) % 256,
                                  (uint32_t)(next_random(&seed) >> 40) % 256,
                                  (uint32_t)(next_random(&seed) >> 40) % 256};
        const struct voxels edited = {edited_floor, edit, 8, 1};
        struct bytes changed = make_packed(&edited, 0.5, origin);
        const uint32_t count = new_pages(&changed, &file);
        if (count == 0 || count > 4) { /* 256 voxels: at most four levels have pages of their own */
            fail_msg("voxel %u, %u, %u: %u new pages", edit[0], edit[1], edit[2], count);
        }
        bytes_finish(&changed);
    }
    bytes_finish(&file);
}

/* Packs content that `spoil` has changed; it must be refused with a message that contains
 * `words`. */
static void expect_refused(void (*spoil)(struct umb__content *, struct umb__octree *),
                           const char *words)
{
    struct umb__octree octree;
    struct umb__content content;
    struct bytes out = {0};
    struct umb_sink sink = bytes_sink(&out);
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&three_suns, &octree);
    make_content(&three_suns, 0.5, origin, &content);
    spoil(&content, &octree);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, &error),
                     UMB_E_ARGUMENT);
    assert_int_equal(error.status, UMB_E_ARGUMENT);
    if (strstr(error.message, words) == NULL) {
        fail_msg("'%s' does not say '%s'", error.message, words);
    }
    assert_int_equal(out.size, 0);
    umb__octree_finish(&octree);
    bytes_finish(&out);
}

static void far_child(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->level[4].children[0] = octree->brick_count + 1000000;
}

static void far_upper_child(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->level[7].children[0] = UINT32_MAX;
}

static void far_root(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->roots[1].index = 77777777;
}

static void odd_root(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->roots[1].state = (enum umb__node_state)3;
}

static void other_level(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->roots[2].level = 6;
}

static void impossible_mask(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->level[5].masks[0] |= 3;
}

static void short_mask(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->level[5].masks[0] = 0x5554; /* no mixed child, where the lists say some */
}

static void one_root_less(struct umb__content *content, struct umb__octree *octree)
{
    (void)content;
    octree->root_count--;
}

static void no_lights(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->light_count = 0;
}

static void spot_light(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->lights[0].kind = UMB_LIGHT_SPOT;
}

static void nan_direction(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->lights[1].direction[0] = (double)__builtin_nanf("");
}

static void latin1_name(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    memcpy(content->lights[2].name, "S\xf6nne", 6);
}

static void endless_name(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    memset(content->lights[2].name, 'x', UMB_NAME_SIZE);
}

static void shared_frustum(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->lights[2].first_frustum = 1;
}

static void flat_matrix(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->frusta[0].world_to_voxel[2][2] = 0;
}

/* A spot light along +z whose W is `far_w` at the far side. */
static void aim(struct umb__content *content, double far_w, double scale)
{
    struct umb_frustum_info *frustum = &content->frusta[0];
    double(*m)[4] = frustum->world_to_voxel;
    content->lights[0].kind = UMB_LIGHT_SPOT;
    memset(m, 0, sizeof frustum->world_to_voxel);
    for (int i = 0; i < 3; i++) {
        m[i][i] = 1;
    }
    m[2][3] = (double)(1U << frustum->log2_size) - far_w;
    m[3][2] = scale;
}

static void far_side_at_the_light(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    aim(content, 0, 1);
}

static void far_side_behind_the_light(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    aim(content, -1, 1);
}

static void vanishing_axis(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    aim(content, 1, 1e-200); /* its square is 0 */
}

static void infinite_bounds(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->bounds.max[1] = __builtin_inf();
}

static char latin1[] = "d\xe9j\xe0 vu\n";

static void latin1_plan(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->plan = latin1;
}

static void latin1_notes(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->notes = latin1;
}

static void no_settings(struct umb__content *content, struct umb__octree *octree)
{
    (void)octree;
    content->settings = NULL;
}

static void what_a_reader_would_refuse_is_an_argument_error(void **state)
{
    static const struct {
        void (*spoil)(struct umb__content *, struct umb__octree *);
        const char *words;
    } cases[] = {
        {far_child, "level 4"},
        {far_upper_child, "4294967295"},
        {far_root, "77777777"},
        {odd_root, "roots[1].state: 3"},
        {other_level, "roots[2]"},
        {impossible_mask, "level 5"},
        {short_mask, "mask 0x5554"},
        {one_root_less, "roots: 2"},
        {no_lights, "lights: 0"},
        {spot_light, "frusta[0].world_to_voxel"},
        {nan_direction, "lights[1].direction"},
        {latin1_name, "lights[2].name"},
        {endless_name, "lights[2].name"},
        {shared_frustum, "lights[2]"},
        {flat_matrix, "frusta[0].world_to_voxel"},
        {far_side_at_the_light, "its far side is not ahead of the light"},
        {far_side_behind_the_light, "its far side is not ahead of the light"},
        {vanishing_axis, "frusta[0].world_to_voxel"},
        {infinite_bounds, "bounds"},
        {latin1_plan, "plan"},
        {latin1_notes, "notes"},
        {no_settings, "settings: missing"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        expect_refused(cases[i].spoil, cases[i].words);
    }
}

static void packing_only_reads_what_it_is_given(void **state)
{
    struct umb__octree octree;
    struct umb__content content;
    struct bytes out = {0};
    struct umb_sink sink = bytes_sink(&out);
    struct umb_frustum_info frusta[3];
    uint8_t id[UMB_ID_BYTES];
    (void)state;
    make_octree(&three_suns, &octree);
    make_content(&three_suns, 0.5, origin, &content);
    for (size_t i = 0; i < 3; i++) {
        content.frusta[i].voxel_step[0][0] = 123; /* derived by readers; not the writer's to set */
        frusta[i] = content.frusta[i];
    }
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    assert_memory_equal(frusta, content.frusta, sizeof frusta);
    umb__octree_finish(&octree);
    bytes_finish(&out);
}

/* Fails the n-th allocation, once or from then on; counts what is alive. */
struct failing {
    size_t calls, fail_at, live;
    int for_ever;
};

static void *failing_resize(void *user, void *block, size_t bytes)
{
    struct failing *f = user;
    if (bytes == 0) {
        f->live -= block != NULL;
        free(block);
        return NULL;
    }
    f->calls++;
    if (f->fail_at && (f->calls == f->fail_at || (f->for_ever && f->calls > f->fail_at))) {
        return NULL;
    }
    void *result = realloc(block, bytes);
    f->live += result != NULL && block == NULL;
    return result;
}

/* Does everything that can be done with an open asset, with the asset's allocator. */
static enum umb_status write_both(const struct umb_asset *asset, struct bytes *packed,
                                  struct bytes *mapped)
{
    struct umb__octree octree;
    struct umb__content content;
    struct umb_sink packed_sink = bytes_sink(packed), mapped_sink = bytes_sink(mapped);
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    enum umb_status status = umb__asset_export(asset, &octree, &content, &error);
    if (status == UMB_OK) {
        status = umb__pack_write(&content, &octree, &test_digest, &packed_sink, id, &error);
    } else {
        assert_null(content.lights);
        assert_null(octree.roots);
    }
    umb__octree_finish(&octree);
    if (status == UMB_OK) {
        status = umb__mapped_write(asset, &mapped_sink, &error);
    }
    assert_int_equal(error.status, status);
    assert_true(status == UMB_OK || error.message[0] != '\0');
    return status;
}

static void every_failing_allocation_of_the_writers_is_reported(void **state)
{
    struct voxels small = {rough, NULL, 7, 1};
    struct bytes file = make_packed(&small, 0.5, origin);
    struct failing f = {0};
    struct umb_alloc alloc = {failing_resize, &f};
    struct umb_open_options options = {.alloc = &alloc};
    struct umb_asset *asset;
    struct bytes packed = {0}, mapped = {0};
    (void)state;
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, &options, &asset, NULL), UMB_OK);
    size_t live = f.live;
    f.calls = 0;
    assert_int_equal(write_both(asset, &packed, &mapped), UMB_OK);
    size_t total = f.calls;
    assert_memory_equal(packed.data, file.data, file.size);
    assert_true(total > 50);
    for (size_t n = 0; n < 2 * total; n++) {
        struct bytes half = {0}, other = {0};
        f.calls = 0;
        f.fail_at = n / 2 + 1;
        f.for_ever = (int)(n % 2);
        assert_int_equal(write_both(asset, &half, &other), UMB_E_NO_MEMORY);
        assert_int_equal(f.live, live);
        bytes_finish(&half);
        bytes_finish(&other);
    }
    umb_asset_close(asset);
    assert_int_equal(f.live, 0);
    bytes_finish(&file);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

/* A sink that takes so many bytes and then says ENOSPC's status. */
static enum umb_status take_some(void *user, const void *bytes, size_t count)
{
    size_t *left = user;
    (void)bytes;
    if (count > *left) {
        return UMB_E_IO;
    }
    *left -= count;
    return UMB_OK;
}

static void a_sink_that_fails_stops_the_writers_with_its_status(void **state)
{
    struct voxels small = {rough, NULL, 7, 1};
    struct bytes file = make_packed(&small, 0.5, origin);
    struct umb_asset *asset;
    struct umb__octree octree;
    struct umb__content content;
    (void)state;
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    assert_int_equal(umb__asset_export(asset, &octree, &content, NULL), UMB_OK);
    for (size_t room = 0; room < 3 * file.size; room += 97) {
        size_t left = room;
        struct umb_sink sink = {take_some, &left};
        struct umb_error error = {0};
        uint8_t id[UMB_ID_BYTES];
        enum umb_status wanted = room >= file.size ? UMB_OK : UMB_E_IO;
        assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, &error),
                         wanted);
        assert_int_equal(error.status, wanted);
        left = 0;
        assert_int_equal(umb__mapped_write(asset, &sink, &error), UMB_E_IO);
        assert_non_null(strstr(error.message, "input or output failed"));
    }
    umb__octree_finish(&octree);
    umb_asset_close(asset);
    bytes_finish(&file);
}

/* A hasher that runs out of memory at the n-th digest, and reports that as umb_sha256 requires. */
static void failing_digest(void *user, const void *const *parts, const size_t *sizes,
                           size_t part_count, uint8_t out[UMB_ID_BYTES])
{
    size_t *left = user;
    test_digest.digest(NULL, parts, sizes, part_count, out);
    if (*left == 0) {
        memset(out, 0, UMB_ID_BYTES);
    } else {
        --*left;
    }
}

static void a_digest_that_could_not_be_made_never_becomes_an_identity(void **state)
{
    struct voxels small = {rough, NULL, 7, 1};
    struct bytes file = make_packed(&small, 0.5, origin);
    struct umb__octree octree;
    struct umb__content content;
    size_t digests = 0, left;
    const struct umb_sha256 hasher = {.digest = failing_digest, .user = &left};
    (void)state;
    make_octree(&small, &octree);
    make_content(&small, 0.5, origin, &content);
    for (;; digests++) {
        struct bytes out = {0};
        struct umb_sink sink = bytes_sink(&out);
        uint8_t id[UMB_ID_BYTES];
        left = digests;
        enum umb_status status = umb__pack_write(&content, &octree, &hasher, &sink, id, NULL);
        bytes_finish(&out);
        if (status == UMB_OK) {
            break;
        }
        assert_int_equal(status, UMB_E_NO_MEMORY);
        left = digests;
        assert_int_not_equal(umb_packed_prove(file.data, file.size, NULL, &hasher, NULL), UMB_OK);
    }
    assert_true(digests >= 2); /* a page and the id */
    umb__octree_finish(&octree);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_trees_under_other_numbers_give_equal_files),
        cmocka_unit_test(pages_with_bricks_stand_alone_and_their_copies_become_one_node_again),
        cmocka_unit_test(trees_that_share_much_have_larger_pages),
        cmocka_unit_test(an_edit_changes_only_pages_on_the_way_to_the_root),
        cmocka_unit_test(what_a_reader_would_refuse_is_an_argument_error),
        cmocka_unit_test(packing_only_reads_what_it_is_given),
        cmocka_unit_test(every_failing_allocation_of_the_writers_is_reported),
        cmocka_unit_test(a_sink_that_fails_stops_the_writers_with_its_status),
        cmocka_unit_test(a_digest_that_could_not_be_made_never_becomes_an_identity),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
