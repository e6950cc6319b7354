/* SPDX-License-Identifier: Apache-2.0 */
/* grpc.testing.TestService of the test build. */
#include "interop_service.h"

#include <stdlib.h>
#include <string.h>

#include "daemon/call/call.h"
#include "interop_test.pb-c.h"

#define SIZE_MAX_BYTES (16 << 20) /* of one payload that a client may order */

static int is_name(const uint8_t *bytes, size_t size, const char *name)
{
    return size == strlen(name) && memcmp(bytes, name, size) == 0;
}

void umbd_interop_header(struct umbd_echo *echo, const uint8_t *name, size_t name_size,
                         const uint8_t *value, size_t value_size)
{
    char *to = is_name(name, name_size, UMBD_ECHO_INITIAL)    ? echo->initial
               : is_name(name, name_size, UMBD_ECHO_TRAILING) ? echo->trailing
                                                              : NULL;
    if (to != NULL && value_size < sizeof echo->initial) {
        memcpy(to, value, value_size);
        to[value_size] = '\0';
    }
}

/* Sends a message. */
static void reply(struct umbd_call *call, const ProtobufCMessage *message)
{
    size_t size = protobuf_c_message_get_packed_size(message);
    uint8_t *to = umbd_call_reserve(call, UMBW_PREFIX_BYTES + size);
    if (to != NULL) {
        to[0] = 0;
        for (size_t i = 0; i < 4; i++) {
            to[1 + i] = (uint8_t)(size >> (24 - 8 * i));
        }
        protobuf_c_message_pack(message, to + UMBW_PREFIX_BYTES);
        umbd_call_commit(call, UMBW_PREFIX_BYTES + size);
    }
}

/* Fails the call as the client wishes; returns 1 if it did. */
static int fails(struct umbd_call *call, const Grpc__Testing__EchoStatus *status)
{
    if (status == NULL || status->code == 0) {
        return 0;
    }
    umbd_call_fail(call, status->code > 0 && status->code < 17 ? status->code : UMBW_GRPC_UNKNOWN,
                   status->message);
    return 1;
}

static void bad_request(struct umbd_call *call)
{
    umbd_call_fail(call, UMBW_GRPC_INVALID_ARGUMENT, "request: no such message");
}

static uint8_t *zeros(struct umbd_call *call, int32_t size)
{
    uint8_t *bytes = size >= 0 && size <= SIZE_MAX_BYTES ? calloc(1, (size_t)size + 1) : NULL;
    if (bytes == NULL) {
        umbd_call_fail(call, UMBW_GRPC_INVALID_ARGUMENT, "response_size: 0 to 16 MiB");
    }
    return bytes;
}

void umbd_interop_empty(struct umbd_call *call)
{
    Grpc__Testing__Empty empty = GRPC__TESTING__EMPTY__INIT;
    reply(call, &empty.base);
}

void umbd_interop_unary(struct umbd_call *call)
{
    Grpc__Testing__SimpleRequest *request =
        grpc__testing__simple_request__unpack(NULL, call->message_size, call->message);
    Grpc__Testing__SimpleResponse answer = GRPC__TESTING__SIMPLE_RESPONSE__INIT;
    Grpc__Testing__Payload payload = GRPC__TESTING__PAYLOAD__INIT;
    if (request == NULL) {
        bad_request(call);
        return;
    }
    if (!fails(call, request->response_status)) {
        uint8_t *bytes = zeros(call, request->response_size);
        if (bytes != NULL) {
            payload.body = (ProtobufCBinaryData){(size_t)request->response_size, bytes};
            answer.payload = &payload;
            reply(call, &answer.base);
            free(bytes);
        }
    }
    grpc__testing__simple_request__free_unpacked(request, NULL);
}

void umbd_interop_input(struct umbd_call *call)
{
    Grpc__Testing__StreamingInputCallRequest *request =
        grpc__testing__streaming_input_call_request__unpack(NULL, call->message_size,
                                                            call->message);
    if (request == NULL) {
        bad_request(call);
        return;
    }
    call->echo.total += request->payload != NULL ? (int32_t)request->payload->body.len : 0;
    grpc__testing__streaming_input_call_request__free_unpacked(request, NULL);
}

void umbd_interop_input_end(struct umbd_call *call)
{
    Grpc__Testing__StreamingInputCallResponse answer =
        GRPC__TESTING__STREAMING_INPUT_CALL_RESPONSE__INIT;
    answer.aggregated_payload_size = call->echo.total;
    reply(call, &answer.base);
}

void umbd_interop_duplex(struct umbd_call *call)
{
    Grpc__Testing__StreamingOutputCallRequest *request =
        grpc__testing__streaming_output_call_request__unpack(NULL, call->message_size,
                                                             call->message);
    Grpc__Testing__StreamingOutputCallResponse answer =
        GRPC__TESTING__STREAMING_OUTPUT_CALL_RESPONSE__INIT;
    Grpc__Testing__Payload payload = GRPC__TESTING__PAYLOAD__INIT;
    if (request == NULL) {
        bad_request(call);
        return;
    }
    answer.payload = &payload;
    int failed = fails(call, request->response_status);
    for (size_t i = 0; !failed && i < request->n_response_parameters; i++) {
        int32_t size = request->response_parameters[i]->size;
        uint8_t *bytes = zeros(call, size);
        failed = bytes == NULL;
        if (!failed) {
            payload.body = (ProtobufCBinaryData){(size_t)size, bytes};
            reply(call, &answer.base);
            free(bytes);
        }
    }
    grpc__testing__streaming_output_call_request__free_unpacked(request, NULL);
}

void umbd_interop_output(struct umbd_call *call)
{
    umbd_interop_duplex(call);
    umbd_call_finish(call);
}
