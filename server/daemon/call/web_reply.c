/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Replies of HTTP/1.1: heads, short texts and failures.
 *
 * A failure before the head becomes a reply with a status and the sentence of the error. After the
 * head a failure closes the connection: the client then notices that it has fewer bytes than
 * Content-Length says.
 *
 * Source: RFC 9110 sections 6.6.1 (Date), 11.6.1 (WWW-Authenticate), 15 (statuses); the Fetch
 * standard, "CORS protocol".
 */
#include "daemon/call/call.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "net/http1_fields.h"

/* Status of a gRPC code. */
static int status_of(int code)
{
    static const int statuses[] = {
        [UMBW_GRPC_INVALID_ARGUMENT] = 400,    [UMBW_GRPC_UNAUTHENTICATED] = 401,
        [UMBW_GRPC_PERMISSION_DENIED] = 403,   [UMBW_GRPC_NOT_FOUND] = 404,
        [UMBW_GRPC_RESOURCE_EXHAUSTED] = 429,  [UMBW_GRPC_UNAVAILABLE] = 503,
        [UMBW_GRPC_FAILED_PRECONDITION] = 503,
    };
    const int status =
        code >= 0 && (size_t)code < sizeof statuses / sizeof statuses[0] ? statuses[code] : 0;
    return status != 0 ? status : 500;
}

/* Texts that a head is made of. */
struct head_text {
    char date[40];
    char origin[UMBD_ORIGIN_SIZE + 160];
};

static void write_date(char *text, size_t size)
{
    const time_t now = time(NULL);
    struct tm parts;
    text[0] = '\0';
    if (gmtime_r(&now, &parts) != NULL) {
        (void)strftime(text, size, "%a, %d %b %Y %H:%M:%S GMT", &parts);
    }
}

static void write_origin(const struct umbd_web *web, char *text, size_t size)
{
    text[0] = '\0';
    if (web->origin != NULL) {
        (void)snprintf(text, size,
                       "Access-Control-Allow-Origin: %s\r\n"
                       "Access-Control-Expose-Headers: Accept-Ranges, Content-Length, "
                       "Content-Range, ETag, Retry-After\r\n",
                       web->origin);
    }
}

size_t umbd_web_head(struct umbd_call *call, int status, uint64_t length, const char *fields,
                     char text[UMBD_WEB_HEAD_BYTES])
{
    const struct umbd_conn *conn = call->conn;
    struct head_text parts;
    char size[48] = "";
    write_date(parts.date, sizeof parts.date);
    write_origin(call->web, parts.origin, sizeof parts.origin);
    if (status != 204 && status != 304) {
        (void)snprintf(size, sizeof size, "Content-Length: %llu\r\n", (unsigned long long)length);
    }
    const int count = snprintf(text, UMBD_WEB_HEAD_BYTES,
                               "HTTP/1.1 %d %s\r\nDate: %s\r\n%s%s%s%s%s"
                               "X-Content-Type-Options: nosniff\r\n\r\n",
                               status, umbn_http1_reason(status), parts.date, size, fields,
                               parts.origin, call->web->vary,
                               conn->last_request || conn->leaving ? "Connection: close\r\n" : "");
    call->web->status = status;
    call->responded = 1;
    call->responded_ms = call->progress_ms = umbd_call_now_ms(call);
    return count > 0 && count < UMBD_WEB_HEAD_BYTES ? (size_t)count : 0;
}

void umbd_web_cut(struct umbd_call *call)
{
    umbw_buffer_finish(&call->out);
    call->sent = 0;
    call->reply_ended = 1;
    call->web->status = 500;
    umbd_conn_terminate(call->conn, 0);
}

void umbd_web_reply(struct umbd_call *call, int status, const char *fields, const char *text)
{
    char all[UMBD_WEB_FIELDS_BYTES + 80];
    const size_t size = strlen(text);
    const int has_body = size > 0;
    struct umbw_buffer *out = &call->out;
    umbw_buffer_finish(out);
    call->sent = 0;
    call->reply_ended = 1;
    out->bytes = malloc(UMBD_WEB_HEAD_BYTES + size + 1);
    if (out->bytes == NULL) {
        call->responded = 1;
        umbd_web_cut(call);
        return;
    }
    out->capacity = UMBD_WEB_HEAD_BYTES + size + 1;
    (void)snprintf(all, sizeof all, "%s%s", fields,
                   has_body ? "Content-Type: text/plain; charset=utf-8\r\n"
                              "Cache-Control: no-store\r\n"
                            : "");
    out->size = umbd_web_head(call, status, has_body ? size + 1 : 0, all, (char *)out->bytes);
    if (has_body && !call->web->is_head) {
        memcpy(out->bytes + out->size, text, size);
        out->bytes[out->size + size] = '\n';
        out->size += size + 1;
        call->web->body_bytes += size + 1;
    }
}

void umbd_web_fail(struct umbd_call *call, int code, const char *message)
{
    char fields[160] = "";
    const int status = status_of(code);
    if (call->responded) {
        umbd_web_cut(call);
        return;
    }
    umbd_call_uncharge(call, 0);
    if (status == 401) {
        (void)snprintf(fields, sizeof fields, "WWW-Authenticate: Bearer realm=\"umbrage\"\r\n");
    } else if (status == 429 || status == 503) {
        (void)snprintf(fields, sizeof fields, "Retry-After: %u\r\n",
                       call->pushback_ms / 1000 + (call->pushback_ms % 1000 > 0 ? 1U : 0U));
    }
    umbd_web_reply(call, status, fields, message);
}
