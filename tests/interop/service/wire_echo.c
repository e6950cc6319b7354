/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Decodes messages and encodes what it decoded, for tests/interop/test_wire.py.
 *
 *     wire_echo --list     prints the kinds of messages, one a line
 *     wire_echo            reads records: kind (uint8), length (uint32), message; writes for each:
 *                          status (uint8: 0 = decoded, 1 = refused, 2 = not to be encoded),
 *                          length (uint32), message
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "wire/bakes.h"
#include "wire/regions.h"
#include "wire/versions.h"
#include "wire/messages.h"
#include "wire/volume_queries.h"

#define MESSAGE_MAX ((size_t)1 << 20)
#define COUNT_MAX   16 /* Most records of a reply's volume query */

enum answer {
    DECODED,
    REFUSED,
    NOT_ENCODED,
};

static enum answer must(enum umb_status status)
{
    if (status != UMB_OK) {
        abort(); /* a message that was decoded can be encoded */
    }
    return DECODED;
}

/* A function for a message whose struct needs nothing else; `block` is freed. */
#define ECHO(name, type, block)                                                                    \
    static enum answer echo_##name(const uint8_t *message, size_t size, struct umbw_buffer *out)   \
    {                                                                                              \
        type value;                                                                                \
        if (umbw_decode_##name(message, size, &value, NULL) != UMB_OK) {                           \
            return REFUSED;                                                                        \
        }                                                                                          \
        const enum answer answer = must(umbw_encode_##name(&value, out, NULL));                    \
        free((void *)(uintptr_t)(block));                                                          \
        return answer;                                                                             \
    }

typedef struct {
    char at[256];
} text;

ECHO(describe_request, struct umbw_describe_request, NULL)
ECHO(list_reply, struct umbw_list_reply, value.assets)
ECHO(limits_reply, struct umbw_limits, NULL)
ECHO(health_reply, int, NULL)
ECHO(submit_request, struct umbw_submit_request, value.manifest.scene)
ECHO(submit_reply, struct umb_job_submitted, NULL)
ECHO(job_status, struct umb_job_status, value.plan)
ECHO(list_jobs_request, uint32_t, NULL)
ECHO(job_list, struct umbw_job_list, value.jobs)
ECHO(fetch_request, struct umbw_fetch_request, NULL)
ECHO(fetch_reply, struct umbw_fetch_reply, NULL)
ECHO(region_request, struct umbw_region_request, NULL)
ECHO(region_reply, struct umbw_region_reply, NULL)
ECHO(version_request, struct umbw_version_request, NULL)
ECHO(derive_request, struct umbw_derive_request, NULL)
ECHO(sample_request, struct umbw_sample_request, NULL)
ECHO(sample_reply, struct umbw_sample_reply, NULL)

#define ECHO_TEXT(name)                                                                            \
    static enum answer echo_##name(const uint8_t *message, size_t size, struct umbw_buffer *out)   \
    {                                                                                              \
        text value;                                                                                \
        return umbw_decode_##name(message, size, value.at, NULL) == UMB_OK                         \
                   ? must(umbw_encode_##name(value.at, out, NULL))                                 \
                   : REFUSED;                                                                      \
    }

ECHO_TEXT(health_request)
ECHO_TEXT(job_request)
ECHO_TEXT(delete_request)

static enum answer echo_describe_reply(const uint8_t *message, size_t size, struct umbw_buffer *out)
{
    struct umb_client_description *value;
    if (umbw_decode_describe_reply(message, size, &value, NULL) != UMB_OK) {
        return REFUSED;
    }
    const enum answer answer = must(umbw_encode_describe_reply(value, out, NULL));
    free(value);
    return answer;
}

static enum answer echo_query_request(const uint8_t *message, size_t size, struct umbw_buffer *out)
{
    struct umbw_query_request value;
    struct umbw_query_target target;
    if (umbw_decode_query_request(message, size, MESSAGE_MAX, &value, NULL) != UMB_OK) {
        return REFUSED;
    }
    for (size_t i = 0; i < value.target_count; i++) {
        (void)!umbw_query_target_next(&value, &target, NULL);
    }
    return value.target_count > 0 ? NOT_ENCODED
                                  : must(umbw_encode_query_request(&value, out, NULL));
}

static enum answer echo_query_reply(const uint8_t *message, size_t size, struct umbw_buffer *out)
{
    struct umbw_query_reply value;
    if (umbw_decode_query_reply(message, size, &value, NULL) != UMB_OK) {
        return REFUSED;
    }
    if (value.asset_id_count > 0) {
        return NOT_ENCODED;
    }
    const size_t room = umbw_query_reply_room(&value);
    (void)must(umbw_buffer_reserve(out, room + value.visibility_bytes, NULL));
    out->size += umbw_write_query_reply_head(&value, out->bytes);
    if (value.visibility_bytes > 0) {
        memcpy(out->bytes + out->size, value.visibility, value.visibility_bytes);
    }
    out->size += value.visibility_bytes;
    return DECODED;
}

static enum answer echo_volume_request(enum umbw_volume_query kind, const uint8_t *message,
                                       size_t size, struct umbw_buffer *out)
{
    struct umbw_volume_query_request value;
    return umbw_decode_volume_query_request(kind, message, size, UINT64_MAX, &value, NULL) == UMB_OK
               ? must(umbw_encode_volume_query_request(&value, out, NULL))
               : REFUSED;
}

static enum answer echo_volume_reply(enum umbw_volume_query kind, const uint8_t *message,
                                     size_t size, struct umbw_buffer *out)
{
    for (size_t count = 0; count <= COUNT_MAX; count++) {
        struct umbw_volume_query_reply value;
        if (umbw_decode_volume_query_reply(kind, message, size, count, &value, NULL) == UMB_OK) {
            return must(umbw_encode_volume_query_reply(&value, out, NULL));
        }
    }
    return REFUSED;
}

#define ECHO_VOLUME(name, kind)                                                                    \
    static enum answer echo_##name##_request(const uint8_t *message, size_t size,                  \
                                             struct umbw_buffer *out)                              \
    {                                                                                              \
        return echo_volume_request(kind, message, size, out);                                      \
    }                                                                                              \
    static enum answer echo_##name##_reply(const uint8_t *message, size_t size,                    \
                                           struct umbw_buffer *out)                                \
    {                                                                                              \
        return echo_volume_reply(kind, message, size, out);                                        \
    }

