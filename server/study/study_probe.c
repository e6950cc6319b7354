/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the peers, and prepares and queries one setting; see study_probe.h. */
#include "study/study_probe.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "study/study_math.h"
#include "tool/clock.h"
#include "umbrage/volume.h"

#define MAP_LOG2_MAX    13 /* 8192 texels a side: 128 MiB */
#define VOLUME_LOG2_MAX 12 /* greatest log2_size of nanovdb_peer.h */
#define DERIVED_QUICK   1024U
#define DERIVED_FULL    2048U
#define BIAS_CLEARS     (65.0 / 64.0)
#define AHEAD           16U /* prefetch distance in points if there are too few for tuning */
#define TUNE_POINTS     256U

const char *const umbt_study_method_names[UMBT_STUDY_METHODS] = {
    "dag", "tent", "footprint", "penumbra", "depth map", "nanovdb", "derived"};

/* ---- samples ---- */

static int faces_light(const struct umbt_study_points *points, size_t i)
{
    double normal[3];
    umbt_widen(points->normals[i], normal);
    return umb__dot(normal, normal) == 0.0 || umb__dot(normal, points->to_light) > 0.0;
}

static enum umb_status facing_gather(const struct umbt_study *study, struct umbt_peers *peers,
                                     struct umb_error *error)
{
    const struct umbt_study_points *points = &study->points;
    peers->rank = calloc(points->count + 1, sizeof *peers->rank);
    peers->positions = calloc(points->count, sizeof *peers->positions);
    peers->normals = calloc(points->count, sizeof *peers->normals);
    if (peers->rank == NULL || peers->positions == NULL || peers->normals == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu samples do not fit in memory", points->count);
    }
    for (size_t i = 0; i < points->count; i++) {
        peers->rank[i] = (uint32_t)peers->facing_count;
        if (faces_light(points, i)) {
            memcpy(peers->positions[peers->facing_count], points->positions[i],
                   sizeof points->positions[i]);
            memcpy(peers->normals[peers->facing_count], points->normals[i],
                   sizeof points->normals[i]);
            peers->facing_count++;
        }
    }
    peers->rank[points->count] = (uint32_t)peers->facing_count;
    return UMB_OK;
}

/* Moves the facing samples off their surface for a filter of `taps`, relative to the asset's
 * origin. Returns float[3 * facing_count] for free(); NULL if out of memory. */
static float *moved_make(const struct umbt_study *study, const struct umbt_peers *peers,
                         const struct umbt_study_bake *bake, uint32_t taps)
{
    const struct umb_frustum_info *frustum = umbt_study_frustum(bake);
    const double(*step)[3] = frustum->voxel_step;
    struct umbt_truth truth =
        umbt_truth_of(&study->common.scene, study->points.to_light, bake->info.origin, frustum);
    truth.settings.taps = taps;
    /* Reach without a normal: that of (1,1,1) / sqrt(3) in voxels. */
    const double no_normal =
        0.5 / sqrt(3.0) *
        ((double)taps * (umb__length(step[0]) + umb__length(step[1])) + umb__length(step[2]));
    float(*moved)[3] = malloc(peers->facing_count * sizeof *moved + 16);
    for (size_t i = 0; moved != NULL && i < peers->facing_count; i++) {
        double normal[3], to[3];
        umbt_widen(peers->normals[i], normal);
        if (umbt_normalize(normal) > 0.0) {
            double at[3], way[3];
            umbt_truth_look_up(&truth, peers->positions[i], normal, at);
            umb__subtract(at, peers->positions[i], way);
            umbt_along(peers->positions[i], BIAS_CLEARS, way, to);
        } else {
            umbt_along(peers->positions[i], BIAS_CLEARS * no_normal, study->points.to_light, to);
        }
        for (int k = 0; k < 3; k++) {
            moved[i][k] = (float)(to[k] - bake->info.origin[k]);
        }
    }
    return moved != NULL ? moved[0] : NULL;
}

