/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One node that very many nodes of other pages claim as their child: its page comes and goes at a
 * cost that its claims bound, and answers are right before and after.
 */
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/numbers.h"
#include "format/canonical.h"
#include "format/directory.h"
#include "partial_fixture.h"

#include "partial_oracle.h"

enum {
    LOG2_SIZE = 12,
    LEVEL = 5, /* Level of the nodes that claim the one node below them */
    POINTS = 2000,
};

#define SIDE_M 100.0

enum {
    TREES = 4,         /* Pages of levels 7 to 5 */
    ROOTS = 4096,      /* Nodes of level 8 */
    TREE_NODES = 8192, /* Nodes of level 7 of each such page */
};

/* A page as a hostile writer makes it. */
struct raw_page {
    uint8_t *at, *bytes, *links;
    uint32_t link_count, high, low, nodes;
};

static struct raw_page begin_raw(uint32_t high, uint32_t low)
{
    struct raw_page page = {.bytes = calloc(UMB__PAGE_RAW_MAX, 1), .high = high, .low = low};
    page.links = calloc(TREES + 1, 1);
    const uint8_t head[3] = {UMB__PAGE_ENCODING, (uint8_t)high, (uint8_t)low};
    memcpy(page.bytes, head, sizeof head);
    page.at = page.bytes + sizeof head;
    return page;
}

static void put_count(struct raw_page *page, uint32_t count)
{
    page->at = umb__put_number(page->at, count);
    page->nodes += count;
}

/* Nodes whose first children are the next nodes; the others are lit or not. */
static void put_masks(struct raw_page *page, uint32_t count, uint32_t mixed, unsigned state,
                      uint64_t *seed)
{
    for (uint32_t i = 0; i < count; i++, page->at += 2) {
        unsigned mask = (unsigned)next_random(seed) & 0x5555U;
        for (uint32_t c = 0; c < mixed; c++) {
            mask = (mask & ~(3U << (2 * c))) | state << (2 * c);
        }
        umb__store16(page->at, (uint16_t)mask);
    }
}

/* Levels 12 to 8. The children of level 8 are in the TREES pages behind this one. */
static struct raw_page top_page(uint64_t *seed)
{
    static uint32_t references[8 * ROOTS];
    struct raw_page page = begin_raw(LOG2_SIZE, 8);
    for (uint32_t count = 1; count <= ROOTS; count *= 8) {
        put_count(&page, count);
    }
    for (uint32_t count = 1; count < ROOTS; count *= 8) {
        *page.at++ = 0;
        put_masks(&page, count, 8, 3, seed);
    }
    page.at = umb__put_number(page.at, 8 * ROOTS);
    for (uint32_t i = 0; i < 8 * ROOTS; i++) {
        *page.at++ = i > 0 && i % TREE_NODES == 0;
        references[i] = i;
    }
    page.at += 8 * ROOTS; /* each position follows the one before */
    put_masks(&page, ROOTS, 8, 2, seed);
    page.at = umb__put_list(page.at, references, 8 * ROOTS, umb__list_high_bits(8 * ROOTS));
    page.links[0] = 2; /* page 1, and those behind it */
    page.link_count = TREES;
    return page;
}

/* Levels 7 to 5. Each node of level 5 claims the one node of the last page. */
static struct raw_page tree_page(uint32_t per_node, uint64_t *seed)
{
    struct raw_page page = begin_raw(7, LEVEL);
    const uint32_t claims = 8 * TREE_NODES * per_node;
    put_count(&page, TREE_NODES);
    put_count(&page, 8 * TREE_NODES);
    put_count(&page, claims);
    *page.at++ = 0;
    put_masks(&page, TREE_NODES, 8, 3, seed);
    *page.at++ = 0;
    put_masks(&page, 8 * TREE_NODES, per_node, 3, seed);
    const uint8_t other[3] = {1, 0, 0};
    memcpy(page.at, other, sizeof other);
    page.at += sizeof other;
    put_masks(&page, claims, 1, 2, seed);
    page.at += claims; /* all references are 0 */
    page.links[0] = 2 * (TREES + 1);
    page.link_count = 1;
    return page;
}

