/* SPDX-License-Identifier: Apache-2.0 */
/* Whole bakes; see bake_race.h. */
#include "bake_race.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include "tool/threads.h"
#include "bake_frustum.h"
#include "bake/depth/depth.h"
#include "bench_machine.h"
#include "bench_report.h"
#include "common/sha256.h"
#include "embree_peer.h"

#define BENCH       "bake"
#define TILE_LOG2   11U /* two tiles are in memory at a time */
#define WINDOWS     512 /* two seconds of rays: a shorter moment says little */
#define WINDOW_LOG2 8U
#define WINDOW      (1 << WINDOW_LOG2)
#define SHARE_LOG2  12U
#define SEED        5U
#define RUNS        3

/* What one bake took. */
struct run {
    double cpu_s, wall_s, peak_mib;
    uint64_t packed_bytes;
};

static enum umb_status count_bytes(void *user, const void *bytes, size_t count)
{
    (void)bytes;
    *(uint64_t *)user += count;
    return UMB_OK;
}

/* From casters to an octree. */
static void octree_make(const struct bench_scene *scene, int closed_rule, unsigned threads,
                        struct umb__octree *octree)
{
    const struct umbb_casters casters = bench_casters(scene, closed_rule);
    const struct umbb_depth_options depth_options = {.tile_log2 = TILE_LOG2, .threads = threads};
    const struct umbb_bake_options options = {
        .log2_size = scene->frustum.log2_size,
        .tile_log2 = TILE_LOG2,
        .threads = threads,
        .closed_rule = closed_rule,
        .octree_max_bytes = SIZE_MAX,
    };
    struct umbb_depth depth;
    struct umb_error error;
    bench_must(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), &error, "depth");
    bench_must(bake_frustum(&depth, &options, octree, NULL, &error), &error, "bake");
    depth.destroy(depth.state);
}

static uint64_t octree_pack(const struct bench_scene *scene, int closed_rule, unsigned threads,
                            const struct umb__octree *octree)
{
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    char nothing[] = "";
    uint64_t bytes = 0;
    struct umb_light_info light = scene->light;
    struct umb_frustum_info frustum = scene->frustum;
    struct umbu_threads *jobs;
    frustum.closed = closed_rule;
    struct umb__content content = {
        .light_count = 1,
        .frustum_count = 1,
        .lights = &light,
        .frusta = &frustum,
        .bounds = scene->study.box,
        .plan = nothing,
        .settings = nothing,
        .notes = nothing,
    };
    memcpy(content.origin, scene->origin, sizeof content.origin);
    bench_must(umbu_threads_create(threads, &jobs, &error), &error, "threads");
    const struct umb_sink sink = {count_bytes, &bytes};
    const struct umb_workers workers = umbu_threads_workers(jobs);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = octree,
                                      .sha256 = &umbs_sha256,
                                      .sink = &sink,
                                      .workers = &workers};
    bench_must(umb__pack_run(&job, id, &error), &error, "pack");
    umbu_threads_destroy(jobs);
    return bytes;
}

static double resident_mib(void)
{
    long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file == NULL || fscanf(file, "%*s %lld", &pages) != 1) {
        bench_fail("/proc/self/statm: cannot be read");
    }
    (void)fclose(file);
    return (double)pages * (double)sysconf(_SC_PAGESIZE) / 1048576.0;
}

/* The task of a child process. */
struct task {
    const struct bench_scene *scene;
    int closed_rule;
    unsigned threads;
    struct run run;  /* of a bake */
    double embree_s; /* of rays */
};

static void bake_here(struct task *task)
{
    struct umb__octree octree;
    struct rusage usage;
    struct run *run = &task->run;
    const double before = resident_mib(), wall = bench_wall_s(), cpu = bench_cpu_s();
    octree_make(task->scene, task->closed_rule, task->threads, &octree);
    run->packed_bytes = octree_pack(task->scene, task->closed_rule, task->threads, &octree);
    run->cpu_s = bench_cpu_s() - cpu;
    run->wall_s = bench_wall_s() - wall;
    umb__octree_finish(&octree);
    getrusage(RUSAGE_SELF, &usage);
    run->peak_mib = (double)usage.ru_maxrss / 1024.0 - before;
}

/* Runs the task in a child process, so that no contestant inherits memory that another one has
 * touched. */
static void do_apart(void (*it)(struct task *task), struct task *task)
{
    int pipe_ends[2], status;
    (void)fflush(NULL);
    if (pipe(pipe_ends) != 0) {
        bench_fail("pipe: refused");
    }
    const pid_t child = fork();
    if (child == 0) {
        it(task);
        _exit(write(pipe_ends[1], task, sizeof *task) == (ssize_t)sizeof *task ? 0 : 1);
    }
    (void)close(pipe_ends[1]);
    if (child < 0 || read(pipe_ends[0], task, sizeof *task) != (ssize_t)sizeof *task ||
        waitpid(child, &status, 0) != child || status != 0) {
        bench_fail("%s: the child process failed", task->scene->name);
    }
    (void)close(pipe_ends[0]);
}

static struct run bake_apart(const struct bench_scene *scene, int closed_rule, unsigned threads)
{
    struct task task = {.scene = scene, .closed_rule = closed_rule, .threads = threads};
    do_apart(bake_here, &task);
    const struct run run = task.run;
    bench_say("%s %s at %u, threads %u: %.2f s CPU of the first, %.2f s wall, %.0f MiB, %llu bytes",
              scene->name, closed_rule ? "closed" : "open", 1U << scene->frustum.log2_size, threads,
              run.cpu_s, run.wall_s, run.peak_mib, (unsigned long long)run.packed_bytes);
    return run;
}