/* ---- the shadow map, from the columns of an open asset ---- */

/* Columns of eight rows at a time. */
struct columns {
    const struct umbt_study_bake *bake;
    struct umb_volume volume;
    struct umbt_map16 *map;
};

/* Fills one block of 8 x 8 columns by a query at the centres of their texels on the first slice. */
static void block_fill(const struct columns *columns, uint32_t x, uint32_t y)
{
    const struct umb_frustum_info *frustum = umbt_study_frustum(columns->bake);
    struct umb_column_answer found[64];
    double at[64][3];
    int32_t lit[64];
    for (uint32_t i = 0; i < 64; i++) {
        const double voxel[3] = {x + i % 8 + 0.5, y + i / 8 + 0.5, 0.5};
        for (int k = 0; k < 3; k++) {
            at[i][k] = 0.0;
            for (int axis = 0; axis < 3; axis++) {
                at[i][k] +=
                    (voxel[axis] - frustum->world_to_voxel[axis][3]) * frustum->voxel_step[axis][k];
            }
        }
    }
    struct umb_points points = {.positions = at, .format = UMB_POINT_F64, .count = 64};
    memcpy(points.origin, columns->bake->info.origin, sizeof points.origin);
    struct umb_column_answers answers = {.columns = found};
    umb_volume_columns(&columns->volume, &points, 0, 64, &answers);
    for (int i = 0; i < 64; i++) {
        lit[i] = (int32_t)found[i].lit;
    }
    umbt_map16_put(columns->map, x, y, lit);
}

static void row_fill(void *user, size_t row)
{
    const struct columns *columns = user;
    for (uint32_t x = 0; x < (uint32_t)columns->map->size; x += 8) {
        block_fill(columns, x, 8 * (uint32_t)row);
    }
}

static enum umb_status map_fill(const struct umbt_study *study, const struct umbt_study_bake *bake,
                                struct umbt_map16 *map, struct umb_error *error)
{
    struct columns columns = {.bake = bake, .map = map};
    UMB__TRY(umb_volume_prepare(bake->asset, 0, &columns.volume, error));
    UMB__TRY(umb_volume_check_parallel(&columns.volume, error));
    UMB__TRY(umb_volume_check_columns(&columns.volume, error));
    return umbu_range_each(study->common.threads, (size_t)map->size / 8, 4, row_fill, &columns,
                           error);
}

/* Keeps the layout that is faster for windows, and frees the other. */
static enum umb_status map_tune(const struct umbt_study *study, const struct umbt_peers *peers,
                                struct umbt_peer *peer, struct umb_error *error)
{
    const size_t view = peers->rank[study->points.first[UMBT_STUDY_BORDER]];
    float *moved =
        moved_make(study, peers, &study->bakes[peer->setting.bake], UMBT_PEER_DERIVED_TAPS);
    float *answers = malloc((view + 1) * sizeof *answers);
    double best_s = INFINITY;
    for (int way = 0; moved != NULL && answers != NULL && way < UMBT_MAP16_WAYS; way++) {
        struct umbt_map16_query query = {.map = &peer->map,
                                         .points = moved,
                                         .count = view,
                                         .taps = UMBT_PEER_DERIVED_TAPS,
                                         .answers = answers};
        const double seconds = umbt_map16_tune(&query, (enum umbt_map16_way)way);
        if (seconds < best_s) {
            best_s = seconds;
            peer->way = (enum umbt_map16_way)way;
        }
    }
    const int fits = moved != NULL && answers != NULL;
    free(moved);
    free(answers);
    return fits ? UMB_OK
                : umb_fail(error, UMB_E_NO_MEMORY, "%zu samples do not fit in memory", view);
}

/* ---- the sparse volume, from the map's heights ---- */

