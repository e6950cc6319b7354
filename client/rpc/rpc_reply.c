/* SPDX-License-Identifier: Apache-2.0 */
/* The state of one reply, see rpc_reply.h. */
#include "rpc_reply.h"

#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"
#include "grpc/grpc.h"

void umb__reply_init(struct umb__reply *reply, size_t max_message)
{
    memset(reply, 0, sizeof *reply);
    umbw_reader_init(&reply->reader, max_message);
}

void umb__reply_finish(struct umb__reply *reply)
{
    umbw_reader_finish(&reply->reader);
    free(reply->message);
    reply->message = NULL;
    reply->message_size = 0;
}

void umb__reply_restart(struct umb__reply *reply)
{
    struct umb__reply fresh;
    umb__reply_finish(reply);
    umb__reply_init(&fresh, reply->reader.max_message);
    fresh.take = reply->take;
    fresh.take_user = reply->take_user;
    *reply = fresh;
}

static bool is_name(const uint8_t *name, size_t size, const char *wanted)
{
    return size == strlen(wanted) && memcmp(name, wanted, size) == 0;
}

#define STATUS_DIGITS   3 /* Digits of :status and grpc-status */
#define PUSHBACK_DIGITS 9 /* eleven days in milliseconds */

/* Parses a number of 1 to max_digits digits, or returns -1. */
static int small_number(const uint8_t *value, size_t size, size_t max_digits)
{
    if (size == 0 || size > max_digits) {
        return -1;
    }
    int number = 0;
    for (size_t i = 0; i < size; i++) {
        if (value[i] < '0' || value[i] > '9') {
            return -1;
        }
        number = number * 10 + (value[i] - '0');
    }
    return number;
}

static void take_content_type(struct umb__reply *reply, const uint8_t *value, size_t size)
{
    static const char wanted[] = "application/grpc";
    size_t length = sizeof wanted - 1;
    (void)umb__utf8_printable(value, size, reply->content_type, sizeof reply->content_type);
    reply->is_grpc = size >= length && memcmp(value, wanted, length) == 0 &&
                     (size == length || value[length] == '+' || value[length] == ';');
}

enum umb_status umb__reply_header(struct umb__reply *reply, const uint8_t *name, size_t name_size,
                                  const uint8_t *value, size_t value_size, struct umb_error *error)
{
    /* HPACK counts 32 bytes a header, too (RFC 7541, section 4.1). */
    if (name_size > UMB__HEADER_BYTES_MAX || value_size > UMB__HEADER_BYTES_MAX ||
        name_size + value_size + 32 > UMB__HEADER_BYTES_MAX - reply->header_bytes) {
        return umb_fail(error, UMB_E_PROTOCOL, "reply: headers are over the limit of %d bytes",
                        UMB__HEADER_BYTES_MAX);
    }
    reply->header_bytes += name_size + value_size + 32;
    if (is_name(name, name_size, ":status")) {
        int status = small_number(value, value_size, STATUS_DIGITS);
        reply->http_status = status < 0 ? 999U : (unsigned)status;
    } else if (is_name(name, name_size, "content-type")) {
        take_content_type(reply, value, value_size);
    } else if (is_name(name, name_size, "grpc-status")) {
        reply->has_grpc_status = true;
        reply->grpc_status = small_number(value, value_size, STATUS_DIGITS);
    } else if (is_name(name, name_size, "grpc-retry-pushback-ms")) {
        int wait_ms = small_number(value, value_size, PUSHBACK_DIGITS);
        reply->come_again = wait_ms >= 0;
        reply->stay_away = wait_ms < 0;
        reply->come_again_ms = wait_ms >= 0 ? (uint32_t)wait_ms : 0;
    } else if (is_name(name, name_size, "grpc-message")) {
        size_t size =
            value_size < sizeof reply->grpc_message ? value_size : sizeof reply->grpc_message;
        memcpy(reply->grpc_message, value, size);
        reply->grpc_message_size = size;
    }
    return UMB_OK;
}

/* Stores a reply's only message. A message in a block of the reader is taken over with the block;
 * any other is copied. */
