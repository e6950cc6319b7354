/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_CLIENT_H
#define UMBRAGE_RPC_RPC_CLIENT_H
/*
 * The inside of a client: one loop thread, calls, connections.
 *
 * A call is made and encoded on the caller's thread and put into the inbox under the lock. From
 * then on it belongs to the loop thread until its `done` has run. It is in exactly one list: the
 * inbox, the waiting calls, or the active calls of one connection.
 *
 *     inbox -> waiting for a replica -> active on a connection -> done
 *                 ^---- resting <------------'  see rpc_endpoint.h
 *
 * A connection that ends before it took a call also counts as a try, with a pause before the next
 * one. So a server that accepts connections and hangs up is not tried without end.
 *
 * After GOAWAY a connection finishes its calls, while the next connection takes new ones.
 *
 * Threads: `lock` guards inbox, last_number, pending, cancels and closing. Once umb_client_open has
 * returned, only the loop thread uses the rest. No lock is held while a caller's function runs.
 */
#include <netdb.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <nghttp2/nghttp2.h>
#include <openssl/ssl.h>
#include <uv.h>
#include "net/address.h"
#include "rpc_reply.h"
#include "umbrage/client.h"
#include "wire/messages.h"

#define UMB__RETRIES_MAX   2                   /* Tries of a call that the server did not process */
#define UMB__ENDPOINTS_MAX 64                  /* bits of `tried` */
#define UMB__RECEIVE_BYTES ((size_t)256 << 10) /* Size of the read buffer of all connections */
#define UMB__SEND_BYTES    ((size_t)1 << 20)   /* Bytes gathered for one write */
#define UMB__FRAME_BYTES   (1 << 20)           /* Largest DATA frame sent and accepted */

struct umb__call;
struct umb__connection;
struct umb__endpoint;
struct umb__cancel; /* Number of a call to be cancelled (rpc_client.c) */

/* Called at the end of a call. Status UMB_OK: message is the reply, borrowed during the call; else
 * error is set. */
typedef void (*umb__done_fn)(void *user, enum umb_status status, const uint8_t *message,
                             size_t size, const struct umb_error *error);

struct umb__call_list {
    struct umb__call *first, *last;
};

/* Appends the next request message to an empty body. If there are no more requests, the body stays
 * empty. After a failure the call's HTTP/2 stream is reset. Runs on the loop thread. */
typedef enum umb_status (*umb__feed_fn)(void *user, struct umbw_buffer *body);

/* Source of request bytes of a call without a body, see rpc_stream.h. user: the call's. */
struct umb__source {
    size_t (*read)(void *user, uint8_t *buffer, size_t length); /* 0: none for now */
    void (*rewind)(void *user); /* the unanswered requests are sent again */
};

/* Parameters of a call. */
struct umb__call_plan {
    const char *asset;   /* Asset of the call, which decides its replica; NULL = any replica */
    uint64_t *number;    /* Out: number for cancelling it, see umb_client_cancel; or NULL */
    bool safe;           /* True if the call changes nothing: it may be sent again even if the
                            server may have begun it */
    const char *path;    /* static */
    uint32_t timeout_ms; /* 0 = the client's */
    struct umb_client_stream
        *stream; /* Stream that carries it; NULL: an HTTP/2 stream of its own */
    /* Functions of calls with many requests or replies, else NULL. Once `feed` has sent a message,
     * the call is not sent again. */
    umb__feed_fn feed; /* Source of the requests after the first */
    bool (*take)(void *user, const uint8_t *message, size_t size); /* see rpc_reply.h */
    void *flow_user;
    /* True for a call of many messages, each of which moves the call's deadline: see
     * umb__call_moved */
    bool flows;
};

