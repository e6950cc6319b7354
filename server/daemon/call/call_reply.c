/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A call's reply: response headers, body, trailers, failures.
 *
 * The body is one block. Its bytes are copied once, into the connection's output. Trailers are
 * queued when nghttp2 asks for the last bytes of the body, as nghttp2 requires. Source: gRPC over
 * HTTP/2, "Responses" (github.com/grpc/grpc, doc/PROTOCOL-HTTP2.md).
 */
#include "daemon/call/call.h"
#include "grpc/grpc.h"

#include <stdlib.h>
#include <string.h>

static nghttp2_nv field(const char *name, const char *value)
{
    return (nghttp2_nv){
        .name = (uint8_t *)(uintptr_t)name, /* nghttp2 takes no const pointers, and copies both */
        .value = (uint8_t *)(uintptr_t)value,
        .namelen = strlen(name),
        .valuelen = strlen(value),
        .flags = NGHTTP2_NV_FLAG_NONE,
    };
}

/* Texts of the status fields, until nghttp2 has copied them. */
struct status_text {
    char code[4], pushback[12];
};

/* Appends the service's own field to the headers or the trailers, if there is one. */
static size_t add_own(const struct umbd_call *call, int is_trailer, nghttp2_nv *fields,
                      size_t count)
{
    const char *name = NULL, *value = NULL;
    if (call->method->field != NULL) {
        call->method->field(call, is_trailer, &name, &value);
    }
    if (name != NULL) {
        fields[count++] = field(name, value);
    }
    return count;
}

/* Appends grpc-status and the fields that belong to it. */
static size_t add_status(const struct umbd_call *call, struct status_text *text, nghttp2_nv *fields,
                         size_t count)
{
    size_t at = 0;
    if (call->code >= 10) {
        text->code[at++] = (char)('0' + call->code / 10);
    }
    text->code[at++] = (char)('0' + call->code % 10);
    text->code[at] = '\0';
    fields[count++] = field("grpc-status", text->code);
    if (call->text[0] != '\0') {
        fields[count++] = field("grpc-message", call->text);
    }
    count = add_own(call, 1, fields, count);
    if (call->pushback_ms > 0) {
        snprintf(text->pushback, sizeof text->pushback, "%u", call->pushback_ms);
        fields[count++] = field("grpc-retry-pushback-ms", text->pushback);
    }
    return count;
}

/* Resets the call's stream. If memory is short even for that, closes the connection, so that its
 * client does not wait for ever. */
static void reset_stream(struct umbd_call *call)
{
    if (nghttp2_submit_rst_stream(call->conn->session, NGHTTP2_FLAG_NONE, call->stream_id,
                                  NGHTTP2_INTERNAL_ERROR) != 0) {
        umbd_conn_terminate(call->conn, NGHTTP2_INTERNAL_ERROR);
    }
}

