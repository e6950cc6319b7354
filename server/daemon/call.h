/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALL_H
#define UMBRAGE_SERVER_DAEMON_CALL_H
/*
 * One call: a stream, from its first header to its end.
 *
 *     headers -> (body bytes)* -> end of request -> service -> reply or failure -> stream closed
 *
 * A failure before the end of the request is answered at once (Trailers-Only) and the rest of the
 * upload is thrown away for a grace of a second before the stream is reset: some clients lose the
 * status otherwise. All functions run on the connection's loop and are safe in nghttp2's
 * call-backs: they only queue frames.
 */
#include "daemon/conn.h"
#include "wire/grpc.h"
#include "wire/messages.h"

#define UMBD_GRACE_MS          1000  /* between an early failure and the reset of the upload */
#define UMBD_HEADERS_MS        10000 /* for a header block to become whole */
#define UMBD_BODY_BYTES_PER_MS 64    /* slower uploads than this eat up --body-timeout */
#define UMBD_PATH_SIZE         128   /* longer paths are unknown methods anyway */
#define UMBD_CALL_BYTES        2560  /* counted for a call itself: its struct, nghttp2's stream */

enum umbd_refusal {
    UMBD_REFUSE_NOTHING = 0,
    UMBD_REFUSE_METHOD,       /* not POST: HTTP 405 */
    UMBD_REFUSE_CONTENT_TYPE, /* not gRPC: HTTP 415 */
};

struct umbd_call {
    struct umbd_conn *conn;
    struct umbd_call *next, *previous;
    int32_t stream_id;
    uint64_t started_ns;  /* umbd_now_ns */
    uint64_t deadline_ns; /* 0 = none */
    uint64_t started_ms;  /* uv_now */
    size_t charged;       /* bytes counted for this call, beside UMBD_CALL_BYTES */

    /* request */
    struct umbd_header_budget headers;
    char path[UMBD_PATH_SIZE];
    int is_post, is_grpc, bad_timeout;
    int has_encoding; /* grpc-encoding names something that is not identity */
    int reset_early;  /* cancelled by the peer before it was opened */
    int headers_whole, request_ended, discarding;
    enum umbd_method method;
    enum umbd_refusal refusal;
    struct umbw_reader reader;
    uint64_t body_bytes;
    uint8_t *message; /* the one request message, owned */
    size_t message_size;
    int message_count;

    /* work */
    struct umbd_batch *batch; /* with the pool */
    int watch_service;        /* Watch: 1 = known service */
    int watch_last;           /* last serving status sent, -1 = none */

    /* reply */
    int counted;   /* in the metrics */
    int reset;     /* by us; it goes with the next flush */
    int responded; /* HEADERS queued */
    uint64_t responded_ms, progress_ms;
    int reply_ended;         /* all of the body is known; trailers follow it */
    int plain;               /* not gRPC: no trailers */
    int offer_identity;      /* say which encodings are taken */
    int code;                /* gRPC code of the trailers */
    char text[512];          /* escaped message of the trailers */
    int pushback;            /* tell the client when to come again */
    struct umbw_buffer head; /* body, first part */
    uint8_t *values;         /* body, second part, owned */
    size_t value_bytes;
    size_t sent;
};

/* Makes a call for a new stream. NULL: out of memory, or over a budget. */
struct umbd_call *umbd_call_create(struct umbd_conn *conn, int32_t stream_id);

/* Cancels what it waits for, counts it, frees it. */
void umbd_call_destroy(struct umbd_call *call);

/* Takes one header field (already within its budget). */
void umbd_call_header(struct umbd_call *call, const uint8_t *name, size_t name_size,
                      const uint8_t *value, size_t value_size);

/* All headers are there: checks them. */
void umbd_call_headers_end(struct umbd_call *call);

/* Takes body bytes. */
void umbd_call_data(struct umbd_call *call, const uint8_t *bytes, size_t count);

/* END_STREAM: hands the request to its service. */
void umbd_call_request_end(struct umbd_call *call);

/* Fails the call. message: plain text. Does nothing if it has been answered in full. */
void umbd_call_fail(struct umbd_call *call, int code, const char *message);
void umbd_call_fail_status(struct umbd_call *call, enum umb_status status,
                           const struct umb_error *error);

/* Answers what is not gRPC with 405 or 415 and a line of text. */
void umbd_call_refuse(struct umbd_call *call);

/* Answers with one message (prefix included): head, then values (may be NULL; taken over). */
void umbd_call_reply(struct umbd_call *call, struct umbw_buffer *head, uint8_t *values,
                     size_t value_bytes);

/* Streams one more message of a server-streaming call; head is taken over. */
void umbd_call_push(struct umbd_call *call, struct umbw_buffer *head);

/* Changes what is counted for the call to `bytes`. Returns 0 and fails the call if over a budget.
 */
int umbd_call_charge(struct umbd_call *call, size_t bytes);

/* Counts the call as finished, once, and logs it at debug. */
void umbd_call_count(struct umbd_call *call, int code);

/* Bytes of the reply that are made and not sent. */
size_t umbd_call_unsent(const struct umbd_call *call);

/* 1 if the call's deadline has passed. */
int umbd_call_expired(const struct umbd_call *call);

/* Copies `count` body bytes that are to be sent now. */
void umbd_call_take_body(struct umbd_call *call, uint8_t *to, size_t count);

/* Timers of one call. Returns 0 if the connection must be closed. */
int umbd_call_tick(struct umbd_call *call, uint64_t now_ms);

/* Service entry points (service_*.c); the call holds its message. */
void umbd_service_query(struct umbd_call *call);
void umbd_service_query_done(struct umbd_call *call, struct umbd_batch *batch);
void umbd_service_describe(struct umbd_call *call);
void umbd_service_list(struct umbd_call *call);
void umbd_service_health_check(struct umbd_call *call);
void umbd_service_health_watch(struct umbd_call *call);

/* Tells a Watch call the current state if it changed. */
void umbd_service_health_update(struct umbd_call *call);

#endif
