/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbraged with grpc.testing.TestService, the service that the gRPC project's interop clients call.
 * It is in BUILD/interop/umbraged only, which is never shipped, and shows that the framing is that
 * of any gRPC server.
 */
#include <stdlib.h>
#include <string.h>

#include "daemon/daemon.h"
#include "daemon/service/services.h"
#include "interop_test.pb-c.h"

#define SIZE_MAX_BYTES (16 << 20) /* of one payload that a client may order */

#define ECHO_INITIAL  "x-grpc-test-echo-initial"
#define ECHO_TRAILING "x-grpc-test-echo-trailing-bin"

/* State of a call. */
struct echo {
    char initial[256],
        trailing[256]; /* Metadata that the client wants back, as it came; "" = none */
    int32_t total;     /* Bytes that came in a StreamingInputCall */
};

/* Returns the call's state, made at the first use; NULL: out of memory. */
static struct echo *echo_of(struct umbd_call *call)
{
    if (call->state == NULL) {
        call->state = calloc(1, sizeof(struct echo));
    }
    return call->state;
}

static void close_call(struct umbd_call *call)
{
    free(call->state);
}

static int is_name(const char *bytes, size_t size, const char *name)
{
    return size == strlen(name) && memcmp(bytes, name, size) == 0;
}

static void take_header(struct umbd_call *call, const char *name, size_t name_size,
                        const char *value, size_t value_size)
{
    const int is_initial = is_name(name, name_size, ECHO_INITIAL);
    if ((is_initial || is_name(name, name_size, ECHO_TRAILING)) && echo_of(call) != NULL &&
        value_size < sizeof echo_of(call)->initial) {
        char *to = is_initial ? echo_of(call)->initial : echo_of(call)->trailing;
        memcpy(to, value, value_size);
        to[value_size] = '\0';
    }
}

static void give_field(const struct umbd_call *call, int is_trailer, const char **name,
                       const char **value)
{
    const struct echo *echo = call->state;
    const char *text = echo == NULL ? "" : is_trailer ? echo->trailing : echo->initial;
    if (text[0] != '\0') {
        *name = is_trailer ? ECHO_TRAILING : ECHO_INITIAL;
        *value = text;
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

/* Fails the call if the client asks for that; returns 1 if it did. */
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

static void serve_empty(struct umbd_call *call)
{
    Grpc__Testing__Empty empty = GRPC__TESTING__EMPTY__INIT;
    reply(call, &empty.base);
}

static void serve_unary(struct umbd_call *call)
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

static void serve_input(struct umbd_call *call)
{
    Grpc__Testing__StreamingInputCallRequest *request =
        grpc__testing__streaming_input_call_request__unpack(NULL, call->message_size,
                                                            call->message);
    if (request == NULL) {
        bad_request(call);
        return;
    }
    if (echo_of(call) != NULL && request->payload != NULL) {
        echo_of(call)->total += (int32_t)request->payload->body.len;
    }
    grpc__testing__streaming_input_call_request__free_unpacked(request, NULL);
}

static void end_input(struct umbd_call *call)
{
    Grpc__Testing__StreamingInputCallResponse answer =
        GRPC__TESTING__STREAMING_INPUT_CALL_RESPONSE__INIT;
    answer.aggregated_payload_size = echo_of(call) != NULL ? echo_of(call)->total : -1;
    reply(call, &answer.base);
}

static void serve_duplex(struct umbd_call *call)
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

static void serve_output(struct umbd_call *call)
{
    serve_duplex(call);
    umbd_call_finish(call);
}

#define OF_SERVICE                                                                                 \
    .scope = UMBD_SCOPE_QUERY, .header = take_header, .field = give_field, .close = close_call

static const struct umbd_method own[] = {
    {.path = "/grpc.testing.TestService/EmptyCall", .serve = serve_empty, OF_SERVICE},
    {.path = "/grpc.testing.TestService/UnaryCall", .serve = serve_unary, OF_SERVICE},
    {.path = "/grpc.testing.TestService/StreamingInputCall",
     .kind = UMBD_CLIENT_STREAM,
     .price = UMBD_PRICE_REQUEST,
     .serve = serve_input,
     .end = end_input,
     OF_SERVICE},
    {.path = "/grpc.testing.TestService/StreamingOutputCall",
     .kind = UMBD_SERVER_STREAM,
     .serve = serve_output,
     OF_SERVICE},
    {.path = "/grpc.testing.TestService/FullDuplexCall",
     .kind = UMBD_BIDI_STREAM,
     .price = UMBD_PRICE_REQUEST,
     .serve = serve_duplex,
     OF_SERVICE},
};

/* Serves these methods, and the daemon's own. */
int main(int argc, char **argv)
{
    static struct umbd_method all[UMBD_METHODS_MAX];
    const size_t count = sizeof own / sizeof own[0];
    memcpy(all, own, sizeof own);
    for (size_t i = 0; umbd_methods[i].path != NULL && count + i < UMBD_METHODS_MAX - 1; i++) {
        all[count + i] = umbd_methods[i];
    }
    return umbd_run(argc, argv, all);
}
