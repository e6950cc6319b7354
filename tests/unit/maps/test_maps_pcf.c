/* SPDX-License-Identifier: Apache-2.0 */
/* Shadow maps, their biases and kernels, and penumbras: compared with plain loops and with
 * geometry. */
#include "maps_fixture.h"
#include "maps/map_parts.h"

enum {
    W = 97,
    H = 61,
    POINTS = 100000
};

static float layer[H][W];
static double at[POINTS][3];
static float values[POINTS];

/* Patches at a few depths, some texels empty; points a tenth beyond each border. */
static uint64_t scatter(uint64_t seed)
{
    seed = round_seed(seed);
    for (int y = 0; y < H; y++) {
        for (int x = 0; x < W; x++) {
            const double r = random_unit(&seed);
            layer[y][x] = r < 0.2 ? 1.0F : (float)(random_unit(&seed) * 0.9);
        }
    }
    for (size_t i = 0; i < POINTS; i++) {
        at[i][0] = (random_unit(&seed) * 1.2 - 0.1) * W;
        at[i][1] = (random_unit(&seed) * 1.2 - 0.1) * H;
        at[i][2] = random_unit(&seed) * 1.2 - 0.1;
    }
    return seed;
}

/* Computes a texel as the header defines it, stored with 1/(2^bits - 1) steps (0: not rounded). */
static int plain_texel(int64_t x, int64_t y, double depth, int bits)
{
    if (x < 0 || y < 0 || x >= W || y >= H || layer[y][x] == 1.0F) {
        return 1;
    }
    double stored = (double)layer[y][x];
    if (bits > 0) {
        const double top = ldexp(1.0, bits) - 1.0;
        stored = fmin(floor(stored * top + 0.5), top - 1.0) / top;
    }
    return stored >= depth;
}

static int inside(const double p[3])
{
    return p[0] >= 0 && p[0] < W && p[1] >= 0 && p[1] < H && p[2] > 0;
}

static void boxes_count_the_texels_that_plain_loops_count(void **state)
{
    static const struct {
        enum umb_map_format format;
        int bits;
    } formats[] = {{UMB_MAP_F32, 0}, {UMB_MAP_U24, 24}, {UMB_MAP_U16, 16}};
    (void)state;
    (void)scatter(19780823);
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    for (size_t f = 0; f < 3; f++) {
        const struct umb_map_settings settings = {.format = formats[f].format};
        struct umb_map *map = map_of(&frustum, &layer[0][0], &settings);
        for (int taps = 1; taps <= 9; taps += 4) {
            const struct umb_map_query query =
                query_of(map, &(struct umb_map_filter){.width = taps});
            ask(&query, (const double(*)[3])at, POINTS, values);
            for (size_t i = 0; i < POINTS; i++) {
                /* The same product as the fixture's matrix makes. */
                const double depth = 0.01 * (100.0 * at[i][2]);
                int lit = 0;
                for (int64_t k = 0; k < taps * taps; k++) {
                    lit += plain_texel((int64_t)floor(at[i][0]) - taps / 2 + k % taps,
                                       (int64_t)floor(at[i][1]) - taps / 2 + k / taps, depth,
                                       formats[f].bits);
                }
                const float expected =
                    inside(at[i]) ? (float)((double)lit / (double)(taps * taps)) : 1.0F;
                if (values[i] != expected) {
                    fail_msg("format %d taps %d point %zu: %g, not %g", (int)formats[f].format,
                             taps, i, (double)values[i], (double)expected);
                }
            }
        }
        umb_map_destroy(map);
    }
}

/* A plane z = z0 + a x + b y, rendered at texel centres, and queried at its own points. */
struct slope_case {
    double z0, a, b;
    struct umb_map_filter filter;
};

static double plane_lit_share(const struct slope_case *c, uint64_t *seed)
{
    enum {
        COUNT = 2000
    };
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    for (int y = 0; y < H; y++) {
        for (int x = 0; x < W; x++) {
            layer[y][x] = (float)(0.01 * (c->z0 + c->a * (x + 0.5) + c->b * (y + 0.5)));
        }
    }
    static float normals[COUNT][3];
    static double world[COUNT][3];
    const double length = sqrt(c->a * c->a + c->b * c->b + 1.0);
    for (size_t i = 0; i < COUNT; i++) {
        world[i][0] = 12.0 + random_unit(seed) * (W - 24);
        world[i][1] = 12.0 + random_unit(seed) * (H - 24);
        world[i][2] = c->z0 + c->a * world[i][0] + c->b * world[i][1];
        normals[i][0] = (float)(c->a / length);
        normals[i][1] = (float)(c->b / length);
        normals[i][2] = (float)(-1.0 / length);
    }
    struct umb_map *map =
        map_of(&frustum, &layer[0][0], &(struct umb_map_settings){.format = UMB_MAP_F32});
    const struct umb_map_query query = query_of(map, &c->filter);
    const struct umb_points points = {
        .positions = world, .format = UMB_POINT_F64, .normals = normals, .count = COUNT};
    umb_map_run(&query, &points, 0, COUNT, values);
    umb_map_destroy(map);
    double sum = 0.0;
    for (size_t i = 0; i < COUNT; i++) {
        sum += (double)values[i];
    }
    return sum / COUNT;
}

