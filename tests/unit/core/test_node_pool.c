/* SPDX-License-Identifier: Apache-2.0 */
/* The pool under a budget: most of the budget can be used, none is exceeded, and a refusal changes
 * nothing. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "base/page_alloc.h"
#include "format/node_pool_parts.h"

/* Two allocators: one copies arrays when they grow, one moves their pages. */
static const struct umb_alloc *const allocs[] = {NULL, &umb__page_alloc};

/* The n-th of many different bricks. */
static void brick_of(uint32_t n, uint64_t slices[8])
{
    memset(slices, 0, 8 * sizeof slices[0]);
    slices[0] = 1;
    slices[7] = n;
}

/* Adds bricks until the budget is used up; returns their number. */
static uint32_t fill_with_bricks(struct umb__pool *pool, struct umb_error *error)
{
    uint64_t slices[8];
    uint32_t ref, n = 0;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK) {
        brick_of(n, slices);
        status = umb__pool_brick(pool, slices, &ref, error);
        assert_true(pool->bytes <= pool->max_bytes);
        if (status == UMB_OK) {
            assert_int_equal(ref, n);
            n++;
        }
    }
    assert_int_equal(status, UMB_E_LIMIT);
    return n;
}

static void most_of_a_budget_holds_bricks(void **state)
{
    (void)state;
    for (size_t budget = 300000, i = 0; budget < 30000000; budget += budget / 5, i++) {
        struct umb__pool pool;
        struct umb_error error;
        umb__pool_init(&pool, allocs[i % 2], budget);
        const uint32_t count = fill_with_bricks(&pool, &error);
        if ((uint64_t)count * 64 < budget / 3) {
            fail_msg("budget %zu: only %u bricks", budget, count);
        }
        for (uint32_t n = 0; n < count; n += 17) { /* all are still found */
            uint64_t slices[8];
            uint32_t ref;
            brick_of(n, slices);
            assert_int_equal(umb__pool_brick(&pool, slices, &ref, &error), UMB_OK);
            assert_int_equal(ref, n);
        }
        umb__pool_finish(&pool);
    }
}

static void most_of_a_budget_holds_nodes(void **state)
{
    (void)state;
    for (size_t budget = 300000, i = 0; budget < 30000000; budget += budget / 5, i++) {
        struct umb__pool pool;
        struct umb_error error;
        umb__pool_init(&pool, allocs[i % 2], budget);
        uint32_t count = 0;
        enum umb_status status = UMB_OK;
        while (status == UMB_OK) {
            /* Two mixed children: 2 + 4 + 8 bytes a node, and its slot. */
            uint32_t children[8] = {count, 7}, ref;
            for (int c = 2; c < 8; c++) {
                children[c] = UMB__REF_LIT;
            }
            status = umb__pool_node(&pool, 5, children, &ref, &error);
            assert_true(pool.bytes <= budget);
            count += status == UMB_OK;
        }
        assert_int_equal(status, UMB_E_LIMIT);
        if ((uint64_t)count * 14 < budget / 5) {
            fail_msg("budget %zu: only %u nodes", budget, count);
        }
        umb__pool_finish(&pool);
    }
}

static uint32_t draw(uint32_t *seed, uint32_t end)
{
    *seed = *seed * 1664525U + 1013904223U;
    return (uint32_t)((uint64_t)*seed * end >> 32);
}

/* Many bricks and two levels of nodes over them, a third of them equal to others of any pool. */
static void fill_with_nodes(struct umb__pool *pool, uint32_t seed)
{
    uint32_t refs[3][2000];
    for (uint32_t i = 0; i < 2000; i++) {
        uint64_t slices[8];
        brick_of(draw(&seed, 3000), slices);
        assert_int_equal(umb__pool_brick(pool, slices, &refs[0][i], NULL), UMB_OK);
    }
    for (uint32_t level = 4; level <= 5; level++) {
        for (uint32_t i = 0; i < 2000; i++) {
            uint32_t children[8];
            for (int c = 0; c < 8; c++) {
                const uint32_t kind = draw(&seed, 4);
                children[c] = kind == 0   ? UMB__REF_LIT
                              : kind == 1 ? UMB__REF_SHADOWED
                                          : refs[level - 4][draw(&seed, 40)];
            }
            assert_int_equal(umb__pool_node(pool, level, children, &refs[level - 3][i], NULL),
                             UMB_OK);
        }
    }
}

/* Returns 1 if two nodes of two pools are equal, down to the bricks. */
static int same_node(const struct umb__pool *a, const struct umb__pool *b, uint32_t level,
                     uint32_t i, uint32_t k)
{
    if (level == UMB_LEVEL_BRICK) {
        return memcmp(a->bricks[i], b->bricks[k], sizeof a->bricks[i]) == 0;
    }
    const struct umb__pool_level *la = &a->level[level], *lb = &b->level[level];
    int same = la->masks[i] == lb->masks[k];
    for (uint32_t c = 0; same && c < la->first[i + 1] - la->first[i]; c++) {
        same = same_node(a, b, level - 1, la->children[la->first[i] + c],
                         lb->children[lb->first[k] + c]);
    }
    return same;
}

