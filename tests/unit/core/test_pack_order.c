/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares the order of a packed file with docs/reference/umb-format.md, section 5, followed word
 * by word: nodes are visited by recursion, and plain arrays hold their places.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "format/node_pool.h"
#include "format/pack_order.h"
#include "make_asset.h"

#define PAGE   8192U
#define WAITS  UINT32_MAX
#define LEVELS 14U

/* The order under construction. */
struct slow {
    const struct umb__octree *octree;
    uint32_t *page_of[LEVELS]; /* [node] page + 1 that it stands in last, WAITS, or 0 */
    struct umb__node_ref *sequence, *waiting;
    size_t *page_first;
    size_t count, waiting_count;
    uint32_t pages;
    uint64_t bytes, all_bytes; /* of the open page; of all closed ones */
    uint32_t low;
    int copies;
};

static void *room(size_t count, size_t size)
{
    void *block = calloc(count, size);
    assert_non_null(block);
    return block;
}

static uint32_t count_of(const struct umb__octree *octree, uint32_t level)
{
    return level == 3 ? octree->brick_count : octree->level[level].count;
}

static void slow_close(struct slow *s)
{
    if (s->bytes > 0) {
        s->pages++;
        s->page_first[s->pages] = s->count;
        s->all_bytes += s->bytes;
        s->bytes = 0;
    }
}

static uint64_t slow_estimate(const struct slow *s, uint32_t level, uint32_t node)
{
    uint64_t bytes = 2;
    if (level == 3) {
        bytes = 4;
        for (int z = 1; z < 8; z++) {
            bytes += s->octree->bricks[node][z] != s->octree->bricks[node][z - 1] ? 3 : 0;
        }
        return bytes;
    }
    const struct umb__octree_level *nodes = &s->octree->level[level];
    for (uint32_t c = nodes->first[node]; c < nodes->first[node + 1]; c++) {
        const uint32_t page = s->page_of[level - 1][nodes->children[c]];
        bytes += 1 + (!s->copies && page != 0 && page != s->pages + 1 ? 8U : 0U);
    }
    return bytes;
}

static void slow_visit(struct slow *s, uint32_t level, uint32_t node)
{
    const uint32_t page = s->page_of[level][node];
    if (s->copies ? page == s->pages + 1 : page != 0 && page != WAITS) {
        return;
    }
    s->bytes += slow_estimate(s, level, node);
    s->page_of[level][node] = s->pages + 1;
    s->sequence[s->count++] = (struct umb__node_ref){level, node};
    if (!s->copies && s->bytes >= PAGE) {
        slow_close(s);
    }
    const struct umb__octree_level *nodes = &s->octree->level[level];
    for (uint32_t c = level > 3 ? nodes->first[node] : 0; level > 3 && c < nodes->first[node + 1];
         c++) {
        const uint32_t child = nodes->children[c];
        if (level > s->low) {
            slow_visit(s, level - 1, child);
        } else if (s->page_of[level - 1][child] == 0) {
            s->page_of[level - 1][child] = WAITS;
            s->waiting[s->waiting_count++] = (struct umb__node_ref){level - 1, child};
        }
    }
}

static void slow_root(struct slow *s, struct umb__node_ref root)
{
    const uint32_t page = s->page_of[root.level][root.index];
    if (page == 0 || page == WAITS) {
        slow_visit(s, root.level, root.index);
        if (s->copies && s->bytes >= PAGE) {
            slow_close(s);
        }
    }
}

/* Takes the lowest band back. */
static void slow_rewind(struct slow *s, size_t count, uint32_t pages)
{
    s->count = count;
    s->pages = pages;
    s->bytes = s->all_bytes = 0;
    for (uint32_t level = 3; level < 8; level++) {
        memset(s->page_of[level], 0, count_of(s->octree, level) * sizeof(uint32_t));
    }
}

/* Decides whether copies are worth their bytes, from sampled runs and their share of the nodes
 * written once. */
static int slow_decide(struct slow *s, const struct umb__node_ref *roots, size_t count)
{
    const size_t first = s->count, k = 1 + count / 16384;
    const uint32_t first_page = s->pages;
    uint64_t own, sampled = 0;
    s->all_bytes = 0;
    s->copies = 1; /* an estimate without references; what is in one page stands once */
    for (size_t i = 0; i < count; i++) {
        slow_visit(s, roots[i].level, roots[i].index);
    }
    slow_close(s);
    own = s->all_bytes;
    slow_rewind(s, first, first_page);
    for (size_t i = 0; i < count; i++) {
        if (i / 64 % k == 0) {
            slow_root(s, roots[i]);
            sampled++;
        }
        if (k > 1 && i % 64 == 63) {
            slow_close(s);
        }
    }
    slow_close(s);
    const uint64_t copied = s->all_bytes;
    slow_rewind(s, first, first_page);
    return 5 * copied * count <= 12 * own * sampled;
}