/* Least and largest `lit` of each block of 8 x 8 columns. */
struct heights {
    const struct umbt_map16 *map;
    uint16_t (*range)[2]; /* [side * side] */
    uint32_t side;        /* blocks */
};

static uint16_t height_at(const struct heights *heights, uint32_t x, uint32_t y)
{
    return heights->map
        ->rows[((size_t)y + UMBT_MAP16_PAD) * (size_t)heights->map->side + x + UMBT_MAP16_PAD];
}

static int heights_make(const struct umbt_map16 *map, struct heights *heights)
{
    heights->map = map;
    heights->side = (uint32_t)map->size / 8;
    const size_t count = (size_t)heights->side * heights->side;
    heights->range = malloc(count * sizeof *heights->range);
    for (size_t block = 0; heights->range != NULL && block < count; block++) {
        uint16_t low = UINT16_MAX, high = 0;
        for (uint32_t i = 0; i < 64; i++) {
            const uint16_t lit = height_at(heights, 8 * (uint32_t)(block % heights->side) + i % 8,
                                           8 * (uint32_t)(block / heights->side) + i / 8);
            low = lit < low ? lit : low;
            high = lit > high ? lit : high;
        }
        heights->range[block][0] = low;
        heights->range[block][1] = high;
    }
    return heights->range != NULL;
}

static int block_state(const void *user, uint32_t x, uint32_t y, uint32_t z, uint64_t slices[8])
{
    const struct heights *heights = user;
    const uint16_t *range = heights->range[(size_t)y * heights->side + x];
    if (8 * z + 8 <= range[0] || 8 * z >= range[1]) {
        return 8 * z + 8 <= range[0];
    }
    memset(slices, 0, 8 * sizeof *slices);
    for (uint32_t i = 0; i < 64; i++) {
        const uint32_t lit = height_at(heights, 8 * x + i % 8, 8 * y + i / 8);
        for (uint32_t slice = 0; slice < 8; slice++) {
            slices[slice] |= (uint64_t)(8 * z + slice < lit) << i;
        }
    }
    return 2;
}

/* Makes a volume from a map's heights; the map still has its rows. */
static enum umb_status volume_add(const struct umbt_study *study, struct umbt_peers *peers,
                                  const struct umbt_peer *map, struct umb_error *error)
{
    struct umbt_peer *peer = &peers->list[peers->count];
    const struct umbt_study_bake *bake = &study->bakes[map->setting.bake];
    struct heights heights;
    *peer = (struct umbt_peer){.setting = {.method = UMBT_STUDY_NANOVDB,
                                           .bake = map->setting.bake,
                                           .name = umbt_study_method_names[UMBT_STUDY_NANOVDB]}};
    if (heights_make(&map->map, &heights)) {
        peer->volume =
            umbt_nanovdb_make(umbt_study_frustum(bake)->log2_size,
                              umbt_study_frustum(bake)->world_to_voxel, block_state, &heights);
        free(heights.range);
    }
    if (peer->volume == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%s as a NanoVDB grid does not fit in memory",
                        bake->name);
    }
    peer->setting.bytes = umbt_nanovdb_bytes(peer->volume);
    peers->count++;
    return UMB_OK;
}

/* Makes the shadow map of a resolution, and its volume. */
static enum umb_status maps_add(const struct umbt_study *study, struct umbt_peers *peers,
                                uint32_t bake, struct umb_error *error)
{
    struct umbt_peer *peer = &peers->list[peers->count];
    const struct umb_frustum_info *frustum = umbt_study_frustum(&study->bakes[bake]);
    *peer = (struct umbt_peer){.setting = {.method = UMBT_STUDY_DEPTH_MAP,
                                           .bake = bake,
                                           .name = umbt_study_method_names[UMBT_STUDY_DEPTH_MAP]}};
    UMB__TRY(umbt_map16_init(&peer->map, frustum->log2_size, frustum->world_to_voxel, error));
    peers->count++;
    UMB__TRY(map_fill(study, &study->bakes[bake], &peer->map, error));
    UMB__TRY(map_tune(study, peers, peer, error));
    if (umbt_nanovdb_is_built() && frustum->log2_size <= VOLUME_LOG2_MAX) {
        UMB__TRY(volume_add(study, peers, peer, error));
    }
    umbt_map16_drop(&peer->map, peer->way != UMBT_MAP16_TILES);
    peer->setting.bytes = umbt_map16_bytes(&peer->map);
    return UMB_OK;
}

