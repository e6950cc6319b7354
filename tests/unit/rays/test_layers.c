/* SPDX-License-Identifier: Apache-2.0 */
/* Translucent surfaces along rays, compared with all triangles met one by one in long double. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "cut_scene.h"
#include "rays/layers.h"

enum {
    TRIANGLES = 200,
    RAYS = 20000,
    FOUND_MAX = 256,
};

/* Distance along an upward ray, to one part in 2^20, that Embree's floats may err by. */
#define NEAR 2e-5

struct met {
    long double distance, passes;
    uint32_t triangle;
};

static int compare(const void *a, const void *b)
{
    const struct met *x = a, *y = b;
    return (x->distance > y->distance) - (x->distance < y->distance);
}

/* What a material of the fixture lets through. */
static long double passes_at(const struct cut_scene *s, uint32_t material, long double u,
                             long double v)
{
    const struct umbs_material *m = &s->materials[material];
    long double alpha =
        m->texture == UMBS_NO_INDEX ? 1.0L : cut_slow_alpha(s, (double)u, (double)v) / 255.0L;
    alpha *= (long double)m->base_alpha;
    alpha = m->alpha_mode == UMBS_ALPHA_BLEND ? alpha : 1.0L;
    return 1.0L - alpha * (1.0L - (long double)m->transmission);
}

/* Finds all triangles of translucent materials above a place; -1: an edge is too near to decide. */
static int meet(const struct cut_scene *s, const double from[3], double far, struct met *out)
{
    int count = 0;
    for (uint32_t t = 0; t < s->view.mesh_count; t++) {
        const double(*p)[3] = &s->positions[3 * (size_t)t];
        const uint32_t material = s->meshes[t].material;
        long double edge[3], area = 0.0L, z = 0.0L, uv[2] = {0.0L, 0.0L};
        for (int k = 0; k < 3; k++) {
            const double *a = p[(k + 1) % 3], *b = p[(k + 2) % 3];
            edge[k] = ((long double)a[0] - from[0]) * ((long double)b[1] - from[1]) -
                      ((long double)a[1] - from[1]) * ((long double)b[0] - from[0]);
            area += edge[k];
        }
        int inside = 1;
        for (int k = 0; k < 3; k++) {
            const long double weight = edge[k] / area;
            if (fabsl(weight) < 1e-3L) {
                return -1;
            }
            inside = inside && weight > 0.0L;
            z += weight * (long double)p[k][2];
            uv[0] += weight * (long double)s->uvs[3 * t + (uint32_t)k][0];
            uv[1] += weight * (long double)s->uvs[3 * t + (uint32_t)k][1];
        }
        if (!inside || material == 0) {
            continue;
        }
        const long double distance = z - (long double)from[2];
        if (fabsl(distance) < NEAR || fabsl(distance - (long double)far) < NEAR) {
            return -1;
        }
        if (distance > 0.0L && distance < (long double)far) {
            out[count++] = (struct met){distance, passes_at(s, material, uv[0], uv[1]), t};
        }
    }
    qsort(out, (size_t)count, sizeof *out, compare);
    return count;
}

static void scene_fill(struct cut_scene *s)
{
    cut_scene_init(s, 11);
    s->materials[1].alpha_mode = UMBS_ALPHA_BLEND; /* with the texture */
    s->materials[1].base_alpha = 0.7F;
    s->materials[2].alpha_mode = UMBS_ALPHA_BLEND;
    s->materials[2].base_alpha = 0.25F;
    s->materials[3].alpha_mode = UMBS_ALPHA_OPAQUE;
    s->materials[3].transmission = 0.6F;
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        cut_scene_add_random(s, 8.0, i % 4);
    }
}

