/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench-query races the product's queries with a 16-bit shadow map and with rays.
 *
 * All parties get the same float points, already moved off their surfaces, and write one float a
 * point. In a run each does all points, one right after the other, on one core, in CPU time of the
 * thread; a row is the median over the runs of theirs over ours. For each peer, the way that is
 * fastest for these points is found beforehand by trials. Rows named sm16 race the shadow map as it
 * is usually laid out, row by row; rows named sm16_tiled race 8 x 4 texels a cache line, which is
 * faster for wide windows, but which no renderer writes.
 */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench_arguments.h"
#include "bench_filters.h"
#include "bench_machine.h"
#include "bench_map16.h"
#include "bench_nanovdb.h"
#include "bench_points.h"
#include "bench_report.h"
#include "bench_scene.h"
#include "embree_peer.h"
#include "lines_floor.h"
#include "place_floor.h"
#include "umbrage/query.h"

#define BENCH         "query"
#define RANDOM_POINTS 262144U
#define RANDOM_RAYS   65536U /* rays are slow: their rate on the first of the points */

/* One scene, with everything made that its rows need. */
struct stage {
    struct bench_scene scene;
    struct umbt_map16 map; /* 16384 only */
    struct embree_peer *peer;
    struct bench_points gbuffer, overview, random;
    int has_map;
};

/* One case: an asset and a set of points. */
struct race {
    const char *name;
    const struct stage *stage;
    const struct bench_points *points;
    struct umb_query queries[3];
    struct umb_points batches[3];
    struct umb_query moving; /* one tap of points with normals, moved by the query */
    struct umb_points surface;
    struct umbt_map16_query maps[3], tiled[3];
    struct embree_query rays[2]; /* gbuffer: 8 coherent, 1; random: the best */
    size_t ray_races;
    float *answers, *other;
    struct bench_samples ours[3], map_ratios[3], map_s[3], ray_ratios[2], ray_s[2];
    struct bench_samples moving_s, moving_over_ray;
    struct bench_samples tiled_ratios[3], tiled_s[3];
    struct bench_samples floor_s, floor_over_ray, map_over_ray; /* a ray over them; one tap */
    struct lines_floor lines;                                   /* of random points */
    struct bench_samples lines_over_ray;
    unsigned lines_sum;
};

static void *floats_make(size_t count)
{
    float *floats = calloc(count, sizeof *floats);
    if (floats == NULL) {
        bench_fail("%zu answers: out of memory", count);
    }
    return floats;
}

static double ours_run(struct race *race, int t)
{
    struct umb_answers answers = {.values = race->answers};
    const double start = bench_cpu_s();
    umb_query_run(&race->queries[t], &race->batches[t], 0, race->points->count, &answers);
    return (bench_cpu_s() - start) / (double)race->points->count;
}

static double moving_run(struct race *race)
{
    struct umb_answers answers = {.values = race->answers};
    const double start = bench_cpu_s();
    umb_query_run(&race->moving, &race->surface, 0, race->points->count, &answers);
    return (bench_cpu_s() - start) / (double)race->points->count;
}

static double map_run(const struct race *race, const struct umbt_map16_query *map)
{
    const double start = bench_cpu_s();
    umbt_map16_run(map);
    return (bench_cpu_s() - start) / (double)race->points->count;
}

static double floor_run(struct race *race)
{
    const int wide = __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
    const double start = bench_cpu_s();
    (wide ? place_floor_avx512 : place_floor_avx2)(&race->queries[0], &race->batches[0],
                                                   race->answers);
    return (bench_cpu_s() - start) / (double)race->points->count;
}

static double lines_run(struct race *race)
{
    const double start = bench_cpu_s();
    race->lines_sum += lines_floor_read(&race->lines);
    return (bench_cpu_s() - start) / (double)race->points->count;
}

static double rays_run(struct race *race, size_t r)
{
    const double start = bench_cpu_s();
    embree_run(&race->rays[r]);
    return (bench_cpu_s() - start) / (double)race->rays[r].count;
}

/* Share of answers that differ. */
static double differing(const float *a, const float *b, size_t count)
{
    size_t different = 0;
    for (size_t i = 0; i < count; i++) {
        different += a[i] != b[i];
    }
    return (double)different / (double)count;
}

