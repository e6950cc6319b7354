/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench-bake compares the bytes of assets with the encoding of 2014, the depth stage with Embree,
 * and voxels with the oracle.
 *
 * depth_front_vs_embree8: seconds that Embree would take for one ray a covered texel (8-wide
 * coherent packets, at the rate of 64 random windows of 256 x 256 texels) over seconds of the whole
 * depth stage for one layer (listing the triangles by tile, drawing, and writing the texels of
 * every square of 8x8 that something covers, with the least and the greatest of each). Both in CPU
 * time of one thread, one right after the other.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bake/depth/depth.h"
#include "bake_race.h"
#include "bench_arguments.h"
#include "bench_machine.h"
#include "bench_report.h"
#include "bench_scene.h"
#include "embree_peer.h"
#include "lamp_race.h"
#include "voxel_truth.h"
#include "yardstick_2014.h"

#define BENCH         "bake"
#define WINDOWS       64
#define WINDOW        256
#define VOXEL_SAMPLES 10000000U
#define SEED          5U
#define QUICK_LOG2    14U
#define FULL_LOG2     16U
#define LARGEST_LOG2  18U

struct windows {
    int32_t size; /* voxels a side of the map */
    int32_t x0[WINDOWS], y0[WINDOWS];
    uint8_t *covered;        /* [WINDOWS * WINDOW * WINDOW] */
    int32_t *lit;            /* the same */
    uint64_t covered_texels; /* of the whole map */
};

static void window_take(struct windows *windows, const struct umbb_tile *tile, size_t w)
{
    for (int32_t i = 0; i < WINDOW * WINDOW; i++) {
        const int32_t x = windows->x0[w] + i % WINDOW - tile->x0;
        const int32_t y = windows->y0[w] + i / WINDOW - tile->y0;
        if (x >= 0 && x < tile->size && y >= 0 && y < tile->size) {
            int32_t lit, end;
            bench_texel(tile, windows->size, x, y, &lit, &end);
            const size_t at = w * WINDOW * WINDOW + (size_t)i;
            windows->lit[at] = lit;
            windows->covered[at] = lit < windows->size;
        }
    }
}

static void tile_take(void *user, const struct umbb_tile *tile)
{
    struct windows *windows = user;
    for (size_t block = 0; block < (size_t)(tile->size >> 3) * (size_t)(tile->size >> 3); block++) {
        for (size_t i = 0; i < 64 && tile->min_end[3][block] < windows->size; i++) {
            windows->covered_texels += tile->lit[64 * block + i] < windows->size;
        }
    }
    for (size_t w = 0; w < WINDOWS; w++) {
        window_take(windows, tile, w);
    }
}

static void windows_make(const struct bench_scene *scene, struct windows *windows)
{
    struct gen_rng rng = {SEED};
    memset(windows, 0, sizeof *windows);
    windows->size = (int32_t)1 << scene->frustum.log2_size;
    windows->covered = calloc(WINDOWS, (size_t)WINDOW * WINDOW);
    windows->lit = calloc(WINDOWS, (size_t)WINDOW * WINDOW * sizeof *windows->lit);
    if (windows->covered == NULL || windows->lit == NULL) {
        bench_fail("windows: out of memory");
    }
    for (size_t w = 0; w < WINDOWS; w++) {
        windows->x0[w] = gen_range(&rng, 0, windows->size - WINDOW);
        windows->y0[w] = gen_range(&rng, 0, windows->size - WINDOW);
    }
    bench_tiles(scene, 0, tile_take, windows);
}

