/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_MESSAGES_H
#define UMBRAGE_WIRE_MESSAGES_H
/*
 * The messages of umbrage.v1.Shadows and of the health service as plain structs, and their codecs.
 * If the public API has a struct for a message, the codec uses that struct. There is no I/O. Only
 * this library uses protobuf-c; codec.h describes the tables of the codecs.
 *
 * Reading in place: the large byte fields (points, normals, visibility) are never copied. The
 * decoder stores pointers to them, so the message must live as long as the struct.
 *
 * Encoding appends the 5-byte prefix of gRPC and the message to the caller's umbw_buffer, which
 * grows as one allocation.
 *
 * Trust: decoders are safe on hostile bytes; every limit is checked here and named in the error.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/client.h"
#include "umbrage/sample.h"

#define UMBW_PATH_QUERY    "/umbrage.v1.Shadows/Query"
#define UMBW_PATH_STREAM   "/umbrage.v1.Shadows/QueryStream"
#define UMBW_PATH_DESCRIBE "/umbrage.v1.Shadows/Describe"
#define UMBW_PATH_LIST     "/umbrage.v1.Shadows/List"
#define UMBW_PATH_LIMITS   "/umbrage.v1.Shadows/Limits"
#define UMBW_PATH_SAMPLE   "/umbrage.v1.Shadows/Sample"
#define UMBW_PATH_CHECK    "/grpc.health.v1.Health/Check"
#define UMBW_PATH_WATCH    "/grpc.health.v1.Health/Watch"
/* grpc.reflection.v1 and v1alpha, whose messages have the same bytes. */
#define UMBW_PATH_REFLECTION       "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo"
#define UMBW_PATH_REFLECTION_ALPHA "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"

#define UMBW_PREFIX_BYTES       5 /* compressed flag and big-endian length before each message */
#define UMBW_ASSET_NAME_MAX     255
#define UMBW_TARGETS_MAX        64    /* Most targets of one request */
#define UMBW_LIST_MAX           65536 /* Most assets in one reply: a larger store needs paging */
#define UMBW_SAMPLE_POINT_BYTES (3 * sizeof(double))

/* A growing byte buffer; zero it before use, umbw_buffer_finish frees it. */
struct umbw_buffer {
    uint8_t *bytes;
    size_t size, capacity;
};
void umbw_buffer_finish(struct umbw_buffer *buffer);

/* Makes room for `count` more bytes after buffer->size. The caller writes the bytes and increases
 * size. Fails: E_NO_MEMORY; the buffer is unchanged. */
UMB_CHECKED enum umb_status umbw_buffer_reserve(struct umbw_buffer *buffer, size_t count,
                                                struct umb_error *error);

/* Appends the prefix of a message of `message_size` bytes, and makes room for the message's first
 * `room` bytes. Fails: E_TOO_LARGE (over 4 GiB), E_NO_MEMORY; the buffer is unchanged. */
UMB_CHECKED enum umb_status umbw_buffer_begin_message(struct umbw_buffer *buffer,
                                                      uint64_t message_size, size_t room,
                                                      struct umb_error *error);

/* Writes the prefix of a message of `message_size` bytes. */
void umbw_prefix_write(uint64_t message_size, uint8_t bytes[UMBW_PREFIX_BYTES]);

/*
 * Declares umbw_decode_NAME and umbw_encode_NAME of a message (codec.h).
 *
 * Decoder: message: uint8[size] without the prefix. Out: out: zeros on failure. Fails: E_ARGUMENT
 * (another message, or a field out of its range, which the error names), E_TOO_LARGE, E_NO_MEMORY.
 *
 * Encoder: appends the prefix and the message. Fails: E_ARGUMENT (a field out of its range),
 * E_TOO_LARGE, E_NO_MEMORY.
 */
#define UMBW_MESSAGE(name, type)                                                                   \
    UMB_CHECKED enum umb_status umbw_decode_##name(const uint8_t *message, size_t size, type *out, \
                                                   struct umb_error *error);                       \
    UMB_CHECKED enum umb_status umbw_encode_##name(const type *in, struct umbw_buffer *buffer,     \
                                                   struct umb_error *error)

/* Records within a message, each of a length that the field has. */
struct umbw_records {
    const void *at;
    size_t count;
};

struct umbw_query_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    struct umb_query_settings settings;
    struct umb_points points; /* positions and normals point into the message */
    int has_picture;          /* Kind of points: 1 = a picture's pixels. Then positions is NULL when
                        encoding, and the picture's depth after decoding */
    struct umb_picture picture;
    int pack;
    uint64_t base_mark; /* Mark of answers that the client has; 0 = none */
    int want_stats;
    struct umb_dial dial; /* Dial; if it requires anything, taps and level are 0 */
    /* Targets of a decoded request, in place of asset and light, which are then empty and 0. */
    size_t target_count;
    const uint8_t *targets_at, *targets_end; /* Place where umbw_query_target_next continues */
    /* The points as the message stores them; the codec converts between these fields and
     * `points`. */
    struct umbw_records f32, f64, depth;
    struct umbw_records normals, footprints; /* One byte each */
    size_t eye_count;                        /* Numbers of settings.eye: 3 or 0 */
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
    uint8_t asset_id[UMB_ID_BYTES]; /* Id of the asset; decoded with targets: one of them */
    const uint8_t *asset_ids;       /* Encoded only: uint8[asset_id_count * UMB_ID_BYTES] */
    size_t asset_id_count;          /* Number of targets; 0: a request without them */
    struct umb_query_stats stats;
    uint64_t nanoseconds;
    double voxel_m;
    /* The settings that answered, as in the message; with stats. */
    uint32_t level, taps;
    double bound_m, visibility_error, lines, expected_ns;
    int has_stats;
    int has_asset_id;          /* 0; for the codec */
    enum umbw_packing packing; /* Packing of visibility */
};