static void race_prepare(struct race *race, const struct bench_asset *asset)
{
    const struct stage *stage = race->stage;
    const struct bench_points *points = race->points;
    struct umb_error error;
    race->answers = floats_make(points->count);
    race->other = floats_make(points->count);
    for (int t = 0; t < 3; t++) {
        const struct umb_query_settings settings = {
            .taps = (uint32_t)bench_taps[t], .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_F32};
        bench_must(umb_query_prepare(asset->asset, &settings, &race->queries[t], &error), &error,
                   "query");
        race->batches[t] = (struct umb_points){
            .positions = points->at[t], .format = UMB_POINT_F32, .count = points->count};
        memcpy(race->batches[t].origin, stage->scene.origin, sizeof race->batches[t].origin);
        race->maps[t] = (struct umbt_map16_query){.map = &stage->map,
                                                  .points = points->at[t],
                                                  .count = points->count,
                                                  .taps = bench_taps[t],
                                                  .way = UMBT_MAP16_ROWS,
                                                  .answers = race->other};
        race->tiled[t] = race->maps[t];
        race->tiled[t].way = UMBT_MAP16_TILES;
    }
    const struct umb_query_settings moved = {.taps = 1, .format = UMB_ANSWER_F32};
    bench_must(umb_query_prepare(asset->asset, &moved, &race->moving, &error), &error, "query");
    race->surface = race->batches[0];
    race->surface.positions = points->surface;
    race->surface.normals = points->normals;
    for (size_t r = 0; r < race->ray_races; r++) {
        struct embree_query *rays = &race->rays[r];
        rays->peer = stage->peer;
        rays->points = points->at[0];
        rays->count =
            race->ray_races == 2 || points->count < RANDOM_RAYS ? points->count : RANDOM_RAYS;
        rays->answers = race->other;
        for (int k = 0; k < 3; k++) {
            rays->to_light[k] = (float)-stage->scene.light.direction[k];
        }
    }
}

/* Chooses the fastest way for one layout of the shadow map, and checks that its answers are those
 * of the product. */
static void map_tune(struct race *race, struct umbt_map16_query *map, int t, int closed_rule)
{
    const char *layout = map->way == UMBT_MAP16_TILES ? "tiles" : "rows";
    struct umbt_map16_query plain = *map;
    const double plain_s = umbt_map16_tune(&plain, UMBT_MAP16_PLAIN);
    const double seconds = umbt_map16_tune(map, map->way);
    if (map->way == UMBT_MAP16_ROWS && plain_s < seconds) {
        *map = plain; /* the same texels in the same places: plain C may win */
    }
    (void)ours_run(race, t);
    (void)map_run(race, map);
    const double share = differing(race->answers, race->other, race->points->count);
    bench_say("%s, %d taps: shadow map in %s, %u points ahead (plain C %.0f, by hand %.0f ns); "
              "%.4f %% of answers differ",
              race->name, bench_taps[t], layout, map->ahead, 1e9 * plain_s, 1e9 * seconds,
              100.0 * share);
    if (!closed_rule && share > 0.0) {
        bench_fail("%s: an open asset must answer as its shadow map does", race->name);
    }
}

/* Finds each peer's fastest way, and checks that all peers give the same answers. */
static void race_tune(struct race *race, int closed_rule)
{
    for (int t = 0; t < 3 && race->stage->has_map; t++) {
        map_tune(race, &race->maps[t], t, closed_rule);
        map_tune(race, &race->tiled[t], t, closed_rule);
    }
    if (race->ray_races == 2) {
        embree_tune(&race->rays[0], 1U << EMBREE_EIGHT | 1U << EMBREE_EIGHT_COHERENT);
        race->rays[1].way = EMBREE_ONE;
    } else {
        embree_tune(&race->rays[0], (1U << EMBREE_WAYS) - 1U);
    }
    (void)ours_run(race, 0);
    (void)rays_run(race, 0);
    bench_say("%s: rays by way %d; %.3f %% of answers differ", race->name, (int)race->rays[0].way,
              100.0 * differing(race->answers, race->other, race->rays[0].count));
}

