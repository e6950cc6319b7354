/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_STREAM_H
#define UMBRAGE_RPC_RPC_STREAM_H
/*
 * Queries over one Shadows.QueryStream: a request is a call in the stream's lists, and one more
 * call, the carrier, is what HTTP/2 sees.
 *
 *     queue (the first one may be sent in part) -> sent -> done, in order
 *       ^---------------------------------------'  the carrier ended before the answer
 *
 * There is a carrier as long as there is something to send or to wait for, and after that until the
 * server ends it. A server ends a stream with the status of the one request that it could not
 * answer: that one fails, those behind it were not begun and go on over another carrier.
 * Threads: loop thread, but for what client.h says of umb_client_stream_open and _close.
 */
#include "rpc_client.h"

struct umb_client_stream {
    struct umb_client_stream *next; /* in client->streams or client->new_streams */
    struct umb_client *client;
    bool closing;                      /* under the client's lock */
    struct umb__call *carrier;         /* or NULL */
    bool deferred;                     /* the carrier has nothing to send */
    struct umb__call_list queue, sent; /* requests */
};

/* Takes a request that was started. */
void umb__stream_take(struct umb_client_stream *stream, struct umb__call *call);

/* Copies request bytes for the carrier; 0 if there are none: then the carrier is deferred. */
size_t umb__stream_read(struct umb_client_stream *stream, uint8_t *buffer, size_t length);

/* Puts what was sent and not answered back to be sent again. */
void umb__stream_rewind(struct umb_client_stream *stream);

/* Ends requests whose time is over, and the carrier if one of them was sent; true if so. */
bool umb__stream_expire(struct umb_client_stream *stream, uint64_t now_ns);

/* Ends everything and frees the stream, which is in no list any more. */
void umb__stream_destroy(struct umb_client_stream *stream, const struct umb_error *reason);

#endif
