/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Squares proven from bounds: no defined voxel may change, and every path, tile size and number of
 * threads must prove the same squares.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>

#include "bake/depth/coverage.h"
#include "bake/depth/proven_squares.h"
#include "bake_soups.h"
#include "make_asset.h"

typedef enum umb_status (*create_fn)(const struct umbb_casters *, const struct umbb_depth_options *,
                                     struct umbb_depth *, struct umb_error *);

/* A closed slab: a rough top of n x n cells, and the same top further down as its bottom. */
static void soup_slab(struct soup *soup, int n, double top, double thick)
{
    const double step = (soup->size - 40.0) / n;
    double v[12][12][2][3];
    for (int y = 0; y <= n; y++) {
        for (int x = 0; x <= n; x++) {
            const double z = top + 0.2 * soup->size * soup_unit(soup);
            for (int side = 0; side < 2; side++) {
                v[y][x][side][0] = 20.0 + x * step;
                v[y][x][side][1] = 20.0 + y * step;
                v[y][x][side][2] = z + side * thick;
            }
        }
    }
    for (int y = 0; y < n; y++) {
        for (int x = 0; x < n; x++) {
            for (int side = 0; side < 2; side++) {
                soup_add_closed(soup, v[y][x][side], v[y + 1][x][side], v[y][x + 1][side], side);
                soup_add_closed(soup, v[y][x + 1][side], v[y + 1][x][side], v[y + 1][x + 1][side],
                                side);
                for (size_t k = soup->count - 2; k < soup->count; k++) {
                    soup->kinds[k] = UMBB_CASTER_CLOSED;
                }
            }
        }
    }
    for (int i = 0; i < n; i++) { /* walls, wound like the top's and bottom's edges ask for */
        const double(*w[4][2])[3] = {{v[0][i + 1], v[0][i]},
                                     {v[n][i], v[n][i + 1]},
                                     {v[i][0], v[i + 1][0]},
                                     {v[i + 1][n], v[i][n]}};
        for (int side = 0; side < 4; side++) {
            const double(*a)[3] = w[side][0], (*b)[3] = w[side][1];
            soup_add_closed(soup, a[0], b[0], a[1], 1);
            soup_add_closed(soup, b[0], b[1], a[1], 1);
            for (size_t k = soup->count - 2; k < soup->count; k++) {
                soup->kinds[k] = UMBB_CASTER_CLOSED;
            }
        }
    }
}

static void soup_scene(struct soup *soup, uint64_t seed)
{
    soup_init(soup, 512, seed);
    soup_slab(soup, 3 + (int)(seed % 3), 0.4 * soup->size, 0.3 * soup->size);
    for (int i = 0; i < 3; i++) {
        soup_random_ball(soup);
    }
    if (seed % 2 == 0) {
        soup_random_box(soup);
        const double z = 0.3 * soup->size; /* an open face before some of it, one behind */
        const double a[3] = {300, 300, z}, b[3] = {300, 420, z}, c[3] = {420, 300, z};
        const double d[3] = {90, 90, 500}, e[3] = {90, 210, 500}, f[3] = {210, 90, 500};
        soup_add(soup, a, b, c, UMBB_CASTER_OPEN);
        soup_add(soup, d, e, f, UMBB_CASTER_OPEN);
    }
}

/* lit and end of a texel from all triangles. */
static void slow_texel(const struct soup *soup, const struct umbb_coverage *all, int32_t x,
                       int32_t y, int32_t *lit, int32_t *end)
{
    int32_t near[3] = {soup->size, soup->size, soup->size};
    for (size_t i = 0; i < soup->count; i++) {
        int32_t first, last;
        if (y < all[i].row_first || y > all[i].row_last) {
            continue;
        }
        const int front = umbb_coverage_row(&all[i], y, &first, &last);
        if (x >= first && x <= last) {
            const int out = front != (soup->kinds[i] == UMBB_CASTER_CLOSED_FLIPPED);
            const int layer = soup->kinds[i] == UMBB_CASTER_OPEN ? 0 : out ? 1 : 2;
            const int32_t z = umbb_coverage_lit(&all[i], umbb_coverage_row_z(&all[i], y), x);
            near[layer] = z < near[layer] ? z : near[layer];
        }
    }
    *lit = near[0] < near[1] ? near[0] : near[1];
    *lit = near[2] < *lit ? near[2] : *lit;
    *end = *lit == near[1] && near[2] < soup->size ? near[2] : *lit;
}

