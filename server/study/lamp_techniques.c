/* SPDX-License-Identifier: Apache-2.0 */
/* See lamp_techniques.h. */
#include "study/lamp_techniques.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "maps/map_parts.h"
#include "tool/clock.h"
#include "tool/threads.h"

#define BOX_RAYS   11U  /* rays a side over the filter's box */
#define BALL_RAYS  64U  /* rays to the lamp's disc */
#define LIFT_SHARE 2e-6 /* starts of rays off the surface, as a share of the scene's diagonal */
#define NEAR_SHARE 1e-3 /* depth 0 from the lamp, as a share of its reach */
#define RUNS       5

#define MAP(kind) .settings.technique = UMB_MAP_##kind
#define WARPS     .settings.exponent = 42, .settings.negative_exponent = 5.4, .settings.linear = 1
#define BOTH(name, truth, ...)                                                                     \
    {"cube-" name, truth, 0, __VA_ARGS__},                                                         \
    {                                                                                              \
        "paraboloid-" name, truth, 1, __VA_ARGS__                                                  \
    }

const struct umbt_lamp_row umbt_lamp_rows[] = {
    BOTH("map", UMBT_POINT, MAP(PCF)),
    BOTH("pcf", UMBT_BOX, MAP(PCF)),
    BOTH("vsm", UMBT_BOX, MAP(VSM)),
    BOTH("esm-80", UMBT_BOX, MAP(ESM), .settings.exponent = 80),
    BOTH("evsm", UMBT_BOX, MAP(EVSM), WARPS),
    BOTH("msm", UMBT_BOX, MAP(MSM)),
    BOTH("pcss", UMBT_PENUMBRA, MAP(PCF), .filter.light_size = 1.0),
};

const size_t umbt_lamp_row_count = sizeof umbt_lamp_rows / sizeof umbt_lamp_rows[0];

/* ---- faces ---- */

/* Returns the tangent of half the angle that a face sees: more than 45 degrees, by half a filter
 * and a texel. So windows at a face's border find their casters on that face. */
static double face_tangent(uint32_t side, uint32_t taps)
{
    return 1.0 / (1.0 - fmin((double)(taps + 1) / (double)side, 0.5));
}

static enum umb_status faces_make(const struct umbt_lamp_view *lamp, struct umbt_lamp_faces *faces,
                                  int paraboloid, struct umb_error *error)
{
    const struct umb_box *box = &lamp->view->setup.scene->box;
    double reach = 0.0;
    for (int k = 0; k < 3; k++) {
        const double far_m =
            fmax(fabs(box->min[k] - lamp->position[k]), fabs(box->max[k] - lamp->position[k]));
        reach += far_m * far_m;
    }
    reach = sqrt(reach) * 1.001;
    /* A cube has six faces of half the map's side, paraboloids two of seven eighths of it: 1.5 and
     * 1.53 times the texels of one map. */
    faces->count = paraboloid ? 2 : 6;
    faces->side = paraboloid ? lamp->view->resolution / 8 * 7 : lamp->view->resolution / 2;
    for (uint32_t i = 0; i < faces->count; i++) {
        const uint32_t axis = paraboloid ? 2 : i / 2;
        struct umb_map_spot spot = {.tangent = face_tangent(faces->side, lamp->view->taps),
                                    .near_m = NEAR_SHARE * reach,
                                    .far_m = reach,
                                    .projection =
                                        paraboloid ? UMB_MAP_PARABOLOID : UMB_MAP_PERSPECTIVE};
        memcpy(spot.position, lamp->position, sizeof spot.position);
        spot.forward[axis] = i % 2 == 0 ? 1.0 : -1.0;
        spot.up[(axis + 1) % 3] = 1.0;
        UMB__TRY(umb_map_frustum_spot(&spot, faces->side, faces->side, &faces->frusta[i], error));
    }
    return UMB_OK;
}

/* Returns the face that holds a point. */
static uint32_t face_of(const struct umbt_lamp_view *lamp, int paraboloid, const double point[3])
{
    double p[3];
    umb__subtract(point, lamp->position, p);
    uint32_t axis = 2;
    for (uint32_t k = 0; k < 3 && !paraboloid; k++) {
        axis = fabs(p[k]) > fabs(p[axis]) ? k : axis;
    }
    return (paraboloid ? 0 : 2 * axis) + (p[axis] < 0.0);
}

struct facing {
    const struct umbt_lamp_view *lamp;
    const struct umbt_lamp_faces *faces;
};

/* ---- truths ---- */

