/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_REPLY_H
#define UMBRAGE_RPC_RPC_REPLY_H
/*
 * The reply of one call so far: headers, one message (or each as it arrives), trailers; and its
 * final status.
 *
 *     umb__reply_init, then umb__reply_header and umb__reply_data as they come,
 *     umb__reply_verdict at the end of the stream, umb__reply_finish.
 *
 * No I/O and no HTTP/2 here. Trust: safe on whatever a server sends; header bytes, message bytes
 * and message count are bounded.
 * Source: "gRPC over HTTP2", Responses; "HTTP to gRPC status code mapping"; gRPC proposal A6 for
 * grpc-retry-pushback-ms: a number of milliseconds, or anything else for "do not try again".
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"
#include "grpc/grpc.h"

#define UMB__HEADER_BYTES_MAX 65536 /* names and values of one reply; nghttp2 has no such limit */

struct umb__reply {
    unsigned http_status; /* 0 = none yet */
    bool is_grpc;         /* True if content-type begins with application/grpc */
    bool has_grpc_status;
    int grpc_status; /* -1 = not a number */
    bool stay_away;  /* True if the server forbids a retry */
    bool come_again; /* True if the server allows a retry after so many milliseconds: */
    uint32_t come_again_ms;
    char content_type[64];
    char grpc_message[1024]; /* still escaped */
    size_t grpc_message_size;
    size_t header_bytes;
    struct umbw_reader reader;
    uint8_t *message; /* the one message, owned */
    size_t message_size;
    unsigned message_count;
    uint64_t taken_bytes; /* Bytes of the messages that were handed to take */
    /* Called with each message of a call with many replies; the message is borrowed. Returns false
     * if it cannot take the message. NULL: one message is stored. */
    bool (*take)(void *user, const uint8_t *message, size_t size);
    void *take_user;
};

void umb__reply_init(struct umb__reply *reply, size_t max_message);
void umb__reply_finish(struct umb__reply *reply);

/* Discards the reply so far, before a retry. */
void umb__reply_restart(struct umb__reply *reply);

/* Takes one header or trailer. Fails: E_PROTOCOL (too many header bytes). */
UMB_CHECKED enum umb_status umb__reply_header(struct umb__reply *reply, const uint8_t *name,
                                              size_t name_size, const uint8_t *value,
                                              size_t value_size, struct umb_error *error);

/* Takes the bytes of DATA frames, and drops the bytes of a reply that is not gRPC. Fails:
 * E_TOO_LARGE, E_NO_MEMORY, E_PROTOCOL. */
UMB_CHECKED enum umb_status umb__reply_data(struct umb__reply *reply, const uint8_t *bytes,
                                            size_t count, struct umb_error *error);

/* Returns the final status of an ended stream. UMB_OK: message and message_size are the answer. */
UMB_CHECKED enum umb_status umb__reply_verdict(const struct umb__reply *reply,
                                               struct umb_error *error);

#endif
