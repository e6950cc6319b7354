/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage.v1.QueryReply between its bytes and struct umbw_query_reply. The answers are the last
 * field on the wire: the encoder stops before them, and the caller sends them from their own
 * memory.
 */
#include "wire/messages.h"

#include <string.h>
#include "base/compat.h"
#include "base/try.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "wire/wire_buffer.h"

enum reply_field {
    FIELD_VISIBILITY,
    FIELD_ASSET_ID,
    FIELD_STATS,
    FIELD_ASSET_IDS,
    FIELD_PACKING,
    FIELD_COUNT,
};

static const struct umbw_field REPLY_FIELDS[FIELD_COUNT] = {
    [FIELD_VISIBILITY] = {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "visibility"},
    [FIELD_ASSET_ID] = {2, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset_id"},
    [FIELD_STATS] = {3, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "stats"},
    [FIELD_ASSET_IDS] = {4, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset_ids"},
    [FIELD_PACKING] = {5, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "packing"},
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
    reply->stats.undefined = stats->undefined;
    reply->stats.nodes = stats->nodes;
    reply->stats.bricks = stats->bricks;
    reply->nanoseconds = stats->nanoseconds;
    reply->voxel_m = stats->voxel_m;
    reply->level = stats->level;
    reply->taps = stats->taps;
    reply->bound_m = stats->bound_m;
    reply->visibility_error = stats->visibility_error;
    reply->lines = stats->lines;
    reply->expected_ns = stats->expected_ns;
}

/* Checks the ids: one, or with targets one of each; the first of several is found by its last
 * occurrence only. */
static enum umb_status take_ids(const struct umbw_field_found found[FIELD_COUNT],
                                struct umbw_query_reply *reply, struct umb_error *error)
{
    enum reply_field field = found[FIELD_ASSET_IDS].count > 0 ? FIELD_ASSET_IDS : FIELD_ASSET_ID;
    reply->asset_id_count = found[FIELD_ASSET_IDS].count;
    return umbw_id_copy(REPLY_FIELDS[field].name, found[field].bytes, found[field].size,
                        reply->asset_id, error);
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
        status = take_ids(found, reply, error);
    }
    if (status == UMB_OK && found[FIELD_PACKING].number > UMBW_PACKING_CHANGES) {
        status = umb_fail(error, UMB_E_UNSUPPORTED, "packing: %llu is not known here",
                          (unsigned long long)found[FIELD_PACKING].number);
    }
    if (status != UMB_OK) {
        return status;
    }
    reply->packing = (enum umbw_packing)found[FIELD_PACKING].number;
    ProtobufCMessage *rest;
    UMB__TRY(umbw_message_unpack(&umbrage__v1__query_reply__descriptor, scratch.bytes, scratch.size,
                                 &rest, error));
    take_stats(((const Umbrage__V1__QueryReply *)rest)->stats, reply);
    umbw_message_free(rest);
    reply->visibility = found[FIELD_VISIBILITY].bytes;
    reply->visibility_bytes = found[FIELD_VISIBILITY].size;
    return UMB_OK;
}

/*
 * The encoder. A reply is made for every call, so its few fields are hand-written, in the order of
 * their numbers except the answers, which protobuf allows anywhere.
 */
#define TAG_VISIBILITY       0x0a /* field 1, bytes */
#define TAG_ASSET_ID         0x12 /* field 2, bytes */
#define TAG_STATS            0x1a /* field 3, bytes */
#define TAG_ASSET_IDS        0x22 /* field 4, bytes */
#define TAG_PACKING          0x28 /* field 5, varint */
#define TAG_VOXEL_M          0x49 /* stats, field 9, fixed64 */
#define TAG_LEVEL            0x50 /* stats, field 10, varint */
#define TAG_TAPS             0x58 /* stats, field 11, varint */
#define TAG_BOUND_M          0x61 /* stats, fields 12 to 14, fixed64 */
#define TAG_VISIBILITY_ERROR 0x69
#define TAG_LINES            0x71
#define TAG_EXPECTED_NS      0x79 /* stats, field 15, fixed64 */
#define TAG_UNDEFINED        0x80 /* stats, field 16, varint: two bytes */
#define ID_FIELD_BYTES       (2 + UMB_ID_BYTES)
/* Most bytes with tags: varints of 64 bits, one of them with a longer tag, and of 32 bits,
 * doubles. */
#define STATS_MAX  (8 * 11 + 12 + 2 * 6 + 5 * 9)
#define VARINT_MAX 10

static size_t varint_size(uint64_t value)
{
    uint8_t bytes[VARINT_MAX];
    return umbw_varint_write(value, bytes);
}

/* Writes a double unless it is 0; returns the bytes. */
static size_t write_double(uint8_t tag, double value, uint8_t *out)
{
    uint64_t bits;
    if (value == 0) {
        return 0;
    }
    memcpy(&bits, &value, sizeof bits);
    out[0] = tag;
    for (unsigned i = 0; i < 8; i++) {
        out[1 + i] = (uint8_t)(bits >> (8 * i));
    }
    return 9;
}

/* Writes a number unless it is 0; returns the bytes. */
static size_t write_number(uint8_t tag, uint32_t value, uint8_t *out)
{
    if (value == 0) {
        return 0;
    }
    out[0] = tag;
    return 1 + umbw_varint_write(value, out + 1);
}

/* Writes the stats message; returns its length. */
static size_t write_stats(const struct umbw_query_reply *reply, uint8_t out[STATS_MAX])
{
    const struct umb_query_stats *stats = &reply->stats;
    const uint64_t numbers[] = {stats->points, stats->outside,     stats->before,
                                stats->behind, stats->facing_away, stats->nodes,
                                stats->bricks, reply->nanoseconds};
    size_t size = 0;
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        if (numbers[i] != 0) {
            out[size++] = (uint8_t)((i + 1) << 3);
            size += umbw_varint_write(numbers[i], out + size);
        }
    }
    size += write_double(TAG_VOXEL_M, reply->voxel_m, out + size);
    size += write_number(TAG_LEVEL, reply->level, out + size);
    size += write_number(TAG_TAPS, reply->taps, out + size);
    size += write_double(TAG_BOUND_M, reply->bound_m, out + size);
    size += write_double(TAG_VISIBILITY_ERROR, reply->visibility_error, out + size);
    size += write_double(TAG_LINES, reply->lines, out + size);
    size += write_double(TAG_EXPECTED_NS, reply->expected_ns, out + size);
    if (stats->undefined != 0) {
        size += umbw_varint_write(TAG_UNDEFINED, out + size);
        size += umbw_varint_write(stats->undefined, out + size);
    }
    return size;
}

