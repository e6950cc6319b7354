/* SPDX-License-Identifier: Apache-2.0 */
/* Averaging: half floats, tables, chains and logarithms, compared with long double sums. */
#include "maps_fixture.h"
#include "maps/map_channels.h"
#include "maps/map_half.h"

static void every_half_comes_back_and_rounding_is_to_nearest_even(void **state)
{
    (void)state;
    for (uint32_t h = 0; h < 0x7c00; h++) {
        const double value = umb__half_to((uint16_t)h);
        assert_int_equal(umb__half_from(value), h);
        assert_int_equal(umb__half_from(-value), h | 0x8000);
        const double next = umb__half_to((uint16_t)(h + 1));
        if (h + 1 == 0x7c00) {
            break;
        }
        const double middle = 0.5 * (value + next);
        assert_int_equal(umb__half_from(middle), h % 2 == 0 ? h : h + 1);
        assert_int_equal(umb__half_from(nextafter(middle, 0.0)), h);
        assert_int_equal(umb__half_from(nextafter(middle, INFINITY)), h + 1);
    }
    assert_int_equal(umb__half_from(65519.99), 0x7bff);
    assert_int_equal(umb__half_from(65520.0), 0x7c00);
    assert_true(isnan(umb__half_to(umb__half_from(NAN))));
    assert_true(isinf(umb__half_to(0xfc00)));
    assert_int_equal(umb__half_from(5e-324), 0);
}

static void logarithmic_means_neither_overflow_nor_lose_digits(void **state)
{
    (void)state;
    uint64_t seed = 2008;
    long double worst = 0.0L;
    for (int i = 0; i < 1000000; i++) {
        double values[4], weights[4];
        const double c = exp(random_unit(&seed) * 7.6); /* 1..2000 */
        long double sum = 0.0L, total = 0.0L;
        for (int k = 0; k < 4; k++) {
            values[k] = random_unit(&seed) * 2.0 - 1.0;
            weights[k] = random_unit(&seed) + 1e-3;
            weights[k] = k > 0 && i % 4 == k ? 0.0 : weights[k]; /* a texel's centre has these */
            total += (long double)weights[k];
        }
        for (int k = 0; k < 4; k++) {
            weights[k] = (double)((long double)weights[k] / total);
            sum += (long double)weights[k] * expl((long double)c * (long double)values[k]);
        }
        const long double exact = logl(sum) / (long double)c;
        const double got = umb__channel_mean(c, values, weights, 4);
        const long double error = fabsl((long double)got - exact);
        worst = error > worst ? error : worst;
    }
    print_message("worst error of a depth: %Lg\n", worst);
    /* exp and log within 1 ulp, sum of four within 4: 8 * 2^-53 of log(sum) / c, c >= 1. */
    assert_true(worst < 2e-15L);
    /* All weight is on the least value: values without weight must have no part, however great they
     * are. */
    for (double other = -1.0; other <= 1.0; other += 1.0 / 64.0) {
        const double values[2] = {-1.0, other}, weights[2] = {1.0, 0.0};
        assert_true(umb__channel_mean(2000.0, values, weights, 2) == -1.0);
    }
}

/* A VSM map whose texels are random depths, so that its channels are known. */
struct random_map {
    uint32_t width, height;
    float *depth;
    struct umb_map_frustum frustum;
    struct umb_map *map;
};

static struct random_map random_map_make(uint32_t width, uint32_t height,
                                         enum umb_map_access access, uint32_t blur, double least)
{
    uint64_t seed = 31 * width + height;
    struct random_map m = {.width = width, .height = height};
    m.depth = malloc((size_t)width * height * sizeof *m.depth);
    assert_non_null(m.depth);
    for (size_t i = 0; i < (size_t)width * height; i++) {
        m.depth[i] = (float)(least + (0.999 - least) * random_unit(&seed));
    }
    m.frustum = plain_frustum(width, height);
    const struct umb_map_settings settings = {
        .technique = UMB_MAP_VSM, .access = access, .blur = blur};
    m.map = map_of(&m.frustum, m.depth, &settings);
    return m;
}

