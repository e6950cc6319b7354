/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shadows.Query and QueryStream. A small batch is answered at once on the loop, within a time
 * budget for each wake-up of the loop. A larger batch goes to the workers, and `answer` sends its
 * reply.
 *
 * Each batch holds one version of its asset until its work ends, and the reply names that version.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compat.h"
#include "base/try.h"
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "query/stages.h"

/* Bytes of a reply's prefix, stats and ids. */
#define HEAD_MAX (256 + UMBW_TARGETS_MAX * (2 + UMB_ID_BYTES))

/* Most look-ups of a batch that the loop answers: about 0.2 ms at 0.1 us each. For such a batch the
 * workers would cost two thread switches, more than they save. */
#define INLINE_WORK 2048

/* Returns whether a part asks a spot, point or area light. */
static bool asks_lamp(const struct umbd_part *part)
{
    struct umb_light_info info;
    return umb_asset_get_light(umbs_entry_asset(part->entry), part->light, &info) == UMB_OK &&
           info.kind != UMB_LIGHT_DIRECTIONAL;
}

/* Returns the look-ups of a part of a batch, in units of one tap. Wide windows read eight texels of
 * a row at a time. */
static uint64_t work_of(const struct umb_query_settings *settings, const struct umbd_part *part,
                        size_t count)
{
    uint64_t taps = settings->taps > 0 ? settings->taps : 1;
    const struct umb__filter *filter = umb__filter_of(settings->filter);
    const double lamp = filter->work_lamp > 0 && asks_lamp(part) ? filter->work_lamp : 0;
    const double each =
        filter->work + lamp + filter->work_radian * fmax(fmin(settings->light_extent, 1), 0);
    return (uint64_t)count * ((uint64_t)each + (taps * taps + 7) / 8);
}

/* Mean edge in metres of the voxels that a part looks up. */
static double voxel_edge_m(const struct umbd_part *part)
{
    const struct umb_asset *asset = umbs_entry_asset(part->entry);
    struct umb_light_info info;
    struct umb_frustum_info frustum;
    double sum = 0;
    if (umb_asset_get_light(asset, part->light, &info) != UMB_OK || info.frustum_count == 0 ||
        umb_asset_get_frustum(asset, info.first_frustum, &frustum) != UMB_OK) {
        return 0;
    }
    for (size_t i = 0; i < 3; i++) {
        const double *step = frustum.voxel_step[i];
        sum += sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
    }
    return sum / 3;
}

/* Writes the setting that answered the first part, and its accuracy. */
static void state_setting(const struct umbd_batch *batch, struct umbw_query_reply *reply)
{
    const struct umbd_part *part = &batch->parts[0];
    const struct umb_asset *asset = umbs_entry_asset(part->entry);
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    struct umb_query_settings settings = batch->settings;
    settings.light = part->light;
    settings.taps = part->taps;
    settings.level = part->level;
    reply->taps = part->taps;
    reply->level = part->level;
    reply->expected_ns = part->expected_ns;
    reply->bound_m = umb_query_bound_m(asset, &settings);
    size_t count;
    (void)umb_asset_get_curve(asset, part->light, rows, &count);
    for (size_t i = 0; i < count; i++) {
        if (rows[i].level == part->level && rows[i].taps == part->taps &&
            umb_filter_get_info(settings.filter)->has_curve) {
            reply->visibility_error = rows[i].visibility_error;
            reply->lines = rows[i].lines;
        }
    }
}

static int is_small(const struct umbd_batch *batch)
{
    uint64_t work = 0;
    for (size_t i = 0; i < batch->part_count; i++) {
        work += work_of(&batch->settings, &batch->parts[i], batch->points.count);
    }
    return work <= INLINE_WORK;
}

