/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The guarantees of each technique, checked on random distributions of depth: 5 x 5 texels around
 * each of 262144 texels, compared with counts and long double formulas.
 */
#include "maps_fixture.h"

enum {
    SIDE = 512,
    BLUR = 5,
    CASES = SIDE * SIDE
};

static float depth[SIDE][SIDE];
static double at[CASES][3];
static float values[CASES];
static float shares[CASES]; /* true share of the window that is lit */

/* Returns a window's texels; texels beyond the border count as "no caster", depth 1. */
static double texel(int x, int y)
{
    return x < 0 || y < 0 || x >= SIDE || y >= SIDE ? 1.0 : (double)depth[y][x];
}

/* Blobs of one, two or many depths, so that windows hold from one to 25 of them; receivers are at
 * random depths, a third of them close to a texel's own. */
static int set_up(void **state)
{
    (void)state;
    uint64_t seed = round_seed(20060314);
    for (int by = 0; by < SIDE; by += 8) {
        for (int bx = 0; bx < SIDE; bx += 8) {
            const double a = random_unit(&seed), b = random_unit(&seed);
            const int kind = (int)(random_unit(&seed) * 4.0);
            for (int k = 0; k < 64; k++) {
                const double r = random_unit(&seed);
                const double d = kind == 0   ? a
                                 : kind == 1 ? (r < 0.5 ? a : b)
                                 : kind == 2 ? a + 1e-4 * r
                                             : r;
                depth[by + k / 8][bx + k % 8] = (float)fmin(d, 0.9999);
            }
        }
    }
    for (int i = 0; i < CASES; i++) {
        const int x = i % SIDE, y = i / SIDE;
        const double r = random_unit(&seed);
        at[i][0] = x + 0.5;
        at[i][1] = y + 0.5;
        at[i][2] = r < 0.33 ? (double)depth[y][x] + 1e-3 * random_unit(&seed) : random_unit(&seed);
        at[i][2] = fmin(at[i][2], 1.0);
        int lit = 0;
        for (int k = 0; k < BLUR * BLUR; k++) {
            lit += texel(x + k % BLUR - BLUR / 2, y + k / BLUR - BLUR / 2) >=
                   0.01 * (100.0 * at[i][2]);
        }
        shares[i] = (float)lit / (BLUR * BLUR);
    }
    return 0;
}

struct trial {
    const char *name;
    struct umb_map_settings settings;
};

/* Runs a technique over all cases; returns the mean difference from the truth. */
static double run_trial(const struct umb_map_settings *settings, double *below, double *above)
{
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    struct umb_map_settings s = *settings;
    s.blur = BLUR;
    struct umb_map *map = map_of(&frustum, &depth[0][0], &s);
    const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 1});
    ask(&query, (const double(*)[3])at, CASES, values);
    umb_map_destroy(map);
    double sum = 0.0;
    *below = 0.0;
    *above = 0.0;
    for (int i = 0; i < CASES; i++) {
        const double difference = (double)values[i] - (double)shares[i];
        sum += fabs(difference);
        *below = fmax(*below, -difference);
        *above = fmax(*above, difference);
    }
    return sum / CASES;
}