static void slope_and_normal_bias_of_1_leave_no_acne_on_planes(void **state)
{
    (void)state;
    uint64_t seed = 1987;
    for (int i = 0; i < 40; i++) {
        struct slope_case c = {.z0 = 45.0};
        c.a = (random_unit(&seed) - 0.5) * 0.6;
        c.b = (random_unit(&seed) - 0.5) * 0.6;
        c.filter.width = 1.0 + 2.0 * floor(random_unit(&seed) * 5.0);
        /* Without: half of a single texel's answers are wrong. */
        assert_true(plane_lit_share(&c, &seed) < 0.9);
        c.filter.bias_m = 1e-4; /* rounding of layer and normal: 100 m * 2^-24 and a little */
        c.filter.bias_slope = 1.0;
        const double by_slope = plane_lit_share(&c, &seed);
        c.filter.bias_slope = 0.0;
        c.filter.bias_normal = 1.0;
        const double by_normal = plane_lit_share(&c, &seed);
        if (by_slope != 1.0 || by_normal != 1.0) {
            fail_msg("plane %g %g, width %g: %g lit by slope, %g by normal", c.a, c.b,
                     c.filter.width, by_slope, by_normal);
        }
    }
}

static void constant_bias_of_16_bit_depth_must_exceed_half_a_step(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(1, 1);
    const float depth = (float)(0.9 / 65535.0 + 0.5); /* stored below itself */
    struct umb_map *map =
        map_of(&frustum, &depth, &(struct umb_map_settings){.format = UMB_MAP_U16});
    struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 1});
    assert_true(ask_one(&query, 0.5, 0.5, (double)depth) == 0.0);
    query = query_of(map, &(struct umb_map_filter){.width = 1, .bias_m = 100.0 * 0.5 / 65535.0});
    assert_true(ask_one(&query, 0.5, 0.5, (double)depth) == 1.0);
    umb_map_destroy(map);
}

static void poisson_points_keep_apart_within_the_disc(void **state)
{
    (void)state;
    double points[UMB_MAP_SAMPLES_MAX][2], fewer[16][2];
    umb__poisson_disc(points, UMB_MAP_SAMPLES_MAX);
    umb__poisson_disc(fewer, 16);
    assert_memory_equal(points, fewer, sizeof fewer);
    for (size_t i = 0; i < UMB_MAP_SAMPLES_MAX; i++) {
        assert_true(hypot(points[i][0], points[i][1]) <= 1.0);
        for (size_t k = 0; k < i; k++) {
            const double apart = hypot(points[i][0] - points[k][0], points[i][1] - points[k][1]);
            /* 64 discs that fill the unit disc best have centres about 0.23 apart. */
            assert_true(apart > 0.10);
        }
    }
}

static void poisson_kernel_approaches_the_share_of_the_disc(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    for (int y = 0; y < H; y++) {
        for (int x = 0; x < W; x++) {
            layer[y][x] = x < W / 2 ? 0.25F : 1.0F; /* an edge at x = 48 */
        }
    }
    struct umb_map *map = map_of(&frustum, &layer[0][0], &(struct umb_map_settings){0});
    const struct umb_map_filter filter = {
        .kernel = UMB_MAP_POISSON, .width = 17, .samples = UMB_MAP_SAMPLES_MAX};
    const struct umb_map_query query = query_of(map, &filter);
    for (double x = 36.0; x <= 60.0; x += 0.5) {
        const double d = fmin(fmax((x - 48.0) / 8.5, -1.0), 1.0);
        /* Share of a disc beyond a chord at -d. */
        const double share = 0.5 + (d * sqrt(1.0 - d * d) + asin(d)) / 3.14159265358979;
        /* 64 points: one of them is 1/64; texels add half a texel of 17. */
        assert_true(fabs(ask_one(&query, x, 30.0, 0.5) - share) < 0.08);
    }
    umb_map_destroy(map);
}

