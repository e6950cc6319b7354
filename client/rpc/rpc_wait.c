/* SPDX-License-Identifier: Apache-2.0 */
/* How calls end: a blocking caller waits on a condition variable, an asynchronous caller gets a
 * callback. */
#include "base/reserved.h"
#include "base/try.h"
#include "rpc_client.h"

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

enum umb_status umb__watch_finish(void *context, enum umb_status status, struct umb_error *error)
{
    const struct umb__watch *watch = context;
    if (watch->stopped) {
        return umb_fail(error, UMB_E_CANCELLED, "stopped watching");
    }
    return status != UMB_OK && watch->error.status != UMB_OK
               ? umb__reply_fault(watch->error.status, &watch->error, error)
               : status;
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

/* Decodes the reply of a call that ended well, else copies its error. */
static enum umb_status take_reply(umb__decode_fn decode, void *out, enum umb_status status,
                                  const uint8_t *message, size_t size,
                                  const struct umb_error *failure, struct umb_error *error)
{
    struct umb_error detail = {.status = UMB_OK};
    if (status == UMB_OK) {
        status = decode(out, message, size, &detail);
        return status == UMB_OK ? UMB_OK : umb__reply_fault(status, &detail, error);
    }
    if (error != NULL) {
        *error = *failure;
    }
    return status;
}

static void on_done(void *user, enum umb_status status, const uint8_t *message, size_t size,
                    const struct umb_error *error)
{
    struct waiter *waiter = user;
    status = take_reply(waiter->decode, waiter->out, status, message, size, error, waiter->error);
    /* The signal is sent before the lock is released: once the lock is free, the waiting thread may
     * see `finished` and free this memory. */
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
    struct waiter waiter = {.lock = PTHREAD_MUTEX_INITIALIZER,
                            .changed = PTHREAD_COND_INITIALIZER,
                            .error = error,
                            .decode = decode,
                            .out = out};
    if (pthread_equal(pthread_self(), client->thread)) {
        umbw_buffer_finish(body);
        return umb_fail(error, UMB_E_STATE, "a blocking call cannot be made from a callback");
    }
    UMB__TRY(umb__call_start(client, plan, body, on_done, &waiter, error));
    pthread_mutex_lock(&waiter.lock);
    while (!waiter.finished) {
        pthread_cond_wait(&waiter.changed, &waiter.lock);
    }
    pthread_mutex_unlock(&waiter.lock);
    (void)pthread_cond_destroy(&waiter.changed);
    (void)pthread_mutex_destroy(&waiter.lock);
    return waiter.status;
}

/* Runs `finish`, if there is one. */
static enum umb_status end(const struct umb__ending *ending, void *context, enum umb_status status,
                           struct umb_error *error)
{
    return ending->finish != NULL ? ending->finish(context, status, error) : status;
}

/* An asynchronous call, for which no thread waits. */
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
    struct umb_error fault = {.status = UMB_OK};
    status =
        take_reply(running->ending.decode, running->context, status, message, size, error, &fault);
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