/* Limits of a server: those that the public API shows, and the others. */
struct umbw_limits {
    struct umb_client_limits client;
    uint32_t max_streams, queue;
    /* Encodings of request messages. Encoded only. */
    const char *const *encodings;
    size_t encoding_count;
    /* Limits of jobs; 0 = the server takes none. */
    uint64_t max_bundle_bytes;
    uint32_t max_bundle_files, max_owner_jobs;
};

struct umbw_describe_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    int want_curves;
};

struct umbw_list_reply {
    size_t count;
    struct umb_client_asset *assets; /* [count]; decoded: free() them */
};

struct umbw_sample_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    struct umb_sample_settings settings;
};

struct umbw_sample_reply {
    struct umb_sample sample; /* Sample of sample.count points */
    const uint8_t *points;    /* double[3 * sample.count], any alignment */
};

UMBW_MESSAGE(describe_request, struct umbw_describe_request);
UMBW_MESSAGE(list_reply, struct umbw_list_reply);
UMBW_MESSAGE(limits_reply, struct umbw_limits);
/* The codecs of both check the ranges of count and scattered. */
UMBW_MESSAGE(sample_request, struct umbw_sample_request);
UMBW_MESSAGE(sample_reply, struct umbw_sample_reply);
UMBW_MESSAGE(health_request, char); /* char[256], the name of a service */
UMBW_MESSAGE(health_reply, int);    /* ServingStatus of the .proto file */

/* Decodes a description. Out: out: free() it; its lights and texts are in the same block. Fails: as
 * the decoders of UMBW_MESSAGE. */
UMB_CHECKED enum umb_status umbw_decode_describe_reply(const uint8_t *message, size_t size,
                                                       struct umb_client_description **out,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_describe_reply(const struct umb_client_description *in,
                                                       struct umbw_buffer *buffer,
                                                       struct umb_error *error);

/* Appends a message without fields: ListRequest, LimitsRequest, DeleteReply. */
UMB_CHECKED enum umb_status umbw_encode_empty(struct umbw_buffer *buffer, struct umb_error *error);

/* Decodes a QueryRequest. Fails: as the decoders of UMBW_MESSAGE; E_TOO_LARGE (more than
 * max_points). Coordinates that are not finite are not detected here but by umb_points_check. */
UMB_CHECKED enum umb_status umbw_decode_query_request(const uint8_t *message, size_t size,
                                                      size_t max_points,
                                                      struct umbw_query_request *request,
                                                      struct umb_error *error);

/* Decodes the next target of a decoded request. Call it target_count times while the message
 * exists. Fails: E_ARGUMENT, naming the field. Cost: all calls together read the message once. */
UMB_CHECKED enum umb_status umbw_query_target_next(struct umbw_query_request *request,
                                                   struct umbw_query_target *target,
                                                   struct umb_error *error);

/* Appends the prefix and a QueryRequest, with the decoder's checks; points and normals are copied
 * once. */
UMB_CHECKED enum umb_status umbw_encode_query_request(const struct umbw_query_request *request,
                                                      struct umbw_buffer *buffer,
                                                      struct umb_error *error);

UMB_CHECKED enum umb_status umbw_decode_query_reply(const uint8_t *message, size_t size,
                                                    struct umbw_query_reply *reply,
                                                    struct umb_error *error);

/* Writes the start of a reply, the prefix and the message up to `visibility`, its last field, into
 * uint8[room]; room: at least umbw_query_reply_room(reply). The caller sends the answers from their
 * own memory; all lengths already include them. Returns the number of bytes written. */
size_t umbw_write_query_reply_head(const struct umbw_query_reply *reply, uint8_t *bytes);

/* Returns the number of bytes of a reply's start: exact without stats, an upper bound with stats.
 * Reads only the sizes, the counts, has_stats and packing of the reply. */
size_t umbw_query_reply_room(const struct umbw_query_reply *reply);

/* Descriptors of the .proto files: a google.protobuf.FileDescriptorSet made by the build. */
extern const uint8_t umbw__descriptor_set[];
extern const size_t umbw__descriptor_set_bytes;

/*
 * Answers one ServerReflectionRequest: appends prefix and message to buffer. A missing symbol or
 * file is an error within the answer, as the protocol requires.
 *
 * Fails: E_ARGUMENT (not such a message), E_TOO_LARGE, E_NO_MEMORY. Trust: safe on hostile bytes.
 * Cost:  one walk over the descriptors, some 10 kB.
 */
UMB_CHECKED enum umb_status umbw_reflection_answer(const uint8_t *message, size_t size,
                                                   struct umbw_buffer *buffer,
                                                   struct umb_error *error);

#endif
