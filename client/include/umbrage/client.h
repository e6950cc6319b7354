/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLIENT_H
#define UMBRAGE_CLIENT_H
/*
 * libumbrage: asking a daemon over gRPC.
 *
 *     struct umb_client *client;
 *     enum umb_status status = umb_client_open("tcp:127.0.0.1:7420", NULL, &client, &error);
 *     if (status == UMB_OK) {
 *         status = umb_client_query(client, &request, values, &reply, &error);  // waits
 *     }
 *     umb_client_close(client);
 *
 * A client owns one loop thread and one connection to each server of its address. A connection
 * opens at the first call for its server, and again after a loss. The client sends an HTTP/2 PING
 * when a call meets its deadline, or when a server that owes answers is silent for keepalive_ms.
 * Without a reply to the PING within connect_timeout_ms the connection counts as lost.
 *
 * Retries: a call that the server has not begun is sent again at once. A call whose connection was
 * lost, or that the server refused with UNAVAILABLE or with retry pushback ("retry after"), is sent
 * again after a pause. Repeating a query is safe, because queries change nothing. A call is retried
 * at most max_retries times, within its deadline, and not while most calls fail. A server that was
 * connected before and is gone (restarted) is awaited for at most connect_timeout_ms. A server that
 * was never reached fails the call at once.
 *
 * Several servers: "tcp:a:7420,tcp:b:7420" are replicas with the same assets, 64 at most. Each
 * asset has its own order of the replicas (rendezvous hashing), the same for every client. A call
 * goes to the first replica in that order that can be reached, and a retry to the next.
 * Asynchronous functions return at once and call back on the client's own thread. Blocking ones
 * start the asynchronous call and wait for it. The library never aborts, exits or prints.
 *
 * Addresses: "tcp:HOST:PORT" (HOST may be [::1]), "tls:HOST:PORT" and "unix:PATH".
 * TLS: 1.2 or 1.3; the server's certificate is always verified. A token is sent with every call,
 * whatever the address. On tcp: it travels in the clear, so use tls: or a Unix socket.
 * Ownership: requests are copied before a call returns; a callback's reply and error are borrowed
 * during the callback.
 * Threads: every function may be called from any thread at once on one client, but for
 * umb_client_close. Blocking calls fail with E_STATE in a callback: they would wait for
 * themselves. A callback that takes long delays all other calls of its client.
 * Trust: every message of a server is bounded and checked. A hostile server can only fail calls or
 * give wrong answers.
 * Errors: the server's gRPC status becomes the status of the same meaning. RESOURCE_EXHAUSTED
 * becomes E_BUSY if the server says when to retry, and E_TOO_LARGE if it does not
 * (docs/decisions/0005-retry-pushback.md).
 * Limits: one connection to each server.
 * Caveat: the system's resolver looks up names and cannot be interrupted. umb_client_close waits
 * for a look-up that is under way.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/log.h"
#include "umbrage/curve.h"
#include "umbrage/derive.h"
#include "umbrage/picture.h"
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_client;        /* opaque */
struct umb_client_stream; /* opaque */

/* Value of max_retries for no retries, unless the server says that it did not begin the call. For
 * measurements, and for programs with retries of their own. */
#define UMB_CLIENT_NEVER UINT32_MAX

