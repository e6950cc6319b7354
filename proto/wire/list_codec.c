/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage.v1.ListRequest, ListReply and the AssetSummary in them. */
#include "wire/asset_codec.h"

#include <stdlib.h>
#include <string.h>
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "wire/wire_buffer.h"

#define LIST_MAX 65536 /* Most assets in one reply: a larger store needs paging, not memory */

enum umb_status umbw_summary_take(const Umbrage__V1__AssetSummary *message,
                                  struct umbw_asset_summary *summary, struct umb_error *error)
{
    memset(summary, 0, sizeof *summary);
    if (message == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "summary: is missing");
    }
    enum umb_status status =
        umbw_text_copy("summary.name", (const uint8_t *)message->name, strlen(message->name),
                       UMBW_ASSET_NAME_MAX, summary->name, error);
    if (status == UMB_OK) {
        status = umbw_id_copy("summary.id", message->id.data, message->id.len, summary->id, error);
    }
    summary->packed_bytes = message->packed_bytes;
    summary->memory_bytes = message->memory_bytes;
    summary->light_count = message->light_count;
    return status;
}

void umbw_summary_put(struct umbw_asset_summary *summary, Umbrage__V1__AssetSummary *message)
{
    umbrage__v1__asset_summary__init(message);
    summary->name[UMBW_ASSET_NAME_MAX] = '\0';
    message->name = summary->name;
    message->id.data = summary->id;
    message->id.len = sizeof summary->id;
    message->packed_bytes = summary->packed_bytes;
    message->memory_bytes = summary->memory_bytes;
    message->light_count = summary->light_count;
}

void umbw_list_reply_finish(struct umbw_list_reply *reply)
{
    free(reply->assets);
    memset(reply, 0, sizeof *reply);
}

static enum umb_status take_assets(const Umbrage__V1__ListReply *message,
                                   struct umbw_list_reply *reply, struct umb_error *error)
{
    if (message->n_assets == 0) {
        return UMB_OK;
    }
    reply->assets = calloc(message->n_assets, sizeof *reply->assets);
    if (reply->assets == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu assets", message->n_assets);
    }
    reply->count = message->n_assets;
    for (size_t i = 0; i < reply->count; i++) {
        enum umb_status status = umbw_summary_take(message->assets[i], &reply->assets[i], error);
        if (status != UMB_OK) {
            umbw_list_reply_finish(reply);
            return status;
        }
    }
    return UMB_OK;
}

enum umb_status umbw_decode_list_reply(const uint8_t *message, size_t size,
                                       struct umbw_list_reply *reply, struct umb_error *error)
{
    static const struct umbw_field field = {1, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "assets"};
    struct umbw_field_found found;
    memset(reply, 0, sizeof *reply);
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, NULL, error);
    if (status == UMB_OK && found.count > LIST_MAX) {
        status = umb_fail(error, UMB_E_TOO_LARGE, "assets: %zu is over the limit of %d",
                          found.count, LIST_MAX);
    }
    ProtobufCMessage *whole = NULL;
    if (status == UMB_OK) {
        status =
            umbw_message_unpack(&umbrage__v1__list_reply__descriptor, message, size, &whole, error);
    }
    if (status == UMB_OK) {
        status = take_assets((const Umbrage__V1__ListReply *)whole, reply, error);
        umbw_message_free(whole);
    }
    return status;
}

enum umb_status umbw_encode_list_request(struct umbw_buffer *buffer, struct umb_error *error)
{
    return umbw_buffer_begin_message(buffer, 0, 0, error);
}

/* The arrays of a reply that protobuf-c needs; one allocation. */
struct list_parts {
    struct umbw_asset_summary summary; /* protobuf-c has no const text */
    Umbrage__V1__AssetSummary message;
};

enum umb_status umbw_encode_list_reply(const struct umbw_list_reply *reply,
                                       struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__ListReply message = UMBRAGE__V1__LIST_REPLY__INIT;
    if (reply->count > LIST_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "assets: %zu is over the limit of %d", reply->count,
                        LIST_MAX);
    }
    size_t count = reply->count;
    struct list_parts *parts = calloc(count + 1, sizeof *parts);
    Umbrage__V1__AssetSummary **pointers = calloc(count + 1, sizeof *pointers);
    enum umb_status status;
    if (parts == NULL || pointers == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu assets", count);
    } else {
        for (size_t i = 0; i < count; i++) {
            parts[i].summary = reply->assets[i];
            umbw_summary_put(&parts[i].summary, &parts[i].message);
            pointers[i] = &parts[i].message;
        }
        message.assets = pointers;
        message.n_assets = count;
        status = umbw_message_append(&message.base, buffer, error);
    }
    free(pointers);
    free(parts);
    return status;
}
