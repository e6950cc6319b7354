/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_REFLECTION_H
#define UMBRAGE_WIRE_REFLECTION_H
/* grpc.reflection.v1 and v1alpha, whose messages have the same bytes. */
#include "wire/messages.h"

/* The descriptors of the .proto files, a google.protobuf.FileDescriptorSet made by the build. */
extern const uint8_t umbw__descriptor_set[];
extern const size_t umbw__descriptor_set_bytes;

#define UMBW_PATH_REFLECTION       "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo"
#define UMBW_PATH_REFLECTION_ALPHA "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"

/*
 * Answers one ServerReflectionRequest: appends prefix and message to buffer. A missing symbol or
 * file is an error within the answer, as the protocol requires.
 *
 * Fails: E_ARGUMENT (not such a message), E_TOO_LARGE, E_NO_MEMORY. Trust: safe on hostile bytes.
 * Cost:  one walk over the descriptors, some 10 kB.
 */
UMB_CHECKED enum umb_status umbw_reflection_answer(const uint8_t *message, size_t size,
                                                   struct umbw_buffer *buffer,
                                                   struct umb_error *error);

#endif