struct umb_client_options {
    uint32_t connect_timeout_ms; /* Wait for the server's first frame or PING reply; 0 = 5000 */
    uint32_t call_timeout_ms;    /* Deadline of a call, sent as grpc-timeout; 0 = 60000 */
    uint32_t stall_timeout_ms;   /* Wait for the next message in calls with many messages (fetch,
                                    submission), plus a second for each KiB in all; 0 = 120000 */
    uint32_t keepalive_ms;       /* Silence, of a server that owes answers, after which the client
                                    sends a PING; 0 = 10000 */
    uint32_t max_retries;        /* Retries of a call, see above; 0 = 2; UMB_CLIENT_NEVER = none */
    uint32_t max_calls;          /* Calls under way and waiting; 0 = 1024; beyond: E_BUSY */
    uint64_t max_request_bytes;  /* Bytes of the requests of all calls under way and waiting; 0 =
                                    256 MiB; beyond: E_BUSY. A single call may have more */
    uint64_t max_reply_bytes;    /* Bytes of one reply; 0 = 64 MiB, at most 4 GiB */
    umb_log_fn log;              /* Log callback, called on the client's thread; NULL = silent */
    void *log_user;              /* First argument of `log` */
    /* For tls: addresses only: PEM files, read by umb_client_open and not again. */
    const char *ca_file;          /* Authorities to trust; NULL = those of the system */
    const char *certificate_file; /* Client's certificate chain, for mutual TLS; NULL = none */
    const char *key_file;         /* Private key of the certificate, without a password; NULL = in
                                     certificate_file */
    const char *server_name;      /* Name that the server's certificate must have; NULL = HOST */
    const char *token; /* Bearer token: 1 to 4096 printable characters, no blanks; NULL = none */
    const char *token_file; /* File that holds only the token; a newline at its end is cut off */
    uint64_t reserved[8];   /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_query_request {
    const char *asset; /* Name, or id in hexadecimal: 1 to 255 bytes of UTF-8 */
    struct umb_query_settings settings;
    /* Dial by which the server chooses taps and level, which must then be 0 in `settings`; zeroed:
     * no dial. budget_ns counts on one of the server's cores, which the server calibrates on points
     * like these. */
    struct umb_dial dial;
    struct umb_points points; /* Batch of points; only the server checks that they are finite */
    /* Depth picture with a point for each pixel (umbrage/picture.h), instead of `points`, whose
     * count and positions are then ignored. NULL: points. */
    const struct umb_picture *picture;
    int pack; /* 1: answers travel packed; the client unpacks them */
    /* With pack: answers to an earlier packed query of the same stream, of the same length as this
     * query's. A server that still has these answers sends only the changes. Copied; NULL: none. */
    const void *base;
    int want_stats;                   /* 1: the reply carries stats; else 0 */
    uint32_t timeout_ms;              /* Deadline of this call; 0 = the client's */
    struct umb_client_stream *stream; /* Stream of the same client; NULL: a call of its own */
    uint64_t reserved[8];             /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_query_reply {
    const void *values;             /* Answers in settings.format, in the order of the points */
    size_t value_bytes;             /* Length in bytes: umb_answer_bytes(format, count) */
    uint8_t asset_id[UMB_ID_BYTES]; /* Id of the asset that answered */
    struct umb_query_stats stats;   /* Counts of the run; 0 without want_stats */
    uint64_t nanoseconds;           /* CPU time on the server; 0 without want_stats */
    /* Settings that answered, if want_stats is set, and their accuracy and cost as in struct
     * umb_curve_row. All are 0 if the server does not say; accuracy and cost also if the asset has
     * no accuracy curve. */
    uint32_t level, taps;
    double bound_m, visibility_error, lines;
    double expected_ns;    /* Expected nanoseconds a point, with a budget and stats; else 0 */
    uint64_t packed_bytes; /* Bytes of the answers on the wire, if they were packed; else 0 */
    int changes_only;      /* 1: the answers were packed against `base` */
    uint64_t reserved[4];  /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_asset {
    char name[256]; /* UTF-8, NUL-terminated */
    uint8_t id[UMB_ID_BYTES];
    uint64_t packed_bytes; /* Length of the packed file */
    uint64_t memory_bytes; /* Bytes that queries read */
    uint32_t light_count;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_light {
    struct umb_light_info info; /* first_frustum and frustum_count are 0: not on the wire */
    uint64_t resolution;        /* Voxels a side */
    double voxel_m[3];          /* Edges of a voxel along the frustum's x, y, z, metres */
    int closed;                 /* 1: baked under the closed rule */
    size_t curve_count;         /* Number of rows; 0: the asset or the server gives no curve */
    struct umb_curve_row curve[UMB_CURVE_ROWS_MAX];
    /* Nanoseconds a point of each row on one of the server's cores. scattered_ns is for points all
     * over the scene, coherent_ns for points next to each other. 0 until the first query with a
     * budget and points of that kind. */
    double scattered_ns[UMB_CURVE_ROWS_MAX], coherent_ns[UMB_CURVE_ROWS_MAX];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Description of an asset. Numbers are as the server sent them: they may be infinite or NaN. */
struct umb_client_description {
    struct umb_client_asset asset;
    uint32_t light_count;
    struct umb_client_light *lights;  /* [light_count] */
    double origin[3];                 /* Scene origin, metres, world space */
    struct umb_box bounds;            /* Box around the casters, metres, world space */
    uint8_t scene_hash[UMB_ID_BYTES]; /* SHA-256 of the scene's content */
    char *plan, *settings;            /* Texts as in struct umb_asset_info, UTF-8 */
    uint64_t reserved[4];             /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Called at the end of a query.
 *
 * In:    status UMB_OK: reply is set and error NULL; else reply is NULL and error is set.
 * Threads: called exactly once for each started query, on the client's thread. May start calls.
 */
typedef void (*umb_client_query_fn)(void *user, enum umb_status status,
                                    const struct umb_client_query_reply *reply,
                                    const struct umb_error *error);

/* Called at the end of a call. In: error: NULL if status is UMB_OK.
 * Threads: called exactly once for each started call, on the client's thread. May start calls. */
typedef void (*umb_client_done_fn)(void *user, enum umb_status status,
                                   const struct umb_error *error);

/*
 * An asynchronous call. A function that takes one returns at once; with NULL instead the function
 * waits for the end of the call.
 *
 * Ownership: output memory is the caller's and must stay until `done` is called; by then it is
 * written. Inputs are copied, unless the function's description says otherwise. If the function
 * fails at once, `done` is not called.
 */
struct umb_client_async {
    umb_client_done_fn done;
    void *user;           /* First argument of `done` */
    uint64_t call;        /* Out: number of the call, for umb_client_cancel */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Makes a client. Does not connect yet.
 *
 * In:    address: one, or several with commas between; copied. options: copied, strings too; NULL
 *        for the defaults.
 * Out:   out: the client, or NULL on failure.
 * Owns:  the caller closes it with umb_client_close.
 * Fails: E_ARGUMENT (address, token, a file with unusable content, files without a tls: address),
 *        E_NO_INPUT, E_PERMISSION or E_IO (a file that cannot be read), E_NO_MEMORY, E_INTERNAL
 *        (the system gives no lock, loop or thread).
 * Cost:  one thread with all signals blocked, about 0.3 MiB.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_open(const char *address,
                                                    const struct umb_client_options *options,
                                                    struct umb_client **out,
                                                    struct umb_error *error);

/*
 * Cancels all calls under way (their callbacks get E_CANCELLED), waits for the client's thread and
 * frees the client.
 *
 * In:    client: may be NULL.
 * Threads: no other thread may use the client, or begin to. Never call it from a callback.
 */
UMB_API void umb_client_close(struct umb_client *client);

/*
 * Starts a query and returns; `done` is called at its end.
 *
 * In:    request: copied whole, points included. user: handed to done.
 * Out:   call: the query's number, for umb_client_cancel; may be NULL.
 * Fails: at once, without calling done: E_ARGUMENT (a request that the server would refuse without
 *        looking at the points), E_TOO_LARGE (over 4 GiB of points), E_BUSY (max_calls),
 *        E_CANCELLED (closing), E_NO_MEMORY.
 *        Through done: E_UNAVAILABLE (no connection, or a lost one), E_UNAUTHENTICATED (the
 *        certificate or token is not accepted), E_DEADLINE, E_CANCELLED, E_TOO_LARGE (reply over
 *        max_reply_bytes), E_PROTOCOL (malformed gRPC), E_NO_MEMORY, and the server's own status.
 * Cost:  one copy of the points.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_query_start(struct umb_client *client, const struct umb_client_query_request *request,
                       umb_client_query_fn done, void *user, uint64_t *call,
                       struct umb_error *error);

/*
 * Cancels a call by its number. The call's callback is called once in any case: soon with
 * E_CANCELLED, or with the call's result if the call has ended by then. The server drops the part
 * of the work that it has not begun. The other unanswered queries of the call's stream are sent
 * again.
 *
 * In:    call: number from umb_client_query_start or struct umb_client_async. 0 and the numbers of
 *        ended calls cancel nothing; numbers are not used again.
 * Fails: E_NO_MEMORY: nothing was cancelled.
 * Threads: any, callbacks too.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_cancel(struct umb_client *client, uint64_t call,
                                                      struct umb_error *error);

/*
 * Sends a query and waits for its answers.
 *
 * Out:   values: answers in settings.format, umb_answer_bytes(format, count) bytes, not
 *        overlapping request->base. On failure unchanged, or with pack unspecified.
 *        reply: may be NULL; zeroed on failure; on success reply->values points to values.
 * Fails: as umb_client_query_start, at once or later; E_STATE in a callback.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_query(struct umb_client *client, const struct umb_client_query_request *request,
                 void *values, struct umb_client_query_reply *reply, struct umb_error *error);

/*
 * Makes a stream, for programs that query again and again, such as a frame loop. Queries that name
 * the stream are answered in the order in which they were started, at a fraction of a call's cost.
 * Nothing is sent before the first query. If the server or the network ends the stream, the next
 * query opens it again. A query that meets its deadline or is refused fails alone.
 *
 * Owns:  the caller closes it with umb_client_stream_close before it closes the client.
 * Fails: E_NO_MEMORY.
 * Threads: any; several threads may query over one stream.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_stream_open(struct umb_client *client,
                                                           struct umb_client_stream **out,
                                                           struct umb_error *error);

/* Cancels the queries under way on a stream (their callbacks soon get E_CANCELLED) and frees it.
 * NULL is allowed. Threads: no other thread may use the stream; a callback may close it. */
UMB_API void umb_client_stream_close(struct umb_client_stream *stream);

/*
 * Lists the server's assets in the order of their names, and waits for the answer.
 *
 * Out:   assets: [count]; NULL and count 0 on failure.
 * Owns:  the caller frees them with umb_free.
 * Fails: as umb_client_query, except for the errors about points.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_list_assets(struct umb_client *client,
                                                           struct umb_client_asset **assets,
                                                           size_t *count, struct umb_error *error);

/*
 * Describes one asset.
 *
 * In:    asset: name or id. async: NULL: waits for the answer.
 * Out:   description: NULL on failure.
 * Owns:  the caller frees it with one umb_free, which frees its lights and texts too.
 * Fails: as umb_client_list_assets; E_ARGUMENT (asset empty, over 255 bytes or not UTF-8),
 *        E_NOT_FOUND.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_describe(struct umb_client *client,
                                                        const char *asset,
                                                        struct umb_client_description **description,
                                                        struct umb_client_async *async,
                                                        struct umb_error *error);

/*
 * Makes the server derive maps from an asset, and receives the KTX 2.0 file that umb_derived_ktx2
 * makes. A texel counts as a point in the server's limits and rates.
 *
 * In:    asset: name or id. settings: as for umb_derive; `cancelled` is ignored.
 * Out:   bytes: [size], NULL on failure. asset_id: id of the asset that answered.
 * Owns:  the caller frees bytes with umb_free.
 * Fails: as umb_client_describe, and as umb_derive on the server; E_TOO_LARGE (over
 *        max_reply_bytes).
 */
UMB_API UMB_CHECKED enum umb_status umb_client_derive(struct umb_client *client, const char *asset,
                                                      const struct umb_derive_settings *settings,
                                                      uint8_t **bytes, size_t *size,
                                                      uint8_t asset_id[UMB_ID_BYTES],
                                                      struct umb_client_async *async,
                                                      struct umb_error *error);

/* Limits of a server for one call; docs/reference/protocol.md has the full list. */
struct umb_client_limits {
    uint64_t max_points;        /* Points times lights; texels of derived maps */
    uint64_t max_message_bytes; /* Bytes of one message */
    uint64_t max_segments; /* Segments with up to 64 intervals each; 0: the server takes none */
    uint64_t max_columns;
    uint64_t max_boxes;
    uint64_t max_box_steps; /* Steps to count one box (umbrage/volume.h) */
    uint32_t max_targets;   /* Assets and lights of one query */
    uint32_t max_taps;
    char version[32];     /* Version of the server */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Asks for the server's limits and waits for the answer.
 *
 * Out:   limits: zeroed on failure.
 * Fails: as umb_client_list_assets.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_get_limits(struct umb_client *client,
                                                          struct umb_client_limits *limits,
                                                          struct umb_error *error);

/*
 * Asks the health service and waits for the answer.
 *
 * In:    service: "umbrage.v1.Shadows"; "" or NULL for the server as a whole.
 * Out:   serving: 1 if the answer is SERVING, else 0.
 * Fails: as umb_client_list_assets; E_NOT_FOUND (the server does not know the service).
 */
UMB_API UMB_CHECKED enum umb_status umb_client_health(struct umb_client *client,
                                                      const char *service, int *serving,
                                                      struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