/* An edge at x = 48 at depth 0.2; light of angular diameter such that the penumbra is 2 tan(a/2)
 * (0.6 - 0.2) 100 m = 16 texels wide at depth 0.6, and the answer across it is linear. */
static void penumbra_of_an_edge_is_linear_and_as_wide_as_geometry_says(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    for (int y = 0; y < H; y++) {
        for (int x = 0; x < W; x++) {
            layer[y][x] = x < 48 ? 0.2F : 1.0F;
        }
    }
    struct umb_map *map = map_of(&frustum, &layer[0][0], &(struct umb_map_settings){0});
    struct umb_map_filter filter = {.width = 40, .light_size = 2.0 * atan(16.0 / 80.0)};
    struct umb_map_query query = query_of(map, &filter);
    for (double x = 36.0; x <= 60.0; x += 0.125) {
        const double expected = fmin(fmax((x - 40.0) / 16.0, 0.0), 1.0);
        /* float(0.2) is off by 3e-9: 40 m of it make a penumbra off by 1e-7. */
        assert_true(fabs(ask_one(&query, x, 30.0, 0.6) - expected) < 1e-6);
    }
    /* Contact hardens: ten times nearer, ten times narrower. */
    for (double x = 46.0; x <= 50.0; x += 0.125) {
        const double expected = fmin(fmax((x - 47.2) / 1.6, 0.0), 1.0);
        assert_true(fabs(ask_one(&query, x, 30.0, 0.24) - expected) < 1e-5);
    }
    /* Where nothing blocks, lit; far inside, dark. */
    assert_true(ask_one(&query, 90.0, 30.0, 0.6) == 1.0);
    assert_true(ask_one(&query, 20.0, 30.0, 0.6) == 0.0);
    umb_map_destroy(map);
}

/* A spot light 10 m above a plane, a blocker half way: similar triangles give size * 1. */
static void penumbra_of_a_spot_light_follows_similar_triangles(void **state)
{
    (void)state;
    enum {
        SIDE = 256
    };
    static float depths[SIDE][SIDE];
    const struct umb_map_spot spot = {.position = {3, 4, 10},
                                      .forward = {0, 0, -2},
                                      .up = {0, 1, 0},
                                      .tangent = 0.5,
                                      .near_m = 1,
                                      .far_m = 11,
                                      .projection = UMB_MAP_PERSPECTIVE};
    struct umb_map_frustum frustum;
    assert_int_equal(umb_map_frustum_spot(&spot, SIDE, SIDE, &frustum, NULL), UMB_OK);
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++) {
            double world[3];
            assert_int_equal(umb_map_frustum_point(&frustum, x + 0.5, y + 0.5, 0.4, world), UMB_OK);
            assert_true(fabs(world[2] - 5.0) < 1e-9); /* near + 0.4 * 10 m below the light */
            depths[y][x] = world[0] < 3.0 ? 0.4F : 1.0F;
        }
    }
    struct umb_map *map = map_of(&frustum, &depths[0][0], &(struct umb_map_settings){0});
    const struct umb_map_query query =
        query_of(map, &(struct umb_map_filter){.width = 64, .light_size = 1.0});
    /* On the plane z = 0: 1 m wide about x = 3. A texel is 10/256 m there. */
    for (double x = 2.0; x <= 4.0; x += 0.05) {
        const double world[3] = {x, 4.3, 0.0};
        const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = 1};
        umb_map_run(&query, &points, 0, 1, values);
        const double expected = fmin(fmax(x - 2.5, 0.0), 1.0);
        assert_true(fabs((double)values[0] - expected) < 0.04);
    }
    umb_map_destroy(map);
}

/* Computes the share of a box of real width that lies over lit texels, by plain loops over small
 * squares. */
static double box_share(double x, double y, double width, double depth)
{
    enum {
        STEPS = 64
    };
    int lit = 0;
    for (int i = 0; i < STEPS * STEPS; i++) {
        const double u = x + width * ((i % STEPS + 0.5) / STEPS - 0.5);
        const double v = y + width * ((i / STEPS + 0.5) / STEPS - 0.5);
        lit += plain_texel((int64_t)floor(u), (int64_t)floor(v), depth, 0);
    }
    return (double)lit / (STEPS * STEPS);
}

