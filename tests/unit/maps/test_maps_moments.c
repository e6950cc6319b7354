/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Moments of translucent casters: the bounds are compared with long double bounds found in another
 * way, and maps with products over all fragments.
 */
#include "maps_fixture.h"
#include "maps/moment_bound.h"

enum {
    ATOMS_MAX = 40,
    ARCSINE = 64, /* equal masses that have its means up to T127 */
    PLACES = ATOMS_MAX + ARCSINE,
    W = 96,
    H = 64,
    MOST = 24,
    POINTS = 12000,
    MARGIN = 2, /* tables keep to the map at its border */
};

struct distribution {
    int count;
    double at[ATOMS_MAX], share[ATOMS_MAX];
};

/* Draws one to forty places; in a third of the cases they are close together, in a third they are
 * few. */
static void distribution_make(struct distribution *d, uint64_t *seed)
{
    const double kind = random_unit(seed), most = kind < 0.4 ? 4.0 : ATOMS_MAX;
    const double middle = 2.0 * random_unit(seed) - 1.0;
    const double wide = random_unit(seed) < 0.3 ? 1e-4 : 1.0;
    double sum = 0.0;
    d->count = 1 + (int)(random_unit(seed) * most);
    d->count = d->count > ATOMS_MAX ? ATOMS_MAX : d->count;
    for (int i = 0; i < d->count; i++) {
        d->at[i] = fmin(fmax(middle + wide * (2.0 * random_unit(seed) - 1.0), -1.0), 1.0);
        d->share[i] = 0.01 + random_unit(seed);
        sum += d->share[i];
    }
    for (int i = 0; i < d->count; i++) {
        d->share[i] /= sum;
    }
}

static void means_of(const struct distribution *d, uint32_t count, double *means)
{
    memset(means, 0, count * sizeof *means);
    for (int i = 0; i < d->count; i++) {
        double before = 1.0, here = d->at[i];
        for (uint32_t k = 0; k < count; k++) {
            const double next = 2.0 * d->at[i] * here - before;
            means[k] += d->share[i] * here;
            before = here;
            here = next;
        }
    }
}

/* Draws a receiver anywhere; in a third of the cases it is at a place or close to one. */
static double receiver_of(const struct distribution *d, uint64_t *seed)
{
    const double r = random_unit(seed), near = random_unit(seed);
    const int i = (int)(random_unit(seed) * d->count);
    const double t = r < 0.15   ? d->at[i]
                     : r < 0.33 ? d->at[i] + 1e-3 * (near - 0.5)
                                : 2.0 * near - 1.0;
    return fmin(fmax(t, -1.0), 1.0);
}

/* The mixture that the code solves, place by place, and its recurrence by Stieltjes' procedure. */
struct mixture {
    int degree;
    long double at[PLACES], share[PLACES];
    long double centre[5], pull[5], square[5];
};

static void mixture_make(const struct distribution *d, double bias, int degree, struct mixture *m)
{
    static long double arcsine[ARCSINE];
    static int made;
    for (int i = 0; i < ARCSINE && !made; i++) {
        arcsine[i] = cosl(acosl(-1.0L) * ((long double)i + 0.5L) / ARCSINE);
    }
    made = 1;
    const int places = d->count + ARCSINE;
    for (int i = 0; i < places; i++) {
        m->at[i] = i < d->count ? (long double)d->at[i] : arcsine[i - d->count];
        m->share[i] = i < d->count ? (1.0L - (long double)bias) * (long double)d->share[i]
                                   : (long double)bias / ARCSINE;
    }
    long double last[PLACES] = {0}, here[PLACES];
    m->degree = degree;
    m->pull[0] = 0.0L;
    for (int i = 0; i < places; i++) {
        here[i] = 1.0L;
    }
    for (int k = 0; k <= degree; k++) {
        long double square = 0.0L, first = 0.0L;
        for (int i = 0; i < places; i++) {
            square += m->share[i] * here[i] * here[i];
            first += m->share[i] * here[i] * here[i] * m->at[i];
        }
        m->square[k] = square;
        m->centre[k] = first / square;
        m->pull[k] = k > 0 ? square / m->square[k - 1] : 0.0L;
        for (int i = 0; i < places; i++) {
            const long double next = (m->at[i] - m->centre[k]) * here[i] - m->pull[k] * last[i];
            last[i] = here[i];
            here[i] = next;
        }
    }
}

