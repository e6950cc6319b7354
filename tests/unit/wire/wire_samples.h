/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_WIRE_SAMPLES_H
#define UMBRAGE_TESTS_WIRE_SAMPLES_H
/* Sample structs for the wire tests, and a small reproducible random generator. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include "wire/messages.h"

/* xorshift64*; the seed is printed by the tests that use it. */
static inline uint64_t sample_random(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return *state * 0x2545f4914f6cdd1dULL;
}

static inline struct umbw_query_request sample_request(const float *positions, const float *normals,
                                                       size_t count)
{
    struct umbw_query_request request = {
        .asset = "city",
        .settings = {.light = 3,
                     .taps = 9,
                     .bias_mode = UMB_BIAS_METRES,
                     .bias = 0.25,
                     .format = UMB_ANSWER_BIT},
        .points = {.positions = positions,
                   .format = UMB_POINT_F32,
                   .origin = {85000.5, -447000.25, 3},
                   .normals = normals,
                   .count = count},
        .want_stats = 1,
    };
    return request;
}

static inline struct umbw_query_reply sample_reply(const uint8_t *visibility, size_t bytes)
{
    struct umbw_query_reply reply = {
        .visibility = visibility,
        .visibility_bytes = bytes,
        .stats = {.points = 5,
                  .outside = 1,
                  .before = 2,
                  .behind = 3,
                  .facing_away = 4,
                  .undefined = 1ULL << 33,
                  .nodes = 1ULL << 40,
                  .bricks = 7},
        .nanoseconds = 123456789,
        .has_stats = 1,
    };
    for (unsigned i = 0; i < UMB_ID_BYTES; i++) {
        reply.asset_id[i] = (uint8_t)(255 - i);
    }
    return reply;
}

/* Appends the start of a reply, as servers do. */
static inline enum umb_status encode_head(const struct umbw_query_reply *reply,
                                          struct umbw_buffer *buffer)
{
    const enum umb_status status = umbw_buffer_reserve(buffer, umbw_query_reply_room(reply), NULL);
    if (status == UMB_OK) {
        buffer->size += umbw_write_query_reply_head(reply, buffer->bytes + buffer->size);
    }
    return status;
}

static inline struct umb_client_asset sample_summary(unsigned number)
{
    struct umb_client_asset summary = {
        .packed_bytes = 1000ULL + number, .memory_bytes = 1ULL << 35, .light_count = number};
    (void)snprintf(summary.name, sizeof summary.name, "asset %u \xc3\xa9", number);
    memset(summary.id, (int)(number & 255U), sizeof summary.id);
    return summary;
}

static inline void sample_light(unsigned number, struct umb_client_light *light)
{
    memset(light, 0, sizeof *light);
    (void)snprintf(light->info.name, sizeof light->info.name, "sun %u", number);
    light->info.kind = (enum umb_light_kind)(number % UMB_LIGHT_KINDS);
    for (int i = 0; i < 3; i++) {
        light->info.direction[i] = 0.5 * i - (double)number;
        light->info.position[i] = 1e6 + i;
        light->voxel_m[i] = 0.01 * (i + 1);
        light->info.side[i] = light->info.kind == UMB_LIGHT_RECTANGLE ? 0.25 * i : 0;
    }
    light->info.extent = 0.0093;
    light->resolution = 1ULL << (6 + number);
    light->closed = (int)(number & 1U);
}

#endif
