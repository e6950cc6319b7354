/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Work of volume queries, see volume_query_work.h. A slice is answered in chunks: first into
 * structs of the library on the stack, then from each field of them into the field's array. Between
 * chunks the slice checks whether the call still waits.
 */
#include "daemon/work/volume_query_work.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "query/volume_parts.h"
#include "tool/clock.h"

#define CHUNK        64
#define BRICK_VOXELS 8.0 /* along an edge of a brick */

/* A slice in progress. It owns nothing, because a fault in a cut file may end it midway. */
struct slice {
    struct umbd_volume_query *volume_query;
    size_t first, count;
    struct umb_error *error;
    enum umb_status status;
    struct umb_volume_stats stats;
};

struct umb_segments umbd_volume_query_pairs(const struct umbw_volume_query_request *request)
{
    struct umb_segments pairs = {
        .ends = request->records, .format = request->format, .count = request->count};
    memcpy(pairs.origin, request->origin, sizeof pairs.origin);
    return pairs;
}

static struct umb_points points_of(const struct umbw_volume_query_request *request)
{
    struct umb_points points = {
        .positions = request->records, .format = request->format, .count = request->count};
    memcpy(points.origin, request->origin, sizeof points.origin);
    return points;
}

static size_t scalar_bytes(const struct umbw_volume_query_request *request)
{
    return request->format == UMB_POINT_F64 ? sizeof(double) : sizeof(float);
}

/* A view of pairs first .. first + count - 1. */
static struct umb_segments sub_pairs(const struct umbw_volume_query_request *request, size_t first,
                                     size_t count)
{
    struct umb_segments pairs = umbd_volume_query_pairs(request);
    pairs.ends = (const uint8_t *)pairs.ends + 6 * scalar_bytes(request) * first;
    pairs.count = count;
    return pairs;
}

/* Checks records first .. first + count - 1. With first 0, errors count records from the start of
 * the message. */
static enum umb_status check_some(const struct umbw_volume_query_request *request, size_t first,
                                  size_t count, struct umb_error *error)
{
    if (request->volume_query == UMBW_COLUMNS) {
        struct umb_points points = points_of(request);
        points.positions = (const uint8_t *)points.positions + 3 * scalar_bytes(request) * first;
        points.count = count;
        return umb_points_check(&points, error);
    }
    const struct umb_segments pairs = sub_pairs(request, first, count);
    return request->volume_query == UMBW_SEGMENTS ? umb_segments_check(&pairs, error)
                                                  : umb__corners_check(&pairs, error);
}

static enum umb_status check(const struct umbw_volume_query_request *request, size_t first,
                             size_t count, struct umb_error *error)
{
    if (check_some(request, first, count, error) == UMB_OK) {
        return UMB_OK;
    }
    /* Repeats the check, so that the message has indices of the whole batch. All records before
     * `first` are valid. */
    return check_some(request, 0, first + count, error);
}

static void store(struct umbd_volume_query *volume_query, size_t field, size_t i, const void *value)
{
    const size_t bytes = umbw_answer_sizes[volume_query->request.volume_query][field];
    memcpy(volume_query->fields[field] + i * bytes, value, bytes);
}

static void run_segments(struct slice *slice, size_t first, size_t count)
{
    struct umbd_volume_query *volume_query = slice->volume_query;
    struct umb_segment_answer segments[CHUNK];
    const size_t most = volume_query->request.max_intervals;
    const struct umb_segments pairs = sub_pairs(&volume_query->request, first, count);
    uint8_t *room = volume_query->fields[UMBW_FIELD_INTERVALS];
    struct umb_segment_answers answers = {.segments = segments, .interval_max = most};
    if (most > 0) { /* they start malloc's block, so they are aligned */
        answers.intervals = (struct umb_interval *)(void *)room + first * most;
    }
    umb_volume_segments(&volume_query->volume, &pairs, 0, count, &answers);
    for (size_t i = 0; i < count; i++) {
        /* At most three steps a voxel of a side: far below 2^32. */
        const uint32_t intervals = (uint32_t)segments[i].interval_count;
        store(volume_query, 0, first + i, &segments[i].lit);
        store(volume_query, 1, first + i, &segments[i].lit_m);
        store(volume_query, 2, first + i, &intervals);
    }
    slice->stats.nodes += answers.stats.nodes;
    slice->stats.bricks += answers.stats.bricks;
}

