/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_CONNECTION_H
#define UMBRAGE_RPC_RPC_CONNECTION_H
/*
 * One connection: resolve, connect, HTTP/2 session, loss. Loop thread only.
 *
 * Life: resolving -> connecting [-> TLS handshake] -> settings awaited -> ready [-> draining]
 * -> lost -> freed.
 * A call that ends at its deadline may have met a peer that is gone without a word (a cut cable, a
 * NAT that forgot). The connection is then asked for a sign of life, and lost if none comes in the
 * time that connecting may take; else every further call would wait for its deadline too.
 *
 * Lost is final: the calls are given back or failed at once, the memory goes when libuv has
 * returned every handle and request. nghttp2_session_del closes no streams by itself, so that the
 * calls are always handled first.
 */
#include "rpc_client.h"
#include "rpc_tls.h"

struct umb__connection {
    struct umb__connection *next, *previous; /* in client->connections */
    struct umb_client *client;
    struct umb__endpoint *endpoint;
    union {
        uv_handle_t handle;
        uv_stream_t stream;
        uv_tcp_t tcp;
        uv_pipe_t pipe;
    } socket;
    bool socket_open;
    uv_timer_t timer; /* until the peer's settings came; while probing */
    unsigned handles; /* not yet closed */
    uv_getaddrinfo_t resolve;
    bool resolving;
    struct addrinfo *addresses, *next_address;
    uv_connect_t connect;
    uv_write_t write;
    bool writing;
    struct umbw_buffer out;    /* frames; given to uv_write while writing, unless there is TLS */
    struct umbn_tls *tls;      /* session of tls: addresses, else NULL */
    struct umbw_buffer sealed; /* records that are being written */
    struct umbw_buffer records; /* records made since */
    nghttp2_session *session;
    struct umb__call_list active;
    bool ready;     /* settings came: takes calls */
    bool used;      /* took a call */
    bool probing;   /* waits for any bytes, after a PING */
    bool heard;     /* bytes came since the timer was set to look */
    bool draining;  /* GOAWAY came, or stream numbers ran out: takes no more calls */
    bool flush_due; /* something was submitted outside of its call-backs */
    bool lost;
    bool http1; /* the first bytes were an HTTP/1 answer */
    bool saw_bytes;
    char detail[160];            /* what nghttp2 said about a broken peer */
    struct umb_error last_error; /* of the last address tried */
};

/* Opens a connection and makes it the replica's current one; without memory the waiting calls are
 * failed. */
void umb__connection_open(struct umb__endpoint *endpoint);

/* Ends a connection for a reason. Never from inside an nghttp2 call-back. */
void umb__connection_lose(struct umb__connection *connection, const struct umb_error *reason);

/* Sets the timer of a ready connection to look whether the peer says anything while it owes
 * answers; if not, it is asked for a sign of life. */
void umb__connection_keep_alive(struct umb__connection *connection);

/* Asks a ready connection for a sign of life; the PING goes out with the next flush. */
void umb__connection_probe(struct umb__connection *connection);

/* Sends what the session has to send; may lose the connection. */
void umb__connection_flush(struct umb__connection *connection);

/* --- the HTTP/2 side (rpc_session.c) --- */

/* Makes the session and queues its settings. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__session_create(struct umb__connection *connection,
                                                struct umb_error *error);

/*
 * Submits a waiting call on a ready connection; it is in connection->active then, or completed.
 * Returns false if the connection takes no more streams; the call still waits.
 */
bool umb__session_submit(struct umb__connection *connection, struct umb__call *call);

/* Resets a call's stream because nobody waits for it any more. */
void umb__session_cancel(struct umb__connection *connection, struct umb__call *call);

/* Puts the calls of a draining connection that were never sent back to the waiting ones. */
void umb__session_give_back(struct umb__connection *connection);

#endif
