/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The HTTP/2 side of a connection: nghttp2's callbacks and the submission of calls.
 *
 * A stream's user data is its call, or NULL once the call has ended on this side. Callbacks only
 * submit, never send, receive or delete (nghttp2 is not re-entrant). A call ends with its stream's
 * END_STREAM, not when the stream closes. A server may answer before it has read the whole request,
 * and then resets the stream. A proxy may turn that reset into CANCEL, so the trailers before it
 * count.
 *
 * Windows are 64 MiB and HTTP/2 frames up to 1 MiB, by measurements of gRPC on nghttp2.
 */
#include "rpc_connection.h"

#include <stdio.h>
#include <string.h>
#include "grpc/grpc.h"
#include "umbrage/version.h"

#define WINDOW_BYTES   (64 << 20)
#define HEADERS_ALWAYS 8 /* Number of headers of every request; some others depend on the call */
#define HEADERS_MAX    (HEADERS_ALWAYS + 3)

static struct umb__call *stream_call(nghttp2_session *session, int32_t stream_id)
{
    return stream_id == 0 ? NULL : nghttp2_session_get_stream_user_data(session, stream_id);
}

/*
 * Completes a call from inside a callback, and resets its stream if either side is still open.
 *
 * In: remote_done: true if END_STREAM came, which nghttp2 records in the stream only after the
 * callback.
 */
static void end_call(struct umb__connection *connection, struct umb__call *call, bool remote_done,
                     enum umb_status status, const struct umb_error *error)
{
    if (!remote_done ||
        nghttp2_session_get_stream_local_close(connection->session, call->stream_id) != 1) {
        (void)nghttp2_submit_rst_stream(connection->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                        NGHTTP2_CANCEL);
    }
    connection->events->ended(connection->client, call, status, error, true);
}

static int on_header(nghttp2_session *session, const nghttp2_frame *frame, const uint8_t *name,
                     size_t name_size, const uint8_t *value, size_t value_size, uint8_t flags,
                     void *user)
{
    (void)flags;
    struct umb__connection *connection = user;
    struct umb__call *call = stream_call(session, frame->hd.stream_id);
    if (call == NULL) {
        return 0;
    }
    struct umb_error error;
    enum umb_status status =
        umb__reply_header(&call->reply, name, name_size, value, value_size, &error);
    if (status != UMB_OK) {
        end_call(connection, call, false, status, &error);
    }
    return 0;
}

static int on_data(nghttp2_session *session, uint8_t flags, int32_t stream_id, const uint8_t *data,
                   size_t size, void *user)
{
    (void)flags;
    struct umb__connection *connection = user;
    struct umb__call *call = stream_call(session, stream_id);
    if (call == NULL || size == 0) {
        return 0;
    }
    struct umb_error error;
    const uint64_t taken = call->reply.taken_bytes;
    enum umb_status status = umb__reply_data(&call->reply, data, size, &error);
    if (status != UMB_OK) {
        end_call(connection, call, false, status, &error);
    } else if (call->reply.taken_bytes > taken) {
        umb__call_moved(connection->client, call, (size_t)(call->reply.taken_bytes - taken));
    }
    return 0;
}

static int on_frame(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    struct umb__connection *connection = user;
    if (frame->hd.type == NGHTTP2_SETTINGS && (frame->hd.flags & NGHTTP2_FLAG_ACK) == 0) {
        connection->ready = true;
        return 0;
    }
    if (frame->hd.type == NGHTTP2_GOAWAY) {
        connection->draining = true;
        return 0;
    }
    bool carries_end = frame->hd.type == NGHTTP2_HEADERS || frame->hd.type == NGHTTP2_DATA;
    if (!carries_end || (frame->hd.flags & NGHTTP2_FLAG_END_STREAM) == 0) {
        return 0;
    }
    struct umb__call *call = stream_call(session, frame->hd.stream_id);
    if (call != NULL) {
        struct umb_error error = {.status = UMB_OK};
        enum umb_status status = umb__reply_verdict(&call->reply, &error);
        end_call(connection, call, true, status, &error);
    }
    return 0;
}

/* Returns the status for an HTTP/2 error code. Source: "gRPC over HTTP2", Errors. */
static enum umb_status status_of_reset(uint32_t code)
{
    switch (code) {
    case NGHTTP2_REFUSED_STREAM:
        return UMB_E_UNAVAILABLE;
    case NGHTTP2_CANCEL:
        return UMB_E_CANCELLED;
    case NGHTTP2_ENHANCE_YOUR_CALM:
        return UMB_E_BUSY;
    case NGHTTP2_INADEQUATE_SECURITY:
        return UMB_E_PERMISSION;
    default:
        return UMB_E_PROTOCOL;
    }
}