static struct umb_map_filter filter_of(const struct umbt_lamp_view *lamp,
                                       const struct umbt_lamp_row *row,
                                       const struct umb_map_frustum *frustum)
{
    return umbt_technique_filter(lamp->view, &row->filter, row->truth, frustum->depth_m,
                                 lamp->size_m);
}

/* Returns the share of free rays to the lamp, from a square of texels at the moved receiver's
 * depth. */
static double box_visibility(const struct facing *facing, size_t i)
{
    const struct umbt_lamp_view *lamp = facing->lamp;
    const struct umbt_technique_view *view = lamp->view;
    const int paraboloid = facing->faces->count == 2;
    const struct umb_map_frustum *frustum =
        &facing->faces->frusta[face_of(lamp, paraboloid, view->buffer.positions[i])];
    const struct umb_map_filter filter =
        filter_of(lamp, &(struct umbt_lamp_row){.truth = UMBT_BOX}, frustum);
    const struct umb_points points =
        umbt_points_at(view->buffer.positions[i], view->buffer.normals[i], 1);
    struct umb__receiver receiver;
    uint32_t lit = 0;
    umb__receiver_make(frustum, &filter, &points, 0, &receiver);
    if (receiver.place != UMB__RECEIVER_INSIDE) {
        return receiver.place == UMB__RECEIVER_OUTSIDE ? 1.0 : 0.0;
    }
    for (uint32_t k = 0; k < BOX_RAYS * BOX_RAYS; k++) {
        const double u = ((double)(k % BOX_RAYS) + 0.5) / BOX_RAYS - 0.5;
        const double v = ((double)(k / BOX_RAYS) + 0.5) / BOX_RAYS - 0.5;
        double start[3], direction[3];
        if (umb_map_frustum_point(frustum, receiver.x + filter.width * u,
                                  receiver.y + filter.width * v, receiver.depth, start) != UMB_OK) {
            lit++; /* beyond a paraboloid's disc there is no ray, and no caster on the map */
            continue;
        }
        umb__subtract(lamp->position, start, direction);
        const double length = umbt_normalize(direction);
        lit += !umbr_occluded(view->setup.scene->rays, start, direction, 0.0, length);
    }
    return (double)lit / (BOX_RAYS * BOX_RAYS);
}

static void box_item(void *user, size_t i)
{
    const struct facing *facing = user;
    facing->faces->box[i] = (float)box_visibility(facing, i);
}

/* Traces rays from a receiver to the lamp itself, and to points of a disc that faces the
 * receiver. */
static void ray_item(void *user, size_t i)
{
    const struct facing *facing = user;
    const struct umbt_lamp_view *lamp = facing->lamp;
    const struct umbt_technique_view *view = lamp->view;
    double direction[3], distance, normal[3], start[3], across[2][3], disc[BALL_RAYS][2];
    view->truth[UMBT_POINT][i] = view->truth[UMBT_PENUMBRA][i] = 0.0F;
    if (!umbt_faces_light(view, i, direction, &distance)) {
        return;
    }
    umbt_widen(view->buffer.normals[i], normal);
    umbt_along(view->buffer.positions[i], LIFT_SHARE * view->setup.scene->diagonal_m, normal,
               start);
    view->truth[UMBT_POINT][i] =
        (float)!umbr_occluded(view->setup.scene->rays, start, direction, 0.0, distance);
    umb__across(direction, across[0], across[1]);
    umb__poisson_disc(disc, BALL_RAYS);
    uint32_t lit = 0;
    for (uint32_t k = 0; k < BALL_RAYS; k++) {
        double at[3];
        umbt_along(lamp->position, 0.5 * lamp->size_m * disc[k][0], across[0], at);
        umbt_along(at, 0.5 * lamp->size_m * disc[k][1], across[1], at);
        umb__subtract(at, start, at);
        const double length = umbt_normalize(at);
        lit += !umbr_occluded(view->setup.scene->rays, start, at, 0.0, length);
    }
    view->truth[UMBT_PENUMBRA][i] = (float)lit / (float)BALL_RAYS;
}

/* ---- the view ---- */

static enum umb_status faces_trace(const struct umbt_lamp_view *lamp, struct umbt_lamp_faces *faces,
                                   int paraboloid, struct umb_error *error)
{
    const struct umbt_technique_view *view = lamp->view;
    UMB__TRY(faces_make(lamp, faces, paraboloid, error));
    const size_t texels = (size_t)faces->count * faces->side * faces->side;
    faces->depth = malloc(texels * sizeof *faces->depth);
    faces->box = malloc(view->buffer.receiver_count * sizeof *faces->box);
    if (faces->depth == NULL || faces->box == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    }
    for (size_t i = 0; i < faces->count; i++) {
        UMB__TRY(umbt_layer_trace(view, &faces->frusta[i], 1,
                                  faces->depth + i * faces->side * faces->side, error));
    }
    struct facing facing = {lamp, faces};
    return umbu_range_each(view->threads, view->buffer.receiver_count, 512, box_item, &facing,
                           error);
}

