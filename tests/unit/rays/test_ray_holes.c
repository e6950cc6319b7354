/* SPDX-License-Identifier: Apache-2.0 */
/* Rays through triangles with holes must meet what the texture keeps, and nothing else. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "cut_scene.h"
#include "rays/rays.h"

/* A square of side 1 at height z that shows the image once. */
static void add_square(struct cut_scene *s, double z, uint32_t material)
{
    const double corners[2][3][3] = {{{0, 0, z}, {1, 0, z}, {0, 1, z}},
                                     {{1, 0, z}, {1, 1, z}, {0, 1, z}}};
    static const float uv[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 0}, {1, 1}, {0, 1}}};
    cut_scene_add(s, corners[0], uv[0], material);
    cut_scene_add(s, corners[1], uv[1], material);
}

static void rays_pass_where_alpha_is_below_the_cut_off(void **state)
{
    (void)state;
    static const double up[3] = {0, 0, 1};
    static struct cut_scene s;
    cut_scene_init(&s, 5);
    add_square(&s, 1.0, 1);
    add_square(&s, 2.0, 2); /* casts nothing */
    struct umbs_cuts cuts;
    struct umbr_rays *rays;
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    const struct umbr_rays_options options = {.threads = 1, .cuts = &cuts};
    assert_int_equal(umbr_rays_build((const double(*)[3][3])s.positions, 4, &options, &rays, NULL),
                     UMB_OK);
    size_t met = 0, asked = 0;
    double eight[8][3];
    for (int i = 0; i < 100000; i++) {
        double *from = eight[asked % 8];
        from[0] = cut_unit(&s);
        from[1] = cut_unit(&s);
        from[2] = 0;
        const long double alpha = cut_slow_alpha(&s, from[0], from[1]);
        struct umbr_hit hit;
        if (fabsl(alpha - 127.5L) < 0.05L) { /* floats decide */
            continue;
        }
        asked++;
        met += alpha > 127.5L;
        assert_int_equal(umbr_occluded(rays, from, up, 0, INFINITY), alpha > 127.5L);
        umbr_nearest(rays, from, up, 0, INFINITY, &hit);
        assert_int_equal(hit.distance >= 0, alpha > 127.5L);
        uint8_t occluded[8];
        if (asked % 8 == 0) {
            umbr_occluded8(rays, (const double(*)[3])eight, up, 0, INFINITY, occluded);
        }
        for (int k = 0; k < 8 && asked % 8 == 0; k++) {
            assert_int_equal(occluded[k], umbr_occluded(rays, eight[k], up, 0, INFINITY));
        }
    }
    print_message("%zu of %zu rays met something\n", met, asked);
    assert_true(asked > 90000 && met > asked / 3 && met < asked * 2 / 3);
    umbr_rays_destroy(rays);
    umbs_cuts_finish(&cuts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_pass_where_alpha_is_below_the_cut_off),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
