/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A call's reply side: response headers, body, trailers, failures.
 *
 * The body is two pieces (encoded head, answers) that are copied once, from where they lie into the
 * connection's output. Trailers are queued when nghttp2 asks for the last bytes, as it requires.
 * Source: reference measurements, "Responses" (protocol.md section 4.3 of the research notes).
 */
#include "daemon/call.h"

#include <stdlib.h>
#include <string.h>

#define PUSHBACK_MS "50" /* a full queue of full-size slices drains in about that time */

static nghttp2_nv field(const char *name, const char *value)
{
    return (nghttp2_nv){
        .name = (uint8_t *)(uintptr_t)name, /* nghttp2 takes no const; it copies both */
        .value = (uint8_t *)(uintptr_t)value,
        .namelen = strlen(name),
        .valuelen = strlen(value),
        .flags = NGHTTP2_NV_FLAG_NONE,
    };
}

/* Appends grpc-status and what goes with it. */
static size_t add_status(const struct umbd_call *call, char digits[12], nghttp2_nv *fields,
                         size_t count)
{
    snprintf(digits, 12, "%d", call->code);
    fields[count++] = field("grpc-status", digits);
    if (call->text[0] != '\0') {
        fields[count++] = field("grpc-message", call->text);
    }
    if (call->pushback) {
        fields[count++] = field("grpc-retry-pushback-ms", PUSHBACK_MS);
    }
    return count;
}

/* Without memory even for that, the connection goes: its client must not wait for ever. */
static void reset_stream(struct umbd_call *call)
{
    if (nghttp2_submit_rst_stream(call->conn->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                  NGHTTP2_INTERNAL_ERROR) != 0) {
        umbd_conn_doom(call->conn, NGHTTP2_INTERNAL_ERROR);
    }
}

static ssize_t read_body(nghttp2_session *session, int32_t stream_id, uint8_t *buffer,
                         size_t length, uint32_t *flags, nghttp2_data_source *source, void *user)
{
    struct umbd_call *call = source->ptr;
    (void)buffer;
    (void)user;
    size_t left = call->head.size + call->value_bytes - call->sent;
    size_t count = left < length ? left : length;
    if (count == 0 && !call->reply_ended) {
        return NGHTTP2_ERR_DEFERRED;
    }
    if (count == left && call->reply_ended) {
        *flags |= NGHTTP2_DATA_FLAG_EOF;
        if (!call->plain) {
            nghttp2_nv fields[3];
            char digits[12];
            size_t field_count = add_status(call, digits, fields, 0);
            *flags |= NGHTTP2_DATA_FLAG_NO_END_STREAM;
            if (nghttp2_submit_trailer(session, stream_id, fields, field_count) != 0) {
                return NGHTTP2_ERR_TEMPORAL_CALLBACK_FAILURE;
            }
        }
    }
    if (count > 0) {
        *flags |= NGHTTP2_DATA_FLAG_NO_COPY;
    }
    return (ssize_t)count;
}

void umbd_call_take_body(struct umbd_call *call, uint8_t *to, size_t count)
{
    if (call->sent < call->head.size) {
        size_t part = call->head.size - call->sent;
        part = part < count ? part : count;
        memcpy(to, call->head.bytes + call->sent, part);
        call->sent += part;
        to += part;
        count -= part;
    }
    if (count > 0) {
        memcpy(to, call->values + (call->sent - call->head.size), count);
        call->sent += count;
    }
    call->progress_ms = uv_now(&call->conn->loop->uv);
}

/* Frees the request's bytes; they are of no use once the answer is known. */
static void drop_request(struct umbd_call *call)
{
    umbw_reader_finish(&call->reader);
    free(call->message);
    call->message = NULL;
    call->message_size = 0;
    call->discarding = !call->request_ended;
}

static void mark_responded(struct umbd_call *call)
{
    call->responded = 1;
    call->responded_ms = uv_now(&call->conn->loop->uv);
    call->progress_ms = call->responded_ms;
}

static void submit(struct umbd_call *call, const nghttp2_nv *fields, size_t count, int with_body)
{
    nghttp2_data_provider provider = {.source.ptr = call, .read_callback = read_body};
    mark_responded(call);
    if (nghttp2_submit_response(call->conn->session, call->stream_id, fields, count,
                                with_body ? &provider : NULL) != 0) {
        reset_stream(call);
    }
}

/* A batch with the pool is given up: it comes home as a stranger and is freed then. */
static void abandon_batch(struct umbd_call *call)
{
    if (call->batch != NULL) {
        struct umbd_batch *batch = call->batch;
        call->batch = NULL;
        batch->charged = call->charged;
        call->conn->buffered -= call->charged;
        call->charged = 0;
        umbd_pool_cancel(call->conn->loop->daemon->pool, batch);
    }
}