static void tile_draw(const struct umbb_depth *depth, struct umbb_tile *tile)
{
    struct umb_error error;
    const int32_t blocks = tile->size / umbb_tile_block(tile);
    bench_must(depth->begin(depth->state, 0, tile, &error), &error, "tile");
    for (int32_t b = 0; b < blocks * blocks; b++) {
        depth->block(depth->state, 0, 0, tile, b % blocks, b / blocks);
    }
}

/* Share of the map that something covers. */
static double covered_share(const char *name)
{
    struct bench_scene scene;
    struct umbb_depth depth;
    struct umbb_tile tile;
    struct umb_error error;
    const int32_t size = 1 << SHARE_LOG2;
    uint64_t covered = 0;
    bench_scene_make(&scene, name, SHARE_LOG2, NULL);
    const struct umbb_casters casters = bench_casters(&scene, 0);
    const struct umbb_depth_options options = {.tile_log2 = SHARE_LOG2, .threads = 1};
    bench_must(umbb_depth_raster_create(&casters, &options, &depth, &error), &error, "depth");
    bench_must(umbb_tile_init(&tile, SHARE_LOG2, 0, &error), &error, "tile");
    tile_draw(&depth, &tile);
    for (size_t block = 0; block < (size_t)(size >> 3) * (size_t)(size >> 3); block++) {
        for (size_t i = 0; i < 64 && tile.min_end[UMB_LEVEL_BRICK][block] < size; i++) {
            covered += tile.lit[64 * block + i] < size;
        }
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
    bench_scene_finish(&scene);
    return (double)covered / ((double)size * (double)size);
}

/* Fills a window's covered texels, row by row. */
static void window_cover(const struct umbb_depth *depth, struct umbb_tile *tile, int32_t size,
                         uint8_t *covered)
{
    tile_draw(depth, tile);
    for (int32_t i = 0; i < WINDOW * WINDOW; i++) {
        int32_t lit, end;
        bench_texel(tile, size, i % WINDOW, i / WINDOW, &lit, &end);
        covered[i] = lit < size;
    }
}

/* Returns the CPU seconds that Embree would take for every covered texel of the map. */
static void embree_here(struct task *task)
{
    const struct bench_scene *scene = task->scene;
    const struct umbb_casters casters = bench_casters(scene, 0);
    const struct umbb_depth_options options = {.tile_log2 = WINDOW_LOG2, .threads = 1};
    const double share = covered_share(scene->name);
    struct embree_peer *peer = embree_peer_make(scene, 1);
    struct gen_rng rng = {SEED};
    struct umbb_depth depth;
    struct umbb_tile tile;
    struct umb_error error;
    uint8_t *covered = calloc(WINDOW, WINDOW);
    float *depths = calloc((size_t)WINDOW * WINDOW, sizeof *depths);
    double seconds = 0.0;
    uint64_t rays = 0;
    if (covered == NULL || depths == NULL) {
        bench_fail("windows: out of memory");
    }
    bench_must(umbb_depth_raster_create(&casters, &options, &depth, &error), &error, "depth");
    bench_must(umbb_tile_init(&tile, WINDOW_LOG2, 0, &error), &error, "window");
    for (size_t w = 0; w < WINDOWS; w++) {
        tile.x0 = gen_range(&rng, 0, (casters.size >> WINDOW_LOG2) - 1) << WINDOW_LOG2;
        tile.y0 = gen_range(&rng, 0, (casters.size >> WINDOW_LOG2) - 1) << WINDOW_LOG2;
        window_cover(&depth, &tile, casters.size, covered);
        for (size_t i = 0; i < (size_t)WINDOW * WINDOW; i++) {
            rays += covered[i];
        }
        const double start = bench_cpu_s();
        (void)embree_depth_window(peer, tile.x0, tile.y0, WINDOW, covered, depths);
        seconds += bench_cpu_s() - start;
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
    embree_peer_destroy(peer);
    free(covered);
    free(depths);
    const double texels = share * (double)casters.size * (double)casters.size;
    task->embree_s = seconds / (double)rays * texels;
    bench_say("%s at %d: Embree %.1f Mrays/s, %.0f s for %.0f million covered texels", scene->name,
              (int)casters.size, 1e-6 * (double)rays / seconds, task->embree_s, 1e-6 * texels);
}

static double embree_apart(const struct bench_scene *scene)
{
    struct task task = {.scene = scene};
    do_apart(embree_here, &task);
    return task.embree_s;
}

void bake_race(const struct bench_scene *scene, int closed_rule, const char *name, int with_threads)
{
    struct bench_samples rays = {0}, threads = {0};
    double peak = 0.0, embree = embree_apart(scene);
    for (int i = 0; i < RUNS; i++) {
        const struct run one = bake_apart(scene, closed_rule, 1);
        peak = one.peak_mib > peak ? one.peak_mib : peak;
        if (with_threads) {
            bench_add(&threads, one.wall_s / bake_apart(scene, closed_rule, 2).wall_s);
        }
        /* Measures Embree before a bake and after it, and keeps the lower time. */
        const double embree_behind = embree_apart(scene);
        bench_add(&rays, fmin(embree, embree_behind) / one.cpu_s);
        embree = embree_behind;
    }
    bench_row(BENCH, name, "bake_vs_embree_rays", "higher", &rays);
    bench_row_counted(BENCH, name, "peak_mib", "lower", peak);
    if (with_threads) {
        bench_row(BENCH, name, "threads2_vs_1", "higher", &threads);
    }
}