static void run_columns(struct slice *slice, size_t first, size_t count)
{
    struct umbd_volume_query *volume_query = slice->volume_query;
    struct umb_column_answer columns[CHUNK];
    struct umb_points points = points_of(&volume_query->request);
    struct umb_column_answers answers = {.columns = columns};
    points.positions =
        (const uint8_t *)points.positions + 3 * scalar_bytes(&volume_query->request) * first;
    umb_volume_columns(&volume_query->volume, &points, 0, count, &answers);
    for (size_t i = 0; i < count; i++) {
        const uint8_t outside = columns[i].outside != 0;
        store(volume_query, 0, first + i, &columns[i].distance_m);
        store(volume_query, 1, first + i, &columns[i].lit);
        store(volume_query, 2, first + i, &outside);
    }
    slice->stats.nodes += answers.stats.nodes;
    slice->stats.bricks += answers.stats.bricks;
}

static int box_goes_on(void *user, uint64_t steps)
{
    struct slice *slice = user;
    slice->status = umbd_task_stopped(&slice->volume_query->task);
    if (slice->status == UMB_OK && steps >= UMBD_BOX_STEPS_MAX) {
        slice->status = UMB_E_TOO_LARGE;
    }
    return slice->status == UMB_OK;
}

static void run_boxes(struct slice *slice, size_t first, size_t count)
{
    struct umbd_volume_query *volume_query = slice->volume_query;
    const struct umb_segments pairs = umbd_volume_query_pairs(&volume_query->request);
    struct umb_box boxes[CHUNK];
    struct umb_box_answer counts[CHUNK];
    struct umb_box_answers answers = {.boxes = counts};
    const struct umb_box_watch watch = {box_goes_on, slice};
    umb_boxes_from_corners(&pairs, first, count, boxes);
    for (size_t i = 0; i < count && slice->status == UMB_OK; i++) {
        const enum umb_status status =
            umb_volume_boxes(&volume_query->volume, boxes, i, 1, &watch, &answers, slice->error);
        slice->status = slice->status == UMB_OK ? status : slice->status;
        store(volume_query, 0, first + i, &counts[i].lit);
        store(volume_query, 1, first + i, &counts[i].voxels);
        if (slice->status == UMB_E_TOO_LARGE) {
            (void)umb_fail(slice->error, UMB_E_TOO_LARGE,
                           "boxes[%zu]: takes more than %u steps, the limit of a box; ask for "
                           "smaller ones, side by side",
                           first + i, UMBD_BOX_STEPS_MAX);
        }
    }
    slice->stats.nodes += answers.stats.nodes;
    slice->stats.bricks += answers.stats.bricks;
}

static void run_slice(void *user)
{
    static void (*const runs[UMBW_VOLUME_QUERY_COUNT])(struct slice *, size_t, size_t) = {
        [UMBW_SEGMENTS] = run_segments, [UMBW_COLUMNS] = run_columns, [UMBW_BOXES] = run_boxes};
    struct slice *slice = user;
    for (size_t at = 0; at < slice->count && slice->status == UMB_OK; at += CHUNK) {
        const size_t left = slice->count - at;
        runs[slice->volume_query->request.volume_query](slice, slice->first + at,
                                                        left < CHUNK ? left : CHUNK);
        slice->status =
            slice->status == UMB_OK ? umbd_task_stopped(&slice->volume_query->task) : slice->status;
    }
}

