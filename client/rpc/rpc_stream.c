/* SPDX-License-Identifier: Apache-2.0 */
/* Queries over a stream, see rpc_stream.h. */
#include "rpc_stream.h"

#include <stdlib.h>
#include <string.h>
#include "rpc_connection.h"
#include "rpc_endpoint.h"

static void make_carrier(struct umb_client_stream *stream);

/* Sends the queue: over the carrier, or over a new one. */
static void push(struct umb_client_stream *stream)
{
    if (stream->queue.first == NULL) {
        return;
    }
    if (stream->carrier == NULL) {
        make_carrier(stream);
    } else if (stream->deferred && stream->carrier->connection != NULL) {
        struct umb__connection *connection = stream->carrier->connection;
        stream->deferred = false;
        (void)nghttp2_session_resume_data(connection->session, stream->carrier->stream_id);
        connection->flush_due = true;
    }
}

void umb__stream_take(struct umb_client_stream *stream, struct umb__call *call)
{
    umb__call_move(call, &stream->queue);
    push(stream);
}

/* Copies request bytes for the carrier, the call that holds the HTTP/2 stream. If there are none,
 * the carrier is deferred. */
static size_t read_requests(void *user, uint8_t *buffer, size_t length)
{
    struct umb_client_stream *stream = user;
    size_t filled = 0;
    while (stream->queue.first != NULL && filled < length) {
        struct umb__call *call = stream->queue.first;
        size_t left = call->body.size - call->body_sent;
        size_t count = left < length - filled ? left : length - filled;
        memcpy(buffer + filled, call->body.bytes + call->body_sent, count);
        filled += count;
        call->body_sent += count;
        if (count == left) {
            umb__call_move(call, &stream->sent);
        }
    }
    stream->deferred = filled == 0;
    return filled;
}

/* Queues the sent but unanswered requests again. */
static void rewind_requests(void *user)
{
    struct umb_client_stream *stream = user;
    while (stream->queue.first != NULL) {
        umb__call_move(stream->queue.first, &stream->sent);
    }
    while (stream->sent.first != NULL) {
        stream->sent.first->body_sent = 0;
        umb__call_move(stream->sent.first, &stream->queue);
    }
    stream->deferred = false;
}

static const struct umb__source SOURCE = {read_requests, rewind_requests};

/* Gives a reply to the oldest request that was sent. */
static bool take_reply(void *user, const uint8_t *message, size_t size)
{
    struct umb_client_stream *stream = user;
    if (stream->sent.first == NULL) {
        return false;
    }
    umb__client_earn(stream->client);
    umb__call_answer(stream->client, stream->sent.first, message, size);
    return true;
}

static void fail_all(struct umb_client_stream *stream, const struct umb_error *reason)
{
    rewind_requests(stream);
    umb__calls_fail(stream->client, &stream->queue, reason);
}

/* Ends the oldest sent request with the server's status, because the server ended the stream over
 * that request. */
static void refuse_oldest(struct umb_client_stream *stream, const struct umb_error *reason)
{
    struct umb__call *oldest = stream->sent.first;
    if (oldest == NULL && stream->queue.first != NULL && stream->queue.first->body_sent > 0) {
        oldest = stream->queue.first;
    }
    if (oldest != NULL) {
        umb__call_complete(stream->client, oldest, reason->status, reason);
    }
    rewind_requests(stream);
    push(stream);
}

/* Handles the end of the stream. Unanswered requests are safe to repeat, and are sent again within
 * the limits of retries. */
static void go_on(struct umb_client_stream *stream, const struct umb_error *reason)
{
    struct umb_client *client = stream->client;
    struct umb__call *next;
    rewind_requests(stream);
    for (struct umb__call *call = stream->queue.first; call != NULL; call = next) {
        next = call->next;
        if (!umb__call_may_repeat(client, call)) {
            umb__call_complete(client, call, reason->status, reason);
        }
    }
    push(stream);
}

static void on_carrier_done(void *user, enum umb_status status, const uint8_t *message, size_t size,
                            const struct umb_error *error)
{
    struct umb_client_stream *stream = user;
    struct umb_error reason;
    (void)message;
    (void)size;
    if (stream->carrier == NULL) {
        return; /* was given up by us */
    }
    bool told = stream->carrier->reply.has_grpc_status && status != UMB_E_UNAVAILABLE;
    bool reached = stream->carrier->headers_sent; /* false: no replica could be reached, which
                                                     already counted as a try */
    stream->carrier = NULL;
    if (status == UMB_OK) {
        (void)umb_fail(&reason, UMB_E_UNAVAILABLE, "the server ended the stream");
    } else {
        reason = *error;
    }
    if (told && status != UMB_OK && !stream->client->stopped) {
        refuse_oldest(stream, &reason);
    } else if (reason.status == UMB_E_UNAVAILABLE && reached) {
        go_on(stream, &reason);
    } else {
        fail_all(stream, &reason);
    }
}

