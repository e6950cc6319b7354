/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_CODEC_H
#define UMBRAGE_WIRE_CODEC_H
/* Helpers that the codecs share: guarded protobuf-c calls and checks of fields. */
#include <stddef.h>
#include <stdint.h>
#include <protobuf-c/protobuf-c.h>
#include "umbrage/asset.h"
#include "umbrage/status.h"
#include "wire/messages.h"

/*
 * Unpacks a message with protobuf-c under a memory limit.
 *
 * In:    descriptor: of the message type.
 * Out:   out: freed by the caller with umbw_message_free; NULL on failure.
 * Fails: E_ARGUMENT (not such a message), E_TOO_LARGE (more than UMBW_FIELDS_MAX unknown fields in
 *        it and its sub-messages; or it would expand to more than 1 MiB and 16 times its size, by
 *        hostile nesting of empty fields), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbw_message_unpack(const ProtobufCMessageDescriptor *descriptor,
                                                const uint8_t *bytes, size_t size,
                                                ProtobufCMessage **out, struct umb_error *error);
void umbw_message_free(ProtobufCMessage *message);

/* Appends the gRPC prefix and the packed message. Fails: E_TOO_LARGE, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbw_message_append(const ProtobufCMessage *message,
                                                struct umbw_buffer *buffer,
                                                struct umb_error *error);

/*
 * Checks a text field and copies it with a NUL.
 *
 * In:    name: of the field, for errors. bytes: uint8[size], NULL if absent. max: bytes.
 * Out:   out: char[max + 1].
 * Fails: E_ARGUMENT (too long, not UTF-8, a NUL inside).
 */
UMB_CHECKED enum umb_status umbw_text_copy(const char *name, const uint8_t *bytes, size_t size,
                                           size_t max, char *out, struct umb_error *error);

/* Checks and copies the name or id of an asset. Fails: E_ARGUMENT (as umbw_text_copy, or empty). */
UMB_CHECKED enum umb_status umbw_asset_copy(const uint8_t *bytes, size_t size,
                                            char out[UMBW_ASSET_NAME_MAX + 1],
                                            struct umb_error *error);

/* Copies a field of exactly 32 bytes. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbw_id_copy(const char *name, const uint8_t *bytes, size_t size,
                                         uint8_t out[UMB_ID_BYTES], struct umb_error *error);

/* Copies a repeated double of no (then zeros) or three elements. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbw_vector_copy(const char *name, const double *values, size_t count,
                                             double out[3], struct umb_error *error);

#endif
