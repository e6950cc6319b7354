/* SPDX-License-Identifier: Apache-2.0 */
/* See bench_nanovdb.h. */
#include "bench_nanovdb.h"

#include <stdlib.h>
#include <string.h>

#include "bench_machine.h"
#include "bench_report.h"
#include "format/asset_parts.h"
#include "study/nanovdb_peer.h"
#include "query/voxel_tree.h"
#include "umbrage/query.h"

#define BENCH "query"

struct race {
    const struct bench_points *points;
    struct umb_query query;
    struct umb_points batch;
    struct umb_answers answers;
    struct umbt_nanovdb_query peer;
    double ours_s, peer_s; /* of the last run */
    struct bench_samples ours, peers, ratios;
};

/* The state of a block of voxels, as the asset answers it. */
static int block_state(const void *user, uint32_t x, uint32_t y, uint32_t z, uint64_t slices[8])
{
    const struct umb__tree *tree = user;
    struct umb_volume_stats stats = {0};
    const struct umb__place place = umb__tree_locate(tree, 8 * x, 8 * y, 8 * z, &stats);
    if (place.brick == NULL) {
        return place.lit;
    }
    memcpy(slices, place.brick, 8 * sizeof *slices);
    return 2;
}

static struct umbt_nanovdb *peer_make(const struct bench_scene *scene,
                                      const struct bench_asset *asset)
{
    const struct umb__view *view = &asset->asset->view;
    const struct umb__tree tree = {.grid = view->grid + view->tops[0].first_cell,
                                   .nodes = view->nodes,
                                   .bricks = view->bricks,
                                   .log2_size = scene->frustum.log2_size,
                                   .grid_log2 = view->tops[0].grid_log2};
    struct umbt_nanovdb *peer = umbt_nanovdb_make(
        scene->frustum.log2_size, scene->frustum.world_to_voxel, block_state, &tree);
    if (peer == NULL) {
        bench_fail("NanoVDB: the grid could not be made");
    }
    return peer;
}

static void race_once(struct race *race)
{
    double start = bench_cpu_s();
    umb_query_run(&race->query, &race->batch, 0, race->points->count, &race->answers);
    race->ours_s = (bench_cpu_s() - start) / (double)race->points->count;
    start = bench_cpu_s();
    umbt_nanovdb_run(&race->peer);
    race->peer_s = (bench_cpu_s() - start) / (double)race->points->count;
}

/* Both ways must give the same bits; for one tap the faster of the two counts. */
static void race_tune(const char *name, struct race *race)
{
    const size_t count = race->points->count;
    race_once(race);
    const double first_s = race->peer_s;
    if (race->peer.taps == 1) {
        race->peer.way = UMBT_NANOVDB_ACCESSOR;
        race_once(race);
        race->peer.way = race->peer_s < first_s ? UMBT_NANOVDB_ACCESSOR : UMBT_NANOVDB_TREE;
    }
    if (memcmp(race->answers.values, race->peer.answers, count * sizeof(float)) != 0) {
        bench_fail("%s: the volume must answer as the asset it was made from", name);
    }
}

static void race_run(const char *name, struct race *race)
{
    const char *figure = race->peer.taps == 1                    ? "tap1_vs_nanovdb"
                         : race->peer.way == UMBT_NANOVDB_LEAVES ? "pcf9_vs_nanovdb_leaves"
                                                                 : "pcf9_vs_nanovdb";
    race_tune(name, race);
    while (race->ratios.count < BENCH_RUNS ||
           (race->ratios.count < BENCH_RUNS_MAX && bench_spread(&race->ratios) > BENCH_SPREAD)) {
        race_once(race);
        bench_add(&race->ours, race->ours_s);
        bench_add(&race->peers, race->peer_s);
        bench_add(&race->ratios, race->peer_s / race->ours_s);
    }
    bench_row(BENCH, name, figure, "higher", &race->ratios);
    bench_say("%s, %s: ns a point: ours %.1f, NanoVDB %.1f (way %d)", name, figure,
              1e9 * bench_median(&race->ours), 1e9 * bench_median(&race->peers),
              (int)race->peer.way);
}

static float *answers_make(size_t count)
{
    float *answers = calloc(count, sizeof *answers);
    if (answers == NULL) {
        bench_fail("%zu answers: out of memory", count);
    }
    return answers;
}

void bench_nanovdb(const char *name, const struct bench_scene *scene,
                   const struct bench_asset *asset, const struct bench_points *points)
{
    static const enum umbt_nanovdb_way ways[] = {UMBT_NANOVDB_TREE, UMBT_NANOVDB_ACCESSOR,
                                                 UMBT_NANOVDB_LEAVES};
    struct umbt_nanovdb *peer = peer_make(scene, asset);
    float *ours = answers_make(points->count), *theirs = answers_make(points->count);
    bench_say("%s: NanoVDB grid of %.1f MB", name, (double)umbt_nanovdb_bytes(peer) / 1e6);
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        const size_t t = i > 0; /* bench_taps: 1, 9, ... */
        const struct umb_query_settings settings = {
            .taps = (uint32_t)bench_taps[t], .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_F32};
        struct race race = {.points = points, .answers = {.values = ours}};
        struct umb_error error;
        bench_must(umb_query_prepare(asset->asset, &settings, &race.query, &error), &error,
                   "query");
        race.batch = (struct umb_points){
            .positions = points->at[t], .format = UMB_POINT_F32, .count = points->count};
        memcpy(race.batch.origin, scene->origin, sizeof race.batch.origin);
        race.peer = (struct umbt_nanovdb_query){.peer = peer,
                                                .points = points->at[t],
                                                .count = points->count,
                                                .taps = bench_taps[t],
                                                .way = ways[i],
                                                .answers = theirs};
        race_run(name, &race);
    }
    free(ours);
    free(theirs);
    umbt_nanovdb_destroy(peer);
}