/* Measures the CPU seconds of the depth stage of a whole map, for one layer, on one thread. */
static double raster_seconds(const struct bench_scene *scene)
{
    const struct umbb_casters casters = bench_casters(scene, 0);
    const struct umbb_depth_options options = {.tile_log2 = BENCH_TILE_LOG2, .threads = 1};
    struct umbb_depth depth;
    struct umbb_tile tile;
    struct umb_error error;
    bench_must(umbb_tile_init(&tile, BENCH_TILE_LOG2, 0, &error), &error, "tile");
    memset(tile.lit, 0, sizeof *tile.lit << (2 * BENCH_TILE_LOG2)); /* a bake's pages are warm */
    const double start = bench_cpu_s();
    bench_must(umbb_depth_raster_create(&casters, &options, &depth, &error), &error, "depth");
    for (int32_t y = 0; y < casters.size; y += tile.size) {
        for (int32_t x = 0; x < casters.size; x += tile.size) {
            tile.x0 = x;
            tile.y0 = y;
            bench_must(depth.begin(depth.state, 0, &tile, &error), &error, "tile");
            const int32_t blocks = tile.size / umbb_tile_block(&tile);
            for (int32_t b = 0; b < blocks * blocks; b++) {
                depth.block(depth.state, 0, 0, &tile, b % blocks, b / blocks);
            }
        }
    }
    const double seconds = bench_cpu_s() - start;
    depth.destroy(depth.state);
    umbb_tile_finish(&tile);
    return seconds;
}

/* Returns the CPU seconds that Embree would take for every covered texel, from its rate in the
 * windows. */
static double embree_seconds(const struct embree_peer *peer, const struct windows *windows,
                             float *depth)
{
    uint64_t rays = 0;
    const double start = bench_cpu_s();
    for (size_t w = 0; w < WINDOWS; w++) {
        const size_t at = w * WINDOW * WINDOW;
        (void)embree_depth_window(peer, windows->x0[w], windows->y0[w], WINDOW,
                                  windows->covered + at, depth + at);
    }
    const double seconds = bench_cpu_s() - start;
    for (size_t i = 0; i < (size_t)WINDOWS * WINDOW * WINDOW; i++) {
        rays += windows->covered[i];
    }
    return rays > 0 ? seconds / (double)rays * (double)windows->covered_texels : NAN;
}

/* Embree must have found the same surface; otherwise the race means nothing. */
static void depths_compare(const struct bench_scene *scene, const struct windows *windows,
                           const float *depth)
{
    uint64_t rays = 0, far_off = 0;
    for (size_t i = 0; i < (size_t)WINDOWS * WINDOW * WINDOW; i++) {
        if (windows->covered[i]) {
            rays++;
            /* lit = ceil(z - 0.5); a voxel of slack for the ray tracer's floats. */
            far_off += !(fabs((double)depth[i] - (double)windows->lit[i]) <= 1.5);
        }
    }
    bench_say("%s: depth of %llu texels compared with Embree, %llu differ by more than a voxel",
              scene->name, (unsigned long long)rays, (unsigned long long)far_off);
    if (far_off * 1000 > rays) {
        bench_fail("%s: the depths are not of one scene", scene->name);
    }
}

static void depth_race(const struct bench_scene *scene, const char *name)
{
    struct windows windows;
    struct bench_samples ratios = {0}, raster = {0}, embree = {0};
    windows_make(scene, &windows);
    struct embree_peer *peer = embree_peer_make(scene, 1);
    float *depth = calloc(WINDOWS, (size_t)WINDOW * WINDOW * sizeof *depth);
    if (depth == NULL) {
        bench_fail("windows: out of memory");
    }
    (void)bench_pin(0);
    (void)embree_seconds(peer, &windows, depth);
    depths_compare(scene, &windows, depth);
    while (ratios.count < BENCH_RUNS ||
           (ratios.count < BENCH_RUNS_MAX && bench_spread(&ratios) > BENCH_SPREAD)) {
        const double ours = raster_seconds(scene);
        const double theirs = embree_seconds(peer, &windows, depth);
        bench_add(&raster, ours);
        bench_add(&embree, theirs);
        bench_add(&ratios, theirs / ours);
    }
    bench_say("%s: depth %.2f s, Embree %.2f s for %llu covered texels", scene->name,
              bench_median(&raster), bench_median(&embree),
              (unsigned long long)windows.covered_texels);
    bench_row(BENCH, name, "depth_front_vs_embree8", "higher", &ratios);
    (void)bench_pin(BENCH_PIN_ALL);
    embree_peer_destroy(peer);
    free(depth);
    free(windows.covered);
    free(windows.lit);
}