enum umb_status umbt_lamp_view_make(struct umbt_lamp_view *lamp, struct umb_error *error)
{
    struct umbt_technique_view *view = lamp->view;
    view->lamp = lamp->position;
    UMB__TRY(umbt_technique_points_make(view, error));
    const size_t count = view->buffer.receiver_count;
    UMB__TRY(faces_trace(lamp, &lamp->faces[0], 0, error));
    UMB__TRY(faces_trace(lamp, &lamp->faces[1], 1, error));
    memcpy(view->truth[UMBT_BOX], lamp->faces[0].box, count * sizeof(float));
    struct facing facing = {lamp, NULL};
    return umbu_range_each(view->threads, count, 512, ray_item, &facing, error);
}

void umbt_lamp_view_finish(struct umbt_lamp_view *lamp)
{
    for (int i = 0; i < 2; i++) {
        free(lamp->faces[i].depth);
        free(lamp->faces[i].box);
    }
}

/* ---- rows ---- */

/* Answers all points, each by its face; returns the CPU seconds. */
static double points_ask(const struct umbt_lamp_view *lamp, const struct umbt_lamp_row *row,
                         const struct umb_map_query *queries, float *values)
{
    const struct umbt_gbuffer *buffer = &lamp->view->buffer;
    const struct umb_points points =
        umbt_points_at(buffer->positions[0], buffer->normals[0], buffer->receiver_count);
    const double start = umbu_thread_cpu_s();
    for (size_t i = 0; i < points.count; i++) {
        const uint32_t face = face_of(lamp, row->paraboloid, buffer->positions[i]);
        umb_map_run(&queries[face], &points, i, 1, values);
    }
    return umbu_thread_cpu_s() - start;
}

static enum umb_status maps_make(const struct umbt_lamp_view *lamp, const struct umbt_lamp_row *row,
                                 struct umb_map **maps, struct umb_map_query *queries,
                                 struct umbt_technique_result *result, struct umb_error *error)
{
    const struct umbt_lamp_faces *faces = &lamp->faces[row->paraboloid];
    struct umb_map_settings settings = row->settings;
    uint64_t bytes = 0;
    if (settings.technique != UMB_MAP_PCF) {
        settings.blur = lamp->view->taps;
    }
    for (uint32_t i = 0; i < faces->count; i++) {
        const struct umb_map_layer layer = {.depth = faces->depth +
                                                     (size_t)i * faces->side * faces->side};
        const struct umb_map_filter filter = filter_of(lamp, row, &faces->frusta[i]);
        const double start = umbu_thread_cpu_s();
        UMB__TRY(umb_map_build(&faces->frusta[i], &layer, &settings, NULL, &maps[i], error));
        result->build_s += umbu_thread_cpu_s() - start;
        UMB__TRY(umb_map_prepare(maps[i], &filter, &queries[i], error));
        umb_map_get_info(maps[i], &result->info);
        bytes += result->info.bytes;
    }
    result->info.bytes = bytes;
    return UMB_OK;
}

enum umb_status umbt_lamp_run(const struct umbt_lamp_view *lamp, const struct umbt_lamp_row *row,
                              float *values, struct umbt_technique_result *result,
                              struct umb_error *error)
{
    struct umb_map *maps[UMBT_LAMP_FACES] = {NULL};
    struct umb_map_query queries[UMBT_LAMP_FACES];
    double ns[RUNS];
    memset(result, 0, sizeof *result);
    const enum umb_status status = maps_make(lamp, row, maps, queries, result, error);
    for (int run = 0; run < RUNS && status == UMB_OK; run++) {
        ns[run] = 1e9 * points_ask(lamp, row, queries, values) /
                  (double)lamp->view->buffer.receiver_count;
    }
    if (status == UMB_OK) {
        result->time = umbt_least(ns, RUNS);
        umbt_technique_compare(lamp->view,
                               row->truth == UMBT_BOX ? lamp->faces[row->paraboloid].box
                                                      : lamp->view->truth[row->truth],
                               values, result);
    }
    for (uint32_t i = 0; i < UMBT_LAMP_FACES; i++) {
        umb_map_destroy(maps[i]);
    }
    return status;
}