/* Jacobi's matrix with t among its places; Sturm's count tells how many places lie below x. */
static int places_below(const struct mixture *m, long double corner, long double x)
{
    long double pivot = 1.0L;
    int below = 0;
    for (int k = 0; k <= m->degree; k++) {
        const long double own = k < m->degree ? m->centre[k] : corner;
        pivot = own - x - (k > 0 ? m->pull[k] / pivot : 0.0L);
        pivot = pivot == 0.0L ? 1e-300L : pivot;
        below += pivot < 0.0L;
    }
    return below;
}

static long double mass_of(const struct mixture *m, long double x)
{
    long double last = 0.0L, here = 1.0L, sum = 0.0L;
    for (int k = 0; k <= m->degree; k++) {
        sum += here * here / m->square[k];
        const long double next = (x - m->centre[k]) * here - m->pull[k] * last;
        last = here;
        here = next;
    }
    return 1.0L / sum;
}

/* Finds the least share before t: places by bisection, in long double. */
static long double slow_before(const struct mixture *m, double t)
{
    long double last = 0.0L, here = 1.0L, sum = 0.0L;
    for (int k = 0; k < m->degree; k++) {
        const long double next = ((long double)t - m->centre[k]) * here - m->pull[k] * last;
        last = here;
        here = next;
    }
    const long double corner = (long double)t - m->pull[m->degree] * last / here;
    for (int i = 0; i <= m->degree; i++) {
        long double low = -1e6L, high = 1e6L;
        while (nextafterl(low, high) < high) {
            const long double middle = 0.5L * (low + high);
            if (middle <= low || middle >= high) {
                break;
            }
            *(places_below(m, corner, middle) > i ? &high : &low) = middle;
        }
        if (low >= (long double)t - 1e-12L) {
            break; /* t itself, and what lies behind it */
        }
        sum += mass_of(m, low);
    }
    return sum;
}

/* Finds how far the bounds of random distributions are off the slow ones, at worst, for 20
 * receivers each. */
static long double worst_before(uint32_t count, double bias, int distributions, uint64_t *seed)
{
    static struct mixture m;
    long double worst = 0.0L;
    for (int i = 0; i < distributions; i++) {
        struct distribution d;
        double means[UMB__MOMENTS_MAX];
        distribution_make(&d, seed);
        means_of(&d, count, means);
        mixture_make(&d, bias, (int)count / 2, &m);
        for (int k = 0; k < 20; k++) {
            const double t = receiver_of(&d, seed);
            const long double before = (long double)umb__moment_bound(means, count, bias, t).before;
            worst = fmaxl(worst, fabsl(before - slow_before(&m, t)));
        }
    }
    return worst;
}

/* Off by rounding alone, which grows as the least squared norm falls, bias 4^-K. */
static void bounds_equal_long_double_ones(void **state)
{
    (void)state;
    static const double errors[] = {0.5 / 32767.0, 0x1p-25};
    uint64_t seed = round_seed(2018);
    for (size_t f = 0; f < 2; f++) {
        for (uint32_t count = 4; count <= UMB__MOMENTS_MAX; count += 2) {
            const double bias = umb__moment_bias(count, errors[f]);
            const long double worst =
                worst_before(count, bias, case_count(24000) / 120, &seed); /* of 6 kinds */
            print_message("%u moments, bias %.2g: off by %Lg\n", count, bias, worst);
            assert_true(worst < 0x1p-46L * powl(4.0L, count / 2) / (long double)bias);
        }
    }
}

/* Returns the least density of the mixture's second part, relative to the arcsine distribution, if
 * each of so many means is off by e with any sign. */
static double least_density(uint32_t count, double e, double bias)
{
    double least = 1.0;
    for (uint32_t signs = 0; signs < 1U << count; signs++) {
        for (int i = 0; i <= 180; i++) {
            double density = 1.0;
            for (uint32_t k = 1; k <= count; k++) {
                const double off = signs >> (k - 1) & 1 ? e : -e;
                density += 2.0 * off / bias * cos(acos(-1.0) / 180.0 * i * k);
            }
            least = fmin(least, density);
        }
    }
    return least;
}