/* ---- maps for GPUs ---- */

static enum umb_status derived_add(const struct umbt_study *study, struct umbt_peers *peers,
                                   uint32_t bake, struct umb_error *error)
{
    static const struct {
        const char *name;
        enum umb_map_technique technique;
    } rows[] = {{"derived pcf", UMB_MAP_PCF},
                {"derived vsm", UMB_MAP_VSM},
                {"derived esm", UMB_MAP_ESM},
                {"derived evsm", UMB_MAP_EVSM},
                {"derived msm", UMB_MAP_MSM}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct umbt_peer *peer = &peers->list[peers->count];
        *peer = (struct umbt_peer){
            .setting = {.method = UMBT_STUDY_DERIVED, .bake = bake, .name = rows[i].name}};
        const struct umb_derive_settings settings = {
            .width = study->bakes[bake].resolution,
            .height = study->bakes[bake].resolution,
            .map = {.technique = rows[i].technique,
                    .blur = rows[i].technique == UMB_MAP_PCF ? 0 : UMBT_PEER_DERIVED_TAPS},
        };
        struct umb_map_info info;
        const double start = umbu_thread_cpu_s();
        UMB__TRY(umb_derive(study->bakes[bake].asset, &settings, NULL, &peer->derived, error));
        peer->setting.build_s = umbu_thread_cpu_s() - start;
        umb_map_get_info(peer->derived->maps[0], &info);
        peer->setting.bytes = info.bytes;
        peers->count++;
    }
    return UMB_OK;
}

/* ---- all ---- */

static void say_missing(struct umbt_study *study)
{
    study->missing = "";
    if (study->points.lamp != NULL) {
        study->missing = "The study knows the plain shadow map, NanoVDB, the maps for GPUs, the "
                         "shadow maps of the literature and the aliasing picture of directional "
                         "lights only: none of them was measured for this lamp. umbrage "
                         "techniques measures maps of lamps.";
    } else if (!umbt_map16_supported()) {
        study->missing = "The plain shadow map and NanoVDB were not measured: no AVX2.";
    } else if (!umbt_nanovdb_is_built()) {
        study->missing =
            "NanoVDB was not measured: umbrage-study was built without libnanovdb-dev.";
    }
}

/* Returns the resolution of derived maps: usual for GPUs, below the highest of the study. */
static uint32_t derived_resolution(const struct umbt_study_options *options)
{
    uint32_t resolution = options->quick ? DERIVED_QUICK : DERIVED_FULL;
    while (resolution > 512 && resolution >= options->max_resolution) {
        resolution /= 2;
    }
    return resolution;
}

/* Peers of a resolution: a map, a volume, five derived maps. */
#define PEERS_OF_RESOLUTION 7

static enum umb_status resolutions_add(const struct umbt_study *study, struct umbt_peers *peers,
                                       struct umb_error *error)
{
    const uint32_t derived = derived_resolution(&study->options);
    for (uint32_t b = 0; b < study->bake_count; b++) {
        const struct umbt_study_bake *bake = &study->bakes[b];
        if (bake->asset == NULL || umbt_study_is_closed(bake) ||
            peers->count + PEERS_OF_RESOLUTION > UMBT_PEERS_MAX) {
            continue;
        }
        if (umbt_map16_supported() && umbt_study_frustum(bake)->log2_size <= MAP_LOG2_MAX) {
            UMB__TRY(maps_add(study, peers, b, error));
        }
        if (bake->resolution == derived) {
            UMB__TRY(derived_add(study, peers, b, error));
        }
    }
    return UMB_OK;
}

