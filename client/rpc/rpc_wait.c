/* SPDX-License-Identifier: Apache-2.0 */
/* The ends of calls: a blocking caller waits on a condition variable, others get a callback. */
#include "rpc_client.h"
#include "base/reserved.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

struct waiter {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    bool finished;
    enum umb_status status;
    struct umb_error *error; /* The caller's; may be NULL */
    umb__decode_fn decode;
    void *out;
};

enum umb_status umb__reply_fault(enum umb_status status, const struct umb_error *detail,
                                 struct umb_error *error)
{
    return umb_fail(error, status == UMB_E_ARGUMENT ? UMB_E_PROTOCOL : status, "reply: %.300s",
                    detail->message);
}

enum umb_status umb__decode_nothing(void *out, const uint8_t *message, size_t size,
                                    struct umb_error *error)
{
    (void)out;
    (void)message;
    (void)size;
    (void)error;
    return UMB_OK;
}

static void on_done(void *user, enum umb_status status, const uint8_t *message, size_t size,
                    const struct umb_error *error)
{
    struct waiter *waiter = user;
    if (status == UMB_OK) {
        struct umb_error detail = {.status = UMB_OK};
        status = waiter->decode(waiter->out, message, size, &detail);
        if (status != UMB_OK) {
            status = umb__reply_fault(status, &detail, waiter->error);
        }
    } else if (waiter->error != NULL) {
        *waiter->error = *error;
    }
    /* The signal comes before the unlock. Once the lock is free the waiter may see `finished` and
     * free this memory. */
    pthread_mutex_lock(&waiter->lock);
    waiter->status = status;
    waiter->finished = true;
    pthread_cond_signal(&waiter->changed);
    pthread_mutex_unlock(&waiter->lock);
}

enum umb_status umb__call_wait(struct umb_client *client, const struct umb__call_plan *plan,
                               struct umbw_buffer *body, umb__decode_fn decode, void *out,
                               struct umb_error *error)
{
    struct waiter waiter = {.finished = false, .error = error, .decode = decode, .out = out};
    enum umb_status status;
    if (pthread_equal(pthread_self(), client->thread)) {
        umbw_buffer_finish(body);
        return umb_fail(error, UMB_E_STATE, "a blocking call cannot be made from a callback");
    }
    int code = pthread_mutex_init(&waiter.lock, NULL);
    if (code != 0) {
        umbw_buffer_finish(body);
        return umb_fail_errno(error, UMB_E_INTERNAL, code, "cannot wait");
    }
    code = pthread_cond_init(&waiter.changed, NULL);
    if (code != 0) {
        umbw_buffer_finish(body);
        status = umb_fail_errno(error, UMB_E_INTERNAL, code, "cannot wait");
        goto end_lock;
    }
    status = umb__call_start(client, plan, body, on_done, &waiter, error);
    if (status != UMB_OK) {
        goto end_condition;
    }
    pthread_mutex_lock(&waiter.lock);
    while (!waiter.finished) {
        pthread_cond_wait(&waiter.changed, &waiter.lock);
    }
    pthread_mutex_unlock(&waiter.lock);
    status = waiter.status;
end_condition:
    (void)pthread_cond_destroy(&waiter.changed);
end_lock:
    (void)pthread_mutex_destroy(&waiter.lock);
    return status;
}

/* Runs `finish`, if there is one. */
static enum umb_status end(const struct umb__ending *ending, void *context, enum umb_status status,
                           struct umb_error *error)
{
    return ending->finish != NULL ? ending->finish(context, status, error) : status;
}

/* A call without a waiting thread. */
struct running {
    struct umb__ending ending;
    umb_client_done_fn done;
    void *user;
    max_align_t context[]; /* copy of the ending's */
};

static void on_end(void *user, enum umb_status status, const uint8_t *message, size_t size,
                   const struct umb_error *error)
{
    struct running *running = user;
    struct umb_error detail = {.status = UMB_OK}, fault = {.status = UMB_OK};
    if (status != UMB_OK) {
        fault = *error;
    } else {
        status = running->ending.decode(running->context, message, size, &detail);
        if (status != UMB_OK) {
            status = umb__reply_fault(status, &detail, &fault);
        }
    }
    status = end(&running->ending, running->context, status, &fault);
    running->done(running->user, status, status == UMB_OK ? NULL : &fault);
    free(running);
}

/* Starts a call whose end is reported to `async`. Out: context: the call's copy, or NULL. */
static enum umb_status start(struct umb_client *client, struct umb__call_plan *plan,
                             struct umbw_buffer *body, const struct umb__ending *ending,
                             struct umb_client_async *async, struct umb_error *error)
{
    async->call = 0;
    struct running *running = malloc(sizeof *running + ending->context_bytes);
    if (running == NULL) {
        umbw_buffer_finish(body);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a call");
    }
    *running = (struct running){*ending, async->done, async->user};
    if (ending->context_bytes > 0) {
        memcpy(running->context, ending->context, ending->context_bytes);
    }
    plan->number = &async->call;
    plan->flow_user = running->context;
    enum umb_status status = umb__call_start(client, plan, body, on_end, running, error);
    if (status != UMB_OK) {
        free(running);
    }
    return status;
}

enum umb_status umb__call_run(struct umb_client *client, struct umb__call_plan plan,
                              enum umb_status status, struct umbw_buffer *body,
                              const struct umb__ending *ending, struct umb_client_async *async,
                              struct umb_error *error)
{
    if (status == UMB_OK && async != NULL && UMB__UNKNOWN(async, "async", error)) {
        status = UMB_E_ARGUMENT;
    }
    if (status != UMB_OK) {
        umbw_buffer_finish(body);
    } else if (async != NULL) {
        status = start(client, &plan, body, ending, async, error);
        return status == UMB_OK ? UMB_OK : end(ending, ending->context, status, error);
    } else {
        plan.flow_user = ending->context;
        status = umb__call_wait(client, &plan, body, ending->decode, ending->context, error);
    }
    return end(ending, ending->context, status, error);
}
