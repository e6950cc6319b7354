/* SPDX-License-Identifier: Apache-2.0 */
/* A call's request side: headers, body, end, timers. */
#include "daemon/call/call.h"

#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/clock.h"

_Static_assert(sizeof(struct umbd_call) + 1024 <= UMBD_CALL_BYTES, "what a call is counted for");

/* Row of a path; the last one for an unknown path. */
static const struct umbd_method *method_of(const struct umbd_method *methods, const char *path)
{
    while (methods->path != NULL && strcmp(path, methods->path) != 0) {
        methods++;
    }
    return methods;
}

struct umbd_call *umbd_call_create(struct umbd_conn *conn, int32_t stream_id, int was_reset)
{
    uint64_t limit;
    const char *option;
    if (!umbd_conn_charge(conn, UMBD_CALL_BYTES, &limit, &option)) {
        umbd_count(&conn->server->metrics.shed, 1);
        return NULL;
    }
    struct umbd_call *call = calloc(1, sizeof *call);
    if (call == NULL) {
        umbd_conn_uncharge(conn, UMBD_CALL_BYTES);
        return NULL;
    }
    call->conn = conn;
    call->server = conn->server;
    call->home = conn->loop->home;
    call->backend = call->home->backend;
    call->stream_id = stream_id;
    call->reset_early = was_reset; /* reset later: the decoder must see all its headers */
    call->started_ns = umbu_clock_ns();
    call->started_ms = call->message_ms = call->looked_ms = umbd_call_now_ms(call);
    call->method = method_of(call->backend->methods, ""); /* unknown until the path comes */
    umbw_reader_init(&call->reader, (size_t)call->server->options.max_message);
    STAILQ_INIT(&call->queue);
    LIST_INSERT_HEAD(&conn->calls, call, link);
    conn->call_count++;
    conn->last_call_ms = call->started_ms;
    return call;
}

void umbd_call_destroy(struct umbd_call *call)
{
    struct umbd_conn *conn = call->conn;
    umbd_call_count(call, call->responded && call->reply_ended ? call->code : UMBW_GRPC_CANCELLED);
    if (call->task != NULL) {
        umbd_call_leave_task(call);
    }
    umbd_call_uncharge(call, 0);
    LIST_REMOVE(call, link);
    conn->call_count--;
    conn->last_call_ms = umbd_call_now_ms(call);
    if (call->admitted) {
        conn->working--;
        conn->last_work_ms = conn->last_call_ms;
    }
    umbd_conn_uncharge(conn, UMBD_CALL_BYTES);
    umbw_reader_finish(&call->reader);
    umbw_buffer_finish(&call->out);
    umbd_stream_drop(call);
    umbd_call_drop_message(call);
    if (call->method->close != NULL) {
        call->method->close(call);
    }
    free(call->web);
    free(call);
}

static int equals(const uint8_t *bytes, size_t size, const char *text)
{
    return size == strlen(text) && memcmp(bytes, text, size) == 0;
}

/* Returns true for application/grpc and application/grpc+proto, both also with parameters after a
 * semicolon. */
static int is_grpc_type(const uint8_t *value, size_t size)
{
    static const char base[] = "application/grpc";
    size_t length = sizeof base - 1;
    if (size < length || memcmp(value, base, length) != 0) {
        return 0;
    }
    value += length;
    size -= length;
    if (size >= 6 && memcmp(value, "+proto", 6) == 0) {
        value += 6;
        size -= 6;
    }
    return size == 0 || value[0] == ';';
}

static void take_timeout(struct umbd_call *call, const uint8_t *value, size_t size)
{
    int64_t nanoseconds = 0;
    if (umbw_timeout_parse((const char *)value, size, &nanoseconds) != UMB_OK) {
        call->bad_timeout = 1;
        return;
    }
    uint64_t room = UINT64_MAX / 2 - call->started_ns;
    call->deadline_ns =
        call->started_ns + ((uint64_t)nanoseconds < room ? (uint64_t)nanoseconds : room);
}

