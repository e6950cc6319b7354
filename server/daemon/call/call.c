/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A call's request side: headers, body, end, timers.
 *
 * Invariants: `charged` is exactly what this call has counted on its connection and the process.
 * While `batch` is set the pool may read the message, so the call neither frees nor changes it. A
 * failed call keeps no request bytes.
 */
#include "base/try.h"
#include "daemon/call/call_rights.h"
#include "daemon/service/job_request.h"
#include "tool/clock.h"
#include "wire/volume_queries.h"
#include "wire/regions.h"

#include <stdlib.h>
#include <string.h>

_Static_assert(sizeof(struct umbd_call) + 1024 <= UMBD_CALL_BYTES, "what a call is counted for");

struct umbd_call *umbd_call_create(struct umbd_conn *conn, int32_t stream_id)
{
    uint64_t limit;
    const char *option;
    if (!umbd_conn_charge(conn, UMBD_CALL_BYTES, &limit, &option)) {
        umbd_count(&conn->loop->daemon->metrics.shed, 1);
        return NULL;
    }
    struct umbd_call *call = calloc(1, sizeof *call);
    if (call == NULL) {
        umbd_conn_uncharge(conn, UMBD_CALL_BYTES);
        return NULL;
    }
    call->conn = conn;
    call->stream_id = stream_id;
    call->started_ns = umbu_clock_ns();
    call->started_ms = call->message_ms = call->looked_ms = uv_now(&conn->loop->uv);
    call->method = UMBD_METHOD_UNKNOWN;
    call->watch_last = -1;
    umbw_reader_init(&call->reader, (size_t)conn->loop->daemon->options.max_message);
    call->next = conn->calls;
    if (conn->calls != NULL) {
        conn->calls->previous = call;
    }
    conn->calls = call;
    conn->call_count++;
    conn->last_call_ms = call->started_ms;
    return call;
}

void umbd_call_count(struct umbd_call *call, int code)
{
    struct umbd_daemon *daemon = call->conn->loop->daemon;
    if (call->counted || !call->headers_whole) {
        return;
    }
    uint64_t duration_ns = umbu_clock_ns() - call->started_ns;
    call->counted = 1;
    umbd_metrics_handled(&daemon->metrics, call->method, code, duration_ns);
    if (daemon->log.level >= UMB_LOG_DEBUG) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(&daemon->log, UMB_LOG_DEBUG, "call",
                       "peer=\"%s\" conn=%llu stream=%d method=%s code=%s dur_us=%llu",
                       call->conn->peer, (unsigned long long)call->conn->serial, call->stream_id,
                       umbs_log_quote(call->path, quoted), umbw_grpc_name(code),
                       (unsigned long long)(duration_ns / 1000));
    }
}

void umbd_call_destroy(struct umbd_call *call)
{
    struct umbd_conn *conn = call->conn;
    struct umbd_daemon *daemon = conn->loop->daemon;
    umbd_call_count(call, call->responded && call->reply_ended ? call->code : UMBW_GRPC_CANCELLED);
    umbd_job_request_drop(call);
    if (call->batch != NULL) {
        /* The workers may still read it: its bytes stay counted until the loop gets it back. */
        call->batch->charged = call->charged;
        umbd_conn_hand_over(conn, call->charged);
        umbd_pool_cancel(daemon->pool, call->batch);
    } else {
        umbd_conn_uncharge(conn, call->charged);
    }
    if (call->previous != NULL) {
        call->previous->next = call->next;
    } else {
        conn->calls = call->next;
    }
    if (call->next != NULL) {
        call->next->previous = call->previous;
    }
    conn->call_count--;
    conn->last_call_ms = uv_now(&conn->loop->uv);
    if (call->admitted) {
        conn->working--;
        conn->last_work_ms = conn->last_call_ms;
    }
    umbd_conn_uncharge(conn, UMBD_CALL_BYTES);
    umbw_reader_finish(&call->reader);
    umbw_buffer_finish(&call->out);
    umbd_stream_drop(call);
    umbd_call_drop_message(call);
    umbd_kept_picture_drop(&call->kept_picture);
    umbd_service_health_end(call);
    free(call);
}