static int on_stream_close(nghttp2_session *session, int32_t stream_id, uint32_t code, void *user)
{
    struct umb__connection *connection = user;
    struct umb__call *call = stream_call(session, stream_id);
    if (call == NULL) {
        return 0;
    }
    /* The server did no work for a stream that was refused, that came after the last stream of a
     * GOAWAY, or that was never sent. */
    bool unprocessed = code == NGHTTP2_REFUSED_STREAM || !call->headers_sent;
    struct umb_error error;
    enum umb_status status =
        umb_fail(&error, unprocessed ? UMB_E_UNAVAILABLE : status_of_reset(code),
                 "%.200s: the server reset the call (%s)", connection->endpoint->text,
                 nghttp2_http2_strerror(code));
    connection->events->ended(connection->client, call, status, &error, !unprocessed);
    return 0;
}

static int on_frame_sent(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    (void)user;
    if (frame->hd.type == NGHTTP2_HEADERS) {
        struct umb__call *call = stream_call(session, frame->hd.stream_id);
        if (call != NULL) {
            call->headers_sent = true;
        }
    }
    return 0;
}

static int on_error(nghttp2_session *session, int code, const char *message, size_t size,
                    void *user)
{
    (void)session;
    (void)code;
    struct umb__connection *connection = user;
    (void)snprintf(connection->detail, sizeof connection->detail, "%.*s",
                   (int)(size < sizeof connection->detail ? size : sizeof connection->detail - 1),
                   message);
    return 0;
}

/* Returns the length of the next DATA frame: as large as the peer and the windows allow. The
 * default of 16 KiB makes a request a fifth more expensive (measured). */
static ssize_t frame_length(nghttp2_session *session, uint8_t frame_type, int32_t stream_id,
                            int32_t session_window, int32_t stream_window, uint32_t peer_max_frame,
                            void *user)
{
    (void)session;
    (void)frame_type;
    (void)stream_id;
    (void)user;
    int32_t length = UMB__FRAME_BYTES;
    length = session_window < length ? session_window : length;
    length = stream_window < length ? stream_window : length;
    length = peer_max_frame < (uint32_t)length ? (int32_t)peer_max_frame : length;
    return length < 1 ? 1 : length;
}

static ssize_t read_body(nghttp2_session *session, int32_t stream_id, uint8_t *buffer,
                         size_t length, uint32_t *flags, nghttp2_data_source *source, void *user)
{
    (void)source; /* The call may be freed already, but the stream's user data is valid */
    struct umb__connection *connection = user;
    struct umb__call *call = stream_call(session, stream_id);
    if (call == NULL) {
        return NGHTTP2_ERR_TEMPORAL_CALLBACK_FAILURE;
    }
    if (call->source != NULL) {
        size_t filled = call->source->read(call->user, buffer, length);
        return filled > 0 ? (ssize_t)filled : NGHTTP2_ERR_DEFERRED;
    }
    if (call->feed != NULL && call->body_sent == call->body.size) {
        call->body.size = call->body_sent = 0;
        call->was_fed = true;
        if (call->feed(call->feed_user, &call->body) != UMB_OK) {
            return NGHTTP2_ERR_TEMPORAL_CALLBACK_FAILURE;
        }
        umb__call_moved(connection->client, call, call->body.size);
    }
    size_t left = call->body.size - call->body_sent;
    size_t count = left < length ? left : length;
    memcpy(buffer, call->body.bytes + call->body_sent, count);
    call->body_sent += count;
    if (count == left && (call->feed == NULL || left == 0)) {
        *flags |= NGHTTP2_DATA_FLAG_EOF;
    }
    return (ssize_t)count;
}

static int make_session(struct umb__connection *connection, nghttp2_session_callbacks *callbacks)
{
    nghttp2_session_callbacks_set_on_header_callback(callbacks, on_header);
    nghttp2_session_callbacks_set_on_data_chunk_recv_callback(callbacks, on_data);
    nghttp2_session_callbacks_set_on_frame_recv_callback(callbacks, on_frame);
    nghttp2_session_callbacks_set_on_stream_close_callback(callbacks, on_stream_close);
    nghttp2_session_callbacks_set_on_frame_send_callback(callbacks, on_frame_sent);
    nghttp2_session_callbacks_set_error_callback2(callbacks, on_error);
    nghttp2_session_callbacks_set_data_source_read_length_callback(callbacks, frame_length);
    return nghttp2_session_client_new(&connection->session, callbacks, connection);
}

