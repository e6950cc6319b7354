/* SPDX-License-Identifier: Apache-2.0 */
/* The blocking face of a call: the asynchronous one and a condition variable. */
#include "rpc_client.h"

struct waiter {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    bool finished;
    enum umb_status status;
    struct umb_error *error; /* the caller's, may be NULL */
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
    /* The waiter's memory is gone as soon as it sees `finished`, and it can only see it once the
     * lock is free: the signal therefore comes before. */
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
        return umb_fail(error, UMB_E_STATE, "a blocking call cannot be made from a call-back");
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
