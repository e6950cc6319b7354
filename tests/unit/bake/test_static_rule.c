/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The static rule: every voxel that a window of a point on a chosen triangle reads must be right,
 * for every number of taps. Lit voxels must stay lit. The result must be equal for all tiles and
 * threads. Windows are made here from the formula of the manual (umbrage/query.h), lit and end by a
 * loop over triangles.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "bake/depth/coverage.h"
#include "bake_soups.h"
#include "format/receiver_mask.h"
#include "umbrage/query.h"

#define SIZE   128
#define TEXELS ((size_t)SIZE * SIZE)

/* A soup, baked under the rule. */
struct ruled {
    struct soup *soup;
    double edge[3]; /* metres a voxel */
    int closed_rule;
    uint8_t *open; /* kinds where nothing is closed */
    struct umbb_static rule;
    uint64_t cells[UMB__RECEIVER_MASK_WORDS];
    struct umb__octree octree;
};

static void bake(struct ruled *r, uint32_t tile_log2, unsigned threads)
{
    struct umb_error error;
    struct umbb_casters casters = soup_casters(r->soup, 1);
    if (!r->closed_rule) {
        casters.kinds = r->open;
    }
    const struct umb_frustum_info frustum = {
        .log2_size = soup_log2(r->soup),
        .voxel_step = {{r->edge[0], 0, 0}, {0, r->edge[1], 0}, {0, 0, r->edge[2]}}};
    const struct umbb_depth_options depth_options = {
        .tile_log2 = tile_log2, .threads = threads, .prove = UMBB_PROVE_NEVER};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), UMB_OK);
    assert_int_equal(umbb_static_init(&r->rule, &casters, &frustum, r->cells, &error), UMB_OK);
    const struct umbb_bake_options options = {
        .log2_size = soup_log2(r->soup),
        .tile_log2 = tile_log2,
        .threads = threads,
        .closed_rule = r->closed_rule,
        .rule = &r->rule,
        .octree_max_bytes = (size_t)1 << 30,
    };
    assert_int_equal(bake_frustum(&depth, &options, &r->octree, NULL, &error), UMB_OK);
    depth.destroy(depth.state);
}

static void release(struct ruled *r)
{
    umbb_static_finish(&r->rule);
    umb__octree_finish(&r->octree);
}

/* Calls fn for each texel centre that a triangle covers. */
typedef void (*texel_fn)(void *user, size_t texel, int32_t lit, int front);
static void covered(const struct soup *soup, size_t triangle, texel_fn fn, void *user)
{
    struct umbb_coverage c;
    if (!umbb_coverage_prepare((const double(*)[3])soup->corners[triangle], SIZE, &c)) {
        return;
    }
    for (int32_t y = c.row_first; y <= c.row_last; y++) {
        int32_t first, last;
        const int front = umbb_coverage_row(&c, y, &first, &last);
        for (int32_t x = first < 0 ? 0 : first; y >= 0 && y < SIZE && x <= last && x < SIZE; x++) {
            fn(user, (size_t)y * SIZE + (size_t)x,
               umbb_coverage_lit(&c, umbb_coverage_row_z(&c, y), x), front);
        }
    }
}

/* The nearest fragments of all texels (of open casters, of fronts and of backs), then lit and end,
 * and the octree's voxels, eight of a column in a byte. */
struct slow {
    int32_t near[3][TEXELS], lit[TEXELS], end[TEXELS];
    int layer_front, layer_back;
    uint8_t said[TEXELS][SIZE / 8];
};

static void lower(void *user, size_t texel, int32_t lit, int front)
{
    struct slow *s = user;
    int32_t *layer = &s->near[front ? s->layer_front : s->layer_back][texel];
    *layer = lit < *layer ? lit : *layer;
}

static struct slow *slow_make(const struct ruled *r)
{
    struct slow *s = malloc(sizeof *s);
    assert_non_null(s);
    for (size_t i = 0; i < 3 * TEXELS; i++) {
        s->near[i / TEXELS][i % TEXELS] = SIZE;
    }
    for (size_t i = 0; i < r->soup->count; i++) {
        const int open = !r->closed_rule || r->soup->kinds[i] == UMBB_CASTER_OPEN;
        const int flipped = r->soup->kinds[i] == UMBB_CASTER_CLOSED_FLIPPED;
        s->layer_front = open ? 0 : flipped ? 2 : 1;
        s->layer_back = open ? 0 : flipped ? 1 : 2;
        covered(r->soup, i, lower, s);
    }
    for (size_t i = 0; i < TEXELS; i++) {
        const int32_t nearest[3] = {s->near[0][i], s->near[1][i], s->near[2][i]};
        umbb_texel_decide(nearest, SIZE, &s->lit[i], &s->end[i]);
    }
    return s;
}

