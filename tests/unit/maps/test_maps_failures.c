/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Failures of techniques that the literature describes: each is constructed and measured, and so is
 * its remedy. Figures of docs/explained/techniques.md come from here.
 */
#include "maps_fixture.h"

enum {
    SIDE = 64
};

static float depth[SIDE][SIDE];

/* Two occluders: at `a` for x < 32, at `b` beyond. */
static void two_depths(float a, float b)
{
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++) {
            depth[y][x] = x < SIDE / 2 ? a : b;
        }
    }
}

/* Least and greatest answer of a depth along the middle row. */
struct range {
    double least, most;
};

static struct range ask_row(const struct umb_map_settings *settings,
                            const struct umb_map_filter *filter, double t)
{
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    struct range range = {2.0, -1.0};
    struct umb_map *map = map_of(&frustum, &depth[0][0], settings);
    const struct umb_map_query query = query_of(map, filter);
    for (double x = 16.5; x < 48.0; x += 1.0) {
        const double value = ask_one(&query, x, 32.5, t);
        range.least = fmin(range.least, value);
        range.most = fmax(range.most, value);
    }
    umb_map_destroy(map);
    return range;
}

static const struct umb_map_filter plain = {.width = 1};

/* Both occluders lie before the receiver: the truth is 0 everywhere. */
static void variance_bleeds_under_two_occluders_and_others_do_not(void **state)
{
    static const struct {
        const char *name;
        struct umb_map_settings settings;
        struct umb_map_filter filter;
        double least, most; /* of the greatest answer */
    } rows[] = {
        /* mu = 0.35, sigma = 0.15 in the middle: 0.0225 / (0.0225 + 0.0225) at 0.5. */
        {"vsm", {.technique = UMB_MAP_VSM}, {.width = 1}, 0.40, 0.70},
        {"vsm, reduction 0.7", {.technique = UMB_MAP_VSM}, {.width = 1, .reduction = 0.7}, 0, 0},
        {"vsm, contrast 16", {.technique = UMB_MAP_VSM}, {.width = 1, .contrast = 16}, 0, 0.12},
        {"lvsm 8", {.technique = UMB_MAP_LVSM, .terms = 8}, {.width = 1}, 0, 0.01},
        {"esm 80", {.technique = UMB_MAP_ESM, .exponent = 80}, {.width = 1}, 0, 0.05},
        {"evsm 40", {.technique = UMB_MAP_EVSM, .exponent = 40}, {.width = 1}, 0, 0.002},
        {"msm", {.technique = UMB_MAP_MSM}, {.width = 1}, 0, 0.01},
        {"convolution 16",
         {.technique = UMB_MAP_CONVOLUTION, .terms = 16, .damping = 2},
         {.width = 1},
         0,
         0.15},
    };
    (void)state;
    two_depths(0.2F, 0.5F);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct umb_map_settings settings = rows[i].settings;
        settings.blur = 9;
        const struct range range = ask_row(&settings, &rows[i].filter, 0.55);
        print_message("%-20s bleeds %.4f\n", rows[i].name, range.most);
        assert_true(range.most >= rows[i].least && range.most <= rows[i].most);
    }
}

/* An occluder 0.5 % of the range before the receiver. */
static void exponential_bleeds_near_the_occluder_and_a_greater_exponent_does_not(void **state)
{
    (void)state;
    two_depths(0.5F, 0.5F);
    struct umb_map_settings settings = {.technique = UMB_MAP_ESM, .exponent = 80};
    const struct range weak = ask_row(&settings, &plain, 0.505);
    assert_true(fabs(weak.most - exp(-0.4)) < 1e-5);
    /* Linear space has no more to give ... */
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    const struct umb_map_layer layer = {.depth = &depth[0][0]};
    struct umb_map *map;
    settings.linear = 1;
    settings.exponent = 800;
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, NULL), UMB_E_TOO_LARGE);
    /* ... log space has. */
    settings.linear = 0;
    const struct range strong = ask_row(&settings, &plain, 0.505);
    print_message("c = 80: %.4f, c = 800: %.4f\n", weak.most, strong.most);
    assert_true(fabs(strong.most - exp(-4.0)) < 1e-5);
    settings = (struct umb_map_settings){
        .technique = UMB_MAP_EVSM, .exponent = 40, .negative_exponent = 40};
    assert_true(ask_row(&settings, &plain, 0.505).most < 1e-3);
}