/* Fills the reply's fields for a batch, all but the answers. ids: [part_count * UMB_ID_BYTES]. */
static void fill_reply(const struct umbd_batch *batch, int with_targets, uint8_t *ids,
                       struct umbw_query_reply *reply)
{
    *reply = (struct umbw_query_reply){
        .visibility_bytes = batch->value_bytes,
        .stats = batch->task.stats,
        .nanoseconds = batch->task.cpu_ns,
        .has_stats = batch->want_stats,
    };
    for (size_t i = 0; i < batch->part_count; i++) {
        memcpy(ids + i * UMB_ID_BYTES, umbs_entry_item(batch->parts[i].entry)->id, UMB_ID_BYTES);
    }
    memcpy(reply->asset_id, ids, UMB_ID_BYTES);
    if (with_targets) {
        reply->asset_ids = ids;
        reply->asset_id_count = batch->part_count;
    }
    if (batch->want_stats) {
        reply->voxel_m = voxel_edge_m(&batch->parts[0]);
        state_setting(batch, reply);
    }
}

/* Answers a batch on the loop and writes the answers into the reply's body. If the batch has one
 * asset, the next flush revalidates its answers. */
static void answer_inline(struct umbd_call *call, struct umbd_batch *batch,
                          const struct umbw_query_request *request)
{
    uint8_t ids[UMBW_TARGETS_MAX * UMB_ID_BYTES] UMB__UNSET;
    struct umbw_query_reply reply UMB__UNSET;
    fill_reply(batch, request->target_count > 0, ids, &reply);
    size_t room = umbw_query_reply_room(&reply);
    uint8_t *at = umbd_call_reserve(call, room + batch->value_bytes);
    if (at == NULL) {
        return;
    }
    uint64_t from = umbd_conn_began(call->conn);
    batch->values = at + room;
    batch->is_optimistic = request->target_count == 0;
    umbd_batch_run(batch, &call->server->metrics);
    umbd_conn_spent(call->conn, from);
    if (batch->task.status != UMB_OK) {
        umbd_call_fail_status(call, batch->task.status, &batch->task.error);
        return;
    }
    if (batch->is_optimistic) {
        umbd_optimistic_reads_add(call, batch, request->asset);
    }
    reply.stats = batch->task.stats;
    reply.nanoseconds = batch->task.cpu_ns;
    size_t head = umbw_write_query_reply_head(&reply, at);
    if (head < room) {
        memmove(at + head, at + room, batch->value_bytes); /* with stats only */
    }
    umbd_call_commit(call, head + batch->value_bytes);
}

/* Returns the most bytes that a batch's answers take. With packing, the memory also holds the
 * base's answers and the packed forms. */
static size_t answer_bytes(const struct umbd_batch *batch)
{
    return (batch->picture_work.pack ? 5 : 1) * batch->value_bytes;
}

/* Keeps the answers that the client of a stream has. The next packed reply may be changes against
 * them. */
static void keep_picture(struct umbd_call *call, struct umbd_kept_picture *kept)
{
    if (call->state == NULL) {
        call->state = calloc(1, sizeof *kept);
    }
    struct umbd_kept_picture *of_stream = call->state;
    if (of_stream != NULL) { /* else the next reply is whole */
        umbd_kept_picture_drop(of_stream);
        *of_stream = *kept;
        call->kept_bytes = kept->bytes;
        *kept = (struct umbd_kept_picture){0};
    }
}

void umbd_query_close(struct umbd_call *call)
{
    if (call->state != NULL) {
        umbd_kept_picture_drop(call->state);
        free(call->state);
    }
}

