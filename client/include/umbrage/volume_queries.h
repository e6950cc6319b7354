/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_VOLUME_QUERIES_H
#define UMBRAGE_VOLUME_QUERIES_H
/*
 * The volume queries of umbrage/volume.h, asked of a daemon: segments, columns and boxes in
 * batches. The answers are those that umb_volume_segments and its like give for the same asset,
 * bit for bit.
 *
 *     const struct umb_volume_query volume_query = {.asset = "city"};
 *     if (umb_client_columns(client, &volume_query, &points, &columns, &reply, NULL, &error)) {
 *         return error.status;
 *     }
 *
 * With async NULL they block until answered. All are tried again as umb_client_query is. What the
 * server takes in one call: Limits (docs/reference/protocol.md). A segment counts as 64 points or
 * as its intervals, a column as 1, a box as 256.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include "umbrage/client.h"
#include "umbrage/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_volume_query {
    const char *asset;   /* name, or id in hexadecimal: 1 to 255 bytes of UTF-8 */
    uint32_t light;      /* index */
    uint32_t timeout_ms; /* 0 = the client's */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_volume_query_reply {
    uint8_t asset_id[UMB_ID_BYTES]; /* the asset that answered */
    struct umb_volume_stats stats;
    uint64_t nanoseconds;    /* CPU time on the server */
    int ignores_translucent; /* as umb_volume_ignores_translucent */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Asks for the lit intervals of segments.
 *
 * In:    segments: that they are finite is checked by the server alone.
 *        async: NULL: waits for the answer.
 * Out:   answers: as umb_volume_segments fills it for all segments; unspecified on failure.
 *        reply: may be NULL; zeroed on failure.
 * Fails: as umb_client_query; E_UNSUPPORTED (a light that cannot be asked).
 * Threads: as umb_client_query.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_segments(struct umb_client *client, const struct umb_volume_query *volume_query,
                    const struct umb_segments *segments, struct umb_segment_answers *answers,
                    struct umb_volume_query_reply *reply, struct umb_client_async *async,
                    struct umb_error *error);

/* Asks for the first occluders of columns; likewise. Out: as umb_volume_columns fills it. */
UMB_API UMB_CHECKED enum umb_status
umb_client_columns(struct umb_client *client, const struct umb_volume_query *volume_query,
                   const struct umb_points *points, struct umb_column_answers *answers,
                   struct umb_volume_query_reply *reply, struct umb_client_async *async,
                   struct umb_error *error);

/* Counts the lit voxels of boxes; likewise. In: boxes: [count], min <= max on each axis, which only
 * the server checks. Out: answers: as umb_volume_boxes fills it. Fails too: E_TOO_LARGE (a box
 * whose counting takes the server too many steps). */
UMB_API UMB_CHECKED enum umb_status
umb_client_boxes(struct umb_client *client, const struct umb_volume_query *volume_query,
                 const struct umb_box *boxes, size_t count, struct umb_box_answers *answers,
                 struct umb_volume_query_reply *reply, struct umb_client_async *async,
                 struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
