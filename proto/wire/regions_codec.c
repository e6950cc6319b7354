/* SPDX-License-Identifier: Apache-2.0 */
/* RegionRequest and RegionReply. */
#include "wire/regions.h"

#include <string.h>

#include "umbrage/v1/regions.pb-c.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"

static enum umb_status check_ranges(const Umbrage__V1__RegionRequest *message,
                                    struct umbw_region_request *request, struct umb_error *error)
{
    uint64_t total = 0;
    if (message->n_offsets != message->n_lengths) {
        return umb_fail(error, UMB_E_ARGUMENT, "offsets, lengths: %zu and %zu, must be as many",
                        message->n_offsets, message->n_lengths);
    }
    if (message->n_offsets == 0 || message->n_offsets > UMBW_RANGES_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "offsets: %zu, must be 1 to %d", message->n_offsets,
                        UMBW_RANGES_MAX);
    }
    for (size_t i = 0; i < message->n_offsets; i++) {
        const uint64_t offset = message->offsets[i], length = message->lengths[i];
        total += length;
        if (length == 0 || length > UMBW_REGION_BYTES_MAX || total > UMBW_REGION_BYTES_MAX ||
            offset > INT64_MAX - length) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "lengths[%zu]: %llu bytes from %llu, must be 1 or more and together at "
                            "most %d",
                            i, (unsigned long long)length, (unsigned long long)offset,
                            UMBW_REGION_BYTES_MAX);
        }
        request->ranges[i] = (struct umbw_range){offset, length};
    }
    request->count = message->n_offsets;
    return UMB_OK;
}

enum umb_status umbw_decode_region_request(const uint8_t *message, size_t size,
                                           struct umbw_region_request *request,
                                           struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset"},
        {2, UMBW_FIELD_PACKED, UMBW_WIRE_VARINT, "offsets"},
        {3, UMBW_FIELD_PACKED, UMBW_WIRE_VARINT, "lengths"},
    };
    struct umbw_field_found found[3];
    struct umbw_scratch scratch;
    ProtobufCMessage *unpacked = NULL;
    memset(request, 0, sizeof *request);
    enum umb_status status = umbw_proto_scan(message, size, fields, 3, found, &scratch, error);
    if (status == UMB_OK) {
        status = umbw_asset_copy(found[0].bytes, found[0].size, request->asset, error);
    }
    if (status == UMB_OK) {
        status = umbw_message_unpack(&umbrage__v1__region_request__descriptor, scratch.bytes,
                                     scratch.size, &unpacked, error);
    }
    if (status == UMB_OK) {
        status = check_ranges((const Umbrage__V1__RegionRequest *)unpacked, request, error);
        umbw_message_free(unpacked);
    }
    return status;
}

enum umb_status umbw_encode_region_request(const struct umbw_region_request *request,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__RegionRequest message = UMBRAGE__V1__REGION_REQUEST__INIT;
    uint64_t offsets[UMBW_RANGES_MAX], lengths[UMBW_RANGES_MAX];
    for (size_t i = 0; i < request->count; i++) {
        offsets[i] = request->ranges[i].offset;
        lengths[i] = request->ranges[i].length;
    }
    message.asset = (char *)(uintptr_t)request->asset; /* read only by the encoder */
    message.n_offsets = message.n_lengths = request->count;
    message.offsets = offsets;
    message.lengths = lengths;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_decode_region_reply(const uint8_t *message, size_t size,
                                         struct umbw_region_reply *reply, struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset_id"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "file_bytes"},
        {3, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "data"},
    };
    struct umbw_field_found found[3];
    memset(reply, 0, sizeof *reply);
    enum umb_status status = umbw_proto_scan(message, size, fields, 3, found, NULL, error);
    if (status == UMB_OK) {
        reply->file_bytes = found[1].count > 0 ? found[1].number : 0;
        reply->data = found[2].bytes;
        reply->data_size = found[2].size;
        status = umbw_id_copy("asset_id", found[0].bytes, found[0].size, reply->asset_id, error);
    }
    return status;
}

enum umb_status umbw_encode_region_reply(const struct umbw_region_reply *reply,
                                         struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__RegionReply message = UMBRAGE__V1__REGION_REPLY__INIT;
    message.asset_id.data = (uint8_t *)(uintptr_t)reply->asset_id;
    message.asset_id.len = UMB_ID_BYTES;
    message.file_bytes = reply->file_bytes;
    message.data.data = (uint8_t *)(uintptr_t)reply->data;
    message.data.len = reply->data_size;
    return umbw_message_append(&message.base, buffer, error);
}