int umbd_call_charge(struct umbd_call *call, size_t bytes)
{
    uint64_t limit = 0;
    const char *option = "";
    if (bytes <= call->charged) {
        umbd_conn_uncharge(call->conn, call->charged - bytes);
        call->charged = bytes;
        return 1;
    }
    if (umbd_conn_charge(call->conn, bytes - call->charged, &limit, &option)) {
        call->charged = bytes;
        return 1;
    }
    char text[200];
    snprintf(
        text, sizeof text,
        "server: requests and replies in memory are at the limit of %llu bytes (%s); try again "
        "later",
        (unsigned long long)limit, option);
    umbd_count(&call->conn->loop->daemon->metrics.shed, 1);
    call->pushback_ms = UMBD_PUSHBACK_MS;
    umbd_call_fail(call, UMBW_GRPC_RESOURCE_EXHAUSTED, text);
    return 0;
}

size_t umbd_call_unsent(const struct umbd_call *call)
{
    return call->out.size - call->sent;
}

int umbd_call_expired(const struct umbd_call *call)
{
    return call->deadline_ns != 0 && umbu_clock_ns() >= call->deadline_ns;
}

static int equals(const uint8_t *bytes, size_t size, const char *text)
{
    return size == strlen(text) && memcmp(bytes, text, size) == 0;
}

/* True for application/grpc and application/grpc+proto, either with parameters after a
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

void umbd_call_header(struct umbd_call *call, const uint8_t *name, size_t name_size,
                      const uint8_t *value, size_t value_size)
{
    if (equals(name, name_size, ":method")) {
        call->is_post = equals(value, value_size, "POST");
    } else if (equals(name, name_size, ":path")) {
        if (value_size < sizeof call->path) {
            memcpy(call->path, value, value_size);
            call->path[value_size] = '\0';
        }
    } else if (equals(name, name_size, "content-type")) {
        call->is_grpc = is_grpc_type(value, value_size);
    } else if (equals(name, name_size, "grpc-timeout")) {
        take_timeout(call, value, value_size);
    } else if (equals(name, name_size, "authorization")) {
        umbd_call_authorization(call, value, value_size);
#ifdef UMBRAGE_TEST_SERVICE
    } else if (name_size > 12 && memcmp(name, "x-grpc-test-", 12) == 0) {
        umbd_interop_header(&call->echo, name, name_size, value, value_size);
#endif
    } else if (equals(name, name_size, "grpc-encoding")) {
        call->encoding = equals(value, value_size, "identity") ? UMBD_ENCODING_IDENTITY
                         : equals(value, value_size, "gzip")   ? UMBD_ENCODING_GZIP
                                                               : UMBD_ENCODING_OTHER;
    }
}

/* Request limit of calls without rights: fits a service's name of 255 bytes. */
#define OPEN_BYTES  1024
#define SMALL_BYTES 4096 /* request limit of calls with a name or an id and a few numbers */

/* Every method: its path, whether it has several requests or replies, the function that answers it,
 * the function for the end of the requests if it needs one, and the limit of a request message if
 * it is not --max-message. */
