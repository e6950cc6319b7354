/* SPDX-License-Identifier: Apache-2.0 */
/* The growing byte buffer of the encoders. */
#include "wire/messages.h"

#include "base/try.h"

#include <stdlib.h>

void umbw_buffer_finish(struct umbw_buffer *buffer)
{
    free(buffer->bytes);
    buffer->bytes = NULL;
    buffer->size = 0;
    buffer->capacity = 0;
}

enum umb_status umbw_buffer_reserve(struct umbw_buffer *buffer, size_t count,
                                    struct umb_error *error)
{
    size_t needed;
    if (__builtin_add_overflow(buffer->size, count, &needed)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", count);
    }
    if (needed <= buffer->capacity) {
        return UMB_OK;
    }
    size_t capacity = buffer->capacity > SIZE_MAX / 2 ? needed : buffer->capacity * 2;
    if (capacity < needed) {
        capacity = needed;
    }
    uint8_t *bytes = realloc(buffer->bytes, capacity);
    if (bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", count);
    }
    buffer->bytes = bytes;
    buffer->capacity = capacity;
    return UMB_OK;
}

void umbw_prefix_write(uint64_t message_size, uint8_t bytes[UMBW_PREFIX_BYTES])
{
    bytes[0] = 0; /* not compressed */
    for (unsigned i = 0; i < 4; i++) {
        bytes[1 + i] = (uint8_t)(message_size >> (24 - 8 * i));
    }
}

enum umb_status umbw_buffer_begin_message(struct umbw_buffer *buffer, uint64_t message_size,
                                          size_t room, struct umb_error *error)
{
    if (message_size > UINT32_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: %llu bytes are over the limit of %lu bytes",
                        (unsigned long long)message_size, (unsigned long)UINT32_MAX);
    }
    if (room > SIZE_MAX - UMBW_PREFIX_BYTES) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", room);
    }
    UMB__TRY(umbw_buffer_reserve(buffer, UMBW_PREFIX_BYTES + room, error));
    umbw_prefix_write(message_size, buffer->bytes + buffer->size);
    buffer->size += UMBW_PREFIX_BYTES;
    return UMB_OK;
}
