/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_CONNECTION_H
#define UMBRAGE_RPC_RPC_CONNECTION_H
/*
 * One connection: resolve, connect, HTTP/2 session, loss. Loop thread only.
 *
 * Life: resolving -> connecting [-> TLS handshake] -> settings awaited -> ready [-> draining] ->
 * lost -> freed. A call that ends at its deadline may have met a dead peer (a cut cable, a NAT that
 * dropped its entry). The connection then sends a PING, and is lost if no reply comes within
 * connect_timeout_ms. Without the PING every further call would also wait for its deadline.
 *
 * Lost is final: its calls are queued again or fail at once, and its memory is freed when libuv has
 * returned every handle and request. nghttp2_session_del does not close streams, so calls are
 * always handled before it.
 */
#include "net/tls_session.h"
#include "rpc_client.h"

/* What a connection reports to the owner of its replica (rpc_endpoint.c). */
struct umb__connection_events {
    /* The connection takes calls. */
    void (*ready)(struct umb__endpoint *endpoint);
    /* Reports the end of a call. In: begun: the server may have acted on the call. */
    void (*ended)(struct umb_client *client, struct umb__call *call, enum umb_status status,
                  const struct umb_error *error, bool begun);
    /* Reports that a connection was lost with calls under way. `ended` is then called for each of
     * these calls. */
    void (*broken)(struct umb_client *client);
    /* Reports that a connection was lost before it took a call. In: reached: the connection had
     * become ready. */
    void (*lost)(struct umb__endpoint *endpoint, const struct umb_error *reason, bool reached);
    /* The peer's bytes were read. */
    void (*read)(struct umb_client *client);
};

struct umb__connection {
    struct umb__connection *next, *previous; /* in client->connections */
    struct umb_client *client;
    struct umb__endpoint *endpoint;
    const struct umb__connection_events *events;
    union {
        uv_handle_t handle;
        uv_stream_t stream;
        uv_tcp_t tcp;
        uv_pipe_t pipe;
    } socket;
    bool socket_open;
    /* Timer that runs until the peer's settings arrive, and while a PING is unanswered */
    uv_timer_t timer;
    unsigned handles; /* not yet closed */
    uv_getaddrinfo_t resolve;
    bool resolving;
    struct addrinfo *addresses, *next_address;
    uv_connect_t connect;
    uv_write_t write;
    bool writing;
    struct umbw_buffer out;     /* HTTP/2 frames; given to uv_write while writing, unless there is
                                  TLS */
    struct umbn_tls *tls;       /* session of tls: addresses, else NULL */
    struct umbw_buffer sealed;  /* TLS records being written */
    struct umbw_buffer records; /* records made since */
    nghttp2_session *session;
    struct umb__call_list active;
    bool ready;     /* True after the peer's settings: takes calls */
    bool reported;  /* True once `ready` was reported */
    bool used;      /* took a call */
    bool probing;   /* True while it waits for any bytes after a PING */
    bool heard;     /* True if bytes came since the timer was set */
    bool draining;  /* True if it takes no more calls: after GOAWAY, or with all stream ids used */
    bool flush_due; /* True if frames were submitted outside of its callbacks */
    bool lost;
    bool http1; /* True if the first bytes were an HTTP/1 answer */
    bool saw_bytes;
    char detail[160];            /* Text of nghttp2 about what the peer did wrong */
    struct umb_error last_error; /* Error of the last address tried */
};

/* Opens a connection and makes it the replica's current one. If memory is short, the waiting calls
 * fail. */
void umb__connection_open(struct umb__endpoint *endpoint,
                          const struct umb__connection_events *events);

/* Closes a connection with a reason. Must not be called inside an nghttp2 callback. */
void umb__connection_lose(struct umb__connection *connection, const struct umb_error *reason);

/* Sends a PING on a ready connection, with the next flush. */
void umb__connection_probe(struct umb__connection *connection);

/* Sends the session's pending frames; may lose the connection. */
void umb__connection_flush(struct umb__connection *connection);

/* --- the HTTP/2 side (rpc_session.c) --- */

/* Makes the session and queues its settings. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__session_create(struct umb__connection *connection,
                                                struct umb_error *error);

/*
 * Submits a waiting call on a ready connection; the call is then in connection->active, or
 * completed. Returns false if the connection takes no more streams; the call then still waits.
 */
bool umb__session_submit(struct umb__connection *connection, struct umb__call *call);

/* Resets the stream of a call that has ended on this side. */
void umb__session_cancel(struct umb__connection *connection, struct umb__call *call);

/* Moves the unsent calls of a draining connection back to the list of waiting calls. */
void umb__session_give_back(struct umb__connection *connection);

/*
 * --- TLS (rpc_tls.c) ---
 *
 * The client's side of TLS (net/tls_session.h): the server must choose HTTP/2 (ALPN), and its
 * certificate is always verified: chain, dates and name. No option turns these checks off. After
 * it is made, a context is only read; a session has one owner.
 */

/*
 * Makes a session. Free it with umbn_tls_destroy.
 *
 * In:    name: host name or IP address that the certificate must have. sink, user: take the records
 *        to be sent.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a name that no certificate can have).
 */
UMB_CHECKED enum umb_status umb__tls_create(SSL_CTX *context, const char *name,
                                            umbn_records_fn sink, void *user, struct umbn_tls **tls,
                                            struct umb_error *error);

/*
 * Decrypts bytes from the server, as umbn_tls_open does; it is no failure if `take` stops early.
 *
 * Fails: E_UNAUTHENTICATED (a certificate that is not trusted, or the server refuses ours),
 *        E_UNAVAILABLE (the server closed the session, or does not use TLS), E_PROTOCOL (no HTTP/2,
 *        broken records).
 */
UMB_CHECKED enum umb_status umb__tls_open(struct umbn_tls *tls, const uint8_t *bytes, size_t count,
                                          umbn_plain_fn take, void *user, struct umb_error *error);

#endif
