/* SPDX-License-Identifier: Apache-2.0 */
/* An asset's head must fit into what readers accept, whatever a bake fills it with. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "bake/bake_transmittance.h"
#include "bake/memory_plan.h"
#include "format/layout.h"
#include "umbrage/curve.h"

/* Returns the greatest length, in bytes of the canonical block, of the lights and frusta that a
 * bake may make. */
static uint64_t filled(struct umb__content content, int translucent, size_t occluder_depth_bytes)
{
    struct umb_error error;
    uint64_t length;
    content.curve_count = content.light_count * UMB_CURVE_ROWS_MAX;
    content.occluder_depth_words = occluder_depth_bytes / 4;
    content.transmittance_bytes = translucent ? UMBB_TRANSMITTANCE_BYTES_MAX : 0;
    if (umb__content_head_bytes(&content, &length, &error) != UMB_OK) {
        fail_msg("%u frusta, translucent %d: %s", content.frustum_count, translucent,
                 error.message);
    }
    return length;
}

static void fronts_beside_all_else_fit_a_head(void **state)
{
    (void)state;
    static char text[UMB__TEXT_MAX + 2];
    static struct umb_light_info infos[UMB_LIGHTS_MAX];
    static const uint32_t lights[] = {1, 2, 365, UMB_LIGHTS_MAX};
    memset(text, 'a', sizeof text - 1);
    for (size_t i = 0; i < 4 * 4; i++) {
        const int translucent = i & 1, wordy = i >> 1 & 1;
        infos[0].side[0] = wordy; /* area lights add an entry */
        struct umb__content content = {.light_count = lights[i / 4],
                                       .lights = infos,
                                       .frustum_count = 6 * lights[i / 4],
                                       .plan = text + (wordy ? 1 : sizeof text - 9),
                                       .settings = text + (wordy ? 1 : sizeof text - 30)};
        size_t occluder_depth;
        struct umb_error error;
        assert_int_equal(
            umbb_head_occluder_depth_bytes(&content, translucent, &occluder_depth, &error), UMB_OK);
        assert_true(occluder_depth >= (size_t)20 << 20);
        assert_true(translucent ? occluder_depth < (size_t)48 << 20
                                : occluder_depth <= (size_t)48 << 20);
        const uint64_t length = filled(content, translucent, occluder_depth);
        if (occluder_depth < (size_t)48 << 20) { /* and nothing is given away */
            assert_true(length + 64 > UMB__CANONICAL_MAX);
        }
    }
}

static void more_lights_than_a_head_holds_are_refused_by_their_number(void **state)
{
    (void)state;
    uint64_t cells;
    static struct umb_light_info infos[2040];
    struct umb__content content = {.light_count = 2040,
                                   .lights = infos,
                                   .frustum_count = 2040,
                                   .plan = (char[]){""},
                                   .settings = (char[]){""},
                                   .receiver_mask_cells = &cells};
    size_t occluder_depth;
    struct umb_error error;
    assert_int_equal(umbb_head_occluder_depth_bytes(&content, 0, &occluder_depth, &error),
                     UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "2040 lights"));
    assert_int_equal(occluder_depth, 0);
    content.light_count = content.frustum_count = 1024;
    assert_int_equal(umbb_head_occluder_depth_bytes(&content, 0, &occluder_depth, &error), UMB_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fronts_beside_all_else_fit_a_head),
        cmocka_unit_test(more_lights_than_a_head_holds_are_refused_by_their_number),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