static void read_octree(const struct umb__octree *octree, struct slow *s)
{
    for (uint32_t i = 0; i < (uint32_t)TEXELS; i++) {
        for (uint32_t z = 0; z < SIZE; z += 8) {
            s->said[i][z / 8] = (uint8_t)octree_eight(octree, i % SIZE, i / SIZE, z);
        }
    }
}

static int says_lit(const struct slow *s, size_t texel, int32_t z)
{
    return s->said[texel][z / 8] >> z % 8 & 1;
}

/* Returns whether a shadow touches a triangle, or nothing is known about it. */
struct touch {
    const struct slow *slow;
    int covered, shadowed;
};

static void look(void *user, size_t texel, int32_t lit, int front)
{
    struct touch *t = user;
    (void)front;
    t->covered = 1;
    t->shadowed |= lit > t->slow->lit[texel] + 1;
}

static int is_asked(const struct ruled *r, const struct slow *slow, size_t triangle)
{
    struct touch t = {.slow = slow};
    covered(r->soup, triangle, look, &t);
    return !t.covered || t.shadowed;
}

/* Finds the window of a random point of a triangle; returns 0 if it lies outside the frustum. */
static int window(struct ruled *r, size_t triangle, int taps, double v[3])
{
    const double(*c)[3] = (const double(*)[3])r->soup->corners[triangle];
    const double root = sqrt(soup_unit(r->soup)), b = root * soup_unit(r->soup), a = 1 - root;
    double e[2][3], p[3], n[3], length = 0, bias = 0;
    for (int k = 0; k < 3; k++) {
        p[k] = r->edge[k] * (c[0][k] + b * (c[1][k] - c[0][k]) + (1 - a - b) * (c[2][k] - c[0][k]));
        e[0][k] = r->edge[k] * (c[1][k] - c[0][k]);
        e[1][k] = r->edge[k] * (c[2][k] - c[0][k]);
    }
    for (int k = 0; k < 3; k++) {
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
        length += n[k] * n[k];
    }
    length = (n[2] > 0 ? -1 : 1) * sqrt(length); /* towards the light */
    for (int k = 0; k < 3; k++) {
        n[k] /= length;
        bias += 0.5 * (k == 2 ? 1 : taps) * fabs(n[k]) * r->edge[k];
    }
    if (!(fabs(n[2]) > 1e-9)) {
        return 0; /* faces away */
    }
    /* The move is along the light by at most 2 taps - 1/2 texels; the rest is along the normal. */
    const double need = 65.0 / 64.0 * bias, most = (2 * taps - 0.5) * (r->edge[0] + r->edge[1]) / 2;
    const double lift = fmin(need / fabs(n[2]), most), rest = need - lift * fabs(n[2]);
    double deeper = -lift / r->edge[2];
    for (int k = 0; k < 3; k++) {
        v[k] = (p[k] + rest * n[k]) / r->edge[k];
    }
    for (int k = 0; k < 2 && taps > 1 && lift < most; k++) {
        /* From the plane's depth at the centre of the window half a texel less suffices. */
        const double slope = n[k] * r->edge[k] / (fabs(n[2]) * r->edge[2]);
        deeper += slope * (0.5 - (v[k] - floor(v[k]))) + 65.0 / 128.0 * fabs(slope);
    }
    v[2] += deeper;
    for (int k = 0; k < 3; k++) {
        v[k] = floor(v[k]);
    }
    return v[0] >= 0 && v[0] < SIZE && v[1] >= 0 && v[1] < SIZE && v[2] >= 0 && v[2] < SIZE;
}

/* Compares a point's window with the truth; returns how many of its voxels lie behind a first
 * caster. */
