/* SPDX-License-Identifier: Apache-2.0 */
/* The set of values behind a page's tables, compared with sorting and searching. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>

#include "format/value_set.h"

static uint64_t random_state = 7;

/* splitmix64 */
static uint64_t random_bits(void)
{
    uint64_t z = (random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

static int compare(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static void check(struct umb__value_set *set, const uint64_t *values, size_t count)
{
    uint32_t *numbers = malloc((count + 1) * sizeof *numbers);
    uint64_t *sorted = malloc((count + 1) * sizeof *sorted);
    assert_true(umb__value_set_begin(set, NULL, count));
    for (size_t i = 0; i < count; i++) {
        sorted[i] = values[i];
        numbers[i] = umb__value_set_add(set, values[i]);
        assert_true(numbers[i] < set->count);
        assert_true(set->values[numbers[i]] == values[i]);
    }
    assert_true(umb__value_set_sort(set, NULL));
    qsort(sorted, count, sizeof *sorted, compare);
    size_t distinct = 0;
    for (size_t i = 0; i < count; i++) {
        if (i == 0 || sorted[i] != sorted[i - 1]) {
            assert_true(distinct < set->count);
            assert_true(set->values[distinct] == sorted[i]);
            distinct++;
        }
    }
    assert_int_equal(distinct, set->count);
    for (size_t i = 0; i < count; i++) {
        assert_true(set->values[set->rank[numbers[i]]] == values[i]);
    }
    free(numbers);
    free(sorted);
}

static void values_are_distinct_ascending_and_found_again(void **state)
{
    (void)state;
    struct umb__value_set set = {0};
    for (size_t round = 0; round < 60; round++) {
        const size_t count = round < 4 ? round : (size_t)(random_bits() % 3000);
        uint64_t *values = malloc((count + 1) * sizeof *values);
        const unsigned kept = 1 + (unsigned)(random_bits() % 63);
        for (size_t i = 0; i < count; i++) {
            /* Few values, and many; high bits only, and low bits only. */
            values[i] = round % 2 == 0 ? random_bits() << kept : random_bits() >> kept;
            values[i] = round % 5 == 0 ? UINT64_MAX * (values[i] & 1) : values[i];
        }
        check(&set, values, count);
        free(values);
    }
    umb__value_set_finish(&set, NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_are_distinct_ascending_and_found_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