/* As moment_bound.h argues, errors leave at least half of the density. The bias must leave no more
 * than that, since a larger bias costs accuracy. */
static void the_bias_is_the_least_that_errors_want(void **state)
{
    (void)state;
    static const double errors[] = {0.5 / 32767.0, 0x1p-20};
    for (uint32_t i = 0; i < 2; i++) {
        for (uint32_t count = 4; count <= UMB__MOMENTS_MAX; count += 2) {
            const double bias = umb__moment_bias(count, errors[i]);
            assert_true(fabs(least_density(count, errors[i], bias) - 0.5) < 1e-9);
        }
    }
}

/* Without errors of the means there is only the rounding of doubles. The bias keeps its effect, and
 * the bias itself, far below a step of a byte answer. */
static void doubles_have_the_bias_that_they_want(void **state)
{
    (void)state;
    uint64_t seed = round_seed(2019);
    for (uint32_t count = 4; count <= UMB__MOMENTS_MAX; count += 2) {
        const double bias = umb__moment_bias(count, 0.0);
        const long double worst = worst_before(count, bias, case_count(24000) / 60, &seed);
        print_message("%u moments of doubles, bias %.2g: off by %Lg\n", count, bias, worst);
        assert_true(bias < 2e-7 && worst < 1e-6L);
    }
}

/* No distribution may lie outside its bounds by more than the bias, for any errors of its means. */
static void distributions_lie_within_their_bounds(void **state)
{
    (void)state;
    static const double errors[] = {0.5 / 32767.0, 0x1p-25, 0x1p-41};
    uint64_t seed = round_seed(1911);
    for (size_t f = 0; f < sizeof errors / sizeof errors[0]; f++) {
        for (uint32_t count = 4; count <= UMB__MOMENTS_MAX; count += 2) {
            const double bias = umb__moment_bias(count, errors[f]);
            double low = 0.0, high = 0.0, gap = 0.0;
            const int cases = case_count(180000) / 9; /* kinds */
            for (int i = 0; i < cases; i++) {
                struct distribution d;
                double means[UMB__MOMENTS_MAX], before = 0.0, up_to = 0.0;
                distribution_make(&d, &seed);
                means_of(&d, count, means);
                for (uint32_t k = 0; k < count; k++) {
                    means[k] += (random_unit(&seed) < 0.5 ? -1.0 : 1.0) * errors[f];
                }
                const double t = receiver_of(&d, &seed);
                const struct umb__moment_bound bound = umb__moment_bound(means, count, bias, t);
                for (int k = 0; k < d.count; k++) {
                    before += d.at[k] < t ? d.share[k] : 0.0;
                    up_to += d.at[k] <= t ? d.share[k] : 0.0;
                }
                assert_true(bound.before >= 0.0 && bound.before + bound.at <= 1.0 + 1e-15);
                low = fmax(low, bound.before - before);
                high = fmax(high, up_to - bound.before - bound.at);
                gap += bound.at / cases;
            }
            print_message("%u moments, bias %.2g: %.2g and %.2g outside, %.3f wide\n", count, bias,
                          low, high, gap);
            /* In addition to the bias: rounding by 2^-53 over the least norm, bias 4^-K. */
            const double rounding = 0x1p-50 * pow(4.0, count / 2) / bias;
            assert_true(low < bias + rounding && high < bias + 4.0 * sqrt(rounding) * bias + 1e-6);
        }
    }
}

static struct umb_map_fragment fragments[W * H * MOST];
static uint64_t first[W * H + 1];
static double at[POINTS][3];
static float values[POINTS];

/* Strands as in hair: lists of up to `most`, depths of neighbours alike; receivers at texel
 * centres, where a blurred texel is its window's mean. */
