/* SPDX-License-Identifier: Apache-2.0 */
/* Ranges of an array: never two in one place, always joined again, and no longer than needed. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "partial/extents.h"

enum {
    RANGES = 300,
    ROOM = 1 << 17,
};

struct range {
    uint32_t extent, count; /* count 0: not taken */
};

static void fill(uint8_t *owners, const struct umb__extents *extents, const struct range *range,
                 uint8_t from, uint8_t to)
{
    const uint32_t begin = umb__extents_begin(extents, range->extent);
    assert_true(begin + range->count <= extents->end && extents->end < ROOM);
    for (uint32_t i = begin; i < begin + range->count; i++) {
        assert_int_equal(owners[i], from);
        owners[i] = to;
    }
}

static void ranges_of_any_order_never_overlap_and_join_again(void **state)
{
    (void)state;
    static struct range ranges[RANGES];
    static uint8_t owners[ROOM];
    struct umb__extents extents = {0};
    uint64_t seed = 5;
    uint32_t taken = 0, most = 0;
    for (int i = 0; i < case_count(200000); i++) {
        struct range *range = &ranges[next_random(&seed) % RANGES];
        if (range->count > 0) {
            fill(owners, &extents, range, 1, 0);
            umb__extents_give(&extents, range->extent);
            taken -= range->count;
            range->count = 0;
        } else {
            range->count = 1 + (uint32_t)(next_random(&seed) % (1U << next_random(&seed) % 8));
            assert_true(umb__extents_take(&extents, range->count, &range->extent));
            fill(owners, &extents, range, 0, 1);
            taken += range->count;
            most = taken > most ? taken : most;
        }
    }
    assert_true(extents.end <= 2 * most); /* Holes are used again */
    for (size_t i = 0; i < RANGES; i++) {
        if (ranges[i].count > 0) {
            umb__extents_give(&extents, ranges[i].extent);
        }
    }
    assert_int_equal(extents.end, 0);
    assert_int_equal(extents.filled, 0);
    assert_true(extents.item_count <= 2 * RANGES + 1);
    umb__extents_finish(&extents);
}

static void a_range_beyond_the_numbers_is_refused(void **state)
{
    (void)state;
    struct umb__extents extents = {0};
    uint32_t extent;
    assert_true(umb__extents_take(&extents, UINT32_MAX - 10, &extent));
    assert_false(umb__extents_take(&extents, 10, &extent));
    assert_true(umb__extents_take(&extents, 9, &extent));
    umb__extents_finish(&extents);
}

static void *resize_or_refuse(void *user, void *block, size_t bytes)
{
    if (bytes == 0) {
        free(block);
        return NULL;
    }
    return *(const bool *)user ? NULL : realloc(block, bytes);
}

static void a_range_that_memory_refuses_to_divide_stays_free(void **state)
{
    (void)state;
    bool refuses = false;
    const struct umb_alloc alloc = {resize_or_refuse, &refuses};
    struct umb__extents extents = {.alloc = &alloc};
    uint32_t extent, hole = 0;
    do {
        assert_true(umb__extents_take(&extents, 8, &extent));
        hole = extents.item_count == 2 ? extent : hole;
    } while (extents.item_count < 3 || extents.item_count < extents.item_capacity);
    const uint32_t end = extents.end;
    umb__extents_give(&extents, hole);
    refuses = true;
    extent = UMB__NO_EXTENT;
    assert_false(umb__extents_take(&extents, 3, &extent));
    assert_int_equal(extent, UMB__NO_EXTENT); /* A caller would give it back a second time */
    assert_true(umb__extents_take(&extents, 8, &extent));
    assert_int_equal(extent, hole);
    assert_int_equal(extents.end, end);
    umb__extents_finish(&extents);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ranges_of_any_order_never_overlap_and_join_again),
        cmocka_unit_test(a_range_beyond_the_numbers_is_refused),
        cmocka_unit_test(a_range_that_memory_refuses_to_divide_stays_free),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
