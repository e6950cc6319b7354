/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage.v1.QueryReply between its bytes and struct umbw_query_reply. The answers are the last
 * field on the wire: the encoder stops before them and the caller sends them from where they lie.
 */
#include "wire/messages.h"

#include <string.h>
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "wire/wire_buffer.h"

#define VISIBILITY_TAG 0x0a /* field 1, wire type 2 */

enum reply_field {
    FIELD_VISIBILITY,
    FIELD_ASSET_ID,
    FIELD_STATS,
    FIELD_COUNT,
};

static const struct umbw_field REPLY_FIELDS[FIELD_COUNT] = {
    [FIELD_VISIBILITY] = {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "visibility"},
    [FIELD_ASSET_ID] = {2, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset_id"},
    [FIELD_STATS] = {3, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "stats"},
};

static void take_stats(const Umbrage__V1__QueryStats *stats, struct umbw_query_reply *reply)
{
    if (stats == NULL) {
        return;
    }
    reply->has_stats = 1;
    reply->stats.points = stats->points;
    reply->stats.outside = stats->outside;
    reply->stats.before = stats->before;
    reply->stats.behind = stats->behind;
    reply->stats.facing_away = stats->facing_away;
    reply->stats.nodes = stats->nodes;
    reply->stats.bricks = stats->bricks;
    reply->nanoseconds = stats->nanoseconds;
}

enum umb_status umbw_decode_query_reply(const uint8_t *message, size_t size,
                                        struct umbw_query_reply *reply, struct umb_error *error)
{
    struct umbw_field_found found[FIELD_COUNT];
    struct umbw_scratch scratch;
    memset(reply, 0, sizeof *reply);
    enum umb_status status =
        umbw_proto_scan(message, size, REPLY_FIELDS, FIELD_COUNT, found, &scratch, error);
    if (status == UMB_OK) {
        status = umbw_id_copy("asset_id", found[FIELD_ASSET_ID].bytes, found[FIELD_ASSET_ID].size,
                              reply->asset_id, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    ProtobufCMessage *rest;
    status = umbw_message_unpack(&umbrage__v1__query_reply__descriptor, scratch.bytes, scratch.size,
                                 &rest, error);
    if (status != UMB_OK) {
        return status;
    }
    take_stats(((const Umbrage__V1__QueryReply *)rest)->stats, reply);
    umbw_message_free(rest);
    reply->visibility = found[FIELD_VISIBILITY].bytes;
    reply->visibility_bytes = found[FIELD_VISIBILITY].size;
    return UMB_OK;
}

static void put_stats(const struct umbw_query_reply *reply, Umbrage__V1__QueryStats *stats)
{
    stats->points = reply->stats.points;
    stats->outside = reply->stats.outside;
    stats->before = reply->stats.before;
    stats->behind = reply->stats.behind;
    stats->facing_away = reply->stats.facing_away;
    stats->nodes = reply->stats.nodes;
    stats->bricks = reply->stats.bricks;
    stats->nanoseconds = reply->nanoseconds;
}

enum umb_status umbw_encode_query_reply_head(const struct umbw_query_reply *reply,
                                             struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__QueryReply message = UMBRAGE__V1__QUERY_REPLY__INIT;
    Umbrage__V1__QueryStats stats = UMBRAGE__V1__QUERY_STATS__INIT;
    uint8_t asset_id[UMB_ID_BYTES];
    memcpy(asset_id, reply->asset_id, sizeof asset_id);
    message.asset_id.data = asset_id;
    message.asset_id.len = sizeof asset_id;
    if (reply->has_stats) {
        put_stats(reply, &stats);
        message.stats = &stats;
    }
    uint8_t tag[11] = {VISIBILITY_TAG};
    size_t tag_size = 0;
    if (reply->visibility_bytes > 0) {
        tag_size = 1 + umbw_varint_write(reply->visibility_bytes, tag + 1);
    }
    size_t head_size = umbrage__v1__query_reply__get_packed_size(&message) + tag_size;
    if (reply->visibility_bytes > UINT32_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "visibility: %zu bytes are over the limit of %lu",
                        reply->visibility_bytes, (unsigned long)UINT32_MAX);
    }
    enum umb_status status = umbw_buffer_begin_message(
        buffer, (uint64_t)head_size + reply->visibility_bytes, head_size, error);
    if (status != UMB_OK) {
        return status;
    }
    buffer->size += umbrage__v1__query_reply__pack(&message, buffer->bytes + buffer->size);
    memcpy(buffer->bytes + buffer->size, tag, tag_size);
    buffer->size += tag_size;
    return UMB_OK;
}