enum umb_status umbt_peers_make(struct umbt_study *study, struct umbt_peers *peers,
                                struct umb_error *error)
{
    memset(peers, 0, sizeof *peers);
    say_missing(study);
    if (study->points.lamp != NULL) {
        return UMB_OK;
    }
    if (!study->common.quiet) {
        fprintf(stderr, "umbrage study: shadow maps and volumes of the same resolutions\n");
    }
    UMB__TRY(facing_gather(study, peers, error));
    return resolutions_add(study, peers, error);
}

void umbt_peers_finish(struct umbt_peers *peers)
{
    for (uint32_t i = 0; i < peers->count; i++) {
        umbt_map16_finish(&peers->list[i].map);
        umbt_nanovdb_destroy(peers->list[i].volume);
        umb_derived_destroy(peers->list[i].derived);
    }
    free(peers->rank);
    free(peers->positions);
    free(peers->normals);
    memset(peers, 0, sizeof *peers);
}

/* ---- probes ---- */

void umbt_study_normal(const struct umbt_study_points *points, size_t i, double normal[3])
{
    umbt_widen(points->normals[i], normal);
    (void)umbt_normalize(normal);
}

static void asset_run(const struct umbt_probe *probe, size_t first, size_t count, float *values)
{
    const struct umbt_study_points *samples = &probe->study->points;
    const struct umb_points points =
        umbt_points_at(samples->positions[first], samples->normals[first], count);
    struct umb_answers answers = {.values = values};
    umb_query_run(&probe->query, &points, 0, count, &answers);
}

static void peer_run(const struct umbt_probe *probe, size_t first, size_t count, float *values)
{
    switch (probe->peer->setting.method) {
    case UMBT_STUDY_DEPTH_MAP: {
        struct umbt_map16_query query = probe->map;
        query.points += 3 * first;
        query.count = count;
        query.answers = values;
        umbt_map16_run(&query);
        break;
    }
    case UMBT_STUDY_NANOVDB: {
        struct umbt_nanovdb_query query = probe->volume;
        query.points += 3 * first;
        query.count = count;
        query.answers = values;
        umbt_nanovdb_run(&query);
        break;
    }
    default: {
        const struct umb_points points =
            umbt_points_at(probe->peers->positions[first], probe->peers->normals[first], count);
        umb_map_run(&probe->derived, &points, 0, count, values);
        break;
    }
    }
}

void umbt_probe_query(const struct umbt_probe *probe, size_t first, size_t count, float *values)
{
    if (probe->peer == NULL) {
        asset_run(probe, first, count, values);
    } else {
        const size_t begin = probe->peers->rank[first], end = probe->peers->rank[first + count];
        peer_run(probe, begin, end - begin, values);
    }
}

void umbt_probe_answer(const struct umbt_probe *probe, size_t first, size_t count, float *values)
{
    umbt_probe_query(probe, first, count, values);
    if (probe->peer == NULL) {
        return;
    }
    const uint32_t *rank = probe->peers->rank + first;
    /* From the end: an answer moves to its place or farther back. */
    for (size_t i = count; i-- > 0;) {
        values[i] = rank[i + 1] > rank[i] ? values[rank[i] - rank[0]] : 0.0F;
    }
}

