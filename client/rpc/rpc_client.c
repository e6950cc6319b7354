/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The client object: its thread, its loop, deadlines, cancellations.
 *
 * All signals are blocked in the loop thread, so the host's handlers never run there. The SIGPIPE
 * of a write to a closed socket stays pending in that thread and is never delivered.
 */
#include "base/reserved.h"
#include "rpc_connection.h"
#include "rpc_endpoint.h"
#include "rpc_stream.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#define CONNECT_TIMEOUT_MS 5000
#define CALL_TIMEOUT_MS    60000
#define STALL_TIMEOUT_MS   120000
#define MAX_CALLS          1024
#define MAX_REPLY_BYTES    ((uint64_t)64 << 20)
#define MAX_REQUEST_BYTES  ((uint64_t)256 << 20)
#define KEEPALIVE_MS       10000
#define TOKENS_FULL        100

/* Number of a call, passed from umb_client_cancel to the loop thread. Numbers are never reused, so
 * the number of an ended call matches no call. */
struct umb__cancel {
    struct umb__cancel *next;
    uint64_t number;
};

/* Calls `see` for each list of calls that are routed. */
static void each_list(struct umb_client *client,
                      void (*see)(const struct umb__call_list *list, void *user), void *user)
{
    see(&client->resting, user);
    for (size_t i = 0; i < client->endpoint_count; i++) {
        see(&client->endpoints[i].waiting, user);
    }
    for (const struct umb__connection *at = client->connections; at != NULL; at = at->next) {
        see(&at->active, user);
    }
    for (const struct umb_client_stream *at = client->streams; at != NULL; at = at->next) {
        see(&at->queue, user);
        see(&at->sent, user);
    }
}

/* Lowers a time to the earliest deadline of a list of calls. */
static void take_earliest(const struct umb__call_list *list, void *user)
{
    uint64_t *deadline_ns = user;
    for (const struct umb__call *call = list->first; call != NULL; call = call->next) {
        *deadline_ns = call->deadline_ns < *deadline_ns ? call->deadline_ns : *deadline_ns;
    }
}

/* Marks the calls with a number as cancelled: their deadline has passed. */
static void mark_cancelled(const struct umb__call_list *list, void *user)
{
    struct umb__cancel *cancel = user;
    for (struct umb__call *call = list->first; call != NULL; call = call->next) {
        if (call->number == cancel->number && cancel->number != 0) {
            call->cancelled = true;
            call->deadline_ns = 0;
        }
    }
}

/* Ends the expired calls of a list; true if there were any. */
static bool expire_list(struct umb_client *client, struct umb__call_list *list, uint64_t now)
{
    bool any = false;
    struct umb__call *next;
    for (struct umb__call *call = list->first; call != NULL; call = next) {
        next = call->next;
        if (call->deadline_ns > now) {
            continue;
        }
        if (call->connection != NULL) {
            umb__session_cancel(call->connection, call);
        }
        umb__call_expire(client, call, call->connection != NULL);
        any = true;
    }
    return any;
}

/* Ends all expired calls. */
static void expire_all(struct umb_client *client)
{
    uint64_t now = uv_hrtime();
    for (size_t i = 0; i < client->endpoint_count; i++) {
        (void)expire_list(client, &client->endpoints[i].waiting, now);
    }
    (void)expire_list(client, &client->resting, now);
    struct umb__connection *next;
    for (struct umb_client_stream *stream = client->streams; stream != NULL;
         stream = stream->next) {
        struct umb__connection *over = stream->carrier != NULL ? stream->carrier->connection : NULL;
        if (umb__stream_expire(stream, now) && over != NULL) {
            umb__connection_probe(over);
        }
    }
    for (struct umb__connection *at = client->connections; at != NULL; at = next) {
        next = at->next;
        if (expire_list(client, &at->active, now)) {
            umb__connection_probe(at);
        }
        umb__connection_flush(at);
    }
}

static void arm_deadline(struct umb_client *client);

static void on_deadline(uv_timer_t *timer)
{
    struct umb_client *client = timer->data;
    client->deadline_armed_ns = 0;
    expire_all(client);
    arm_deadline(client);
}

static void set_deadline(struct umb_client *client, uint64_t deadline_ns)
{
    uint64_t now = uv_hrtime();
    uint64_t wait_ms = deadline_ns > now ? (deadline_ns - now) / 1000000U + 1 : 0;
    uv_update_time(&client->loop);
    client->deadline_armed_ns = deadline_ns;
    (void)uv_timer_start(&client->deadline_timer, on_deadline, wait_ms, 0);
}

/* Checks all calls; runs only when the timer has fired. */
static void arm_deadline(struct umb_client *client)
{
    uint64_t deadline_ns = UINT64_MAX;
    each_list(client, take_earliest, &deadline_ns);
    if (deadline_ns != UINT64_MAX) {
        set_deadline(client, deadline_ns);
    }
}

