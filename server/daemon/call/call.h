/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALL_CALL_H
#define UMBRAGE_SERVER_DAEMON_CALL_CALL_H
/*
 * One call: a stream, from its first header to its end.
 *
 *     headers -> (body bytes)* -> end of request -> service -> reply or failure -> stream closed
 *
 * In a stream of requests (call_queue.c) each message goes to its service on arrival, one at a
 * time, and the end of the request ends the reply.
 *
 * A request of HTTP/1.1 is a call too, with a struct umbd_web: rights, rates, budgets and tasks are
 * the same, and only its head and its replies differ.
 *
 * Files, the lowest first: call_state.c, web_reply.c, call_reply.c, call_rights.c,
 * optimistic_reads.c, call_queue.c, call.c, web_call.c, call_home.c. The services are above them
 * and are called through the call's method (base/method.h).
 *
 * A failure before the end of the request is answered at once (Trailers-Only). The rest of the
 * upload is then discarded for a second before the stream is reset, because some clients would lose
 * the status otherwise. All functions run on the connection's loop. They are safe in nghttp2's
 * callbacks, because they only queue frames.
 */
#include "daemon/base/method.h"
#include "daemon/call/optimistic_reads.h"
#include "daemon/transport/conn.h"
#include "net/http1_request.h"
#include "daemon/work/batch.h"
#include "grpc/grpc.h"
#include "wire/messages.h"

#define UMBD_GRACE_MS 1000 /* time from an early failure to the reset of the upload */
/* Retry delay for clients in milliseconds: about the time in which a full queue of slices
 * drains. */
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

struct umbd_calibrations;
struct umbj_service;

/* Objects from which calls are answered; all loops share them. */
struct umbd_backend {
    const struct umbd_method *methods; /* Table that ends with a row without a path */
    const struct umbd_method *web;     /* Row for all requests of HTTP/1.1 */
    struct umbs_store *store;
    size_t store_count; /* Number of the operator's folders in the store */
    struct umbd_pool *pool;
    struct umbd_calibrations *calibrations; /* Measured for budgets */
    struct umbd_tokens *tokens;             /* NULL: every caller may query */
    struct umbj_service *jobs;              /* NULL without --jobs, and after the loops have run */
};

/* State of the calls of one loop. */
struct umbd_call_home {
    struct umbd_loop *loop;
    struct umbd_backend *backend;
    struct umbs_reader *reader; /* Reader of the store: calls find assets without a lock */
    struct umbd_optimistic_reads optimistic; /* Reads of small batches in this event */
    struct umbd_batch *spare;                /* Memory of the last small batch, for the next */
    struct umb_error error;                  /* Error of the step that is being taken for a call */
    pthread_mutex_t mutex;
    STAILQ_HEAD(umbd_done, umbd_task) done; /* Finished tasks, under the mutex */
};

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
    STAILQ_ENTRY(umbd_queued) link;
    uint8_t *bytes;
    size_t size;
};

/* State of a request of HTTP/1.1. */
struct umbd_web {
    const struct umbn_http1_request *request; /* Valid until the service returns; then NULL */
    int is_head;                              /* 1: the reply has no body */
    const char *vary;    /* Lines of Vary: fields of the request on which replies depend, or "" */
    const char *origin;  /* Value of Access-Control-Allow-Origin; NULL: none */
    int status;          /* Status of the reply; 0: none yet */
    uint64_t body_bytes; /* Bytes of the reply's body that were made ready */
};

struct umbd_call {
    struct umbd_conn *conn;
    struct umbd_server *server; /* The connection's */
    struct umbd_call_home *home;
    struct umbd_backend *backend;
    LIST_ENTRY(umbd_call) link; /* Link of the connection's list */
    int32_t stream_id;
    uint64_t started_ns;  /* Start, umbu_clock_ns */
    uint64_t deadline_ns; /* Deadline, umbu_clock_ns; 0 = none */
    uint64_t started_ms;  /* Start, uv_now */
    size_t charged;       /* Bytes counted for this call, besides UMBD_CALL_BYTES */

    /* request */
    const struct umbd_method
        *method;          /* Row of the table of methods; its last row while the path is unknown */
    void *state;          /* The service's; `close` of the method frees it */
    struct umbd_web *web; /* NULL: gRPC */
    struct umbd_header_budget headers;
    char path[UMBD_PATH_SIZE];
    int is_post, is_grpc, bad_timeout;
    enum umbd_encoding encoding; /* Value of grpc-encoding */
    int has_token;               /* 1: a bearer token came, with that hash */
    uint8_t token_hash[UMBD_HASH_BYTES];
    int reset_early; /* 1: cancelled by the peer before it was opened */
    int headers_whole, request_ended, discarding;
    int admitted; /* 1 if the call needs rights and had them when it began */
    enum umbd_refusal refusal;
    struct umbw_reader reader;
    uint64_t body_bytes;
    uint8_t *message; /* Request message being served */
    size_t message_size;
    int message_borrowed; /* 1: its memory goes with the event; copy it to keep it */
    int message_count;    /* 1 once a message came */

