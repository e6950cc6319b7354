/* SPDX-License-Identifier: Apache-2.0 */
/* The histogram of latencies: its error is checked with sorted values; its edges and merging are
 * tested. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "load/load_histogram.h"

enum {
    COUNT = 100000
};

static uint64_t next_random(uint64_t *state)
{
    *state = *state * 6364136223846793005U + 1442695040888963407U;
    return *state >> 11;
}

static int compare(const void *a, const void *b)
{
    const uint64_t *x = a;
    const uint64_t *y = b;
    return (*x > *y) - (*x < *y);
}

/* Durations over nine decades, as many in each. */
static void draw(uint64_t *values, uint64_t seed)
{
    for (int i = 0; i < COUNT; i++) {
        double exponent = 9.0 * (double)next_random(&seed) / 9007199254740992.0;
        values[i] = (uint64_t)pow(10, exponent);
    }
}

static void percentiles_are_never_too_small_and_less_than_a_128th_too_large(void **state)
{
    static const double shares[] = {0, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999, 1};
    static struct umbc_histogram histogram;
    uint64_t *values = calloc(COUNT, sizeof *values);
    (void)state;
    assert_non_null(values);
    for (uint64_t seed = 1; seed <= 5; seed++) {
        memset(&histogram, 0, sizeof histogram);
        draw(values, seed);
        for (int i = 0; i < COUNT; i++) {
            umbc_histogram_record(&histogram, values[i]);
        }
        qsort(values, COUNT, sizeof *values, compare);
        assert_int_equal(histogram.count, COUNT);
        assert_int_equal(histogram.min_ns, values[0]);
        assert_int_equal(histogram.max_ns, values[COUNT - 1]);
        for (size_t i = 0; i < sizeof shares / sizeof shares[0]; i++) {
            size_t rank = (size_t)ceil(shares[i] * COUNT);
            uint64_t exact = values[rank == 0 ? 0 : rank - 1];
            uint64_t told = umbc_histogram_percentile(&histogram, shares[i]);
            assert_in_range(told, exact, exact + exact / 128);
        }
    }
    free(values);
}

static void small_values_and_every_power_of_two_are_kept(void **state)
{
    static struct umbc_histogram histogram;
    (void)state;
    for (uint64_t value = 0; value < 256; value++) {
        memset(&histogram, 0, sizeof histogram);
        umbc_histogram_record(&histogram, value);
        umbc_histogram_record(&histogram, 1000000);
        assert_int_equal(umbc_histogram_percentile(&histogram, 0.5), value);
    }
    for (unsigned bit = 8; bit < 42; bit++) {
        for (int step = -1; step <= 1; step++) {
            uint64_t value = ((uint64_t)1 << bit) + (uint64_t)(int64_t)step;
            memset(&histogram, 0, sizeof histogram);
            umbc_histogram_record(&histogram, value);
            umbc_histogram_record(&histogram, UMBC_HISTOGRAM_MAX_NS);
            assert_in_range(umbc_histogram_percentile(&histogram, 0.5), value, value + value / 128);
        }
    }
}

static void what_is_too_long_counts_as_the_longest(void **state)
{
    static struct umbc_histogram histogram;
    (void)state;
    memset(&histogram, 0, sizeof histogram);
    assert_int_equal(umbc_histogram_percentile(&histogram, 0.99), 0);
    assert_true(umbc_histogram_mean(&histogram) == 0);
    umbc_histogram_record(&histogram, UINT64_MAX);
    assert_int_equal(histogram.max_ns, UMBC_HISTOGRAM_MAX_NS);
    assert_int_equal(umbc_histogram_percentile(&histogram, 1), UMBC_HISTOGRAM_MAX_NS);
}

static void merged_histograms_are_as_if_recorded_in_one(void **state)
{
    static struct umbc_histogram parts[3], sum, one;
    uint64_t seed = 9;
    (void)state;
    for (int i = 0; i < 3000; i++) {
        uint64_t value = next_random(&seed) % 100000000;
        umbc_histogram_record(&parts[i % 2], value);
        umbc_histogram_record(&one, value);
    }
    for (int k = 0; k < 3; k++) { /* the third is empty */
        umbc_histogram_merge(&sum, &parts[k]);
    }
    assert_memory_equal(sum.buckets, one.buckets, sizeof one.buckets);
    assert_int_equal(sum.count, one.count);
    assert_int_equal(sum.min_ns, one.min_ns);
    assert_int_equal(sum.max_ns, one.max_ns);
    assert_true(umbc_histogram_mean(&sum) == umbc_histogram_mean(&one));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(percentiles_are_never_too_small_and_less_than_a_128th_too_large),
        cmocka_unit_test(small_values_and_every_power_of_two_are_kept),
        cmocka_unit_test(what_is_too_long_counts_as_the_longest),
        cmocka_unit_test(merged_histograms_are_as_if_recorded_in_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