/* A node of level 4 with one brick. */
static struct raw_page claimed_page(void)
{
    static const uint8_t rest[] = {1, 1, 0, 3, 0, 1, 1, 1, 1, 0};
    struct raw_page page = begin_raw(4, 3);
    memcpy(page.at, rest, sizeof rest);
    page.at += sizeof rest;
    page.nodes = 2;
    return page;
}

/* Compresses a page, and writes its entry without the offset. */
static struct bytes store_raw(const struct raw_page *page, uint8_t *entry)
{
    const size_t size = (size_t)(page->at - page->bytes), room = ZSTD_compressBound(size);
    struct bytes stored = {.data = malloc(room), .capacity = room};
    const void *part = page->bytes;
    stored.size = ZSTD_compress(stored.data, room, page->bytes, size, 1);
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)stored.size);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(stored.data, stored.size));
    entry[UMB__PAGE_LEVEL_HIGH] = (uint8_t)page->high;
    entry[UMB__PAGE_LEVEL_LOW] = (uint8_t)page->low;
    umb__store16(entry + UMB__PAGE_LINKS, (uint16_t)page->link_count);
    umb__store32(entry + UMB__PAGE_RECORDS, page->nodes);
    test_digest.digest(test_digest.user, &part, &size, 1, entry + UMB__PAGE_HASH);
    return stored;
}

/* An asset as only a hostile server makes it: 2^18 times per_node nodes of level 5 whose one child
 * is the same node of another page. */
static struct bytes claimed_asset(uint32_t per_node)
{
    static const double origin[3] = {0, 0, 0};
    enum {
        PAGES = TREES + 2
    };
    const struct voxels voxels = {.log2_size = LOG2_SIZE, .frustum_count = 1};
    struct umb__packed_root root = {UMB__NODE_MIXED, 0, 0};
    struct umb__canonical canonical = {.roots = &root};
    struct raw_page pages[PAGES];
    struct bytes stored[PAGES], file = {0};
    struct umb_sink sink = bytes_sink(&file);
    uint8_t block[PAGES * UMB__PAGE_ENTRY + 64] = {0}, table[UMB__BLOCK_ENTRY] = {0}, *made;
    uint64_t seed = 7;
    uint32_t size = PAGES * UMB__PAGE_ENTRY;
    make_content(&voxels, SIDE_M / (1U << LOG2_SIZE), origin, &canonical.content);
    for (uint32_t l = 3; l <= LOG2_SIZE; l++) {
        canonical.counts[l] = (uint64_t)ROOTS * 64 * 8 * 4; /* at least those that there are */
    }
    for (uint32_t i = 0; i < PAGES; i++) {
        pages[i] =
            i == 0 ? top_page(&seed) : (i <= TREES ? tree_page(per_node, &seed) : claimed_page());
        stored[i] = store_raw(&pages[i], block + (size_t)i * UMB__PAGE_ENTRY);
        memcpy(block + size, pages[i].links, pages[i].link_count);
        size += pages[i].link_count;
    }
    struct umb__head head = {.encoding = UMB_ENCODING_PACKED,
                             .directory = table,
                             .directory_count = 1,
                             .page_count = PAGES,
                             .first_block = size};
    assert_int_equal(umb__canonical_encode(&canonical, NULL, &made, &head.canonical_length, NULL),
                     UMB_OK);
    head.canonical = made;
    head.head_length = umb__head_length(&head);
    head.file_length = head.head_length + size;
    for (uint32_t i = 0; i < PAGES; i++) {
        umb__store64(block + (size_t)i * UMB__PAGE_ENTRY, head.file_length);
        head.file_length += stored[i].size;
    }
    assert_true(umb__block_seal(block, size, PAGES, &test_digest, table));
    umb__store64(table + UMB__BLOCK_END, size);
    assert_true(umb__directory_identify(&head, &test_digest, NULL, head.id));
    uint8_t *front = umb__head_make(&head, NULL);
    assert_int_equal(sink.write(sink.user, front, (size_t)head.head_length), UMB_OK);
    assert_int_equal(sink.write(sink.user, block, size), UMB_OK);
    for (uint32_t i = 0; i < PAGES; i++) {
        assert_int_equal(sink.write(sink.user, stored[i].data, stored[i].size), UMB_OK);
        bytes_finish(&stored[i]);
        free(pages[i].bytes);
        free(pages[i].links);
    }
    free(front);
    free(made);
    return file;
}