static void end_streams(struct umb_client_stream *streams, const struct umb_error *reason)
{
    while (streams != NULL) {
        struct umb_client_stream *stream = streams;
        streams = stream->next;
        umb__stream_destroy(stream, reason);
    }
}

static void stop_everything(struct umb_client *client)
{
    struct umb_error error;
    client->stopped = true;
    (void)umb_fail(&error, UMB_E_CANCELLED, "the client was closed");
    end_streams(client->streams, &error);
    client->streams = NULL;
    umb__calls_fail(client, &client->resting, &error);
    for (size_t i = 0; i < client->endpoint_count; i++) {
        umb__calls_fail(client, &client->endpoints[i].waiting, &error);
    }
    while (client->connections != NULL) {
        /* Losing the connection completes its calls. No call is queued again once `stopped` is
         * set. */
        umb__connection_lose(client->connections, &error);
    }
    uv_close((uv_handle_t *)&client->deadline_timer, NULL);
    uv_close((uv_handle_t *)&client->rest_timer, NULL);
    uv_close((uv_handle_t *)&client->wake, NULL);
}

/* Takes over what other threads have put in: new streams, streams to end (moved to *ended), calls,
 * and the numbers of calls to cancel. */
static void take_inbox(struct umb_client *client, struct umb__call_list *calls,
                       struct umb_client_stream **ended, struct umb__cancel **cancels)
{
    *cancels = client->cancels;
    client->cancels = NULL;
    while (client->new_streams != NULL) {
        struct umb_client_stream *stream = client->new_streams;
        client->new_streams = stream->next;
        stream->next = client->streams;
        client->streams = stream;
    }
    while (client->inbox.first != NULL) {
        umb__call_move(client->inbox.first, calls);
    }
    for (struct umb_client_stream **at = &client->streams; *at != NULL;) {
        struct umb_client_stream *stream = *at;
        if (stream->closing) {
            *at = stream->next;
            stream->next = *ended;
            *ended = stream;
        } else {
            at = &stream->next;
        }
    }
}

/* Moves new calls to the lists in which they wait. Returns the earliest deadline of these calls. */
static uint64_t route(struct umb_client *client, struct umb__call_list *calls)
{
    uint64_t deadline_ns = UINT64_MAX;
    while (calls->first != NULL) {
        struct umb__call *call = calls->first;
        deadline_ns = call->deadline_ns < deadline_ns ? call->deadline_ns : deadline_ns;
        if (call->stream != NULL) {
            umb__stream_take(call->stream, call);
        } else {
            umb__call_route(client, call);
        }
    }
    return deadline_ns;
}

static void flush_due(struct umb_client *client)
{
    struct umb__connection *next;
    for (struct umb__connection *at = client->connections; at != NULL; at = next) {
        next = at->next;
        if (at->flush_due) {
            at->flush_due = false;
            umb__connection_flush(at);
        }
    }
}

/* Ends the calls with these numbers in the way in which calls end at their deadline, but with
 * another status. Frees the list. */
static void apply_cancels(struct umb_client *client, struct umb__cancel *cancels)
{
    const bool any = cancels != NULL;
    while (cancels != NULL) {
        struct umb__cancel *first = cancels;
        cancels = first->next;
        each_list(client, mark_cancelled, first);
        free(first);
    }
    if (any) {
        expire_all(client);
    }
}

static void on_wake(uv_async_t *wake)
{
    struct umb_client *client = wake->data;
    struct umb__call_list calls = {NULL, NULL};
    struct umb_client_stream *ended = NULL;
    struct umb__cancel *cancels = NULL;
    struct umb_error closed;
    pthread_mutex_lock(&client->lock);
    bool closing = client->closing;
    take_inbox(client, &calls, &ended, &cancels);
    pthread_mutex_unlock(&client->lock);
    uint64_t deadline_ns = route(client, &calls);
    (void)umb_fail(&closed, UMB_E_CANCELLED, "the stream was closed");
    end_streams(ended, &closed);
    apply_cancels(client, cancels);
    if (client->stopped) {
        return;
    }
    if (closing) {
        stop_everything(client);
        return;
    }
    if (deadline_ns != UINT64_MAX &&
        (client->deadline_armed_ns == 0 || deadline_ns < client->deadline_armed_ns)) {
        set_deadline(client, deadline_ns);
    }
    umb__client_dispatch(client);
    flush_due(client);
}

static void *run_loop(void *user)
{
    struct umb_client *client = user;
    (void)uv_run(&client->loop, UV_RUN_DEFAULT); /* Ends when stop_everything has closed it all */
    return NULL;
}

/* Starts the thread with all signals blocked, which it inherits. */
static int start_thread(struct umb_client *client)
{
    sigset_t all;
    sigset_t before;
    sigfillset(&all);
    int code = pthread_sigmask(SIG_SETMASK, &all, &before);
    if (code != 0) {
        return code;
    }
    code = pthread_create(&client->thread, NULL, run_loop, client);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    return code;
}

