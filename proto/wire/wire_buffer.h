/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_WIRE_BUFFER_H
#define UMBRAGE_WIRE_WIRE_BUFFER_H
/* The encoders' side of struct umbw_buffer (messages.h). */
#include "wire/messages.h"

/*
 * Makes room for `count` more bytes behind buffer->size; the caller writes them and adds to size.
 *
 * Fails: E_NO_MEMORY; the buffer is unchanged.
 */
UMB_CHECKED enum umb_status umbw_buffer_reserve(struct umbw_buffer *buffer, size_t count,
                                                struct umb_error *error);

/*
 * Appends the 5-byte gRPC prefix of a message of `message_size` bytes and makes room for `room`
 * bytes behind it (not more than the message; what is missing is sent by the caller).
 *
 * Fails: E_TOO_LARGE (over 4 GiB), E_NO_MEMORY; the buffer is unchanged.
 */
UMB_CHECKED enum umb_status umbw_buffer_begin_message(struct umbw_buffer *buffer,
                                                      uint64_t message_size, size_t room,
                                                      struct umb_error *error);

#endif