/* Returns the bytes of the message before the answers, with their tag and length. */
static size_t head_size(const struct umbw_query_reply *reply, size_t stats_size)
{
    size_t ids = reply->asset_id_count > 0 ? reply->asset_id_count : 1;
    size_t size = ids * ID_FIELD_BYTES;
    if (reply->has_stats) {
        size += 1 + varint_size(stats_size) + stats_size;
    }
    size += reply->packing != UMBW_PACKING_PLAIN ? 2 : 0;
    if (reply->visibility_bytes > 0) {
        size += 1 + varint_size(reply->visibility_bytes);
    }
    return size;
}

size_t umbw_query_reply_room(const struct umbw_query_reply *reply)
{
    return UMBW_PREFIX_BYTES + head_size(reply, STATS_MAX);
}

static uint8_t *write_id(uint8_t *at, uint8_t tag, const uint8_t id[UMB_ID_BYTES])
{
    at[0] = tag;
    at[1] = UMB_ID_BYTES;
    memcpy(at + 2, id, UMB_ID_BYTES);
    return at + ID_FIELD_BYTES;
}

size_t umbw_write_query_reply_head(const struct umbw_query_reply *reply, uint8_t *bytes)
{
    uint8_t stats[STATS_MAX] UMB__UNSET;
    size_t stats_size = reply->has_stats ? write_stats(reply, stats) : 0;
    uint64_t message_size = head_size(reply, stats_size) + reply->visibility_bytes;
    uint8_t *at = bytes + UMBW_PREFIX_BYTES;
    bytes[0] = 0; /* not compressed */
    for (unsigned i = 0; i < 4; i++) {
        bytes[1 + i] = (uint8_t)(message_size >> (24 - 8 * i));
    }
    if (reply->asset_id_count == 0) {
        at = write_id(at, TAG_ASSET_ID, reply->asset_id);
    }
    if (reply->has_stats) {
        *at++ = TAG_STATS;
        at += umbw_varint_write(stats_size, at);
        memcpy(at, stats, stats_size);
        at += stats_size;
    }
    for (size_t i = 0; i < reply->asset_id_count; i++) {
        at = write_id(at, TAG_ASSET_IDS, reply->asset_ids + i * UMB_ID_BYTES);
    }
    at += write_number(TAG_PACKING, (uint32_t)reply->packing, at);
    if (reply->visibility_bytes > 0) {
        *at++ = TAG_VISIBILITY;
        at += umbw_varint_write(reply->visibility_bytes, at);
    }
    return (size_t)(at - bytes);
}

enum umb_status umbw_encode_query_reply_head(const struct umbw_query_reply *reply,
                                             struct umbw_buffer *buffer, struct umb_error *error)
{
    size_t room = umbw_query_reply_room(reply);
    if (reply->visibility_bytes > UINT32_MAX - room) {
        return umb_fail(error, UMB_E_TOO_LARGE, "visibility: %zu bytes are over the limit of %lu",
                        reply->visibility_bytes, (unsigned long)(UINT32_MAX - room));
    }
    enum umb_status status = umbw_buffer_reserve(buffer, room, error);
    if (status == UMB_OK) {
        buffer->size += umbw_write_query_reply_head(reply, buffer->bytes + buffer->size);
    }
    return status;
}