struct umb__call {
    struct umb__call *next, *previous;
    struct umb__call_list *list;
    const char *path; /* static */
    struct umbw_buffer body;
    size_t counted; /* Bytes of the body that are counted in the client's pending_bytes. Pieces that
                       `feed` gives are not counted */
    size_t body_sent;
    umb__feed_fn feed; /* NULL: body is all */
    void *feed_user;
    bool was_fed;
    uint64_t deadline_ns; /* uv_hrtime's clock */
    uint32_t timeout_ms;
    bool flows;
    uint64_t moved_bytes; /* Bytes of the messages of a call that flows, in both directions */
    uint64_t key;         /* Hash of its asset */
    uint64_t started_ns;  /* uv_hrtime's clock */
    uint64_t ready_ns;    /* while it rests */
    uint64_t tried;       /* Set of the replicas that failed the call, a bit each */
    bool safe;
    uint64_t number;                /* Number, never used again; 0 for a carrier */
    bool cancelled;                 /* True: its deadline counts as passed */
    struct umb__endpoint *endpoint; /* Replica that it waits for or was sent to; NULL = not yet
                                       routed */
    umb__done_fn done;
    void *user;
    struct umb__connection *connection; /* NULL while waiting */
    int32_t stream_id;
    bool headers_sent;                /* True if its headers were sent on the present connection */
    struct umb_client_stream *stream; /* Stream that carries it, or NULL */
    const struct umb__source *source; /* Source of its requests; NULL: body and feed */
    unsigned retries;
    struct umb__reply reply;
    char asset[]; /* "" if it is about none */
};

/* Moves the deadline of a call with `flows` set, after a message of `bytes` was sent or received.
 * The new deadline is stall_timeout_ms from now, but never later than a rate of 1 KiB a second
 * allows. Other calls keep their deadline. */
void umb__call_moved(const struct umb_client *client, struct umb__call *call, size_t bytes);

/* A replica: its address, and the one connection to it that takes new calls. */
struct umb__endpoint {
    struct umb_client *client;
    char text[320]; /* Address as given, for messages */
    struct umbn_address address;
    char authority[UMBN_AUTHORITY_SIZE]; /* Value of the header :authority */
    uint64_t key;                        /* Hash of the address */
    struct umb__call_list waiting;
    struct umb__connection *current; /* Connection that takes new calls, or NULL */
    uint64_t backoff_ms;             /* Pause before the next connection; 0 = none; doubles with
                                        each failure */
    uint64_t backoff_until_ns;       /* Time before which no connection is tried */
    bool known;                      /* was there once */
};

struct umb_client {
    struct umb_client_options options; /* defaults filled in; max_retries is a plain number */
    struct umb__endpoint *endpoints;   /* [endpoint_count] */
    size_t endpoint_count;
    bool any_tls;
    SSL_CTX *tls_context; /* TLS context of tls: addresses, else NULL */
    char *server_name;    /* Name that the server's certificate must have; NULL = the host's */
    char *bearer;         /* Value of the authorization header, or NULL */
    pthread_mutex_t lock;
    struct umb__call_list inbox;
    uint64_t last_number;   /* Number of the newest call */
    uint32_t pending;       /* Number of calls from start to done */
    uint64_t pending_bytes; /* Bytes of the requests of these calls */
    bool closing;
    pthread_t thread;
    uv_loop_t loop;
    uv_async_t wake;
    uv_timer_t deadline_timer;
    uint64_t deadline_armed_ns; /* Time that the timer is set for; 0 = off */
    uv_timer_t rest_timer;
    uint64_t rest_armed_ns; /* Time that it is set for; 0 = off */
    bool stopped;           /* True if everything is closed or closing */
    struct umb__call_list resting;
    uint32_t tokens;                       /* budget of tries */
    uint64_t noise;                        /* state of random pauses */
    struct umb__cancel *cancels;           /* Under the lock: cancels not handled yet */
    struct umb_client_stream *new_streams; /* Under the lock: opened streams that are not yet in
                                              streams */
    struct umb_client_stream *streams;
    struct umb__connection *connections; /* all that are not lost */
    uint8_t *receive_buffer;             /* [UMB__RECEIVE_BYTES] */
};

/* --- calls (rpc_calls.c) --- */

/* Copies the name or id of an asset. In: asset: may be NULL. Fails: E_ARGUMENT (its length). */
UMB_CHECKED enum umb_status umb__asset_take(const char *asset, char out[UMBW_ASSET_NAME_MAX + 1],
                                            struct umb_error *error);

/*
 * Starts a call whose request is encoded.
 *
 * In:    body: taken over, also on failure.
 * Fails: E_BUSY, E_CANCELLED (closing), E_NO_MEMORY; `done` is then not called.
 * Threads: any.
 */
UMB_CHECKED enum umb_status umb__call_start(struct umb_client *client,
                                            const struct umb__call_plan *plan,
                                            struct umbw_buffer *body, umb__done_fn done, void *user,
                                            struct umb_error *error);

