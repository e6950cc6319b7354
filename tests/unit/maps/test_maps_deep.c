/* SPDX-License-Identifier: Apache-2.0 */
/* Deep shadow maps, compared with brute force: products in long double, and windows searched texel
 * by texel. */
#include "maps_fixture.h"
#include "maps/deep_parts.h"

enum {
    W = 83,
    H = 47,
    MOST = 96, /* lists end where nothing is left, after 21 or so: 18 on average */
    POINTS = 60000
};

static struct umb_map_fragment fragments[W * H * MOST];
static uint64_t first[W * H + 1];
static double at[POINTS][3];
static float values[POINTS], others[POINTS];

/* Makes strands: lists of 0 to `most` fragments in random order, some at equal depths, with similar
 * depths in neighbouring texels. */
static struct umb_map_fragments strands(uint64_t seed, int most, int opaque)
{
    uint64_t used = 0;
    seed = round_seed(seed);
    for (int i = 0; i < W * H; i++) {
        const int count = (int)(random_unit(&seed) * (most + 1));
        first[i] = used;
        for (int k = 0; k < count; k++) {
            const double near = (double)k / most + 0.02 * sin(0.2 * i) + 0.01 * random_unit(&seed);
            const int slot = (int)(random_unit(&seed) * (double)(used - first[i] + 1));
            fragments[used] = fragments[first[i] + (uint64_t)slot];
            fragments[first[i] + (uint64_t)slot] = (struct umb_map_fragment){
                (float)(floor(fmin(fmax(near, 0.0), 1.0) * 500.0) / 500.0),
                opaque ? 1.0F : (float)random_unit(&seed)};
            used++;
        }
    }
    first[W * H] = used;
    for (int i = 0; i < POINTS; i++) {
        at[i][0] = random_unit(&seed) * W;
        at[i][1] = random_unit(&seed) * H;
        at[i][2] = random_unit(&seed) < 0.3 ? floor(random_unit(&seed) * 500.0) / 500.0
                                            : random_unit(&seed) + 1e-6;
    }
    return (struct umb_map_fragments){first, fragments};
}

static struct umb_map *deep_of(const struct umb_map_fragments *in,
                               const struct umb_map_deep_settings *settings)
{
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    struct umb_map *map = NULL;
    struct umb_error error = {.message = ""};
    if (umb_map_build_deep(&frustum, in, settings, NULL, &map, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return map;
}

static void ask_deep(const struct umb_map *map, double taps, float *out)
{
    const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = taps});
    ask(&query, (const double(*)[3])at, POINTS, out);
}

/* Computes the product over a texel's fragments before a depth, in any order, exact to long
 * double. */
static long double brute_texel(int64_t x, int64_t y, double depth)
{
    long double left = 1.0L;
    if (x < 0 || y < 0 || x >= W || y >= H) {
        return left;
    }
    for (uint64_t i = first[y * W + x]; i < first[y * W + x + 1]; i++) {
        if ((double)fragments[i].depth < depth) {
            left *= 1.0L - (long double)fragments[i].alpha;
        }
    }
    return left;
}

static long double brute(const double p[3], int taps)
{
    long double sum = 0.0L;
    const double depth = 0.01 * (100.0 * p[2]);
    if (!(depth > 0.0)) {
        return 1.0L;
    }
    for (int64_t k = 0; k < taps * taps; k++) {
        sum += brute_texel((int64_t)floor(p[0]) - taps / 2 + k % taps,
                           (int64_t)floor(p[1]) - taps / 2 + k / taps, depth);
    }
    return sum / (taps * taps);
}

/* Tests all ways, and what they store. Answers are off by at most half of 2^-30 a node, and are
 * rounded to floats. */