void umbd_call_fail(struct umbd_call *call, int code, const char *message)
{
    if (call->responded && call->reply_ended) {
        return;
    }
    abandon_batch(call);
    drop_request(call);
    call->code = code;
    umbw_message_escape(message, call->text, sizeof call->text);
    call->reply_ended = 1;
    if (call->responded) {
        nghttp2_session_resume_data(call->conn->session, call->stream_id);
        return;
    }
    (void)umbd_call_charge(call, 0);
    nghttp2_nv fields[7];
    char digits[12];
    size_t count = 0;
    fields[count++] = field(":status", "200");
    fields[count++] = field("content-type", "application/grpc");
    if (call->offer_identity) {
        fields[count++] = field("grpc-accept-encoding", "identity");
    }
    count = add_status(call, digits, fields, count);
    umbd_call_count(call, code);
    submit(call, fields, count, 0);
}

/* What passes by itself: without the trailer a client takes RESOURCE_EXHAUSTED for final. */
static int is_temporary(enum umb_status status)
{
    return status == UMB_E_NO_MEMORY || status == UMB_E_LIMIT || status == UMB_E_BUSY;
}

void umbd_call_fail_status(struct umbd_call *call, enum umb_status status,
                           const struct umb_error *error)
{
    const char *message =
        error != NULL && error->message[0] != '\0' ? error->message : umb_status_text(status);
    call->pushback |= is_temporary(status);
    umbd_call_fail(call, umb_status_grpc(status), message);
}

static void respond_grpc(struct umbd_call *call)
{
    nghttp2_nv fields[2];
    fields[0] = field(":status", "200");
    fields[1] = field("content-type", "application/grpc");
    submit(call, fields, 2, 1);
}

void umbd_call_reply(struct umbd_call *call, struct umbw_buffer *head, uint8_t *values,
                     size_t value_bytes)
{
    drop_request(call);
    call->head = *head;
    memset(head, 0, sizeof *head);
    call->values = values;
    call->value_bytes = value_bytes;
    call->reply_ended = 1;
    call->code = UMBW_GRPC_OK;
    respond_grpc(call);
}

void umbd_call_push(struct umbd_call *call, struct umbw_buffer *head)
{
    if (call->sent == call->head.size) {
        umbw_buffer_finish(&call->head);
        call->head = *head;
        call->sent = 0;
        memset(head, 0, sizeof *head);
    } else {
        /* The last message is still waiting: put the new one behind it. */
        uint8_t *bytes = head->size <= SIZE_MAX - call->head.size
                             ? realloc(call->head.bytes, call->head.size + head->size)
                             : NULL;
        if (bytes == NULL) {
            umbw_buffer_finish(head);
            reset_stream(call);
            return;
        }
        memcpy(bytes + call->head.size, head->bytes, head->size);
        call->head.bytes = bytes;
        call->head.size += head->size;
        call->head.capacity = call->head.size;
        umbw_buffer_finish(head);
    }
    if (call->responded) {
        call->progress_ms = uv_now(&call->conn->loop->uv);
        nghttp2_session_resume_data(call->conn->session, call->stream_id);
    } else {
        respond_grpc(call);
    }
}

void umbd_call_refuse(struct umbd_call *call)
{
    static const char wrong_method[] = "This is a gRPC service: POST only.\n";
    static const char wrong_type[] =
        "This is a gRPC service: content-type must be application/grpc.\n";
    int is_method = call->refusal == UMBD_REFUSE_METHOD;
    const char *text = is_method ? wrong_method : wrong_type;
    size_t length = strlen(text);
    nghttp2_nv fields[4];
    char digits[24];
    size_t count = 0;
    if (call->responded) {
        return;
    }
    call->head.bytes = malloc(length);
    if (call->head.bytes == NULL) {
        reset_stream(call);
        return;
    }
    memcpy(call->head.bytes, text, length);
    call->head.size = call->head.capacity = length;
    call->plain = 1;
    call->reply_ended = 1;
    call->code = UMBW_GRPC_UNIMPLEMENTED;
    snprintf(digits, sizeof digits, "%zu", length);
    fields[count++] = field(":status", is_method ? "405" : "415");
    fields[count++] = field("content-type", "text/plain; charset=utf-8");
    fields[count++] = field("content-length", digits);
    if (is_method) {
        fields[count++] = field("allow", "POST");
    }
    submit(call, fields, count, 1);
}
