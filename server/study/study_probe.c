/* SPDX-License-Identifier: Apache-2.0 */
/* Preparing and querying one setting; see study_probe.h. */
#include "study/study_probe.h"

#include <stdlib.h>
#include <string.h>

#include "study/study_math.h"

#define AHEAD       16U /* prefetch distance in points if there are too few for tuning */
#define TUNE_POINTS 256U

struct umb_points umbt_study_points_all(const struct umbt_study *study)
{
    return (struct umb_points){
        .positions = study->points.positions,
        .format = UMB_POINT_F64,
        .normals = study->points.normals,
        .count = study->points.count,
    };
}

void umbt_study_normal(const struct umbt_study_points *points, size_t i, double normal[3])
{
    umbt_widen(points->normals[i], normal);
    (void)umbt_normalize(normal);
}

static void asset_run(const struct umbt_probe *probe, size_t first, size_t count, float *values)
{
    struct umb_points points = umbt_study_points_all(probe->study);
    struct umb_answers answers = {.values = values};
    points.positions = probe->study->points.positions + first;
    points.normals = probe->study->points.normals + first;
    points.count = count;
    umb_query_run(&probe->query, &points, 0, count, &answers);
}

static void peer_run(const struct umbt_probe *probe, size_t first, size_t count, float *values)
{
    switch (probe->peer->method) {
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
        const struct umb_points points = {.positions = probe->peers->positions + first,
                                          .format = UMB_POINT_F64,
                                          .normals = probe->peers->normals + first,
                                          .count = count};
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
    const int disc = probe->result->method == UMBT_STUDY_PENUMBRA;
    probe->truth = (struct umbt_truth){
        .rays = study->scene.rays,
        .kind = disc ? UMBT_TRUTH_DISC : UMBT_TRUTH_AREA,
        .settings = {.taps = probe->result->taps},
        .samples = (uint32_t)study->options.truth_side,
        .extent = disc ? probe->bake->light.extent : 0.0,
        .diagonal_m = study->scene.diagonal_m,
        .frustum = probe->bake->frustum,
        .closed = probe->bake->frustum.closed ? study->scene.parts.closed : NULL,
    };
    memcpy(probe->truth.to_light, study->points.to_light, sizeof probe->truth.to_light);
    memcpy(probe->truth.origin, probe->bake->info.origin, sizeof probe->truth.origin);
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
    if (probe->peer->method == UMBT_STUDY_DERIVED) {
        const struct umb_derived *derived = probe->peer->derived;
        const struct umb_map_filter filter = {
            .width = (double)taps, .bias_normal = 1.0, .bias_m = derived->texel_error_m};
        return umb_map_prepare(derived->maps[0], &filter, &probe->derived, error);
    }
    probe->moved = umbt_peers_moved(probe->study, probe->peers, probe->bake, taps);
    if (probe->moved == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "the samples do not fit in memory again");
    }
    if (probe->peer->method == UMBT_STUDY_DEPTH_MAP) {
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

enum umb_status umbt_probe_prepare(struct umbt_probe *probe, struct umb_error *error)
{
    const struct umbt_study_result *result = probe->result;
    const struct umb_query_settings settings = {
        .taps = result->taps,
        .level = result->level,
        .filter = result->method == UMBT_STUDY_PENUMBRA ? UMB_FILTER_PENUMBRA : UMB_FILTER_BOX};
    probe->bake = &probe->study->bakes[result->bake];
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