    /* streams of requests */
    STAILQ_HEAD(, umbd_queued) queue;
    size_t queue_bytes, queue_count;
    size_t window_held;  /* Bytes that flow control returns when the queue is shorter */
    uint64_t message_ms; /* Time when the current message began, or the last one ended; uv_now */
    uint64_t waited_ms;  /* Time in which an upload let the server wait for data */
    uint64_t looked_ms;  /* Time of the last update of waited_ms; uv_now */
    uint64_t data_bytes; /* Bytes of an upload's files that came */
    int last_call;       /* 1 in a drain: end after the received requests */

    /* work */
    struct umbd_task *task; /* Away from the loop; NULL: none */
    size_t task_bytes;      /* Bytes that the task holds */
    size_t kept_bytes;      /* Bytes that the service keeps between requests */

    /* reply */
    int counted;   /* 1 once the metrics count it */
    int reset;     /* 1: its stream was reset; sent with the next flush */
    int responded; /* 1: HEADERS are queued */
    uint64_t responded_ms, progress_ms;
    int reply_ended;           /* 1: the whole body is known; trailers follow it */
    int plain;                 /* 1: not gRPC, no trailers */
    int offer_encodings;       /* 1: the reply names the accepted encodings */
    int code;                  /* gRPC code of the trailers */
    char text[512];            /* Escaped message of the trailers */
    unsigned pushback_ms;      /* Retry delay for the client, milliseconds; 0 = none */
    struct umbw_buffer out;    /* Finished part of the body that is not all sent */
    size_t sent;               /* Bytes of out that are sent */
    uint64_t optimistic_turn;  /* Turn of its last optimistic read (optimistic_reads.h) */
    unsigned optimistic_reads; /* Bit set of the versions read */
    size_t unvalidated_bytes;  /* Bytes at the end of out that wait for revalidation */
};

/* --- State of a call (call_state.c) --- */

/* Sets the bytes counted for the call to fewer than before, or as many. */
void umbd_call_uncharge(struct umbd_call *call, size_t bytes);

/* Counts the call as finished, once, and logs it at debug. */
void umbd_call_count(struct umbd_call *call, int code);

/* Number of bytes of the reply that are finished and not sent. */
size_t umbd_call_unsent(const struct umbd_call *call);

/* 1 if the call's deadline has passed. */
int umbd_call_expired(const struct umbd_call *call);

/* Returns 1 if the call needs no rights: health calls and refused calls. Such a call has a short
 * time-out, does not protect its connection from eviction, and does not delay a drain. */
int umbd_call_is_open(const struct umbd_call *call);

/* uv_now of the call's loop. */
uint64_t umbd_call_now_ms(const struct umbd_call *call);

/* Detaches the call's task from the call. The task is cancelled if possible. Its bytes stay counted
 * until it returns and is freed. */
void umbd_call_leave_task(struct umbd_call *call);

void umbd_call_drop_message(struct umbd_call *call);

/* Takes the call's message over; a borrowed message is copied. Returns NULL if memory is short. */
uint8_t *umbd_call_take_message(struct umbd_call *call);

/* Does umbd_call_take_message, and changes the pointers of `points` into the message to its new
 * place. On failure points is unchanged. */
uint8_t *umbd_call_take_message_of(struct umbd_call *call, struct umb_points *points);

/* Fills the fields by which a finished task finds the call, which then waits for the task. bytes:
 * memory that the task holds. */
void umbd_call_await(struct umbd_call *call, struct umbd_task *task, size_t bytes);

/* Submits a task to the worker pool, whose queue, fairness, deadlines and cancelling apply. Fails:
 * E_BUSY (queue full); the task stays the caller's. */
UMB_CHECKED enum umb_status umbd_call_send_task(struct umbd_call *call, struct umbd_task *task,
                                                size_t bytes, struct umb_error *error);

/* umbd_stream_drop frees the waiting messages of a stream. umbd_stream_later continues with them in
 * the loop's next turn. */
void umbd_stream_drop(struct umbd_call *call);
void umbd_stream_later(struct umbd_call *call);

/* --- Replies of HTTP/1.1 (web_reply.c) --- */

#define UMBD_WEB_HEAD_BYTES   2048 /* room for the head of a reply */
#define UMBD_WEB_FIELDS_BYTES 768  /* room for a service's own fields */

/*
 * Writes the head of a reply, and marks the call as answered with that status.
 *
 * In: length: bytes of the body; left out of the head with 204 and 304. fields: the service's own
 *        header lines, each with its end, less than UMBD_WEB_FIELDS_BYTES. Returns the size of the
 *        head.
 */