/* Upper bounds may not be below the truth by more than the slack that the map states. */
static void upper_bounds_hold_within_their_stated_slack(void **state)
{
    static const struct trial trials[] = {
        {"vsm f32", {.technique = UMB_MAP_VSM}},
        {"vsm u16", {.technique = UMB_MAP_VSM, .format = UMB_MAP_U16}},
        {"vsm sat", {.technique = UMB_MAP_VSM, .access = UMB_MAP_SAT}},
        {"lvsm 4", {.technique = UMB_MAP_LVSM, .terms = 4}},
        {"lvsm 16", {.technique = UMB_MAP_LVSM, .terms = 16}},
        {"esm log 80", {.technique = UMB_MAP_ESM, .exponent = 80}},
        {"esm log 1000", {.technique = UMB_MAP_ESM, .exponent = 1000}},
        {"esm f32 80", {.technique = UMB_MAP_ESM, .exponent = 80, .linear = 1}},
        {"esm f16 10",
         {.technique = UMB_MAP_ESM, .exponent = 10, .linear = 1, .format = UMB_MAP_F16}},
        {"evsm log 40", {.technique = UMB_MAP_EVSM, .exponent = 40}},
        {"evsm log 40/40", {.technique = UMB_MAP_EVSM, .exponent = 40, .negative_exponent = 40}},
        {"evsm f32 40/5",
         {.technique = UMB_MAP_EVSM, .exponent = 40, .negative_exponent = 5, .linear = 1}},
        {"evsm f16 5/5",
         {.technique = UMB_MAP_EVSM,
          .exponent = 5,
          .negative_exponent = 5,
          .linear = 1,
          .format = UMB_MAP_F16}},
        {"msm f32", {.technique = UMB_MAP_MSM}},
        {"msm u16", {.technique = UMB_MAP_MSM, .format = UMB_MAP_U16}},
        {"msm sat", {.technique = UMB_MAP_MSM, .access = UMB_MAP_SAT}},
    };
    (void)state;
    for (size_t t = 0; t < sizeof trials / sizeof trials[0]; t++) {
        double below, above;
        const double mean = run_trial(&trials[t].settings, &below, &above);
        const struct umb_map_frustum frustum = plain_frustum(1, 1);
        const float one = 0.5F;
        struct umb_map *map = map_of(&frustum, &one, &trials[t].settings);
        struct umb_map_info info;
        umb_map_get_info(map, &info);
        umb_map_destroy(map);
        print_message("%-16s mean %.4f, below by %.3g of %.3g, above by %.3f\n", trials[t].name,
                      mean, below, info.slack, above);
        assert_int_equal(info.bound, UMB_MAP_UPPER_BOUND);
        assert_true(below <= info.slack + 1e-6); /* answers are floats */
    }
}

/* The formulas in long double, from the layer itself. */
struct window {
    long double mean, square, warped, series;
};

static void window_make(int i, long double c, int terms, struct window *w)
{
    memset(w, 0, sizeof *w);
    const long double pi = 3.14159265358979323846264338327950288L;
    const long double t = 0.01L * (long double)(100.0 * at[i][2]);
    for (int k = 0; k < BLUR * BLUR; k++) {
        const long double z =
            (long double)texel(i % SIDE + k % BLUR - BLUR / 2, i / SIDE + k / BLUR - BLUR / 2);
        const long double d = 2.0L * z - 1.0L;
        w->mean += d / (BLUR * BLUR);
        w->square += d * d / (BLUR * BLUR);
        w->warped += c > 0.0L ? expl(c * z) / (BLUR * BLUR) : 0.0L;
        long double step = 0.5L;
        for (int m = 1; m <= terms; m++) {
            const long double angle = (2 * m - 1) * pi;
            step += 2.0L / angle * sinl(angle * (z - t));
        }
        w->series += terms > 0 ? step / (BLUR * BLUR) : 0.0L;
    }
}

static struct umb_map_info ask_all(const struct umb_map_settings *settings)
{
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    struct umb_map_info info;
    struct umb_map *map = map_of(&frustum, &depth[0][0], settings);
    const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 1});
    ask(&query, (const double(*)[3])at, CASES, values);
    umb_map_get_info(map, &info);
    umb_map_destroy(map);
    return info;
}

static void fourier_series_equal_long_double_ones_within_the_stated_slack(void **state)
{
    (void)state;
    for (int terms = 4; terms <= 16; terms += 12) {
        const struct umb_map_settings settings = {
            .technique = UMB_MAP_CONVOLUTION, .blur = BLUR, .terms = (uint32_t)terms};
        const struct umb_map_info info = ask_all(&settings);
        long double worst = 0.0L;
        for (int i = 0; i < CASES; i += short_count(8, 32)) { /* sines of long doubles are slow */
            struct window w;
            window_make(i, 0.0L, terms, &w);
            const long double expected = fminl(fmaxl(2.0L * w.series, 0.0L), 1.0L);
            worst = fmaxl(worst, fabsl((long double)values[i] - expected));
        }
        print_message("%d terms: off by %Lg of %g\n", terms, worst, info.slack);
        assert_int_equal(info.bound, UMB_MAP_ESTIMATE);
        assert_true(worst <= (long double)info.slack + 6e-8L); /* answers are floats */
    }
}

