/* SPDX-License-Identifier: Apache-2.0 */
/* Hostile messages and gRPC bytes: every decoder, and the reader fed in pieces the input chooses.
 */
#include <string.h>

#include "fuzz.h"
#include "grpc/grpc.h"
#include "wire/messages.h"
#include "wire/volume_queries.h"
#include "wire/regions.h"
#include "wire/versions.h"

static enum umb_status on_message(void *user, const uint8_t *message, size_t size, int compressed)
{
    size_t *total = user;
    (void)compressed;
    for (size_t i = 0; i < size; i++) {
        *total += message[i];
    }
    return UMB_OK;
}

static void feed_reader(const uint8_t *data, size_t size)
{
    struct umbw_reader reader;
    size_t total = 0, at = 0;
    umbw_reader_init(&reader, 4096);
    while (at < size) {
        size_t piece = 1 + data[at] % 37;
        piece = piece < size - at ? piece : size - at;
        if (umbw_reader_feed(&reader, data + at, piece, on_message, &total, NULL) != UMB_OK) {
            break;
        }
        at += piece;
    }
    umbw_reader_finish(&reader);
}

static void decode_all(const uint8_t *message, size_t size)
{
    struct umbw_query_request request;
    struct umbw_query_reply query_reply;
    struct umb_client_description *describe;
    struct umbw_list_reply list;
    char text[256];
    struct umbw_describe_request asked;
    int serving;
    if (umbw_decode_query_request(message, size, 1000, &request, NULL) == UMB_OK) {
        FUZZ_DEMAND(request.points.count <= 1000);
        (void)!umb_points_check(&request.points, NULL);
    }
    (void)!umbw_decode_query_reply(message, size, &query_reply, NULL);
    if (umbw_decode_describe_reply(message, size, &describe, NULL) == UMB_OK) {
        free(describe);
    }
    if (umbw_decode_list_reply(message, size, &list, NULL) == UMB_OK) {
        free(list.assets);
    }
    struct umbw_region_request region;
    struct umbw_region_reply piece;
    struct umbw_derive_request derive;
    (void)!umbw_decode_region_request(message, size, &region, NULL);
    (void)!umbw_decode_region_reply(message, size, &piece, NULL);
    struct umbw_version_request version;
    (void)!umbw_decode_version_request(message, size, &version, NULL);
    if (umbw_decode_derive_request(message, size, &derive, NULL) == UMB_OK) {
        FUZZ_DEMAND(derive.settings.cascades.count <= UMB_CASCADES_MAX);
    }
    struct umbw_sample_request sample;
    struct umbw_sample_reply sampled;
    if (umbw_decode_sample_request(message, size, &sample, NULL) == UMB_OK) {
        FUZZ_DEMAND(sample.settings.count >= 1 && sample.settings.count <= UMB_SAMPLE_MAX);
    }
    if (umbw_decode_sample_reply(message, size, &sampled, NULL) == UMB_OK) {
        FUZZ_DEMAND(sampled.sample.count <= size / UMBW_SAMPLE_POINT_BYTES);
    }
    for (int q = 0; q < UMBW_VOLUME_QUERY_COUNT; q++) {
        struct umbw_volume_query_request volume_query;
        struct umbw_volume_query_reply answers;
        if (umbw_decode_volume_query_request((enum umbw_volume_query)q, message, size, 1000,
                                             &volume_query, NULL) == UMB_OK) {
            FUZZ_DEMAND(volume_query.count <= 1000);
        }
        (void)!umbw_decode_volume_query_reply((enum umbw_volume_query)q, message, size, size % 5,
                                              &answers, NULL);
    }
    (void)!umbw_decode_describe_request(message, size, &asked, NULL);
    (void)!umbw_decode_health_request(message, size, text, NULL);
    (void)!umbw_decode_health_reply(message, size, &serving, NULL);
    struct umbw_limits limits;
    (void)!umbw_decode_limits_reply(message, size, &limits, NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int64_t nanoseconds;
    char text[64];
    uint8_t *exact = malloc(size ? size : 1);
    if (!exact) {
        return 0;
    }
    memcpy(exact, data, size);
    decode_all(exact, size);
    feed_reader(exact, size);
    (void)!umbw_timeout_parse((const char *)exact, size, &nanoseconds);
    (void)umbw_message_unescape((const char *)exact, size, text, sizeof text);
    free(exact);
    return 0;
}
