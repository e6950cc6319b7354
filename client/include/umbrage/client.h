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
 * A client owns one loop thread and a connection to each server it was given, opened at the first
 * call for it and again after it was lost. A connection on which a call met its deadline, or whose
 * server owes answers and is silent for keepalive_ms, is asked for a sign of life and given up
 * after connect_timeout_ms without one.
 *
 * Trying again: a call that the server has not begun goes on at once. All calls here only ask, so
 * one whose connection was lost, or that the server refused with UNAVAILABLE or "come again after",
 * is asked again after a pause, max_retries times at most, within its deadline, and not while most
 * calls fail. A server that was there and is gone (restarted) is waited for, connect_timeout_ms at
 * most; one that never was fails the call at once.
 *
 * Several servers: "tcp:a:7420,tcp:b:7420" are replicas with the same assets, 64 at most. Each
 * asset has its own order of them (rendezvous hashing), the same for every client: a call goes to
 * the first that can be reached, and a try to the next.
 * The asynchronous face returns at once and
 * calls back on the client's own thread; the blocking face is the asynchronous one and a wait. The
 * library never aborts, exits or prints.
 *
 * Addresses: "tcp:HOST:PORT" (HOST may be [::1]), "tls:HOST:PORT" and "unix:PATH".
 * TLS: 1.2 or 1.3; the server's certificate is always verified. A token is sent with every call,
 * over whatever address was given: in the clear on tcp:, so use tls: or a Unix socket.
 * Ownership: requests are copied before a call returns; a callback's reply and error are borrowed
 * during the callback.
 * Threads: every function may be called from any thread at once on one client, but for
 * umb_client_close. Blocking calls refuse to run in a callback (E_STATE): they would wait for
 * themselves. A callback that takes long delays all other calls of its client.
 * Trust: whatever a server sends is bounded and checked; a hostile one can only fail calls or lie.
 * Errors: what the server says keeps its meaning. RESOURCE_EXHAUSTED is E_BUSY if the server says
 * when to come again and E_TOO_LARGE if it does not (docs/decisions/0005-retry-pushback.md).
 * Limits: one connection to each server.
 * Caveat: a name is resolved by the system's resolver, which cannot be interrupted:
 * umb_client_close then waits for it.
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

/* As max_retries: a call is sent once and not again, unless the server said that it did not begin
 * it. For whoever measures, or tries again by himself. */
#define UMB_CLIENT_NEVER UINT32_MAX

