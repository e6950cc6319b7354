/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench-orders races the orders in which a window's leaves can be visited (Sintorn et al. 2014,
 * section
 * 6.2 and figure 7), against the product's blocks of 64 points.
 *
 * The octree is that of 2014, of 4096 voxels a side: 2-bit children, 8 x 8 masks. A window of 9 x 9
 * touches up to 4 leaves, one of 17 x 17 up to 9. Each point walks alone, as a GPU's thread does:
 * from the root for each leaf; or in a fixed order, back to the lowest common ancestor; or in the
 * order that climbs least. All give the same counts, which are those of the product's open asset.
 * Steps are the children fetched. The figure of the paper is the time of the best order against the
 * fixed one.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench_arguments.h"
#include "bench_machine.h"
#include "bench_points.h"
#include "bench_report.h"
#include "format/node_pool.h"
#include "umbrage/query.h"
#include "yardstick_2014.h"

#define BENCH      "orders"
#define LEAVES_MAX 3 /* leaves a side of a window */
#define LEVELS     32

enum way {
    FROM_ROOT,
    FIXED,
    BEST,
    WAYS
};

/* A node on the way down, with its level; or the uniform child at which the way ended. */
struct stop {
    enum umb__node_state state;
    uint32_t number;
};

struct walk {
    const struct umb__octree *octree;
    struct stop path[LEVELS]; /* [level] node that holds the last leaf; valid from `low` up */
    uint32_t low, top;
    uint32_t last[2]; /* leaf that the path leads to, in leaves */
    uint64_t steps;
};

/* A window in voxels, and the leaves that it touches. */
struct window {
    int32_t x0, y0, z, taps;
    uint32_t leaf[2][2]; /* [axis][first, last] */
};

/* Returns the mask of a leaf, by a descent from the path's node at level `from`. */
static uint64_t leaf_fetch(struct walk *walk, uint32_t from, uint32_t lx, uint32_t ly, uint32_t z)
{
    const struct umb__octree *octree = walk->octree;
    uint32_t level = from;
    struct stop at = walk->path[level];
    while (at.state == UMB__NODE_MIXED && level > UMB_LEVEL_BRICK) {
        const struct umb__octree_level *l = &octree->level[level];
        const uint32_t below = level - 1 - UMB_LEVEL_BRICK; /* in leaves */
        const unsigned child =
            (lx >> below & 1) + 2 * (ly >> below & 1) + 4 * (z >> (level - 1) & 1);
        const uint16_t mask = l->masks[at.number];
        const struct stop next = {
            umb__mask_state(mask, child),
            umb__mask_state(mask, child) == UMB__NODE_MIXED
                ? l->children[l->first[at.number] +
                              umb__mask_mixed_count((uint16_t)(mask & ((1U << (2 * child)) - 1U)))]
                : 0};
        at = next;
        walk->path[--level] = at;
        walk->steps++;
    }
    walk->low = level;
    if (at.state != UMB__NODE_MIXED) {
        return at.state == UMB__NODE_LIT ? UINT64_MAX : 0;
    }
    walk->steps++;
    return octree->bricks[at.number][z & 7];
}

/* Returns the level of the lowest node that holds both of two leaves. */
static uint32_t common_level(const uint32_t a[2], const uint32_t b[2])
{
    const uint32_t differ = (a[0] ^ b[0]) | (a[1] ^ b[1]);
    return UMB_LEVEL_BRICK + (differ != 0 ? 32U - (uint32_t)__builtin_clz(differ) : 0U);
}

/* Returns the number of lit voxels of a leaf within a window. */
static uint32_t leaf_count(const struct window *w, uint32_t lx, uint32_t ly, uint64_t mask)
{
    const int32_t x = (int32_t)(8 * lx), y = (int32_t)(8 * ly);
    const int32_t x_from = w->x0 > x ? w->x0 - x : 0, y_from = w->y0 > y ? w->y0 - y : 0;
    const int32_t x_end = w->x0 + w->taps < x + 8 ? w->x0 + w->taps - x : 8;
    const int32_t y_end = w->y0 + w->taps < y + 8 ? w->y0 + w->taps - y : 8;
    const uint64_t row = (0xffU >> (8 - (x_end - x_from))) << x_from;
    uint64_t rows = 0;
    for (int32_t r = y_from; r < y_end; r++) {
        rows |= row << (8 * r);
    }
    return (uint32_t)__builtin_popcountll(mask & rows);
}

static uint32_t leaf_visit(struct walk *walk, const struct window *w, int from_root, uint32_t lx,
                           uint32_t ly)
{
    const uint32_t leaf[2] = {lx, ly};
    uint32_t level = walk->top;
    if (!from_root && walk->low <= walk->top) {
        level = common_level(leaf, walk->last);
        level = level < walk->low ? walk->low : level; /* a uniform node holds both */
    }
    const uint64_t mask = leaf_fetch(walk, level, lx, ly, (uint32_t)w->z);
    walk->last[0] = lx;
    walk->last[1] = ly;
    return leaf_count(w, lx, ly, mask);
}