/* An open scene has no undefined voxels, so both builders must make the same nodes. */
static void nodes_compare(const struct bench_asset *asset, const struct yardstick_2014 *yardstick)
{
    struct umb_asset_info info;
    uint64_t nodes = 0;
    umb_asset_get_info(asset->asset, &info);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        nodes += info.level_nodes[level];
    }
    if (nodes != yardstick->nodes + yardstick->bricks) {
        bench_fail("the asset has %llu nodes, the octree of 2014 %llu", (unsigned long long)nodes,
                   (unsigned long long)(yardstick->nodes + yardstick->bricks));
    }
}

static void sizes_report(const struct bench_scene *scene, const char *name, int closed_rule,
                         const struct bench_asset *asset)
{
    const struct yardstick_2014 yardstick = yardstick_2014_count(scene, closed_rule);
    if (!closed_rule) {
        nodes_compare(asset, &yardstick);
    }
    bench_row_counted(BENCH, name, "packed_vs_2014", "lower",
                      (double)asset->packed_bytes / (double)yardstick.bytes);
    bench_row_counted(BENCH, name, "mapped_vs_2014", "lower",
                      (double)asset->mapped_bytes / (double)yardstick.bytes);
}

/* Measures sizes and voxels of a scene under the open and the closed rule. */
static void rules_run(const struct bench_scene *scene, int thousands, int with_sizes)
{
    struct bench_asset assets[2];
    struct voxel_truth_result truths[2];
    const char *names[2];
    for (int rule = 0; rule < 2; rule++) {
        names[rule] = bench_text("%s-%dk-%s", scene->name, thousands, rule ? "closed" : "open");
        bench_asset_make(scene, rule, with_sizes, &assets[rule]);
        if (with_sizes) {
            sizes_report(scene, names[rule], rule, &assets[rule]);
        }
    }
    voxel_truth_compare(scene, assets, VOXEL_SAMPLES, truths);
    for (int rule = 0; rule < 2; rule++) {
        bench_row_counted(BENCH, names[rule], "wrong_voxels", "lower", (double)truths[rule].wrong);
        bench_asset_finish(&assets[rule]);
    }
}

/* The parts of a run and the figures that come from each; --only chooses a part by a figure. */
enum part {
    PART_RACE,
    PART_RULES,
    PART_DEPTH,
    PART_LAMP,
    PART_COUNT
};
static const struct {
    const char *name;
    enum part part;
} figures[] = {
    {"bake_vs_embree_rays", PART_RACE},
    {"threads2_vs_1", PART_RACE},
    {"peak_mib", PART_RACE},
    {"packed_vs_2014", PART_RULES},
    {"mapped_vs_2014", PART_RULES},
    {"wrong_voxels", PART_RULES},
    {"depth_front_vs_embree8", PART_DEPTH},
    {"point_vs_sun", PART_LAMP},
    {"point_face_vs_sun", PART_LAMP},
};
#define FIGURE_COUNT (sizeof figures / sizeof figures[0])

/* What a command line asks for. */
struct choice {
    const char *assets, *scene; /* NULL: none kept; all scenes */
    int full;
    int wanted[PART_COUNT];
};