static void merge_and_compare(int loose)
{
    struct umb__pool all, again, part;
    struct umb__pool_numbers numbers = {0};
    umb__pool_init(&all, NULL, SIZE_MAX);
    umb__pool_init(&again, NULL, SIZE_MAX);
    if (loose) {
        umb__pool_init_loose(&part, NULL, SIZE_MAX);
    } else {
        umb__pool_init(&part, NULL, SIZE_MAX);
    }
    for (uint32_t seed = 1; seed <= 6; seed++) {
        umb__pool_clear(&part);
        fill_with_nodes(&part, seed % 4); /* 1 and 2 come twice */
        assert_int_equal(umb__pool_merge(&all, &part, 5, &numbers, NULL), UMB_OK);
        fill_with_nodes(&again, seed % 4); /* one at a time: the oracle */
        for (uint32_t i = 0; i < part.level[5].count; i++) {
            assert_true(same_node(&part, &all, 5, i, numbers.refs[i]));
        }
        assert_int_equal(all.level[UMB_LEVEL_BRICK].count, again.level[UMB_LEVEL_BRICK].count);
        for (uint32_t level = 4; level <= 5; level++) {
            assert_int_equal(all.level[level].count, again.level[level].count);
            assert_int_equal(all.level[level].child_count, again.level[level].child_count);
        }
    }
    umb__pool_clear(&part);
    assert_int_equal(umb__pool_merge(&all, &part, 5, &numbers, NULL), UMB_OK);
    assert_int_equal(all.level[UMB_LEVEL_BRICK].count, again.level[UMB_LEVEL_BRICK].count);
    umb__pool_numbers_finish(&numbers);
    umb__pool_finish(&part);
    umb__pool_finish(&again);
    umb__pool_finish(&all);
}

static void merged_pools_hold_what_each_held_and_nothing_twice(void **state)
{
    (void)state;
    merge_and_compare(0);
}

static void merged_loose_pools_come_to_the_same(void **state)
{
    (void)state;
    merge_and_compare(1);
}

static void a_pool_that_never_held_anything_adds_nothing(void **state)
{
    (void)state;
    struct umb__pool all, none;
    struct umb__pool_numbers numbers = {0};
    umb__pool_init(&all, NULL, SIZE_MAX);
    umb__pool_init_loose(&none, NULL, SIZE_MAX);
    assert_int_equal(umb__pool_merge(&all, &none, 5, &numbers, NULL), UMB_OK);
    assert_int_equal(all.level[UMB_LEVEL_BRICK].count, 0);
    umb__pool_numbers_finish(&numbers);
    umb__pool_finish(&none);
    umb__pool_finish(&all);
}

static void a_loose_pool_knows_the_latest_bricks_again(void **state)
{
    (void)state;
    struct umb__pool pool;
    uint64_t slices[8];
    uint32_t ref;
    umb__pool_init_loose(&pool, NULL, SIZE_MAX);
    for (uint32_t round = 0; round < 2; round++) {
        for (uint32_t n = 0; n < 5000; n++) {
            brick_of(n, slices);
            assert_int_equal(umb__pool_brick(&pool, slices, &ref, NULL), UMB_OK);
            assert_memory_equal(pool.bricks[ref], slices, sizeof slices);
            const uint32_t first = ref, count = pool.level[UMB_LEVEL_BRICK].count;
            assert_int_equal(umb__pool_brick(&pool, slices, &ref, NULL), UMB_OK);
            assert_int_equal(ref, first);
            assert_int_equal(pool.level[UMB_LEVEL_BRICK].count, count);
        }
    }
    assert_true(pool.level[UMB_LEVEL_BRICK].count >
                5000); /* most were forgotten by the second round */
    umb__pool_clear(&pool);
    assert_int_equal(umb__pool_brick(&pool, slices, &ref, NULL), UMB_OK);
    assert_int_equal(ref, 0);
    umb__pool_finish(&pool);
}

static void a_loose_pool_adds_every_node_and_its_merge_adds_it_once(void **state)
{
    (void)state;
    struct umb__pool loose, pool;
    struct umb__pool_numbers numbers = {0};
    uint64_t slices[8];
    uint32_t children[8], ref;
    umb__pool_init_loose(&loose, NULL, SIZE_MAX);
    umb__pool_init(&pool, NULL, SIZE_MAX);
    brick_of(1, slices);
    assert_int_equal(umb__pool_brick(&loose, slices, &ref, NULL), UMB_OK);
    for (int c = 0; c < 8; c++) {
        children[c] = c == 3 ? ref : UMB__REF_LIT;
    }
    for (uint32_t n = 0; n < 3000; n++) {
        assert_int_equal(umb__pool_node(&loose, 4, children, &ref, NULL), UMB_OK);
        assert_int_equal(ref, n);
    }
    children[3] = UMB__REF_LIT; /* uniform: never a node */
    assert_int_equal(umb__pool_node(&loose, 4, children, &ref, NULL), UMB_OK);
    assert_int_equal(ref, UMB__REF_LIT);
    assert_int_equal(umb__pool_merge(&pool, &loose, 4, &numbers, NULL), UMB_OK);
    assert_int_equal(pool.level[4].count, 1);
    for (uint32_t n = 0; n < 3000; n++) {
        assert_int_equal(numbers.refs[n], 0);
    }
    umb__pool_numbers_finish(&numbers);
    umb__pool_finish(&loose);
    umb__pool_finish(&pool);
}

