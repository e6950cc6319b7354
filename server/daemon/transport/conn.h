/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_CONN_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_CONN_H
/*
 * One connection: its socket, its protocol, its calls, its timers and budgets.
 *
 * Life: umbd_conn_adopt, then events, then umbd_conn_close from outside nghttp2's callbacks. The
 * memory is freed when libuv has closed the handle. Calls end before the session, because
 * nghttp2_session_del does not report its streams.
 *
 * Files, the lowest first: loop.c, conn_budget.c, conn_tls.c, conn.c, conn_io.c, conn_h2.c,
 * conn_http1.c, conn_room.c, conn_life.c.
 *
 * Two protocols, each a table of functions (struct umbd_protocol): HTTP/2 by nghttp2 carries gRPC,
 * HTTP/1.1 carries assets. Everything else is the same for both.
 *
 * Output: nghttp2's frames, or replies, are collected in the loop's buffer and written at once. If
 * the socket takes only a part, the rest is copied into one pending write, and no more output is
 * made until that write is done. A peer that does not read therefore costs one such block, and the
 * frames that nghttp2 queues afterwards. If these exceed UMBD_QUEUED_FRAMES, the connection ends. A
 * flush sends a limited amount; the rest waits until other connections have had their turn.
 */
#include <nghttp2/nghttp2.h>
#include <uv.h>
#include "daemon/transport/h2_filter.h"
#include "daemon/transport/h2_guard.h"
#include "daemon/transport/loop.h"
#include "daemon/base/net_address.h"

/* Functions of a protocol. Those that may send are called outside of nghttp2's callbacks. */
struct umbd_protocol {
    /* Creates the connection's state, and queues the bytes that the server sends first, if any.
     * Fails: E_NO_MEMORY. */
    enum umb_status (*start)(struct umbd_conn *conn);
    /* Frees the state. The calls have ended. */
    void (*stop)(struct umbd_conn *conn);
    /* Chooses the room for the next bytes from the socket. */
    size_t (*room)(struct umbd_conn *conn, uint8_t **place);
    /* 1 if it can take more bytes. */
    int (*has_room)(const struct umbd_conn *conn);
    /* Takes plain bytes; returns 0 or an error. */
    int (*feed)(void *conn, const uint8_t *bytes, size_t count);
    /* Collects output into the loop's buffer; returns 0 or an error. */
    int (*collect)(struct umbd_conn *conn);
    /* Sentence for an error. */
    const char *(*error_text)(int code);
    /* 1 if nothing more will be sent or read. */
    int (*is_over)(const struct umbd_conn *conn);
    /* 1 if the peer takes too long to send what it began. */
    int (*is_late)(struct umbd_conn *conn, uint64_t now_ms);
    /* Steps of umbd_conn_terminate, _notice and _last_call. */
    void (*terminate)(struct umbd_conn *conn, uint32_t code);
    void (*notice)(struct umbd_conn *conn);
    void (*last_call)(struct umbd_conn *conn);
    /* The call with that number; NULL if it has ended. */
    struct umbd_call *(*find)(struct umbd_conn *conn, int32_t stream_id);
};

extern const struct umbd_protocol umbd_protocol_h2, umbd_protocol_http1;

struct umbd_conn {
    struct umbd_loop *loop;
    struct umbd_server *server; /* The loop's */
    LIST_ENTRY(umbd_conn) link; /* Link of the loop's list */
    struct umbd_conn *next_in_bucket;
    uint64_t serial;
    union {
        uv_handle_t handle;
        uv_stream_t stream;
        uv_tcp_t tcp;
        uv_pipe_t pipe;
    } socket;
    char peer[UMBD_ADDRESS_TEXT_SIZE];
    struct umbd_conn_tls *tls; /* NULL = plain */
    const struct umbd_protocol *protocol;
    enum umbd_language language;
    nghttp2_session *session;      /* HTTP/2; NULL = HTTP/1.1, or closed */
    struct umbd_conn_http1 *http1; /* HTTP/1.1; NULL = HTTP/2, or closed */
    LIST_HEAD(, umbd_call) calls;  /* Open calls */
    size_t call_count;
    size_t buffered;  /* Bytes of its calls and of its pending write */
    size_t allowance; /* Bytes that it may hold without a further grant, see conn_budget.c */
    size_t taken;     /* Part of the allowance that its address's share gave */