/* Returns a number that depends on all bits of z. */
uint64_t umb__mix(uint64_t z);

/* Returns the hash of an asset's name, which is the same for the same text. */
uint64_t umb__asset_key(const char *asset);

/* Moves a call to the end of a list. */
void umb__call_move(struct umb__call *call, struct umb__call_list *list);

/* Ends a call: runs done, frees it. message may be NULL. Loop thread. */
void umb__call_complete(struct umb_client *client, struct umb__call *call, enum umb_status status,
                        const struct umb_error *error);

/* Ends a call well: runs done with this message, frees it. Loop thread. */
void umb__call_answer(struct umb_client *client, struct umb__call *call, const uint8_t *message,
                      size_t size);

/* Ends a call whose deadline has passed, or which was cancelled. In: was_sent: true if the request
 * was sent to the server. */
void umb__call_expire(struct umb_client *client, struct umb__call *call, bool was_sent);

/* Completes all calls of a list with one error. */
void umb__calls_fail(struct umb_client *client, struct umb__call_list *list,
                     const struct umb_error *error);

/* --- credentials (rpc_identity.c) --- */

/*
 * Reads the files that the options name, into tls_context, bearer and server_name of the client.
 * The client's endpoints must be known. Afterwards all borrowed strings in the client's options are
 * NULL.
 *
 * Fails: E_ARGUMENT (token, or a file that cannot be used, or files without a tls: address),
 *        E_NO_INPUT, E_PERMISSION or E_IO (a file that cannot be read), E_NO_MEMORY.
 *        umb__identity_forget frees all that was read, also after a failure.
 */
UMB_CHECKED enum umb_status umb__identity_take(struct umb_client *client, struct umb_error *error);

/* Frees the credentials; a token is wiped from memory. */
void umb__identity_forget(struct umb_client *client);

/* --- ends of calls (rpc_wait.c) --- */

/* Runs a call and waits for it; decode turns the reply into *out on the loop thread. */
typedef enum umb_status (*umb__decode_fn)(void *out, const uint8_t *message, size_t size,
                                          struct umb_error *error);

/* Decoder for calls whose replies went to `take`, or are empty. */
enum umb_status umb__decode_nothing(void *out, const uint8_t *message, size_t size,
                                    struct umb_error *error);
UMB_CHECKED enum umb_status umb__call_wait(struct umb_client *client,
                                           const struct umb__call_plan *plan,
                                           struct umbw_buffer *body, umb__decode_fn decode,
                                           void *out, struct umb_error *error);

/* Called at the end of a call, successful or not. Returns the call's final status, and frees the
 * content of the context. */
typedef enum umb_status (*umb__finish_fn)(void *context, enum umb_status status,
                                          struct umb_error *error);

/* Completion of a call. */
struct umb__ending {
    void *context; /* The caller's; an asynchronous call has a copy */
    size_t context_bytes;
    umb__decode_fn decode; /* Decoder of the reply, with the context */
    umb__finish_fn finish; /* or NULL */
};

/*
 * Runs a call: waits for its end, or leaves it to `async`.
 *
 * In:    plan: flow_user becomes the context. status: result of encoding the request; a failure
 *        ends the call with that status. body: taken over, also on failure. async: NULL to wait.
 * Fails: as umb__call_start and, if it waited, as the call did.
 */
UMB_CHECKED enum umb_status umb__call_run(struct umb_client *client, struct umb__call_plan plan,
                                          enum umb_status status, struct umbw_buffer *body,
                                          const struct umb__ending *ending,
                                          struct umb_client_async *async, struct umb_error *error);

/* Decodes a reply. A malformed reply is the server's fault, so E_ARGUMENT becomes E_PROTOCOL. */
enum umb_status umb__reply_fault(enum umb_status status, const struct umb_error *detail,
                                 struct umb_error *error);

/* A stream of messages that its caller may end: the first member of a watch's state. */
struct umb__watch {
    struct umb_error error; /* Error of a malformed message; its status is UMB_OK otherwise */
    bool stopped;           /* The caller's function asked to stop */
};

/* The finish function of a watch's umb__ending. In: context: a struct that begins with umb__watch. */
enum umb_status umb__watch_finish(void *context, enum umb_status status, struct umb_error *error);

#endif