/* In: octree: one root, of level 13. Returns whether nodes of the lowest band are copied. */
static int slow_order(struct slow *s)
{
    static const uint32_t lows[] = {13, 8, 3};
    struct umb__node_ref *roots = room(1, sizeof *roots);
    size_t root_count = 1;
    roots[0] = (struct umb__node_ref){13, s->octree->roots[0].index};
    for (int band = 0; band < 3; band++) {
        s->low = lows[band];
        if (band == 2) {
            s->copies = slow_decide(s, roots, root_count);
        }
        for (size_t i = 0; i < root_count; i++) {
            slow_root(s, roots[i]);
        }
        slow_close(s);
        free(roots);
        roots = s->waiting;
        root_count = s->waiting_count;
        s->waiting = room(1 << 20, sizeof *s->waiting);
        s->waiting_count = 0;
    }
    free(roots);
    return s->copies;
}

/* A tree of random nodes. In: near: true: a child's place in its level is about that of its parent,
 * so that neighbours share children; false: any place. Copies in 20000 trees are decided by a
 * sample, and all trees are reached. */
static void random_octree(uint64_t seed, uint32_t trees, int near, struct umb__octree *octree)
{
    uint32_t counts[LEVELS] = {0, 0, 0, trees, trees, trees, trees, trees};
    uint32_t refs[2][1 << 17], level = 13, root = 0;
    struct umb__pool pool;
    umb__pool_init(&pool, NULL, SIZE_MAX);
    for (uint32_t l = 8; l < LEVELS; l++) {
        counts[l] = counts[l - 1] / 6 + 1;
    }
    for (uint32_t l = 3; l < LEVELS; l++) {
        for (uint32_t i = 0; i < counts[l]; i++) {
            uint64_t slices[8] = {1, i};
            uint32_t children[8];
            for (uint32_t c = 0; c < 8 && l > 3; c++) {
                const uint64_t any = next_random(&seed) >> 20;
                const uint64_t at = near && (l <= 7 || trees < 20000)
                                        ? (uint64_t)i * counts[l - 1] / counts[l] + any % 16
                                        : (l > 7 ? 6ULL * i + c : any);
                children[c] =
                    any % 7 > (l > 7 ? 6 : 3) ? UMB__REF_LIT : refs[l & 1][at % counts[l - 1]];
            }
            children[0] = l > 3 && i % 2 ? UMB__REF_SHADOWED : children[0];
            slices[7] = next_random(&seed) % 3;
            const enum umb_status status = l == 3 ? umb__pool_brick(&pool, slices, &root, NULL)
                                                  : umb__pool_node(&pool, l, children, &root, NULL);
            assert_int_equal(status, UMB_OK);
            refs[(l + 1) & 1][i] = root;
        }
    }
    assert_int_equal(umb__pool_take(&pool, &root, &level, 1, octree, NULL), UMB_OK);
    assert_int_equal(octree->roots[0].state, UMB__NODE_MIXED);
}

/* Compares page by page and level by level; each node must be found where it stands. */
static void compare_pages(const struct slow *s, const struct umb__pack_order *order)
{
    uint32_t next[LEVELS] = {0};
    assert_int_equal(order->page_count, s->pages);
    for (uint32_t page = 0; page < s->pages; page++) {
        for (uint32_t level = 3; level < LEVELS; level++) {
            assert_int_equal(order->begins[level][page], next[level]);
        }
        for (size_t i = s->page_first[page]; i < s->page_first[page + 1]; i++) {
            const struct umb__node_ref node = s->sequence[i];
            const uint32_t ordinal = next[node.level]++;
            const struct umb__node_place place = umb__pack_place(order, node.level, ordinal);
            assert_int_equal(order->nodes[node.level][ordinal], node.index);
            assert_int_equal(place.page, page);
            assert_int_equal(place.position, ordinal - order->begins[node.level][page]);
            if (s->page_of[node.level][node.index] == page + 1 &&
                (page < order->alone_from || node.level >= 7)) {
                assert_int_equal(order->ordinals[node.level][node.index], ordinal);
            }
        }
    }
    for (uint32_t level = 3; level < LEVELS; level++) {
        assert_int_equal(order->begins[level][s->pages], next[level]);
    }
}

/* Helpers of which each does every third job, the last one first. */
static void run_backwards(void *user, void (*job)(void *, uint32_t, unsigned), void *job_user,
                          uint32_t jobs)
{
    (void)user;
    while (jobs-- > 0) {
        job(job_user, jobs, jobs % 3);
    }
}

