/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_volume_asset.h. */
#include "cli_volume_asset.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "cli_query_plan.h"
#include "tool/tool_try.h"
#include "umbrage/volume_queries.h"

/* Number of records of a file between two updates of the progress line; for boxes it is 1. */
#define SLICE ((size_t)256)

static enum umb_status prepare_boxes(struct umbc_volume_asset *asset, struct umb_error *error)
{
    struct umb_light_info light;
    UMB__TRY(umb_volume_check_parallel(&asset->volume, error));
    UMB__TRY(umb_asset_get_light(asset->file, asset->options->settings.light, &light));
    return umb_asset_get_frustum(asset->file, light.first_frustum, &asset->frustum);
}

static enum umb_status open_file(struct umbc_volume_asset *asset, struct umb_error *error)
{
    const struct umbc_query_options *options = asset->options;
    struct umb_asset_info info;
    enum umb_status status = umb_asset_open_file(options->target, NULL, &asset->file, error);
    if (status != UMB_OK) {
        asset->bad_file = true;
        return status;
    }
    umb_asset_get_info(asset->file, &info);
    memcpy(asset->id, info.id, sizeof info.id);
    memcpy(asset->origin, info.origin, sizeof info.origin);
    UMB__TRY(umb_volume_prepare(asset->file, options->settings.light, &asset->volume, error));
    asset->ignores_translucent = umb_volume_ignores_translucent(&asset->volume);
    switch (options->volume_query) {
    case UMBC_ASK_BOXES:
        return prepare_boxes(asset, error);
    case UMBC_ASK_COLUMNS:
        return umb_volume_check_columns(&asset->volume, error);
    default:
        return UMB_OK;
    }
}

static enum umb_status connect_to(const struct umbc_query_options *options,
                                  struct umbc_volume_asset *asset, struct umb_error *error)
{
    UMB__TRY(umbu_connect(&options->session, &asset->client, error));
    UMB__TRY(umb_client_get_limits(asset->client, &asset->limits, error));
    return umbc_call_size(options, &asset->limits, &asset->batch_size, error);
}

enum umb_status umbc_volume_open(const struct umbc_query_options *options,
                                 struct umbc_volume_asset *asset, struct umb_error *error)
{
    memset(asset, 0, sizeof *asset);
    asset->options = options;
    asset->batch_size = options->batch;
    UMB__TRY(umbc_is_file(options->target) ? open_file(asset, error)
                                           : connect_to(options, asset, error));
    if (options->volume_query != UMBC_ASK_BOXES) {
        return UMB_OK;
    }
    asset->boxes = calloc(asset->batch_size, sizeof *asset->boxes);
    return asset->boxes != NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu boxes", asset->batch_size);
}

void umbc_volume_close(struct umbc_volume_asset *asset)
{
    free(asset->boxes);
    umb_client_close(asset->client);
    umb_asset_close(asset->file);
}

static struct umb_volume_query volume_query_of(const struct umbc_volume_asset *asset)
{
    return (struct umb_volume_query){.asset = asset->options->target,
                                     .light = asset->options->settings.light};
}

/* Stores the id of the asset that answered. Fails if an earlier reply has another id. */
static enum umb_status take_reply(struct umbc_volume_asset *asset,
                                  const struct umb_volume_query_reply *reply,
                                  struct umb_error *error)
{
    if (asset->has_id && memcmp(asset->id, reply->asset_id, UMB_ID_BYTES) != 0) {
        /* Asking again helps: the exit code is 75. */
        return umb_fail(error, UMB_E_CANCELLED,
                        "asset '%.200s' was replaced during the query; ask again",
                        asset->options->target);
    }
    memcpy(asset->id, reply->asset_id, UMB_ID_BYTES);
    asset->has_id = true;
    asset->ignores_translucent = reply->ignores_translucent;
    return UMB_OK;
}

static void show(struct umbc_record_progress *progress, double answered)
{
    if (progress != NULL) {
        umbc_records_show(progress, answered);
    }
}