static const struct {
    const char *path;
    int takes_many, gives_many;
    void (*serve)(struct umbd_call *call);
    void (*end)(struct umbd_call *call);
    size_t most_bytes;
} methods[UMBD_METHOD_UNKNOWN] = {
    [UMBD_METHOD_QUERY] = {UMBW_PATH_QUERY, 0, 0, umbd_service_query, NULL, 0},
    [UMBD_METHOD_QUERY_STREAM] = {UMBW_PATH_STREAM, 1, 1, umbd_service_query, NULL, 0},
    [UMBD_METHOD_DESCRIBE] = {UMBW_PATH_DESCRIBE, 0, 0, umbd_service_describe, NULL, SMALL_BYTES},
    [UMBD_METHOD_LIST] = {UMBW_PATH_LIST, 0, 0, umbd_service_list, NULL, SMALL_BYTES},
    [UMBD_METHOD_LIMITS] = {UMBW_PATH_LIMITS, 0, 0, umbd_service_limits, NULL, SMALL_BYTES},
    [UMBD_METHOD_BAKES_SUBMIT] = {UMBW_PATH_BAKES_SUBMIT, 1, 0, umbd_service_bakes_submit,
                                  umbd_service_bakes_submit_end, 0},
    [UMBD_METHOD_BAKES_WATCH] = {UMBW_PATH_BAKES_WATCH, 0, 1, umbd_service_bakes_watch, NULL,
                                 SMALL_BYTES},
    [UMBD_METHOD_BAKES_CANCEL] = {UMBW_PATH_BAKES_CANCEL, 0, 0, umbd_service_bakes_cancel, NULL,
                                  SMALL_BYTES},
    [UMBD_METHOD_BAKES_LIST] = {UMBW_PATH_BAKES_LIST, 0, 0, umbd_service_bakes_list, NULL,
                                SMALL_BYTES},
    [UMBD_METHOD_BAKES_FETCH] = {UMBW_PATH_BAKES_FETCH, 0, 1, umbd_service_bakes_fetch, NULL,
                                 SMALL_BYTES},
    [UMBD_METHOD_BAKES_DELETE] = {UMBW_PATH_BAKES_DELETE, 0, 0, umbd_service_bakes_delete, NULL,
                                  SMALL_BYTES},
    [UMBD_METHOD_REGIONS_STREAM] = {UMBW_PATH_REGIONS_STREAM, 0, 1, umbd_service_regions, NULL, 0},
    [UMBD_METHOD_REGIONS_FOLLOW] = {UMBW_PATH_REGIONS_FOLLOW, 1, 1, umbd_service_regions, NULL, 0},
    [UMBD_METHOD_REGIONS_DERIVE] = {UMBW_PATH_REGIONS_DERIVE, 0, 1, umbd_service_derive, NULL, 0},
    [UMBD_METHOD_SEGMENTS] = {UMBW_PATH_SEGMENTS, 0, 0, umbd_service_segments, NULL, 0},
    [UMBD_METHOD_COLUMNS] = {UMBW_PATH_COLUMNS, 0, 0, umbd_service_columns, NULL, 0},
    [UMBD_METHOD_BOXES] = {UMBW_PATH_BOXES, 0, 0, umbd_service_boxes, NULL, 0},
    [UMBD_METHOD_CHECK] = {UMBW_PATH_CHECK, 0, 0, umbd_service_health_check, NULL, OPEN_BYTES},
    [UMBD_METHOD_WATCH] = {UMBW_PATH_WATCH, 0, 1, umbd_service_health_watch, NULL, OPEN_BYTES},
    [UMBD_METHOD_REFLECTION] = {UMBW_PATH_REFLECTION, 1, 1, umbd_service_reflection, NULL,
                                SMALL_BYTES},
    [UMBD_METHOD_REFLECTION_ALPHA] = {UMBW_PATH_REFLECTION_ALPHA, 1, 1, umbd_service_reflection,
                                      NULL, SMALL_BYTES},
#ifdef UMBRAGE_TEST_SERVICE
    [UMBD_METHOD_TEST_EMPTY] = {"/grpc.testing.TestService/EmptyCall", 0, 0, umbd_interop_empty,
                                NULL, 0},
    [UMBD_METHOD_TEST_UNARY] = {"/grpc.testing.TestService/UnaryCall", 0, 0, umbd_interop_unary,
                                NULL, 0},
    [UMBD_METHOD_TEST_INPUT] = {"/grpc.testing.TestService/StreamingInputCall", 1, 0,
                                umbd_interop_input, umbd_interop_input_end, 0},
    [UMBD_METHOD_TEST_OUTPUT] = {"/grpc.testing.TestService/StreamingOutputCall", 0, 1,
                                 umbd_interop_output, NULL, 0},
    [UMBD_METHOD_TEST_DUPLEX] = {"/grpc.testing.TestService/FullDuplexCall", 1, 1,
                                 umbd_interop_duplex, NULL, 0},
#endif
};

static enum umbd_method method_of(const char *path)
{
    enum umbd_method method = 0;
    while (method < UMBD_METHOD_UNKNOWN && strcmp(path, methods[method].path) != 0) {
        method++;
    }
    return method;
}

int umbd_call_is_busy(const struct umbd_call *call)
{
    return call->batch != NULL || (call->job_request != NULL && call->job_request->away);
}

int umbd_method_asks_points(enum umbd_method method)
{
    return method == UMBD_METHOD_QUERY || method == UMBD_METHOD_QUERY_STREAM;
}

int umbd_method_asks_space(enum umbd_method method)
{
    return method == UMBD_METHOD_SEGMENTS || method == UMBD_METHOD_COLUMNS ||
           method == UMBD_METHOD_BOXES;
}