size_t umbd_web_head(struct umbd_call *call, int status, uint64_t length, const char *fields,
                     char text[UMBD_WEB_HEAD_BYTES]);

/* Answers with a line of text, or without a body if the text is empty. */
void umbd_web_reply(struct umbd_call *call, int status, const char *fields, const char *text);

/* Answers a request of HTTP/1.1 with an error: umbd_call_fail for such requests. code: a gRPC
 * status code, from which the HTTP status follows. */
void umbd_web_fail(struct umbd_call *call, int code, const char *message);

/* Ends a reply whose body cannot be completed: the connection closes. */
void umbd_web_cut(struct umbd_call *call);

/* --- Replies (call_reply.c) --- */

/*
 * There are two ways to send a message with its prefix. In place: umbd_call_reserve, write the
 * bytes, umbd_call_commit. Handed over: umbd_call_reply. In a unary call the message is the reply
 * and ends the call. In other calls more messages may follow until umbd_call_finish.
 */

/* Reserves `bytes` at the end of the body. Returns NULL if memory is short; the call has then been
 * failed. */
uint8_t *umbd_call_reserve(struct umbd_call *call, size_t bytes);
void umbd_call_commit(struct umbd_call *call, size_t bytes);

/* Sends bytes first .. last - 1 of a malloc block, and takes the block over. */
void umbd_call_reply_block(struct umbd_call *call, uint8_t *block, size_t first, size_t last);

/* Sends a message; takes it over. */
void umbd_call_reply(struct umbd_call *call, struct umbw_buffer *message);

/*
 * One step of a service: a function that fails with a status and an error. umbd_call_error returns
 * the place for the error, empty. umbd_call_ok takes the status: it returns 1, or fails the call
 * and returns 0.
 *
 *     if (!umbd_call_ok(call, step(..., umbd_call_error(call)))) { return; }
 */
struct umb_error *umbd_call_error(struct umbd_call *call);
int umbd_call_ok(struct umbd_call *call, enum umb_status status);

/* Decodes the call's message by umbw_decode_NAME; as umbd_call_ok. */
#define UMBD_CALL_READ(call, name, out)                                                            \
    umbd_call_ok(call, umbw_decode_##name((call)->message, (call)->message_size, out,              \
                                          umbd_call_error(call)))

/* Sends a message that umbw_encode_NAME makes, or fails the call. */
#define UMBD_CALL_SEND(call, name, in)                                                             \
    do {                                                                                           \
        struct umbw_buffer to_send = {0};                                                          \
        umbd_call_reply_or_fail(call, umbw_encode_##name(in, &to_send, umbd_call_error(call)),     \
                                &to_send);                                                         \
    } while (0)

/* Sends an encoded message, or fails the call if the step that made it failed (umbd_call_ok). Takes
 * the message over in any case. */
void umbd_call_reply_or_fail(struct umbd_call *call, enum umb_status status,
                             struct umbw_buffer *message);

/* Ends a streamed reply with OK. */
void umbd_call_finish(struct umbd_call *call);

/* Fails the call. message: plain text. Has no effect if the call has been answered in full. */
void umbd_call_fail(struct umbd_call *call, int code, const char *message);
void umbd_call_fail_status(struct umbd_call *call, enum umb_status status,
                           const struct umb_error *error);

/* The same as umbd_call_fail_status, for a call whose work the workers refused. After E_BUSY (a
 * full queue) the daemon also stops reading from the connection until the queue has room. */
void umbd_call_fail_work(struct umbd_call *call, enum umb_status status,
                         const struct umb_error *error);

/* Answers a request that is not gRPC with 405 or 415 and a line of text. */
void umbd_call_refuse(struct umbd_call *call);

/* Changes the number of bytes counted for the call to `bytes`. If that exceeds a budget, fails the
 * call and returns 0. */
int umbd_call_charge(struct umbd_call *call, size_t bytes);

/* Discards the replies that have not been revalidated (optimistic_reads.h), and fails the call. */
void umbd_call_discard_unvalidated(struct umbd_call *call, const struct umb_error *error);

/* Copies `count` body bytes for sending. */
void umbd_call_take_body(struct umbd_call *call, uint8_t *to, size_t count);

/* Resets a call that needs no rights if its request or its reply is incomplete, because a drain
 * does not wait for such a call. The reset drops a queued answer, so flush the connection first. */
void umbd_call_cut_open(struct umbd_call *call);

/* --- Rights: token, rates of token and address (call_rights.c) --- */

/* Takes the authorization header. */
void umbd_call_authorization(struct umbd_call *call, const uint8_t *value, size_t size);