static ssize_t read_body(nghttp2_session *session, int32_t stream_id, uint8_t *buffer,
                         size_t length, uint32_t *flags, nghttp2_data_source *source, void *user)
{
    struct umbd_call *call = source->ptr;
    (void)buffer;
    (void)user;
    size_t left = umbd_call_unsent(call);
    size_t count = left < length ? left : length;
    if (count == 0 && !call->reply_ended) {
        return NGHTTP2_ERR_DEFERRED;
    }
    if (count == left && call->reply_ended) {
        *flags |= NGHTTP2_DATA_FLAG_EOF;
        if (!call->plain) {
            nghttp2_nv fields[6];
            struct status_text status;
            size_t field_count = add_status(call, &status, fields, 0);
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
    memcpy(to, call->out.bytes + call->sent, count);
    call->sent += count;
    call->progress_ms = umbd_call_now_ms(call);
    if (call->sent == call->out.size) {
        call->sent = call->out.size = 0;
        if (call->out.capacity > UMBD_KEPT_BYTES) {
            umbw_buffer_finish(&call->out);
        }
    }
    if (!STAILQ_EMPTY(&call->queue) && call->task == NULL) {
        umbd_stream_later(call); /* the client reads its replies: there is room for more */
    }
    if (call->method->more != NULL) {
        call->method->more(call);
    }
}

/* Frees the request's bytes, which are not needed once the answer is known. */
static void drop_request(struct umbd_call *call)
{
    umbw_reader_finish(&call->reader);
    umbd_call_drop_message(call);
    umbd_stream_drop(call);
    call->discarding = !call->request_ended;
}

static void mark_responded(struct umbd_call *call)
{
    call->responded = 1;
    call->responded_ms = umbd_call_now_ms(call);
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

void umbd_call_fail(struct umbd_call *call, int code, const char *message)
{
    if (call->responded && call->reply_ended) {
        return;
    }
    if (call->task != NULL && call->task->pool != NULL) {
        umbd_call_leave_task(call);
        call->state = call->web == NULL ? call->state : NULL; /* the task has it */
    }
    if (call->web != NULL) {
        umbd_web_fail(call, code, message);
        return;
    }
    drop_request(call);
    call->code = code;
    umbw_message_escape(message, call->text, sizeof call->text);
    call->reply_ended = 1;
    if (call->responded) {
        nghttp2_session_resume_data(call->conn->session, call->stream_id);
        return;
    }
    umbd_call_uncharge(call, 0);
    nghttp2_nv fields[8];
    struct status_text status;
    size_t count = 0;
    fields[count++] = field(":status", "200");
    fields[count++] = field("content-type", "application/grpc");
    if (call->offer_encodings) {
        fields[count++] = field("grpc-accept-encoding", "identity,gzip");
    }
    count = add_status(call, &status, fields, count);
    umbd_call_count(call, code);
    submit(call, fields, count, 0);
}

/* Returns true for failures that pass by themselves. Their replies need a trailer with a retry
 * delay, because RESOURCE_EXHAUSTED alone means a final failure. */
static int is_temporary(enum umb_status status)
{
    return status == UMB_E_NO_MEMORY || status == UMB_E_LIMIT || status == UMB_E_BUSY;
}

void umbd_call_fail_status(struct umbd_call *call, enum umb_status status,
                           const struct umb_error *error)
{
    const char *message =
        error != NULL && error->message[0] != '\0' ? error->message : umb_status_text(status);
    if (call->pushback_ms == 0 && is_temporary(status)) {
        call->pushback_ms = UMBD_PUSHBACK_MS;
    }
    umbd_call_fail(call, umbw_grpc_code(status), message);
}

void umbd_call_fail_work(struct umbd_call *call, enum umb_status status,
                         const struct umb_error *error)
{
    if (status == UMB_E_BUSY) {
        umbd_conn_hold(call->conn);
        umbd_count(&call->server->metrics.shed, 1);
    }
    umbd_call_fail_status(call, status, error);
}

int umbd_call_charge(struct umbd_call *call, size_t bytes)
{
    uint64_t limit = 0;
    const char *option = "";
    if (bytes <= call->charged) {
        umbd_call_uncharge(call, bytes);
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
    umbd_count(&call->server->metrics.shed, 1);
    call->pushback_ms = UMBD_PUSHBACK_MS;
    umbd_call_fail(call, UMBW_GRPC_RESOURCE_EXHAUSTED, text);
    return 0;
}

void umbd_call_discard_unvalidated(struct umbd_call *call, const struct umb_error *error)
{
    call->out.size -= call->unvalidated_bytes;
    call->unvalidated_bytes = 0;
    call->reply_ended = 0; /* the planned end of the reply has not been sent */
    umbd_call_fail_status(call, error->status, error);
}

void umbd_call_cut_open(struct umbd_call *call)
{
    if (call->reset || call->reset_early ||
        (call->headers_whole && call->request_ended && umbd_call_unsent(call) == 0)) {
        return;
    }
    call->reset = 1;
    nghttp2_submit_rst_stream(call->conn->session, NGHTTP2_FLAG_NONE, call->stream_id,
                              call->headers_whole ? NGHTTP2_NO_ERROR : NGHTTP2_REFUSED_STREAM);
}

static void respond_grpc(struct umbd_call *call)
{
    nghttp2_nv fields[4];
    size_t count = 0;
    fields[count++] = field(":status", "200");
    fields[count++] = field("content-type", "application/grpc");
    count = add_own(call, 0, fields, count);
    submit(call, fields, count, 1);
}

uint8_t *umbd_call_reserve(struct umbd_call *call, size_t bytes)
{
    struct umbw_buffer *out = &call->out;
    if (call->sent > 0 && out->capacity - out->size < bytes) {
        memmove(out->bytes, out->bytes + call->sent, out->size - call->sent);
        out->size -= call->sent;
        call->sent = 0;
    }
    if (out->capacity - out->size < bytes) {
        size_t capacity = out->size + bytes;
        if (umbd_gives_many(call->method)) {
            capacity += capacity / 2; /* room for more replies */
        }
        uint8_t *block = realloc(out->bytes, capacity);
        if (block == NULL) {
            umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
            return NULL;
        }
        out->bytes = block;
        out->capacity = capacity;
    }
    return out->bytes + out->size;
}

void umbd_call_commit(struct umbd_call *call, size_t bytes)
{
    call->out.size += bytes;
    if (call->optimistic_turn == call->home->optimistic.turn) {
        call->unvalidated_bytes += bytes;
    }
    if (!umbd_gives_many(call->method)) {
        drop_request(call);
        call->reply_ended = 1;
        call->code = UMBW_GRPC_OK;
    }
    if (call->responded) {
        call->progress_ms = umbd_call_now_ms(call);
        nghttp2_session_resume_data(call->conn->session, call->stream_id);
    } else {
        respond_grpc(call);
    }
}

void umbd_call_reply_block(struct umbd_call *call, uint8_t *block, size_t first, size_t last)
{
    if (umbd_call_unsent(call) > 0) {
        uint8_t *to = umbd_call_reserve(call, last - first);
        if (to != NULL) {
            memcpy(to, block + first, last - first);
            umbd_call_commit(call, last - first);
        }
        free(block);
        return;
    }
    umbw_buffer_finish(&call->out);
    call->out = (struct umbw_buffer){.bytes = block, .size = first, .capacity = last};
    call->sent = first;
    umbd_call_commit(call, last - first);
}

void umbd_call_reply(struct umbd_call *call, struct umbw_buffer *message)
{
    umbd_call_reply_block(call, message->bytes, 0, message->size);
    memset(message, 0, sizeof *message);
}

struct umb_error *umbd_call_error(struct umbd_call *call)
{
    call->home->error.message[0] = '\0';
    return &call->home->error;
}

int umbd_call_ok(struct umbd_call *call, enum umb_status status)
{
    struct umb_error *error = &call->home->error;
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, error->status == status ? error : NULL);
        error->message[0] = '\0'; /* a later step may fail without a message */
    }
    return status == UMB_OK;
}

void umbd_call_reply_or_fail(struct umbd_call *call, enum umb_status status,
                             struct umbw_buffer *message)
{
    if (umbd_call_ok(call, status) && umbd_call_charge(call, call->charged + message->size)) {
        umbd_call_reply(call, message);
    }
    umbw_buffer_finish(message);
}

void umbd_call_finish(struct umbd_call *call)
{
    if (call->reply_ended) {
        return;
    }
    if (!call->responded) {
        respond_grpc(call); /* no reply at all: headers, then trailers */
    }
    drop_request(call);
    call->reply_ended = 1;
    call->code = UMBW_GRPC_OK;
    nghttp2_session_resume_data(call->conn->session, call->stream_id);
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
    call->out.bytes = malloc(length);
    if (call->out.bytes == NULL) {
        reset_stream(call);
        return;
    }
    memcpy(call->out.bytes, text, length);
    call->out.size = call->out.capacity = length;
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