/* Finds the levels to which a walk climbs between the columns (or rows) of a window's leaves. */
static void climbs(const struct window *w, int axis, uint32_t levels[LEAVES_MAX - 1])
{
    for (uint32_t i = 0; w->leaf[axis][0] + i < w->leaf[axis][1]; i++) {
        const uint32_t at = w->leaf[axis][0] + i;
        levels[i] = 32U - (uint32_t)__builtin_clz(at ^ (at + 1));
    }
}

/* Counts a window's lit voxels. The fixed order goes along rows, in alternating directions. The
 * best order goes along the axis whose borders between leaves are lower in the tree, since each row
 * crosses them. */
static uint32_t window_count(struct walk *walk, const struct window *w, enum way way)
{
    uint32_t levels[2][LEAVES_MAX - 1] = {{0}};
    uint32_t count = 0;
    int inner = 0;
    walk->low = walk->top + 1; /* no path yet */
    if (way == BEST) {
        climbs(w, 0, levels[0]);
        climbs(w, 1, levels[1]);
        inner = levels[0][0] + levels[0][1] > levels[1][0] + levels[1][1];
    }
    const uint32_t *in = w->leaf[inner], *out = w->leaf[!inner];
    int back = 0;
    for (uint32_t o = out[0]; o <= out[1]; o++, back = !back) {
        for (uint32_t k = 0; k <= in[1] - in[0]; k++) {
            const uint32_t i = back ? in[1] - k : in[0] + k;
            count += leaf_visit(walk, w, way == FROM_ROOT, inner ? o : i, inner ? i : o);
        }
    }
    return count;
}

struct race {
    struct umb__octree octree;
    struct window *windows;
    size_t count;
    float *answers[WAYS];
};

static double way_run(struct race *race, enum way way, uint64_t *steps)
{
    const struct umb__octree_root root = race->octree.roots[0];
    struct walk walk = {.octree = &race->octree, .top = root.level};
    walk.path[root.level] = (struct stop){root.state, root.index};
    const double start = bench_cpu_s();
    for (size_t i = 0; i < race->count; i++) {
        const struct window *w = &race->windows[i];
        race->answers[way][i] = (float)window_count(&walk, w, way) / (float)(w->taps * w->taps);
    }
    *steps = walk.steps;
    return (bench_cpu_s() - start) / (double)race->count;
}

/* Makes windows around points, placed as the product places them. Windows that reach beyond the map
 * are left out for all parties. Returns the points kept. */
static size_t windows_make(const struct bench_scene *scene, const float *points, size_t count,
                           int taps, struct window *windows, float *kept)
{
    const int32_t size = (int32_t)1 << scene->frustum.log2_size;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        double v[3];
        for (int row = 0; row < 3; row++) {
            const double *m = scene->frustum.world_to_voxel[row];
            v[row] = m[3];
            for (int k = 0; k < 3; k++) {
                v[row] += m[k] * (double)points[3 * i + (size_t)k];
            }
        }
        struct window w = {
            (int32_t)v[0] - taps / 2, (int32_t)v[1] - taps / 2, (int32_t)v[2], taps, {{0}}};
        if (w.x0 < 0 || w.y0 < 0 || w.x0 + taps > size || w.y0 + taps > size || v[2] < 0.0 ||
            w.z >= size) {
            continue;
        }
        w.leaf[0][0] = (uint32_t)w.x0 / 8;
        w.leaf[0][1] = (uint32_t)(w.x0 + taps - 1) / 8;
        w.leaf[1][0] = (uint32_t)w.y0 / 8;
        w.leaf[1][1] = (uint32_t)(w.y0 + taps - 1) / 8;
        memcpy(kept + 3 * used, points + 3 * i, 3 * sizeof *kept);
        windows[used++] = w;
    }
    return used;
}

static double ours_run(const struct bench_scene *scene, const struct umb_asset *asset, int taps,
                       const float *points, size_t count, float *answers)
{
    const struct umb_query_settings settings = {
        .taps = (uint32_t)taps, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_F32};
    struct umb_points batch = {.positions = points, .format = UMB_POINT_F32, .count = count};
    struct umb_answers out = {.values = answers};
    struct umb_query query;
    struct umb_error error;
    memcpy(batch.origin, scene->origin, sizeof batch.origin);
    bench_must(umb_query_prepare(asset, &settings, &query, &error), &error, "query");
    const double start = bench_cpu_s();
    umb_query_run(&query, &batch, 0, count, &out);
    return (bench_cpu_s() - start) / (double)count;
}