static void make_carrier(struct umb_client_stream *stream)
{
    struct umb_client *client = stream->client;
    /* Usually all requests of a stream name one asset */
    const char *asset = stream->queue.first->asset;
    size_t asset_size = strlen(asset) + 1;
    struct umb__call *carrier = calloc(1, sizeof *carrier + asset_size);
    if (carrier == NULL) {
        struct umb_error error;
        (void)umb_fail(&error, UMB_E_NO_MEMORY, "out of memory for a stream");
        fail_all(stream, &error);
        return;
    }
    carrier->path = UMBW_PATH_STREAM;
    carrier->deadline_ns = UINT64_MAX; /* Each request has its own deadline */
    carrier->source = &SOURCE;
    carrier->done = on_carrier_done;
    carrier->user = stream;
    umb__reply_init(&carrier->reply, (size_t)client->options.max_reply_bytes);
    carrier->reply.take = take_reply;
    carrier->reply.take_user = stream;
    pthread_mutex_lock(&client->lock);
    client->pending++; /* Counted in the totals as every call is; only requests count against the
                          limit of calls */
    pthread_mutex_unlock(&client->lock);
    stream->carrier = carrier;
    stream->deferred = false;
    carrier->started_ns = uv_hrtime();
    carrier->key = stream->queue.first->key;
    memcpy(carrier->asset, asset, asset_size);
    umb__call_route(client, carrier);
    (void)uv_async_send(&client->wake); /* Not every caller is followed by a dispatch */
}

/* Ends the carrier; its requests stay in the stream's lists. */
static void drop_carrier(struct umb_client_stream *stream, const struct umb_error *reason)
{
    struct umb__call *carrier = stream->carrier;
    if (carrier == NULL) {
        return;
    }
    stream->carrier = NULL;
    if (carrier->connection != NULL && carrier->connection->session != NULL) {
        umb__session_cancel(carrier->connection, carrier);
        carrier->connection->flush_due = true;
    }
    umb__call_complete(stream->client, carrier, reason->status, reason);
}

/* Lists are short, so they are not sorted by deadline. */
static bool any_expired(const struct umb__call_list *list, uint64_t now_ns, bool sent_only)
{
    for (const struct umb__call *call = list->first; call != NULL; call = call->next) {
        if (call->deadline_ns <= now_ns && (!sent_only || call->body_sent > 0)) {
            return true;
        }
    }
    return false;
}

bool umb__stream_expire(struct umb_client_stream *stream, uint64_t now_ns)
{
    struct umb_error error;
    bool was_sent =
        any_expired(&stream->sent, now_ns, false) || any_expired(&stream->queue, now_ns, true);
    if (!was_sent && !any_expired(&stream->queue, now_ns, false)) {
        return false;
    }
    (void)umb_fail(&error, UMB_E_DEADLINE, "a request on the stream before was not answered");
    if (was_sent) {
        /* The only way to withdraw the request on which the server works */
        drop_carrier(stream, &error);
        rewind_requests(stream);
    }
    struct umb__call *next;
    for (struct umb__call *call = stream->queue.first; call != NULL; call = next) {
        next = call->next;
        if (call->deadline_ns <= now_ns) {
            umb__call_expire(stream->client, call, was_sent);
        }
    }
    push(stream);
    return was_sent;
}

void umb__stream_destroy(struct umb_client_stream *stream, const struct umb_error *reason)
{
    drop_carrier(stream, reason);
    fail_all(stream, reason);
    free(stream);
}

enum umb_status umb_client_stream_open(struct umb_client *client, struct umb_client_stream **out,
                                       struct umb_error *error)
{
    *out = NULL;
    struct umb_client_stream *stream = calloc(1, sizeof *stream);
    if (stream == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a stream");
    }
    stream->client = client;
    pthread_mutex_lock(&client->lock);
    stream->next = client->new_streams;
    client->new_streams = stream;
    pthread_mutex_unlock(&client->lock);
    *out = stream;
    return UMB_OK;
}

void umb_client_stream_close(struct umb_client_stream *stream)
{
    if (stream == NULL) {
        return;
    }
    struct umb_client *client = stream->client;
    pthread_mutex_lock(&client->lock);
    stream->closing = true; /* The loop thread may free it as soon as the lock is free */
    (void)uv_async_send(&client->wake);
    pthread_mutex_unlock(&client->lock);
}
