/* SPDX-License-Identifier: Apache-2.0 */
/* Samples of alpha, and which triangles count as whole, cut, or gone (no part casts). */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "cut_scene.h"

static void samples_equal_a_slow_definition_for_every_wrap(void **state)
{
    (void)state;
    static struct cut_scene s;
    cut_scene_init(&s, 11);
    for (uint32_t mode = 0; mode < 18; mode++) {
        s.texture.wrap_s = mode % 3;
        s.texture.wrap_t = mode / 3 % 3;
        s.texture.nearest = mode / 9;
        for (int i = 0; i < 60000; i++) {
            double at[2];
            for (int axis = 0; axis < 2; axis++) {
                at[axis] = 8.0 * cut_unit(&s) - 4.0;
                if (i % 4 == 0 && !s.texture.nearest) { /* on borders and centres of texels */
                    at[axis] = rint(at[axis] * 2 * CUT_SIDE) / (2 * CUT_SIDE);
                }
            }
            const double got = umbs_alpha_at(&s.view, &s.texture, at[0], at[1]);
            const long double wanted = cut_slow_alpha(&s, at[0], at[1]);
            /* Positions are good to 2^-52 of 160 texels, slopes are at most 255 a texel. */
            if (!(fabsl((long double)got - wanted) <= (s.texture.nearest ? 0.0L : 1e-10L))) {
                fail_msg("wraps %u: %.17g %.17g gives %.17g, not %.17Lg", mode, at[0], at[1], got,
                         wanted);
            }
        }
    }
}

static void coordinates_far_outside_stay_in_the_image(void **state)
{
    (void)state;
    static struct cut_scene s;
    cut_scene_init(&s, 12);
    static const double far[] = {1e9, -1e9, 1e18, -1e18, 3.4e38, -3.4e38, 1e-310, -0.0};
    for (uint32_t mode = 0; mode < 18; mode++) {
        s.texture.wrap_s = s.texture.wrap_t = mode % 3;
        s.texture.nearest = mode / 9;
        for (size_t i = 0; i < 64; i++) {
            const double alpha = umbs_alpha_at(&s.view, &s.texture, far[i % 8], far[i / 8]);
            assert_true(alpha >= 0.0 && alpha <= 255.0);
        }
    }
}

/* Samples a triangle all over. Returns bit 1 if something casts, and bit 2 if something does
 * not. */
static int sample_triangle(const struct cut_scene *s, size_t triangle)
{
    const struct umbs_material *m = &s->materials[s->meshes[triangle].material];
    int found = 0;
    for (int i = 0; i <= 40; i++) {
        for (int k = 0; k <= 40 - i; k++) {
            const double a = i / 40.0, b = k / 40.0, c = 1.0 - a - b;
            double at[2];
            for (int axis = 0; axis < 2; axis++) {
                at[axis] = a * (double)s->uvs[3 * triangle][axis] +
                           b * (double)s->uvs[3 * triangle + 1][axis] +
                           c * (double)s->uvs[3 * triangle + 2][axis];
            }
            const double alpha = m->texture == UMBS_NO_INDEX
                                     ? 255.0
                                     : umbs_alpha_at(&s->view, &s->texture, at[0], at[1]);
            found |= alpha * (double)m->base_alpha >= 255.0 * (double)m->alpha_cutoff ? 1 : 2;
        }
    }
    return found;
}

static void triangles_are_whole_cut_or_gone_as_their_samples_say(void **state)
{
    (void)state;
    static struct cut_scene s;
    size_t whole = 0, gone = 0, cut = 0;
    for (uint32_t mode = 0; mode < 18; mode++) {
        cut_scene_init(&s, 100 + mode);
        s.texture.wrap_s = mode % 3;
        s.texture.wrap_t = mode / 3 % 3;
        s.texture.nearest = mode / 9;
        for (uint32_t i = 0; i < CUT_TRIANGLES_MAX; i++) {
            cut_scene_add_random(&s, 10.0, i % 8 < 5 ? 1 : i % 4);
        }
        struct umbs_cuts cuts;
        assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
        size_t counted = 0;
        for (size_t i = 0; i < CUT_TRIANGLES_MAX; i++) {
            const uint32_t number = cuts.of[i], material = s.meshes[i].material;
            counted += number != UMBS_CUT_NONE;
            if (material != 1) {
                assert_int_equal(number, material == 2 ? UMBS_CUT_GONE : UMBS_CUT_NONE);
                continue;
            }
            const int found = sample_triangle(&s, i);
            whole += number == UMBS_CUT_NONE;
            gone += number == UMBS_CUT_GONE;
            cut += number != UMBS_CUT_NONE && number != UMBS_CUT_GONE;
            assert_false(number == UMBS_CUT_NONE && (found & 2));
            assert_false(number == UMBS_CUT_GONE && (found & 1));
            assert_false(found == 3 && number >= UMBS_CUT_GONE);
        }
        assert_int_equal(counted, cuts.figures.triangles);
        assert_int_equal(cuts.figures.materials, 2);
        assert_true(cuts.figures.share > 0.1 && cuts.figures.share < 0.9);
        umbs_cuts_finish(&cuts);
    }
    print_message("whole %zu, gone %zu, cut %zu\n", whole, gone, cut);
    assert_true(whole > 100 && gone > 100 && cut > 1000);
}

