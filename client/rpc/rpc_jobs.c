/* SPDX-License-Identifier: Apache-2.0 */
/* Bakes.Watch, Cancel, List, Fetch and Delete. Submit is in rpc_submit.c. */
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "rpc_client.h"
#include "umbrage/jobs.h"
#include "wire/bakes.h"

#define FOR_EVER_MS UINT32_MAX /* 49 days */

/* Frees the texts of a decoded status. All texts are in one block of memory, which begins with the
 * plan. */
static void drop_texts(struct umb_job_status *status)
{
    free((void *)(uintptr_t)status->plan);
    status->plan = status->notices = NULL;
}

static enum umb_status encode_job(const char *job, struct umbw_buffer *body,
                                  struct umb_error *error)
{
    const size_t length = job == NULL ? 0 : strlen(job);
    if (length == 0 || length > UMBW_JOB_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "job: has %zu bytes, must have 1 to %d", length,
                        UMBW_JOB_MAX);
    }
    return umbw_encode_job_request(job, body, error);
}

/* --- Watch --- */

struct watch {
    struct umb__watch watch;
    umb_job_status_fn on_status;
    void *user;
};

static bool take_status(void *user, const uint8_t *message, size_t size)
{
    struct watch *watch = user;
    struct umb_job_status status;
    if (umbw_decode_job_status(message, size, &status, &watch->watch.error) != UMB_OK) {
        return false;
    }
    watch->watch.stopped = !watch->on_status(watch->user, &status);
    drop_texts(&status);
    return !watch->watch.stopped;
}

enum umb_status umb_client_watch(struct umb_client *client, const char *job,
                                 umb_job_status_fn on_status, void *user,
                                 struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    struct watch watch = {.on_status = on_status, .user = user};
    const struct umb__ending ending = {&watch, sizeof watch, umb__decode_nothing,
                                       umb__watch_finish};
    const struct umb__call_plan plan = {
        .path = UMBW_PATH_BAKES_WATCH, .timeout_ms = FOR_EVER_MS, .take = take_status};
    enum umb_status status = encode_job(job, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

/* --- Cancel --- */

static enum umb_status decode_status(void *context, const uint8_t *message, size_t size,
                                     struct umb_error *error)
{
    struct umb_job_status *const *out = context; /* *out may be NULL */
    struct umb_job_status job;
    UMB__TRY(umbw_decode_job_status(message, size, &job, error));
    drop_texts(&job);
    if (*out != NULL) {
        **out = job;
    }
    return UMB_OK;
}

enum umb_status umb_client_cancel_job(struct umb_client *client, const char *job,
                                      struct umb_job_status *out, struct umb_client_async *async,
                                      struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    const struct umb__ending ending = {&out, sizeof out, decode_status, NULL};
    const struct umb__call_plan plan = {.path = UMBW_PATH_BAKES_CANCEL};
    enum umb_status status = encode_job(job, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

/* --- List --- */

struct list {
    struct umb_job_status **jobs;
    size_t *count;
};

static enum umb_status decode_list(void *out, const uint8_t *message, size_t size,
                                   struct umb_error *error)
{
    struct list *list = out;
    struct umbw_job_list reply;
    UMB__TRY(umbw_decode_job_list(message, size, &reply, error));
    for (size_t i = 0; i < reply.count; i++) {
        reply.jobs[i].plan = reply.jobs[i].notices = NULL; /* they are in the list's own block */
    }
    *list->jobs = reply.jobs;
    *list->count = reply.count;
    return UMB_OK;
}

enum umb_status umb_client_list_jobs(struct umb_client *client, uint32_t limit,
                                     struct umb_job_status **jobs, size_t *count,
                                     struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    struct list list = {jobs, count};
    const struct umb__ending ending = {&list, sizeof list, decode_list, NULL};
    *jobs = NULL;
    *count = 0;
    const struct umb__call_plan plan = {.path = UMBW_PATH_BAKES_LIST};
    enum umb_status status = umbw_encode_list_jobs_request(&limit, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

/* --- Fetch --- */

struct fetch {
    umb_job_bytes_fn on_bytes;
    void *user;
    uint64_t at, size;
    struct umb_error error;
    enum umb_status status; /* Status of the callback, or of a malformed message */
};

static enum umb_status hand_on(struct fetch *fetch, const uint8_t *message, size_t size)
{
    struct umbw_fetch_reply reply;
    UMB__TRY(umbw_decode_fetch_reply(message, size, &reply, &fetch->error));
    if (reply.offset != fetch->at || reply.offset > reply.size ||
        reply.data_size > reply.size - reply.offset ||
        (reply.data_size == 0 && reply.offset < reply.size)) {
        return umb_fail(&fetch->error, UMB_E_PROTOCOL,
                        "data: %zu bytes at %llu of %llu, after %llu", reply.data_size,
                        (unsigned long long)reply.offset, (unsigned long long)reply.size,
                        (unsigned long long)fetch->at);
    }
    fetch->at += reply.data_size;
    fetch->size = reply.size;
    const enum umb_status status =
        fetch->on_bytes(fetch->user, reply.offset, reply.data, reply.data_size, reply.size);
    return status == UMB_OK ? UMB_OK
                            : umb_fail(&fetch->error, status, "the fetch was ended here: %s",
                                       umb_status_text(status));
}

static bool take_piece(void *user, const uint8_t *message, size_t size)
{
    struct fetch *fetch = user;
    fetch->status = hand_on(fetch, message, size);
    return fetch->status == UMB_OK;
}

static enum umb_status finish_fetch(void *context, enum umb_status status, struct umb_error *error)
{
    const struct fetch *fetch = context;
    if (fetch->status != UMB_OK) {
        return umb_fail(error, fetch->status, "%.300s", fetch->error.message);
    }
    if (status == UMB_OK && fetch->at != fetch->size) {
        status = umb_fail(error, UMB_E_PROTOCOL, "data: ended at byte %llu of %llu",
                          (unsigned long long)fetch->at, (unsigned long long)fetch->size);
    }
    return status;
}

enum umb_status umb_client_fetch(struct umb_client *client, const uint8_t asset[UMB_ID_BYTES],
                                 uint64_t offset, umb_job_bytes_fn on_bytes, void *user,
                                 struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_fetch_request request = {.offset = offset};
    struct umbw_buffer body = {NULL, 0, 0};
    struct fetch fetch = {.on_bytes = on_bytes, .user = user, .at = offset};
    const struct umb__ending ending = {&fetch, sizeof fetch, umb__decode_nothing, finish_fetch};
    const struct umb__call_plan plan = {.path = UMBW_PATH_BAKES_FETCH,
                                        .timeout_ms = FOR_EVER_MS,
                                        .take = take_piece,
                                        .flows = true};
    umb_id_to_text(asset, request.asset);
    enum umb_status status = umbw_encode_fetch_request(&request, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

/* --- Delete --- */

enum umb_status umb_client_delete_asset(struct umb_client *client,
                                        const uint8_t asset[UMB_ID_BYTES],
                                        struct umb_client_async *async, struct umb_error *error)
{
    char id[UMB_ID_TEXT_SIZE];
    struct umbw_buffer body = {NULL, 0, 0};
    const struct umb__ending ending = {.decode = umb__decode_nothing};
    const struct umb__call_plan plan = {.path = UMBW_PATH_BAKES_DELETE};
    umb_id_to_text(asset, id);
    enum umb_status status = umbw_encode_delete_request(id, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}
