/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The reader of length-prefixed gRPC messages, see grpc.h.
 *
 * Invariants: prefix_bytes < 5 between messages and while a prefix is incomplete; once it is 5,
 * message_size <= max_message and received < message_size.
 *
 * Memory grows with the received bytes: it at most doubles, or grows to 1 MiB after 16 KiB. Memory
 * never follows the declared length alone, so a false length gains a peer nothing. A message that
 * is complete in one piece of input is passed on without a copy.
 */
#include "grpc/grpc.h"

#include <stdlib.h>
#include <string.h>

#include "base/try.h"

#define FIRST_CAPACITY 4096 /* bytes of the first allocation */
#define AHEAD_FROM                                                                                 \
    (16 << 10) /* Bytes received before room for a usual message is allocated at
                                     once */
#define AHEAD_CAPACITY (1 << 20)

void umbw_reader_init(struct umbw_reader *reader, size_t max_message)
{
    memset(reader, 0, sizeof *reader);
    reader->max_message = max_message;
}

/* Completes the prefix from the input; returns the bytes taken. */
static size_t take_prefix(struct umbw_reader *reader, const uint8_t *bytes, size_t count)
{
    size_t wanted = sizeof reader->prefix - reader->prefix_bytes;
    size_t taken = count < wanted ? count : wanted;
    memcpy(reader->prefix + reader->prefix_bytes, bytes, taken);
    reader->prefix_bytes += (unsigned)taken;
    return taken;
}

static enum umb_status check_prefix(struct umbw_reader *reader, struct umb_error *error)
{
    const uint8_t *p = reader->prefix;
    if (p[0] > 1) {
        return umb_fail(error, UMB_E_PROTOCOL,
                        "message prefix: compressed flag is %u, must be 0 or 1", (unsigned)p[0]);
    }
    reader->compressed = p[0];
    reader->message_size =
        (uint32_t)p[1] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 8 | (uint32_t)p[4];
    if (reader->message_size > reader->max_message) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: %lu bytes are over the limit of %zu bytes",
                        (unsigned long)reader->message_size, reader->max_message);
    }
    return UMB_OK;
}

static enum umb_status reserve(struct umbw_reader *reader, size_t needed, struct umb_error *error)
{
    if (needed <= reader->capacity) {
        return UMB_OK;
    }
    size_t capacity = reader->capacity == 0 ? FIRST_CAPACITY : reader->capacity;
    if (needed >= AHEAD_FROM && capacity < AHEAD_CAPACITY) {
        capacity = AHEAD_CAPACITY; /* cut to the message's size below */
    }
    while (capacity < needed) {
        capacity = capacity > SIZE_MAX / 2 ? needed : capacity * 2;
    }
    if (capacity > reader->message_size) {
        capacity = reader->message_size; /* needed never exceeds it */
    }
    uint8_t *message = realloc(reader->message, capacity);
    if (message == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %lu bytes",
                        (unsigned long)reader->message_size);
    }
    reader->message = message;
    reader->capacity = capacity;
    return UMB_OK;
}

/* Starts with the next prefix; keeps the memory for the next message. */
static void next_message(struct umbw_reader *reader)
{
    reader->prefix_bytes = 0;
    reader->received = 0;
}

/* Takes bytes of a message's body. Out: *taken: number of bytes taken, even if the callback stops
 * the feed. */
static enum umb_status take_body(struct umbw_reader *reader, const uint8_t *bytes, size_t count,
                                 size_t *taken, umbw_message_fn on_message, void *user,
                                 struct umb_error *error)
{
    size_t missing = reader->message_size - reader->received;
    *taken = count < missing ? count : missing;
    if (reader->received == 0 && *taken == missing) {
        next_message(reader);
        return on_message(user, bytes, missing, reader->compressed);
    }
    UMB__TRY(reserve(reader, reader->received + *taken, error));
    if (bytes != reader->message + reader->received) { /* Else read in place: umbw_reader_room */
        memcpy(reader->message + reader->received, bytes, *taken);
    }
    reader->received += *taken;
    if (*taken < missing) {
        return UMB_OK;
    }
    next_message(reader);
    return on_message(user, reader->message, reader->message_size, reader->compressed);
}

enum umb_status umbw_reader_feed(struct umbw_reader *reader, const uint8_t *bytes, size_t count,
                                 umbw_message_fn on_message, void *user, struct umb_error *error)
{
    /* The loop ends: each turn takes at least one byte, or completes a message whose prefix took
     * five. */
    size_t at = 0;
    while (at < count) {
        enum umb_status status;
        if (reader->prefix_bytes < sizeof reader->prefix) {
            at += take_prefix(reader, bytes + at, count - at);
            if (reader->prefix_bytes < sizeof reader->prefix) {
                return UMB_OK;
            }
            UMB__TRY(check_prefix(reader, error));
            if (at == count && reader->message_size > 0) {
                return UMB_OK;
            }
        }
        size_t taken = 0;
        status = take_body(reader, bytes + at, count - at, &taken, on_message, user, error);
        at += taken;
        if (status != UMB_OK) {
            return status;
        }
    }
    return UMB_OK;
}

size_t umbw_reader_room(struct umbw_reader *reader, size_t most, uint8_t **place)
{
    if (reader->prefix_bytes < sizeof reader->prefix || reader->received < AHEAD_FROM) {
        return 0;
    }
    size_t missing = reader->message_size - reader->received;
    size_t room = missing < most ? missing : most;
    /* The bytes received so far limit the room. */
    size_t ahead = reader->received > AHEAD_CAPACITY ? reader->received : AHEAD_CAPACITY;
    room = room < ahead ? room : ahead;
    if (reserve(reader, reader->received + room, NULL) != UMB_OK) {
        return 0;
    }
    *place = reader->message + reader->received;
    return room;
}

int umbw_reader_at_boundary(const struct umbw_reader *reader)
{
    return reader->prefix_bytes == 0;
}

void umbw_reader_finish(struct umbw_reader *reader)
{
    free(reader->message);
    reader->message = NULL;
    reader->capacity = 0;
    reader->received = 0;
    reader->prefix_bytes = 0;
}