static enum umb_status keep_message(void *user, const uint8_t *message, size_t size, int compressed)
{
    struct umb__reply *reply = user;
    if (reply->take != NULL && !compressed) {
        reply->taken_bytes += size;
        return reply->take(reply->take_user, message, size) ? UMB_OK : UMB_E_PROTOCOL;
    }
    reply->message_count++;
    if (compressed || reply->message_count > 1) {
        return UMB_E_PROTOCOL;
    }
    if (message == reply->reader.message) {
        reply->message = reply->reader.message;
        reply->reader.message = NULL;
        reply->reader.capacity = 0;
    } else {
        reply->message = malloc(size == 0 ? 1 : size);
        if (reply->message == NULL) {
            return UMB_E_NO_MEMORY;
        }
        if (size > 0) {
            memcpy(reply->message, message, size);
        }
    }
    reply->message_size = size;
    return UMB_OK;
}

enum umb_status umb__reply_data(struct umb__reply *reply, const uint8_t *bytes, size_t count,
                                struct umb_error *error)
{
    if (!reply->is_grpc || reply->http_status != 200) {
        return UMB_OK;
    }
    /* The callback `take` cannot fill in an error; the reader of messages always does. */
    struct umb_error detail = {.status = UMB_OK};
    enum umb_status status =
        umbw_reader_feed(&reply->reader, bytes, count, keep_message, reply, &detail);
    if (status == UMB_OK) {
        return UMB_OK;
    }
    if (detail.status == UMB_OK) {
        return umb_fail(error, status, "reply: %s",
                        status == UMB_E_NO_MEMORY  ? "out of memory for its message"
                        : reply->take != NULL      ? "a message without a request"
                        : reply->message_count > 1 ? "more than one message for a single call"
                                                   : "a compressed message that was not asked for");
    }
    return umb_fail(error, status, "reply: %.300s", detail.message);
}

/* Returns the status for an HTTP status without gRPC. Source: grpc,
 * doc/http-grpc-status-mapping.md; here 400 and all others count as a broken protocol. */
static enum umb_status status_of_http(unsigned http_status)
{
    switch (http_status) {
    case 401:
        return UMB_E_UNAUTHENTICATED;
    case 403:
        return UMB_E_PERMISSION;
    case 404:
        return UMB_E_UNSUPPORTED;
    case 429:
    case 502:
    case 503:
    case 504:
        return UMB_E_UNAVAILABLE;
    default:
        return UMB_E_PROTOCOL;
    }
}

static enum umb_status server_status(const struct umb__reply *reply, struct umb_error *error)
{
    char message[1024];
    char clean[sizeof error->message];
    size_t size = umbw_message_unescape(reply->grpc_message, reply->grpc_message_size, message,
                                        sizeof message);
    (void)umb__utf8_printable((const uint8_t *)message, size, clean, sizeof clean);
    enum umb_status status = umbw_grpc_status(reply->grpc_status);
    if (reply->grpc_status == UMBW_GRPC_RESOURCE_EXHAUSTED && reply->come_again) {
        status = UMB_E_BUSY;
    }
    if (clean[0] == '\0') {
        return umb_fail(error, status, "the server answered %s (%d) without a message",
                        umbw_grpc_name(reply->grpc_status), reply->grpc_status);
    }
    return umb_fail(error, status, "%s", clean);
}

enum umb_status umb__reply_verdict(const struct umb__reply *reply, struct umb_error *error)
{
    if (!reply->has_grpc_status) {
        if (reply->http_status != 200) {
            return umb_fail(error, status_of_http(reply->http_status),
                            "the server answered HTTP status %u (content-type '%s'), not gRPC",
                            reply->http_status, reply->content_type);
        }
        if (!reply->is_grpc) {
            return umb_fail(error, UMB_E_PROTOCOL,
                            "the server answered with content-type '%s', not gRPC",
                            reply->content_type);
        }
        return umb_fail(error, UMB_E_PROTOCOL, "reply: ended without grpc-status");
    }
    if (reply->grpc_status != 0) {
        return server_status(reply, error);
    }
    if (reply->http_status != 200 || !reply->is_grpc) {
        return umb_fail(error, UMB_E_PROTOCOL,
                        "reply: grpc-status 0 with HTTP status %u and content-type '%s'",
                        reply->http_status, reply->content_type);
    }
    if (!umbw_reader_at_boundary(&reply->reader)) {
        return umb_fail(error, UMB_E_PROTOCOL, "reply: ended inside a message");
    }
    if (reply->message_count != 1 && reply->take == NULL) {
        return umb_fail(error, UMB_E_PROTOCOL, "reply: status OK without a message");
    }
    return UMB_OK;
}