    TAILQ_ENTRY(umbd_conn) stranger; /* Link of the loop's list of strangers */
    int proven;     /* 1 once a call was allowed by its rights; before that it is a stranger */
    size_t working; /* Number of its calls that were allowed by their rights */
    uint64_t last_work_ms; /* Time when such a call last began or ended; uv_now */
    unsigned watches;      /* Number of its health Watches: 0 or 1 */

    struct umbd_peer_account *account; /* Account of its address */
    /* Rate state of its calls without rights, see UMBD_OPEN_CALLS_OF_ONE. */
    atomic_uint_fast64_t open_until_ns;
    struct umbd_token_set *tokens; /* Set that holds `token` */
    struct umbd_token *token;      /* Token of the last call that had one */
    unsigned token_generation;

    struct umbd_h2_filter filter;
    struct umbd_bucket control, resets;
    unsigned header_strikes;

    uint64_t opened_ms,
        last_call_ms;    /* Times when it was opened, and when a call last began or ended; uv_now */
    uint64_t sent_bytes; /* Bytes handed to the socket, the pending write included */
    uint64_t taken_bytes,
        ticked_ms; /* Bytes that the peer had taken at the last tick, and the time of that tick */
    int64_t patience_ms;     /* Time left for a peer that reads too slowly, see umbd_conn_tick */
    uint64_t retire_at_ms;   /* Time of the next step of its retirement, 0 = none */
    enum umbd_drain retired; /* Last step of its retirement */
    int is_greeted;          /* 1 once the handshake is over, or the first head came */
    int last_request;        /* 1 if it ends with the reply under way; HTTP/1.1 */
    int leaving;             /* 1 once it was asked to leave (umbd_conn_notice) */
    int write_pending;
    int terminated; /* 1: a GOAWAY is queued; no new work begins */
    uint64_t terminated_ms;
    int closing;
    uint64_t turn_ns,
        turn_at_ms; /* Time spent on small work in the wake-up of turn_at_ms (uv_now) */
    int pump_due;   /* 1 if streams wait for their turn */
    int paused;     /* 1: its turn was too long; reading resumes in the next turn */
    int was_long;   /* 1: it had such a turn, and is read in small pieces since */
    int held;       /* 1: it is paused until the workers' queue has room */
    int dirty;
    struct umbd_conn *next_dirty;
};

/* Writes an event of a connection (umbs_log_event), with further pairs. */
#define UMBD_CONN_LOG(conn, level, event, format, ...)                                             \
    umbs_log_event(&(conn)->server->log, level, event, "peer=\"%s\" conn=%llu " format,            \
                   (conn)->peer, (unsigned long long)(conn)->serial, __VA_ARGS__)

#define UMBD_STREAMS_MAX 256 /* number of calls open at once on a connection */

/* Most frames queued for a peer: an answer for each stream, and the refusals of a burst of
 * requests. */
#define UMBD_QUEUED_FRAMES 1500

/* Takes over a connected socket; closes it if there is no room or memory. An address with too many
 * connections must give one up: a stranger (see below) is closed for the new one. If this loop has
 * no stranger of the address, the socket goes on to the next loop that may have one. */
void umbd_conn_adopt(struct umbd_loop *loop, const struct umbd_socket *socket);

#define UMBD_KEPT_SHARE 4 /* one part in this of --max-buffer is reserved */

/*
 * Rights of connections, and room for connections (conn_budget.c, conn_room.c). A stranger is a
 * connection of which no call has been allowed by its rights.
 *
 *     umbd_conn_enter, _leave      adds a new connection, a stranger; removes a closed one
 *     umbd_conn_prove              a call of the connection was allowed: no stranger from now on
 *     umbd_conn_doubt              the tokens were read again: a stranger until the next such call
 *     umbd_conn_evict              closes a stranger or an idle connection, at least a second old
 *     umbd_conn_make_room          closes one if a new one needs its place; 1 if there is room
 *     umbd_conn_make_room_at       closes the loop's oldest stranger of an address; 1 if it had one
 */