ECHO_VOLUME(segments, UMBW_SEGMENTS)
ECHO_VOLUME(columns, UMBW_COLUMNS)
ECHO_VOLUME(boxes, UMBW_BOXES)

static const struct {
    const char *message; /* Name in the .proto files */
    enum answer (*echo)(const uint8_t *message, size_t size, struct umbw_buffer *out);
} kinds[] = {
    {"shadows.QueryRequest", echo_query_request},
    {"shadows.QueryReply", echo_query_reply},
    {"shadows.DescribeRequest", echo_describe_request},
    {"shadows.DescribeReply", echo_describe_reply},
    {"shadows.ListReply", echo_list_reply},
    {"shadows.LimitsReply", echo_limits_reply},
    {"shadows.SampleRequest", echo_sample_request},
    {"shadows.SampleReply", echo_sample_reply},
    {"health.HealthCheckRequest", echo_health_request},
    {"health.HealthCheckResponse", echo_health_reply},
    {"bakes.SubmitRequest", echo_submit_request},
    {"bakes.SubmitReply", echo_submit_reply},
    {"bakes.WatchRequest", echo_job_request},
    {"bakes.JobStatus", echo_job_status},
    {"bakes.ListJobsRequest", echo_list_jobs_request},
    {"bakes.ListJobsReply", echo_job_list},
    {"bakes.FetchRequest", echo_fetch_request},
    {"bakes.FetchReply", echo_fetch_reply},
    {"bakes.DeleteRequest", echo_delete_request},
    {"regions.RegionRequest", echo_region_request},
    {"regions.RegionReply", echo_region_reply},
    {"regions.VersionRequest", echo_version_request},
    {"regions.DeriveMapRequest", echo_derive_request},
    {"questions.SegmentsRequest", echo_segments_request},
    {"questions.SegmentsReply", echo_segments_reply},
    {"questions.ColumnsRequest", echo_columns_request},
    {"questions.ColumnsReply", echo_columns_reply},
    {"questions.BoxesRequest", echo_boxes_request},
    {"questions.BoxesReply", echo_boxes_reply},
};

#define KIND_COUNT (sizeof kinds / sizeof kinds[0])

int main(int argc, char **argv)
{
    uint8_t kind;
    uint32_t size;
    if (argc > 1 && strcmp(argv[1], "--list") == 0) {
        for (size_t i = 0; i < KIND_COUNT; i++) {
            (void)puts(kinds[i].message);
        }
        return 0;
    }
    while (fread(&kind, sizeof kind, 1, stdin) == 1 && fread(&size, sizeof size, 1, stdin) == 1) {
        struct umbw_buffer out = {0};
        uint8_t *exact = size <= MESSAGE_MAX ? malloc(size + 1) : NULL;
        if (kind >= KIND_COUNT || exact == NULL || fread(exact + 1, 1, size, stdin) != size) {
            return 1;
        }
        const enum answer answer = kinds[kind].echo(exact + 1, size, &out);
        const uint32_t length = answer == DECODED ? (uint32_t)out.size - UMBW_PREFIX_BYTES : 0;
        (void)fputc((int)answer, stdout);
        (void)fwrite(&length, sizeof length, 1, stdout);
        if (length > 0) {
            (void)fwrite(out.bytes + UMBW_PREFIX_BYTES, 1, length, stdout);
        }
        umbw_buffer_finish(&out);
        free(exact);
    }
    return 0;
}
