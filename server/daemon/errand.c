/* SPDX-License-Identifier: Apache-2.0 */
/* Errands to the job service, see errand.h. */
#include "daemon/errand.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/call_rights.h"

struct umbd_errand *umbd_errand_create(struct umbd_call *call)
{
    struct umbd_daemon *daemon = call->conn->loop->daemon;
    if (daemon->jobs == NULL) {
        umbd_call_fail(call, UMBW_GRPC_UNIMPLEMENTED, "this server takes no jobs (--jobs)");
        return NULL;
    }
    struct umbd_errand *errand = calloc(1, sizeof *errand);
    if (errand == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return NULL;
    }
    const struct umbd_token *token = umbd_call_token(call);
    if (token != NULL) {
        memcpy(errand->owner, token->name, sizeof errand->owner);
        errand->is_admin = (token->scopes & UMBD_SCOPE_ADMIN) != 0;
    }
    errand->home = call->conn->loop;
    errand->lane = call->conn->serial;
    errand->stream_id = call->stream_id;
    errand->fd = -1;
    call->errand = errand;
    return errand;
}

int umbd_errand_is_allowed(struct umbd_call *call)
{
    struct umbd_errand *errand = call->errand;
    if (!umbd_call_is_allowed(call)) {
        return 0;
    }
    const struct umbd_token *token = umbd_call_token(call);
    if (strcmp(token != NULL ? token->name : "", errand->owner) != 0) {
        struct umb_error error;
        enum umb_status status = umb_fail(
            &error, UMB_E_PERMISSION, "authorization: the token of this call was '%s' and is '%s'",
            errand->owner, token != NULL ? token->name : "");
        umbd_call_fail_status(call, status, &error);
        return 0;
    }
    errand->is_admin = token != NULL && (token->scopes & UMBD_SCOPE_ADMIN) != 0;
    return 1;
}

const char *umbd_errand_owner(const struct umbd_errand *errand)
{
    return errand->is_admin ? NULL : errand->owner;
}

/* Frees all; blocks on the disk if an upload has to be removed. */
static void errand_free(struct umbd_errand *errand)
{
    if (errand->fd >= 0) {
        close(errand->fd);
    }
    umbj_upload_destroy(errand->upload);
    umbw_manifest_finish(&errand->wire);
    free(errand->list);
    free(errand->settings);
    free(errand->prepared);
    free(errand->message);
    free(errand->jobs);
    free(errand->chunk);
    free(errand);
}

static void run_files(struct umbj_request *request)
{
    struct umbd_errand *errand = (struct umbd_errand *)request;
    errand->files(errand);
}

static void run_work(struct umbj_request *request, struct umbj_service *service)
{
    struct umbd_errand *errand = (struct umbd_errand *)request;
    if (errand->status == UMB_OK) {
        errand->work(errand, service);
    }
}

/* On the jobs' thread, or on the one that ends the service. */
static void come_home(struct umbj_request *request)
{
    struct umbd_errand *errand = (struct umbd_errand *)request;
    struct umbd_loop *loop = errand->home;
    if (request->skipped) {
        errand->status = umb_fail(&errand->error, UMB_E_UNAVAILABLE, "server: shutting down");
    }
    errand->next_done = NULL;
    pthread_mutex_lock(&loop->done_mutex);
    if (loop->errand_last != NULL) {
        loop->errand_last->next_done = errand;
    } else {
        loop->errand_first = errand;
    }
    loop->errand_last = errand;
    pthread_mutex_unlock(&loop->done_mutex);
    uv_async_send(&loop->wake);
}

static void send_request(struct umbd_call *call, struct umbj_request request,
                         void (*answer)(struct umbd_errand *, struct umbd_call *))
{
    struct umbd_errand *errand = call->errand;
    errand->away = 1;
    errand->status = UMB_OK;
    errand->answer = answer;
    errand->service = call->conn->loop->daemon->jobs;
    errand->request = request;
    errand->request.done = come_home;
    errand->request.owner = errand->owner;
    umbj_service_post(errand->service, &errand->request);
}

void umbd_errand_send(struct umbd_call *call, void (*files)(struct umbd_errand *),
                      void (*work)(struct umbd_errand *, struct umbj_service *),
                      void (*answer)(struct umbd_errand *, struct umbd_call *))
{
    call->errand->files = files;
    call->errand->work = work;
    send_request(call,
                 (struct umbj_request){.files = files != NULL ? run_files : NULL,
                                       .run = work != NULL ? run_work : NULL},
                 answer);
}

void umbd_errand_send_reading(struct umbd_call *call, void (*reads)(struct umbd_errand *),
                              void (*answer)(struct umbd_errand *, struct umbd_call *))
{
    call->errand->files = reads;
    send_request(call, (struct umbj_request){.files = run_files, .reads = 1}, answer);
}

static void run_discard(struct umbj_request *request)
{
    umbj_upload_discard(((struct umbd_errand *)request)->upload);
}

static void run_drop(struct umbj_request *request, struct umbj_service *service)
{
    struct umbd_errand *errand = (struct umbd_errand *)request;
    umbj_service_drop_upload(service, errand->upload);
    errand->upload = NULL;
}

static void free_there(struct umbj_request *request)
{
    errand_free((struct umbd_errand *)request);
}

static void give_up(struct umbd_daemon *daemon, struct umbd_errand *errand)
{
    if (daemon->jobs == NULL || (errand->upload == NULL && errand->fd < 0)) {
        errand_free(errand);
        return;
    }
    errand->request = (struct umbj_request){
        .files = run_discard, .run = run_drop, .done = free_there, .owner = errand->owner};
    umbj_service_post(daemon->jobs, &errand->request);
}

void umbd_errand_drop(struct umbd_call *call)
{
    struct umbd_errand *errand = call->errand;
    call->errand = NULL;
    if (errand == NULL) {
        return;
    }
    if (errand->away) {
        /* What it holds stays counted until the loop gets it back. */
        errand->charged = call->charged;
        umbd_conn_hand_over(call->conn, call->charged);
        call->charged = 0;
    } else {
        give_up(call->conn->loop->daemon, errand);
    }
}

static void deliver(struct umbd_loop *loop, struct umbd_errand *errand)
{
    struct umbd_conn *conn = umbd_conn_find(loop, errand->lane);
    struct umbd_call *call =
        conn != NULL ? nghttp2_session_get_stream_user_data(conn->session, errand->stream_id)
                     : NULL;
    if (call == NULL || call->errand != errand) {
        umbd_daemon_uncharge(loop->daemon, errand->charged);
        give_up(loop->daemon, errand);
        return;
    }
    errand->away = 0;
    free(errand->message);
    errand->message = NULL;
    if (call->reply_ended) {
        return; /* failed meanwhile: a deadline */
    }
    if (errand->status != UMB_OK) {
        umbd_call_fail_status(call, errand->status, &errand->error);
    } else {
        errand->answer(errand, call);
    }
    if (umbd_method_takes_many(call->method)) {
        umbd_stream_pump(call);
    }
    umbd_loop_flush_later(conn);
}

void umbd_errands_collect(struct umbd_loop *loop)
{
    pthread_mutex_lock(&loop->done_mutex);
    struct umbd_errand *errand = loop->errand_first;
    loop->errand_first = loop->errand_last = NULL;
    pthread_mutex_unlock(&loop->done_mutex);
    while (errand != NULL) {
        struct umbd_errand *next = errand->next_done;
        deliver(loop, errand);
        errand = next;
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
