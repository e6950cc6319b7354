/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_DESCRIPTOR_SET_H
#define UMBRAGE_WIRE_DESCRIPTOR_SET_H
/* The descriptors of the .proto files, made by the build: a google.protobuf.FileDescriptorSet. */
#include <stddef.h>
#include <stdint.h>

extern const uint8_t umbw__descriptor_set[];
extern const size_t umbw__descriptor_set_bytes;

#endif