/* A pool that had more than its share, or ran out of memory, is used again for another square. */
static void a_loose_pool_that_was_refused_memory_is_sound(void **state)
{
    (void)state;
    uint32_t refused = 0;
    for (size_t budget = 0; budget < 200000; budget += 2000) {
        struct umb__pool pool;
        umb__pool_init_loose(&pool, NULL, budget);
        for (uint32_t n = 0; n < 2000; n++) {
            uint64_t slices[8];
            uint32_t ref;
            brick_of(n, slices);
            const enum umb_status status = umb__pool_brick(&pool, slices, &ref, NULL);
            if (status != UMB_OK) {
                assert_int_equal(status, UMB_E_LIMIT);
                refused++;
            }
        }
        umb__pool_clear(&pool);
        pool.max_bytes = SIZE_MAX;
        fill_with_nodes(&pool, 1);
        umb__pool_finish(&pool);
    }
    assert_true(refused > 0);
}

static void a_merge_ends_at_the_budget(void **state)
{
    (void)state;
    struct umb__pool part, pool;
    struct umb__pool_numbers numbers = {0};
    struct umb_error error;
    umb__pool_init(&part, NULL, SIZE_MAX);
    fill_with_nodes(&part, 1);
    for (size_t budget = 0; budget < part.bytes; budget += part.bytes / 7) {
        umb__pool_init(&pool, NULL, budget);
        const enum umb_status status = umb__pool_merge(&pool, &part, 5, &numbers, &error);
        assert_true(status == UMB_E_LIMIT || (status == UMB_OK && budget > part.bytes / 3));
        assert_true(pool.bytes <= budget);
        umb__pool_finish(&pool);
    }
    umb__pool_numbers_finish(&numbers);
    umb__pool_finish(&part);
}

/* With known keys, an attacker could choose bricks whose sums of products are equal. If a word plus
 * its key were 0, the other word of the pair would not matter. The writer of a file does not know
 * the keys. */
static void bricks_and_nodes_that_differ_in_a_word_have_many_tags(void **state)
{
    (void)state;
    enum {
        COUNT = 1000
    };
    struct umb__pool pool;
    uint32_t tags[2][COUNT], equal[2] = {0, 0};
    umb__pool_init(&pool, NULL, SIZE_MAX);
    for (uint32_t n = 0; n < COUNT; n++) {
        uint64_t slices[8];
        brick_of(7, slices);
        slices[1] = (uint64_t)n << 32;
        const uint32_t children[8] = {[0] = 5, [7] = n};
        struct umb__node_key key;
        umb__key_from_children(children, &key);
        tags[0][n] = umb__brick_tag(&pool, slices);
        tags[1][n] = umb__key_tag(&pool, &key);
        for (uint32_t i = 0; i < n; i++) {
            equal[0] += tags[0][i] == tags[0][n];
            equal[1] += tags[1][i] == tags[1][n];
        }
    }
    assert_in_range(equal[0], 0, 3); /* of half a million pairs; expected: none in 8000 runs */
    assert_in_range(equal[1], 0, 3);
    umb__pool_finish(&pool);
}

/* A loose pool passes its tags on: they must be those that the other pool would compute. */
static void a_loose_pool_keeps_the_tags_of_its_bricks(void **state)
{
    (void)state;
    struct umb__pool loose, pool;
    umb__pool_init_loose(&loose, NULL, SIZE_MAX);
    umb__pool_init(&pool, NULL, SIZE_MAX);
    fill_with_nodes(&loose, 3);
    for (uint32_t i = 0; i < loose.level[UMB_LEVEL_BRICK].count; i++) {
        assert_int_equal(loose.brick_tags[i], umb__brick_tag(&pool, loose.bricks[i]));
    }
    umb__pool_finish(&loose);
    umb__pool_finish(&pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(most_of_a_budget_holds_bricks),
        cmocka_unit_test(most_of_a_budget_holds_nodes),
        cmocka_unit_test(merged_pools_hold_what_each_held_and_nothing_twice),
        cmocka_unit_test(merged_loose_pools_come_to_the_same),
        cmocka_unit_test(a_pool_that_never_held_anything_adds_nothing),
        cmocka_unit_test(a_loose_pool_knows_the_latest_bricks_again),
        cmocka_unit_test(a_loose_pool_adds_every_node_and_its_merge_adds_it_once),
        cmocka_unit_test(a_loose_pool_that_was_refused_memory_is_sound),
        cmocka_unit_test(a_merge_ends_at_the_budget),
        cmocka_unit_test(bricks_and_nodes_that_differ_in_a_word_have_many_tags),
        cmocka_unit_test(a_loose_pool_keeps_the_tags_of_its_bricks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