int umbd_method_takes_many(enum umbd_method method)
{
    return method < UMBD_METHOD_UNKNOWN && methods[method].takes_many;
}

int umbd_method_gives_many(enum umbd_method method)
{
    return method < UMBD_METHOD_UNKNOWN && methods[method].gives_many;
}

/* True for methods that ask for points, bricks or bytes: the price of the call is taken together
 * with theirs, in one step. In two steps the first would make the second fail for a call that costs
 * more than the rate's head start. Streams pay for each request. */
static int pays_with_request(enum umbd_method method)
{
    return method == UMBD_METHOD_QUERY || umbd_method_asks_space(method) ||
           method == UMBD_METHOD_REGIONS_STREAM || method == UMBD_METHOD_REGIONS_DERIVE ||
           umbd_method_takes_many(method);
}

int umbd_call_is_open(const struct umbd_call *call)
{
    return call->refusal != UMBD_REFUSE_NOTHING || call->method == UMBD_METHOD_CHECK ||
           call->method == UMBD_METHOD_WATCH || call->method == UMBD_METHOD_UNKNOWN;
}

/* Records that the call's rights were checked: the connection does real work. */
static void admit(struct umbd_call *call)
{
    call->admitted = 1;
    call->conn->working++;
    call->conn->last_work_ms = call->started_ms;
    if (!pays_with_request(call->method)) {
        (void)umbd_call_take_points(call, UMBD_CALL_POINTS);
    }
}

void umbd_call_headers_end(struct umbd_call *call)
{
    call->headers_whole = 1;
    call->method = method_of(call->path);
    if (call->method < UMBD_METHOD_UNKNOWN && methods[call->method].most_bytes > 0) {
        call->reader.max_message = methods[call->method].most_bytes;
    }
    umbd_count(&call->conn->loop->daemon->metrics.started[call->method], 1);
    if (!call->is_post) {
        call->refusal = UMBD_REFUSE_METHOD; /* answered at the end of the request */
    } else if (!call->is_grpc) {
        call->refusal = UMBD_REFUSE_CONTENT_TYPE;
    } else if (call->method == UMBD_METHOD_UNKNOWN) {
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
        admit(call);
        return;
    }
    umbd_call_refused(call);
}

void umbd_call_drop_message(struct umbd_call *call)
{
    if (!call->message_borrowed) {
        free(call->message);
    }
    call->message = NULL;
    call->message_size = 0;
    call->message_borrowed = 0;
}

uint8_t *umbd_call_take_message(struct umbd_call *call)
{
    uint8_t *message = call->message;
    if (call->message_borrowed) {
        message = malloc(call->message_size > 0 ? call->message_size : 1);
        if (message == NULL) {
            return NULL;
        }
        memcpy(message, call->message, call->message_size);
    }
    call->message = NULL;
    call->message_borrowed = 0;
    return message;
}

/* Address in the moved message of data that was at `at`; NULL stays NULL. */
static const void *moved(const void *at, const uint8_t *from, const uint8_t *to)
{
    return at != NULL ? to + ((const uint8_t *)at - from) : NULL;
}

uint8_t *umbd_call_take_message_of(struct umbd_call *call, struct umb_points *points)
{
    const uint8_t *from = call->message;
    uint8_t *message = umbd_call_take_message(call);
    if (message != NULL) {
        points->positions = moved(points->positions, from, message);
        points->normals = moved(points->normals, from, message);
        points->footprints = moved(points->footprints, from, message);
    }
    return message;
}

void umbd_call_serve(struct umbd_call *call)
{
    methods[call->method].serve(call);
    umbd_call_drop_message(call);
}

void umbd_call_end_requests(struct umbd_call *call)
{
    if (methods[call->method].end != NULL) {
        methods[call->method].end(call);
    } else {
        umbd_call_finish(call);
    }
}

/* Keeps the one message of a unary call until the end of the request proves that it is one. */
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
    if (call->message_count > 0 && !umbd_method_takes_many(call->method)) {
        umbd_call_fail(call, UMBW_GRPC_INTERNAL, "request: more than one message in a unary call");
        return UMB_E_PROTOCOL;
    }
    call->message_count = 1;
    umbd_bucket_credit(&call->conn->control, 1); /* a tiny frame with a whole request is work */
    call->message_ms = uv_now(&call->conn->loop->uv);
    if (compressed) {
        UMB__TRY(inflate_message(call, message, size, &bytes, &size));
        owned = 1;
    } else if (message == call->reader.message && size > 0) {
        bytes = call->reader.message;
        call->reader.message = NULL;
        call->reader.capacity = 0;
        owned = 1;
    }
    return umbd_method_takes_many(call->method) ? umbd_stream_message(call, bytes, size, owned)
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