static void take_header(struct umbd_call *call, const uint8_t *name, size_t name_size,
                        const uint8_t *value, size_t value_size)
{
    if (equals(name, name_size, ":method")) {
        call->is_post = equals(value, value_size, "POST");
    } else if (equals(name, name_size, ":path")) {
        if (value_size < sizeof call->path) {
            memcpy(call->path, value, value_size);
            call->path[value_size] = '\0';
            call->method = method_of(call->backend->methods, call->path);
        }
    } else if (equals(name, name_size, "content-type")) {
        call->is_grpc = is_grpc_type(value, value_size);
    } else if (equals(name, name_size, "grpc-timeout")) {
        take_timeout(call, value, value_size);
    } else if (equals(name, name_size, "authorization")) {
        umbd_call_authorization(call, value, value_size);
    } else if (equals(name, name_size, "grpc-encoding")) {
        call->encoding = equals(value, value_size, "identity") ? UMBD_ENCODING_IDENTITY
                         : equals(value, value_size, "gzip")   ? UMBD_ENCODING_GZIP
                                                               : UMBD_ENCODING_OTHER;
    } else if (call->method->header != NULL) {
        call->method->header(call, (const char *)name, name_size, (const char *)value, value_size);
    }
}

int umbd_call_header(struct umbd_call *call, const uint8_t *name, size_t name_size,
                     const uint8_t *value, size_t value_size)
{
    if (!umbd_header_take(&call->headers, name_size, value_size)) {
        return 0;
    }
    if (!call->headers_whole) {
        take_header(call, name, name_size, value, value_size);
    }
    return 1;
}

void umbd_call_admit(struct umbd_call *call)
{
    call->admitted = 1;
    call->conn->working++;
    call->conn->last_work_ms = call->started_ms;
    if (call->method->price == UMBD_PRICE_CALL) {
        (void)umbd_call_take_points(call, UMBD_CALL_POINTS);
    }
}

static void check_headers(struct umbd_call *call)
{
    call->headers_whole = 1;
    if (call->method->most_bytes > 0) {
        call->reader.max_message = call->method->most_bytes;
    }
    umbd_metrics_started(&call->server->metrics, call->method);
    if (!call->is_post) {
        call->refusal = UMBD_REFUSE_METHOD; /* answered at the end of the request */
    } else if (!call->is_grpc) {
        call->refusal = UMBD_REFUSE_CONTENT_TYPE;
    } else if (call->method->path == NULL) {
        char text[200];
        snprintf(text, sizeof text, "unknown method '%s'", call->path);
        umbd_call_fail(call, UMBW_GRPC_UNIMPLEMENTED, text);
    } else if (call->bad_timeout) {
        umbd_call_fail(call, UMBW_GRPC_INVALID_ARGUMENT,
                       "grpc-timeout: must be 1 to 8 digits and one of H, M, S, m, u, n");
    } else if (umbd_call_is_open(call)) {
        (void)umbd_call_take_open(call);
        return;
    } else if (umbd_call_is_allowed(call)) {
        umbd_call_admit(call);
        return;
    }
    umbd_call_refused(call);
}

int umbd_call_headers_end(struct umbd_call *call)
{
    if (call->reset_early) {
        return 0;
    }
    if (!call->headers_whole) {
        check_headers(call);
    }
    return 1;
}

/* Keeps the message of a unary call until the request ends. Only then is it certain that no second
 * message follows. */
static enum umb_status keep_message(struct umbd_call *call, uint8_t *message, size_t size,
                                    int owned)
{
    call->message = message;
    call->message_size = size;
    call->message_borrowed = !owned;
    if (!owned) {
        call->message = umbd_call_take_message(call);
        call->message_borrowed = 0;
    }
    return call->message != NULL ? UMB_OK : UMB_E_NO_MEMORY;
}

/* Replaces a compressed message by what it inflates to. */
static enum umb_status inflate_message(struct umbd_call *call, const uint8_t *message, size_t size,
                                       uint8_t **out, size_t *out_size)
{
    struct umb_error error;
    call->offer_encodings = 1;
    if (call->encoding != UMBD_ENCODING_GZIP) {
        int other = call->encoding == UMBD_ENCODING_OTHER;
        umbd_call_fail(call, other ? UMBW_GRPC_UNIMPLEMENTED : UMBW_GRPC_INTERNAL,
                       other ? "grpc-encoding: only identity and gzip are supported"
                             : "message prefix: compressed, but grpc-encoding says identity");
        return UMB_E_PROTOCOL;
    }
    const size_t limit = call->reader.max_message;
    uint64_t from = umbd_conn_began(call->conn);
    enum umb_status status = umbw_gunzip(message, size, limit, out, out_size, &error);
    umbd_conn_spent(call->conn, from);
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
    } else if (!umbd_call_charge(call, call->charged + *out_size)) {
        free(*out);
        status = UMB_E_BUSY;
    }
    return status;
}