enum umb_status umb__session_create(struct umb__connection *connection, struct umb_error *error)
{
    const nghttp2_settings_entry settings[] = {
        {NGHTTP2_SETTINGS_ENABLE_PUSH, 0},
        {NGHTTP2_SETTINGS_INITIAL_WINDOW_SIZE, WINDOW_BYTES},
        {NGHTTP2_SETTINGS_MAX_FRAME_SIZE, UMB__FRAME_BYTES},
        {NGHTTP2_SETTINGS_MAX_HEADER_LIST_SIZE, UMB__HEADER_BYTES_MAX},
    };
    nghttp2_session_callbacks *callbacks = NULL;
    int result = nghttp2_session_callbacks_new(&callbacks);
    if (result == 0) {
        result = make_session(connection, callbacks);
        nghttp2_session_callbacks_del(callbacks);
    }
    if (result == 0) {
        result = nghttp2_submit_settings(connection->session, NGHTTP2_FLAG_NONE, settings,
                                         sizeof settings / sizeof settings[0]);
    }
    if (result == 0) {
        result = nghttp2_session_set_local_window_size(connection->session, NGHTTP2_FLAG_NONE, 0,
                                                       WINDOW_BYTES);
    }
    return result == 0 ? UMB_OK
                       : umb_fail(error, UMB_E_NO_MEMORY, "cannot start HTTP/2: %s",
                                  nghttp2_strerror(result));
}

static nghttp2_nv header(const char *name, const char *value)
{
    nghttp2_nv pair = {.namelen = strlen(name), .valuelen = strlen(value), .flags = 0};
    /* nghttp2 copies name and value, but its struct has no const. */
    memcpy(&pair.name, &name, sizeof pair.name);
    memcpy(&pair.value, &value, sizeof pair.value);
    return pair;
}

/* An asset's name may be any UTF-8. A name that a header cannot hold is left out. */
static bool is_header_value(const char *text)
{
    for (const char *at = text; *at != '\0'; at++) {
        if (*at <= ' ' || *at > '~') {
            return false;
        }
    }
    return text[0] != '\0';
}

/* Tokens never enter HPACK's table of headers: an attacker could make a proxy compare guesses with
 * its entries. */
static nghttp2_nv secret_header(const char *name, const char *value)
{
    nghttp2_nv pair = header(name, value);
    pair.flags = NGHTTP2_NV_FLAG_NO_INDEX;
    return pair;
}

bool umb__session_submit(struct umb__connection *connection, struct umb__call *call)
{
    struct umb_client *client = connection->client;
    uint64_t now = uv_hrtime();
    /* A call of many messages sends no deadline to the server. */
    uint64_t left = call->flows               ? (uint64_t)call->timeout_ms * 1000000U
                    : call->deadline_ns > now ? call->deadline_ns - now
                                              : 0;
    char timeout[16];
    nghttp2_nv headers[HEADERS_MAX] = {
        header(":method", "POST"),
        header(":scheme", connection->endpoint->address.transport == UMBN_TLS ? "https" : "http"),
        header(":path", call->path),
        header(":authority", connection->endpoint->authority),
        header("te", "trailers"),
        header("content-type", "application/grpc"),
        header("user-agent", "umbrage/" UMB_VERSION_TEXT),
        header("grpc-accept-encoding", "identity"),
    };
    size_t header_count = HEADERS_ALWAYS;
    if (call->deadline_ns != UINT64_MAX) {
        (void)umbw_timeout_format((int64_t)left, timeout);
        headers[header_count++] = header("grpc-timeout", timeout);
    }
    if (is_header_value(call->asset)) {
        headers[header_count++] = header("x-umbrage-asset", call->asset);
    }
    if (client->bearer != NULL) {
        headers[header_count++] = secret_header("authorization", client->bearer);
    }
    nghttp2_data_provider body = {.source = {.ptr = NULL}, .read_callback = read_body};
    int32_t id =
        nghttp2_submit_request(connection->session, NULL, headers, header_count, &body, call);
    if (id == NGHTTP2_ERR_STREAM_ID_NOT_AVAILABLE) {
        connection->draining = true;
        return false;
    }
    if (id < 0) {
        struct umb_error error;
        enum umb_status status =
            umb_fail(&error, UMB_E_NO_MEMORY, "cannot send the call: %s", nghttp2_strerror(id));
        umb__call_complete(client, call, status, &error);
        return true;
    }
    call->connection = connection;
    call->stream_id = id;
    connection->used = true;
    umb__call_move(call, &connection->active);
    return true;
}

void umb__session_cancel(struct umb__connection *connection, struct umb__call *call)
{
    (void)nghttp2_session_set_stream_user_data(connection->session, call->stream_id, NULL);
    (void)nghttp2_submit_rst_stream(connection->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                    NGHTTP2_CANCEL);
}

void umb__session_give_back(struct umb__connection *connection)
{
    struct umb__call *next;
    for (struct umb__call *call = connection->active.first; call != NULL; call = next) {
        next = call->next;
        if (!call->headers_sent) {
            umb__session_cancel(connection, call);
            struct umb_error error;
            enum umb_status status =
                umb_fail(&error, UMB_E_UNAVAILABLE, "%.200s: the server is going away",
                         connection->endpoint->text);
            connection->events->ended(connection->client, call, status, &error, false);
        }
    }
}