/* Orders in steps of three pages, in which no memory may move. Returns the number of steps. */
static int order_in_steps(const struct umb__octree *octree, const struct umb_workers *workers,
                          struct umb__pack_order *order)
{
    struct umb__pack_ordering *ordering;
    int steps = 0;
    assert_int_equal(umb__pack_order_begin(octree, workers, false, order, &ordering, NULL), UMB_OK);
    for (; !umb__pack_order_complete(ordering); steps++) {
        const uint32_t before = order->page_count;
        assert_int_equal(umb__pack_order_reserve(ordering, 3), UMB_OK);
        const uint32_t *const nodes = order->nodes[3], *const begins = order->begins[3];
        assert_int_equal(umb__pack_order_step(ordering, 3), UMB_OK);
        assert_true(order->page_count == before + 3 || umb__pack_order_complete(ordering));
        assert_true(order->page_count <= before + 3);
        assert_ptr_equal(order->nodes[3], nodes);
        assert_ptr_equal(order->begins[3], begins);
    }
    umb__pack_ordering_destroy(ordering);
    return steps;
}

/* Returns whether there are copies. */
static int compare_orders(const struct umb__octree *octree, const struct umb_workers *workers,
                          int *steps)
{
    struct slow s = {.octree = octree};
    struct umb__pack_order order;
    const size_t most = (size_t)1 << 24;
    for (uint32_t level = 3; level < LEVELS; level++) {
        s.page_of[level] = room(count_of(octree, level) + 1, sizeof(uint32_t));
    }
    s.sequence = room(most, sizeof *s.sequence);
    s.waiting = room(1 << 20, sizeof *s.waiting);
    s.page_first = room(1 << 20, sizeof *s.page_first);
    const int copies = slow_order(&s);
    assert_true(s.count < most);
    *steps += order_in_steps(octree, workers, &order);
    assert_int_equal(order.alone_from != UINT32_MAX, copies);
    compare_pages(&s, &order);
    umb__pack_order_finish(&order);
    for (uint32_t level = 3; level < LEVELS; level++) {
        free(s.page_of[level]);
    }
    free(s.sequence);
    free(s.waiting);
    free(s.page_first);
    return copies;
}

static void orders_are_those_of_the_format_page(void **state)
{
    /* Numbers of trees: with few of them all trees decide whether copies are worth it, with many a
     * sample does. */
    static const uint32_t trees[] = {50, 3000, 15000, 20000};
    const struct umb_workers three = {3, run_backwards, NULL};
    int worth[2] = {0}, steps = 0;
    (void)state;
    for (uint64_t seed = 1; seed <= 8; seed++) {
        struct umb__octree octree;
        random_octree(seed, trees[seed / 2 % 4], seed % 2, &octree);
        worth[compare_orders(&octree, seed % 4 < 2 ? &three : NULL, &steps)]++;
        umb__octree_finish(&octree);
    }
    print_message("with copies %d, without %d, %d steps\n", worth[1], worth[0], steps);
    assert_true(worth[0] > 1 && worth[1] > 1 && steps > 1);
}

/* Bytes that are allocated, and the most that were. */
struct tally {
    size_t bytes, peak;
};

static void *counted_resize(void *user, void *block, size_t bytes)
{
    struct tally *tally = user;
    size_t *const old = block != NULL ? (size_t *)block - 2 : NULL;
    tally->bytes -= old != NULL ? *old : 0;
    if (bytes == 0) {
        free(old);
        return NULL;
    }
    size_t *const header = realloc(old, bytes + 2 * sizeof *header);
    assert_non_null(header);
    *header = bytes;
    tally->bytes += bytes;
    tally->peak = tally->bytes > tally->peak ? tally->bytes : tally->peak;
    return header + 2;
}

/* Most bytes that an order takes before its first step. */
static size_t peak_with_helpers(const struct umb__octree *octree, unsigned count)
{
    struct tally tally = {0};
    const struct umb_alloc alloc = {counted_resize, &tally};
    const struct umb_workers workers = {count, run_backwards, NULL};
    struct umb__octree counted = *octree;
    struct umb__pack_order order;
    struct umb__pack_ordering *ordering;
    counted.alloc = &alloc;
    assert_int_equal(umb__pack_order_begin(&counted, &workers, false, &order, &ordering, NULL),
                     UMB_OK);
    umb__pack_ordering_destroy(ordering);
    umb__pack_order_finish(&order);
    assert_int_equal(tally.bytes, 0);
    return tally.peak;
}

static void many_helpers_take_no_more_memory_than_some(void **state)
{
    struct umb__octree octree;
    (void)state;
    random_octree(6, 20000, 0, &octree); /* so many trees that some are asked */
    const size_t some = peak_with_helpers(&octree, 8), many = peak_with_helpers(&octree, 256);
    umb__octree_finish(&octree);
    if (many > some + some / 100) {
        fail_msg("%zu bytes with 8 helpers, %zu with 256", some, many);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(orders_are_those_of_the_format_page),
        cmocka_unit_test(many_helpers_take_no_more_memory_than_some),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
