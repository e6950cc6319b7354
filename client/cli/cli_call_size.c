/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_call_size.h. */
#include "cli_call_size.h"

#include <inttypes.h>

/* Room for what a request has beside its records: a name, an origin, numbers. */
#define HEAD_BYTES 512

/* Bytes of a record in a request, at most. */
static size_t record_bytes(const struct umbc_query_options *options)
{
    const size_t scalar = options->format == UMBC_POINTS_F32 ? sizeof(float) : sizeof(double);
    switch (options->volume_query) {
    case UMBC_ASK_POINTS: /* lines of text may have normals, seen too late */
        return 3 * scalar +
               (options->with_normals || options->format == UMBC_POINTS_TEXT ? 3 * sizeof(float)
                                                                             : 0) +
               (options->footprints != NULL ? sizeof(float) : 0);
    case UMBC_ASK_COLUMNS:
        return 3 * scalar;
    default:
        return 6 * scalar;
    }
}

/* What the server takes of the records, and their name. */
static uint64_t taken(enum umbc_ask_kind volume_query, const struct umb_client_limits *limits,
                      const char **name)
{
    switch (volume_query) {
    case UMBC_ASK_POINTS:
        *name = "points";
        return limits->max_points > 0 ? limits->max_points : UINT64_MAX;
    case UMBC_ASK_SEGMENTS:
        *name = "segments";
        return limits->max_segments;
    case UMBC_ASK_COLUMNS:
        *name = "columns";
        return limits->max_columns;
    default:
        *name = "boxes";
        return limits->max_boxes;
    }
}

enum umb_status umbc_call_size(const struct umbc_query_options *options,
                               const struct umb_client_limits *limits, size_t *count,
                               struct umb_error *error)
{
    const char *name;
    const uint64_t takes = taken(options->volume_query, limits, &name);
    const uint64_t bytes = limits->max_message_bytes;
    const size_t record = record_bytes(options);
    if (takes == 0) {
        *count = 0;
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "the server takes no %s: max_%s is 0 (max_points is %" PRIu64 ")", name,
                        name, limits->max_points);
    }
    size_t most = takes < options->batch ? (size_t)takes : options->batch;
    if (bytes >= HEAD_BYTES + record && (bytes - HEAD_BYTES) / record < most) {
        most = (size_t)((bytes - HEAD_BYTES) / record);
    }
    *count = most;
    return UMB_OK;
}