static void bilinear_boxes_weigh_texels_by_their_share(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    uint64_t seed = scatter(22);
    struct umb_map *map = map_of(&frustum, &layer[0][0], &(struct umb_map_settings){0});
    static const double widths[] = {1.0, 2.0, 2.75, 9.0};
    for (int i = 0; i < 400; i++) {
        const double width = widths[i % 4];
        const double x = 6.0 + random_unit(&seed) * (W - 12),
                     y = 6.0 + random_unit(&seed) * (H - 12);
        const double depth = 0.05 + 0.9 * random_unit(&seed);
        const struct umb_map_query query =
            query_of(map, &(struct umb_map_filter){.kernel = UMB_MAP_BILINEAR, .width = width});
        /* A border that crosses the squares is off by half of one on each side and axis. */
        assert_true(fabs(ask_one(&query, x, y, depth) - box_share(x, y, width, depth)) <
                    4.0 / 64.0);
    }
    /* Width 1 is the 2 x 2 comparison of graphics hardware: weights of bilinear interpolation. */
    const struct umb_map_query query =
        query_of(map, &(struct umb_map_filter){.kernel = UMB_MAP_BILINEAR});
    for (int i = 0; i < 2000; i++) {
        const double x = 2.0 + random_unit(&seed) * (W - 4), y = 2.0 + random_unit(&seed) * (H - 4);
        const double depth = 0.05 + 0.9 * random_unit(&seed);
        const int64_t x0 = (int64_t)floor(x - 0.5), y0 = (int64_t)floor(y - 0.5);
        const double fx = x - 0.5 - (double)x0, fy = y - 0.5 - (double)y0;
        const double expected = (1 - fy) * ((1 - fx) * plain_texel(x0, y0, depth, 0) +
                                            fx * plain_texel(x0 + 1, y0, depth, 0)) +
                                fy * ((1 - fx) * plain_texel(x0, y0 + 1, depth, 0) +
                                      fx * plain_texel(x0 + 1, y0 + 1, depth, 0));
        assert_true(fabs(ask_one(&query, x, y, depth) - expected) < 1e-6);
    }
    umb_map_destroy(map);
    map = map_of(&frustum, &layer[0][0], &(struct umb_map_settings){.technique = UMB_MAP_VSM});
    struct umb_map_query refused;
    assert_int_equal(
        umb_map_prepare(map, &(struct umb_map_filter){.kernel = UMB_MAP_BILINEAR}, &refused, NULL),
        UMB_E_UNSUPPORTED);
    umb_map_destroy(map);
}

/* Computes the penumbra's width in texels at a point of map space without normals: the mean depth
 * of the blockers under the widest window, then similar triangles. */
static double penumbra_of(double x, double y, double depth, double light, double nearest)
{
    const double spread = 2.0 * tan(0.5 * light) * 100.0; /* texels are metres, depth is 100 m */
    const double widest = fmin(fmax(spread * (depth - nearest), 1.0), 64.0);
    double sum = 0.0;
    int count = 0;
    for (int ty = 0; ty < H; ty++) {
        for (int tx = 0; tx < W; tx++) {
            const int under = tx + 1 > x - 0.5 * widest && tx < x + 0.5 * widest &&
                              ty + 1 > y - 0.5 * widest && ty < y + 0.5 * widest;
            if (under && layer[ty][tx] < 1.0F && (double)layer[ty][tx] < depth) {
                sum += (double)layer[ty][tx];
                count++;
            }
        }
    }
    return count > 0 ? fmin(fmax(spread * (depth - sum / count), 1.0), 64.0) : 0.0;
}