struct umb_client_options {
    uint32_t connect_timeout_ms; /* until the server's first frame, or sign of life; 0 = 5000 */
    uint32_t call_timeout_ms;    /* 0 = 60000; sent as grpc-timeout */
    uint32_t stall_timeout_ms;   /* Wait of calls with many messages (fetch, submission) until the
                                    next one, and a second more in all for each KiB; 0 = 120000 */
    uint32_t keepalive_ms;       /* silence of a server that owes answers before it is asked for a
                                    sign of life; 0 = 10000 */
    uint32_t max_retries;        /* of a call, see above; 0 = 2; UMB_CLIENT_NEVER = none */
    uint32_t max_calls;          /* under way and waiting; 0 = 1024; further ones get E_BUSY */
    uint64_t max_request_bytes;  /* of those calls together; 0 = 256 MiB; likewise, but one call
                                    alone may have more */
    uint64_t max_reply_bytes;    /* of one reply; 0 = 64 MiB, at most 4 GiB */
    umb_log_fn log;              /* NULL = silent; called on the client's thread */
    void *log_user;
    /* Of tls: addresses alone: PEM files, read by umb_client_open and not again. */
    const char *ca_file;          /* authorities to trust; NULL = those of the system */
    const char *certificate_file; /* our chain, for mutual TLS; NULL = none */
    const char *key_file;         /* its private key, without a password; NULL = the same file */
    const char *server_name;      /* that the server's certificate must have; NULL = HOST */
    const char *token; /* bearer token: 1 to 4096 printable characters, no blanks; NULL = none */
    const char *token_file; /* or a file that holds it alone; a line's end behind it is cut off */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_query_request {
    const char *asset; /* name, or id in hexadecimal: 1 to 255 bytes of UTF-8 */
    struct umb_query_settings settings;
    /* Chooses taps and level, which must be 0, on the server; zeroed: nothing is chosen. budget_ns
     * is of one of the server's cores, calibrated there on points like these. */
    struct umb_dial dial;
    struct umb_points points; /* that they are finite is checked by the server alone */
    /* Instead of points, whose count and positions are then not looked at: a point for each pixel
     * (umbrage/picture.h). NULL: points. */
    const struct umb_picture *picture;
    int pack; /* 1: answers travel packed; they are unpacked here */
    /* With pack: answers to an earlier packed query of the same stream, as many bytes as this one's
     * have: a server that has them too sends only what changed. Copied. NULL: none. */
    const void *base;
    int want_stats;                   /* 0 or 1 */
    uint32_t timeout_ms;              /* 0 = the client's */
    struct umb_client_stream *stream; /* of the same client; NULL: a call of its own */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_query_reply {
    const void *values;             /* in settings.format, one a point, in their order */
    size_t value_bytes;             /* always umb_answer_bytes(format, count) */
    uint8_t asset_id[UMB_ID_BYTES]; /* the asset that answered */
    struct umb_query_stats stats;   /* if asked for, else 0 */
    uint64_t nanoseconds;           /* server CPU of the query, if asked for, else 0 */
    /* The setting that answered and what it gives, if stats are asked for; from a server that does
     * not say 0. The last two: 0 if the asset carries no accuracy curve. */
    uint32_t level, taps;
    double bound_m, visibility_error, lines;
    double expected_ns;    /* with a budget and stats: nanoseconds a point; else 0 */
    uint64_t packed_bytes; /* that the answers took on the wire, if they were packed, else 0 */
    int changes_only;      /* 1: they were packed against `base` */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_asset {
    char name[256]; /* UTF-8, NUL-terminated */
    uint8_t id[UMB_ID_BYTES];
    uint64_t packed_bytes; /* of its file */
    uint64_t memory_bytes; /* that queries read */
    uint32_t light_count;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_client_light {
    struct umb_light_info info; /* first_frustum and frustum_count are 0: not on the wire */
    uint64_t resolution;        /* voxels a side */
    double voxel_m[3];          /* metres a voxel along the frustum's x, y, z */
    int closed;                 /* baked under the closed rule */
    size_t curve_count;         /* rows; 0: the asset carries no curve, or the server tells none */
    struct umb_curve_row curve[UMB_CURVE_ROWS_MAX];
    /* Nanoseconds a point of a row on one of the server's cores, for points all over the scene and
     * for such as lie next to each other; 0 until a budget was asked of points of that kind. */
    double scattered_ns[UMB_CURVE_ROWS_MAX], coherent_ns[UMB_CURVE_ROWS_MAX];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Numbers are as the server sent them, not checked for being finite. */
struct umb_client_description {
    struct umb_client_asset asset;
    uint32_t light_count;
    struct umb_client_light *lights;  /* [light_count] */
    double origin[3];                 /* metres, world space */
    struct umb_box bounds;            /* metres, world space, of the casters */
    uint8_t scene_hash[UMB_ID_BYTES]; /* SHA-256 of the scene's content */
    char *plan, *settings;            /* UTF-8 */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Takes the end of a query.
 *
 * In:    status UMB_OK: reply is set and error NULL; else reply is NULL and error is set.
 * Owns:  both are borrowed during the call.
 * Threads: called exactly once for each started query, on the client's thread. May start calls.
 */
typedef void (*umb_client_query_fn)(void *user, enum umb_status status,
                                    const struct umb_client_query_reply *reply,
                                    const struct umb_error *error);

/* Takes the end of a call: error is NULL if status is UMB_OK, else borrowed during the call.
 * Threads: called exactly once for each started call, on the client's thread. May start calls. */
typedef void (*umb_client_done_fn)(void *user, enum umb_status status,
                                   const struct umb_error *error);

/*
 * How a call goes on by itself. Functions that take one return at once; NULL instead makes them
 * wait for the end.
 *
 * Memory that such a function writes to is the caller's, must stay until `done` is called, and is
 * written by then. What it only reads is copied, unless its description says otherwise. If the
 * function fails at once, `done` is not called.
 */
struct umb_client_async {
    umb_client_done_fn done;
    void *user;    /* First argument of `done` */
    uint64_t call; /* Out: the call's number, for umb_client_cancel */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Makes a client. Does not connect yet.
 *
 * In:    address: one, or several with commas between; copied. options: copied, strings too; NULL
 * for the defaults. Out:   out: the client, or NULL on failure. Owns:  the caller closes it with
 * umb_client_close. Fails: E_ARGUMENT (address, token, a file that cannot be used, files without a
 * tls: address), E_NO_INPUT, E_PERMISSION or E_IO (a file that cannot be read), E_NO_MEMORY,
 * E_INTERNAL (no lock, loop or thread to be had). Cost:  one thread with all signals blocked, about
 * 0.3 MiB.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_open(const char *address,
                                                    const struct umb_client_options *options,
                                                    struct umb_client **out,
                                                    struct umb_error *error);

/*
 * Cancels what is under way (its callbacks get E_CANCELLED), waits for the thread, frees the
 * client.
 *
 * In:    client: may be NULL.
 * Threads: nobody else may use the client, or begin to; never from a callback.
 */
UMB_API void umb_client_close(struct umb_client *client);

/*
 * Starts a query; its end comes to `done`.
 *
 * In:    request: copied whole, points included. user: handed to done.
 * Out:   call: the query's number, for umb_client_cancel; may be NULL.
 * Fails: at once, and then done is not called: E_ARGUMENT (what the server would refuse without
 *        looking at the points), E_TOO_LARGE (over 4 GiB of points), E_BUSY (max_calls),
 *        E_CANCELLED (closing), E_NO_MEMORY. To done: E_UNAVAILABLE (no connection, or lost),
 *        E_UNAUTHENTICATED (a certificate or token that is not accepted),
 *        E_DEADLINE, E_CANCELLED, E_TOO_LARGE (reply over max_reply_bytes), E_PROTOCOL (no proper
 *        gRPC), E_NO_MEMORY, and what the server said.
 * Cost:  one copy of the points.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_query_start(struct umb_client *client, const struct umb_client_query_request *request,
                       umb_client_query_fn done, void *user, uint64_t *call,
                       struct umb_error *error);

/*
 * Cancels a call by its number: its callback gets E_CANCELLED, soon, unless the call has ended by
 * then, and comes once in any case. The server is told, and gives up what it has not begun. Of a
 * stream, what else was sent and is not answered yet is asked again.
 *
 * In:    call: as umb_client_query_start or struct umb_client_async gave it. A number whose call
 *        has ended, and 0, cancel nothing: numbers are not used again.
 * Fails: E_NO_MEMORY: nothing was cancelled.
 * Threads: any, callbacks too.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_cancel(struct umb_client *client, uint64_t call,
                                                      struct umb_error *error);

/*
 * Asks and waits.
 *
 * Out:   values: answers in settings.format, umb_answer_bytes(format, count) bytes, not where
 *        request->base is; written on success only, or with pack without meaning on failure.
 *        reply: may be NULL; zeroed on failure; reply->values then points to values.
 * Fails: as umb_client_query_start, at once or later; E_STATE in a callback.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_query(struct umb_client *client, const struct umb_client_query_request *request,
                 void *values, struct umb_client_query_reply *reply, struct umb_error *error);

/*
 * Makes a stream: queries that name it are answered in the order in which they were started, at a
 * fraction of a call's cost. For whoever asks again and again, as a frame loop. Nothing is sent
 * before the first query; a stream that the server or the network ended is opened again by the
 * next one. A query that meets its deadline or is refused fails alone.
 *
 * Owns:  the caller closes it with umb_client_stream_close before it closes the client.
 * Fails: E_NO_MEMORY.
 * Threads: any; several may ask over one stream.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_stream_open(struct umb_client *client,
                                                           struct umb_client_stream **out,
                                                           struct umb_error *error);

/* Cancels what is under way on a stream (call-backs get E_CANCELLED, soon) and frees it. NULL is
 * allowed. Nobody else may use the stream; a call-back may close it. */
UMB_API void umb_client_stream_close(struct umb_client_stream *stream);

/*
 * Lists the server's assets, by name, and waits for the answer.
 *
 * Out:   assets: [count], NULL and 0 on failure.
 * Owns:  the caller frees them with umb_free.
 * Fails: as umb_client_query but for the points.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_list_assets(struct umb_client *client,
                                                           struct umb_client_asset **assets,
                                                           size_t *count, struct umb_error *error);

/*
 * Describes one asset.
 *
 * In:    asset: name or id. async: NULL: waits for the answer.
 * Out:   description: NULL on failure.
 * Owns:  the caller frees it and all it points to with umb_free.
 * Fails: as umb_client_list_assets; E_ARGUMENT (asset empty, over 255 bytes or not UTF-8),
 *        E_NOT_FOUND.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_describe(struct umb_client *client,
                                                        const char *asset,
                                                        struct umb_client_description **description,
                                                        struct umb_client_async *async,
                                                        struct umb_error *error);

/*
 * Has the server derive maps of an asset, and receives the KTX 2.0 file that umb_derived_ktx2
 * makes. A texel counts as a point in the server's limits and rates.
 *
 * In:    asset: name or id. settings: as umb_derive takes them; cancelled is not looked at.
 * Out:   bytes: [size], NULL on failure; asset_id: of the version that answered.
 * Owns:  the caller frees bytes with umb_free.
 * Fails: as umb_client_describe; what umb_derive fails with, as the server says it; E_TOO_LARGE
 *        (over max_reply_bytes).
 */
UMB_API UMB_CHECKED enum umb_status umb_client_derive(struct umb_client *client, const char *asset,
                                                      const struct umb_derive_settings *settings,
                                                      uint8_t **bytes, size_t *size,
                                                      uint8_t asset_id[UMB_ID_BYTES],
                                                      struct umb_client_async *async,
                                                      struct umb_error *error);

/* What a server takes in one call; docs/reference/protocol.md has all of it. */
struct umb_client_limits {
    uint64_t max_points; /* points times lights, texels of derived maps */
    uint64_t max_message_bytes;
    uint64_t max_segments; /* with up to 64 intervals each; 0: the server takes none */
    uint64_t max_columns;
    uint64_t max_boxes;
    uint64_t max_box_steps; /* of one box (umbrage/volume.h) */
    uint32_t max_targets;   /* assets and lights of one query */
    uint32_t max_taps;
    char version[32]; /* of the server */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Asks what the server takes and waits for the answer.
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
 * Out:   serving: 1 if it said SERVING, else 0.
 * Fails: as umb_client_list_assets; E_NOT_FOUND (a service it does not know).
 */
UMB_API UMB_CHECKED enum umb_status umb_client_health(struct umb_client *client,
                                                      const char *service, int *serving,
                                                      struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