static void the_share_is_that_of_the_texels_below_the_cut_off(void **state)
{
    (void)state;
    static struct cut_scene s;
    cut_scene_init(&s, 1);
    /* Two triangles that show the image once. The left quarter of the image is whole, the right
     * quarter is gone, and half of the rest is below the cut-off. */
    static const double corners[2][3][3] = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                                            {{1, 0, 0}, {1, 1, 0}, {0, 1, 0}}};
    static const float uv[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 0}, {1, 1}, {0, 1}}};
    cut_scene_add(&s, corners[0], uv[0], 1);
    cut_scene_add(&s, corners[1], uv[1], 1);
    struct umbs_cuts cuts;
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    print_message("share %.3f\n", cuts.figures.share);
    assert_true(fabs(cuts.figures.share - 0.5) < 0.06);
    umbs_cuts_finish(&cuts);
    /* Without a MASK material there is no table at all. */
    s.meshes[0].material = s.meshes[1].material = 0;
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    assert_null(cuts.of);
    assert_int_equal(cuts.figures.mask_triangles, 0);
    umbs_cuts_finish(&cuts);
}

/* Repeats of a texture whose number a triangle's side divides would always be met at the same
 * phase. */
static void the_share_of_a_texture_that_repeats_is_not_that_of_one_texel(void **state)
{
    (void)state;
    static struct cut_scene s;
    for (uint32_t repeats = 1; repeats <= 64; repeats *= 2) {
        static const double corners[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
        const float n = (float)repeats;
        const float uv[3][2] = {{0, 0}, {n, 0}, {0, n}};
        cut_scene_init(&s, 1);
        for (int i = 0; i < CUT_SIDE * CUT_SIDE; i++) { /* checks of ten texels */
            s.alpha[i] = (i / 10 + i / CUT_SIDE / 10) % 2 == 0 ? 255 : 0;
        }
        for (int i = 0; i < 8; i++) {
            cut_scene_add(&s, corners, uv, 1);
        }
        struct umbs_cuts cuts;
        assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
        print_message("%u repeats: share %.3f\n", repeats, cuts.figures.share);
        assert_true(fabs(cuts.figures.share - 0.5) < 0.06);
        umbs_cuts_finish(&cuts);
    }
}

static void mirrored_instances_keep_each_corner_with_its_coordinates(void **state)
{
    (void)state;
    static struct cut_scene s;
    cut_scene_init(&s, 1);
    static const double corners[3][3] = {{1, 0, 0}, {2, 0, 0}, {1, 3, 0}};
    static const float uv[3][2] = {{0.3F, 0.0F}, {0.9F, 0.1F}, {0.5F, 1.0F}};
    cut_scene_add(&s, corners, uv, 1);
    s.instances[0].mesh_to_world[0][0] = -1.0;
    struct umbs_cuts cuts;
    double(*flat)[3][3];
    size_t count;
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    assert_int_equal(umbs_scene_flatten(&s.view, &flat, NULL, &count, NULL), UMB_OK);
    assert_int_equal(cuts.of[0], 0);
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++) {
            if (flat[0][k][0] == -corners[i][0] && flat[0][k][1] == corners[i][1]) {
                assert_memory_equal(cuts.cuts[0].uv[k], uv[i], sizeof uv[i]);
            }
        }
    }
    free(flat);
    umbs_cuts_finish(&cuts);
}

