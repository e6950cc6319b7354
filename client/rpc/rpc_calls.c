/* SPDX-License-Identifier: Apache-2.0 */
/* Calls: made on any thread, queued, completed on the loop thread. See rpc_client.h. */
#include "rpc_connection.h"
#include "rpc_stream.h"

#include <stdlib.h>
#include <string.h>

enum {
    SLOWEST_BYTES_S = 1024, /* Least rate of a call with many messages, after the stall time-out */
};

enum umb_status umb__asset_take(const char *asset, char out[UMBW_ASSET_NAME_MAX + 1],
                                struct umb_error *error)
{
    const size_t length = asset == NULL ? 0 : strlen(asset);
    if (length == 0 || length > UMBW_ASSET_NAME_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "asset: has %zu bytes, must have 1 to %d", length,
                        UMBW_ASSET_NAME_MAX);
    }
    memcpy(out, asset, length + 1);
    return UMB_OK;
}

/* Mixes the bits of a number. Source: the finalizer of "Fast splittable pseudorandom number
 * generators", 2014. */
uint64_t umb__mix(uint64_t z)
{
    z += 0x9e3779b97f4a7c15U;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
}

uint64_t umb__asset_key(const char *asset)
{
    uint64_t key = 0;
    for (const char *at = asset; *at != '\0'; at++) {
        key = umb__mix(key ^ (uint8_t)*at);
    }
    return key;
}

static void list_remove(struct umb__call *call)
{
    struct umb__call_list *list = call->list;
    if (list == NULL) {
        return;
    }
    if (call->previous != NULL) {
        call->previous->next = call->next;
    } else {
        list->first = call->next;
    }
    if (call->next != NULL) {
        call->next->previous = call->previous;
    } else {
        list->last = call->previous;
    }
    call->list = NULL;
    call->next = NULL;
    call->previous = NULL;
}

void umb__call_move(struct umb__call *call, struct umb__call_list *list)
{
    list_remove(call);
    call->list = list;
    call->previous = list->last;
    if (list->last != NULL) {
        list->last->next = call;
    } else {
        list->first = call;
    }
    list->last = call;
}

static void call_free(struct umb__call *call)
{
    umbw_buffer_finish(&call->body);
    umb__reply_finish(&call->reply);
    free(call);
}

/* Counts a call against the limits and queues it, or fails. */
static enum umb_status enqueue(struct umb_client *client, struct umb__call *call, uint64_t *number,
                               struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    pthread_mutex_lock(&client->lock);
    if (client->closing) {
        status = umb_fail(error, UMB_E_CANCELLED, "the client is closing");
    } else if (client->pending >= client->options.max_calls) {
        status = umb_fail(error, UMB_E_BUSY, "calls: %lu are under way, the limit is %lu",
                          (unsigned long)client->pending, (unsigned long)client->options.max_calls);
    } else if (client->pending > 0 &&
               (client->pending_bytes >= client->options.max_request_bytes ||
                call->body.size > client->options.max_request_bytes - client->pending_bytes)) {
        status = umb_fail(error, UMB_E_BUSY, "requests: %llu bytes are held, the limit is %llu",
                          (unsigned long long)client->pending_bytes,
                          (unsigned long long)client->options.max_request_bytes);
    } else {
        client->pending++;
        call->counted = call->body.size;
        client->pending_bytes += call->counted;
        call->number = ++client->last_number;
        if (number != NULL) {
            *number = call->number; /* before `done` can run */
        }
        umb__call_move(call, &client->inbox);
        /* The lock is still held, so a closing client cannot have closed the handle yet. */
        (void)uv_async_send(&client->wake);
    }
    pthread_mutex_unlock(&client->lock);
    return status;
}

