/* SPDX-License-Identifier: Apache-2.0 */
/* Job requests of Bakes calls, see job_request.h. */
#include "daemon/service/job_request.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct umbd_job_request *umbd_job_request_create(struct umbd_call *call)
{
    if (call->backend->jobs == NULL) {
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
    job_request->fd = -1;
    call->state = job_request;
    return job_request;
}

int umbd_job_request_is_allowed(struct umbd_call *call)
{
    struct umbd_job_request *job_request = call->state;
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

int umbd_job_request_set_asset(struct umbd_call *call, const char *id)
{
    struct umbd_job_request *job_request = call->state;
    return umb_id_from_text(id, job_request->asset) == UMB_OK ||
           umbd_call_ok(call, umb_fail(umbd_call_error(call), UMB_E_ARGUMENT,
                                       "asset: '%.80s' is not an id of 64 hexadecimal digits", id));
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
    job_request->step.files(job_request);
}

static void run_work(struct umbj_request *request, struct umbj_service *service)
{
    struct umbd_job_request *job_request = (struct umbd_job_request *)request;
    if (job_request->status == UMB_OK) {
        job_request->step.work(job_request, service);
    }
}

/* Returns a request to its loop. Called on the jobs' thread, or on the thread that ends the
 * service. */
static void come_home(struct umbj_request *request)
{
    struct umbd_job_request *job_request = (struct umbd_job_request *)request;
    if (request->skipped) {
        job_request->status =
            umb_fail(&job_request->error, UMB_E_UNAVAILABLE, "server: shutting down");
    }
    job_request->task.done(&job_request->task);
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

/* Frees a job request that is with its call. Its upload, if any, is freed on the threads of the
 * jobs. */
static void give_up(struct umbj_service *jobs, struct umbd_job_request *job_request)
{
    if (jobs == NULL || (job_request->upload == NULL && job_request->fd < 0)) {
        job_request_free(job_request);
        return;
    }
    job_request->request = (struct umbj_request){
        .files = run_discard, .run = run_drop, .done = free_there, .owner = job_request->owner};
    umbj_service_post(jobs, &job_request->request);
}

void umbd_job_close(struct umbd_call *call)
{
    struct umbd_job_request *job_request = call->state;
    if (job_request != NULL && !job_request->away) {
        give_up(call->backend->jobs, job_request);
    }
}

static struct umbd_job_request *of_task(struct umbd_task *task)
{
    return (struct umbd_job_request *)(void *)((char *)task -
                                               offsetof(struct umbd_job_request, task));
}

/* The call has ended meanwhile. */
static void free_task(struct umbd_task *task)
{
    const struct umbd_call_home *home = task->home;
    give_up(home->backend->jobs, of_task(task));
}

static void answer_call(struct umbd_call *call, struct umbd_task *task)
{
    struct umbd_job_request *job_request = of_task(task);
    job_request->away = 0;
    free(job_request->message);
    job_request->message = NULL;
    if (call->reply_ended) {
        return; /* the call failed meanwhile, say by its deadline */
    }
    if (job_request->status != UMB_OK) {
        umbd_call_fail_status(call, job_request->status, &job_request->error);
    } else if (job_request->step.answer != NULL) {
        job_request->step.answer(job_request, call);
    }
}

void umbd_job_request_send(struct umbd_call *call, struct umbd_job_step step)
{
    struct umbd_job_request *job_request = call->state;
    job_request->away = 1;
    job_request->status = UMB_OK;
    job_request->step = step;
    job_request->service = call->backend->jobs;
    job_request->request = (struct umbj_request){.files = step.files != NULL ? run_files : NULL,
                                                 .run = step.work != NULL ? run_work : NULL,
                                                 .reads = step.reads,
                                                 .done = come_home,
                                                 .owner = job_request->owner};
    job_request->task.answer = answer_call;
    job_request->task.free = free_task;
    job_request->task.is_kept = 1;
    umbd_call_await(call, &job_request->task, call->task_bytes);
    umbj_service_post(job_request->service, &job_request->request);
}