static void expect_answers_of_the_oracle(struct umb_partial *partial)
{
    static double positions[3 * POINTS];
    static float got[4][POINTS], wanted[4][POINTS];
    struct oracle oracle = {.part = partial};
    const struct umb_query_settings settings = {.taps = 1};
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_partial_answers ours = {got[0], got[1], got[2], got[3], 0, 0, {0}, {0}};
    struct umb_partial_answers theirs = {wanted[0], wanted[1], wanted[2], wanted[3],
                                         0,         0,         {0},       {0}};
    uint64_t seed = 11;
    for (size_t i = 0; i < 3 * (size_t)POINTS; i++) {
        positions[i] = random_unit(&seed) * SIDE_M;
    }
    assert_int_equal(oracle_build(&oracle, NULL), UMB_OK);
    assert_int_equal(umb_partial_query(partial, &settings, &points, 0, &ours, NULL), UMB_OK);
    assert_int_equal(oracle_query(&oracle, &settings, &points, 0, &theirs, NULL), UMB_OK);
    for (unsigned i = 0; i < 4; i++) {
        assert_memory_equal(got[i], wanted[i], sizeof got[i]);
    }
    oracle_finish(&oracle);
}

/* Returns the number of wide nodes that watch a page. */
static uint64_t watchers_of(const struct umb_partial *p, uint32_t page)
{
    uint64_t count = 0;
    for (uint32_t at = p->pages[page].watchers; at > 0; at = p->watches[at - 1].next) {
        count++;
    }
    return count;
}

static void a_node_that_a_million_nodes_claim_comes_and_goes(void **state)
{
    (void)state;
    const uint32_t per_node = (uint32_t)short_count(4, 1), parents = per_node << 18;
    const struct umb_partial_view view = {.light = UINT32_MAX};
    struct partial_fixture f = {.file = claimed_asset(per_node)};
    struct umb_partial_stats stats;
    uint32_t claimed = 0;
    f.partial = partial_open(&f.file, (uint64_t)1 << 32);
    umb_partial_get_stats(f.partial, &stats);
    assert_int_equal(stats.page_count, TREES + 2);
    for (uint32_t page = stats.page_count; page-- > 0;) {
        partial_add(&f, page);
    }
    partial_build(&f);
    for (uint32_t page = 0; page < stats.page_count; page++) {
        claimed = watchers_of(f.partial, page) > watchers_of(f.partial, claimed) ? page : claimed;
    }
    /* But for those of its own page, each parent watches the page, once. */
    assert_true(watchers_of(f.partial, claimed) > parents - parents / 64);
    assert_true(watchers_of(f.partial, claimed) <= parents);
    umb_partial_drop(f.partial, claimed);
    partial_build(&f);
    expect_answers_of_the_oracle(f.partial);
    assert_int_equal(umb_partial_want(f.partial, &view, 0, NULL), UMB_OK);
    assert_true(f.partial->want_steps <= 1024 + 17 * f.partial->node_count);
    uint32_t list[2];
    assert_int_equal(umb_partial_missing(f.partial, list, 2, 0), 1);
    assert_int_equal(list[0], claimed);
    partial_add(&f, claimed);
    partial_build(&f);
    expect_answers_of_the_oracle(f.partial);
    umb_partial_close(f.partial);
    bytes_finish(&f.file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_node_that_a_million_nodes_claim_comes_and_goes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