static struct umb_map_fragments strands(uint64_t seed, int most, double opaque)
{
    uint64_t used = 0;
    seed = round_seed(seed);
    for (int i = 0; i < W * H; i++) {
        const int count = (int)(random_unit(&seed) * (most + 1));
        first[i] = used;
        for (int k = 0; k < count; k++) {
            const double near = (double)k / most + 0.02 * sin(0.2 * i) + 0.01 * random_unit(&seed);
            const double alpha = random_unit(&seed);
            const int full = random_unit(&seed) < opaque;
            fragments[used++] = (struct umb_map_fragment){(float)fmin(fmax(0.95 * near, 0.0), 1.0),
                                                          full ? 1.0F : (float)(0.7 * alpha)};
        }
    }
    first[W * H] = used;
    for (int i = 0; i < POINTS; i++) {
        at[i][0] = MARGIN + floor(random_unit(&seed) * (W - 2 * MARGIN)) + 0.5;
        at[i][1] = MARGIN + floor(random_unit(&seed) * (H - 2 * MARGIN)) + 0.5;
        at[i][2] = random_unit(&seed);
    }
    return (struct umb_map_fragments){first, fragments};
}

static long double product_at(int64_t x, int64_t y, double depth)
{
    long double left = 1.0L;
    if (x >= 0 && y >= 0 && x < W && y < H) {
        for (uint64_t i = first[y * W + x]; i < first[y * W + x + 1]; i++) {
            left *=
                (double)fragments[i].depth < depth ? 1.0L - (long double)fragments[i].alpha : 1.0L;
        }
    }
    return left;
}

static double truth_of(const double p[3], int taps)
{
    long double sum = 0.0L;
    for (int64_t k = 0; k < taps * taps; k++) {
        sum += product_at((int64_t)p[0] - taps / 2 + k % taps, (int64_t)p[1] - taps / 2 + k / taps,
                          0.01 * (100.0 * p[2]));
    }
    return (double)(sum / (taps * taps));
}

struct off {
    double mean, below, above;
    struct umb_map_info info;
};

static struct off run(const struct umb_map_fragments *in, enum umb_map_technique technique,
                      struct umb_map_settings settings, int taps)
{
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    struct umb_map *map = NULL;
    struct umb_error error = {.message = ""};
    struct off off = {0};
    settings.technique = technique;
    settings.blur = settings.access == UMB_MAP_SAT ? 0 : (uint32_t)taps;
    if (umb_map_build_translucent(&frustum, in, &settings, NULL, &map, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    const double width = settings.access == UMB_MAP_SAT ? taps : 1.0;
    const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = width});
    ask(&query, (const double(*)[3])at, POINTS, values);
    umb_map_get_info(map, &off.info);
    umb_map_destroy(map);
    for (int i = 0; i < POINTS; i++) {
        const double difference = (double)values[i] - truth_of(at[i], taps);
        off.mean += fabs(difference) / POINTS;
        off.below = fmax(off.below, -difference);
        off.above = fmax(off.above, difference);
    }
    print_message("%-10s %u of %d texels, format %d: mean %.4f, -%.3g +%.3g, slack %.3g\n",
                  off.info.name, settings.terms, taps, (int)settings.format, off.mean, off.below,
                  off.above, off.info.slack);
    return off;
}

static void light_is_never_below_the_products_and_nearer_with_more_moments(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(2017, MOST, 0.02);
    for (int taps = 1; taps <= 5; taps += 4) {
        double before = 1.0;
        for (uint32_t terms = 4; terms <= 8; terms += 2) {
            const struct off off =
                run(&in, UMB_MAP_MOMENTS, (struct umb_map_settings){.terms = terms}, taps);
            const struct off coarse =
                run(&in, UMB_MAP_MOMENTS,
                    (struct umb_map_settings){.terms = terms, .format = UMB_MAP_U16}, taps);
            assert_int_equal(off.info.bound, UMB_MAP_UPPER_BOUND);
            assert_true(off.info.bytes == (uint64_t)W * H * terms * 4);
            assert_true(off.below <= off.info.slack + 1e-6); /* answers are floats */
            assert_true(coarse.below <= coarse.info.slack + 1e-6);
            assert_true(off.mean < before && off.mean < coarse.mean);
            before = off.mean;
        }
    }
    const struct off tables =
        run(&in, UMB_MAP_MOMENTS, (struct umb_map_settings){.terms = 6, .access = UMB_MAP_SAT}, 5);
    assert_true(tables.below <= tables.info.slack + 1e-6);
}

/* A caller that sets a smaller bias than the format's errors need must be told that nothing is
 * promised. */