static int check_window(const struct slow *slow, int taps, const double v[3])
{
    int behind = 0;
    for (int i = 0; i < taps * taps; i++) {
        const int x = (int)v[0] + i % taps - taps / 2, y = (int)v[1] + i / taps - taps / 2;
        const int z = (int)v[2];
        if (x < 0 || x >= SIZE || y < 0 || y >= SIZE) {
            continue;
        }
        const size_t texel = (size_t)y * SIZE + (size_t)x;
        if (z < slow->lit[texel] || z >= slow->end[texel]) {
            const int lit = says_lit(slow, texel, z);
            behind += z >= slow->lit[texel];
            if (lit != (z < slow->lit[texel])) {
                fail_msg("%d taps at %g %g %g: voxel %d %d %d of lit %d end %d is %d", taps, v[0],
                         v[1], v[2], x, y, z, slow->lit[texel], slow->end[texel], lit);
            }
        }
    }
    return behind;
}

/* Checks that lit voxels are lit; returns how many of those beyond `end` are lit, too. */
static size_t check_lit(const struct slow *slow)
{
    size_t freed = 0;
    for (size_t i = 0; i < TEXELS; i++) {
        for (int32_t z = 0; z < SIZE; z++) {
            const int lit = says_lit(slow, i, z);
            if (z < slow->lit[i] && !lit) {
                fail_msg("voxel %zu %zu %d of lit %d is dark", i % SIZE, i / SIZE, (int)z,
                         (int)slow->lit[i]);
            }
            freed += z >= slow->end[i] && lit;
        }
    }
    return freed;
}

/* Returns how many voxels became undefined by the rule. */
static size_t check_soup(struct ruled *r, size_t points)
{
    struct slow *slow = slow_make(r);
    size_t asked = 0, behind = 0;
    bake(r, 7, 2);
    read_octree(&r->octree, slow);
    for (size_t i = 0; i < r->soup->count; i++) {
        const int wanted = is_asked(r, slow, i);
        assert_int_equal(r->rule.met[i] != 1, wanted);
        asked += (size_t)wanted;
        for (size_t k = 0; k < points; k++) {
            const int taps = 1 + 2 * (int)(soup_bits(r->soup) % 9);
            double v[3];
            if (window(r, i, taps, v)) {
                const uint32_t voxel[3] = {(uint32_t)v[0], (uint32_t)v[1], (uint32_t)v[2]};
                assert_true(umb__receiver_mask_has(r->cells, 7, voxel));
                behind += wanted ? (size_t)check_window(slow, taps, v) : 0;
            }
        }
    }
    assert_true(asked > 0 && asked < r->soup->count);
    assert_true(behind > 0);
    const size_t freed = check_lit(slow);
    release(r);
    free(slow);
    return freed;
}

/* A mixture of casters, and under it two large squares, one of them steep, on which shadows
 * fall. */
static void make_soup(struct soup *soup, uint64_t seed)
{
    soup_init(soup, SIZE, seed);
    soup_mixture(soup);
    const double low[4][3] = {{4, 4, 118}, {124, 4, 116}, {124, 124, 112}, {4, 124, 114}};
    const double steep[3][3] = {{2, 2, 20}, {126, 2, 25}, {60, 40, 126}};
    soup_add(soup, low[0], low[1], low[2], UMBB_CASTER_OPEN);
    soup_add(soup, low[0], low[2], low[3], UMBB_CASTER_OPEN);
    soup_add(soup, steep[0], steep[1], steep[2], UMBB_CASTER_OPEN);
}

static void windows_of_asked_triangles_read_what_is_there(void **state)
{
    (void)state;
    static const double edges[][3] = {{1, 1, 1}, {0.5, 0.25, 2}};
    for (uint64_t seed = 301; seed <= 304; seed++) {
        struct soup soup;
        make_soup(&soup, seed);
        struct ruled r = {.soup = &soup, .closed_rule = seed % 2 == 0};
        r.open = calloc(soup.count, 1);
        assert_non_null(r.open);
        memcpy(r.edge, edges[seed > 302], sizeof r.edge);
        assert_true(check_soup(&r, 60) > 0);
        free(r.open);
        soup_finish(&soup);
    }
}

/* Walls across the diagonal, 1e-8 off the light's direction. Beside a wall, the depth of its plane
 * is too large for the whole numbers that hold depths. */
