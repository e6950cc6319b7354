/* SPDX-License-Identifier: Apache-2.0 */
/* Bakes.Watch, Cancel, List and Delete. Submit and Fetch are in service_bakes_data.c. */
#include <stdlib.h>
#include <string.h>

#include "daemon/service/job_request.h"

#define WATCH_MS     200 /* between two messages about progress */
#define LIST_DEFAULT 100

/* Fills what a job's status says on the wire; texts are borrowed. */
static void status_of_job(const struct umbj_job *job, struct umb_job_status *status)
{
    memset(status, 0, sizeof *status);
    memcpy(status->job, job->id, sizeof status->job);
    memcpy(status->owner, job->owner, sizeof status->owner);
    memcpy(status->cause, job->cause, sizeof status->cause);
    status->state = (int)job->state;
    status->failure = (int)job->failure;
    status->priority = job->priority;
    status->has_asset = job->has_asset;
    memcpy(status->asset, job->asset, sizeof status->asset);
    status->epoch = (uint64_t)job->epoch;
    status->bundle_bytes = (uint64_t)job->bundle_bytes;
    status->submitted_ms = job->submitted_ms;
    status->started_ms = job->started_ms;
    status->ended_ms = job->ended_ms;
    status->not_before_ms = job->not_before_ms;
    status->left_ms = -1;
}

/* --- Cancel --- */

static void cancel(struct umbd_job_request *job_request, struct umbj_service *service)
{
    char id[UMBJ_ID_SIZE];
    memcpy(id, job_request->job.id, sizeof id);
    job_request->status = umbj_service_cancel(service, id, umbd_job_request_owner(job_request),
                                              &job_request->job, &job_request->error);
}

static void cancelled(struct umbd_job_request *job_request, struct umbd_call *call)
{
    struct umb_job_status status;
    status_of_job(&job_request->job, &status);
    UMBD_CALL_SEND(call, job_status, &status);
}

/* Creates the call's job request for the job that the message names, or fails the call. */
static struct umbd_job_request *begin(struct umbd_call *call)
{
    struct umbd_job_request *job_request = umbd_job_request_create(call);
    return job_request != NULL && UMBD_CALL_READ(call, job_request, job_request->job.id)
               ? job_request
               : NULL;
}

void umbd_job_cancel_serve(struct umbd_call *call)
{
    if (begin(call) != NULL) {
        umbd_job_request_send(call, (struct umbd_job_step){NULL, cancel, cancelled, 0});
    }
}

/* --- Watch --- */

static void show(struct umbd_job_request *job_request, struct umbj_service *service)
{
    job_request->status = umbj_service_show(
        service, job_request->job.id, umbd_job_request_owner(job_request), &job_request->error);
}

/* A job's encoded status, made under the snapshot's lock. */
struct look {
    struct umbw_buffer reply;
    struct umb_error *error;
    enum umb_status status;
    uint64_t version;
    int over;
};

static void take_look(void *user, const struct umbj_standing *standing)
{
    struct look *look = user;
    struct umb_job_status status;
    status_of_job(&standing->job, &status);
    if (standing->loading) { /* the asset cannot be queried yet */
        status.state = UMBJ_RUNNING;
        status.has_asset = 0;
        status.ended_ms = 0;
    }
    if (status.state == UMBJ_RUNNING) {
        memcpy(status.phase, standing->phase, sizeof status.phase);
        memcpy(status.unit, standing->unit, sizeof status.unit);
        status.done = standing->done;
        status.total = standing->total;
        status.rate = standing->rate;
        status.left_ms = standing->left_ms;
    }
    status.tiles_done = standing->tiles.done;
    status.tiles_total = standing->tiles.total;
    status.tiles_found = standing->tiles.found;
    status.plan = standing->plan;
    status.notices = standing->notices;
    look->version = standing->version;
    look->over = umbj_is_over((enum umbj_state)status.state);
    look->status = umbw_encode_job_status(&status, &look->reply, look->error);
}

