/* SPDX-License-Identifier: Apache-2.0 */
/* The forecast of bytes, and the choice between closed and open. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/byte_growth.h"
#include "bake/plan_choices.h"

/* Sets the costs of pages that take `density` bytes of the file for each of their bytes. */
static void set_pages(struct umbb_page_costs *pages, const struct umbb_costs *costs, double density,
                      double copies)
{
    *pages = (struct umbb_page_costs){density * copies * umbb_level_bytes_sum(costs), copies};
}

/* Makes costs at three resolutions from 2^10 on, in which every level grows by `growth`. */
static void make_costs(struct umbb_costs costs[3], double first, double growth, double density)
{
    memset(costs, 0, 3 * sizeof *costs);
    for (uint32_t i = 0; i < 3; i++) {
        double bytes = first * pow(growth, i);
        for (uint32_t level = UMB_LEVEL_BRICK; level <= 10 + i; level++, bytes /= growth) {
            costs[i].level_bytes[level] = bytes;
        }
        set_pages(&costs[i].small_pages, &costs[i], density, 1.1);
        set_pages(&costs[i].large_pages, &costs[i], density, 1.0);
    }
}

static double sum_at(double first, double growth, uint32_t doublings, uint32_t levels)
{
    double sum = 0.0, bytes = first * pow(growth, doublings);
    for (uint32_t i = 0; i < levels; i++, bytes /= growth) {
        sum += bytes;
    }
    return sum;
}

/* A steady growth must be continued, whatever its rate. */
static void steady_growth_is_continued(void **state)
{
    (void)state;
    static const double rates[] = {1.5, 2.0, 3.1, 3.9};
    struct umbb_costs open[3], closed[3];
    const struct umbb_growth_samples a = {open, 3}, b = {closed, 3}, few = {open + 1, 2};
    for (size_t i = 0; i < sizeof rates / sizeof rates[0]; i++) {
        for (uint32_t doublings = 1; doublings <= 3; doublings++) {
            make_costs(open, 1e5, rates[i], 0.8);
            make_costs(closed, 5e4, rates[i], 0.8);
            const double expected = sum_at(1e5, rates[i], 2 + doublings, 10 + doublings);
            const struct umbb_rule_bytes nodes = umbb_growth_nodes(&a, &b, doublings);
            assert_true(fabs(nodes.open / expected - 1.0) < 1e-3); /* the levels near the root */
            assert_true(fabs(nodes.closed / nodes.open - 0.5) < 1e-9);
            assert_true(fabs(umbb_growth_packed(&a, doublings) / (0.88 * nodes.open) - 1) < 1e-9);
            assert_true(fabs(umbb_growth_packed(&b, doublings) / (0.88 * nodes.closed) - 1) < 1e-3);
            assert_true(fabs(umbb_growth_nodes(&few, &few, doublings).open / expected - 1) < 1e-3);
        }
    }
}

/* Costs may grow like lines beside areas: the ratio between the two rules must be continued as it
 * was. */
static void ratio_of_the_rules_is_continued(void **state)
{
    (void)state;
    struct umbb_costs open[3], closed[3];
    const struct umbb_growth_samples a = {open, 3}, b = {closed, 3};
    make_costs(open, 1e5, 3.2, 0.8);
    make_costs(closed, 1e5, 2.0, 0.8);
    const double last = umbb_level_bytes_sum(&closed[2]) / umbb_level_bytes_sum(&open[2]);
    const struct umbb_rule_bytes nodes = umbb_growth_nodes(&a, &b, 2);
    assert_true(nodes.closed / nodes.open < last * 0.42); /* (2 / 3.2)^2 is 0.39 */
    assert_true(nodes.closed / nodes.open > last * 0.37);
}

/* The density of a file's pages goes on to change, but less. */
static void a_trend_of_the_density_is_continued(void **state)
{
    struct umbb_costs costs[3];
    const struct umbb_growth_samples samples = {costs, 3};
    (void)state;
    make_costs(costs, 1e5, 2.5, 0.9);
    const double steady = umbb_growth_packed(&samples, 1);
    costs[1].small_pages.bytes *= 0.8 / 0.9;
    costs[1].large_pages.bytes *= 0.8 / 0.9;
    const double rising = umbb_growth_packed(&samples, 1);
    assert_true(rising > 1.05 * steady && rising < 1.125 * steady);
}

