/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shadows.Query and QueryStream. A small batch is answered at once on the loop, within a time
 * budget a wake-up; a larger one goes to the pool, and comes back through umbd_service_query_done.
 *
 * Each batch holds one version of its asset from here to the end of its work, and the reply names
 * that version.
 */
#include "daemon/query_budget.h"
#include "base/compat.h"
#include "query/stages.h"

#include <math.h>
#include <string.h>

/* Bytes of a reply's prefix, stats and ids. */
#define HEAD_MAX (256 + UMBW_TARGETS_MAX * (2 + UMB_ID_BYTES))

/* Work that is answered on the loop: about 0.2 ms at 0.1 us a look-up. Below that, two thread
 * switches cost more than they save. */
#define INLINE_WORK 2048

/* Look-ups in units of one tap; wide windows read eight texels of a row at a time. */
static uint64_t work_of(const struct umb_query_settings *settings, size_t count)
{
    uint64_t taps = settings->taps > 0 ? settings->taps : 1;
    const struct umb__filter *filter = umb__filter_of(settings->filter);
    const double each =
        filter->work + filter->work_radian * fmax(fmin(settings->light_extent, 1), 0);
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

static int is_small(const struct umb_query_settings *settings, size_t count, size_t parts)
{
    return work_of(settings, count) * parts <= INLINE_WORK;
}

/* Description of the batch in the reply, without its answers. ids: [part_count * UMB_ID_BYTES]. */
static struct umbw_query_reply reply_of(const struct umbd_batch *batch, int with_targets,
                                        uint8_t *ids)
{
    struct umbw_query_reply reply = {
        .visibility_bytes = batch->value_bytes,
        .stats = batch->stats,
        .nanoseconds = batch->cpu_ns,
        .has_stats = batch->want_stats,
    };
    for (size_t i = 0; i < batch->part_count; i++) {
        memcpy(ids + i * UMB_ID_BYTES, umbs_entry_item(batch->parts[i].entry)->id, UMB_ID_BYTES);
    }
    memcpy(reply.asset_id, ids, UMB_ID_BYTES);
    if (with_targets) {
        reply.asset_ids = ids;
        reply.asset_id_count = batch->part_count;
    }
    if (batch->want_stats) {
        reply.voxel_m = voxel_edge_m(&batch->parts[0]);
        state_setting(batch, &reply);
    }
    return reply;
}

/* Answers into the reply itself. The next flush revalidates the answers of one version. */
static void answer_inline(struct umbd_call *call, struct umbd_batch *batch,
                          const struct umbw_query_request *request)
{
    uint8_t ids[UMBW_TARGETS_MAX * UMB_ID_BYTES] UMB__UNSET;
    struct umbw_query_reply reply = reply_of(batch, request->target_count > 0, ids);
    size_t room = umbw_query_reply_room(&reply);
    uint8_t *at = umbd_call_reserve(call, room + batch->value_bytes);
    if (at == NULL) {
        return;
    }
    uint64_t from = umbd_conn_began(call->conn);
    batch->values = at + room;
    batch->is_optimistic = request->target_count == 0;
    umbd_batch_run(batch, &call->conn->loop->daemon->metrics);
    umbd_conn_spent(call->conn, from);
    if (batch->status != UMB_OK) {
        umbd_call_fail_status(call, batch->status, &batch->error);
        return;
    }
    if (batch->is_optimistic) {
        umbd_optimistic_reads_add(call, batch, request->asset);
    }
    reply.stats = batch->stats;
    reply.nanoseconds = batch->cpu_ns;
    size_t head = umbw_write_query_reply_head(&reply, at);
    if (head < room) {
        memmove(at + head, at + room, batch->value_bytes); /* with stats only */
    }
    umbd_call_commit(call, head + batch->value_bytes);
}

/* Bytes of a batch's answers: packing holds them, those of the base, and the packed ones. */
static size_t answer_bytes(const struct umbd_batch *batch)
{
    return (batch->picture_work.pack ? 5 : 1) * batch->value_bytes;
}

/* Hands the batch to the workers; it is the caller's again if that fails. */
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
    enum umb_status status = umbd_batch_reserve(batch, umbw_query_reply_room(&reply), error);
    if (status == UMB_OK) {
        batch->message = umbd_call_take_message_of(call, &batch->points);
        status = batch->message != NULL ? UMB_OK : UMB_E_NO_MEMORY;
    }
    if (status != UMB_OK) {
        return status;
    }
    if (batch->is_borrowed) {
        umbs_entry_retain(batch->parts[0].entry);
        batch->is_borrowed = 0;
    }
    batch->with_targets = with_targets;
    batch->deadline_ns = call->deadline_ns;
    batch->lane = call->conn->serial;
    batch->stream_id = call->stream_id;
    batch->done = umbd_loop_batch_done;
    batch->home = call->conn->loop;
    call->batch_bytes = call->message_size + answer_bytes(batch);
    call->batch = batch; /* before the submit: it may come home at once */
    status = umbd_pool_submit(call->conn->loop->daemon->pool, batch, error);
    if (status != UMB_OK) {
        call->batch = NULL;
    }
    return status;
}

