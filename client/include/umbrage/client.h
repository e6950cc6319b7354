/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLIENT_H
#define UMBRAGE_CLIENT_H
/*
 * libumbrage: asking a daemon over gRPC.
 *
 *     struct umb_client *client;
 *     umb_client_open("tcp:127.0.0.1:7420", NULL, &client, &error);
 *     umb_client_query(client, &request, &reply, &error);      blocks until answered or timed out
 *     umb_client_close(client);
 *
 * A client owns one loop thread and one connection, which it opens at the first call and again
 * after it was lost. Calls may be made from any thread at once; they share the connection. The
 * asynchronous face returns at once and calls back on the client's own thread; the blocking face
 * is the asynchronous one and a wait. The library never aborts, exits or prints.
 *
 * Addresses: "tcp:HOST:PORT" (HOST may be [::1]) and "unix:PATH".
 * Ownership: requests are copied before a call returns; a callback's reply is borrowed during the
 * callback. umb_client_close cancels what is under way (callbacks get E_CANCELLED) and waits for
 * the thread; it must not be called from a callback.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/log.h"
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_client; /* opaque */

struct umb_client_options {
    uint32_t connect_timeout_ms; /* 0 = 5000 */
    uint32_t call_timeout_ms;    /* 0 = 60000; sent as grpc-timeout */
    uint32_t max_calls;          /* under way and waiting; 0 = 1024; further ones get E_BUSY */
    uint64_t max_reply_bytes;    /* 0 = 64 MiB */
    umb_log_fn log;              /* NULL = silent */
    void *log_user;
};

struct umb_client_query_request {
    const char *asset; /* name or id */
    struct umb_query_settings settings;
    struct umb_points points;
    int want_stats;
    uint32_t timeout_ms; /* 0 = the client's */
};

struct umb_client_query_reply {
    const void *values; /* in settings.format */
    size_t value_bytes;
    uint8_t asset_id[UMB_ID_BYTES]; /* the asset that answered */
    struct umb_query_stats stats;   /* if asked for */
    uint64_t nanoseconds;           /* server CPU of the query, if asked for */
};

struct umb_client_asset {
    char name[256];
    uint8_t id[UMB_ID_BYTES];
    uint64_t packed_bytes, memory_bytes;
    uint32_t light_count;
};

struct umb_client_light {
    struct umb_light_info info;
    uint64_t resolution; /* voxels a side */
    double voxel_m[3];   /* metres a voxel along the frustum's x, y, z */
    int closed;
};

struct umb_client_description {
    struct umb_client_asset asset;
    uint32_t light_count;
    struct umb_client_light *lights;
    double origin[3];
    struct umb_box bounds;
    uint8_t scene_hash[UMB_ID_BYTES];
    char *plan, *settings;
};

/* status UMB_OK: reply is set; else error is. Called once, on the client's thread. */
typedef void (*umb_client_query_fn)(void *user, enum umb_status status,
                                    const struct umb_client_query_reply *reply,
                                    const struct umb_error *error);

/* Fails: E_ARGUMENT (address), E_NO_MEMORY, E_INTERNAL (thread). Does not connect yet. */
UMB_API UMB_CHECKED enum umb_status umb_client_open(const char *address,
                                                    const struct umb_client_options *options,
                                                    struct umb_client **out,
                                                    struct umb_error *error);
UMB_API void umb_client_close(struct umb_client *client);

/* Starts a query. Fails at once: E_BUSY, E_ARGUMENT, E_NO_MEMORY; else the callback comes. */
UMB_API UMB_CHECKED enum umb_status
umb_client_query_start(struct umb_client *client, const struct umb_client_query_request *request,
                       umb_client_query_fn done, void *user, struct umb_error *error);

/*
 * Asks and waits.
 *
 * Out:   values: answers in settings.format, umb_answer_bytes(format, count) bytes, caller's.
 *        reply: may be NULL; reply->values then points to values.
 * Fails: E_UNAVAILABLE (no connection), E_DEADLINE, and what the server said.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_query(struct umb_client *client, const struct umb_client_query_request *request,
                 void *values, struct umb_client_query_reply *reply, struct umb_error *error);

/* Lists the server's assets; free with umb_client_assets_free. */
UMB_API UMB_CHECKED enum umb_status umb_client_list(struct umb_client *client,
                                                    struct umb_client_asset **assets, size_t *count,
                                                    struct umb_error *error);
UMB_API void umb_client_assets_free(struct umb_client_asset *assets);

/* Describes one asset; free with umb_client_description_free. */
UMB_API UMB_CHECKED enum umb_status umb_client_describe(struct umb_client *client,
                                                        const char *asset,
                                                        struct umb_client_description **description,
                                                        struct umb_error *error);
UMB_API void umb_client_description_free(struct umb_client_description *description);

/* Asks the health service; *serving is 1 if it said SERVING. */
UMB_API UMB_CHECKED enum umb_status umb_client_health(struct umb_client *client,
                                                      const char *service, int *serving,
                                                      struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