/* Checks whether the caller has the rights for the method. Returns 1; or 0 after failing the call
 * with UNAUTHENTICATED or PERMISSION_DENIED. */
int umbd_call_is_allowed(struct umbd_call *call);

/* Records that the call was allowed, so its connection does real work, and charges the price of the
 * call. The call has failed if its rate is used up. */
void umbd_call_admit(struct umbd_call *call);

/* Returns the call's token from the current token file; NULL if the call has none or the file no
 * longer has it. */
const struct umbd_token *umbd_call_token(struct umbd_call *call);

/*
 * Takes a reference to an asset for a call, as umbs_store_acquire. An asset of a job is E_NOT_FOUND
 * for every caller but its owners and admins. The message is that of a missing asset, even if the
 * file is damaged: the owner of a scene must not learn whether another owner had it baked. An asset
 * that is also in the store under a name is visible to all; a bake of the same scene cannot hide
 * it. umbd_call_sees returns 1 if a call may see an asset.
 */
UMB_CHECKED enum umb_status umbd_call_acquire(struct umbd_call *call, const char *name_or_id,
                                              struct umbs_entry **out, struct umb_error *error);
int umbd_call_sees(struct umbd_call *call, const uint8_t asset[UMB_ID_BYTES]);

/* Returns 1 if health may report an asset's state to the call. With a token file the call needs a
 * token with the scope `query`. */
int umbd_call_may_name_assets(struct umbd_call *call);

/* Takes points from the rates, once for each request of a stream. Returns 1, or 0 and fails the
 * call: RESOURCE_EXHAUSTED with a retry delay; or, if a reload has removed the call's token, as
 * umbd_call_is_allowed. */
int umbd_call_take_points(struct umbd_call *call, uint64_t points);

/* Takes points from the rates for work that has been allowed, even beyond the rates. Later calls
 * wait until these points are paid for. */
void umbd_call_owe_points(struct umbd_call *call, uint64_t points);

/*
 * Charges a call that needs no rights to its address's rate, UMBD_OPEN_CALLS_PER_SECOND. This rate
 * is separate from --address-rate, so a client over --address-rate does not fail a balancer's
 * health check. In addition each connection may make UMBD_OPEN_CALLS_OF_ONE calls a second. Unix
 * sockets have no rate. Beyond the rate, umbd_call_take_open fails the call with a retry delay, and
 * the daemon stops reading from a connection without rights for a moment. umbd_call_refused charges
 * a call that fails anyway.
 */
int umbd_call_take_open(struct umbd_call *call);
void umbd_call_refused(struct umbd_call *call);

/* Releases the token and the set that a connection remembers. */
void umbd_conn_forget_rights(struct umbd_conn *conn);

/* --- Streams of requests (call_queue.c) --- */

/* Passes the call's message to its service, and frees the message unless the service took it
 * over. */
void umbd_call_serve(struct umbd_call *call);

/* umbd_stream_message takes the next message, with the arguments of umbw_message_fn. _pump
 * continues with waiting messages. _window returns how many bytes of a DATA frame flow control may
 * give back at once. _charge counts the memory held now. _last_call ends the stream after the
 * received requests. */
UMB_CHECKED enum umb_status umbd_stream_message(struct umbd_call *call, uint8_t *message,
                                                size_t size, int owned);
void umbd_stream_pump(struct umbd_call *call);
size_t umbd_stream_window(struct umbd_call *call, size_t size);
void umbd_stream_charge(struct umbd_call *call);
void umbd_stream_last_call(struct umbd_call *call);

/* --- Requests (call.c): events of the transport, see struct umbd_call_events --- */

struct umbd_call *umbd_call_create(struct umbd_conn *conn, int32_t stream_id, int was_reset);
int umbd_call_header(struct umbd_call *call, const uint8_t *name, size_t name_size,
                     const uint8_t *value, size_t value_size);
int umbd_call_headers_end(struct umbd_call *call);
size_t umbd_call_room(struct umbd_call *call, size_t most, uint8_t **place);
size_t umbd_call_data(struct umbd_call *call, const uint8_t *bytes, size_t count);
void umbd_call_request_end(struct umbd_call *call);
void umbd_call_destroy(struct umbd_call *call);

/* Checks the call's timers. Returns 0 if the connection must be closed. */
int umbd_call_tick(struct umbd_call *call, uint64_t now_ms);

/* --- Requests of HTTP/1.1 (web_call.c): events of the transport --- */

struct umbd_call *umbd_web_request(struct umbd_conn *conn, int32_t number,
                                   const struct umbn_http1_request *request);
int umbd_web_is_over(const struct umbd_call *call);

/* Handlers of the transport's events for calls (call_home.c). umbd_server.backend must be a struct
 * umbd_backend. */
extern const struct umbd_call_events umbd_call_events;

#endif