static void a_bias_below_what_the_format_needs_has_no_slack_to_state(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(2017, MOST, 0.02);
    for (int technique = UMB_MAP_MOMENTS; technique <= UMB_MAP_ABSORBANCE; technique++) {
        for (uint32_t terms = 4; terms <= 8; terms += 2) {
            const struct umb_map_settings settings = {
                .terms = terms, .format = UMB_MAP_U16, .moment_bias = 1e-12};
            const struct off off = run(&in, (enum umb_map_technique)technique, settings, 1);
            assert_true(off.below <= off.info.slack + 1e-6);
        }
    }
    const struct umb_map_frustum frustum = plain_frustum(2, 1);
    const struct umb_map_layer layer = {.depth = (const float[2]){0.25F, 0.5F}};
    const struct umb_map_settings msm = {
        .technique = UMB_MAP_MSM, .format = UMB_MAP_U16, .moment_bias = 1e-12};
    struct umb_map *map;
    struct umb_map_info info;
    assert_int_equal(umb_map_build(&frustum, &layer, &msm, NULL, &map, NULL), UMB_OK);
    umb_map_get_info(map, &info);
    assert_true(info.slack == 1.0);
    umb_map_destroy(map);
}

/* Also with the least number there is as bias: the bounds then mean nothing, but a share stays
 * between 0 and 1. */
static void a_bias_next_to_none_still_gives_shares(void **state)
{
    (void)state;
    static const double biases[] = {5e-324, 1e-310, 1e-300, 1e-160, 1e-60, 1e-18};
    uint64_t seed = 4711;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int i = 0; i < 30000; i++) {
        struct distribution d;
        double means[UMB__MOMENTS_MAX];
        distribution_make(&d, &seed);
        const uint32_t count = 4 + 2 * (uint32_t)(i % 3);
        means_of(&d, count, means);
        const double t = receiver_of(&d, &seed), bias = biases[i / 3 % 6];
        const struct umb__moment_bound bound = umb__moment_bound(means, count, bias, t);
        const struct umb__moment_bound least =
            umb__moment_bound(means, count, fmax(bias, UMB__MOMENT_BIAS_MIN), t);
        assert_memory_equal(&bound, &least, sizeof bound);
        if (!(bound.before >= 0.0 && bound.before <= 1.0 && bound.at >= 0.0 && bound.at <= 1.0)) {
            fail_msg("case %d, %u moments, bias %g: %g before %g, %g at it", i, count, bias,
                     bound.before, t, bound.at);
        }
    }
}

/* For single texels ABSORBANCE bounds the light too, and behind all casters it is nearly exact.
 * With a filter it is too dark, because the logarithm of a mean is not the mean of logarithms. */
static void absorbance_is_a_bound_in_a_texel_and_exact_behind_all(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(2018, MOST, 0.02);
    double before = 1.0;
    for (uint32_t terms = 4; terms <= 8; terms += 2) {
        const struct off off =
            run(&in, UMB_MAP_ABSORBANCE, (struct umb_map_settings){.terms = terms}, 1);
        assert_int_equal(off.info.bound, UMB_MAP_ESTIMATE);
        assert_true(off.info.bytes == (uint64_t)W * H * (terms + 1) * 4);
        assert_true(off.below <= off.info.slack + 1e-6);
        assert_true(off.mean < before);
        before = off.mean;
    }
    const struct off filtered =
        run(&in, UMB_MAP_ABSORBANCE, (struct umb_map_settings){.terms = 8}, 5);
    assert_true(filtered.below > 0.01);
    for (int i = 0; i < POINTS; i++) {
        at[i][2] = 1.0;
    }
    const struct off behind =
        run(&in, UMB_MAP_ABSORBANCE, (struct umb_map_settings){.terms = 8}, 1);
    assert_true(behind.mean < 0.01);
}

/* Answers with `overestimate` must lie between the bounds, and nearer to the middle of them. */
static void overestimating_trades_light_for_a_smaller_error(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(2019, MOST, 0.0);
    for (int technique = UMB_MAP_MOMENTS; technique <= UMB_MAP_ABSORBANCE; technique++) {
        const struct off bound =
            run(&in, (enum umb_map_technique)technique, (struct umb_map_settings){.terms = 4}, 1);
        const struct off middle =
            run(&in, (enum umb_map_technique)technique,
                (struct umb_map_settings){.terms = 4, .overestimate = 0.25}, 1);
        assert_int_equal(middle.info.bound, UMB_MAP_ESTIMATE);
        assert_true(middle.mean < bound.mean && middle.above <= bound.above);
    }
}