static void orders_race(struct race *race, const struct bench_scene *scene,
                        const struct umb_asset *asset, const struct bench_points *points, int t)
{
    struct bench_samples times[WAYS] = {0}, ours = {0}, best = {0}, root = {0}, product = {0};
    uint64_t steps[WAYS];
    const char *name = bench_text("%s-open-%s", scene->name, points->name);
    float *kept = calloc(points->count, 3 * sizeof *kept);
    float *answers = calloc(points->count, sizeof *answers);
    race->windows = calloc(points->count, sizeof *race->windows);
    for (int way = 0; way < WAYS; way++) {
        race->answers[way] = calloc(points->count, sizeof(float));
    }
    if (kept == NULL || answers == NULL || race->windows == NULL || race->answers[BEST] == NULL) {
        bench_fail("windows: out of memory");
    }
    race->count =
        windows_make(scene, points->at[t], points->count, bench_taps[t], race->windows, kept);
    for (int run = 0; run < BENCH_RUNS; run++) {
        for (int way = 0; way < WAYS; way++) {
            bench_add(&times[way], way_run(race, (enum way)way, &steps[way]));
        }
        bench_add(&ours, ours_run(scene, asset, bench_taps[t], kept, race->count, answers));
        bench_add(&best, times[FIXED].values[run] / times[BEST].values[run]);
        bench_add(&root, times[FROM_ROOT].values[run] / times[BEST].values[run]);
        bench_add(&product, times[BEST].values[run] / ours.values[run]);
    }
    size_t different = 0;
    for (size_t i = 0; i < race->count; i++) {
        different += race->answers[BEST][i] != race->answers[FIXED][i] ||
                     race->answers[BEST][i] != race->answers[FROM_ROOT][i];
        different +=
            (race->answers[BEST][i] - answers[i]) * (race->answers[BEST][i] - answers[i]) > 1e-10F;
    }
    if (different * 1000 > race->count) { /* floats at a voxel's border */
        bench_fail("%s: %zu of %zu answers differ", name, different, race->count);
    }
    bench_say("%s, %d taps: ns a point: root %.0f fixed %.0f best %.0f ours %.1f; steps %.2f %.2f "
              "%.2f",
              name, bench_taps[t], 1e9 * bench_median(&times[FROM_ROOT]),
              1e9 * bench_median(&times[FIXED]), 1e9 * bench_median(&times[BEST]),
              1e9 * bench_median(&ours), (double)steps[FROM_ROOT] / (double)race->count,
              (double)steps[FIXED] / (double)race->count,
              (double)steps[BEST] / (double)race->count);
    bench_row(BENCH, name, bench_text("best_vs_fixed_%d", bench_taps[t]), "higher", &best);
    bench_row(BENCH, name, bench_text("best_vs_root_%d", bench_taps[t]), "higher", &root);
    bench_row(BENCH, name, bench_text("ours_vs_best_%d", bench_taps[t]), "higher", &product);
    bench_row_counted(BENCH, name, bench_text("steps_best_of_fixed_%d", bench_taps[t]), "lower",
                      (double)steps[BEST] / (double)steps[FIXED]);
    free(kept);
    free(answers);
    free(race->windows);
    for (int way = 0; way < WAYS; way++) {
        free(race->answers[way]);
    }
}

static void scene_run(const char *name, const char *assets)
{
    struct bench_scene scene;
    struct bench_points sets[2];
    struct bench_asset asset;
    struct race race = {0};
    bench_scene_make(&scene, name, 12, assets);
    bench_scene_trace(&scene);
    bench_points_gbuffer(&scene, BENCH_VIEW_INSIDE, &sets[0]);
    bench_points_gbuffer(&scene, BENCH_VIEW_OVERVIEW, &sets[1]);
    bench_asset_make(&scene, 0, 0, &asset);
    yardstick_2014_octree(&scene, 0, &race.octree);
    (void)bench_pin(0);
    for (int s = 0; s < 2; s++) {
        for (int t = 1; t < 3; t++) {
            orders_race(&race, &scene, asset.asset, &sets[s], t);
        }
        bench_points_finish(&sets[s]);
    }
    (void)bench_pin(BENCH_PIN_ALL);
    umb__octree_finish(&race.octree);
    bench_asset_finish(&asset);
    bench_scene_finish(&scene);
}

static void usage_print(FILE *to)
{
    fputs("usage: bench_orders [--scene terrain|city] [--assets DIR]\n"
          "  --scene   this scene alone\n"
          "  --assets  read and keep bakes in this folder, which other benchmarks share\n",
          to);
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--scene", "--assets", NULL};
    static const char *const scenes[] = {"terrain", "city", NULL};
    bench_arguments(argc, argv, options, usage_print);
    const char *only = bench_choice(argc, argv, "--scene", scenes, NULL);
    const char *assets = bench_option(argc, argv, "--assets", NULL);
    for (size_t i = 0; scenes[i] != NULL; i++) {
        if (only == NULL || strcmp(only, scenes[i]) == 0) {
            scene_run(scenes[i], assets);
        }
    }
    bench_table(BENCH, "quick");
    return 0;
}
