/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_MESSAGES_H
#define UMBRAGE_WIRE_MESSAGES_H
/*
 * The messages of umbrage.v1 as plain structs, and their codecs. No I/O. Only this library sees
 * protobuf-c.
 *
 * Reading in place: the large byte fields (points, normals, visibility) are never copied. Decoding
 * scans the top level of the message, takes pointers to them into the caller's buffer, and gives
 * only the small rest to protobuf-c. The caller keeps the buffer alive as long as the struct.
 *
 * Encoding: writes into a caller's umbw_buffer (growing, one allocation), after room reserved for
 * the 5-byte gRPC prefix if asked.
 *
 * Trust: decoders are safe on hostile bytes; every limit is checked here and named in the error.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/curve.h"
#include "umbrage/picture.h"
#include "umbrage/query.h"

#define UMBW_PATH_QUERY     "/umbrage.v1.Shadows/Query"
#define UMBW_PATH_STREAM    "/umbrage.v1.Shadows/QueryStream"
#define UMBW_PATH_DESCRIBE  "/umbrage.v1.Shadows/Describe"
#define UMBW_PATH_LIST      "/umbrage.v1.Shadows/List"
#define UMBW_PATH_LIMITS    "/umbrage.v1.Shadows/Limits"
#define UMBW_PATH_CHECK     "/grpc.health.v1.Health/Check"
#define UMBW_PATH_WATCH     "/grpc.health.v1.Health/Watch"
#define UMBW_PREFIX_BYTES   5 /* compressed flag and big-endian length before each message */
#define UMBW_ASSET_NAME_MAX 255
#define UMBW_TARGETS_MAX    64 /* of one request */

/* A growing byte buffer; zero it before use, umbw_buffer_finish frees it. */
struct umbw_buffer {
    uint8_t *bytes;
    size_t size, capacity;
};
void umbw_buffer_finish(struct umbw_buffer *buffer);

struct umbw_query_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    struct umb_query_settings settings;
    struct umb_points points; /* positions and normals point into the message */
    int has_picture; /* then the points are its pixels: positions is NULL when encoding, and its
                        depth when decoded */
    struct umb_picture picture;
    int pack;
    uint64_t base_mark; /* of answers the client has; 0 = none */
    int want_stats;
    struct umb_dial dial; /* if it wants anything, taps and level are 0 */
    /* Decoded only: targets that stand for asset and light, then empty and 0. */
    size_t target_count;
    const uint8_t *targets_at, *targets_end; /* where umbw_query_target_next goes on */
};

/* One light of one asset. */
struct umbw_query_target {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    uint32_t light;
};

/* As in the .proto file. */
enum umbw_packing {
    UMBW_PACKING_PLAIN = 0,
    UMBW_PACKING_ZSTD = 1,
    UMBW_PACKING_CHANGES = 2,
};

struct umbw_query_reply {
    const uint8_t *visibility; /* into the message */
    size_t visibility_bytes;
    uint8_t asset_id[UMB_ID_BYTES]; /* with targets: of the first */
    const uint8_t *asset_ids; /* encoder: uint8[asset_id_count * UMB_ID_BYTES], with targets */
    size_t asset_id_count;    /* 0 = no targets */
    struct umb_query_stats stats;
    uint64_t nanoseconds;
    double voxel_m;
    /* What answered, as in the message; with stats. */
    uint32_t level, taps;
    double bound_m, visibility_error, lines, expected_ns;
    int has_stats;
    enum umbw_packing packing; /* of visibility */
};

/* What a server takes. */
struct umbw_limits {
    uint64_t max_points, max_message_bytes;
    uint32_t max_targets, max_taps, max_streams, queue;
    char version[32];
    int takes_gzip; /* beside identity */
    /* Of jobs; 0 = none are taken. */
    uint64_t max_bundle_bytes;
    uint32_t max_bundle_files, max_owner_jobs;
    /* Of volume queries (volume_queries.h); 0 = none are taken. */
    uint64_t max_segments, max_columns, max_boxes, max_box_steps;
};

struct umbw_asset_summary {
    char name[UMBW_ASSET_NAME_MAX + 1];
    uint8_t id[UMB_ID_BYTES];
    uint64_t packed_bytes, memory_bytes;
    uint32_t light_count;
};

/* A light's accuracy curve, and what its rows cost on the server; 0 where that is not known. */
struct umbw_curve {
    size_t count;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    double scattered_ns[UMB_CURVE_ROWS_MAX], coherent_ns[UMB_CURVE_ROWS_MAX];
};