void umbd_conn_enter(struct umbd_conn *conn);
void umbd_conn_leave(struct umbd_conn *conn);
void umbd_conn_prove(struct umbd_conn *conn);
void umbd_conn_doubt(struct umbd_conn *conn);
void umbd_conn_evict(struct umbd_loop *loop);
int umbd_conn_make_room(struct umbd_loop *loop);
int umbd_conn_make_room_at(struct umbd_loop *loop, const struct sockaddr_storage *address);

/* Adds a connection to its loop's lists; umbd_conn_close removes it. */
void umbd_conn_link(struct umbd_conn *conn);

/* Frees a connection whose handle libuv has closed. */
void umbd_conn_closed(uv_handle_t *handle);

/* Closes a connection whose timer has expired. */
void umbd_conn_cut(struct umbd_conn *conn, const char *timer);

/* Sends GOAWAY to a connection and closes it, to make room for others. Returns 0 for NULL. */
int umbd_conn_dismiss(struct umbd_conn *conn);

/* 1 if it uses a Unix socket, whose mode has admitted the peer. */
int umbd_conn_is_local(const struct umbd_conn *conn);

/* Begins to read (conn_io.c); 0 or libuv's error. */
int umbd_conn_read_start(struct umbd_conn *conn);

/* Resumes reading if it was paused. May close the connection. */
void umbd_conn_read_again(struct umbd_conn *conn);

/*
 * Stops reading from the connection until the workers' queue has room, at most for a tick. It is
 * called after one of the connection's calls was refused for lack of room. Reading a batch only to
 * refuse it costs up to a third of answering it. A client that repeats its call at once would
 * therefore use up the time for answers. Meanwhile the client's data waits in the kernel.
 */
void umbd_conn_hold(struct umbd_conn *conn);

/* Resumes after umbd_conn_hold. May close the connection. */
void umbd_conn_release(struct umbd_conn *conn);

/* Closes now; logs `why` at debug. Not from within nghttp2's callbacks. */
void umbd_conn_close(struct umbd_conn *conn, const char *why);

/* Sends queued frames up to a limit, and the rest in a later turn. Closes the connection if its
 * session is over. Not from callbacks. */
void umbd_conn_flush(struct umbd_conn *conn);

/* Checks the timers. May close the connection. */
void umbd_conn_tick(struct umbd_conn *conn, uint64_t now_ms);

/* Sends GOAWAY, if the protocol has it, and lets the session end. If the connection does not end,
 * the tick closes it. */
void umbd_conn_terminate(struct umbd_conn *conn, uint32_t code);

/*
 * Two steps that ask a connection to leave without losing a call. umbd_conn_notice sends a GOAWAY
 * that still admits requests on their way. umbd_conn_last_call follows UMBD_NOTICE_MS later with
 * the final GOAWAY. It ends endless replies, and ends streams when they have answered the received
 * requests. With HTTP/1.1 replies say `Connection: close` from the notice on; the last call ends a
 * connection without a request of a caller with rights.
 */
#define UMBD_NOTICE_MS 200 /* more than a round trip */
void umbd_conn_notice(struct umbd_conn *conn);
void umbd_conn_last_call(struct umbd_conn *conn);

/* Ends the session with a GOAWAY of the kind's code, and counts and logs the abuse. Safe in
 * callbacks. */
void umbd_conn_abuse(struct umbd_conn *conn, enum umbd_abuse kind, const char *why);

/* Counts bytes held for the connection's calls. Returns 1; or 0 if that would exceed a budget,
 * which *limit and *option then name. umbd_conn_hand_over moves bytes from the connection's account
 * to the server's alone. */
int umbd_conn_charge(struct umbd_conn *conn, size_t bytes, uint64_t *limit, const char **option);
void umbd_conn_uncharge(struct umbd_conn *conn, size_t bytes);
void umbd_conn_hand_over(struct umbd_conn *conn, size_t bytes);
void umbd_conn_charge_always(struct umbd_conn *conn, size_t bytes); /* ignores all budgets */

/* The connection with that serial; NULL if it is closed. */
struct umbd_conn *umbd_conn_find(struct umbd_loop *loop, uint64_t serial);

#endif