static void fill_options(const struct umb_client_options *options, struct umb_client_options *out)
{
    if (options != NULL) {
        *out = *options;
    }
#define DEFAULT(field, value) out->field = out->field == 0 ? (value) : out->field
    DEFAULT(connect_timeout_ms, CONNECT_TIMEOUT_MS);
    DEFAULT(call_timeout_ms, CALL_TIMEOUT_MS);
    DEFAULT(stall_timeout_ms, STALL_TIMEOUT_MS);
    DEFAULT(max_calls, MAX_CALLS);
    DEFAULT(max_retries, UMB__RETRIES_MAX);
    DEFAULT(keepalive_ms, KEEPALIVE_MS);
    DEFAULT(max_request_bytes, MAX_REQUEST_BYTES);
    DEFAULT(max_reply_bytes, MAX_REPLY_BYTES);
#undef DEFAULT
    if (out->max_retries == UMB_CLIENT_NEVER) {
        out->max_retries = 0;
    }
    if (out->max_reply_bytes > UINT32_MAX) {
        out->max_reply_bytes = UINT32_MAX; /* Largest gRPC message */
    }
}

/* If the system lacked a resource, a later call may succeed. Any other failure is a bug of this
 * library. */
static enum umb_status lacks(int code)
{
    return code == ENOMEM                                       ? UMB_E_NO_MEMORY
           : code == EAGAIN || code == EMFILE || code == ENFILE ? UMB_E_LIMIT
                                                                : UMB_E_INTERNAL;
}

/* Makes loop and handles; a failure leaves none of them behind. */
static int open_loop(struct umb_client *client)
{
    int code = uv_loop_init(&client->loop);
    if (code < 0) {
        return code;
    }
    client->wake.data = client;
    client->deadline_timer.data = client;
    client->rest_timer.data = client;
    code = uv_async_init(&client->loop, &client->wake, on_wake);
    if (code < 0) {
        (void)uv_loop_close(&client->loop);
        return code;
    }
    (void)uv_timer_init(&client->loop, &client->deadline_timer); /* cannot fail */
    (void)uv_timer_init(&client->loop, &client->rest_timer);
    return 0;
}

static void free_client(struct umb_client *client)
{
    (void)pthread_mutex_destroy(&client->lock);
    free(client->receive_buffer);
    umb__identity_forget(client);
    free(client->endpoints);
    free(client);
}

enum umb_status umb_client_open(const char *address, const struct umb_client_options *options,
                                struct umb_client **out, struct umb_error *error)
{
    enum umb_status status;
    *out = NULL;
    if (options && UMB__UNKNOWN(options, "options", error)) {
        return UMB_E_ARGUMENT;
    }
    struct umb_client *client = malloc(sizeof *client);
    if (client == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a client");
    }
    *client = (struct umb_client){
        .lock = PTHREAD_MUTEX_INITIALIZER, .tokens = TOKENS_FULL, .noise = uv_hrtime()};
    fill_options(options, &client->options);
    status = umb__endpoints_parse(client, address, error);
    if (status == UMB_OK) {
        status = umb__identity_take(client, error);
    }
    if (status == UMB_OK) {
        client->receive_buffer = malloc(UMB__RECEIVE_BYTES);
        status = client->receive_buffer != NULL
                     ? UMB_OK
                     : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a client");
    }
    if (status != UMB_OK) {
        goto fail;
    }
    int code = open_loop(client);
    if (code < 0) {
        status = umb_fail_errno(error, lacks(-code), -code, "cannot make the client's loop");
        goto fail;
    }
    code = start_thread(client);
    if (code != 0) {
        status = umb_fail_errno(error, lacks(code), code, "cannot start the client's thread");
        goto fail_thread;
    }
    *out = client;
    return UMB_OK;

fail_thread:
    stop_everything(client);
    (void)uv_run(&client->loop, UV_RUN_DEFAULT);
    (void)uv_loop_close(&client->loop);
fail:
    free_client(client);
    return status;
}

enum umb_status umb_client_cancel(struct umb_client *client, uint64_t call, struct umb_error *error)
{
    struct umb__cancel *cancel = malloc(sizeof *cancel);
    if (cancel == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a cancellation");
    }
    cancel->number = call;
    pthread_mutex_lock(&client->lock);
    const bool closing = client->closing; /* A closing client cancels all calls anyway */
    if (!closing) {
        cancel->next = client->cancels;
        client->cancels = cancel;
        (void)uv_async_send(&client->wake);
    }
    pthread_mutex_unlock(&client->lock);
    if (closing) {
        free(cancel);
    }
    return UMB_OK;
}

void umb_client_close(struct umb_client *client)
{
    if (client == NULL) {
        return;
    }
    pthread_mutex_lock(&client->lock);
    client->closing = true;
    (void)uv_async_send(&client->wake);
    pthread_mutex_unlock(&client->lock);
    (void)pthread_join(client->thread, NULL);
    (void)uv_loop_close(&client->loop);
    free_client(client);
}