enum umb_status umbd_volume_query_run(struct umbd_task *task, size_t first, size_t count,
                                      struct umbd_slice_result *result)
{
    struct umbd_volume_query *volume_query = (struct umbd_volume_query *)task;
    struct slice slice = {
        .volume_query = volume_query, .first = first, .count = count, .error = &result->error};
    const uint64_t from = umbu_thread_cpu_ns();
    enum umb_status status = check(&volume_query->request, first, count, &result->error);
    if (status == UMB_OK) {
        status = umbs_entry_read(volume_query->entry, run_slice, &slice, &result->error);
    }
    if (status == UMB_OK && slice.status != UMB_OK) {
        status = slice.status;
        if (status != UMB_E_TOO_LARGE) {
            (void)umb_fail(&result->error, status, "%s within records %zu to %zu of %zu",
                           status == UMB_E_DEADLINE ? "the deadline passed" : "cancelled", first,
                           first + count - 1, task->count);
        }
    }
    result->stats.nodes = slice.stats.nodes;
    result->stats.bricks = slice.stats.bricks;
    result->cpu_ns = umbu_thread_cpu_ns() - from;
    return status;
}

/* Moves the intervals of all segments together; returns their number. */
static size_t gather_intervals(struct umbd_volume_query *volume_query)
{
    const size_t most = volume_query->request.max_intervals;
    const size_t bytes = umbw_answer_sizes[UMBW_SEGMENTS][UMBW_FIELD_INTERVALS];
    uint8_t *intervals = volume_query->fields[UMBW_FIELD_INTERVALS];
    size_t count = 0;
    for (size_t i = 0; i < volume_query->request.count; i++) {
        uint32_t found;
        memcpy(&found, volume_query->fields[2] + i * sizeof found, sizeof found);
        const size_t told = found < most ? found : most;
        memmove(intervals + count * bytes, intervals + i * most * bytes, told * bytes);
        count += told;
    }
    return count;
}

enum umb_status umbd_volume_query_end(struct umbd_task *task, struct umb_error *error)
{
    struct umbd_volume_query *volume_query = (struct umbd_volume_query *)task;
    struct umbw_volume_query_reply reply = {
        .volume_query = volume_query->request.volume_query,
        .ignores_translucent = umb_volume_ignores_translucent(&volume_query->volume),
        .has_stats = volume_query->request.want_stats,
        .nodes = task->stats.nodes,
        .bricks = task->stats.bricks,
        .nanoseconds = task->cpu_ns,
        .count = volume_query->request.count,
    };
    memcpy(reply.asset_id, umbs_entry_item(volume_query->entry)->id, UMB_ID_BYTES);
    if (reply.volume_query == UMBW_SEGMENTS && volume_query->request.max_intervals > 0) {
        reply.interval_count = gather_intervals(volume_query);
    }
    for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
        reply.fields[k] = volume_query->fields[k];
    }
    return umbw_encode_volume_query_reply(&reply, &volume_query->reply, error);
}

double umbd_box_bricks(const struct umb_frustum_info *frustum, const struct umb_box *box)
{
    const double across = (double)((uint64_t)1 << frustum->log2_size) / BRICK_VOXELS;
    const double most = 6 * across * across;
    /* density: number of bricks cut by each unit of area, for a plane across each world axis. */
    double volume = 1, cut = 0, edge[3], density[3] = {0};
    for (size_t i = 0; i < 3; i++) {
        const double *step = frustum->voxel_step[i];
        volume *= BRICK_VOXELS * sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
        edge[i] = box->max[i] - box->min[i];
    }
    for (size_t i = 0; i < 3; i++) {
        for (size_t k = 0; k < 3; k++) {
            density[k] += fabs(frustum->voxel_step[i][k]) * BRICK_VOXELS / volume;
        }
    }
    for (size_t k = 0; k < 3; k++) {
        cut += 2 * edge[(k + 1) % 3] * edge[(k + 2) % 3] * density[k];
    }
    return cut < most ? cut : most; /* NaN too gives most; it is refused later */
}
