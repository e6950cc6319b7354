/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The list of hits behind umbr_crossings: order, repetitions, overflow. Embree decides when it
 * reports a hit twice, so this is tested from inside.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "rays/rays.c"

static void keep(struct crossing_list *list, uint32_t triangle, float distance)
{
    const struct crossing hit = {.distance = distance, .triangle = triangle, .sign = 1};
    keep_hit(list, &hit);
}

static void list_drops_a_repeated_hit(void **state)
{
    (void)state;
    static struct crossing_list list;
    list = (struct crossing_list){0};
    keep(&list, 7, 2);
    keep(&list, 3, 1);
    keep(&list, 7, 2);
    keep(&list, 3, 1);
    assert_int_equal(list.count, 2);
    assert_int_equal(list.hits[0].triangle, 3);
    assert_int_equal(list.hits[1].triangle, 7);
    assert_int_equal(list.more, 0);
}

static void list_orders_equal_distances_by_triangle(void **state)
{
    (void)state;
    static struct crossing_list list;
    list = (struct crossing_list){0};
    keep(&list, 9, 1);
    keep(&list, 4, 1);
    keep(&list, 6, 1);
    assert_int_equal(list.hits[0].triangle, 4);
    assert_int_equal(list.hits[1].triangle, 6);
    assert_int_equal(list.hits[2].triangle, 9);
}

static void full_list_keeps_the_nearest_and_asks_for_another_round(void **state)
{
    (void)state;
    enum {
        HITS = 3 * HITS_MAX + 5
    };
    static struct crossing_list list;
    list = (struct crossing_list){0};
    uint32_t seen = 0, rounds = 0;
    do {
        list.count = 0;
        list.more = 0;
        for (uint32_t i = 0; i < HITS; i++) {
            uint32_t t = i * 7 % HITS; /* 7 and HITS share no divisor: every triangle once */
            keep(&list, t, (float)(t / 2));
            keep(&list, t, (float)(t / 2));
        }
        for (size_t i = 0; i < list.count; i++) {
            assert_int_equal(list.hits[i].triangle, seen);
            seen++;
        }
        list.last = list.hits[list.count - 1];
        list.has_last = 1;
        rounds++;
    } while (list.more);
    assert_int_equal(seen, HITS);
    assert_int_equal(rounds, 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(list_drops_a_repeated_hit),
        cmocka_unit_test(list_orders_equal_distances_by_triangle),
        cmocka_unit_test(full_list_keeps_the_nearest_and_asks_for_another_round),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