void umbd_job_watch_tick(struct umbd_call *call)
{
    struct umbd_job_request *job_request = call->state;
    struct umbj_service *jobs = call->backend->jobs;
    const uint64_t now_ms = umbd_call_now_ms(call);
    if (job_request == NULL || !job_request->watching || call->reply_ended || jobs == NULL ||
        now_ms - job_request->status_ms < WATCH_MS || umbd_call_unsent(call) > 0) {
        return;
    }
    struct umbj_snapshot *snapshot = umbj_service_snapshot(jobs);
    if (umbj_snapshot_version(snapshot, job_request->job.id) == job_request->version ||
        !umbd_job_request_is_allowed(call)) {
        return;
    }
    struct look look = {.error = umbd_call_error(call)};
    job_request->status_ms = now_ms;
    if (!umbj_snapshot_look(snapshot, job_request->job.id, umbd_job_request_owner(job_request),
                            take_look, &look)) {
        look.status =
            umb_fail(look.error, UMB_E_NOT_FOUND, "job: '%.40s' is gone", job_request->job.id);
    }
    job_request->version = look.version;
    umbd_call_reply_or_fail(call, look.status, &look.reply);
    if (look.status == UMB_OK && look.over) {
        umbd_call_finish(call);
    }
}

static void watch(struct umbd_job_request *job_request, struct umbd_call *call)
{
    job_request->watching = 1;
    umbd_job_watch_tick(call);
}

void umbd_job_watch_serve(struct umbd_call *call)
{
    struct umbd_job_request *job_request = begin(call);
    if (job_request == NULL) {
        return;
    }
    if (umbj_snapshot_version(umbj_service_snapshot(call->backend->jobs), job_request->job.id)) {
        watch(job_request, call); /* the usual case: the table is not needed */
    } else {
        umbd_job_request_send(call, (struct umbd_job_step){NULL, show, watch, 0});
    }
}

/* --- List --- */

static void list(struct umbd_job_request *job_request)
{
    job_request->status =
        umbj_service_list(job_request->service, job_request->owner, job_request->limit,
                          &job_request->jobs, &job_request->job_count, &job_request->error);
}

static void listed(struct umbd_job_request *job_request, struct umbd_call *call)
{
    struct umbw_job_list reply = {.count = job_request->job_count};
    reply.jobs = calloc(reply.count + 1, sizeof *reply.jobs);
    if (reply.jobs == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    for (size_t i = 0; i < reply.count; i++) {
        status_of_job(&job_request->jobs[i], &reply.jobs[i]);
    }
    UMBD_CALL_SEND(call, job_list, &reply);
    free(reply.jobs);
}

void umbd_job_list_serve(struct umbd_call *call)
{
    struct umbd_job_request *job_request = umbd_job_request_create(call);
    if (job_request == NULL || !UMBD_CALL_READ(call, list_jobs_request, &job_request->limit)) {
        return;
    }
    job_request->limit = job_request->limit > 0 ? job_request->limit : LIST_DEFAULT;
    umbd_job_request_send(call, (struct umbd_job_step){list, NULL, listed, .reads = 1});
}

/* --- Delete --- */

static void delete (struct umbd_job_request *job_request, struct umbj_service *service)
{
    job_request->status = umbj_service_delete(
        service, job_request->asset, umbd_job_request_owner(job_request), &job_request->error);
}

static void deleted(struct umbd_job_request *job_request, struct umbd_call *call)
{
    struct umbw_buffer reply = {0};
    (void)job_request;
    umbd_call_reply_or_fail(call, umbw_encode_empty(&reply, umbd_call_error(call)), &reply);
}

void umbd_job_delete_serve(struct umbd_call *call)
{
    char id[UMBW_ASSET_NAME_MAX + 1];
    if (umbd_job_request_create(call) != NULL && UMBD_CALL_READ(call, delete_request, id) &&
        umbd_job_request_set_asset(call, id)) {
        umbd_job_request_send(call, (struct umbd_job_step){NULL, delete, deleted, 0});
    }
}