static void transmittance_equals_the_product_whatever_the_way(void **state)
{
    (void)state;
    static const int node_bytes[] = {0, 8, 16, 8};
    const struct umb_map_fragments in = strands(2000, MOST, 0);
    uint64_t searched_bytes = 0;
    for (int way = UMB_MAP_DEEP_SEARCH; way <= UMB_MAP_DEEP_STREAM; way++) {
        struct umb_map *map =
            deep_of(&in, &(struct umb_map_deep_settings){.way = (enum umb_map_deep_way)way});
        struct umb_map_info info;
        umb_map_get_info(map, &info);
        searched_bytes = way == UMB_MAP_DEEP_SEARCH ? info.bytes : searched_bytes;
        assert_true(info.bytes ==
                    searched_bytes + (uint64_t)(node_bytes[way] - 8) * info.fragments);
        for (int taps = 1; taps <= 7; taps += 2) {
            static float first_way[4][POINTS];
            ask_deep(map, taps, values);
            if (way == UMB_MAP_DEEP_SEARCH) {
                memcpy(first_way[taps / 2], values, sizeof values);
            }
            assert_memory_equal(values, first_way[taps / 2], sizeof values);
            for (int i = 0; i < POINTS && way == UMB_MAP_DEEP_STREAM; i++) {
                const long double error = fabsl((long double)values[i] - brute(at[i], taps));
                assert_true(error < 0x1p-31L + 0x1p-25L + 1e-12L);
            }
        }
        umb_map_destroy(map);
    }
}

static void the_way_follows_the_length_of_lists(void **state)
{
    (void)state;
    /* Thin strands leave light behind all of them, so no list ends early, and lists have half of
     * `most` nodes on average. */
    static const struct {
        int most, thin;
        double exponent;
        uint64_t node_bytes;
    } cases[] = {
        {6, 0, 0.0, 8}, {MOST, 0, 0.0, 8}, {60, 1, 0.0, 8}, {MOST, 1, 0.0, 16}, {6, 0, 5.0, 16}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct umb_map_fragments in = strands(77, cases[i].most, 0);
        for (uint64_t k = 0; k < first[W * H] && cases[i].thin; k++) {
            fragments[k].alpha = 0.01F;
        }
        struct umb_map *map =
            deep_of(&in, &(struct umb_map_deep_settings){.exponent = cases[i].exponent});
        struct umb_map_info info;
        umb_map_get_info(map, &info);
        assert_true(info.bytes ==
                    (W * H + 1) * sizeof(uint64_t) + cases[i].node_bytes * info.fragments);
        umb_map_destroy(map);
    }
    const struct umb_map_fragments in = strands(77, 6, 0);
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    static const struct umb_map_deep_settings bad[] = {
        {.way = UMB_MAP_DEEP_STREAM, .exponent = 1.0}, {.way = (enum umb_map_deep_way)4}};
    for (size_t i = 0; i < 2; i++) {
        struct umb_map *map;
        struct umb_error error;
        assert_int_equal(umb_map_build_deep(&frustum, &in, &bad[i], NULL, &map, &error),
                         UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "settings.way"));
    }
}

static void opaque_fragments_give_exactly_the_binary_answer(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(1978, 6, 1);
    static float nearest[W * H];
    for (int i = 0; i < W * H; i++) {
        nearest[i] = 1.0F;
        for (uint64_t k = first[i]; k < first[i + 1]; k++) {
            nearest[i] = fminf(nearest[i], fragments[k].depth);
        }
        if (nearest[i] == 1.0F && first[i] < first[i + 1]) {
            nearest[i] = nextafterf(1.0F, 0.0F); /* a caster at the very end is no empty texel */
        }
    }
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    struct umb_map *binary = map_of(&frustum, nearest, &(struct umb_map_settings){0});
    for (int way = UMB_MAP_DEEP_SEARCH; way <= UMB_MAP_DEEP_STREAM; way++) {
        const struct umb_map_deep_settings settings = {.way = (enum umb_map_deep_way)way,
                                                       .epsilon = 0.001};
        struct umb_map *deep = deep_of(&in, &settings);
        for (int taps = 1; taps <= 9; taps += 4) {
            ask_deep(binary, taps, values);
            ask_deep(deep, taps, others);
            assert_memory_equal(values, others, sizeof values);
        }
        umb_map_destroy(deep);
    }
    umb_map_destroy(binary);
}