/* Sends what the workers answered. */
static void answer(struct umbd_call *call, struct umbd_task *task)
{
    struct umbd_batch *batch = umbd_batch_of(task);
    uint8_t ids[UMBW_TARGETS_MAX * UMB_ID_BYTES];
    uint8_t head[HEAD_MAX];
    if (task->status != UMB_OK) {
        umbd_call_fail_work(call, task->status, &task->error);
        return;
    }
    struct umbw_query_reply reply;
    fill_reply(batch, batch->with_targets, ids, &reply);
    uint8_t **answers = batch->picture_work.pack ? &batch->picture_work.block : &batch->reply;
    if (batch->picture_work.pack) {
        reply.visibility_bytes = batch->picture_work.packed_bytes;
        reply.packing = batch->picture_work.changes ? UMBW_PACKING_CHANGES : UMBW_PACKING_ZSTD;
    }
    size_t size = umbw_write_query_reply_head(&reply, head);
    size_t first = batch->head_room - size;
    uint8_t *block = *answers;
    memcpy(block + first, head, size);
    *answers = NULL;
    if (!umbd_takes_many(call->method)) {
        umbd_call_uncharge(call, batch->value_bytes);
    } else if (batch->picture_work.pack) {
        keep_picture(call, &batch->picture_work.kept);
    }
    umbd_call_reply_block(call, block, first, batch->head_room + reply.visibility_bytes);
}

/* Submits the batch to the workers. If that fails, the batch stays the caller's. */
static enum umb_status answer_by_pool(struct umbd_call *call, struct umbd_batch *batch,
                                      int with_targets, struct umb_error *error)
{
    struct umbw_query_reply reply = {
        .visibility_bytes =
            batch->picture_work.pack ? umb_picture_room(batch->value_bytes) : batch->value_bytes,
        .asset_id_count = with_targets ? batch->part_count : 0,
        .has_stats = batch->want_stats,
        .packing = batch->picture_work.pack ? UMBW_PACKING_CHANGES : UMBW_PACKING_PLAIN,
    };
    UMB__TRY(umbd_batch_reserve(batch, umbw_query_reply_room(&reply), error));
    batch->message = umbd_call_take_message_of(call, &batch->points);
    if (batch->message == NULL) {
        return UMB_E_NO_MEMORY;
    }
    if (batch->is_borrowed) {
        umbs_entry_retain(batch->parts[0].entry);
        batch->is_borrowed = 0;
    }
    batch->with_targets = with_targets;
    batch->task.answer = answer;
    return umbd_call_send_task(call, &batch->task, call->message_size + answer_bytes(batch), error);
}

static enum umb_status add_part(struct umbd_call *call, struct umbd_batch *batch, const char *asset,
                                uint32_t light, struct umb_error *error)
{
    struct umbs_entry *entry = NULL;
    enum umb_status status = umbd_call_acquire(call, asset, &entry, error);
    return status == UMB_OK ? umbd_batch_add(batch, entry, light, error) : status;
}

/* Adds the one part of a batch. Requests of one event mostly ask the same asset, and those of a
 * stream mostly have the same settings: an equal entry and an equal part are used again. */
static enum umb_status add_only_part(struct umbd_call *call, struct umbd_batch *batch,
                                     const struct umbw_query_request *request,
                                     struct umb_error *error)
{
    struct umbs_entry *entry = umbd_optimistic_reads_find(call->home, request->asset);
    batch->is_borrowed = entry != NULL && umbd_call_sees(call, umbs_entry_item(entry)->id);
    if (!batch->is_borrowed) {
        UMB__TRY(umbd_call_acquire(call, request->asset, &entry, error));
    }
    return umbd_batch_repeat(batch, entry, umbs_entry_serial(entry))
               ? UMB_OK
               : umbd_batch_add(batch, entry, request->settings.light, error);
}

/* Makes a batch with a part for each target. */
static enum umb_status make_batch(struct umbd_call *call, struct umbw_query_request *request,
                                  const struct umb_calibration *calibration,
                                  struct umbd_batch **out, struct umb_error *error)
{
    const size_t count = request->target_count;
    struct umbw_query_target target UMB__UNSET;
    UMB__TRY(
        count == 0
            ? umbd_batch_reuse(&call->home->spare, &request->settings, &request->points, out, error)
            : umbd_batch_create(count, &request->settings, &request->points, out, error));
    struct umbd_batch *batch = *out;
    batch->want_stats = request->want_stats;
    if (request->has_picture) {
        batch->picture_work.has_picture = 1;
        batch->picture_work.picture = request->picture;
    }
    batch->picture_work.pack = request->pack;
    batch->dial = request->dial;
    batch->calibration = calibration;
    if (count == 0) {
        UMB__TRY(add_only_part(call, batch, request, error));
    }
    for (size_t i = 0; i < count; i++) {
        UMB__TRY(umbw_query_target_next(request, &target, error));
        UMB__TRY(add_part(call, batch, target.asset, target.light, error));
    }
    batch->calibration = NULL;
    return UMB_OK;
}

