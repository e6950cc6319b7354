/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Budgets of Shadows.Query and QueryStream. The first request with a budget for a light and a kind
 * of points waits for a calibration. A worker calibrates, on the request's own points if there are
 * many. Then the request is served as if it had just arrived.
 */
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "daemon/work/calibrations.h"
#include "tool/clock.h"

/* Number of points by which a calibration is charged against the rates. They are taken in one step
 * with the request's own points. In two steps, the debt of the calibration would make the request
 * fail. */
#define DETOUR_POINTS 65536

#define PIXEL_BYTES (3 * sizeof(float)) /* a picture's pixel as a point */

/* A calibration in progress; its points lie in its message. */
struct detour {
    struct umbd_task task; /* The first field */
    void (*again)(struct umbd_call *call);
    struct umbs_entry *entry; /* owned */
    uint32_t light;
    enum umbd_point_kind kind;
    uint8_t *message; /* owned */
    size_t message_size;
    struct umb_points points;
    struct umb_picture picture; /* picture whose depths are the points; width 0: none */
    float *pixels;              /* points of the pixels, owned, once they are made */
    struct umb_calibration calibration;
    enum umb_status status;
    struct umb_error error;
};

/* Calibrates. If the asset's file is cut short meanwhile, the calibration's memory (2 MiB) is
 * leaked. This happens at most once for each asset, because the asset is then taken out of use. */
static void measure(void *user)
{
    struct detour *detour = user;
    const struct umb_asset *asset = umbs_entry_asset(detour->entry);
    detour->status =
        detour->kind == UMBD_POINTS_FEW
            ? umb_calibrate(asset, detour->light, umbu_thread_cpu_s, &detour->calibration,
                            &detour->error)
            : umb_calibrate_points(asset, detour->light, &detour->points, umbu_thread_cpu_s,
                                   &detour->calibration, &detour->error);
}

/* Prepares the points of the calibration: the message's points, or the points of its picture's
 * pixels. */
static enum umb_status ready_points(struct detour *detour, struct umb_error *error)
{
    struct umb_points *points = &detour->points;
    if (detour->kind == UMBD_POINTS_FEW) {
        return UMB_OK; /* uses points that the library makes */
    }
    if (detour->picture.width == 0) {
        return umb_points_check(points, error);
    }
    detour->pixels = malloc(points->count * PIXEL_BYTES);
    if (detour->pixels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a calibration");
    }
    detour->picture.depth = points->positions;
    umb_picture_points(&detour->picture, 0, points->count, detour->pixels);
    points->positions = detour->pixels;
    memcpy(points->origin, detour->picture.camera.eye, sizeof points->origin);
    return UMB_OK;
}

/* Calibrates on a worker's thread. It is the `run` of a task with one record. */
static enum umb_status run_detour(struct umbd_task *task, size_t first, size_t count,
                                  struct umbd_slice_result *result)
{
    (void)first;
    (void)count;
    struct detour *detour = (struct detour *)task;
    UMB__TRY(ready_points(detour, &result->error));
    UMB__TRY(umbs_entry_read(detour->entry, measure, detour, &result->error));
    if (detour->status != UMB_OK) {
        result->error = detour->error;
    }
    return detour->status;
}

/* Stores a finished calibration and serves the call's message again. */
static void answer(struct umbd_call *call, struct umbd_task *task)
{
    struct detour *detour = (struct detour *)task;
    if (task->status != UMB_OK) {
        umbd_call_fail_work(call, task->status, &task->error);
        return;
    }
    umbd_calibrations_put(call->backend->calibrations, umbs_entry_item(detour->entry)->id,
                          detour->light, detour->kind, &detour->calibration);
    call->message = detour->message;
    call->message_size = detour->message_size;
    call->message_borrowed = 0;
    detour->message = NULL;
    detour->again(call);
    umbd_call_drop_message(call);
}

static void free_detour(struct umbd_task *task)
{
    struct detour *detour = (struct detour *)task;
    umbs_entry_release(detour->entry);
    free(detour->message);
    free(detour->pixels);
    free(detour);
}

/* The light of a request with a budget, which has at most one target. */
static enum umb_status light_of(struct umbw_query_request request, struct umbw_query_target *light,
                                struct umb_error *error)
{
    if (request.target_count > 0) {
        return umbw_query_target_next(&request, light, error);
    }
    memcpy(light->asset, request.asset, sizeof light->asset);
    light->light = request.settings.light;
    return UMB_OK;
}

/* Sends a detour to the workers; *away is 0 if it stays the caller's. */
static enum umb_status send_away(struct umbd_call *call, struct detour *detour,
                                 const struct umbw_query_request *request, int *away,
                                 struct umb_error *error)
{
    const size_t pixel_bytes = request->has_picture && detour->kind != UMBD_POINTS_FEW
                                   ? request->points.count * PIXEL_BYTES
                                   : 0;
    *away = 0;
    if (!umbd_call_take_points(call, DETOUR_POINTS + UMBD_CALL_POINTS + request->points.count) ||
        !umbd_call_charge(call, call->charged + pixel_bytes)) { /* the call has failed */
        return UMB_OK;
    }
    detour->points = request->points;
    detour->message_size = call->message_size;
    detour->message = umbd_call_take_message_of(call, &detour->points);
    if (detour->message == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a calibration");
    }
    detour->task.run = run_detour;
    detour->task.answer = answer;
    detour->task.free = free_detour;
    detour->task.count = detour->task.slice = 1;
    UMB__TRY(umbd_call_send_task(call, &detour->task, detour->message_size + pixel_bytes, error));
    *away = 1;
    return UMB_OK;
}

enum umb_status umbd_budget_calibrate(struct umbd_call *call,
                                      const struct umbw_query_request *request,
                                      void (*again)(struct umbd_call *call),
                                      struct umb_calibration *calibration, int *away,
                                      struct umb_error *error)
{
    struct umbw_query_target target;
    struct umbs_entry *entry = NULL;
    *away = 0;
    UMB__TRY(light_of(*request, &target, error));
    UMB__TRY(umbd_call_acquire(call, target.asset, &entry, error));
    const enum umbd_point_kind kind = umbd_point_kind_of(umbs_entry_asset(entry), target.light,
                                                         &request->points, request->has_picture);
    if (umbd_calibrations_get(call->backend->calibrations, umbs_entry_item(entry)->id, target.light,
                              kind, calibration)) {
        umbs_entry_release(entry);
        return UMB_OK;
    }
    struct detour *detour = calloc(1, sizeof *detour);
    if (detour == NULL) {
        umbs_entry_release(entry);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a calibration");
    }
    detour->again = again;
    detour->entry = entry;
    detour->light = target.light;
    detour->kind = kind;
    if (request->has_picture) {
        detour->picture = request->picture;
    }
    enum umb_status status = send_away(call, detour, request, away, error);
    if (!*away) {
        free_detour(&detour->task);
        *away = 1;
    }
    return status;
}