/* log(0): an opaque caster counts as leaving 2^-10, and nothing behind it counts. */
static void opaque_casters_are_dark_within_the_stated_bound(void **state)
{
    (void)state;
    const struct umb_map_fragment list[5] = {
        {0.25F, 1.0F}, {0.5F, 1.0F}, {-0.0F, 0.0F}, {0.75F, 0.5F}, {0.25F, 1.0F}};
    const uint64_t ends[2] = {0, 5};
    const struct umb_map_fragments in = {ends, list};
    const struct umb_map_frustum frustum = plain_frustum(1, 1);
    for (int technique = UMB_MAP_MOMENTS; technique <= UMB_MAP_ABSORBANCE; technique++) {
        for (uint32_t terms = 4; terms <= 8; terms += 2) {
            const struct umb_map_settings settings = {
                .technique = (enum umb_map_technique)technique, .terms = terms};
            struct umb_map *map;
            struct umb_map_info info;
            assert_int_equal(umb_map_build_translucent(&frustum, &in, &settings, NULL, &map, NULL),
                             UMB_OK);
            umb_map_get_info(map, &info);
            const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 1});
            assert_true(ask_one(&query, 0.5, 0.5, 0.2) > 0.99);
            assert_true(ask_one(&query, 0.5, 0.5, 0.25) >= 1.0 - info.slack);
            /* One place, and t: the bias alone stands between. */
            for (double t = 0.3; t < 1.0; t += 0.1) {
                assert_true(ask_one(&query, 0.5, 0.5, t) < info.slack + 1e-3);
            }
            umb_map_destroy(map);
        }
    }
}

/* Lists of opaque fragments are shadow maps: four moments of both must be the same numbers. */
static void opaque_lists_have_the_moments_of_a_shadow_map(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(2015, 6, 1.0);
    static float nearest[W * H];
    for (int i = 0; i < W * H; i++) {
        nearest[i] = 1.0F;
        for (uint64_t k = first[i]; k < first[i + 1]; k++) {
            nearest[i] = fminf(nearest[i], fragments[k].depth);
        }
    }
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    const struct umb_map_settings settings = {.technique = UMB_MAP_MOMENTS, .terms = 4, .blur = 5};
    const struct umb_map_settings plain = {.technique = UMB_MAP_MSM, .blur = 5};
    struct umb_map *lists, *depths = map_of(&frustum, nearest, &plain);
    struct umb_map_level a, b;
    assert_int_equal(umb_map_build_translucent(&frustum, &in, &settings, NULL, &lists, NULL),
                     UMB_OK);
    assert_true(umb_map_get_level(lists, 0, &a) == UMB_OK &&
                umb_map_get_level(depths, 0, &b) == UMB_OK);
    assert_true(a.bytes == b.bytes);
    for (size_t i = 0; i < a.bytes / sizeof(float); i++) {
        float x, y;
        memcpy(&x, (const uint8_t *)a.texels + i * sizeof x, sizeof x);
        memcpy(&y, (const uint8_t *)b.texels + i * sizeof y, sizeof y);
        assert_true(fabs((double)x - (double)y) < 1e-7);
    }
    umb_map_destroy(lists);
    umb_map_destroy(depths);
}