static void check_voxel(const struct umb__octree *octree, int32_t x, int32_t y, int32_t z,
                        const int32_t bounds[2])
{
    if (z < 0 || z >= 1 << octree->roots[0].level || (z >= bounds[0] && z < bounds[1])) {
        return;
    }
    if (octree_voxel(octree, (uint32_t)x, (uint32_t)y, (uint32_t)z) != (z < bounds[0])) {
        fail_msg("voxel %d %d %d: lit %d end %d, octree says otherwise", (int)x, (int)y, (int)z,
                 (int)bounds[0], (int)bounds[1]);
    }
}

static void check_columns(struct soup *soup, const struct umb__octree *octree)
{
    struct umbb_coverage *all = calloc(soup->count, sizeof *all);
    assert_non_null(all);
    for (size_t i = 0; i < soup->count; i++) {
        if (!umbb_coverage_prepare((const double(*)[3])soup->corners[i], soup->size, &all[i])) {
            all[i].row_last = -1;
            all[i].row_first = 0;
        }
    }
    for (int32_t y = 0; y < soup->size; y += 3) {
        for (int32_t x = (int32_t)(soup_bits(soup) % 3); x < soup->size; x += 3) {
            int32_t bounds[2];
            slow_texel(soup, all, x, y, &bounds[0], &bounds[1]);
            for (int32_t k = -2; k < 2; k++) {
                check_voxel(octree, x, y, bounds[0] + k, bounds);
                check_voxel(octree, x, y, bounds[1] + k, bounds);
                check_voxel(octree, x, y, (int32_t)(soup_bits(soup) % 512), bounds);
            }
        }
    }
    free(all);
}

static void bake(const struct soup *soup, create_fn create, struct umbb_depth_options options,
                 struct umb__octree *octree)
{
    struct umb_error error;
    struct umbb_depth depth;
    const struct umbb_casters casters = soup_casters(soup, 1);
    const struct umbb_bake_options bake_options = {
        .log2_size = soup_log2(soup),
        .tile_log2 = options.tile_log2,
        .threads = options.threads,
        .closed_rule = 1,
        .octree_max_bytes = (size_t)1 << 30,
    };
    assert_int_equal(create(&casters, &options, &depth, &error), UMB_OK);
    assert_int_equal(bake_frustum(&depth, &bake_options, octree, NULL, &error), UMB_OK);
    depth.destroy(depth.state);
}