/* Copies double with each doubling. Above the limit of copies the file has large pages. */
static void copies_decide_the_size_of_the_pages(void **state)
{
    static const double last[] = {1.04, 1.2, 1.9, 0.0};
    struct umbb_costs costs[3];
    const struct umbb_growth_samples samples = {costs, 3};
    (void)state;
    for (size_t i = 0; i < sizeof last / sizeof last[0]; i++) {
        make_costs(costs, 1e5, 2.5, 0.5);
        const double nodes = umbb_growth_nodes(&samples, &samples, 1).open;
        set_pages(&costs[1].small_pages, &costs[1], 0.5, 1.0);
        set_pages(&costs[2].small_pages, &costs[2], 0.5, last[i]);
        const double density = umbb_growth_packed(&samples, 1) / nodes;
        /* Small pages: two doublings of copies. Large ones have none. */
        const double small = 0.5 * last[i] * last[i];
        assert_true(fabs(density / (i < 2 ? small : 0.5) - 1.0) < 1e-9);
    }
    /* In between, so is the forecast. */
    make_costs(costs, 1e5, 2.5, 0.5);
    const double nodes = umbb_growth_nodes(&samples, &samples, 1).open;
    set_pages(&costs[1].small_pages, &costs[1], 0.5, 1.2);
    set_pages(&costs[2].small_pages, &costs[2], 0.5, 1.5);
    const double density = umbb_growth_packed(&samples, 1) / nodes;
    assert_true(density > 0.55 && density < 0.9);
}

/* The farther a forecast reaches, the wider its range. */
static void range_grows_with_the_doublings(void **state)
{
    (void)state;
    assert_true(umbb_growth_packed_factor(1, 0) == 1.0);
    for (uint32_t doublings = 1; doublings <= 4; doublings++) {
        const double factor = umbb_growth_packed_factor(3, doublings);
        assert_true(factor > umbb_growth_packed_factor(3, doublings - 1));
        assert_true(factor < umbb_growth_packed_factor(2, doublings));
    }
}

/* A cube over an open square. */
struct cube_scene {
    double positions[12][3];
    uint32_t triangles[14][3];
    struct umbs_mesh mesh;
    struct umbs_instance instance;
    struct umbs_scene_view view;
};