static void random_map_finish(struct random_map *m)
{
    umb_map_destroy(m->map);
    free(m->depth);
}

static long double share(double low, double high, uint32_t texel)
{
    const long double a = fmaxl((long double)low, (long double)texel);
    const long double b = fminl((long double)high, (long double)texel + 1.0L);
    return b > a ? b - a : 0.0L;
}

/* The channels of map.c are reached through map_parts.h, since this test looks inside. */
static const struct umb__channels *channels_of(const struct random_map *m)
{
    return &((const struct umb_map *)m->map)->channels;
}

static void boxes_of_tables_are_exact_at_the_far_corner_of_a_large_map(void **state)
{
    (void)state;
    /* Depths near the far plane: the corner's sum is 2^20 times a texel. */
    struct random_map m = random_map_make(1024, 1024, UMB_MAP_SAT, 1, 0.95);
    uint64_t seed = 1984;
    long double worst = 0.0L;
    for (int i = 0; i < case_count(2000); i++) {
        const double width = 1.0 + 20.0 * random_unit(&seed);
        const double x = 1000.0 + 23.0 * random_unit(&seed), y = 1000.0 + 23.0 * random_unit(&seed);
        double got[2];
        umb__channels_fetch(channels_of(&m), x, y, 0.0, width, got);
        const double half = 0.5 * width;
        const double low[2] = {x - half, y - half};
        const double high[2] = {fmin(x + half, 1024.0), fmin(y + half, 1024.0)};
        long double sum[2] = {0.0L, 0.0L}, area = 0.0L;
        for (uint32_t ty = (uint32_t)low[1]; ty < 1024; ty++) {
            for (uint32_t tx = (uint32_t)low[0]; tx < 1024; tx++) {
                const long double w = share(low[0], high[0], tx) * share(low[1], high[1], ty);
                const long double d = 2.0L * (long double)m.depth[ty * 1024 + tx] - 1.0L;
                sum[0] += w * d;
                sum[1] += w * d * d;
                area += w;
            }
        }
        for (int k = 0; k < 2; k++) {
            const long double error = fabsl((long double)got[k] - sum[k] / area);
            worst = error > worst ? error : worst;
        }
    }
    print_message("worst error of a moment: %Lg\n", worst);
    /* A texel's moment is rounded to 2^-41 = 4.6e-13; doubles add 16 products. A table of floats
     * would be off by 2^20 * 2^-24 / 400. */
    assert_true(worst < 6e-13L);
    random_map_finish(&m);
}

static void blur_and_chain_average_what_they_cover(void **state)
{
    (void)state;
    struct random_map blurred = random_map_make(64, 32, UMB_MAP_BASE, 5, 0.0);
    for (uint32_t y = 2; y < 30; y++) {
        for (uint32_t x = 2; x < 62; x++) {
            long double sum = 0.0L;
            for (uint32_t k = 0; k < 25; k++) {
                sum +=
                    2.0L * (long double)blurred.depth[(y + k / 5 - 2) * 64 + x + k % 5 - 2] - 1.0L;
            }
            double got[2];
            umb__channels_fetch(channels_of(&blurred), x + 0.5, y + 0.5, 0.0, 1.0, got);
            assert_true(fabsl((long double)got[0] - sum / 25.0L) < 0x1p-24L);
        }
    }
    random_map_finish(&blurred);
    struct random_map chain = random_map_make(64, 32, UMB_MAP_MIPS, 1, 0.0);
    long double all = 0.0L;
    for (size_t i = 0; i < 64 * 32; i++) {
        all += 2.0L * (long double)chain.depth[i] - 1.0L;
    }
    double got[2];
    umb__channels_fetch(channels_of(&chain), 11.0, 3.0, 9.0, 1.0, got);
    assert_true(fabsl((long double)got[0] - all / 2048.0L) < 0x1p-24L);
    /* Level 1 at a texel's centre: the four below it. */
    umb__channels_fetch(channels_of(&chain), 7.0, 5.0, 1.0, 1.0, got);
    long double four = 0.0L;
    for (uint32_t k = 0; k < 4; k++) {
        four += 2.0L * (long double)chain.depth[(4 + k / 2) * 64 + 6 + k % 2] - 1.0L;
    }
    assert_true(fabsl((long double)got[0] - four / 4.0L) < 0x1p-24L);
    random_map_finish(&chain);
}

