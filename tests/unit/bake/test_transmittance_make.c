/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares deep maps of translucent triangles with products over all hits. The test's own rays find
 * the hits in long double, through every texel's middle.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/depth/cut_out.h"
#include "bake/depth/transmittance_make.h"
#include "cut_scene.h"

enum {
    LEVEL = 7,
    TEXELS = 1 << LEVEL,
    DEPTH = 256, /* voxels */
    TRIANGLES = 120,
};

struct fixture {
    struct cut_scene scene;
    struct umbs_cuts cuts;
    struct umbb_cut_plane planes[CUT_TRIANGLES_MAX];
    uint8_t kinds[CUT_TRIANGLES_MAX];
    struct umbb_cuts of;
    struct umbb_casters casters;
};

/* Materials 1 to 3 become BLEND with the texture, glass with it, and glass without one. */
static void make_materials(struct cut_scene *s)
{
    s->materials[1].alpha_mode = UMBS_ALPHA_BLEND;
    s->materials[1].base_alpha = 0.9F;
    s->materials[2].alpha_mode = UMBS_ALPHA_MASK;
    s->materials[2].texture = 0;
    s->materials[2].base_alpha = 1.0F;
    s->materials[2].transmission = 0.75F;
    s->materials[3].alpha_mode = UMBS_ALPHA_OPAQUE;
    s->materials[3].transmission = 0.5F;
}

/* In: scale: of x, y; z times as much again. */
static void finish_fixture(struct fixture *f, double scale_z)
{
    struct cut_scene *s = &f->scene;
    assert_int_equal(umbs_cuts_find(&s->view, &f->cuts, NULL), UMB_OK);
    for (uint32_t i = 0; i < s->view.triangle_count; i++) {
        double corners[3][3];
        for (int k = 0; k < 3; k++) {
            s->positions[3 * i + (uint32_t)k][2] *= scale_z;
            memcpy(corners[k], s->positions[3 * i + (uint32_t)k], sizeof corners[k]);
            corners[k][2] = 1.0;
        }
        const uint32_t cut = f->cuts.of[i];
        if (cut < UMBS_CUT_CLEAR) {
            umbb_cut_plane_find((const double(*)[3])corners, &f->planes[cut]);
        }
    }
    f->of = (struct umbb_cuts){f->cuts.of, f->planes, &f->cuts};
    f->casters = (struct umbb_casters){.corners = (const double(*)[3][3])s->positions,
                                       .kinds = f->kinds,
                                       .count = s->view.triangle_count,
                                       .size = DEPTH,
                                       .cuts = &f->of};
}

static void make_fixture(struct fixture *f, uint64_t seed)
{
    memset(f, 0, sizeof *f);
    cut_scene_init(&f->scene, seed);
    make_materials(&f->scene);
    while (f->scene.view.triangle_count < TRIANGLES) {
        cut_scene_add_random(&f->scene, TEXELS, 1 + (uint32_t)(cut_bits(&f->scene) % 3));
    }
    finish_fixture(f, (double)DEPTH / TEXELS);
    /* A material that is clear or opaque all over gives no translucent caster; its triangles are
     * put far behind. */
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        if (f->cuts.of[i] >= UMBS_CUT_CLEAR) {
            f->cuts.of[i] = 0;
            for (int k = 0; k < 3; k++) {
                f->scene.positions[3 * i + (uint32_t)k][0] = -5.0 * k;
            }
        }
    }
}