static void cube_scene_init(struct cube_scene *s, double side, double square)
{
    static const uint32_t faces[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6},
                                          {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7},
                                          {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    memset(s, 0, sizeof *s);
    for (int i = 0; i < 8; i++) {
        for (int k = 0; k < 3; k++) {
            /* turned a little, so that no face is parallel to a voxel's */
            s->positions[i][k] =
                side * ((double)(i >> k & 1) + 0.2 * (double)(i >> (k + 1) % 3 & 1));
        }
    }
    for (int i = 0; i < 4; i++) {
        s->positions[8 + i][0] = i & 1 ? square : 0.0;
        s->positions[8 + i][1] = i & 2 ? square : 0.0;
        s->positions[8 + i][2] = -1.0;
    }
    memcpy(s->triangles, faces, sizeof faces);
    memcpy(s->triangles[12], (uint32_t[3]){8, 9, 11}, sizeof s->triangles[12]);
    memcpy(s->triangles[13], (uint32_t[3]){8, 11, 10}, sizeof s->triangles[13]);
    s->mesh =
        (struct umbs_mesh){.vertex_count = 12, .triangle_count = 14, .material = UMBS_NO_INDEX};
    for (int k = 0; k < 3; k++) {
        s->instance.mesh_to_world[k][k] = 1.0;
    }
    s->view = (struct umbs_scene_view){.format = UMBS_FORMAT_OBJ,
                                       .z_up = 1,
                                       .mesh_count = 1,
                                       .instance_count = 1,
                                       .vertex_count = 12,
                                       .triangle_count = 14,
                                       .meshes = &s->mesh,
                                       .instances = &s->instance,
                                       .positions = (const double(*)[3])s->positions,
                                       .triangles = (const uint32_t(*)[3])s->triangles,
                                       .world_triangle_count = 14,
                                       .warnings = ""};
}

/* Chooses for a scene. Out: price. Returns 1 if the rule is on. */
static int choose(struct cube_scene *s, const struct umbb_options *options,
                  struct umbb_closed_price *price)
{
    struct umbb_analysis a;
    struct umb_error error;
    assert_int_equal(umbb_analysis_run(&s->view, options, &a, &error), UMB_OK);
    const struct umbb_small_job job = {.analysis = &a,
                                       .view = &s->view,
                                       .options = options,
                                       .memory = {.memory_bytes = options->memory_bytes,
                                                  .triangles = a.count,
                                                  .log2_size = options->resolution_log2,
                                                  .tile_log2 = options->tile_log2,
                                                  .threads = options->threads,
                                                  .closed_rule = a.closed_rule},
                                       .packed = options->plan};
    const enum umb_status status = umbb_closed_choose(&job, &error);
    if (status != UMB_OK) {
        print_error("%s\n", error.message);
    }
    assert_int_equal(status, UMB_OK);
    assert_int_equal(a.frusta[0].log2_size, options->resolution_log2);
    assert_int_equal(a.frusta[0].closed, a.closed_rule);
    *price = a.closed_price;
    const int closed = a.closed_rule;
    umbb_analysis_finish(&a);
    return closed;
}

static struct umbb_options options_at(uint32_t log2_size)
{
    return (struct umbb_options){.resolution_log2 = log2_size,
                                 .tile_log2 = log2_size < 12 ? log2_size : 12,
                                 .threads = 1,
                                 .memory_bytes = 1U << 30,
                                 .quiet = 1};
}

/* The cube fills the map, or is a speck on the square: by area the shares are 99 % and 0.1 %. */
static void rule_is_chosen_by_the_bytes_that_it_saves(void **state)
{
    (void)state;
    struct cube_scene s;
    struct umbb_closed_price price;
    for (uint32_t log2_size = 9; log2_size <= 14; log2_size += 5) {
        const struct umbb_options options = options_at(log2_size);
        cube_scene_init(&s, 10.0, 1.0);
        assert_int_equal(choose(&s, &options, &price), 1);
        assert_true(price.known && price.saved > 0.3);
        assert_int_equal(price.exact, log2_size == 9);
        assert_true(price.open_bytes == 0.0); /* not asked for */
        cube_scene_init(&s, 0.01, 1000.0);
        assert_int_equal(choose(&s, &options, &price), 0);
        assert_true(price.known && price.saved < UMBB_CLOSED_SAVES);
    }
    /* At a fine resolution the closed rule pays for the same small cube, although it is 0.6 % of
     * the area. */
    cube_scene_init(&s, 10.0, 300.0);
    struct umbb_options fine = options_at(12);
    fine.plan = 1;
    assert_int_equal(choose(&s, &fine, &price), 1);
    assert_true(price.exact && price.saved > 0.1);
    assert_true(price.closed_bytes > 0.0 && price.closed_bytes < 0.9 * price.open_bytes);
}

static void choice_depends_on_no_thread_or_memory(void **state)
{
    (void)state;
    struct cube_scene s;
    struct umbb_closed_price first, other;
    cube_scene_init(&s, 10.0, 300.0);
    struct umbb_options options = options_at(13);
    (void)choose(&s, &options, &first);
    options.threads = 3;
    options.memory_bytes = 64U << 20;
    options.tile_log2 = 9;
    (void)choose(&s, &options, &other);
    assert_memory_equal(&first.saved, &other.saved, sizeof first.saved);
    options.depth = UMBB_DEPTH_PLAIN;
    options.plan = 1; /* packed bytes change nothing */
    (void)choose(&s, &options, &other);
    assert_memory_equal(&first.saved, &other.saved, sizeof first.saved);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(steady_growth_is_continued),
        cmocka_unit_test(ratio_of_the_rules_is_continued),
        cmocka_unit_test(a_trend_of_the_density_is_continued),
        cmocka_unit_test(copies_decide_the_size_of_the_pages),
        cmocka_unit_test(range_grows_with_the_doublings),
        cmocka_unit_test(rule_is_chosen_by_the_bytes_that_it_saves),
        cmocka_unit_test(choice_depends_on_no_thread_or_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