enum umb_status umbc_volume_segments(struct umbc_volume_asset *asset,
                                     const struct umb_segments *segments,
                                     struct umbc_record_progress *progress,
                                     struct umb_segment_answers *answers, struct umb_error *error)
{
    if (asset->client == NULL) {
        UMB__TRY(umb_segments_check(segments, error));
        for (size_t i = 0, n; i < segments->count; i += n) {
            n = segments->count - i < SLICE ? segments->count - i : SLICE;
            umb_volume_segments(&asset->volume, segments, i, n, answers);
            show(progress, (double)(i + n));
        }
        return UMB_OK;
    }
    const struct umb_volume_query volume_query = volume_query_of(asset);
    struct umb_volume_query_reply reply;
    UMB__TRY(
        umb_client_segments(asset->client, &volume_query, segments, answers, &reply, NULL, error));
    return take_reply(asset, &reply, error);
}

enum umb_status umbc_volume_columns(struct umbc_volume_asset *asset,
                                    const struct umb_points *points,
                                    struct umbc_record_progress *progress,
                                    struct umb_column_answers *answers, struct umb_error *error)
{
    if (asset->client == NULL) {
        UMB__TRY(umb_points_check(points, error));
        for (size_t i = 0, n; i < points->count; i += n) {
            n = points->count - i < SLICE ? points->count - i : SLICE;
            umb_volume_columns(&asset->volume, points, i, n, answers);
            show(progress, (double)(i + n));
        }
        return UMB_OK;
    }
    const struct umb_volume_query volume_query = volume_query_of(asset);
    struct umb_volume_query_reply reply;
    UMB__TRY(
        umb_client_columns(asset->client, &volume_query, points, answers, &reply, NULL, error));
    return take_reply(asset, &reply, error);
}

/* State of counting one box of a file. */
struct box_count {
    const struct umbc_volume_asset *asset;
    struct umbc_record_progress *progress;
    const struct umb_box_answer *answers;
    size_t box;
    double voxels; /* estimated voxels of the box; 0: not estimated yet */
};

/* Shows the counted share of a box: a large one takes long. */
static int show_box(void *user, uint64_t steps)
{
    struct box_count *count = user;
    const double counted = (double)count->answers[count->box].voxels;
    (void)steps;
    if (!(count->voxels > 0)) {
        const struct umbc_volume_asset *asset = count->asset;
        count->voxels =
            umbc_box_voxels(&asset->frustum, asset->origin, &asset->boxes[count->box]) + 1;
    }
    show(count->progress, (double)count->box + fmin(counted / count->voxels, 0.99));
    return 1;
}

static enum umb_status count_boxes(struct umbc_volume_asset *asset, size_t boxes,
                                   struct umbc_record_progress *progress,
                                   struct umb_box_answers *answers, struct umb_error *error)
{
    for (size_t i = 0; i < boxes; i++) {
        struct box_count count = {
            .asset = asset, .progress = progress, .answers = answers->boxes, .box = i};
        const struct umb_box_watch watch = {show_box, &count};
        UMB__TRY(umb_volume_boxes(&asset->volume, asset->boxes, i, 1, &watch, answers, error));
        show(progress, (double)(i + 1));
    }
    return UMB_OK;
}

enum umb_status umbc_volume_boxes(struct umbc_volume_asset *asset,
                                  const struct umb_segments *corners,
                                  struct umbc_record_progress *progress,
                                  struct umb_box_answers *answers, struct umb_error *error)
{
    umb_boxes_from_corners(corners, 0, corners->count, asset->boxes);
    UMB__TRY(umb_boxes_check(asset->boxes, corners->count, error));
    if (asset->client == NULL) {
        return count_boxes(asset, corners->count, progress, answers, error);
    }
    const struct umb_volume_query volume_query = volume_query_of(asset);
    struct umb_volume_query_reply reply;
    UMB__TRY(umb_client_boxes(asset->client, &volume_query, asset->boxes, corners->count, answers,
                              &reply, NULL, error));
    return take_reply(asset, &reply, error);
}

/* --- segments with more intervals than the batch has room for --- */