static void truth_prepare(struct umbt_probe *probe)
{
    const struct umbt_study *study = probe->study;
    const enum umbt_study_method method = probe->result->method;
    const int disc = method == UMBT_STUDY_PENUMBRA;
    struct umbt_truth *rays = &probe->truth.rays;
    *rays = umbt_truth_of(&study->common.scene, study->points.to_light, probe->bake->info.origin,
                          umbt_study_frustum(probe->bake));
    rays->kind = disc ? UMBT_TRUTH_DISC : UMBT_TRUTH_AREA;
    rays->settings.taps = probe->result->taps;
    rays->samples = (uint32_t)study->options.truth_side;
    rays->extent = disc ? probe->bake->light.extent : 0.0;
    rays->layers = probe->peer != NULL ? NULL : rays->layers; /* peers know opaque casters only */
    rays->lamp = study->points.lamp;
    rays->frusta = rays->lamp != NULL ? probe->bake->frusta : NULL;
    rays->frustum_count = rays->lamp != NULL ? probe->bake->light.frustum_count : 0;
    probe->truth.method = method;
    probe->truth.footprint_m = study->points.footprint_m;
}

/* Tunes the map's prefetch distance on the view. */
static enum umb_status map_prepare(struct umbt_probe *probe, struct umb_error *error)
{
    const size_t view = probe->peers->rank[probe->study->points.first[UMBT_STUDY_BORDER]];
    float *answers = malloc((view + 1) * sizeof *answers);
    if (answers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu answers do not fit in memory", view);
    }
    probe->map = (struct umbt_map16_query){.map = &probe->peer->map,
                                           .points = probe->moved,
                                           .count = view,
                                           .taps = (int)probe->result->taps,
                                           .way = probe->peer->way,
                                           .ahead = AHEAD,
                                           .answers = answers};
    if (view >= TUNE_POINTS) {
        (void)umbt_map16_tune(&probe->map, probe->peer->way);
    }
    free(answers);
    return UMB_OK;
}

static enum umb_status peer_prepare(struct umbt_probe *probe, struct umb_error *error)
{
    const uint32_t taps = probe->result->taps;
    if (probe->peer->setting.method == UMBT_STUDY_DERIVED) {
        const struct umb_derived *derived = probe->peer->derived;
        const struct umb_map_filter filter = {
            .width = (double)taps, .bias_normal = 1.0, .bias_m = derived->texel_error_m};
        return umb_map_prepare(derived->maps[0], &filter, &probe->derived, error);
    }
    probe->moved = moved_make(probe->study, probe->peers, probe->bake, taps);
    if (probe->moved == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "the samples do not fit in memory again");
    }
    if (probe->peer->setting.method == UMBT_STUDY_DEPTH_MAP) {
        return map_prepare(probe, error);
    }
    probe->volume = (struct umbt_nanovdb_query){
        .peer = probe->peer->volume,
        .points = probe->moved,
        .taps = (int)taps,
        .way = taps == 1 ? UMBT_NANOVDB_ACCESSOR : UMBT_NANOVDB_LEAVES,
    };
    return UMB_OK;
}

struct umb_query_settings umbt_study_settings(const struct umbt_study *study,
                                              const struct umbt_study_result *result)
{
    static const enum umb_filter filters[UMBT_STUDY_METHODS] = {
        [UMBT_STUDY_TENT] = UMB_FILTER_TENT,
        [UMBT_STUDY_FOOTPRINT] = UMB_FILTER_FOOTPRINT,
        [UMBT_STUDY_PENUMBRA] = UMB_FILTER_PENUMBRA,
    };
    return (struct umb_query_settings){
        .taps = result->taps,
        .level = result->level,
        .filter = filters[result->method],
        .footprint_m = result->method == UMBT_STUDY_FOOTPRINT ? study->points.footprint_m : 0.0};
}

enum umb_status umbt_probe_prepare(struct umbt_probe *probe, struct umb_error *error)
{
    const struct umb_query_settings settings = umbt_study_settings(probe->study, probe->result);
    probe->bake = &probe->study->bakes[probe->result->bake];
    truth_prepare(probe);
    return probe->peer != NULL
               ? peer_prepare(probe, error)
               : umb_query_prepare(probe->bake->asset, &settings, &probe->query, error);
}

void umbt_probe_finish(struct umbt_probe *probe)
{
    free(probe->moved);
    probe->moved = NULL;
}
