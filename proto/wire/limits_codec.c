/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage.v1.LimitsReply between its bytes and struct umbw_limits. */
#include <string.h>
#include "base/try.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"
#include "wire/messages.h"

enum umb_status umbw_encode_limits_reply(const struct umbw_limits *limits,
                                         struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__LimitsReply message = UMBRAGE__V1__LIMITS_REPLY__INIT;
    char identity[] = "identity";
    char gzip[] = "gzip";
    char *encodings[] = {identity, gzip};
    char version[sizeof limits->version];
    memcpy(version, limits->version, sizeof version);
    version[sizeof version - 1] = '\0';
    message.max_points = limits->max_points;
    message.max_message_bytes = limits->max_message_bytes;
    message.max_targets = limits->max_targets;
    message.max_taps = limits->max_taps;
    message.max_streams = limits->max_streams;
    message.queue = limits->queue;
    message.encodings = encodings;
    message.n_encodings = limits->takes_gzip ? 2 : 1;
    message.version = version;
    message.max_bundle_bytes = limits->max_bundle_bytes;
    message.max_bundle_files = limits->max_bundle_files;
    message.max_owner_jobs = limits->max_owner_jobs;
    message.max_segments = limits->max_segments;
    message.max_columns = limits->max_columns;
    message.max_boxes = limits->max_boxes;
    message.max_box_steps = limits->max_box_steps;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_decode_limits_reply(const uint8_t *message, size_t size,
                                         struct umbw_limits *limits, struct umb_error *error)
{
    ProtobufCMessage *base;
    memset(limits, 0, sizeof *limits);
    UMB__TRY(
        umbw_message_unpack(&umbrage__v1__limits_reply__descriptor, message, size, &base, error));
    const Umbrage__V1__LimitsReply *reply = (const Umbrage__V1__LimitsReply *)base;
    limits->max_points = reply->max_points;
    limits->max_message_bytes = reply->max_message_bytes;
    limits->max_targets = reply->max_targets;
    limits->max_taps = reply->max_taps;
    limits->max_streams = reply->max_streams;
    limits->queue = reply->queue;
    limits->max_bundle_bytes = reply->max_bundle_bytes;
    limits->max_bundle_files = reply->max_bundle_files;
    limits->max_owner_jobs = reply->max_owner_jobs;
    limits->max_segments = reply->max_segments;
    limits->max_columns = reply->max_columns;
    limits->max_boxes = reply->max_boxes;
    limits->max_box_steps = reply->max_box_steps;
    for (size_t i = 0; i < reply->n_encodings; i++) {
        limits->takes_gzip |= strcmp(reply->encodings[i], "gzip") == 0;
    }
    enum umb_status status =
        umbw_text_copy("version", (const uint8_t *)reply->version, strlen(reply->version),
                       sizeof limits->version - 1, limits->version, error);
    umbw_message_free(base);
    return status;
}