static void products_and_order_are_those_of_all_triangles(void **state)
{
    (void)state;
    static const double up[3] = {0, 0, 1};
    static struct cut_scene s;
    struct umbs_cuts cuts;
    struct umbr_layers *layers;
    size_t judged = 0, several = 0;
    scene_fill(&s);
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    assert_int_equal(
        umbr_layers_build((const double(*)[3][3])s.positions, TRIANGLES, &cuts, 1, &layers, NULL),
        UMB_OK);
    for (int i = 0; i < RAYS; i++) {
        const double from[3] = {8.0 * cut_unit(&s), 8.0 * cut_unit(&s), 8.0 * cut_unit(&s)};
        const double far = 8.0 * cut_unit(&s);
        struct umbr_layer found[FOUND_MAX];
        struct met met[TRIANGLES];
        const int count = meet(&s, from, far, met);
        if (count < 0) {
            continue;
        }
        long double left = 1.0L;
        size_t at = 0;
        const size_t got = umbr_layers_find(layers, from, up, far, 0.0, found, FOUND_MAX);
        for (int k = 0; k < count; k++) {
            left *= met[k].passes;
            if (met[k].passes < 0.99L) { /* others may round to clear */
                while (at < got && found[at].triangle != met[k].triangle) {
                    at++;
                }
                assert_true(at < got);
                assert_true(fabsl(found[at].distance - met[k].distance) < NEAR);
                assert_true(fabsl(1.0L - found[at].opacity - met[k].passes) < 1e-2L);
            }
        }
        judged++;
        several += count > 2;
        assert_true(got <= (size_t)count);
        /* Embree's floats move a hit by 1e-6, and its texture by up to a percent of a texel. */
        assert_true(fabsl(umbr_layers_pass(layers, from, up, far) - left) < 2e-2L);
    }
    print_message("%zu rays judged, %zu through more than two surfaces\n", judged, several);
    assert_true(judged > RAYS / 2 && several > RAYS / 20);
    umbr_layers_destroy(layers);
    umbs_cuts_finish(&cuts);
}

/* A square of two triangles at height z; `material` is translucent. */
static void add_square(struct cut_scene *s, double z, uint32_t material)
{
    const double corners[2][3][3] = {{{0, 0, z}, {1, 0, z}, {0, 1, z}},
                                     {{1, 0, z}, {1, 1, z}, {0, 1, z}}};
    static const float uv[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 0}, {1, 1}, {0, 1}}};
    cut_scene_add(s, corners[0], uv[0], material);
    cut_scene_add(s, corners[1], uv[1], material);
}

static void a_ray_through_a_shared_edge_meets_a_pane_once(void **state)
{
    (void)state;
    static const double up[3] = {0, 0, 1};
    static struct cut_scene s;
    struct umbs_cuts cuts;
    struct umbr_layers *layers;
    cut_scene_init(&s, 12);
    s.materials[2].alpha_mode = UMBS_ALPHA_BLEND; /* takes a quarter */
    add_square(&s, 1.0, 2);
    add_square(&s, 2.0, 2);
    add_square(&s, 3.0, 0);
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    assert_int_equal(
        umbr_layers_build((const double(*)[3][3])s.positions, 6, &cuts, 1, &layers, NULL), UMB_OK);
    for (int i = 1; i < 1024; i++) { /* along the diagonal, in exact floats */
        const double from[3] = {i / 1024.0, 1.0 - i / 1024.0, 0.0};
        struct umbr_layer found[8];
        assert_true(fabs(umbr_layers_pass(layers, from, up, INFINITY) - 0.5625) < 1e-6);
        assert_true(fabs(umbr_layers_pass(layers, from, up, 1.5) - 0.75) < 1e-6);
        assert_int_equal(umbr_layers_find(layers, from, up, INFINITY, 0.0, found, 8), 2);
        assert_int_equal(umbr_layers_find(layers, from, up, INFINITY, 0.0, found, 1), 1);
        assert_int_equal(umbr_layers_find(layers, from, up, INFINITY, 0.8, found, 8), 1);
        assert_true(found[0].distance < 1.001 && found[0].opacity > 0.24);
    }
    umbr_layers_destroy(layers);
    umbs_cuts_finish(&cuts);
}

static void opaque_scenes_have_no_layers(void **state)
{
    (void)state;
    static const double up[3] = {0, 0, 1}, from[3] = {0.3, 0.3, 0};
    static struct cut_scene s;
    struct umbs_cuts cuts;
    struct umbr_layers *layers = (struct umbr_layers *)(void *)&cuts;
    cut_scene_init(&s, 13);
    add_square(&s, 1.0, 0);
    add_square(&s, 2.0, 1); /* cut out, not translucent */
    assert_int_equal(umbs_cuts_find(&s.view, &cuts, NULL), UMB_OK);
    assert_int_equal(
        umbr_layers_build((const double(*)[3][3])s.positions, 4, &cuts, 1, &layers, NULL), UMB_OK);
    assert_null(layers);
    assert_true(umbr_layers_pass(NULL, from, up, INFINITY) >= 1.0);
    umbr_layers_destroy(NULL);
    umbs_cuts_finish(&cuts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(products_and_order_are_those_of_all_triangles),
        cmocka_unit_test(a_ray_through_a_shared_edge_meets_a_pane_once),
        cmocka_unit_test(opaque_scenes_have_no_layers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
