/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_SERVER_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_SERVER_H
/*
 * State that all loops share, and the tables of functions through which calls and daemon handle
 * events. The transport knows sockets, TLS, HTTP/2 and heads of HTTP/1.1; the calls interpret the
 * content of a stream.
 */
#include <stdatomic.h>
#include "common/log.h"
#include "daemon/base/daemon_metrics.h"
#include "daemon/base/daemon_options.h"
#include "daemon/base/rate_limit.h"
#include "daemon/transport/tls_context.h"

struct umbd_call;
struct umbd_conn;
struct umbn_http1_request;
struct umbd_loop;
struct umbd_server;

/* Protocol that a listener and its connections speak. */
enum umbd_language {
    UMBD_HTTP2 = 0, /* gRPC: --listen */
    UMBD_HTTP1,     /* Assets: --http */
};

/* Events for the calls, all on the connection's loop. Events of a stream come from nghttp2's
 * callbacks, so their handlers only queue frames. */
struct umbd_call_events {
    /* A new stream. was_reset: 1 if the peer has already cancelled it. Returns NULL if memory or a
     * budget is exhausted. */
    struct umbd_call *(*open)(struct umbd_conn *conn, int32_t stream_id, int was_reset);
    /* A header field; 0 if the request's headers are over their budget. */
    int (*header)(struct umbd_call *call, const uint8_t *name, size_t name_size,
                  const uint8_t *value, size_t value_size);
    /* The header block is complete. Returns 0 if the stream was cancelled before. */
    int (*headers_end)(struct umbd_call *call);
    /* Gives the memory for the next body bytes, at most `most`. Returns its size; 0 if there is
     * none. */
    size_t (*room)(struct umbd_call *call, size_t most, uint8_t **place);
    /* Body bytes. Returns by how many of these bytes the stream's window may open again. */
    size_t (*data)(struct umbd_call *call, const uint8_t *bytes, size_t count);
    void (*request_end)(struct umbd_call *call);
    /* Copies `count` bytes of the reply for sending. */
    void (*take_body)(struct umbd_call *call, uint8_t *to, size_t count);
    void (*close)(struct umbd_call *call);

    /* A request of HTTP/1.1, whose texts are valid during the event. Returns its call, which may be
     * answered already; NULL if memory or a budget is exhausted. _unsent returns the number of
     * reply bytes that are ready to be sent. _is_over returns 1 once the reply is whole and sent.
     * _find returns the connection's call with that number, or NULL. */
    struct umbd_call *(*web_request)(struct umbd_conn *conn, int32_t number,
                                     const struct umbn_http1_request *request);
    size_t (*web_unsent)(const struct umbd_call *call);
    int (*web_is_over)(const struct umbd_call *call);
    struct umbd_call *(*web_find)(struct umbd_conn *conn, int32_t number);

    /* Events for all calls of a connection. _is_sending returns 1 if reply bytes wait. _tick checks
     * the timers and returns 0 if a header block takes too long. _pump continues with streams that
     * waited for their turn. _last_call ends calls that would not end by themselves; it may close
     * the connection. _end ends all calls, because the connection closes. */
    int (*conn_is_sending)(const struct umbd_conn *conn);
    int (*conn_tick)(struct umbd_conn *conn, uint64_t now_ms);
    void (*conn_pump)(struct umbd_conn *conn);
    void (*conn_last_call)(struct umbd_conn *conn);
    void (*conn_end)(struct umbd_conn *conn);

    /* Events for a loop. _open creates loop->home, _close frees it. _woken takes finished tasks.
     * _settle revalidates replies before HTTP/2 frames are made of them. _has_room returns 1 if
     * connections that were held may be read again. */
    enum umb_status (*loop_open)(struct umbd_loop *loop, struct umb_error *error);
    void (*loop_close)(struct umbd_loop *loop);
    void (*loop_woken)(struct umbd_loop *loop);
    void (*loop_tick)(struct umbd_loop *loop);
    void (*loop_settle)(struct umbd_loop *loop);
    int (*loop_has_room)(const struct umbd_loop *loop);
};

/* Events for the daemon, on the first loop. */
struct umbd_daemon_events {
    void (*tick)(struct umbd_server *server, uint64_t now_ms);
    void (*reload)(struct umbd_server *server); /* SIGHUP */
    void (*drained)(struct umbd_server *server);
};

struct umbd_server {
    struct umbd_options options;
    struct umbs_log log;
    struct umbd_metrics metrics;
    const struct umbd_call_events *calls;
    const struct umbd_daemon_events *daemon;
    void *backend; /* For loop_open */
    struct umbd_peer_table *peers;
    struct umbd_tls *tls;    /* NULL unless something listens on tls: */
    int has_tokens;          /* 1: only calls with a known token have rights */
    struct umbd_loop *loops; /* [loop_count], see loop.h */
    uint32_t loop_count;
    uint32_t max_connections; /* Limit of all loops: the option's, or by the descriptors */
    atomic_uint loops_running;
    atomic_int draining;                    /* 1: health says NOT_SERVING */
    atomic_uint_fast64_t next_serial;       /* Serial of the next connection; never reused */
    atomic_uint_fast64_t buffered;          /* Bytes of requests and replies held */
    size_t stranger_bytes;                  /* Bytes that a connection without rights may hold */
    atomic_uint_fast64_t stranger_buffered; /* Bytes that all of these connections hold */
    atomic_uint stranger_watches;           /* Number of their health Watches */
};

/* Initialises the server from the options. The caller then sets the pointers. */
void umbd_server_init(struct umbd_server *server, const struct umbd_options *options);

/* Counts bytes held. Returns 1; or 0, counting nothing, if --max-buffer would be exceeded. */
int umbd_server_charge(struct umbd_server *server, size_t bytes);
void umbd_server_uncharge(struct umbd_server *server, size_t bytes);

#endif