static void a_solid_with_a_hole_counts_as_open(void **state)
{
    (void)state;
    static struct cut_scene s;
    static const double v[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const int faces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    static const float uv[3][2] = {{0.3F, 0.0F}, {0.6F, 0.1F}, {0.5F, 1.0F}};
    for (uint32_t with_hole = 0; with_hole < 2; with_hole++) {
        cut_scene_init(&s, 1);
        for (int f = 0; f < 4; f++) {
            double corners[3][3];
            for (int k = 0; k < 3; k++) {
                memcpy(corners[k], v[faces[f][k]], sizeof corners[k]);
            }
            cut_scene_add(&s, (const double(*)[3])corners, uv, f == 2 ? with_hole : 0);
        }
        struct umbs_cuts cuts;
        struct umbs_parts parts;
        char why[128];
        assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
        assert_int_equal(umbs_parts_find((const double(*)[3][3])s.positions, 4, &parts, NULL),
                         UMB_OK);
        umbs_cuts_open_parts(&cuts, &parts, 4);
        assert_int_equal(parts.part_count, 1);
        assert_int_equal(parts.parts[0].closed, !with_hole);
        assert_int_equal(parts.closed_triangles, with_hole ? 0 : 4);
        assert_int_equal(parts.closed[3], !with_hole);
        umbs_part_reason(&parts.parts[0], why, sizeof why);
        assert_string_equal(why, with_hole ? "1 triangle with holes by alpha" : "closed");
        umbs_parts_finish(&parts);
        umbs_cuts_finish(&cuts);
    }
}

/* A BLEND material is sharp by the share of its texels that are clear or opaque. */
static void sharp_materials_become_cut_outs_on_request(void **state)
{
    (void)state;
    static struct cut_scene s;
    static const struct {
        int soft; /* of 40 columns of texels, how many are half clear */
        float base_alpha, transmission;
        int is_sharp;
    } cases[] = {{1, 1.0F, 0.0F, 1},
                 {12, 1.0F, 0.0F, 0},
                 {1, 0.6F, 0.0F, 0},   /* opaque texels take 60 % */
                 {1, 1.0F, 0.2F, 0},   /* glass */
                 {-1, 1.0F, 0.0F, 0}}; /* opaque all over */
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cut_scene_init(&s, 500 + i);
        for (int k = 0; k < CUT_SIDE * CUT_SIDE; k++) {
            const int x = k % CUT_SIDE;
            s.alpha[k] = (uint8_t)(cases[i].soft < 0 || x < 10 ? 255
                                   : x < 10 + cases[i].soft    ? 128
                                                               : 0);
        }
        s.texture.nearest = 1;
        s.materials[1].alpha_mode = UMBS_ALPHA_BLEND;
        s.materials[1].base_alpha = cases[i].base_alpha;
        s.materials[1].transmission = cases[i].transmission;
        for (uint32_t k = 0; k < 100; k++) {
            cut_scene_add_random(&s, 2.0, 1);
        }
        struct umbs_cuts blend, cut;
        assert_int_equal(umbs_cuts_find(&s.view, &blend, NULL), UMB_OK);
        assert_int_equal(umbs_cuts_find_sharp(&s.view, &cut, NULL), UMB_OK);
        assert_int_equal(blend.sharp.triangles, cases[i].is_sharp ? 100 : 0);
        assert_int_equal(cut.sharp.triangles, blend.sharp.triangles);
        assert_int_equal(blend.figures.triangles, 0);
        if (cases[i].is_sharp) {
            assert_int_equal(blend.sharp.first, 1);
            assert_true(blend.sharp.share > 0.95 && blend.sharp.share < 1.0);
            assert_true(blend.translucent.triangles > 50 && cut.translucent.triangles == 0);
            assert_true(cut.figures.triangles > 50);
            assert_true(umbs_cut_keeps(&cut, 0, 0.1, 0.5) && !umbs_cut_keeps(&cut, 0, 0.6, 0.5));
        } else {
            assert_int_equal(cut.translucent.triangles, blend.translucent.triangles);
        }
        umbs_cuts_finish(&blend);
        umbs_cuts_finish(&cut);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(samples_equal_a_slow_definition_for_every_wrap),
        cmocka_unit_test(coordinates_far_outside_stay_in_the_image),
        cmocka_unit_test(triangles_are_whole_cut_or_gone_as_their_samples_say),
        cmocka_unit_test(the_share_is_that_of_the_texels_below_the_cut_off),
        cmocka_unit_test(the_share_of_a_texture_that_repeats_is_not_that_of_one_texel),
        cmocka_unit_test(mirrored_instances_keep_each_corner_with_its_coordinates),
        cmocka_unit_test(a_solid_with_a_hole_counts_as_open),
        cmocka_unit_test(sharp_materials_become_cut_outs_on_request),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