static void truncation_costs_less_than_epsilon_and_saves_nodes(void **state)
{
    (void)state;
    const struct umb_map_fragments in = strands(2014, MOST, 0);
    struct umb_map *full = deep_of(&in, &(struct umb_map_deep_settings){.way = UMB_MAP_DEEP_LINKS});
    ask_deep(full, 5, values);
    struct umb_map_info info;
    umb_map_get_info(full, &info);
    uint64_t before = info.fragments;
    for (double epsilon = 1e-4; epsilon < 0.2; epsilon *= 10.0) {
        struct umb_map *map = deep_of(
            &in, &(struct umb_map_deep_settings){.way = UMB_MAP_DEEP_LINKS, .epsilon = epsilon});
        ask_deep(map, 5, others);
        umb_map_get_info(map, &info);
        for (int i = 0; i < POINTS; i++) {
            /* Answers must not be darker, and may be lighter by less than the light that was
             * left. */
            assert_true(others[i] >= values[i] && (double)(others[i] - values[i]) < info.slack);
        }
        print_message("epsilon %g keeps %llu nodes\n", epsilon, (unsigned long long)info.fragments);
        assert_true(info.fragments < before);
        before = info.fragments;
        umb_map_destroy(map);
    }
    umb_map_destroy(full);
}

static void products_underflow_to_darkness_and_equal_depths_are_one_step(void **state)
{
    (void)state;
    struct umb_map_fragment many[2000];
    for (int i = 0; i < 2000; i++) {
        many[i] = (struct umb_map_fragment){0.5F, 0.9F}; /* all at one depth: 10^-2000 */
    }
    const uint64_t ends[2] = {0, 2000};
    const struct umb_map_fragments in = {ends, many};
    const struct umb_map_frustum frustum = plain_frustum(1, 1);
    struct umb_map *map;
    const struct umb_map_deep_settings settings = {.way = UMB_MAP_DEEP_LINKS};
    assert_int_equal(umb_map_build_deep(&frustum, &in, &settings, NULL, &map, NULL), UMB_OK);
    struct umb_map_info info;
    umb_map_get_info(map, &info);
    assert_true(info.fragments == 1);
    const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 1});
    assert_true(ask_one(&query, 0.5, 0.5, 0.5) == 1.0); /* at the depth itself: lit */
    assert_true(ask_one(&query, 0.5, 0.5, 0.51) == 0.0);
    umb_map_destroy(map);
}

static void an_exponent_fades_the_last_step_in(void **state)
{
    (void)state;
    const struct umb_map_fragment two[2] = {{0.25F, 0.5F}, {0.5F, 0.5F}};
    const uint64_t ends[2] = {0, 2};
    const struct umb_map_fragments in = {ends, two};
    const struct umb_map_frustum frustum = plain_frustum(1, 1);
    const struct umb_map_deep_settings settings = {.way = UMB_MAP_DEEP_LINKS, .exponent = 40};
    struct umb_map *map;
    assert_int_equal(umb_map_build_deep(&frustum, &in, &settings, NULL, &map, NULL), UMB_OK);
    const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 1});
    for (double t = 0.01; t < 1.0; t += 0.01) {
        const double z = 0.01 * (100.0 * t);
        const double expected = z <= 0.25  ? 1.0
                                : z <= 0.5 ? 0.5 + 0.5 * exp(-40.0 * (z - 0.25))
                                           : 0.25 + 0.25 * exp(-40.0 * (z - 0.5));
        assert_true(fabs(ask_one(&query, 0.5, 0.5, t) - expected) < 1e-7);
    }
    umb_map_destroy(map);
}

