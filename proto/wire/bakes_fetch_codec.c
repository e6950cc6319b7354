/* SPDX-License-Identifier: Apache-2.0 */
/* FetchRequest and FetchReply; data is never copied by the decoder. */
#include <string.h>
#include "umbrage/v1/bakes.pb-c.h"
#include "wire/bakes.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"

enum umb_status umbw_encode_fetch_request(const struct umbw_fetch_request *request,
                                          struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__FetchRequest message = UMBRAGE__V1__FETCH_REQUEST__INIT;
    message.asset = (char *)(uintptr_t)request->asset; /* read only by the encoder */
    message.offset = request->offset;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_decode_fetch_request(const uint8_t *message, size_t size,
                                          struct umbw_fetch_request *request,
                                          struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "offset"},
    };
    struct umbw_field_found found[2];
    memset(request, 0, sizeof *request);
    enum umb_status status = umbw_proto_scan(message, size, fields, 2, found, NULL, error);
    if (status == UMB_OK) {
        request->offset = found[1].count > 0 ? found[1].number : 0;
        status = umbw_asset_copy(found[0].bytes, found[0].size, request->asset, error);
    }
    return status;
}

enum umb_status umbw_encode_fetch_reply(const struct umbw_fetch_reply *reply,
                                        struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__FetchReply message = UMBRAGE__V1__FETCH_REPLY__INIT;
    message.size = reply->size;
    message.offset = reply->offset;
    message.data.data = (uint8_t *)(uintptr_t)reply->data;
    message.data.len = reply->data_size;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_decode_fetch_reply(const uint8_t *message, size_t size,
                                        struct umbw_fetch_reply *reply, struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "size"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "offset"},
        {3, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "data"},
    };
    struct umbw_field_found found[3];
    memset(reply, 0, sizeof *reply);
    enum umb_status status = umbw_proto_scan(message, size, fields, 3, found, NULL, error);
    if (status == UMB_OK) {
        reply->size = found[0].count > 0 ? found[0].number : 0;
        reply->offset = found[1].count > 0 ? found[1].number : 0;
        reply->data = found[2].bytes;
        reply->data_size = found[2].size;
    }
    return status;
}
