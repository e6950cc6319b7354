/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Rays in doubles: every hit is compared with long double over all triangles, far from the world's
 * origin and closer to edges than floats resolve. No ray may pass through a watertight mesh.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "gen.h"
#include "make_asset.h"
#include "rays/rays.h"

typedef double triangle[3][3];

static const double far_origin[3] = {2600000, 1200000, 400};

/* Returns the share of `way` at which a ray meets a triangle; NAN if it misses, or is so near to an
 * edge or to its start that 1e-12 metres would change the answer. */
static long double meet(const triangle v, const struct umbr_exact_ray *ray, int *is_close)
{
    long double at[3][3], sum = 0, edge[3], least = INFINITY;
    int below = 0, above = 0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            at[i][k] =
                (long double)v[i][k] - (long double)ray->origin[k] - (long double)ray->from[k];
        }
    }
    for (int i = 0; i < 3; i++) {
        const long double *a = at[(i + 1) % 3], *b = at[(i + 2) % 3];
        edge[i] = 0;
        for (int k = 0; k < 3; k++) {
            const int m = (k + 1) % 3, n = (k + 2) % 3;
            edge[i] += (long double)ray->direction[k] * (a[m] * b[n] - a[n] * b[m]);
        }
        below |= edge[i] < 0;
        above |= edge[i] > 0;
        sum += edge[i];
        least = fminl(least, fabsl(edge[i]));
    }
    long double normal[3], height = 0;
    for (int k = 0; k < 3; k++) {
        const int m = (k + 1) % 3, n = (k + 2) % 3;
        normal[k] = (at[1][m] - at[0][m]) * (at[2][n] - at[0][n]) -
                    (at[1][n] - at[0][n]) * (at[2][m] - at[0][m]);
        height += normal[k] * at[0][k];
    }
    *is_close = least < 1e-12L || fabsl(height) < 1e-12L;
    return below == above || height / sum < 0 ? (long double)NAN : height / sum;
}

static void random_ray(uint64_t *seed, const triangle *soup, size_t count,
                       struct umbr_exact_ray *ray)
{
    const double(*v)[3] = soup[next_random(seed) % count];
    const double b = random_unit(seed), c = (1 - b) * random_unit(seed);
    /* Aims a ray at a place up to 1e-10 m beside an edge, or anywhere in a triangle. */
    const double beside = next_random(seed) & 1 ? 0 : 1e-10 * (2 * random_unit(seed) - 1);
    double length = 0;
    ray->origin = far_origin;
    ray->far_m = next_random(seed) & 1 ? (double)INFINITY : 3 * random_unit(seed);
    for (int k = 0; k < 3; k++) {
        const double at = next_random(seed) % 4 == 0
                              ? v[0][k] + b * (v[1][k] - v[0][k]) + beside
                              : v[0][k] + b * (v[1][k] - v[0][k]) + c * (v[2][k] - v[0][k]);
        ray->from[k] = 3 * random_unit(seed) - 1.5;
        ray->direction[k] = at - far_origin[k] - ray->from[k];
        length += ray->direction[k] * ray->direction[k];
    }
    for (int k = 0; k < 3; k++) {
        ray->direction[k] /= sqrt(length);
    }
}

static void hits_equal_those_of_long_double_over_all_triangles(void **state)
{
    (void)state;
    enum {
        COUNT = 60
    };
    static triangle soup[COUNT];
    uint8_t closed[COUNT];
    uint64_t seed = round_seed(20261122);
    struct umbr_exact *exact;
    int hits = 0, judged = 0;
    for (int i = 0; i < COUNT * 9; i++) {
        soup[i / 9][i / 3 % 3][i % 3] = far_origin[i % 3] + 2 * random_unit(&seed) - 1;
    }
    for (int i = 0; i < COUNT; i++) {
        closed[i] = (uint8_t)(next_random(&seed) & 1);
    }
    assert_int_equal(umbr_exact_create((const triangle *)soup, COUNT, NULL, 1, &exact, NULL),
                     UMB_OK);
    for (int n = 0; n < case_count(short_count(100000, 10000)); n++) {
        struct umbr_exact_ray ray;
        struct umbr_exact_hit hit;
        long double least = INFINITY;
        int close = 0, winding = 0;
        uint32_t first = UINT32_MAX;
        random_ray(&seed, (const triangle *)soup, COUNT, &ray);
        for (uint32_t i = 0; i < COUNT; i++) {
            int is_close;
            const long double s = meet(soup[i], &ray, &is_close);
            close |= is_close || fabsl(s - (long double)ray.far_m) < 1e-9L;
            if (s <= (long double)ray.far_m) {
                long double facing = 0;
                for (int k = 0; k < 3; k++) {
                    const int a = (k + 1) % 3, b = (k + 2) % 3;
                    const double *o = soup[i][0], *p = soup[i][1], *q = soup[i][2];
                    facing += (long double)ray.direction[k] *
                              ((long double)(p[a] - o[a]) * (long double)(q[b] - o[b]) -
                               (long double)(p[b] - o[b]) * (long double)(q[a] - o[a]));
                }
                winding += closed[i] ? (facing > 0 ? 1 : -1) : 0;
                first = s < least ? i : first;
                least = fminl(least, s);
            }
        }
        if (close) {
            continue;
        }
        judged++;
        hits += first != UINT32_MAX;
        umbr_exact_nearest(exact, &ray, &hit);
        assert_int_equal(hit.triangle, first);
        assert_true(first == UINT32_MAX ? hit.distance < 0
                                        : fabsl((long double)hit.distance - least) < 1e-9L);
        assert_int_equal(umbr_exact_occluded(exact, &ray), first != UINT32_MAX);
        assert_int_equal(umbr_exact_winding(exact, &ray, closed), winding);
    }
    print_message("%d rays judged, %d of them hit\n", judged, hits);
    assert_true(judged > case_count(short_count(100000, 10000)) / 2 && hits > judged / 4 &&
                hits < judged);
    umbr_exact_destroy(exact);
}