static void chains_refuse_sides_that_do_not_halve(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(6, 8);
    float depth[48] = {0};
    const struct umb_map_layer layer = {.depth = depth};
    struct umb_map *map;
    const struct umb_map_settings settings = {.technique = UMB_MAP_VSM, .access = UMB_MAP_MIPS};
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, NULL), UMB_E_ARGUMENT);
}

/* A texel of several samples must hold the mean of their channels: the first two Chebyshev moments
 * here, and the logarithm of the mean exponential. */
static void samples_of_a_texel_are_averaged_as_channels(void **state)
{
    (void)state;
    enum {
        TEXELS = 6,
        SAMPLES = 4
    };
    static const float depths[TEXELS * SAMPLES] = {0.1F, 0.1F, 0.1F, 0.1F, 0.2F, 0.9F, 0.2F, 0.9F,
                                                   1.0F, 1.0F, 0.3F, 1.0F, 0.5F, 0.6F, 0.7F, 0.8F,
                                                   0.0F, 1.0F, 0.0F, 1.0F, 0.4F, 0.4F, 0.4F, 0.8F};
    const struct umb_map_frustum frustum = plain_frustum(3, 2);
    const struct umb_map_layer layer = {.depth = depths, .samples = SAMPLES};
    for (int esm = 0; esm < 2; esm++) {
        const struct umb_map_settings settings = {.technique = esm ? UMB_MAP_ESM : UMB_MAP_MSM,
                                                  .exponent = esm ? 40 : 0};
        struct umb_map *map;
        struct umb_map_level level;
        assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, NULL), UMB_OK);
        assert_int_equal(umb_map_get_level(map, 0, &level), UMB_OK);
        const float *texels = level.texels;
        for (int i = 0; i < TEXELS; i++) {
            long double first = 0, second = 0, exponential = 0;
            for (int s = 0; s < SAMPLES; s++) {
                const long double z = (long double)depths[i * SAMPLES + s], d = 2 * z - 1;
                first += d / SAMPLES;
                second += (2 * d * d - 1) / SAMPLES;
                exponential += expl(40 * z) / SAMPLES;
            }
            if (esm) {
                assert_true(fabsl((long double)texels[i] - logl(exponential) / 40) < 1e-7L);
            } else {
                assert_true(fabsl((long double)texels[4 * i] - first) < 1e-7L);
                assert_true(fabsl((long double)texels[4 * i + 1] - second) < 1e-7L);
            }
        }
        umb_map_destroy(map);
    }
    struct umb_map *map;
    struct umb_error error;
    const struct umb_map_settings one = {0}, plane = {.technique = UMB_MAP_VSM, .depth_plane = 1};
    assert_int_equal(umb_map_build(&frustum, &layer, &one, NULL, &map, &error), UMB_E_UNSUPPORTED);
    assert_non_null(strstr(error.message, "layer.samples is 4"));
    assert_int_equal(umb_map_build(&frustum, &layer, &plane, NULL, &map, &error),
                     UMB_E_UNSUPPORTED);
    const struct umb_map_layer many = {.depth = depths, .samples = 17};
    assert_int_equal(umb_map_build(&frustum, &many, &one, NULL, &map, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "layer.samples is 17; it must be 1..16"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_half_comes_back_and_rounding_is_to_nearest_even),
        cmocka_unit_test(logarithmic_means_neither_overflow_nor_lose_digits),
        cmocka_unit_test(boxes_of_tables_are_exact_at_the_far_corner_of_a_large_map),
        cmocka_unit_test(blur_and_chain_average_what_they_cover),
        cmocka_unit_test(chains_refuse_sides_that_do_not_halve),
        cmocka_unit_test(samples_of_a_texel_are_averaged_as_channels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