static void race_once(struct race *race)
{
    double point_s = 0.0, map_point_s = 0.0;
    const double floor_s = floor_run(race);
    bench_add(&race->floor_s, floor_s);
    for (int t = 0; t < 3; t++) {
        const double ours = ours_run(race, t);
        bench_add(&race->ours[t], ours);
        point_s = t == 0 ? ours : point_s;
        if (race->stage->has_map) {
            const double map = map_run(race, &race->maps[t]);
            map_point_s = t == 0 ? map : map_point_s;
            const double tiled = map_run(race, &race->tiled[t]);
            bench_add(&race->map_s[t], map);
            bench_add(&race->map_ratios[t], map / ours);
            bench_add(&race->tiled_s[t], tiled);
            bench_add(&race->tiled_ratios[t], tiled / ours);
        }
        for (size_t r = 0; t == 0 && r < race->ray_races; r++) {
            const double rays = rays_run(race, r);
            bench_add(&race->ray_s[r], rays);
            bench_add(&race->ray_ratios[r], rays / point_s);
            if (r == 0) {
                const double moving = moving_run(race);
                bench_add(&race->moving_s, moving);
                bench_add(&race->moving_over_ray, rays / moving);
                bench_add(&race->floor_over_ray, rays / floor_s);
                if (race->lines.lines != NULL) {
                    bench_add(&race->lines_over_ray, rays / lines_run(race));
                }
                bench_add(&race->map_over_ray, race->stage->has_map ? rays / map_point_s : 0.0);
            }
        }
    }
}

static int race_is_noisy(const struct race *race)
{
    int noisy = bench_spread(&race->ray_ratios[0]) > BENCH_SPREAD;
    for (int t = 0; t < 3; t++) {
        noisy |= bench_spread(&race->map_ratios[t]) > BENCH_SPREAD;
    }
    return noisy;
}

/* Measures the limits of our side: the time if the points were answered by a shadow map, and the
 * time without any look-up. */
static void limits_report(const struct race *race)
{
    const char *rays = race->ray_races == 2 ? "occluded8" : "best_embree";
    if (race->stage->has_map) {
        bench_row(BENCH, race->name, bench_text("sm16_vs_%s", rays), "higher", &race->map_over_ray);
    }
    bench_row(BENCH, race->name, bench_text("floor_vs_%s", rays), "higher", &race->floor_over_ray);
    if (race->lines.lines != NULL) {
        bench_say("%s: %.2f lines a point (%u)", race->name,
                  (double)race->lines.count / (double)race->points->count, race->lines_sum & 1);
        bench_row(BENCH, race->name, bench_text("lines_vs_%s", rays), "higher",
                  &race->lines_over_ray);
    }
}

static void race_report(const struct race *race)
{
    limits_report(race);
    bench_row(BENCH, race->name,
              race->ray_races == 2 ? "tap1_normals_vs_occluded8" : "tap1_normals_vs_best_embree",
              "higher", &race->moving_over_ray);
    if (race->ray_races == 2) {
        bench_row(BENCH, race->name, "tap1_vs_occluded8", "higher", &race->ray_ratios[0]);
        if (race->stage->has_map) {
            bench_row(BENCH, race->name, "tap1_vs_occluded1", "higher", &race->ray_ratios[1]);
            bench_row(BENCH, race->name, "tap1_vs_sm16", "higher", &race->map_ratios[0]);
        }
    } else {
        bench_row(BENCH, race->name, "tap1_vs_best_embree", "higher", &race->ray_ratios[0]);
    }
    if (race->stage->has_map) {
        bench_row(BENCH, race->name, "pcf9_vs_sm16", "higher", &race->map_ratios[1]);
        bench_row(BENCH, race->name, "pcf17_vs_sm16", "higher", &race->map_ratios[2]);
        bench_row(BENCH, race->name, "pcf9_vs_sm16_tiled", "higher", &race->tiled_ratios[1]);
        bench_row(BENCH, race->name, "pcf17_vs_sm16_tiled", "higher", &race->tiled_ratios[2]);
    }
    bench_say("%s: ns a point: ours %.1f %.1f %.1f, shadow map %.1f %.1f %.1f, tiled %.1f %.1f "
              "%.1f, rays %.0f %.0f, floor %.1f, with normals %.1f",
              race->name, 1e9 * bench_median(&race->ours[0]), 1e9 * bench_median(&race->ours[1]),
              1e9 * bench_median(&race->ours[2]), 1e9 * bench_median(&race->map_s[0]),
              1e9 * bench_median(&race->map_s[1]), 1e9 * bench_median(&race->map_s[2]),
              1e9 * bench_median(&race->tiled_s[0]), 1e9 * bench_median(&race->tiled_s[1]),
              1e9 * bench_median(&race->tiled_s[2]), 1e9 * bench_median(&race->ray_s[0]),
              1e9 * bench_median(&race->ray_s[1]), 1e9 * bench_median(&race->floor_s),
              1e9 * bench_median(&race->moving_s));
}

/* Half of a batch, answered by a separate thread. */
struct half {
    const struct race *race;
    unsigned core;
    size_t first, count;
    pthread_barrier_t *ready; /* all threads are on their cores */
    double start, end;        /* wall clock */
};