static enum umb_status add_part(struct umbd_call *call, struct umbd_batch *batch, const char *asset,
                                uint32_t light, struct umb_error *error)
{
    struct umbs_entry *entry = NULL;
    enum umb_status status = umbd_call_acquire(call, asset, &entry, error);
    return status == UMB_OK ? umbd_batch_add(batch, entry, light, error) : status;
}

/* Adds the one part of a batch, reusing the last one if it is equal: requests of one event mostly
 * ask the same asset. */
static enum umb_status add_only_part(struct umbd_call *call, struct umbd_batch *batch,
                                     const struct umbw_query_request *request,
                                     struct umb_error *error)
{
    struct umbd_loop *loop = call->conn->loop;
    struct umbs_entry *entry = umbd_optimistic_reads_find(loop, request->asset);
    enum umb_status status;
    if (entry != NULL && umbd_call_sees(call, umbs_entry_item(entry)->id)) {
        batch->is_borrowed = 1;
        if (umbd_batch_repeat(batch, entry, loop->optimistic.turn)) {
            return UMB_OK;
        }
        status = umbd_batch_add(batch, entry, request->settings.light, error);
    } else {
        status = add_part(call, batch, request->asset, request->settings.light, error);
    }
    if (status == UMB_OK) {
        batch->parts[0].turn = loop->optimistic.turn;
    }
    return status;
}

/* A batch with a part for each target. Out: NULL if the call is away to be calibrated, or failed by
 * its rate. */
static enum umb_status make_batch(struct umbd_call *call, struct umbw_query_request *request,
                                  struct umbd_batch **out, struct umb_error *error)
{
    struct umbd_loop *loop = call->conn->loop;
    size_t count = request->target_count;
    struct umbw_query_target target;
    struct umb_calibration calibration;
    int away = 0;
    enum umb_status status = UMB_OK;
    if (request->dial.budget_ns > 0) {
        status = umbd_budget_calibrate(call, request, &calibration, &away, error);
    }
    if (status == UMB_OK && !away) {
        status =
            count == 0
                ? umbd_batch_reuse(&loop->spare, &request->settings, &request->points, out, error)
                : umbd_batch_create(count, &request->settings, &request->points, out, error);
    }
    if (status != UMB_OK || away) {
        return status;
    }
    struct umbd_batch *batch = *out;
    batch->want_stats = request->want_stats;
    batch->picture_work.has_picture = request->has_picture;
    batch->picture_work.picture = request->picture;
    batch->picture_work.pack = request->pack;
    batch->dial = request->dial;
    batch->calibration = request->dial.budget_ns > 0 ? &calibration : NULL;
    if (count == 0) {
        status = add_only_part(call, batch, request, error);
    }
    for (size_t i = 0; status == UMB_OK && i < count; i++) {
        status = umbw_query_target_next(request, &target, error);
        if (status == UMB_OK) {
            status = add_part(call, batch, target.asset, target.light, error);
        }
    }
    batch->calibration = NULL;
    return status;
}