static void walls_next_to_vertical_are_asked_where_they_are(void **state)
{
    (void)state;
    struct soup soup;
    make_soup(&soup, 331);
    const double wall[3][3] = {{10, 10, 10}, {118, 118, 10}, {64 + 7e-7, 64 - 7e-7, 118}};
    const double other[3][3] = {{10, 10, 10}, {118, 118, 10}, {64 - 7e-7, 64 + 7e-7, 118}};
    soup_add(&soup, wall[0], wall[1], wall[2], UMBB_CASTER_OPEN);
    soup_add(&soup, other[0], other[1], other[2], UMBB_CASTER_OPEN);
    struct ruled r = {.soup = &soup, .edge = {1, 1, 1}};
    r.open = calloc(soup.count, 1);
    assert_non_null(r.open);
    (void)check_soup(&r, 60);
    free(r.open);
    soup_finish(&soup);
}

static void tiles_and_threads_change_nothing(void **state)
{
    (void)state;
    struct soup soup;
    make_soup(&soup, 311);
    struct ruled one = {.soup = &soup, .edge = {1, 1, 1}}, other = one;
    one.open = other.open = calloc(soup.count, 1);
    assert_non_null(one.open);
    bake(&one, 7, 1);
    bake(&other, 6, 3);
    assert_memory_equal(one.cells, other.cells, sizeof one.cells);
    assert_memory_equal(one.rule.met, other.rule.met, soup.count);
    for (uint32_t i = 0; i < (uint32_t)(TEXELS * SIZE / 8); i++) {
        const uint32_t x = i % SIZE, y = i / SIZE % SIZE, z = i / SIZE / SIZE * 8;
        assert_int_equal(octree_eight(&one.octree, x, y, z), octree_eight(&other.octree, x, y, z));
    }
    release(&one);
    release(&other);
    free(one.open);
    soup_finish(&soup);
}

static int is_over(void)
{
    return 1;
}

static void a_cancelled_survey_looks_at_nothing_more(void **state)
{
    (void)state;
    struct soup soup;
    struct umb_error error;
    struct umbu_threads *jobs;
    make_soup(&soup, 341);
    struct ruled r = {.soup = &soup, .edge = {1, 1, 1}};
    r.open = calloc(soup.count, 1);
    assert_non_null(r.open);
    bake(&r, 7, 1);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    r.rule.casters = &casters;
    assert_int_equal(umbu_threads_create(2, &jobs, &error), UMB_OK);
    memset(r.rule.met, 0, soup.count);
    /* No texel may be read: this tile has none, so a read would be out of bounds. */
    const struct umbb_tile tile = {.size = SIZE, .background = SIZE};
    umbb_static_survey(&r.rule, &tile, jobs, is_over);
    for (size_t i = 0; i < soup.count; i++) {
        assert_int_equal(r.rule.met[i], 0);
    }
    umbu_threads_destroy(jobs);
    release(&r);
    free(r.open);
    soup_finish(&soup);
}

/* Every marked cell must have a triangle within its diagonal plus the reach of a bias. */
static void cells_are_marked_near_surfaces_only(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, SIZE, 321);
    const double a[3] = {10, 10, 100}, b[3] = {110, 20, 104}, c[3] = {20, 110, 96};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    struct ruled r = {.soup = &soup, .edge = {1, 1, 1}};
    r.open = calloc(soup.count, 1);
    assert_non_null(r.open);
    bake(&r, 7, 1);
    size_t marked = 0;
    for (uint32_t i = 0; i < 64 * 64 * 64; i++) {
        const uint32_t voxel[3] = {i % 64 * 2, i / 64 % 64 * 2, i / 4096 * 2};
        marked += umb__receiver_mask_has(r.cells, 7, voxel);
        if (umb__receiver_mask_has(r.cells, 7, voxel)) {
            assert_in_range(voxel[2], 96 - 13 - 3, 104 + 3);
            assert_true(voxel[0] + voxel[1] <= 130 + 4 * 15);
        }
    }
    assert_true(marked > 0);
    release(&r);
    free(r.open);
    soup_finish(&soup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(windows_of_asked_triangles_read_what_is_there),
        cmocka_unit_test(walls_next_to_vertical_are_asked_where_they_are),
        cmocka_unit_test(tiles_and_threads_change_nothing),
        cmocka_unit_test(a_cancelled_survey_looks_at_nothing_more),
        cmocka_unit_test(cells_are_marked_near_surfaces_only),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