static void walking_ends_where_searching_does_from_any_guess(void **state)
{
    (void)state;
    uint64_t seed = 11;
    struct umb__deep_node nodes[30];
    for (int round = 0; round < case_count(2000); round++) {
        const uint32_t count = (uint32_t)(random_unit(&seed) * 31.0);
        double depth = 0.0;
        for (uint32_t i = 0; i < count; i++) {
            depth += 0.01 + random_unit(&seed) * 0.02;
            nodes[i].depth = (float)depth;
        }
        const double t = random_unit(&seed) < 0.3 && count > 0 ? (double)nodes[count / 2].depth
                                                               : random_unit(&seed);
        uint32_t expected = 0;
        while (expected < count && (double)nodes[expected].depth < t) {
            expected++;
        }
        const struct umb__deep_list list = {(const uint8_t *)nodes, sizeof nodes[0], count};
        assert_int_equal(umb__deep_search(&list, t), expected);
        for (uint32_t guess = 0; guess <= count; guess++) {
            assert_int_equal(umb__deep_walk(&list, guess, t), expected);
        }
    }
}

static void fragments_from_strangers_are_refused_by_name(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(2, 1);
    struct umb_map_fragment list[3] = {{0.1F, 0.5F}, {0.2F, 0.5F}, {0.3F, 0.5F}};
    uint64_t ends[3] = {0, 2, 3};
    const struct umb_map_fragments in = {ends, list};
    struct umb_map_deep_settings settings = {.way = UMB_MAP_DEEP_LINKS};
    struct umb_map *map;
    struct umb_error error;
    static const float bad[] = {NAN, INFINITY, -0.1F, 1.1F};
    for (int i = 0; i < 8; i++) {
        *(i % 2 ? &list[1].alpha : &list[1].depth) = bad[i / 2];
        assert_int_equal(umb_map_build_deep(&frustum, &in, &settings, NULL, &map, &error),
                         UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "fragments[1]"));
        list[1] = (struct umb_map_fragment){0.2F, 0.5F};
    }
    ends[1] = 4;
    assert_int_equal(umb_map_build_deep(&frustum, &in, &settings, NULL, &map, &error),
                     UMB_E_ARGUMENT);
    ends[1] = 2;
    settings.epsilon = NAN;
    assert_int_equal(umb_map_build_deep(&frustum, &in, &settings, NULL, &map, &error),
                     UMB_E_ARGUMENT);
    assert_null(map);
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
    const struct umb_map_fragments in = strands(5, 8, 0);
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    const struct umb_map_deep_settings settings = {.way = UMB_MAP_DEEP_LINKS};
    int ok = 0;
    for (int n = 0; n < 9; n++) {
        struct failing failing = {.fail_at = n};
        const struct umb_alloc alloc = {failing_resize, &failing};
        struct umb_map *map;
        const enum umb_status status =
            umb_map_build_deep(&frustum, &in, &settings, &alloc, &map, NULL);
        assert_true(status == UMB_OK || status == UMB_E_NO_MEMORY);
        ok += status == UMB_OK;
        umb_map_destroy(map);
        assert_int_equal(failing.out, 0);
    }
    assert_true(ok >= 2 && ok < 9); /* shrinking may fail without harm */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transmittance_equals_the_product_whatever_the_way),
        cmocka_unit_test(the_way_follows_the_length_of_lists),
        cmocka_unit_test(opaque_fragments_give_exactly_the_binary_answer),
        cmocka_unit_test(truncation_costs_less_than_epsilon_and_saves_nodes),
        cmocka_unit_test(products_underflow_to_darkness_and_equal_depths_are_one_step),
        cmocka_unit_test(an_exponent_fades_the_last_step_in),
        cmocka_unit_test(walking_ends_where_searching_does_from_any_guess),
        cmocka_unit_test(fragments_from_strangers_are_refused_by_name),
        cmocka_unit_test(short_memory_is_a_status_and_leaks_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
