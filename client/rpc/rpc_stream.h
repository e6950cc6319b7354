/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_STREAM_H
#define UMBRAGE_RPC_RPC_STREAM_H
/*
 * Queries over one Shadows.QueryStream. Each request is a call in the stream's lists. One more
 * call, the carrier, has the HTTP/2 stream.
 *
 *     queue (the first one may be sent in part) -> sent -> done, in order
 *       ^---------------------------------------'  the carrier ended before the answer
 *
 * The carrier exists while requests are unsent or unanswered, and then until the server ends it. A
 * server ends a stream with the status of the one request that it could not answer. That request
 * fails. The server has not begun the requests after it, which go on over another carrier.
 * Threads: loop thread only, except umb_client_stream_open and _close (umbrage/client.h).
 */
#include "rpc_client.h"

struct umb_client_stream {
    struct umb_client_stream *next; /* in client->streams or client->new_streams */
    struct umb_client *client;
    bool closing;                      /* under the client's lock */
    struct umb__call *carrier;         /* or NULL */
    bool deferred;                     /* True if the carrier has nothing to send */
    struct umb__call_list queue, sent; /* requests */
};

/* Takes a started request. */
void umb__stream_take(struct umb_client_stream *stream, struct umb__call *call);

/* Ends the requests whose deadline has passed, and the carrier if one of these was sent. Returns
 * true if the carrier was ended. */
bool umb__stream_expire(struct umb_client_stream *stream, uint64_t now_ns);

/* Ends all requests and frees the stream, which is no longer in any list. */
void umb__stream_destroy(struct umb_client_stream *stream, const struct umb_error *reason);

#endif