/* Takes one message; takes over the reader's memory if it can. */
static enum umb_status on_message(void *user, const uint8_t *message, size_t size, int compressed)
{
    struct umbd_call *call = user;
    uint8_t *bytes = (uint8_t *)(uintptr_t)message;
    int owned = 0;
    if (call->message_count > 0 && !umbd_takes_many(call->method)) {
        umbd_call_fail(call, UMBW_GRPC_INTERNAL, "request: more than one message in a unary call");
        return UMB_E_PROTOCOL;
    }
    call->message_count = 1;
    umbd_bucket_credit(&call->conn->control, 1); /* a tiny frame with a whole request is work */
    call->message_ms = umbd_call_now_ms(call);
    if (compressed) {
        UMB__TRY(inflate_message(call, message, size, &bytes, &size));
        owned = 1;
    } else if (message == call->reader.message && size > 0) {
        bytes = call->reader.message;
        call->reader.message = NULL;
        call->reader.capacity = 0;
        owned = 1;
    }
    return umbd_takes_many(call->method) ? umbd_stream_message(call, bytes, size, owned)
                                         : keep_message(call, bytes, size, owned);
}

/* 1 if body bytes are discarded. */
static int ignores_input(const struct umbd_call *call)
{
    return call->discarding || call->reset_early || call->reply_ended ||
           call->refusal != UMBD_REFUSE_NOTHING;
}

size_t umbd_call_room(struct umbd_call *call, size_t most, uint8_t **place)
{
    return ignores_input(call) ? 0 : umbw_reader_room(&call->reader, most, place);
}

static void take_data(struct umbd_call *call, const uint8_t *bytes, size_t count)
{
    struct umb_error error;
    error.message[0] = '\0';
    call->body_bytes += count;
    if (ignores_input(call)) {
        return;
    }
    if (umbw_reader_at_boundary(&call->reader)) {
        call->message_ms = umbd_call_now_ms(call);
    }
    if (!umbd_call_charge(call, call->charged + count)) {
        return;
    }
    enum umb_status status =
        umbw_reader_feed(&call->reader, bytes, count, on_message, call, &error);
    if (status == UMB_OK || call->reply_ended) {
        umbd_stream_charge(call);
        return;
    }
    if (status == UMB_E_TOO_LARGE) {
        size_t length = strlen(error.message);
        const int fixed = call->reader.max_message < call->server->options.max_message;
        snprintf(error.message + length, sizeof error.message - length, " (%s)",
                 fixed ? "of this method" : "--max-message");
    } else if (status == UMB_E_NO_MEMORY) {
        snprintf(error.message, sizeof error.message, "server: out of memory for the request");
    }
    umbd_call_fail_status(call, status, &error);
}

size_t umbd_call_data(struct umbd_call *call, const uint8_t *bytes, size_t count)
{
    take_data(call, bytes, count);
    return umbd_stream_window(call, count);
}

void umbd_call_request_end(struct umbd_call *call)
{
    if (call->request_ended) {
        return;
    }
    call->request_ended = 1;
    if (call->refusal != UMBD_REFUSE_NOTHING) {
        umbd_call_refuse(call);
    } else if (call->reply_ended) {
        return;
    } else if (!umbw_reader_at_boundary(&call->reader)) {
        umbd_call_fail(call, UMBW_GRPC_INTERNAL, "request: the stream ended inside a message");
    } else if (umbd_takes_many(call->method)) {
        umbd_stream_pump(call);
    } else if (call->message_count == 0) {
        umbd_call_fail(call, UMBW_GRPC_INTERNAL, "request: no message in a unary call");
    } else if (umbd_call_expired(call)) {
        umbd_call_fail(call, UMBW_GRPC_DEADLINE_EXCEEDED,
                       "grpc-timeout: passed before the work was started");
    } else {
        umbd_call_serve(call);
    }
}