enum umb_status umb__call_start(struct umb_client *client, const struct umb__call_plan *plan,
                                struct umbw_buffer *body, umb__done_fn done, void *user,
                                struct umb_error *error)
{
    if (plan->stream != NULL && plan->stream->client != client) {
        umbw_buffer_finish(body);
        return umb_fail(error, UMB_E_ARGUMENT, "stream: belongs to another client");
    }
    const char *asset = plan->asset != NULL ? plan->asset : "";
    size_t asset_size = strlen(asset) + 1;
    struct umb__call *call = calloc(1, sizeof *call + asset_size);
    if (call == NULL) {
        umbw_buffer_finish(body);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a call");
    }
    call->path = plan->path;
    call->stream = plan->stream;
    call->body = *body;
    memset(body, 0, sizeof *body);
    call->timeout_ms = plan->timeout_ms != 0 ? plan->timeout_ms : client->options.call_timeout_ms;
    call->started_ns = uv_hrtime();
    call->deadline_ns = call->started_ns + (uint64_t)call->timeout_ms * 1000000U;
    call->flows = plan->flows;
    if (call->flows) {
        umb__call_moved(client, call, 0);
    }
    call->key = umb__asset_key(asset);
    memcpy(call->asset, asset, asset_size);
    call->safe = plan->safe;
    call->done = done;
    call->user = user;
    call->feed = plan->feed;
    call->feed_user = plan->flow_user;
    umb__reply_init(&call->reply, (size_t)client->options.max_reply_bytes);
    call->reply.take = plan->take;
    call->reply.take_user = plan->flow_user;
    enum umb_status status = enqueue(client, call, plan->number, error);
    if (status != UMB_OK) {
        call_free(call);
    }
    return status;
}

void umb__call_moved(const struct umb_client *client, struct umb__call *call, size_t bytes)
{
    if (!call->flows || call->cancelled) {
        return;
    }
    call->moved_bytes += bytes;
    const uint64_t stall_ns = (uint64_t)client->options.stall_timeout_ms * 1000000U;
    const uint64_t seconds = call->moved_bytes / SLOWEST_BYTES_S;
    const uint64_t pace_ns = call->started_ns + stall_ns + seconds * 1000000000U;
    const uint64_t next_ns = uv_hrtime() + stall_ns;
    call->deadline_ns = next_ns < pace_ns ? next_ns : pace_ns;
}

/* Removes a call from every list and stream that refers to it. */
static void leave(struct umb_client *client, struct umb__call *call)
{
    list_remove(call);
    if (call->connection != NULL && call->connection->session != NULL) {
        /* Does nothing if the stream no longer exists. */
        (void)nghttp2_session_set_stream_user_data(call->connection->session, call->stream_id,
                                                   NULL);
    }
    /* Removed before `done` runs: `done` may start the next call in the place of this one. */
    pthread_mutex_lock(&client->lock);
    client->pending--;
    client->pending_bytes -= call->counted;
    pthread_mutex_unlock(&client->lock);
}

void umb__call_answer(struct umb_client *client, struct umb__call *call, const uint8_t *message,
                      size_t size)
{
    leave(client, call);
    call->done(call->user, UMB_OK, message, size, NULL);
    call_free(call);
}

void umb__call_complete(struct umb_client *client, struct umb__call *call, enum umb_status status,
                        const struct umb_error *error)
{
    leave(client, call);
    if (status == UMB_OK) {
        call->done(call->user, UMB_OK, call->reply.message, call->reply.message_size, NULL);
    } else {
        call->done(call->user, status, NULL, 0, error);
    }
    call_free(call);
}

/* The address in messages about a call. */
static const char *where(const struct umb_client *client, const struct umb__call *call)
{
    return call->endpoint != NULL ? call->endpoint->text : client->endpoints[0].text;
}

void umb__call_expire(struct umb_client *client, struct umb__call *call, bool was_sent)
{
    struct umb_error error;
    enum umb_status status =
        call->cancelled
            ? umb_fail(&error, UMB_E_CANCELLED, "%.180s: cancelled", where(client, call))
        : call->flows && was_sent
            ? umb_fail(&error, UMB_E_DEADLINE,
                       "%.180s: stalled after %llu bytes: no message for %lu ms, or fewer than "
                       "%d bytes a second",
                       where(client, call), (unsigned long long)call->moved_bytes,
                       (unsigned long)client->options.stall_timeout_ms, SLOWEST_BYTES_S)
            : umb_fail(&error, UMB_E_DEADLINE, "%.180s: %s within %lu ms", where(client, call),
                       was_sent ? "no answer" : "no connection", (unsigned long)call->timeout_ms);
    umb__call_complete(client, call, status, &error);
}

void umb__calls_fail(struct umb_client *client, struct umb__call_list *list,
                     const struct umb_error *error)
{
    /* `done` may start new calls, but new calls go to the inbox, so this list only shrinks. */
    while (list->first != NULL) {
        umb__call_complete(client, list->first, error->status, error);
    }
}
