/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the ranges of alpha in rectangles with a loop over their texels. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "scene/alpha_pyramid.h"

enum {
    TEXELS_MAX = 1 << 20,
    RECTANGLES = 2000,
};

static uint64_t random_state;

/* xorshift64 */
static uint32_t below(uint32_t n)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (uint32_t)(random_state >> 20) % n;
}

static struct umbs_alpha_range slow_range(const uint8_t *texels, uint32_t width,
                                          const uint32_t x[2], const uint32_t y[2])
{
    struct umbs_alpha_range range = {UINT8_MAX, 0};
    for (uint32_t row = y[0]; row <= y[1]; row++) {
        for (uint32_t column = x[0]; column <= x[1]; column++) {
            const uint8_t texel = texels[(size_t)row * width + column];
            range.low = texel < range.low ? texel : range.low;
            range.high = texel > range.high ? texel : range.high;
        }
    }
    return range;
}

static void choose(uint32_t n, uint32_t ends[2])
{
    const uint32_t a = below(n), b = below(n);
    ends[0] = a < b ? a : b;
    ends[1] = a < b ? b : a;
}

static void ranges_equal_a_loop_over_the_texels(void **state)
{
    (void)state;
    static const uint32_t shapes[][2] = {{1, 1},      {16, 16},   {17, 1},   {1, 33},
                                         {15, 257},   {300, 31},  {512, 64}, {65536, 3},
                                         {997, 1009}, {1024, 513}};
    static uint8_t texels[TEXELS_MAX];
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++) {
        const uint32_t width = shapes[i][0], height = shapes[i][1];
        const struct umbs_texture texture = {.width = width, .height = height};
        const struct umbs_scene_view view = {
            .texture_count = 1, .textures = &texture, .alpha = texels};
        struct umbs_alpha_pyramid pyramid = {0};
        random_state = 88172645463325252ULL + i;
        memset(texels, 100, (size_t)width * height);
        for (uint32_t k = 0; k < 1 + width * height / 500; k++) { /* a few that stand out */
            texels[below(width * height)] = (uint8_t)below(256);
        }
        assert_int_equal(umbs_alpha_pyramid_find(&view, 0, &pyramid, NULL), UMB_OK);
        for (int k = 0; k < RECTANGLES; k++) {
            uint32_t x[2], y[2];
            struct umbs_alpha_range range = {UINT8_MAX, 0};
            choose(width, x);
            choose(height, y);
            y[1] = k % 8 != 0 && y[1] - y[0] > 40 ? y[0] + 40 : y[1]; /* sooner done */
            umbs_alpha_pyramid_range(&pyramid, x, y, &range);
            const struct umbs_alpha_range wanted = slow_range(texels, width, x, y);
            assert_int_equal(range.low, wanted.low);
            assert_int_equal(range.high, wanted.high);
        }
        umbs_alpha_pyramid_finish(&pyramid);
        umbs_alpha_pyramid_finish(&pyramid);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(ranges_equal_a_loop_over_the_texels)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