struct umbw_light {
    struct umb_light_info info;
    uint64_t resolution;
    double voxel_m[3];
    int closed;
    struct umbw_curve curve; /* only if asked for */
};

struct umbw_describe_reply {
    struct umbw_asset_summary summary;
    uint32_t light_count;
    struct umbw_light *lights; /* malloc, owned when decoded */
    double origin[3];
    struct umb_box bounds;
    char *plan, *settings; /* malloc, owned when decoded */
    uint8_t scene_hash[UMB_ID_BYTES];
};
void umbw_describe_reply_finish(struct umbw_describe_reply *reply);

struct umbw_list_reply {
    size_t count;
    struct umbw_asset_summary *assets; /* malloc, owned when decoded */
};
void umbw_list_reply_finish(struct umbw_list_reply *reply);

/*
 * Decoders. In: message: uint8[size] without the 5-byte prefix.
 * Fails: E_ARGUMENT (not a valid message, a field out of its range: the field is named),
 *        E_TOO_LARGE (max_points), E_NO_MEMORY. Finiteness is checked later by umb_points_check.
 */
UMB_CHECKED enum umb_status umbw_decode_query_request(const uint8_t *message, size_t size,
                                                      size_t max_points,
                                                      struct umbw_query_request *request,
                                                      struct umb_error *error);

/* Takes the next target of a decoded request; call it target_count times, the message still there.
 * Fails: E_ARGUMENT, naming the field. Cost: all calls together look at the message once. */
UMB_CHECKED enum umb_status umbw_query_target_next(struct umbw_query_request *request,
                                                   struct umbw_query_target *target,
                                                   struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_query_reply(const uint8_t *message, size_t size,
                                                    struct umbw_query_reply *reply,
                                                    struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_describe_request(const uint8_t *message, size_t size,
                                                         char asset[UMBW_ASSET_NAME_MAX + 1],
                                                         int *want_curves, struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_describe_reply(const uint8_t *message, size_t size,
                                                       struct umbw_describe_reply *reply,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_list_reply(const uint8_t *message, size_t size,
                                                   struct umbw_list_reply *reply,
                                                   struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_limits_reply(const uint8_t *message, size_t size,
                                                     struct umbw_limits *limits,
                                                     struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_health_request(const uint8_t *message, size_t size,
                                                       char service[256], struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_health_reply(const uint8_t *message, size_t size,
                                                     int *serving_status, struct umb_error *error);

/*
 * Encoders: append prefix and message to buffer. Fails: E_NO_MEMORY, E_TOO_LARGE (over 4 GiB).
 *
 * umbw_encode_query_request writes the whole message, points and normals copied once. The query
 * reply's `visibility` comes last on the wire and is sent by the caller from where it lies: the
 * encoder writes everything before it, with both lengths already counting it.
 */
UMB_CHECKED enum umb_status umbw_encode_query_request(const struct umbw_query_request *request,
                                                      struct umbw_buffer *buffer,
                                                      struct umb_error *error);
/* Writes all of the reply but the `visibility_bytes` bytes that must follow. */
UMB_CHECKED enum umb_status umbw_encode_query_reply_head(const struct umbw_query_reply *reply,
                                                         struct umbw_buffer *buffer,
                                                         struct umb_error *error);
/* The same into uint8[room]; room: at least umbw_query_reply_room(reply). Returns the bytes. */
size_t umbw_write_query_reply_head(const struct umbw_query_reply *reply, uint8_t *bytes);

/* Bytes that the head of a reply takes: exactly, or with stats at most. Only the sizes, counts and
 * has_stats of the reply are looked at. */
size_t umbw_query_reply_room(const struct umbw_query_reply *reply);
UMB_CHECKED enum umb_status umbw_encode_describe_request(const char *asset, int want_curves,
                                                         struct umbw_buffer *buffer,
                                                         struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_describe_reply(const struct umbw_describe_reply *reply,
                                                       struct umbw_buffer *buffer,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_list_request(struct umbw_buffer *buffer,
                                                     struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_list_reply(const struct umbw_list_reply *reply,
                                                   struct umbw_buffer *buffer,
                                                   struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_limits_reply(const struct umbw_limits *limits,
                                                     struct umbw_buffer *buffer,
                                                     struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_health_request(const char *service,
                                                       struct umbw_buffer *buffer,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_health_reply(int serving_status, struct umbw_buffer *buffer,
                                                     struct umb_error *error);

#endif
