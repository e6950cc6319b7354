/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALL_CALL_H
#define UMBRAGE_SERVER_DAEMON_CALL_CALL_H
/*
 * One call: a stream, from its first header to its end.
 *
 *     headers -> (body bytes)* -> end of request -> service -> reply or failure -> stream closed
 *
 * In a stream of requests (call_queue.c) each message goes to its service as it comes, one at a
 * time, and the end of the request ends the reply.
 *
 * A failure before the end of the request is answered at once (Trailers-Only). The rest of the
 * upload is discarded for a second before the stream is reset: some clients lose the status
 * otherwise. All functions run on the connection's loop and are safe in nghttp2's callbacks: they
 * only queue frames.
 */
#include "daemon/transport/conn.h"
#include "wire/grpc.h"
#include "wire/gunzip.h"
#include "wire/messages.h"
#include "wire/reflection.h"
#ifdef UMBRAGE_TEST_SERVICE
#include "interop_service.h"
#endif

#define UMBD_GRACE_MS 1000 /* from an early failure to the reset of the upload */
/* Retry delay for clients: a full queue of slices drains in about that time. */
#define UMBD_PUSHBACK_MS       50
#define UMBD_HEADERS_MS        10000 /* time limit of a header block */
#define UMBD_OPEN_BODY_MS      2000  /* time limit of a request that needs no rights */
#define UMBD_BODY_BYTES_PER_MS 64    /* upload rate below which --body-timeout counts down */
#define UMBD_DATA_BYTES_PER_MS 16    /* rate below which files use up the pauses of an upload */
#define UMBD_PATH_SIZE         128   /* longer paths are unknown methods anyway */
/* Counted for a call itself: struct, kept block, nghttp2's memory. */
#define UMBD_CALL_BYTES 5120
#define UMBD_KEPT_BYTES 2048 /* a stream's block of at most this is kept between replies */
/* Of a stream's requests or replies; above it the stream waits. */
#define UMBD_BACKLOG_BYTES (1 << 20)

enum umbd_refusal {
    UMBD_REFUSE_NOTHING = 0,
    UMBD_REFUSE_METHOD,       /* not POST: HTTP 405 */
    UMBD_REFUSE_CONTENT_TYPE, /* not gRPC: HTTP 415 */
};

enum umbd_encoding {
    UMBD_ENCODING_IDENTITY = 0,
    UMBD_ENCODING_GZIP,
    UMBD_ENCODING_OTHER,
};

/* A queued request message of a stream; its bytes are malloc. */
struct umbd_queued {
    struct umbd_queued *next;
    uint8_t *bytes;
    size_t size;
};

struct umbd_call {
    struct umbd_conn *conn;
    struct umbd_call *next, *previous;
    int32_t stream_id;
    uint64_t started_ns;  /* umbu_clock_ns */
    uint64_t deadline_ns; /* 0 = none */
    uint64_t started_ms;  /* uv_now */
    size_t charged;       /* bytes counted for this call, besides UMBD_CALL_BYTES */

    /* request */
    struct umbd_header_budget headers;
    char path[UMBD_PATH_SIZE];
    int is_post, is_grpc, bad_timeout;
    enum umbd_encoding encoding; /* grpc-encoding */
    int has_token;               /* a bearer token came, with that hash */
    uint8_t token_hash[UMBD_HASH_BYTES];
    int reset_early; /* cancelled by the peer before it was opened */
    int headers_whole, request_ended, discarding;
    enum umbd_method method;
    int admitted; /* 1 if the call needs rights and had them when it began */
    enum umbd_refusal refusal;
    struct umbw_reader reader;
    uint64_t body_bytes;
    uint8_t *message; /* request message being served */
    size_t message_size;
    int message_borrowed; /* its memory goes with the event: copy it to keep it */
    int message_count;    /* number of messages so far, at most 2 */

    /* streams of requests */
    struct umbd_queued *queue_first, *queue_last;
    size_t queue_bytes, queue_count;
    size_t window_held;  /* bytes that flow control returns when the queue is shorter */
    uint64_t message_ms; /* uv_now when the current message began, or the last one ended */
    uint64_t waited_ms;  /* total time in which a Submit let the server wait for data */
    uint64_t looked_ms;  /* uv_now of the last update of waited_ms */
    uint64_t data_bytes; /* bytes of its files that came */
    int last_call;       /* 1 in a drain: end after the received requests */

    /* work */
    struct umbd_batch *batch;             /* with the pool */
    struct umbd_job_request *job_request; /* to the job service, job_request.h */
    size_t batch_bytes;                   /* bytes of its message and answers */
    int is_paid; /* the request was paid before its detour, query_budget.h */
    struct umbd_kept_picture kept_picture; /* answers of the stream's last packed reply */
    char *watch_service;                   /* watch: name of the watched service, owned */
    int watch_last;                        /* serving status sent last, -1 = none */
    uint64_t watch_ms;                     /* uv_now of the last check */