/* A filtered map with its depths must answer with the window that the penumbra spans. */
static void filtered_maps_ask_the_window_of_the_penumbra(void **state)
{
    (void)state;
    static const struct umb_map_settings cases[] = {
        {.technique = UMB_MAP_VSM, .access = UMB_MAP_SAT},
        {.technique = UMB_MAP_MSM, .access = UMB_MAP_SAT},
        {.technique = UMB_MAP_LVSM, .access = UMB_MAP_SAT, .terms = 3},
        {.technique = UMB_MAP_CONVOLUTION, .access = UMB_MAP_SAT, .terms = 4},
        {.technique = UMB_MAP_ESM, .access = UMB_MAP_MIPS, .exponent = 60},
        {.technique = UMB_MAP_EVSM, .access = UMB_MAP_MIPS, .exponent = 20},
    };
    const double light = 2.0 * atan(0.1);
    uint64_t seed = scatter(57);
    double nearest = 1.0;
    for (int i = 0; i < W * H; i++) {
        nearest = fmin(nearest, (double)layer[i / W][i % W]);
    }
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        const struct umb_map_frustum frustum = plain_frustum(
            cases[c].access == UMB_MAP_MIPS ? 64 : W, cases[c].access == UMB_MAP_MIPS ? 32 : H);
        static float small[32][64];
        for (int i = 0; i < 64 * 32; i++) {
            small[i / 64][i % 64] = 0.2F + 0.1F * (float)(i % 7);
        }
        const float *depths = cases[c].access == UMB_MAP_MIPS ? &small[0][0] : &layer[0][0];
        struct umb_map_settings settings = cases[c];
        struct umb_map *plain = map_of(&frustum, depths, &settings);
        settings.keep_depth = 1;
        struct umb_map *map = map_of(&frustum, depths, &settings);
        struct umb_map_info infos[2];
        umb_map_get_info(plain, &infos[0]);
        umb_map_get_info(map, &infos[1]);
        assert_true(infos[1].bytes == infos[0].bytes + 4ULL * frustum.width * frustum.height);
        const struct umb_map_query soft =
            query_of(map, &(struct umb_map_filter){.width = 64, .light_size = light});
        for (int i = 0; i < 200; i++) {
            const double x = random_unit(&seed) * frustum.width;
            const double y = random_unit(&seed) * frustum.height;
            const double depth = 0.05 + 0.9 * random_unit(&seed);
            if (cases[c].access == UMB_MAP_MIPS) {
                const double value = ask_one(&soft, x, y, depth);
                assert_true(value >= 0.0 && value <= 1.0);
                continue; /* levels of the chain have no widths of their own to ask for */
            }
            const double width = penumbra_of(x, y, depth, light, nearest);
            double expected = 1.0;
            if (width > 0.0) {
                const struct umb_map_query box =
                    query_of(plain, &(struct umb_map_filter){.width = width});
                expected = ask_one(&box, x, y, depth);
            }
            assert_true(fabs(ask_one(&soft, x, y, depth) - expected) < 1e-5);
        }
        umb_map_destroy(plain);
        umb_map_destroy(map);
    }
    struct umb_map *map;
    const struct umb_map_frustum frustum = plain_frustum(W, H);
    const struct umb_map_layer in = {.depth = &layer[0][0]};
    struct umb_map_settings bad = {.technique = UMB_MAP_VSM, .keep_depth = 1};
    assert_int_equal(umb_map_build(&frustum, &in, &bad, NULL, &map, NULL), UMB_E_UNSUPPORTED);
    bad = (struct umb_map_settings){.keep_depth = 1};
    assert_int_equal(umb_map_build(&frustum, &in, &bad, NULL, &map, NULL), UMB_E_UNSUPPORTED);
}

/* The trilinear level of a penumbra must be that of a box of the same width. */
static void chains_take_the_level_of_the_penumbra(void **state)
{
    (void)state;
    enum {
        SIDE = 64
    };
    static float edge[SIDE][SIDE];
    for (int i = 0; i < SIDE * SIDE; i++) {
        edge[i / SIDE][i % SIDE] = i % SIDE < SIDE / 2 ? 0.2F : 1.0F;
    }
    const struct umb_map_frustum frustum = plain_frustum(SIDE, SIDE);
    struct umb_map_settings settings = {
        .technique = UMB_MAP_MSM, .access = UMB_MAP_MIPS, .keep_depth = 1};
    struct umb_map *map = map_of(&frustum, &edge[0][0], &settings);
    const double light = 2.0 * atan(0.1); /* 20 m of penumbra behind 100 m */
    const struct umb_map_query soft =
        query_of(map, &(struct umb_map_filter){.width = 64, .light_size = light});
    for (double x = 24.0; x < 40.0; x += 0.5) {
        /* float(0.2) is off by 3e-9. */
        const double width = 20.0 * (0.7 - 0.2);
        const struct umb_map_query box = query_of(map, &(struct umb_map_filter){.width = width});
        const double expected = x < 37.0 ? ask_one(&box, x, 32.0, 0.7) : 1.0;
        assert_true(fabs(ask_one(&soft, x, 32.0, 0.7) - expected) < 1e-5);
    }
    umb_map_destroy(map);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_count_the_texels_that_plain_loops_count),
        cmocka_unit_test(slope_and_normal_bias_of_1_leave_no_acne_on_planes),
        cmocka_unit_test(constant_bias_of_16_bit_depth_must_exceed_half_a_step),
        cmocka_unit_test(poisson_points_keep_apart_within_the_disc),
        cmocka_unit_test(poisson_kernel_approaches_the_share_of_the_disc),
        cmocka_unit_test(penumbra_of_an_edge_is_linear_and_as_wide_as_geometry_says),
        cmocka_unit_test(penumbra_of_a_spot_light_follows_similar_triangles),
        cmocka_unit_test(bilinear_boxes_weigh_texels_by_their_share),
        cmocka_unit_test(filtered_maps_ask_the_window_of_the_penumbra),
        cmocka_unit_test(chains_take_the_level_of_the_penumbra),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