static void what_a_map_cannot_do_is_refused_by_name(void **state)
{
    (void)state;
    static const struct {
        struct umb_map_settings settings;
        enum umb_status status;
        const char *named;
    } bad[] = {
        {{.terms = 5}, UMB_E_ARGUMENT, "settings.terms"},
        {{.terms = 0}, UMB_E_ARGUMENT, "settings.terms"},
        {{.terms = 10}, UMB_E_ARGUMENT, "settings.terms"},
        {{.terms = 4, .format = UMB_MAP_F16}, UMB_E_UNSUPPORTED, "settings.format"},
        {{.terms = 4, .overestimate = NAN}, UMB_E_ARGUMENT, "settings.overestimate"},
        {{.terms = 4, .overestimate = 1.1}, UMB_E_ARGUMENT, "settings.overestimate"},
        {{.terms = 4, .moment_bias = -1.0}, UMB_E_ARGUMENT, "settings.moment_bias"},
        {{.terms = 4, .blur = 4}, UMB_E_ARGUMENT, "settings.blur"},
        {{.technique = UMB_MAP_MSM}, UMB_E_UNSUPPORTED, "umb_map_build"},
        {{.technique = UMB_MAP_DEEP}, UMB_E_UNSUPPORTED, "umb_map_build_deep"},
    };
    const struct umb_map_frustum frustum = plain_frustum(2, 1);
    struct umb_map_fragment list[2] = {{0.1F, 0.5F}, {0.2F, 0.5F}};
    const uint64_t ends[3] = {0, 1, 2};
    const struct umb_map_fragments in = {ends, list};
    struct umb_error error;
    struct umb_map *map;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct umb_map_settings settings = bad[i].settings;
        settings.technique =
            settings.technique == UMB_MAP_PCF ? UMB_MAP_MOMENTS : settings.technique;
        assert_int_equal(umb_map_build_translucent(&frustum, &in, &settings, NULL, &map, &error),
                         bad[i].status);
        assert_null(map);
        assert_non_null(strstr(error.message, bad[i].named));
    }
    const struct umb_map_settings good = {.technique = UMB_MAP_ABSORBANCE, .terms = 6};
    const float depth[2] = {0.5F, 0.5F};
    const struct umb_map_layer layer = {.depth = depth};
    assert_int_equal(umb_map_build(&frustum, &layer, &good, NULL, &map, &error), UMB_E_UNSUPPORTED);
    assert_non_null(strstr(error.message, "umb_map_build_translucent"));
    list[1].alpha = NAN;
    assert_int_equal(umb_map_build_translucent(&frustum, &in, &good, NULL, &map, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "fragments[1]"));
}

/* realloc that fails the n-th time and counts what is out. */
struct failing {
    int calls, fail_at, out;
};

static void *failing_resize(void *user, void *block, size_t bytes)
{
    struct failing *f = user;
    if (bytes == 0) {
        f->out -= block != NULL;
        free(block);
        return NULL;
    }
    if (f->calls++ == f->fail_at) {
        return NULL;
    }
    f->out += block == NULL;
    return realloc(block, bytes);
}

static void short_memory_is_a_status_and_leaks_nothing(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(5, 4, 0.0);
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    const struct umb_map_settings settings = {.technique = UMB_MAP_MOMENTS, .terms = 8};
    int ok = 0;
    for (int n = 0; n < 12 && ok == 0; n++) {
        struct failing failing = {.fail_at = n};
        const struct umb_alloc alloc = {failing_resize, &failing};
        struct umb_map *map;
        const enum umb_status status =
            umb_map_build_translucent(&frustum, &in, &settings, &alloc, &map, NULL);
        assert_int_equal(status, failing.calls > n ? UMB_E_NO_MEMORY : UMB_OK);
        ok += status == UMB_OK;
        umb_map_destroy(map);
        assert_int_equal(failing.out, 0);
    }
    assert_int_equal(ok, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bounds_equal_long_double_ones),
        cmocka_unit_test(the_bias_is_the_least_that_errors_want),
        cmocka_unit_test(doubles_have_the_bias_that_they_want),
        cmocka_unit_test(distributions_lie_within_their_bounds),
        cmocka_unit_test(light_is_never_below_the_products_and_nearer_with_more_moments),
        cmocka_unit_test(a_bias_below_what_the_format_needs_has_no_slack_to_state),
        cmocka_unit_test(a_bias_next_to_none_still_gives_shares),
        cmocka_unit_test(absorbance_is_a_bound_in_a_texel_and_exact_behind_all),
        cmocka_unit_test(overestimating_trades_light_for_a_smaller_error),
        cmocka_unit_test(opaque_casters_are_dark_within_the_stated_bound),
        cmocka_unit_test(opaque_lists_have_the_moments_of_a_shadow_map),
        cmocka_unit_test(what_a_map_cannot_do_is_refused_by_name),
        cmocka_unit_test(short_memory_is_a_status_and_leaks_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