static size_t proven_count(const struct soup *soup, uint32_t tile_log2)
{
    struct umb_error error;
    struct umbb_depth depth;
    struct umbb_tile tile;
    const struct umbb_casters casters = soup_casters(soup, 1);
    const struct umbb_depth_options options = {
        .tile_log2 = tile_log2, .threads = 1, .prove = UMBB_PROVE_ALWAYS};
    size_t count = 0;
    assert_int_equal(umbb_depth_raster_create(&casters, &options, &depth, &error), UMB_OK);
    assert_int_equal(umbb_tile_init(&tile, tile_log2, 1, &error), UMB_OK);
    for (tile.y0 = 0; tile.y0 < soup->size; tile.y0 += tile.size) {
        for (tile.x0 = 0; tile.x0 < soup->size; tile.x0 += tile.size) {
            assert_int_equal(depth.begin(depth.state, 0, &tile, &error), UMB_OK);
            for (size_t i = 0; i < (size_t)1 << (2 * (tile_log2 - UMBB_SQUARE_LOG2)); i++) {
                /* Squares over background alone prove nothing, so they do not count. */
                count += tile.proven[i] && tile.max_lit[UMBB_SQUARE_LOG2][i] < soup->size;
            }
        }
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
    return count;
}

static void proven_squares_change_no_defined_voxel(void **state)
{
    (void)state;
    size_t proven = 0;
    const int seeds = short_count(6, 2);
    for (int seed = 1; seed <= seeds; seed++) {
        struct soup soup;
        struct umb__octree octree;
        soup_scene(&soup, (uint64_t)seed);
        const struct umbb_depth_options options = {
            .tile_log2 = 9, .threads = 2, .prove = UMBB_PROVE_ALWAYS};
        bake(&soup, umbb_depth_raster_create, options, &octree);
        check_columns(&soup, &octree);
        umb__octree_finish(&octree);
        const size_t here = proven_count(&soup, 9);
        for (uint32_t tile_log2 = 6; tile_log2 < 9; tile_log2++) {
            assert_int_equal(proven_count(&soup, tile_log2), here);
        }
        proven += here;
        soup_finish(&soup);
    }
    print_message("%zu of %d squares proven\n", proven, seeds * 64);
    assert_true(proven > 3 * (size_t)seeds); /* the proof did something */
}

static void a_sheet_called_closed_ends_in_shadow(void **state)
{
    (void)state;
    struct soup soup;
    struct umb__octree octree;
    soup_init(&soup, 512, 5);
    /* Behind the sheet there is no back face, except where a box stands under it. */
    const double a[3] = {5, 5, 100}, b[3] = {5, 507, 100}, c[3] = {507, 5, 100};
    const double low[3] = {90, 90, 200}, high[3] = {100, 100, 400};
    soup_add(&soup, a, b, c, UMBB_CASTER_CLOSED);
    soup_box(&soup, low, high, 0);
    soup.open_on_word = 1;
    const struct umbb_depth_options options = {
        .tile_log2 = 9, .threads = 1, .prove = UMBB_PROVE_ALWAYS};
    bake(&soup, umbb_depth_raster_create, options, &octree);
    check_columns(&soup, &octree);
    umb__octree_finish(&octree);
    soup_finish(&soup);
}

/* Computes a digest from counts and masks of all levels, and all slices. It is equal for equal
 * trees, whatever their numbers. */
static uint64_t fingerprint(const struct umb__octree *octree)
{
    uint64_t sum = octree->brick_count;
    for (uint32_t i = 0; i < octree->brick_count; i++) {
        uint64_t hash = 0;
        for (size_t z = 0; z < 8; z++) {
            hash = (hash ^ octree->bricks[i][z]) * 0x9e3779b97f4a7c15ULL;
            hash ^= hash >> 29;
        }
        sum += hash;
    }
    for (uint32_t level = 4; level <= octree->roots[0].level; level++) {
        for (uint32_t i = 0; i < octree->level[level].count; i++) {
            sum += (octree->level[level].masks[i] + 1) * 0xd6e8feb86659fd93ULL * level;
        }
    }
    return sum;
}

static void every_path_and_tile_size_proves_the_same(void **state)
{
    (void)state;
    struct soup soup;
    struct umb__octree octree;
    soup_scene(&soup, 2);
    uint64_t first = 0;
    for (uint32_t tile_log2 = 6; tile_log2 <= 9; tile_log2++) {
        const struct umbb_depth_options options = {.tile_log2 = tile_log2,
                                                   .threads = 1 + tile_log2 % 3,
                                                   .plain = tile_log2 == 7,
                                                   .prove = UMBB_PROVE_ALWAYS};
        bake(&soup, tile_log2 == 8 ? umbb_depth_embree_create : umbb_depth_raster_create, options,
             &octree);
        first = tile_log2 == 6 ? fingerprint(&octree) : first;
        assert_true(fingerprint(&octree) == first);
        umb__octree_finish(&octree);
    }
    soup_finish(&soup);
}

/* Bakes a soup; returns the fingerprint of its octree. */
static uint64_t print_of(const struct soup *soup, create_fn create,
                         struct umbb_depth_options options)
{
    struct umb__octree octree;
    bake(soup, create, options, &octree);
    const uint64_t print = fingerprint(&octree);
    umb__octree_finish(&octree);
    return print;
}

/* Compares a lamp's octree with one made without proven squares, for every path. */
static void check_lamp(const struct soup *soup)
{
    const uint64_t drawn = print_of(
        soup, umbb_depth_raster_create,
        (struct umbb_depth_options){.tile_log2 = 9, .threads = 1, .prove = UMBB_PROVE_NEVER});
    for (uint32_t tile_log2 = 6; tile_log2 <= 9; tile_log2++) {
        const struct umbb_depth_options options = {.tile_log2 = tile_log2,
                                                   .threads = 1 + tile_log2 % 2,
                                                   .plain = tile_log2 == 7,
                                                   .prove = UMBB_PROVE_ALWAYS};
        assert_true(print_of(soup,
                             tile_log2 == 8 ? umbb_depth_embree_create : umbb_depth_raster_create,
                             options) == drawn);
    }
}

static void proven_squares_of_lamps_change_no_voxel(void **state)
{
    (void)state;
    size_t proven = 0;
    const int seeds = short_count(12, 2);
    for (int seed = 1; seed <= seeds; seed++) {
        struct soup soup;
        soup_scene(&soup, (uint64_t)seed);
        soup_before_lamp(&soup, seed % 2 == 0 ? 30.0 : 700.0);
        proven += proven_count(&soup, 9);
        check_lamp(&soup);
        soup_finish(&soup);
    }
    print_message("%zu of %d squares proven\n", proven, seeds * 64);
    assert_true(proven > (size_t)seeds);
}

/* A box with a tip below its bottom, a little beyond the last voxel. */
static void soup_tipped_box(struct soup *soup)
{
    static const double flat[4][2] = {{20, 20}, {20, 492}, {492, 492}, {492, 20}};
    double top[4][3], bottom[4][3], tip[3];
    for (int i = 0; i < 4; i++) {
        for (int axis = 0; axis < 2; axis++) {
            top[i][axis] = bottom[i][axis] = flat[i][axis];
            tip[axis] = 150.0 + 200.0 * soup_unit(soup);
        }
        top[i][2] = 100.0;
        bottom[i][2] = 480.0;
    }
    tip[2] = soup->size + 5.0 * soup_unit(soup);
    soup_add_closed(soup, top[0], top[1], top[2], 0);
    soup_add_closed(soup, top[0], top[2], top[3], 0);
    for (int i = 0; i < 4; i++) {
        const int next = (i + 1) % 4;
        soup_add_closed(soup, top[next], top[i], bottom[i], 0);
        soup_add_closed(soup, top[next], bottom[i], bottom[next], 0);
        soup_add_closed(soup, bottom[next], bottom[i], tip, 0);
    }
}

/* Texels at the tip have no back face within the map, so their `end` is their `lit`. */
static void a_back_beyond_the_last_voxel_ends_nothing(void **state)
{
    (void)state;
    for (int seed = 1; seed <= short_count(12, 2); seed++) {
        struct soup soup;
        soup_init(&soup, 512, (uint64_t)seed);
        soup_tipped_box(&soup);
        soup_before_lamp(&soup, 200.0);
        assert_true(proven_count(&soup, 9) > 16);
        check_lamp(&soup);
        soup_finish(&soup);
    }
}

static void only_silhouettes_are_borders(void **state)
{
    (void)state;
    struct soup soup;
    struct umb_error error;
    uint8_t *marks;
    soup_init(&soup, 64, 0);
    const double low[3] = {10, 10, 20}, high[3] = {50, 50, 40};
    soup_box(&soup, low, high, 0);
    soup_box(&soup, low, high, 1);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    assert_int_equal(umbb_front_marks_make(&casters, UMBB_PROVE_ALWAYS, NULL, &marks, &error),
                     UMB_OK);
    size_t fronts = 0, borders = 0;
    for (size_t i = 0; i < soup.count; i++) {
        fronts += (marks[i] & UMBB_MARK_FRONT) != 0;
        borders += (size_t)__builtin_popcount(marks[i] & UMBB_MARK_BORDER);
        assert_true((marks[i] & UMBB_MARK_FRONT) != 0 || marks[i] == 0); /* walls are neither */
    }
    assert_int_equal(fronts, 4);  /* two triangles of each box */
    assert_int_equal(borders, 8); /* the outlines, not the diagonals */
    free(marks);
    assert_int_equal(umbb_front_marks_make(&casters, UMBB_PROVE_NEVER, NULL, &marks, &error),
                     UMB_OK);
    assert_null(marks);
    soup_finish(&soup);
}

/* A closed wedge, a voxel or two wide, of which a corner lies within three texels of a corner of
 * squares. */
static void soup_splinter(struct soup *soup)
{
    double v[4][3];
    for (int axis = 0; axis < 2; axis++) {
        const double border = 64.0 * (double)(1 + soup_bits(soup) % 7);
        v[0][axis] = border - 3.0 + 6.0 * soup_unit(soup);
        for (int i = 1; i < 4; i++) {
            v[i][axis] = v[0][axis] - 4.0 + 8.0 * soup_unit(soup);
        }
    }
    for (int i = 0; i < 4; i++) {
        v[i][2] = 100.0 + 380.0 * soup_unit(soup);
    }
    /* The fourth corner on the inner side of the first three. */
    double n = 0;
    for (int axis = 0; axis < 3; axis++) {
        const int a = (axis + 1) % 3, b = (axis + 2) % 3;
        n += ((v[1][a] - v[0][a]) * (v[2][b] - v[0][b]) -
              (v[1][b] - v[0][b]) * (v[2][a] - v[0][a])) *
             (v[3][axis] - v[0][axis]);
    }
    const int turn = n > 0;
    soup_add_closed(soup, v[0], v[1], v[2], turn);
    soup_add_closed(soup, v[0], v[3], v[1], turn);
    soup_add_closed(soup, v[1], v[3], v[2], turn);
    soup_add_closed(soup, v[2], v[3], v[0], turn);
    for (size_t k = soup->count - 4; k < soup->count; k++) {
        soup->kinds[k] = UMBB_CASTER_CLOSED;
    }
}

/* Collects, tile by tile, what is known of each square of 64 x 64 texels: whether it is proven, and
 * its two bounds. Out: int32[8 * 8][3]. */
static void prove_all(const struct soup *soup, create_fn create, uint32_t tile_log2,
                      int32_t (*out)[3])
{
    struct umb_error error;
    struct umbb_depth depth;
    struct umbb_tile tile;
    const struct umbb_casters casters = soup_casters(soup, 1);
    const struct umbb_depth_options options = {
        .tile_log2 = tile_log2, .threads = 1, .prove = UMBB_PROVE_ALWAYS};
    assert_int_equal(create(&casters, &options, &depth, &error), UMB_OK);
    assert_int_equal(umbb_tile_init(&tile, tile_log2, 1, &error), UMB_OK);
    const int32_t across = 1 << (tile_log2 - UMBB_SQUARE_LOG2);
    for (tile.y0 = 0; tile.y0 < soup->size; tile.y0 += tile.size) {
        for (tile.x0 = 0; tile.x0 < soup->size; tile.x0 += tile.size) {
            assert_int_equal(depth.begin(depth.state, 0, &tile, &error), UMB_OK);
            for (int32_t i = 0; i < across * across; i++) {
                const int32_t x = tile.x0 / 64 + i % across, y = tile.y0 / 64 + i / across;
                int32_t *square = out[y * (soup->size / 64) + x];
                square[0] = tile.proven[i];
                square[1] = tile.proven[i] ? tile.max_lit[UMBB_SQUARE_LOG2][i] : 0;
                square[2] = tile.proven[i] ? tile.min_end[UMBB_SQUARE_LOG2][i] : 0;
            }
        }
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
}

static void what_lies_beside_a_square_counts_whatever_the_tile(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= (uint64_t)short_count(40, 4); seed++) {
        struct soup soup;
        int32_t first[64][3], other[64][3];
        soup_init(&soup, 512, seed);
        const double low[3] = {5, 5, 50}, high[3] = {507, 507, 490};
        soup_box(&soup, low, high, 0);
        for (int i = 0; i < 12; i++) {
            soup_splinter(&soup);
        }
        prove_all(&soup, umbb_depth_raster_create, 9, first);
        for (uint32_t tile_log2 = 6; tile_log2 < 9; tile_log2++) {
            prove_all(&soup, umbb_depth_raster_create, tile_log2, other);
            assert_memory_equal(other, first, sizeof first);
        }
        prove_all(&soup, umbb_depth_embree_create, 6, other);
        assert_memory_equal(other, first, sizeof first);
        if (seed % 4 == 0) {
            soup_before_lamp(&soup, 100.0);
            check_lamp(&soup);
        }
        soup_finish(&soup);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(only_silhouettes_are_borders),
        cmocka_unit_test(proven_squares_change_no_defined_voxel),
        cmocka_unit_test(a_sheet_called_closed_ends_in_shadow),
        cmocka_unit_test(every_path_and_tile_size_proves_the_same),
        cmocka_unit_test(proven_squares_of_lamps_change_no_voxel),
        cmocka_unit_test(a_back_beyond_the_last_voxel_ends_nothing),
        cmocka_unit_test(what_lies_beside_a_square_counts_whatever_the_tile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
