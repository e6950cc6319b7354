/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_INTEROP_SERVICE_H
#define UMBRAGE_TESTS_INTEROP_SERVICE_H
/*
 * grpc.testing.TestService, which the gRPC project's interop clients ask: only in
 * BUILD/interop/umbraged, to show that the framing is any gRPC server's. Never shipped.
 */
#include <nghttp2/nghttp2.h>
#include <stddef.h>
#include <stdint.h>

struct umbd_call;

/* Metadata that the client wants back, as it came. */
struct umbd_echo {
    char initial[256], trailing[256]; /* "" = none */
    int32_t total;                    /* bytes that came in a StreamingInputCall */
};

#define UMBD_ECHO_INITIAL  "x-grpc-test-echo-initial"
#define UMBD_ECHO_TRAILING "x-grpc-test-echo-trailing-bin"

void umbd_interop_header(struct umbd_echo *echo, const uint8_t *name, size_t name_size,
                         const uint8_t *value, size_t value_size);

/* Service entry points, as those of call.h. */
void umbd_interop_empty(struct umbd_call *call);
void umbd_interop_unary(struct umbd_call *call);
void umbd_interop_input(struct umbd_call *call);
void umbd_interop_input_end(struct umbd_call *call);
void umbd_interop_output(struct umbd_call *call);
void umbd_interop_duplex(struct umbd_call *call);

#endif
