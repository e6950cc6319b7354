/* SPDX-License-Identifier: Apache-2.0 */
/* Job requests of Bakes calls, see job_request.h. */
#include "daemon/service/job_request.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/call/call_rights.h"

struct umbd_job_request *umbd_job_request_create(struct umbd_call *call)
{
    struct umbd_daemon *daemon = call->conn->loop->daemon;
    if (daemon->jobs == NULL) {
        umbd_call_fail(call, UMBW_GRPC_UNIMPLEMENTED, "this server takes no jobs (--jobs)");
        return NULL;
    }
    struct umbd_job_request *job_request = calloc(1, sizeof *job_request);
    if (job_request == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return NULL;
    }
    const struct umbd_token *token = umbd_call_token(call);
    if (token != NULL) {
        memcpy(job_request->owner, token->name, sizeof job_request->owner);
        job_request->is_admin = (token->scopes & UMBD_SCOPE_ADMIN) != 0;
    }
    job_request->home = call->conn->loop;
    job_request->lane = call->conn->serial;
    job_request->stream_id = call->stream_id;
    job_request->fd = -1;
    call->job_request = job_request;
    return job_request;
}

int umbd_job_request_is_allowed(struct umbd_call *call)
{
    struct umbd_job_request *job_request = call->job_request;
    if (!umbd_call_is_allowed(call)) {
        return 0;
    }
    const struct umbd_token *token = umbd_call_token(call);
    if (strcmp(token != NULL ? token->name : "", job_request->owner) != 0) {
        struct umb_error error;
        enum umb_status status = umb_fail(
            &error, UMB_E_PERMISSION, "authorization: the token of this call was '%s' and is '%s'",
            job_request->owner, token != NULL ? token->name : "");
        umbd_call_fail_status(call, status, &error);
        return 0;
    }
    job_request->is_admin = token != NULL && (token->scopes & UMBD_SCOPE_ADMIN) != 0;
    return 1;
}

const char *umbd_job_request_owner(const struct umbd_job_request *job_request)
{
    return job_request->is_admin ? NULL : job_request->owner;
}

/* Frees everything; blocks on the disk if an upload must be removed. */
static void job_request_free(struct umbd_job_request *job_request)
{
    if (job_request->fd >= 0) {
        close(job_request->fd);
    }
    umbj_upload_destroy(job_request->upload);
    umbw_manifest_finish(&job_request->wire);
    free(job_request->list);
    free(job_request->settings);
    free(job_request->prepared);
    free(job_request->message);
    free(job_request->jobs);
    free(job_request->chunk);
    free(job_request);
}

static void run_files(struct umbj_request *request)
{
    struct umbd_job_request *job_request = (struct umbd_job_request *)request;
    job_request->files(job_request);
}

static void run_work(struct umbj_request *request, struct umbj_service *service)
{
    struct umbd_job_request *job_request = (struct umbd_job_request *)request;
    if (job_request->status == UMB_OK) {
        job_request->work(job_request, service);
    }
}

/* Returns a request to its loop; on the jobs' thread, or on the one that ends the service. */
static void come_home(struct umbj_request *request)
{
    struct umbd_job_request *job_request = (struct umbd_job_request *)request;
    struct umbd_loop *loop = job_request->home;
    if (request->skipped) {
        job_request->status =
            umb_fail(&job_request->error, UMB_E_UNAVAILABLE, "server: shutting down");
    }
    job_request->next_done = NULL;
    pthread_mutex_lock(&loop->done_mutex);
    if (loop->job_request_last != NULL) {
        loop->job_request_last->next_done = job_request;
    } else {
        loop->job_request_first = job_request;
    }
    loop->job_request_last = job_request;
    pthread_mutex_unlock(&loop->done_mutex);
    uv_async_send(&loop->wake);
}