/* Time that the peer has for the current message. */
static uint64_t body_limit_ms(const struct umbd_call *call)
{
    uint64_t bytes = umbd_takes_many(call->method) ? call->reader.received : call->body_bytes;
    return call->server->options.body_timeout_ms + bytes / UMBD_BODY_BYTES_PER_MS;
}

/*
 * Adds the time since the last check in which the server waited for data of the stream. Returns 1
 * for a Submit whose files come too slowly. The sizes that a Submit declares count against quotas,
 * and a client that sends a byte now and then could hold them for ever.
 */
static int is_upload_slow(struct umbd_call *call, uint64_t now_ms)
{
    const struct umbd_options *options = &call->server->options;
    call->waited_ms += now_ms - call->looked_ms;
    call->looked_ms = now_ms;
    return (call->method->traits & UMBD_UPLOAD) != 0 &&
           call->waited_ms > options->idle_timeout_ms + options->body_timeout_ms +
                                 call->data_bytes / UMBD_DATA_BYTES_PER_MS;
}

/* Returns 1 if the request is overdue. Between its messages, a stream may pause as long as a
 * connection without calls may be idle. */
static int is_body_late(struct umbd_call *call, uint64_t now_ms)
{
    const struct umbd_options *options = &call->server->options;
    if (call->request_ended || call->reply_ended) {
        return 0;
    }
    if (umbd_call_is_open(call)) {
        return now_ms - call->started_ms > UMBD_OPEN_BODY_MS;
    }
    if (!umbd_takes_many(call->method)) {
        return now_ms - call->started_ms > body_limit_ms(call);
    }
    if (call->task != NULL || !STAILQ_EMPTY(&call->queue) || umbd_call_unsent(call) > 0) {
        call->message_ms = call->looked_ms = now_ms;
        return 0;
    }
    if (is_upload_slow(call, now_ms)) {
        return 1;
    }
    return now_ms - call->message_ms > (umbw_reader_at_boundary(&call->reader)
                                            ? options->idle_timeout_ms
                                            : body_limit_ms(call));
}

static void tick_open_reply(struct umbd_call *call, uint64_t now_ms)
{
    const struct umbd_options *options = &call->server->options;
    size_t left = umbd_call_unsent(call);
    if (call->reset) {
        return;
    }
    if (!call->request_ended && call->reply_ended && left == 0 &&
        now_ms - call->responded_ms > UMBD_GRACE_MS) {
        call->reset = 1;
        nghttp2_submit_rst_stream(call->conn->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                  NGHTTP2_NO_ERROR);
    } else if (left > 0 && now_ms - call->progress_ms > options->stall_timeout_ms) {
        call->reset = 1;
        umbd_count(&call->server->metrics.abuse[UMBD_ABUSE_TIMEOUT], 1);
        nghttp2_submit_rst_stream(call->conn->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                  NGHTTP2_CANCEL);
    }
}

static void tick_service(struct umbd_call *call)
{
    if (call->method->tick != NULL) {
        call->method->tick(call);
    }
}

int umbd_call_tick(struct umbd_call *call, uint64_t now_ms)
{
    if (call->web != NULL) {
        tick_service(call); /* the connection's timers suffice */
        return 1;
    }
    if (!call->headers_whole) {
        return now_ms - call->started_ms <= UMBD_HEADERS_MS;
    }
    if (call->deadline_ns != 0 && !call->reply_ended && umbd_call_expired(call)) {
        umbd_call_fail(call, UMBW_GRPC_DEADLINE_EXCEEDED, "grpc-timeout: the deadline passed");
    } else if (is_body_late(call, now_ms)) {
        umbd_count(&call->server->metrics.abuse[UMBD_ABUSE_TIMEOUT], 1);
        call->refusal = UMBD_REFUSE_NOTHING;
        umbd_call_fail(call, UMBW_GRPC_DEADLINE_EXCEEDED,
                       "request: it did not arrive in time (--body-timeout, --idle-timeout)");
    } else if (call->responded) {
        tick_open_reply(call, now_ms);
    }
    tick_service(call);
    return 1;
}
