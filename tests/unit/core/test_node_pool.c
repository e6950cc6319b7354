/* SPDX-License-Identifier: Apache-2.0 */
/* The pool under a budget: most of it can be used, none beyond it, and a refusal changes nothing.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "format/node_pool.h"

/* The n-th of many different bricks. */
static void brick_of(uint32_t n, uint64_t slices[8])
{
    memset(slices, 0, 8 * sizeof slices[0]);
    slices[0] = 1;
    slices[7] = n;
}

/* Adds bricks until the budget ends; returns how many. */
static uint32_t fill_with_bricks(struct umb_pool *pool, struct umb_error *error)
{
    uint64_t slices[8];
    uint32_t ref, n = 0;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK) {
        brick_of(n, slices);
        status = umb_pool_brick(pool, slices, &ref, error);
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
    for (size_t budget = 300000; budget < 12000000; budget += budget / 5) {
        struct umb_pool pool;
        struct umb_error error;
        umb_pool_init(&pool, NULL, budget);
        const uint32_t count = fill_with_bricks(&pool, &error);
        if ((uint64_t)count * 64 < budget / 3) {
            fail_msg("budget %zu: only %u bricks", budget, count);
        }
        for (uint32_t n = 0; n < count; n += 17) { /* all are still found */
            uint64_t slices[8];
            uint32_t ref;
            brick_of(n, slices);
            assert_int_equal(umb_pool_brick(&pool, slices, &ref, &error), UMB_OK);
            assert_int_equal(ref, n);
        }
        umb_pool_finish(&pool);
    }
}

static void most_of_a_budget_holds_nodes(void **state)
{
    (void)state;
    for (size_t budget = 300000; budget < 12000000; budget += budget / 5) {
        struct umb_pool pool;
        struct umb_error error;
        umb_pool_init(&pool, NULL, budget);
        uint32_t count = 0;
        enum umb_status status = UMB_OK;
        while (status == UMB_OK) {
            /* Two mixed children: 2 + 4 + 8 bytes a node, and its slot. */
            uint32_t children[8] = {count, 7}, ref;
            for (int c = 2; c < 8; c++) {
                children[c] = UMB_REF_LIT;
            }
            status = umb_pool_node(&pool, 5, children, &ref, &error);
            assert_true(pool.bytes <= budget);
            count += status == UMB_OK;
        }
        assert_int_equal(status, UMB_E_LIMIT);
        if ((uint64_t)count * 14 < budget / 5) {
            fail_msg("budget %zu: only %u nodes", budget, count);
        }
        umb_pool_finish(&pool);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(most_of_a_budget_holds_bricks),
        cmocka_unit_test(most_of_a_budget_holds_nodes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
