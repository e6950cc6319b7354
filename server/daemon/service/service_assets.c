/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows.Describe, Shadows.List and Shadows.Limits, and server reflection. */
#include "base/try.h"
#include "daemon/work/calibrations.h"
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "daemon/work/volume_query_work.h"
#include "jobs/bundle.h"
#include "umbrage/version.h"
#include "wire/messages.h"

#include <stdlib.h>
#include <string.h>

static void fill_summary(struct umb_client_asset *summary, const struct umbs_store_item *item)
{
    memset(summary, 0, sizeof *summary);
    memcpy(summary->name, item->name, strlen(item->name) + 1); /* 251 bytes at most */
    memcpy(summary->id, item->id, UMB_ID_BYTES);
    summary->packed_bytes = item->packed_bytes;
    summary->memory_bytes = item->memory_bytes;
    summary->light_count = item->light_count;
}

/* Describes a light. Resolution and voxel size are those of its first frustum; all its frusta have
 * the same resolution. */
static enum umb_status fill_light(const struct umb_asset *asset, uint32_t index,
                                  struct umb_client_light *light)
{
    struct umb_frustum_info frustum;
    UMB__TRY(umb_asset_get_light(asset, index, &light->info));
    if (light->info.frustum_count == 0) {
        return UMB_OK;
    }
    UMB__TRY(umb_asset_get_frustum(asset, light->info.first_frustum, &frustum));
    light->resolution = (uint64_t)1 << frustum.log2_size;
    light->closed = frustum.closed;
    umb_frustum_voxel_edges(&frustum, light->voxel_m);
    return UMB_OK;
}

/* Fills a light's curve, with the costs that earlier calibrations have measured for its rows. */
static void fill_curve(struct umbd_calibrations *calibrations, const struct umbs_entry *entry,
                       uint32_t index, struct umb_client_light *light)
{
    const uint8_t *id = umbs_entry_item(entry)->id;
    struct umb_calibration known;
    (void)umb_asset_get_curve(umbs_entry_asset(entry), index, light->curve, &light->curve_count);
    if (umbd_calibrations_get(calibrations, id, index, UMBD_POINTS_SCATTERED, &known) ||
        umbd_calibrations_get(calibrations, id, index, UMBD_POINTS_FEW, &known)) {
        memcpy(light->scattered_ns, known.ns, sizeof light->scattered_ns);
    }
    if (umbd_calibrations_get(calibrations, id, index, UMBD_POINTS_COHERENT, &known)) {
        memcpy(light->coherent_ns, known.ns, sizeof light->coherent_ns);
    }
}

/* Fills a description that borrows the asset's strings; with curves if calibrations is not NULL.
 * The caller frees the lights. */
static enum umb_status fill_description(const struct umbs_entry *entry,
                                        struct umbd_calibrations *calibrations,
                                        struct umb_client_description *reply)
{
    const struct umb_asset *asset = umbs_entry_asset(entry);
    struct umb_asset_info info;
    umb_asset_get_info(asset, &info);
    fill_summary(&reply->asset, umbs_entry_item(entry));
    reply->light_count = info.light_count;
    reply->lights = calloc((size_t)info.light_count + 1, sizeof *reply->lights);
    if (reply->lights == NULL) {
        return UMB_E_NO_MEMORY;
    }
    memcpy(reply->origin, info.origin, sizeof reply->origin);
    reply->bounds = info.bounds;
    reply->plan = (char *)(uintptr_t)info.plan; /* read only by the encoder */
    reply->settings = (char *)(uintptr_t)info.settings;
    memcpy(reply->scene_hash, info.scene_hash, sizeof reply->scene_hash);
    for (uint32_t i = 0; i < info.light_count; i++) {
        UMB__TRY(fill_light(asset, i, &reply->lights[i]));
        if (calibrations != NULL) {
            fill_curve(calibrations, entry, i, &reply->lights[i]);
        }
    }
    return UMB_OK;
}

void umbd_describe_serve(struct umbd_call *call)
{
    struct umbw_describe_request request;
    struct umbs_entry *entry = NULL;
    struct umb_client_description reply = {0};
    if (UMBD_CALL_READ(call, describe_request, &request) &&
        umbd_call_ok(call, umbd_call_acquire(call, request.asset, &entry, umbd_call_error(call))) &&
        umbd_call_ok(
            call, fill_description(entry, request.want_curves ? call->backend->calibrations : NULL,
                                   &reply))) {
        UMBD_CALL_SEND(call, describe_reply, &reply);
    }
    free(reply.lights);
    umbs_entry_release(entry);
}

void umbd_list_serve(struct umbd_call *call)
{
    struct umbs_store_item *items = NULL;
    struct umbw_list_reply reply = {0};
    size_t count = 0;
    if (!umbd_call_ok(
            call, umbs_store_list(call->backend->store, &items, &count, umbd_call_error(call)))) {
        return;
    }
    reply.assets = calloc(count + 1, sizeof *reply.assets);
    for (size_t i = 0; reply.assets != NULL && i < count; i++) {
        if (items[i].status == UMB_OK && umbd_call_sees(call, items[i].id)) {
            fill_summary(&reply.assets[reply.count++], &items[i]);
        }
    }
    if (umbd_call_ok(call, reply.assets != NULL ? UMB_OK : UMB_E_NO_MEMORY)) {
        UMBD_CALL_SEND(call, list_reply, &reply);
    }
    free(reply.assets);
    free(items);
}

void umbd_limits_serve(struct umbd_call *call)
{
    const struct umbd_options *options = &call->server->options;
    static const char *const encodings[] = {"identity", "gzip"};
    struct umbw_limits limits = {
        .client = {.max_points = options->max_points,
                   .max_message_bytes = options->max_message,
                   .max_targets = UMBW_TARGETS_MAX,
                   .max_taps = UMB_TAPS_MAX,
                   .max_segments = options->max_points / umbw_volume_query_points(UMBW_SEGMENTS, 0),
                   .max_columns = options->max_points / umbw_volume_query_points(UMBW_COLUMNS, 0),
                   .max_boxes = options->max_points / umbw_volume_query_points(UMBW_BOXES, 0),
                   .max_box_steps = UMBD_BOX_STEPS_MAX,
                   .version = UMB_VERSION_TEXT},
        .max_streams = UMBD_STREAMS_MAX,
        .queue = options->queue,
        .encodings = encodings,
        .encoding_count = 2,
    };
    if (options->bakes.folder != NULL) {
        limits.max_bundle_bytes = options->bakes.max_bundle_bytes;
        limits.max_bundle_files = UMBJ_FILES_MAX;
        limits.max_owner_jobs = (uint32_t)options->bakes.limits.owner_jobs;
    }
    UMBD_CALL_SEND(call, limits_reply, &limits);
}

void umbd_reflection_serve(struct umbd_call *call)
{
    struct umbw_buffer head = {0};
    if (!umbd_call_take_points(call, UMBD_CALL_POINTS)) {
        return;
    }
    uint64_t from = umbd_conn_began(call->conn);
    enum umb_status status =
        umbw_reflection_answer(call->message, call->message_size, &head, umbd_call_error(call));
    umbd_conn_spent(call->conn, from);
    umbd_call_reply_or_fail(call, status, &head);
}
