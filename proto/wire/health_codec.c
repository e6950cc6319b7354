/* SPDX-License-Identifier: Apache-2.0 */
/* The messages of grpc.health.v1. */
#include "wire/messages.h"

#include <string.h>
#include "base/try.h"
#include "grpc/health/v1/health.pb-c.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"

#define SERVICE_MAX 255 /* bytes of a service name */

enum umb_status umbw_decode_health_request(const uint8_t *message, size_t size, char service[256],
                                           struct umb_error *error)
{
    static const struct umbw_field field = {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "service"};
    struct umbw_field_found found;
    service[0] = '\0';
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, NULL, error);
    return status == UMB_OK
               ? umbw_text_copy("service", found.bytes, found.size, SERVICE_MAX, service, error)
               : status;
}

enum umb_status umbw_decode_health_reply(const uint8_t *message, size_t size, int *serving_status,
                                         struct umb_error *error)
{
    static const struct umbw_field field = {1, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "status"};
    struct umbw_field_found found;
    struct umbw_scratch scratch;
    *serving_status = 0;
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, &scratch, error);
    ProtobufCMessage *reply = NULL;
    if (status == UMB_OK) {
        status = umbw_message_unpack(&grpc__health__v1__health_check_response__descriptor,
                                     scratch.bytes, scratch.size, &reply, error);
    }
    if (status == UMB_OK) {
        *serving_status = (int)((const Grpc__Health__V1__HealthCheckResponse *)reply)->status;
        umbw_message_free(reply);
    }
    return status;
}

enum umb_status umbw_encode_health_request(const char *service, struct umbw_buffer *buffer,
                                           struct umb_error *error)
{
    Grpc__Health__V1__HealthCheckRequest message = GRPC__HEALTH__V1__HEALTH_CHECK_REQUEST__INIT;
    char copy[SERVICE_MAX + 1];
    UMB__TRY(umbw_text_copy("service", (const uint8_t *)service, strlen(service), SERVICE_MAX, copy,
                            error));
    message.service = copy;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_encode_health_reply(int serving_status, struct umbw_buffer *buffer,
                                         struct umb_error *error)
{
    Grpc__Health__V1__HealthCheckResponse message = GRPC__HEALTH__V1__HEALTH_CHECK_RESPONSE__INIT;
    message.status = (Grpc__Health__V1__HealthCheckResponse__ServingStatus)serving_status;
    return umbw_message_append(&message.base, buffer, error);
}