/* A flat occluder at 0.5; receivers behind its slope are dark: how much light leaks? */
static double ringing(uint32_t terms, double damping)
{
    const struct umb_map_settings settings = {
        .technique = UMB_MAP_CONVOLUTION, .terms = terms, .damping = damping};
    double leak = 0.0;
    for (double t = 0.5 + 1.5 / terms; t < 0.95; t += 0.002) {
        leak = fmax(leak, ask_row(&settings, &plain, t).most);
    }
    return leak;
}

static void fourier_series_ring_and_damping_calms_them(void **state)
{
    (void)state;
    two_depths(0.5F, 0.5F);
    for (uint32_t terms = 8; terms <= 16; terms += 8) {
        const double rings = ringing(terms, 0.0), calm = ringing(terms, 2.0);
        print_message("M = %u: rings by %.4f, damped %.4f\n", terms, rings, calm);
        /* Gibbs: the series overshoots by 9 % beside the step, for any number of terms; answers are
         * twice the series. */
        assert_true(rings > 0.04 && rings < 0.18);
        assert_true(calm < 0.04 && calm < 0.5 * rings);
    }
}

/* The series converges to the step: the mean error over depths around an occluder falls with M. */
static void more_fourier_terms_are_nearer_to_the_step(void **state)
{
    (void)state;
    two_depths(0.5F, 0.5F);
    double before = 1.0;
    for (uint32_t terms = 2; terms <= 16; terms *= 2) {
        const struct umb_map_settings settings = {.technique = UMB_MAP_CONVOLUTION, .terms = terms};
        double sum = 0.0;
        int count = 0;
        for (double t = 0.1; t < 0.9; t += 0.0137) {
            sum += fabs(ask_row(&settings, &plain, t).most - (t <= 0.5 ? 1.0 : 0.0));
            count++;
        }
        print_message("M = %u: mean error %.4f\n", terms, sum / count);
        assert_true(sum / count < 0.7 * before);
        before = sum / count;
    }
}

/* Receivers on a steep plane, queried without bias: the depth plane's second moment must light
 * them. */
static void second_moment_of_the_depth_plane_lights_steep_planes(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++) {
            depth[y][x] = (float)(0.1 + 0.01 * (x + 0.5) + 0.002 * (y + 0.5));
        }
    }
    double darkest[2];
    for (int plane = 0; plane < 2; plane++) {
        const struct umb_map_settings settings = {
            .technique = UMB_MAP_VSM, .access = UMB_MAP_SAT, .depth_plane = plane};
        struct umb_map *map = map_of(&frustum, &depth[0][0], &settings);
        const struct umb_map_query query = query_of(map, &plain);
        darkest[plane] = 1.0;
        for (double x = 20.05; x < 40.0; x += 0.1) {
            /* Boxes of width 1 interpolate, so points are queried half a texel off, where they do
             * not. */
            const double t = 0.1 + 0.01 * (x + 0.45) + 0.002 * 30.5;
            darkest[plane] = fmin(darkest[plane], ask_one(&query, x, 30.5, t));
        }
        umb_map_destroy(map);
    }
    print_message("darkest: %.3f without, %.3f with\n", darkest[0], darkest[1]);
    assert_true(darkest[0] < 0.25);
    assert_true(darkest[1] > 0.5); /* p = 0.25 g^2 / (0.25 g^2 + (0.45 g)^2) */
}