void umbd_call_data(struct umbd_call *call, const uint8_t *bytes, size_t count)
{
    struct umb_error error;
    error.message[0] = '\0';
    call->body_bytes += count;
    if (ignores_input(call)) {
        return;
    }
    if (umbw_reader_at_boundary(&call->reader)) {
        call->message_ms = uv_now(&call->conn->loop->uv);
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
        const int fixed = call->reader.max_message < call->conn->loop->daemon->options.max_message;
        snprintf(error.message + length, sizeof error.message - length, " (%s)",
                 fixed ? "of this method" : "--max-message");
    } else if (status == UMB_E_NO_MEMORY) {
        snprintf(error.message, sizeof error.message, "server: out of memory for the request");
    }
    umbd_call_fail_status(call, status, &error);
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
    } else if (umbd_method_takes_many(call->method)) {
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
    uint64_t bytes =
        umbd_method_takes_many(call->method) ? call->reader.received : call->body_bytes;
    return call->conn->loop->daemon->options.body_timeout_ms + bytes / UMBD_BODY_BYTES_PER_MS;
}

/*
 * Adds the time since the last check in which the server waited for the stream. Returns 1 for a
 * Submit whose files come too slowly. Its claimed sizes count against quotas, and a byte now and
 * then must not hold them.
 */
static int is_upload_slow(struct umbd_call *call, uint64_t now_ms)
{
    const struct umbd_options *options = &call->conn->loop->daemon->options;
    call->waited_ms += now_ms - call->looked_ms;
    call->looked_ms = now_ms;
    return call->method == UMBD_METHOD_BAKES_SUBMIT &&
           call->waited_ms > options->idle_timeout_ms + options->body_timeout_ms +
                                 call->data_bytes / UMBD_DATA_BYTES_PER_MS;
}

/* 1 if the request is overdue. A stream may pause between its messages as long as a connection
 * without calls may be idle. */
static int is_body_late(struct umbd_call *call, uint64_t now_ms)
{
    const struct umbd_options *options = &call->conn->loop->daemon->options;
    if (call->request_ended || call->reply_ended) {
        return 0;
    }
    if (umbd_call_is_open(call)) {
        return now_ms - call->started_ms > UMBD_OPEN_BODY_MS;
    }
    if (!umbd_method_takes_many(call->method)) {
        return now_ms - call->started_ms > body_limit_ms(call);
    }
    if (umbd_call_is_busy(call) || call->queue_first != NULL || umbd_call_unsent(call) > 0) {
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
    const struct umbd_options *options = &call->conn->loop->daemon->options;
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
        umbd_count(&call->conn->loop->daemon->metrics.abuse[UMBD_ABUSE_TIMEOUT], 1);
        nghttp2_submit_rst_stream(call->conn->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                  NGHTTP2_CANCEL);
    }
}

int umbd_call_tick(struct umbd_call *call, uint64_t now_ms)
{
    if (!call->headers_whole) {
        return now_ms - call->started_ms <= UMBD_HEADERS_MS;
    }
    if (call->deadline_ns != 0 && !call->reply_ended && umbd_call_expired(call)) {
        umbd_call_fail(call, UMBW_GRPC_DEADLINE_EXCEEDED, "grpc-timeout: the deadline passed");
    } else if (is_body_late(call, now_ms)) {
        umbd_count(&call->conn->loop->daemon->metrics.abuse[UMBD_ABUSE_TIMEOUT], 1);
        call->refusal = UMBD_REFUSE_NOTHING;
        umbd_call_fail(call, UMBW_GRPC_DEADLINE_EXCEEDED,
                       "request: it did not arrive in time (--body-timeout, --idle-timeout)");
    } else if (call->responded) {
        tick_open_reply(call, now_ms);
    }
    if (call->watch_service != NULL) {
        umbd_service_health_update(call);
    }
    umbd_service_bakes_update(call);
    return 1;
}