/* Reuses the stream's last answers as the base if the client still has them; otherwise frees
 * them. */
static void take_base(struct umbd_call *call, struct umbd_batch *batch, uint64_t mark)
{
    if (mark != 0 && mark == call->kept_picture.mark &&
        call->kept_picture.bytes == batch->value_bytes) {
        batch->picture_work.kept = call->kept_picture;
        call->kept_picture = (struct umbd_kept_picture){0};
    }
    umbd_kept_picture_drop(&call->kept_picture);
}

void umbd_service_query(struct umbd_call *call)
{
    struct umbd_loop *loop = call->conn->loop;
    struct umbd_daemon *daemon = loop->daemon;
    struct umbw_query_request request UMB__UNSET;
    struct umbd_batch *batch = NULL;
    struct umb_error error UMB__UNSET;
    error.message[0] = '\0';
    if (!umbd_optimistic_reads_has_room(loop)) {
        umbd_optimistic_reads_revalidate(loop);
        if (call->reply_ended) {
            return; /* an earlier answer had to be discarded */
        }
    }
    enum umb_status status = umbw_decode_query_request(
        call->message, call->message_size, (size_t)daemon->options.max_points, &request, &error);
    if (status == UMB_OK) {
        status = make_batch(call, &request, &batch, &error);
    }
    if (status == UMB_OK && batch == NULL) {
        return; /* comes again when it is calibrated */
    }
    int targets = request.target_count > 0;
    if (status == UMB_OK && !call->is_paid &&
        !umbd_call_take_points(call, UMBD_CALL_POINTS + request.points.count * batch->part_count)) {
        umbd_batch_recycle(batch, &loop->spare);
        return;
    }
    if (status == UMB_OK && !umbd_call_charge(call, call->charged + answer_bytes(batch))) {
        umbd_batch_recycle(batch, &loop->spare);
        return;
    }
    if (status == UMB_OK && request.pack) {
        take_base(call, batch, request.base_mark);
    }
    if (status == UMB_OK && request.points.count > 0 &&
        !(!request.pack && is_small(&batch->settings, request.points.count, batch->part_count) &&
          umbd_conn_has_turn(call->conn))) {
        status = answer_by_pool(call, batch, targets, &error);
        if (status == UMB_OK) {
            return;
        }
    } else if (status == UMB_OK) {
        answer_inline(call, batch, &request);
    }
    umbd_batch_recycle(batch, &loop->spare);
    if (status == UMB_E_BUSY) {
        umbd_call_shed(call, &error);
    } else if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
    }
}

void umbd_service_query_calibrated(struct umbd_call *call, struct umbd_batch *batch)
{
    const enum umb_status status = umbd_budget_take(call, batch);
    if (status == UMB_OK) {
        call->is_paid = 1;
        umbd_call_serve(call);
        call->is_paid = 0;
    } else if (status == UMB_E_BUSY) {
        umbd_call_shed(call, &batch->error);
    } else {
        umbd_call_fail_status(call, status, &batch->error);
    }
}

void umbd_service_query_done(struct umbd_call *call, struct umbd_batch *batch)
{
    uint8_t ids[UMBW_TARGETS_MAX * UMB_ID_BYTES];
    uint8_t head[HEAD_MAX];
    if (batch->status == UMB_E_BUSY) {
        umbd_call_shed(call, &batch->error);
        return;
    }
    if (batch->status != UMB_OK) {
        umbd_call_fail_status(call, batch->status, &batch->error);
        return;
    }
    struct umbw_query_reply reply = reply_of(batch, batch->with_targets, ids);
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
    if (!umbd_method_takes_many(call->method)) {
        (void)umbd_call_charge(call, batch->value_bytes); /* fewer bytes than before: cannot fail */
    }
    if (batch->picture_work.pack && umbd_method_takes_many(call->method)) {
        umbd_kept_picture_drop(&call->kept_picture);
        call->kept_picture = batch->picture_work.kept;
        batch->picture_work.kept = (struct umbd_kept_picture){0};
    }
    umbd_call_reply_block(call, block, first, batch->head_room + reply.visibility_bytes);
}