    /* reply */
    int counted;   /* 1 once the metrics count it */
    int reset;     /* 1 once we reset it; sent with the next flush */
    int responded; /* HEADERS queued */
    uint64_t responded_ms, progress_ms;
    int reply_ended;           /* the whole body is known; trailers follow it */
    int plain;                 /* not gRPC: no trailers */
    int offer_encodings;       /* the reply names the accepted encodings */
    int code;                  /* gRPC code of the trailers */
    char text[512];            /* escaped message of the trailers */
    unsigned pushback_ms;      /* retry delay for the client, milliseconds; 0 = none */
    struct umbw_buffer out;    /* finished part of the body that is not all sent */
    size_t sent;               /* bytes of out that are sent */
    uint64_t optimistic_turn;  /* turn of its last optimistic read (optimistic_reads.h) */
    unsigned optimistic_reads; /* bit set of the versions read */
    size_t unvalidated_bytes;  /* bytes at the end of out that wait for revalidation */
#ifdef UMBRAGE_TEST_SERVICE
    struct umbd_echo echo;
#endif
};

/* Makes a call for a new stream. NULL: out of memory, or over a budget. */
struct umbd_call *umbd_call_create(struct umbd_conn *conn, int32_t stream_id);

/* Cancels its pending work, counts it, frees it. */
void umbd_call_destroy(struct umbd_call *call);

/* Takes one header field, which is within the header budget. */
void umbd_call_header(struct umbd_call *call, const uint8_t *name, size_t name_size,
                      const uint8_t *value, size_t value_size);

/* Checks the headers; called when all are there. */
void umbd_call_headers_end(struct umbd_call *call);

/* Room in place for the next body bytes, at most `most`; 0 if there is none. */
size_t umbd_call_room(struct umbd_call *call, size_t most, uint8_t **place);

/* Takes body bytes. */
void umbd_call_data(struct umbd_call *call, const uint8_t *bytes, size_t count);

/* Handles END_STREAM: hands the request to its service. */
void umbd_call_request_end(struct umbd_call *call);

/* Fails the call. message: plain text. No effect if it has been answered in full. */
void umbd_call_fail(struct umbd_call *call, int code, const char *message);
void umbd_call_fail_status(struct umbd_call *call, enum umb_status status,
                           const struct umb_error *error);

/* Refuses for lack of room. The client gets a retry delay, and its connection is not read
 * meanwhile. */
void umbd_call_shed(struct umbd_call *call, const struct umb_error *error);

/* Answers a request that is not gRPC with 405 or 415 and a line of text. */
void umbd_call_refuse(struct umbd_call *call);

/*
 * Replies. A message (prefix included) is either made in place (umbd_call_reserve, write it,
 * umbd_call_commit) or handed over (umbd_call_reply). In a unary call it is the reply and ends it;
 * in others more may follow until umbd_call_finish.
 */

/* Room for `bytes` at the end of the body. NULL: out of memory, and the call has been failed. */
uint8_t *umbd_call_reserve(struct umbd_call *call, size_t bytes);
void umbd_call_commit(struct umbd_call *call, size_t bytes);

/* Sends bytes first .. last - 1 of a block (malloc), and takes the block over. */
void umbd_call_reply_block(struct umbd_call *call, uint8_t *block, size_t first, size_t last);

/* Sends a message; takes it over. */
void umbd_call_reply(struct umbd_call *call, struct umbw_buffer *message);

/* Ends a streamed reply with OK. */
void umbd_call_finish(struct umbd_call *call);

/* Changes the bytes counted for the call to `bytes`. Over a budget it returns 0 and fails the
 * call. */
int umbd_call_charge(struct umbd_call *call, size_t bytes);

/* Counts the call as finished, once, and logs it at debug. */
void umbd_call_count(struct umbd_call *call, int code);

/* Number of bytes of the reply that are finished and not sent. */
size_t umbd_call_unsent(const struct umbd_call *call);

/* 1 if the call's deadline has passed. */
int umbd_call_expired(const struct umbd_call *call);

/* Discards the replies that are not revalidated (optimistic_reads.h), and fails the call. */
void umbd_call_discard_unvalidated(struct umbd_call *call, const struct umb_error *error);

/* Copies `count` body bytes for sending. */
void umbd_call_take_body(struct umbd_call *call, uint8_t *to, size_t count);

/* Checks the call's timers. Returns 0 if the connection must be closed. */
int umbd_call_tick(struct umbd_call *call, uint64_t now_ms);

/* 1 if a batch or a job request of the call is in progress: it serves no further message. */
int umbd_call_is_busy(const struct umbd_call *call);

/* 1 if the call needs no rights: health, and calls that are refused. Such a call has a short
 * time-out, does not protect its connection from eviction, and does not delay a drain. */
int umbd_call_is_open(const struct umbd_call *call);