static void exponentials_equal_long_double_ones_within_the_stated_slack(void **state)
{
    (void)state;
    for (int linear = 0; linear < 2; linear++) {
        const struct umb_map_settings settings = {
            .technique = UMB_MAP_ESM, .blur = BLUR, .exponent = 80, .linear = linear};
        const struct umb_map_info info = ask_all(&settings);
        long double worst = 0.0L;
        for (int i = 0; i < CASES; i += short_count(1, 8)) {
            struct window w;
            window_make(i, 80.0L, 0, &w);
            const long double t = 0.01L * (long double)(100.0 * at[i][2]);
            const long double expected = fminl(w.warped * expl(-80.0L * t), 1.0L);
            worst = fmaxl(worst, fabsl((long double)values[i] - expected));
        }
        print_message("%s: off by %Lg of %g\n", linear ? "linear" : "log", worst, info.slack);
        assert_true(worst <= (long double)info.slack + 6e-8L);
    }
}

static void variances_equal_long_double_ones_where_rounding_can_be_told_from_them(void **state)
{
    (void)state;
    const struct umb_map_settings settings = {.technique = UMB_MAP_VSM, .blur = BLUR};
    (void)ask_all(&settings);
    const long double e = 0x1p-25L;
    int told = 0;
    for (int i = 0; i < CASES; i++) {
        struct window w;
        window_make(i, 0.0L, 0, &w);
        const long double t = 2.0L * 0.01L * (long double)(100.0 * at[i][2]) - 1.0L;
        const long double variance = w.square - w.mean * w.mean, distance = t - w.mean;
        if (variance < 100.0L * e || distance < 10.0L * e) {
            continue;
        }
        const long double expected = variance / (variance + distance * distance);
        /* d p = p (1 - p) (d log variance + 2 d log distance), p (1 - p) <= 1/4. */
        const long double allowed = 0.25L * (3.0L * e / variance + 2.0L * e / distance) * 1.1L;
        assert_true(fabsl((long double)values[i] - expected) <= allowed + 6e-8L);
        told++;
    }
    assert_true(told > CASES / 4);
}

/* The contrast C bends the bound: values up to 1 keep it, larger ones break it by the amount that
 * the header states. */
static void a_contrast_above_1_is_no_bound_any_more(void **state)
{
    (void)state;
    static const double contrasts[] = {0.25, 1.0, 4.0, 16.0};
    double below[4], above[4];
    for (int c = 0; c < 4; c++) {
        const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
        const struct umb_map_settings settings = {.technique = UMB_MAP_VSM, .blur = BLUR};
        struct umb_map *map = map_of(&frustum, &depth[0][0], &settings);
        struct umb_map_info info;
        umb_map_get_info(map, &info);
        const struct umb_map_query query =
            query_of(map, &(struct umb_map_filter){.contrast = contrasts[c]});
        ask(&query, (const double(*)[3])at, CASES, values);
        below[c] = above[c] = 0.0;
        for (int i = 0; i < CASES; i++) {
            below[c] = fmax(below[c], (double)shares[i] - (double)values[i]);
            above[c] += fmax((double)values[i] - (double)shares[i], 0.0) / CASES;
        }
        assert_true(contrasts[c] > 1.0 || below[c] <= info.slack);
        umb_map_destroy(map);
    }
    print_message("below the share: %.3f with C = 4, %.3f with 16\n", below[2], below[3]);
    assert_true(below[2] > 0.2 && below[3] > below[2]);
    assert_true(above[0] > above[1] && above[1] > above[2] && above[2] > above[3]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(upper_bounds_hold_within_their_stated_slack),
        cmocka_unit_test(a_contrast_above_1_is_no_bound_any_more),
        cmocka_unit_test(fourier_series_equal_long_double_ones_within_the_stated_slack),
        cmocka_unit_test(exponentials_equal_long_double_ones_within_the_stated_slack),
        cmocka_unit_test(variances_equal_long_double_ones_where_rounding_can_be_told_from_them),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