#define FEW 64 /* fewest intervals that a daemon counts for a segment */
/* Most intervals of the segments of one call, unless one segment has more. */
#define LONG_INTERVALS ((size_t)1 << 18)

/* Returns true if one more segment fits into the call. Each segment gets room for as many intervals
 * as the longest has, and at least half of that room must be used. A daemon counts the whole room
 * as points. */
static bool has_room(const struct umbc_volume_asset *asset, size_t count, size_t most, size_t used)
{
    const size_t room = count * most;
    return count == 1 || (room <= LONG_INTERVALS && room / 2 <= used &&
                          (asset->client == NULL || room <= asset->limits.max_points));
}

/* Counts the long segments from segment i on that fit into one call, and finds the most intervals
 * of any of them. */
static void choose(struct umbc_long_segments *longs, const struct umbc_volume_asset *asset,
                   size_t i)
{
    size_t used = 0, most = FEW;
    longs->count = 0;
    for (; i < longs->segments->count; i++) {
        const size_t intervals = (size_t)longs->answers->segments[i].interval_count;
        const size_t longest = intervals > most ? intervals : most;
        if (intervals > UMBC_INTERVALS_KEPT) {
            used += intervals > FEW ? intervals : FEW;
            if (!has_room(asset, longs->count + 1, longest, used)) {
                break;
            }
            most = longest;
            longs->count++;
        }
    }
    longs->again.interval_max = most;
}

/* Refuses answers with more intervals than the server announced before. */
static enum umb_status check(const struct umbc_long_segments *longs, struct umb_error *error)
{
    for (size_t i = 0; i < longs->count; i++) {
        const uint64_t intervals = longs->again.segments[i].interval_count;
        if (intervals > longs->again.interval_max) {
            return umb_fail(error, UMB_E_PROTOCOL,
                            "the daemon announced at most %zu intervals, and then sent %" PRIu64,
                            longs->again.interval_max, intervals);
        }
    }
    return UMB_OK;
}

/* Asks for the long segments from segment i on once more, as many as fit into one call. */
static enum umb_status ask(struct umbc_long_segments *longs, struct umbc_volume_asset *asset,
                           size_t i, struct umb_error *error)
{
    const struct umb_segments *segments = longs->segments;
    const size_t record = 6 * (segments->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double));
    umbc_longs_finish(longs);
    choose(longs, asset, i);
    const size_t room = longs->count * longs->again.interval_max;
    longs->ends = malloc(longs->count * record);
    longs->again.segments = calloc(longs->count, sizeof *longs->again.segments);
    longs->again.intervals = calloc(room, sizeof *longs->again.intervals);
    if (longs->ends == NULL || longs->again.segments == NULL || longs->again.intervals == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu intervals", room);
    }
    for (size_t found = 0; found < longs->count; i++) {
        if (longs->answers->segments[i].interval_count > UMBC_INTERVALS_KEPT) {
            memcpy(longs->ends + found++ * record, (const uint8_t *)segments->ends + i * record,
                   record);
        }
    }
    struct umb_segments again = *segments;
    again.ends = longs->ends;
    again.count = longs->count;
    UMB__TRY(umbc_volume_segments(asset, &again, NULL, &longs->again, error));
    return check(longs, error);
}

void umbc_longs_finish(struct umbc_long_segments *longs)
{
    free(longs->ends);
    free(longs->again.segments);
    free(longs->again.intervals);
    longs->ends = NULL;
    memset(&longs->again, 0, sizeof longs->again);
    longs->count = longs->next = 0;
}

enum umb_status umbc_longs_next(struct umbc_long_segments *longs, struct umbc_volume_asset *asset,
                                size_t i, const struct umb_segment_answer **answer,
                                const struct umb_interval **intervals, struct umb_error *error)
{
    if (longs->next == longs->count) {
        UMB__TRY(ask(longs, asset, i, error));
    }
    *answer = &longs->again.segments[longs->next];
    *intervals = longs->again.intervals + longs->next * longs->again.interval_max;
    longs->next++;
    return UMB_OK;
}