static void make(const struct fixture *f, unsigned threads, struct umb__transmittance_bytes *bytes)
{
    const struct umbb_transmittance_input job = {.casters = &f->casters,
                                                 .level = LEVEL,
                                                 .threads = threads,
                                                 .max_bytes = SIZE_MAX / 2,
                                                 .working_bytes = (size_t)64 << 20};
    int too_large;
    struct umb_error error = {0};
    memset(bytes, 0, sizeof *bytes);
    if (umbb_transmittance_make(&job, bytes, &too_large, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(too_large, 0);
}

/* The entry of one frustum whose map is these squares. */
static void expand(const struct umb__transmittance_bytes *squares, struct umb__trans *trans)
{
    static const struct umb_frustum_info frustum = {.log2_size = 8};
    static const uint8_t level = LEVEL;
    struct umb__transmittance_bytes entry = {0};
    struct umb_error error = {0};
    assert_int_equal(umb__transmittance_append(&entry, &level, 1, SIZE_MAX, NULL), UMB_OK);
    assert_int_equal(
        umb__transmittance_append(&entry, squares->data, squares->count, SIZE_MAX, NULL), UMB_OK);
    if (umb__transmittance_load(entry.data, entry.count, &frustum, 1, NULL, trans, &error) !=
        UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb__transmittance_bytes_finish(&entry);
}

/* A hit of the ray through a texel's middle: its depth, and the light that it lets through. It is
 * unsure at an edge, on a voxel's border, or where the texture has a step. */
struct hit {
    long double z, passes;
    int unsure;
};

/* Returns 0 where the ray misses the triangle. */
static int hit_triangle(const struct fixture *f, uint32_t i, int x, int y, struct hit *hit)
{
    const double(*p)[3] = &f->casters.corners[i][0];
    const struct umbs_cut *cut = &f->cuts.cuts[f->cuts.of[i]];
    const struct umbs_material *material = &f->scene.materials[cut->material];
    const long double at[2] = {x + 0.5L, y + 0.5L};
    long double edge[3], area = 0.0L, z = 0.0L, uv[2] = {0.0L, 0.0L};
    for (int k = 0; k < 3; k++) {
        const double *a = p[(k + 1) % 3], *b = p[(k + 2) % 3];
        edge[k] = (a[0] - at[0]) * (b[1] - at[1]) - (a[1] - at[1]) * (b[0] - at[0]);
        area += edge[k];
    }
    int inside = 1;
    hit->unsure = fabsl(area) < 1e-9L;
    for (int k = 0; k < 3; k++) {
        const long double weight = edge[k] / area;
        inside = inside && weight > 0.0L;
        hit->unsure |= fabsl(weight) < 1e-9L;
        z += weight * p[k][2];
        uv[0] += weight * (long double)cut->uv[k][0];
        uv[1] += weight * (long double)cut->uv[k][1];
    }
    if (!inside) {
        return hit->unsure;
    }
    long double alpha = 255.0L;
    if (material->texture != UMBS_NO_INDEX) {
        alpha = cut_slow_alpha(&f->scene, (double)uv[0], (double)uv[1]);
    }
    const long double own = alpha / 255.0L * (long double)material->base_alpha;
    const long double cutoff = (long double)material->alpha_cutoff;
    const long double opacity = material->alpha_mode == UMBS_ALPHA_BLEND  ? own
                                : material->alpha_mode == UMBS_ALPHA_MASK ? own >= cutoff
                                                                          : 1.0L;
    hit->unsure |= material->alpha_mode == UMBS_ALPHA_MASK && fabsl(own - cutoff) < 1e-6L;
    hit->unsure |= fabsl(z - 0.5L - rintl(z - 0.5L)) < 1e-6L;
    hit->passes = 1.0L - opacity * (1.0L - (long double)material->transmission);
    hit->z = z;
    return 1;
}

/* Computes the light left at the middle of voxels behind all hits before them; a list ends where
 * almost none is left. */
static void lists_are_products_of_all_hits(void **state)
{
    (void)state;
    static struct fixture f;
    size_t compared = 0, unsure = 0, deep = 0;
    for (uint64_t seed = 1; seed <= 3; seed++) {
        struct umb__transmittance_bytes bytes;
        struct umb__trans trans;
        make_fixture(&f, seed);
        make(&f, 2, &bytes);
        expand(&bytes, &trans);
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            struct hit hits[TRIANGLES];
            int count = 0, bad = 0;
            for (uint32_t t = 0; t < TRIANGLES; t++) {
                if (hit_triangle(&f, t, i % TEXELS, i / TEXELS, &hits[count])) {
                    bad |= hits[count++].unsure;
                }
            }
            unsure += (size_t)bad;
            deep += count > 8;
            for (uint32_t z = 3; z < DEPTH && !bad; z += 13) {
                const struct umb__transmittance_window window = {
                    2 * (uint32_t)(i % TEXELS), 2 * (uint32_t)(i % TEXELS),
                    2 * (uint32_t)(i / TEXELS), 2 * (uint32_t)(i / TEXELS), z};
                long double left = 1.0L;
                for (int k = 0; k < count; k++) {
                    left *= hits[k].z <= z + 0.5L ? hits[k].passes : 1.0L;
                }
                const long double got = 1.0L - (long double)umb__transmittance_lost(
                                                   &trans, &trans.maps[0], 8, &window) /
                                                   (long double)UMB__TRANSMITTANCE_ONE;
                const long double room = left < 0.001L ? 0.001L : 1e-6L;
                if (fabsl(got - left) > room) {
                    fail_msg("seed %d, texel %d, z %u: %.9Lg, not %.9Lg", (int)seed, i, z, got,
                             left);
                }
                compared++;
            }
        }
        umb__transmittance_finish(&trans, NULL);
        umb__transmittance_bytes_finish(&bytes);
        umbs_cuts_finish(&f.cuts);
    }
    print_message("%zu compared, %zu texels unsure, %zu of more than 8 hits\n", compared, unsure,
                  deep);
    assert_true(compared > 500000 && unsure < 500 && deep > 100);
}

static void bytes_do_not_depend_on_threads_or_the_order_of_triangles(void **state)
{
    (void)state;
    static struct fixture f;
    struct umb__transmittance_bytes first, other;
    make_fixture(&f, 11);
    make(&f, 1, &first);
    for (unsigned threads = 2; threads <= 4; threads++) {
        make(&f, threads, &other);
        assert_int_equal(first.count, other.count);
        assert_memory_equal(first.data, other.data, first.count);
        umb__transmittance_bytes_finish(&other);
    }
    for (uint32_t i = 0; i < TRIANGLES / 2; i++) {
        double swap[3][3];
        const uint32_t k = TRIANGLES - 1 - i, cut = f.cuts.of[i];
        double(*corners)[3][3] = (double(*)[3][3])f.scene.positions;
        memcpy(swap, corners[i], sizeof swap);
        memcpy(corners[i], corners[k], sizeof swap);
        memcpy(corners[k], swap, sizeof swap);
        f.cuts.of[i] = f.cuts.of[k];
        f.cuts.of[k] = cut;
    }
    make(&f, 2, &other);
    assert_int_equal(first.count, other.count);
    assert_memory_equal(first.data, other.data, first.count);
    umb__transmittance_bytes_finish(&other);
    umb__transmittance_bytes_finish(&first);
    umbs_cuts_finish(&f.cuts);
}

/* A pane of two triangles, whose diagonal runs through the middles of texels, must take its share
 * of light once. */
static void edges_that_are_shared_count_once(void **state)
{
    (void)state;
    static struct fixture f;
    static const float uv[3][2] = {{0, 0}, {0, 0}, {0, 0}};
    const double low = 4.5, high = 100.5, z = 50.0;
    const double pane[2][3][3] = {{{low, low, z}, {high, low, z}, {high, high, z}},
                                  {{low, low, z}, {high, high, z}, {low, high, z}}};
    struct umb__transmittance_bytes bytes;
    struct umb__trans trans;
    memset(&f, 0, sizeof f);
    cut_scene_init(&f.scene, 1);
    make_materials(&f.scene);
    cut_scene_add(&f.scene, pane[0], uv, 3);
    cut_scene_add(&f.scene, pane[1], uv, 3);
    finish_fixture(&f, 1.0);
    make(&f, 1, &bytes);
    expand(&bytes, &trans);
    for (uint32_t i = 0; i < TEXELS * TEXELS; i++) {
        const uint32_t x = i % TEXELS, y = i / TEXELS;
        const struct umb__transmittance_window window = {2 * x, 2 * x, 2 * y, 2 * y, 60};
        const int inside = x >= 4 && x < 100 && y >= 4 && y < 100;
        assert_int_equal(umb__transmittance_lost(&trans, &trans.maps[0], 8, &window),
                         inside ? UMB__TRANSMITTANCE_ONE / 2 : 0);
    }
    umb__transmittance_finish(&trans, NULL);
    umb__transmittance_bytes_finish(&bytes);
    umbs_cuts_finish(&f.cuts);
}

static void limits_are_told_apart(void **state)
{
    (void)state;
    static struct fixture f;
    struct umb__transmittance_bytes bytes = {0};
    struct umb_error error = {0};
    int too_large;
    make_fixture(&f, 5);
    struct umbb_transmittance_input job = {.casters = &f.casters,
                                           .level = LEVEL,
                                           .threads = 2,
                                           .max_bytes = 2000,
                                           .working_bytes = (size_t)64 << 20};
    assert_int_equal(umbb_transmittance_make(&job, &bytes, &too_large, &error), UMB_E_LIMIT);
    assert_int_equal(too_large, 1);
    umb__transmittance_bytes_finish(&bytes);
    job.max_bytes = SIZE_MAX / 2;
    job.working_bytes = 20000;
    assert_int_equal(umbb_transmittance_make(&job, &bytes, &too_large, &error), UMB_E_LIMIT);
    assert_int_equal(too_large, 0);
    assert_non_null(strstr(error.message, "--memory"));
    umb__transmittance_bytes_finish(&bytes);
    /* With too many threads for the memory, fewer are used. */
    size_t least = 20000;
    for (enum umb_status status = UMB_E_LIMIT; status == UMB_E_LIMIT; least += least / 4) {
        job.threads = 1;
        job.working_bytes = least;
        status = umbb_transmittance_make(&job, &bytes, &too_large, &error);
    }
    const size_t wanted = bytes.count;
    umb__transmittance_bytes_finish(&bytes);
    job.threads = 16;
    assert_int_equal(umbb_transmittance_make(&job, &bytes, &too_large, &error), UMB_OK);
    assert_int_equal(bytes.count, wanted);
    umb__transmittance_bytes_finish(&bytes);
    umbs_cuts_finish(&f.cuts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_are_products_of_all_hits),
        cmocka_unit_test(bytes_do_not_depend_on_threads_or_the_order_of_triangles),
        cmocka_unit_test(edges_that_are_shared_count_once),
        cmocka_unit_test(limits_are_told_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
