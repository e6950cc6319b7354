/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_GRPC_GRPC_H
#define UMBRAGE_GRPC_GRPC_H
/*
 * gRPC framing without I/O: message prefixes, timeouts, status messages. This part has pure
 * functions and one small state machine. HTTP/2 is in the folders rpc and daemon, which use
 * nghttp2.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

enum umbw_grpc_code {
    UMBW_GRPC_OK = 0,
    UMBW_GRPC_CANCELLED = 1,
    UMBW_GRPC_UNKNOWN = 2,
    UMBW_GRPC_INVALID_ARGUMENT = 3,
    UMBW_GRPC_DEADLINE_EXCEEDED = 4,
    UMBW_GRPC_NOT_FOUND = 5,
    UMBW_GRPC_PERMISSION_DENIED = 7,
    UMBW_GRPC_RESOURCE_EXHAUSTED = 8,
    UMBW_GRPC_FAILED_PRECONDITION = 9,
    UMBW_GRPC_UNIMPLEMENTED = 12,
    UMBW_GRPC_INTERNAL = 13,
    UMBW_GRPC_UNAVAILABLE = 14,
    UMBW_GRPC_DATA_LOSS = 15,
    UMBW_GRPC_UNAUTHENTICATED = 16,
};

/* Returns the name of a code ("NOT_FOUND"), never NULL. */
const char *umbw_grpc_name(int code);

/* Returns the code that a status is sent as. */
int umbw_grpc_code(enum umb_status status);

/*
 * Returns the umb_status for a gRPC code from a server; E_PROTOCOL for codes above 16.
 * RESOURCE_EXHAUSTED gives E_TOO_LARGE, since a retry would not help. With the trailer
 * grpc-retry-pushback-ms RESOURCE_EXHAUSTED means E_BUSY; libumbrage handles that case.
 */
enum umb_status umbw_grpc_status(int code);

/*
 * Parses a grpc-timeout value: 1 to 8 digits and one of H M S m u n.
 * Out:   nanoseconds: saturated at INT64_MAX; 0 means already expired.
 * Fails: E_ARGUMENT.
 */
UMB_CHECKED enum umb_status umbw_timeout_parse(const char *text, size_t size, int64_t *nanoseconds);

/* Writes a grpc-timeout value (rounded up, at most 8 digits) and returns its length. */
size_t umbw_timeout_format(int64_t nanoseconds, char text[16]);

/*
 * Percent-encodes a status message: bytes outside 0x20..0x7e and '%' become %XX; invalid UTF-8
 * becomes U+FFFD. Returns the length written, cut at a character that fits; always NUL-terminated.
 */
size_t umbw_message_escape(const char *message, char *text, size_t capacity);

/* Decodes an escaped status message; bad escapes stay as they are. */
size_t umbw_message_unescape(const char *text, size_t size, char *message, size_t capacity);

/*
 * Collects the messages of one direction of one call from DATA bytes, however they are split. Life:
 * umbw_reader_init, umbw_reader_feed for all bytes in their order, umbw_reader_finish.
 */
struct umbw_reader {
    uint8_t prefix[5];
    unsigned prefix_bytes;
    int compressed;        /* flag of the current message */
    uint32_t message_size; /* Length of the current message, valid once prefix_bytes == 5 */
    uint8_t *message;      /* Buffer for the message; it grows with the received bytes and is never
                              sized by the declared length alone */
    size_t received, capacity;
    size_t max_message;
};

/* Callback for each whole message, which is borrowed during the call. A status other than UMB_OK
 * stops the feed. */
typedef enum umb_status (*umbw_message_fn)(void *user, const uint8_t *message, size_t size,
                                           int compressed);

void umbw_reader_init(struct umbw_reader *reader, size_t max_message);

/*
 * Feeds bytes to a reader. Fails: E_TOO_LARGE when a prefix declares an over-long message (no byte
 * of that message is stored), E_NO_MEMORY, E_PROTOCOL (flag above 1), or the callback's status.
 */
UMB_CHECKED enum umb_status umbw_reader_feed(struct umbw_reader *reader, const uint8_t *bytes,
                                             size_t count, umbw_message_fn on_message, void *user,
                                             struct umb_error *error);

/*
 * Returns how many bytes of the current message a read may put at *place. Bytes read to that place
 * and then fed are not copied. The number is 0 between messages, near a message's beginning, and
 * without memory.
 *
 * In:    most: largest number to return. The number never exceeds the rest of the message.
 * Out:   place: valid until the reader is fed or finished.
 */
size_t umbw_reader_room(struct umbw_reader *reader, size_t most, uint8_t **place);

/* Returns 1 if the stream may end here, 0 inside a message. */
int umbw_reader_at_boundary(const struct umbw_reader *reader);
void umbw_reader_finish(struct umbw_reader *reader);

/* --- compressed messages (gunzip.c): grpc-encoding gzip, each message a stream of its own --- */

/* Most bytes of a decompressed message. A server decompresses between other work, at about 200 MB a
 * second, and points hardly compress. Clients with more data send the message uncompressed. */
#define UMBW_GUNZIP_MAX ((size_t)4 << 20)

/*
 * Inflates a message.
 *
 * In:    max: most bytes of the result; UMBW_GUNZIP_MAX if that is less.
 * Out:   out: malloc, free() it; NULL on failure.
 * Fails: E_TOO_LARGE, E_ARGUMENT (not one whole gzip stream), E_NO_MEMORY.
 * Trust: safe on hostile bytes. A stream that states too large a size is refused before it is
 *        inflated; one that holds more or less than it states is refused as soon as this is found.
 */
UMB_CHECKED enum umb_status umbw_gunzip(const uint8_t *bytes, size_t size, size_t max,
                                        uint8_t **out, size_t *out_size, struct umb_error *error);

#endif