static void nothing_passes_through_a_watertight_mesh(void **state)
{
    (void)state;
    struct gen_mesh mesh = {0};
    struct gen_rng rng = {3};
    struct umbr_exact *exact;
    uint64_t seed = round_seed(5);
    gen_ball(&mesh, (const int32_t[3]){0, 0, 0}, 1000, 24, &rng, 0);
    triangle *ball = calloc(mesh.triangle_count, sizeof *ball);
    assert_non_null(ball);
    for (size_t t = 0; t < mesh.triangle_count; t++) {
        for (size_t k = 0; k < 9; k++) {
            ball[t][k / 3][k % 3] =
                mesh.vertices[mesh.triangles[t][k / 3]][k % 3] / 1000.0 + far_origin[k % 3];
        }
    }
    assert_int_equal(
        umbr_exact_create((const triangle *)ball, mesh.triangle_count, NULL, 1, &exact, NULL),
        UMB_OK);
    for (int n = 0; n < case_count(short_count(200000, 20000)); n++) {
        /* Aims rays from the middle at corners and at places on edges. */
        const double(*v)[3] = (const double(*)[3])ball[next_random(&seed) % mesh.triangle_count];
        const double share = next_random(&seed) & 1 ? 0 : random_unit(&seed);
        struct umbr_exact_ray ray = {.origin = far_origin, .far_m = INFINITY};
        double length = 0;
        for (int k = 0; k < 3; k++) {
            ray.from[k] = 0.1 * random_unit(&seed);
            ray.direction[k] =
                (v[0][k] - far_origin[k]) + share * (v[1][k] - v[0][k]) - ray.from[k];
            length += ray.direction[k] * ray.direction[k];
        }
        for (int k = 0; k < 3; k++) {
            ray.direction[k] /= sqrt(length);
        }
        assert_true(umbr_exact_occluded(exact, &ray));
    }
    umbr_exact_destroy(exact);
    gen_mesh_finish(&mesh);
    free(ball);
}

/* Two floors 1e-9 m apart, 1000 m wide: floats cannot tell them apart. */
static void what_floats_cannot_tell_apart_is_told_apart(void **state)
{
    (void)state;
    static const double corner[4][2] = {{-500, -500}, {500, -500}, {500, 500}, {-500, 500}};
    triangle floor[2];
    struct umbr_rays *rays;
    const struct umbr_exact *exact, *again;
    static const double origin[3] = {0, 0, 0};
    for (int t = 0; t < 2; t++) {
        for (int k = 0; k < 3; k++) {
            const double *at = corner[k == 0 ? 0 : k + t];
            floor[t][k][0] = at[0];
            floor[t][k][1] = at[1];
            floor[t][k][2] = 0.37 + 0.001 * at[0]; /* no float */
        }
    }
    assert_int_equal(umbr_rays_build((const triangle *)floor, 2, NULL, &rays, NULL), UMB_OK);
    assert_true(umbr_rays_error_m(rays) > 1e-5);
    assert_int_equal(umbr_rays_exact(rays, &exact, NULL), UMB_OK);
    assert_int_equal(umbr_rays_exact(rays, &again, NULL), UMB_OK);
    assert_ptr_equal(exact, again);
    for (int n = 0; n < 1000; n++) {
        const double x = 0.321 * n - 150;
        struct umbr_exact_ray ray = {.origin = origin,
                                     .from = {x, 20.5, 0.37 + 0.001 * x + 1e-9},
                                     .direction = {0, 0, 1},
                                     .far_m = INFINITY};
        assert_false(umbr_exact_occluded(exact, &ray));
        ray.from[2] -= 2e-9;
        assert_true(umbr_exact_occluded(exact, &ray));
    }
    umbr_rays_destroy(rays);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hits_equal_those_of_long_double_over_all_triangles),
        cmocka_unit_test(nothing_passes_through_a_watertight_mesh),
        cmocka_unit_test(what_floats_cannot_tell_apart_is_told_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
