/* SPDX-License-Identifier: Apache-2.0 */
/* Token bucket and header budget. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "daemon/transport/h2_guard.h"

#define SECOND ((uint64_t)1000000000)

static unsigned take_all(struct umbd_bucket *bucket, uint64_t now, unsigned tries)
{
    unsigned taken = 0;
    for (unsigned i = 0; i < tries; i++) {
        taken += (unsigned)umbd_bucket_take(bucket, now);
    }
    return taken;
}

static void bucket_gives_its_burst_and_then_its_rate(void **state)
{
    struct umbd_bucket bucket;
    (void)state;
    umbd_bucket_init(&bucket, 1000, 200, 5 * SECOND);
    assert_int_equal(take_all(&bucket, 5 * SECOND, 3000), 1000);
    assert_int_equal(take_all(&bucket, 6 * SECOND, 3000), 200);
    assert_int_equal(take_all(&bucket, 6 * SECOND + SECOND / 100, 3000), 2);
    assert_int_equal(take_all(&bucket, 3600 * SECOND, 3000), 1000);
}

static void bucket_loses_no_fraction_of_a_token(void **state)
{
    struct umbd_bucket bucket;
    unsigned taken = 0;
    (void)state;
    umbd_bucket_init(&bucket, 10, 3, 0);
    take_all(&bucket, 0, 10);
    for (uint64_t ms = 1; ms <= 10000; ms++) {
        taken += (unsigned)umbd_bucket_take(&bucket, ms * 1000000);
    }
    assert_int_equal(taken, 30);
}

static void bucket_ignores_a_clock_that_steps_back(void **state)
{
    struct umbd_bucket bucket;
    (void)state;
    umbd_bucket_init(&bucket, 5, 1, 10 * SECOND);
    assert_int_equal(take_all(&bucket, 2 * SECOND, 9), 5);
    assert_int_equal(take_all(&bucket, 10 * SECOND, 9), 0);
    assert_int_equal(take_all(&bucket, 11 * SECOND, 9), 1);
}

static void bucket_credit_never_passes_the_burst(void **state)
{
    struct umbd_bucket bucket;
    (void)state;
    umbd_bucket_init(&bucket, 100, 1, 0);
    assert_int_equal(take_all(&bucket, 0, 50), 50);
    umbd_bucket_credit(&bucket, 20);
    assert_int_equal(take_all(&bucket, 0, 70), 70);
    umbd_bucket_credit(&bucket, 1000000);
    assert_int_equal(take_all(&bucket, 0, 500), 100);
}

static void headers_stop_at_the_field_limit(void **state)
{
    struct umbd_header_budget budget = {0};
    (void)state;
    for (unsigned i = 0; i < UMBD_HEADER_FIELDS_MAX; i++) {
        assert_true(umbd_header_take(&budget, 1, 1));
    }
    assert_false(umbd_header_take(&budget, 1, 1));
}

static void headers_stop_at_the_byte_limit_to_the_byte(void **state)
{
    struct umbd_header_budget budget = {0};
    (void)state;
    assert_true(umbd_header_take(&budget, 4, UMBD_HEADER_BYTES_MAX - 32 - 4 - 34));
    assert_true(umbd_header_take(&budget, 1, 1));
    assert_int_equal(budget.bytes, UMBD_HEADER_BYTES_MAX);
    assert_false(umbd_header_take(&budget, 0, 0));
    budget = (struct umbd_header_budget){0};
    assert_false(umbd_header_take(&budget, 4, UMBD_HEADER_BYTES_MAX - 32 - 3));
}

static void headers_refuse_sizes_that_would_wrap(void **state)
{
    struct umbd_header_budget budget = {0};
    (void)state;
    assert_false(umbd_header_take(&budget, SIZE_MAX, 1));
    assert_false(umbd_header_take(&budget, 1, SIZE_MAX));
    assert_false(umbd_header_take(&budget, (size_t)1 << 32, 0));
    assert_int_equal(budget.fields, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bucket_gives_its_burst_and_then_its_rate),
        cmocka_unit_test(bucket_loses_no_fraction_of_a_token),
        cmocka_unit_test(bucket_ignores_a_clock_that_steps_back),
        cmocka_unit_test(bucket_credit_never_passes_the_burst),
        cmocka_unit_test(headers_stop_at_the_field_limit),
        cmocka_unit_test(headers_stop_at_the_byte_limit_to_the_byte),
        cmocka_unit_test(headers_refuse_sizes_that_would_wrap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