static void send_request(struct umbd_call *call, struct umbj_request request,
                         void (*answer)(struct umbd_job_request *, struct umbd_call *))
{
    struct umbd_job_request *job_request = call->job_request;
    job_request->away = 1;
    job_request->status = UMB_OK;
    job_request->answer = answer;
    job_request->service = call->conn->loop->daemon->jobs;
    job_request->request = request;
    job_request->request.done = come_home;
    job_request->request.owner = job_request->owner;
    umbj_service_post(job_request->service, &job_request->request);
}

void umbd_job_request_send(struct umbd_call *call, void (*files)(struct umbd_job_request *),
                           void (*work)(struct umbd_job_request *, struct umbj_service *),
                           void (*answer)(struct umbd_job_request *, struct umbd_call *))
{
    call->job_request->files = files;
    call->job_request->work = work;
    send_request(call,
                 (struct umbj_request){.files = files != NULL ? run_files : NULL,
                                       .run = work != NULL ? run_work : NULL},
                 answer);
}

void umbd_job_request_send_reading(struct umbd_call *call, void (*reads)(struct umbd_job_request *),
                                   void (*answer)(struct umbd_job_request *, struct umbd_call *))
{
    call->job_request->files = reads;
    send_request(call, (struct umbj_request){.files = run_files, .reads = 1}, answer);
}

static void run_discard(struct umbj_request *request)
{
    umbj_upload_discard(((struct umbd_job_request *)request)->upload);
}

static void run_drop(struct umbj_request *request, struct umbj_service *service)
{
    struct umbd_job_request *job_request = (struct umbd_job_request *)request;
    umbj_service_drop_upload(service, job_request->upload);
    job_request->upload = NULL;
}

static void free_there(struct umbj_request *request)
{
    job_request_free((struct umbd_job_request *)request);
}

static void give_up(struct umbd_daemon *daemon, struct umbd_job_request *job_request)
{
    if (daemon->jobs == NULL || (job_request->upload == NULL && job_request->fd < 0)) {
        job_request_free(job_request);
        return;
    }
    job_request->request = (struct umbj_request){
        .files = run_discard, .run = run_drop, .done = free_there, .owner = job_request->owner};
    umbj_service_post(daemon->jobs, &job_request->request);
}

void umbd_job_request_drop(struct umbd_call *call)
{
    struct umbd_job_request *job_request = call->job_request;
    call->job_request = NULL;
    if (job_request == NULL) {
        return;
    }
    if (job_request->away) {
        /* Its memory stays counted until the loop gets it back. */
        job_request->charged = call->charged;
        umbd_conn_hand_over(call->conn, call->charged);
        call->charged = 0;
    } else {
        give_up(call->conn->loop->daemon, job_request);
    }
}

static void deliver(struct umbd_loop *loop, struct umbd_job_request *job_request)
{
    struct umbd_conn *conn = umbd_conn_find(loop, job_request->lane);
    struct umbd_call *call =
        conn != NULL ? nghttp2_session_get_stream_user_data(conn->session, job_request->stream_id)
                     : NULL;
    if (call == NULL || call->job_request != job_request) {
        umbd_daemon_uncharge(loop->daemon, job_request->charged);
        give_up(loop->daemon, job_request);
        return;
    }
    job_request->away = 0;
    free(job_request->message);
    job_request->message = NULL;
    if (call->reply_ended) {
        return; /* the call failed meanwhile, say by its deadline */
    }
    if (job_request->status != UMB_OK) {
        umbd_call_fail_status(call, job_request->status, &job_request->error);
    } else {
        job_request->answer(job_request, call);
    }
    if (umbd_method_takes_many(call->method)) {
        umbd_stream_pump(call);
    }
    umbd_loop_flush_later(conn);
}

void umbd_job_requests_collect(struct umbd_loop *loop)
{
    pthread_mutex_lock(&loop->done_mutex);
    struct umbd_job_request *job_request = loop->job_request_first;
    loop->job_request_first = loop->job_request_last = NULL;
    pthread_mutex_unlock(&loop->done_mutex);
    while (job_request != NULL) {
        struct umbd_job_request *next = job_request->next_done;
        deliver(loop, job_request);
        job_request = next;
    }
}

void umbd_status_of_job(const struct umbj_job *job, struct umbw_job_status *status)
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