static void *half_run(void *user)
{
    struct half *half = user;
    struct umb_answers answers = {.values = half->race->answers};
    (void)bench_pin(half->core);
    (void)pthread_barrier_wait(half->ready);
    half->start = bench_wall_s();
    umb_query_run(&half->race->queries[0], &half->race->batches[0], half->first, half->count,
                  &answers);
    half->end = bench_wall_s();
    return NULL;
}

/* Returns the wall-clock seconds that `threads` threads (1 or 2), each on a core of its own, take
 * for the batch, from the start of the first until the end of the last. */
static double threads_run(const struct race *race, unsigned threads)
{
    const size_t count = race->points->count, middle = count / 2 / 16 * 16;
    pthread_barrier_t ready;
    struct half halves[2] = {{race, 0, 0, threads == 2 ? middle : count, &ready, 0, 0},
                             {race, 1, middle, count - middle, &ready, 0, 0}};
    pthread_t ids[2];
    if (pthread_barrier_init(&ready, NULL, threads) != 0) {
        bench_fail("no barrier");
    }
    for (unsigned t = 0; t < threads; t++) {
        if (pthread_create(&ids[t], NULL, half_run, &halves[t]) != 0) {
            bench_fail("no thread");
        }
    }
    for (unsigned t = 0; t < threads; t++) {
        (void)pthread_join(ids[t], NULL);
    }
    (void)pthread_barrier_destroy(&ready);
    const struct half *other = &halves[threads - 1];
    return fmax(halves[0].end, other->end) - fmin(halves[0].start, other->start);
}

static void threads_report(const struct race *race)
{
    struct bench_samples ratios = {0};
    while (ratios.count < BENCH_RUNS_MAX) {
        const double one = threads_run(race, 1);
        bench_add(&ratios, one / threads_run(race, 2));
    }
    bench_row(BENCH, race->name, "threads2_vs_1", "higher", &ratios);
}

/* Measures the cache lines that random points touch: the time to read those lines and do nothing
 * else. */
static void lines_prepare(struct race *race)
{
    race->lines.lines = malloc(race->points->count * LINES_FLOOR_MAX * sizeof *race->lines.lines);
    if (race->lines.lines == NULL) {
        bench_fail("lines of %zu points: out of memory", race->points->count);
    }
    lines_floor_note(&race->queries[0], &race->batches[0], &race->lines);
}

static void race_run(const struct stage *stage, const struct bench_asset *asset, int closed_rule,
                     const struct bench_points *points, int thousands)
{
    const int gbuffer = strncmp(points->name, "gbuffer", 7) == 0;
    struct race race = {.stage = stage, .points = points, .ray_races = gbuffer ? 2 : 1};
    race.name = bench_text("%s-%dk-%s-%s", stage->scene.name, thousands,
                           closed_rule ? "closed" : "open", points->name);
    race_prepare(&race, asset);
    race_tune(&race, closed_rule);
    if (!gbuffer) {
        lines_prepare(&race);
    }
    while (race.ours[0].count < BENCH_RUNS ||
           (race.ours[0].count < BENCH_RUNS_MAX && race_is_noisy(&race))) {
        race_once(&race);
    }
    race_report(&race);
    bench_filters_race(race.name, &stage->scene, asset, points);
    free(race.lines.lines);
    free(race.answers);
    free(race.other);
}

static void stage_make(struct stage *stage, const char *name, uint32_t log2_size,
                       const char *assets)
{
    memset(stage, 0, sizeof *stage);
    bench_scene_make(&stage->scene, name, log2_size, assets);
    bench_scene_trace(&stage->scene);
    bench_points_gbuffer(&stage->scene, BENCH_VIEW_INSIDE, &stage->gbuffer);
    bench_points_gbuffer(&stage->scene, BENCH_VIEW_OVERVIEW, &stage->overview);
    bench_points_random(&stage->scene, RANDOM_POINTS, &stage->random);
    umbr_rays_destroy(stage->scene.study.rays); /* the peer builds its own */
    stage->scene.study.rays = NULL;
    stage->peer = embree_peer_make(&stage->scene, 0);
    stage->has_map = log2_size <= 14;
    if (stage->has_map) {
        bench_map16_make(&stage->map, &stage->scene);
    }
}

static void stage_finish(struct stage *stage)
{
    bench_points_finish(&stage->gbuffer);
    bench_points_finish(&stage->overview);
    bench_points_finish(&stage->random);
    embree_peer_destroy(stage->peer);
    umbt_map16_finish(&stage->map);
    bench_scene_finish(&stage->scene);
}