/* Properties of a method: it asks for points; it takes, or gives, more than one message. */
int umbd_method_asks_points(enum umbd_method method);
int umbd_method_asks_space(enum umbd_method method);
int umbd_method_takes_many(enum umbd_method method);
int umbd_method_gives_many(enum umbd_method method);

/* Hands the call's message to its service; frees it, unless the service took it over. */
void umbd_call_serve(struct umbd_call *call);

/* Ends the reply of a stream whose requests are all served, or calls its service's end function. */
void umbd_call_end_requests(struct umbd_call *call);

void umbd_call_drop_message(struct umbd_call *call);

/* Takes the call's message over, copying a borrowed one. Returns NULL if out of memory. */
uint8_t *umbd_call_take_message(struct umbd_call *call);

/* umbd_call_take_message, and moves the points that lie in the message along. On failure they are
 * unchanged. */
uint8_t *umbd_call_take_message_of(struct umbd_call *call, struct umb_points *points);

/* Streams of requests (call_queue.c). _message: takes the next one, bytes as in umbw_message_fn;
 * _pump: goes on with waiting messages; _later: schedules that for the loop's next turn; _window:
 * tells how much of a DATA frame flow control may return at once; _charge: counts the memory held
 * now; _drop: frees waiting messages; _last_call: ends the stream after the received requests. */
UMB_CHECKED enum umb_status umbd_stream_message(struct umbd_call *call, uint8_t *message,
                                                size_t size, int owned);
void umbd_stream_pump(struct umbd_call *call);
size_t umbd_stream_window(struct umbd_call *call, size_t size);
void umbd_stream_charge(struct umbd_call *call);
void umbd_stream_later(struct umbd_call *call);
void umbd_stream_drop(struct umbd_call *call);
void umbd_stream_last_call(struct umbd_call *call);

/* Work for the workers that is not a query. */
struct umbd_work {
    umbd_work_fn run; /* for each slice */
    /* Called at the end; or NULL. */
    enum umb_status (*end)(struct umbd_batch *batch, struct umb_error *error);
    void (*free)(void *user); /* called last, on failure too */
    void *user;               /* the batch's work_user */
    size_t count, slice;      /* number of records, and records a slice; 1 and 1: run once */
    const char *items;        /* name of the records in messages; NULL: it runs once */
    uint64_t turns;           /* turns a slice takes, about; 0 counts as 1 */
    size_t bytes;             /* bytes that the call holds meanwhile */
};

/* Has the workers do work, with the queue, fairness, deadlines and cancelling of queries.
 * Fails: E_BUSY (queue full), E_NO_MEMORY. */
UMB_CHECKED enum umb_status
umbd_call_send_work(struct umbd_call *call, const struct umbd_work *work, struct umb_error *error);

/* Service entry points (service_*.c); the call holds its message. */
void umbd_service_query(struct umbd_call *call);
void umbd_service_regions(struct umbd_call *call);
void umbd_service_regions_done(struct umbd_call *call, struct umbd_batch *batch);
void umbd_service_derive(struct umbd_call *call);
void umbd_service_derive_done(struct umbd_call *call, struct umbd_batch *batch);
void umbd_service_limits(struct umbd_call *call);
void umbd_service_reflection(struct umbd_call *call);
void umbd_service_query_calibrated(struct umbd_call *call, struct umbd_batch *batch);
void umbd_service_query_done(struct umbd_call *call, struct umbd_batch *batch);
void umbd_service_segments(struct umbd_call *call);
void umbd_service_columns(struct umbd_call *call);
void umbd_service_boxes(struct umbd_call *call);
void umbd_service_volume_queries_done(struct umbd_call *call, struct umbd_batch *batch);
void umbd_service_describe(struct umbd_call *call);
void umbd_service_list(struct umbd_call *call);
void umbd_service_health_check(struct umbd_call *call);
void umbd_service_health_watch(struct umbd_call *call);

/* Bakes (service_bakes*.c). _submit_end: all data came; _update: sends a Watch the changes; _more:
 * goes on with a Fetch whose client has read enough. */
void umbd_service_bakes_submit(struct umbd_call *call);
void umbd_service_bakes_submit_end(struct umbd_call *call);
void umbd_service_bakes_watch(struct umbd_call *call);
void umbd_service_bakes_update(struct umbd_call *call);
void umbd_service_bakes_cancel(struct umbd_call *call);
void umbd_service_bakes_list(struct umbd_call *call);
void umbd_service_bakes_fetch(struct umbd_call *call);
void umbd_service_bakes_more(struct umbd_call *call);
void umbd_service_bakes_delete(struct umbd_call *call);

/* Sends a Watch call the current state if it changed. Asset states are checked once a second. _end:
 * the call ends. */
void umbd_service_health_update(struct umbd_call *call);
void umbd_service_health_end(struct umbd_call *call);

/* Resets a call that needs no rights if its peer has not sent, or not read, all of it: a drain does
 * not wait for that (drain.c). This drops the queued answer, so flush before. */
void umbd_call_cut_open(struct umbd_call *call);

#endif