static void scene_run(const char *scene_name, const struct choice *choice)
{
    const uint32_t log2_size = choice->full ? FULL_LOG2 : QUICK_LOG2;
    struct bench_scene scene;
    const int thousands = 1 << (log2_size - 10);
    const int is_terrain = strcmp(scene_name, "terrain") == 0;
    bench_scene_make(&scene, scene_name, log2_size, choice->assets);
    if (choice->full && choice->wanted[PART_RACE]) {
        bake_race(&scene, 1, bench_text("%s-%dk-closed", scene_name, thousands), is_terrain);
        if (is_terrain) {
            bake_race(&scene, 0, bench_text("%s-%dk-open", scene_name, thousands), 1);
        }
    }
    if (choice->wanted[PART_RULES]) {
        rules_run(&scene, thousands, log2_size == QUICK_LOG2);
    }
    if (choice->wanted[PART_DEPTH]) {
        depth_race(&scene, bench_text("%s-%dk", scene_name, thousands));
    }
    for (int rule = 0; !is_terrain && choice->wanted[PART_LAMP] && rule < 2; rule++) {
        lamp_race(&scene, rule,
                  bench_text("%s-%dk-%s", scene_name, thousands, rule ? "closed" : "open"));
    }
    bench_scene_finish(&scene);
}

/* Runs the closed terrain at the largest size, whose depths are never in memory as a whole. */
static void largest_run(const struct choice *choice)
{
    struct bench_scene scene;
    struct bench_asset pair[2] = {{0}};
    struct voxel_truth_result truths[2];
    bench_scene_make(&scene, "terrain", LARGEST_LOG2, choice->assets);
    if (choice->wanted[PART_RACE]) {
        bake_race(&scene, 1, "terrain-256k-closed", 0);
    }
    if (choice->wanted[PART_RULES]) {
        bench_asset_make(&scene, 1, 0, &pair[1]);
        voxel_truth_compare(&scene, pair, VOXEL_SAMPLES, truths);
        bench_row_counted(BENCH, "terrain-256k-closed", "wrong_voxels", "lower",
                          (double)truths[1].wrong);
        bench_asset_finish(&pair[1]);
    }
    bench_scene_finish(&scene);
}

static int choice_asks(const struct choice *choice, const char *scene)
{
    return choice->scene == NULL || strcmp(choice->scene, scene) == 0;
}

static void usage_print(FILE *to)
{
    fprintf(to, "usage: bench_bake [--size quick|full] [--scene terrain|city|largest]\n"
                "                  [--only FIGURE] [--assets DIR]\n"
                "  --size    quick: maps of 16384; full: of 65536 and 262144 (quick)\n"
                "  --scene   this scene alone; largest: the terrain at 262144, full only\n"
                "  --only    the part of the run alone that prints this figure, one of\n");
    for (size_t i = 0; i < FIGURE_COUNT; i++) {
        fprintf(to, "              %s\n", figures[i].name);
    }
    fprintf(to, "            depth_front_vs_embree8 bakes nothing\n"
                "  --assets  keep bakes in this empty folder for the other benchmarks\n");
}

/* Marks the part of the run that computes a figure, or all parts. */
static void parts_choose(struct choice *choice, const char *only)
{
    int found = only == NULL;
    for (size_t i = 0; i < FIGURE_COUNT; i++) {
        const int asked = only == NULL || strcmp(only, figures[i].name) == 0;
        choice->wanted[figures[i].part] |= asked;
        found |= asked;
    }
    if (!found) {
        bench_misuse("--only: '%.40s' is not a figure", only);
    }
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--size", "--scene", "--only", "--assets", NULL};
    static const char *const scenes[] = {"terrain", "city", "largest", NULL};
    struct choice choice = {0};
    bench_arguments(argc, argv, options, usage_print);
    const char *size = bench_size(argc, argv);
    choice.full = strcmp(size, "full") == 0;
    choice.assets = bench_option(argc, argv, "--assets", NULL);
    choice.scene = bench_choice(argc, argv, "--scene", scenes, NULL);
    parts_choose(&choice, bench_option(argc, argv, "--only", NULL));
    for (size_t i = 0; strcmp(scenes[i], "largest") != 0; i++) {
        if (choice_asks(&choice, scenes[i])) {
            scene_run(scenes[i], &choice);
        }
    }
    if (choice.full && choice_asks(&choice, "largest") &&
        (choice.wanted[PART_RACE] || choice.wanted[PART_RULES])) {
        largest_run(&choice);
    }
    bench_table(BENCH, size);
    return 0;
}