/* In: only: name of the one set of points to race, or NULL for all. */
static void scene_run(const char *name, uint32_t log2_size, const char *assets, const char *only)
{
    struct stage stage;
    const int thousands = 1 << (log2_size - 10);
    const struct bench_points *const sets[] = {&stage.gbuffer, &stage.overview, &stage.random};
    stage_make(&stage, name, log2_size, assets);
    for (int closed_rule = 1; closed_rule >= (log2_size > 14); closed_rule--) {
        struct bench_asset asset;
        bench_asset_make(&stage.scene, closed_rule, 0, &asset);
        (void)bench_pin(0);
        for (size_t i = 0; i < (stage.has_map ? 3U : 2U); i++) {
            if (only == NULL || strcmp(only, sets[i]->name) == 0) {
                race_run(&stage, &asset, closed_rule, sets[i], thousands);
            }
        }
        (void)bench_pin(BENCH_PIN_ALL);
        bench_asset_finish(&asset);
    }
    stage_finish(&stage);
}

/* The rows of a sparse volume, at 2048 voxels a side. */
static void volume_run(const char *name, const char *assets)
{
#ifdef UMB_BENCH_NANOVDB
    struct bench_scene scene;
    struct bench_points random;
    bench_scene_make(&scene, name, 11, assets);
    bench_scene_trace(&scene);
    bench_points_random(&scene, RANDOM_POINTS, &random);
    for (int closed_rule = 1; closed_rule >= 0; closed_rule--) {
        struct bench_asset asset;
        bench_asset_make(&scene, closed_rule, 0, &asset);
        (void)bench_pin(0);
        bench_nanovdb(bench_text("%s-2k-%s-random", name, closed_rule ? "closed" : "open"), &scene,
                      &asset, &random);
        (void)bench_pin(BENCH_PIN_ALL);
        bench_asset_finish(&asset);
    }
    bench_points_finish(&random);
    bench_scene_finish(&scene);
#else
    (void)assets;
    bench_say("skipped: %s-2k against NanoVDB: libnanovdb-dev is not installed", name);
#endif
}

/* The row of two threads, at 16384 voxels a side. */
static void threads_race(const char *name, const char *assets)
{
    struct stage stage = {.peer = NULL};
    struct bench_asset asset;
    bench_scene_make(&stage.scene, name, 14, assets);
    bench_scene_trace(&stage.scene);
    bench_points_random(&stage.scene, RANDOM_POINTS, &stage.random);
    bench_asset_make(&stage.scene, 0, 0, &asset);
    struct race race = {.stage = &stage, .points = &stage.random};
    race.name = bench_text("%s-16k-open-random", name);
    race_prepare(&race, &asset);
    threads_report(&race);
    free(race.answers);
    free(race.other);
    bench_asset_finish(&asset);
    bench_points_finish(&stage.random);
    bench_scene_finish(&stage.scene);
}

static void usage_print(FILE *to)
{
    fputs("usage: bench_query [--size quick|full] [--scene terrain|city]\n"
          "                   [--points gbuffer|gbuffer-overview|random] [--assets DIR]\n"
          "  --size    quick: assets of 16384 voxels a side; full: of 65536, two threads against\n"
          "            one, and a sparse volume as peer (quick)\n"
          "  --scene   this scene alone\n"
          "  --points  this set of points alone; nothing of threads and of the volume\n"
          "  --assets  read and keep bakes in this folder, which other benchmarks share\n",
          to);
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--size", "--scene", "--points", "--assets", NULL};
    static const char *const scenes[] = {"terrain", "city", NULL};
    static const char *const sets[] = {"gbuffer", "gbuffer-overview", "random", NULL};
    bench_arguments(argc, argv, options, usage_print);
    const char *size = bench_size(argc, argv);
    const char *assets = bench_option(argc, argv, "--assets", NULL);
    const int full = strcmp(size, "full") == 0;
    const char *only = bench_choice(argc, argv, "--scene", scenes, NULL);
    const char *points = bench_choice(argc, argv, "--points", sets, NULL);
    for (size_t i = 0; scenes[i] != NULL; i++) {
        if (only == NULL || strcmp(only, scenes[i]) == 0) {
            scene_run(scenes[i], full ? 16 : 14, assets, points);
            if (full && points == NULL) {
                volume_run(scenes[i], assets);
                threads_race(scenes[i], assets);
            }
        }
    }
    bench_table(BENCH, size);
    return 0;
}