/* A plane across the light must not flicker with its depth's rounding, wherever it lies. */
static void flat_receivers_are_lit_at_every_depth_in_every_format(void **state)
{
    static const struct umb_map_settings kinds[] = {
        {.technique = UMB_MAP_VSM, .blur = 5},
        {.technique = UMB_MAP_VSM, .blur = 5, .format = UMB_MAP_U16},
        {.technique = UMB_MAP_LVSM, .blur = 5, .terms = 8},
        {.technique = UMB_MAP_EVSM, .blur = 5, .exponent = 40, .negative_exponent = 40},
        {.technique = UMB_MAP_EVSM, .blur = 5, .exponent = 42, .linear = 1},
        {.technique = UMB_MAP_MSM, .blur = 5},
        {.technique = UMB_MAP_MSM, .blur = 5, .format = UMB_MAP_U16},
        {.technique = UMB_MAP_ESM, .blur = 5, .exponent = 80},
    };
    (void)state;
    uint64_t seed = 7;
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        double darkest = 1.0;
        for (int i = 0; i < 60; i++) {
            const float z = (float)(0.001 + 0.998 * random_unit(&seed));
            two_depths(z, z);
            /* A sixteen-bit channel moves depth by up to 1/65534; the receiver's depth is not
             * rounded. */
            darkest = fmin(darkest, ask_row(&kinds[k], &plain, (double)z).least);
        }
        print_message("%s %d: darkest %.4f\n", umb_map_technique_name(kinds[k].technique),
                      (int)kinds[k].format, darkest);
        assert_true(darkest > 0.45);
    }
}

/* Two depths in the window, the receiver at the deeper one: both bounds are exact there, so the
 * answer is the lit share (Donnelly, Lauritzen 2006; Peters, Klein 2015). */
static void two_depths_and_a_receiver_at_the_deeper_are_answered_exactly(void **state)
{
    static const struct umb_map_settings kinds[] = {
        {.technique = UMB_MAP_VSM, .blur = 9, .access = UMB_MAP_SAT},
        {.technique = UMB_MAP_EVSM, .blur = 9, .exponent = 10, .negative_exponent = 10},
        {.technique = UMB_MAP_MSM, .blur = 9, .access = UMB_MAP_SAT},
    };
    (void)state;
    two_depths(0.25F, 0.75F);
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        struct umb_map *map = map_of(&frustum, &depth[0][0], &kinds[k]);
        const struct umb_map_query query = query_of(map, &plain);
        for (int lit = 1; lit < 9; lit++) {
            const double x = 32.5 - 5.0 + lit; /* `lit` of the nine columns are beyond 32 */
            const double value = ask_one(&query, x, 32.5, 0.75);
            assert_true(fabs(value - lit / 9.0) < 2e-3);
        }
        umb_map_destroy(map);
    }
}

static void linear_exponents_stay_finite_up_to_their_limit(void **state)
{
    (void)state;
    two_depths(0.0F, 1.0F);
    const enum umb_map_format formats[] = {UMB_MAP_F32, UMB_MAP_F16};
    for (int i = 0; i < 2; i++) {
        const double limit = umb_map_exponent_limit(formats[i], 2);
        print_message("format %d: %.3f\n", (int)formats[i], limit);
        const struct umb_map_settings settings = {.technique = UMB_MAP_EVSM,
                                                  .exponent = limit,
                                                  .negative_exponent = limit,
                                                  .linear = 1,
                                                  .format = formats[i],
                                                  .blur = 9};
        const struct range range = ask_row(&settings, &plain, 0.999999);
        assert_true(range.least >= 0.0 && range.most <= 1.0 && range.most > 0.99);
    }
    assert_true(umb_map_exponent_limit(UMB_MAP_F32, 2) > 44.0);
    assert_true(umb_map_exponent_limit(UMB_MAP_F16, 2) > 5.4);
    assert_true(umb_map_exponent_limit(UMB_MAP_U16, 1) == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(variance_bleeds_under_two_occluders_and_others_do_not),
        cmocka_unit_test(exponential_bleeds_near_the_occluder_and_a_greater_exponent_does_not),
        cmocka_unit_test(fourier_series_ring_and_damping_calms_them),
        cmocka_unit_test(more_fourier_terms_are_nearer_to_the_step),
        cmocka_unit_test(second_moment_of_the_depth_plane_lights_steep_planes),
        cmocka_unit_test(flat_receivers_are_lit_at_every_depth_in_every_format),
        cmocka_unit_test(two_depths_and_a_receiver_at_the_deeper_are_answered_exactly),
        cmocka_unit_test(linear_exponents_stay_finite_up_to_their_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
