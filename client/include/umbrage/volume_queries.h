/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_VOLUME_QUERIES_H
#define UMBRAGE_VOLUME_QUERIES_H
/*
 * Volume queries (umbrage/volume.h) over a daemon: batches of segments, columns and boxes. The
 * answers equal those of umb_volume_segments, umb_volume_columns and umb_volume_boxes for the same
 * asset, bit for bit.
 *
 *     const struct umb_volume_query volume_query = {.asset = "city"};
 *     if (umb_client_columns(client, &volume_query, &points, &columns, &reply, NULL, &error)) {
 *         return error.status;
 *     }
 *
 * With async NULL the functions block until answered. Ownership, threads and retries are as in
 * umbrage/client.h.
 * Limits: umb_client_get_limits has the server's limits for one call. Against them a segment counts
 * as 64 points or as its intervals, a column as 1 point, a box as 256.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include "umbrage/client.h"
#include "umbrage/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_volume_query {
    const char *asset;    /* Name, or id in hexadecimal: 1 to 255 bytes of UTF-8 */
    uint32_t light;       /* Index of the light */
    uint32_t timeout_ms;  /* Deadline of this call; 0 = the client's */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_volume_query_reply {
    uint8_t asset_id[UMB_ID_BYTES]; /* Id of the asset that answered */
    struct umb_volume_stats stats;
    uint64_t nanoseconds;    /* CPU time on the server, nanoseconds */
    int ignores_translucent; /* Result of umb_volume_ignores_translucent for the light */
    uint64_t reserved[4];    /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Asks for the lit intervals of segments.
 *
 * In:    segments: only the server checks that they are finite.
 *        async: NULL: waits for the answer.
 * Out:   answers: as umb_volume_segments fills it for all segments; unspecified on failure.
 *        reply: may be NULL; zeroed on failure.
 * Fails: as umb_client_query; E_UNSUPPORTED (as umb_volume_prepare).
 * Threads: as umb_client_query.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_segments(struct umb_client *client, const struct umb_volume_query *volume_query,
                    const struct umb_segments *segments, struct umb_segment_answers *answers,
                    struct umb_volume_query_reply *reply, struct umb_client_async *async,
                    struct umb_error *error);

/* Asks for the first occluders of columns. The parameters of umb_client_segments apply. Out:
 * answers: as umb_volume_columns fills it. Fails also: E_UNSUPPORTED (as
 * umb_volume_check_columns). */
UMB_API UMB_CHECKED enum umb_status
umb_client_columns(struct umb_client *client, const struct umb_volume_query *volume_query,
                   const struct umb_points *points, struct umb_column_answers *answers,
                   struct umb_volume_query_reply *reply, struct umb_client_async *async,
                   struct umb_error *error);

/*
 * Counts the lit voxels of boxes. The parameters of umb_client_segments apply.
 *
 * In:    boxes: [count], min <= max on each axis, which only the server checks.
 * Out:   answers: as umb_volume_boxes fills it.
 * Fails also: E_TOO_LARGE (a box takes more steps
 *        than the server's max_box_steps).
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_boxes(struct umb_client *client, const struct umb_volume_query *volume_query,
                 const struct umb_box *boxes, size_t count, struct umb_box_answers *answers,
                 struct umb_volume_query_reply *reply, struct umb_client_async *async,
                 struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