/* Uses the stream's last answers as the base of the packing if the client still has them; otherwise
 * frees them. */
static void take_base(struct umbd_call *call, struct umbd_batch *batch, uint64_t mark)
{
    struct umbd_kept_picture *kept = call->state;
    if (kept == NULL) {
        return;
    }
    if (mark != 0 && mark == kept->mark && kept->bytes == batch->value_bytes) {
        batch->picture_work.kept = *kept;
        *kept = (struct umbd_kept_picture){0};
    }
    umbd_kept_picture_drop(kept);
    call->kept_bytes = 0;
}

/* 1 if the batch is answered on the loop. */
static int is_inline(struct umbd_call *call, const struct umbd_batch *batch)
{
    const size_t count = batch->points.count;
    return count == 0 ||
           (!batch->picture_work.pack && is_small(batch) && umbd_conn_has_turn(call->conn));
}

/* Answers a batch, or submits it to the workers. Returns UMB_OK with *away = 1 if the workers have
 * the batch. A call over its rate or budget has been failed. */
static enum umb_status answer_batch(struct umbd_call *call, struct umbd_batch *batch,
                                    const struct umbw_query_request *request, int is_paid,
                                    int *away, struct umb_error *error)
{
    if ((!is_paid && !umbd_call_take_points(call, UMBD_CALL_POINTS +
                                                      request->points.count * batch->part_count)) ||
        !umbd_call_charge(call, call->charged + answer_bytes(batch))) {
        return UMB_OK;
    }
    if (request->pack) {
        take_base(call, batch, request->base_mark);
    }
    if (is_inline(call, batch)) {
        answer_inline(call, batch, request);
        return UMB_OK;
    }
    enum umb_status status = answer_by_pool(call, batch, request->target_count > 0, error);
    *away = status == UMB_OK;
    return status;
}

static void serve_paid(struct umbd_call *call);

/* Serves a Query, or one request of a QueryStream. is_paid: 1 if the request was charged before its
 * calibration and must not be charged again. */
static void serve(struct umbd_call *call, int is_paid)
{
    struct umbd_call_home *home = call->home;
    struct umbw_query_request request UMB__UNSET;
    struct umb_calibration calibration UMB__UNSET;
    struct umbd_batch *batch = NULL;
    struct umb_error error UMB__UNSET;
    int away = 0;
    error.message[0] = '\0';
    if (!umbd_optimistic_reads_has_room(home)) {
        umbd_optimistic_reads_revalidate(home);
        if (call->reply_ended) {
            return; /* an earlier answer had to be discarded */
        }
    }
    enum umb_status status =
        umbw_decode_query_request(call->message, call->message_size,
                                  (size_t)call->server->options.max_points, &request, &error);
    const int has_budget = status == UMB_OK && request.dial.budget_ns > 0;
    if (has_budget) {
        status = umbd_budget_calibrate(call, &request, serve_paid, &calibration, &away, &error);
    }
    if (status == UMB_OK && !away) {
        status = make_batch(call, &request, has_budget ? &calibration : NULL, &batch, &error);
    }
    if (status == UMB_OK && !away) {
        status = answer_batch(call, batch, &request, is_paid, &away, &error);
    }
    if (!away) {
        umbd_batch_recycle(batch, &home->spare);
    }
    if (status != UMB_OK) {
        umbd_call_fail_work(call, status, &error);
    }
}

static void serve_paid(struct umbd_call *call)
{
    serve(call, 1);
}

void umbd_query_serve(struct umbd_call *call)
{
    serve(call, 0);
}
