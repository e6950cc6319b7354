/* SPDX-License-Identifier: Apache-2.0 */
/* Boxes in boxes: the tree must give the same result as comparing each with each, and a hostile
 * pile must end early. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>

#include "scene/parts_nest.h"

static uint64_t random_state;

/* splitmix64 */
static double random_unit(void)
{
    uint64_t z = (random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static struct umb_box random_box(double reach, double edge)
{
    struct umb_box box;
    for (int i = 0; i < 3; i++) {
        box.min[i] = reach * random_unit();
        box.max[i] = box.min[i] + edge * random_unit();
    }
    return box;
}

static int inside(const struct umb_box *inner, const struct umb_box *outer)
{
    int good = 1;
    for (int i = 0; i < 3; i++) {
        good = good && inner->min[i] >= outer->min[i] && inner->max[i] <= outer->max[i];
    }
    return good;
}

static void scattered_boxes_match_direct_comparison(void **state)
{
    (void)state;
    enum {
        COUNT = 500
    };
    struct umb_box boxes[COUNT];
    random_state = 77;
    print_message("seed 77\n");
    for (int i = 0; i < COUNT; i++) {
        boxes[i] = random_box(100, 8);
    }
    struct umbs_nest nest;
    assert_int_equal(umbs_nest_init(&nest, boxes, COUNT), 1);
    int held = 0;
    for (int i = 0; i < 4000; i++) {
        const struct umb_box box = random_box(100, 1);
        int expected = 0;
        for (int k = 0; k < COUNT; k++) {
            expected = expected || inside(&box, &boxes[k]);
        }
        assert_int_equal(umbs_nest_holds(&nest, &box), expected);
        held += expected;
    }
    assert_true(held > 10);
    umbs_nest_finish(&nest);
}

/* Plates that cross: any two of them together enclose the box's middle, none does alone. */
static void crossing_plates_end_in_the_cautious_answer(void **state)
{
    (void)state;
    static const size_t counts[2] = {1000, 100000};
    const struct umb_box box = {{-1, -1, -1}, {1, 1, 1}};
    for (int n = 0; n < 2; n++) {
        struct umb_box *plates = calloc(counts[n], sizeof *plates);
        assert_non_null(plates);
        for (size_t i = 0; i < counts[n]; i++) {
            const size_t thin = i % 3;
            for (size_t k = 0; k < 3; k++) {
                plates[i].min[k] = k == thin ? -0.5 : -50.0 - (double)i;
                plates[i].max[k] = k == thin ? 0.5 : 50.0 + (double)i;
            }
        }
        struct umbs_nest nest;
        assert_int_equal(umbs_nest_init(&nest, plates, counts[n]), 1);
        /* Numbers of boxes: few enough to compare all, and too many for that. */
        assert_int_equal(umbs_nest_holds(&nest, &box), counts[n] > UMBS_NEST_STEPS_MAX);
        umbs_nest_finish(&nest);
        free(plates);
    }
}

static void an_empty_nest_holds_nothing(void **state)
{
    (void)state;
    struct umbs_nest nest;
    const struct umb_box box = {{0, 0, 0}, {0, 0, 0}};
    assert_int_equal(umbs_nest_init(&nest, NULL, 0), 1);
    assert_int_equal(umbs_nest_holds(&nest, &box), 0);
    umbs_nest_finish(&nest);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(scattered_boxes_match_direct_comparison),
        cmocka_unit_test(crossing_plates_end_in_the_cautious_answer),
        cmocka_unit_test(an_empty_nest_holds_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
