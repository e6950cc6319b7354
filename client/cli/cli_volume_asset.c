/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_volume_asset.h. */
#include "cli_volume_asset.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "cli_call_size.h"
#include "tool/tool_try.h"
#include "umbrage/volume_queries.h"

/* Records of a file that are answered between two looks at the clock; of boxes it is one. */
#define SLICE ((size_t)256)

/* Of the light, which is directional and has one. */
static enum umb_status first_frustum(struct umbc_volume_asset *asset, struct umb_error *error)
{
    struct umb_light_info light;
    enum umb_status status =
        umb_asset_get_light(asset->file, asset->options->settings.light, &light);
    if (status == UMB_OK) {
        status = umb_asset_get_frustum(asset->file, light.first_frustum, &asset->frustum);
    }
    return status == UMB_OK ? status : umb_fail(error, status, "the light has no frustum");
}

static enum umb_status prepare_boxes(struct umbc_volume_asset *asset, struct umb_error *error)
{
    const enum umb_status status = umb_volume_check_parallel(&asset->volume, error);
    return status == UMB_OK ? first_frustum(asset, error) : status;
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
    enum umb_status status = umbu_connect(&options->session, &asset->client, error);
    if (status == UMB_OK) {
        status = umb_client_get_limits(asset->client, &asset->limits, error);
    }
    return status == UMB_OK ? umbc_call_size(options, &asset->limits, &asset->batch_size, error)
                            : status;
}

enum umb_status umbc_volume_open(const struct umbc_query_options *options,
                                 struct umbc_volume_asset *asset, struct umb_error *error)
{
    memset(asset, 0, sizeof *asset);
    asset->options = options;
    asset->batch_size = options->batch;
    enum umb_status status =
        umbc_is_file(options->target) ? open_file(asset, error) : connect_to(options, asset, error);
    if (status != UMB_OK || options->volume_query != UMBC_ASK_BOXES) {
        return status;
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

/* Notes the id of the version that answered. All replies must be of one version. */
static enum umb_status take_reply(struct umbc_volume_asset *asset,
                                  const struct umb_volume_query_reply *reply,
                                  struct umb_error *error)
{
    if (asset->has_id && memcmp(asset->id, reply->asset_id, UMB_ID_BYTES) != 0) {
        /* Asking again helps, so that the exit code must say 75. */
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
        enum umb_status status = umb_segments_check(segments, error);
        for (size_t i = 0, n; status == UMB_OK && i < segments->count; i += n) {
            n = segments->count - i < SLICE ? segments->count - i : SLICE;
            umb_volume_segments(&asset->volume, segments, i, n, answers);
            show(progress, (double)(i + n));
        }
        return status;
    }
    const struct umb_volume_query volume_query = volume_query_of(asset);
    struct umb_volume_query_reply reply;
    enum umb_status status =
        umb_client_segments(asset->client, &volume_query, segments, answers, &reply, NULL, error);
    return status == UMB_OK ? take_reply(asset, &reply, error) : status;
}

enum umb_status umbc_volume_columns(struct umbc_volume_asset *asset,
                                    const struct umb_points *points,
                                    struct umbc_record_progress *progress,
                                    struct umb_column_answers *answers, struct umb_error *error)
{
    if (asset->client == NULL) {
        enum umb_status status = umb_points_check(points, error);
        for (size_t i = 0, n; status == UMB_OK && i < points->count; i += n) {
            n = points->count - i < SLICE ? points->count - i : SLICE;
            umb_volume_columns(&asset->volume, points, i, n, answers);
            show(progress, (double)(i + n));
        }
        return status;
    }
    const struct umb_volume_query volume_query = volume_query_of(asset);
    struct umb_volume_query_reply reply;
    enum umb_status status =
        umb_client_columns(asset->client, &volume_query, points, answers, &reply, NULL, error);
    return status == UMB_OK ? take_reply(asset, &reply, error) : status;
}

/* One box of a file, while it is counted. */
struct box_count {
    const struct umbc_volume_asset *asset;
    struct umbc_record_progress *progress;
    const struct umb_box_answer *answers;
    size_t box;
    double voxels; /* about what it will have; 0: not known yet */
};

/* A large box takes long: shows how much of it is counted. */
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
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < boxes; i++) {
        struct box_count count = {
            .asset = asset, .progress = progress, .answers = answers->boxes, .box = i};
        const struct umb_box_watch watch = {show_box, &count};
        status = umb_volume_boxes(&asset->volume, asset->boxes, i, 1, &watch, answers, error);
        show(progress, (double)(i + 1));
    }
    return status;
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
    enum umb_status status = umb_client_boxes(asset->client, &volume_query, asset->boxes,
                                              corners->count, answers, &reply, NULL, error);
    return status == UMB_OK ? take_reply(asset, &reply, error) : status;
}
