/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_VOLUME_QUERIES_H
#define UMBRAGE_WIRE_VOLUME_QUERIES_H
/*
 * The messages of umbrage.v1.Questions as plain structs. One codec serves the three volume queries,
 * because a field number has the same meaning in each of their messages.
 *
 * Decoded records and answers are pointers into the message, as in messages.h.
 * Trust: decoders are safe on hostile bytes.
 */
#include "wire/messages.h"

#define UMBW_PATH_SEGMENTS "/umbrage.v1.Questions/Segments"
#define UMBW_PATH_COLUMNS  "/umbrage.v1.Questions/Columns"
#define UMBW_PATH_BOXES    "/umbrage.v1.Questions/Boxes"

enum umbw_volume_query {
    UMBW_SEGMENTS,
    UMBW_COLUMNS,
    UMBW_BOXES,
    UMBW_VOLUME_QUERY_COUNT,
};

/* Answers in the form of a reply: an array for each field, in the order of the .proto file. */
#define UMBW_ANSWER_FIELDS 4

/* Number of bytes of one record's answer in each field; 0: the query has no such field. For
 * intervals: the bytes of one interval. */
extern const size_t umbw_answer_sizes[UMBW_VOLUME_QUERY_COUNT][UMBW_ANSWER_FIELDS];

#define UMBW_FIELD_INTERVALS 3 /* of segments */

struct umbw_volume_query_request {
    enum umbw_volume_query volume_query;
    char asset[UMBW_ASSET_NAME_MAX + 1];
    uint32_t light;
    const void *records; /* scalar[6 or 3 * count], any alignment */
    enum umb_point_format format;
    double origin[3];
    size_t count;
    uint32_t max_intervals; /* Most intervals of a segment that are sent */
    int want_stats;
    /* The records as the message stores them; the codec converts between these fields and
     * `records`. */
    struct umbw_records f32, f64;
};

struct umbw_volume_query_reply {
    enum umbw_volume_query volume_query;
    uint8_t asset_id[UMB_ID_BYTES];
    int ignores_translucent;
    int has_stats;
    uint64_t nodes, bricks, nanoseconds;
    size_t count;                              /* Number of records */
    const uint8_t *fields[UMBW_ANSWER_FIELDS]; /* little-endian, any alignment */
    size_t sizes[UMBW_ANSWER_FIELDS];          /* Bytes of each; for the codec */
    size_t interval_count;                     /* Number of intervals, in the last field of
                                                  segments */
};

/* Returns the points that one record of a request counts as. */
uint64_t umbw_volume_query_points(enum umbw_volume_query volume_query, uint32_t max_intervals);

/*
 * Decodes a request. umb_segments_check and its siblings check later that the records are finite.
 *
 * Fails: E_ARGUMENT (another message, a wrong length, an origin that is not finite; the error names
 *        the field), E_TOO_LARGE (more than max_points).
 */
UMB_CHECKED enum umb_status umbw_decode_volume_query_request(
    enum umbw_volume_query volume_query, const uint8_t *message, size_t size, uint64_t max_points,
    struct umbw_volume_query_request *request, struct umb_error *error);

/* Decodes a reply to a request of `count` records. Fails: E_ARGUMENT (not the message, or another
 * number of answers). */
UMB_CHECKED enum umb_status umbw_decode_volume_query_reply(enum umbw_volume_query volume_query,
                                                           const uint8_t *message, size_t size,
                                                           size_t count,
                                                           struct umbw_volume_query_reply *reply,
                                                           struct umb_error *error);

/* Appends the prefix and a message. Fails: E_ARGUMENT (asset, origin), E_TOO_LARGE (over 4 GiB),
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status
umbw_encode_volume_query_request(const struct umbw_volume_query_request *request,
                                 struct umbw_buffer *buffer, struct umb_error *error);
UMB_CHECKED enum umb_status
umbw_encode_volume_query_reply(const struct umbw_volume_query_reply *reply,
                               struct umbw_buffer *buffer, struct umb_error *error);

#endif
