/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The texts of gRPC's headers: code names, grpc-timeout values, grpc-message escapes.
 *
 * Source: "gRPC over HTTP2" (PROTOCOL-HTTP2.md): timeouts are 1 to 8 digits and a unit; a status
 * message is UTF-8 with every byte outside 0x20..0x7e and '%' percent-encoded.
 */
#include "grpc/grpc.h"

#include <stdio.h>
#include <string.h>
#include "base/bytes.h"
#include "base/utf8.h"

#define TIMEOUT_DIGITS_MAX 8
#define TIMEOUT_VALUE_MAX  99999999 /* eight digits */

struct timeout_unit {
    char letter;
    int64_t nanoseconds;
};

/* Units of a timeout, the finest first: formatting uses the first unit in which the value has at
 * most eight digits. */
static const struct timeout_unit TIMEOUT_UNITS[] = {
    {'n', 1},
    {'u', 1000},
    {'m', 1000000},
    {'S', 1000000000},
    {'M', 60 * (int64_t)1000000000},
    {'H', 3600 * (int64_t)1000000000},
};
#define TIMEOUT_UNIT_COUNT (sizeof TIMEOUT_UNITS / sizeof TIMEOUT_UNITS[0])

#define SENT_MOST 4 /* Most statuses that are sent as one code */

/* Rows by gRPC code: the code's name, the status that a client reports for it, and the statuses
 * that a server sends as that code. */
static const struct {
    const char *name;
    enum umb_status received;
    enum umb_status sent[SENT_MOST]; /* UMB_OK ends the list */
} CODES[] = {
    {"OK", UMB_OK, {UMB_OK}},
    {"CANCELLED", UMB_E_CANCELLED, {UMB_E_CANCELLED}},
    {"UNKNOWN", UMB_E_INTERNAL, {UMB_OK}},
    {"INVALID_ARGUMENT", UMB_E_ARGUMENT, {UMB_E_ARGUMENT, UMB_E_BAD_SCENE}},
    {"DEADLINE_EXCEEDED", UMB_E_DEADLINE, {UMB_E_DEADLINE}},
    {"NOT_FOUND", UMB_E_NOT_FOUND, {UMB_E_NOT_FOUND, UMB_E_NO_INPUT}},
    {"ALREADY_EXISTS", UMB_E_EXISTS, {UMB_E_EXISTS}},
    {"PERMISSION_DENIED", UMB_E_PERMISSION, {UMB_E_PERMISSION}},
    {"RESOURCE_EXHAUSTED",
     UMB_E_TOO_LARGE,
     {UMB_E_TOO_LARGE, UMB_E_NO_MEMORY, UMB_E_BUSY, UMB_E_LIMIT}},
    {"FAILED_PRECONDITION", UMB_E_STATE, {UMB_E_STATE}},
    {"ABORTED", UMB_E_STATE, {UMB_OK}},
    {"OUT_OF_RANGE", UMB_E_ARGUMENT, {UMB_OK}},
    {"UNIMPLEMENTED", UMB_E_UNSUPPORTED, {UMB_E_UNSUPPORTED, UMB_E_VERSION}},
    {"INTERNAL", UMB_E_INTERNAL, {UMB_E_INTERNAL, UMB_E_IO, UMB_E_CANNOT_CREATE, UMB_E_PROTOCOL}},
    {"UNAVAILABLE", UMB_E_UNAVAILABLE, {UMB_E_UNAVAILABLE}},
    {"DATA_LOSS", UMB_E_CORRUPT, {UMB_E_CORRUPT, UMB_E_FORMAT, UMB_E_TRUNCATED}},
    {"UNAUTHENTICATED", UMB_E_UNAUTHENTICATED, {UMB_E_UNAUTHENTICATED}},
};
#define CODE_COUNT ((int)(sizeof CODES / sizeof CODES[0]))

const char *umbw_grpc_name(int code)
{
    return code >= 0 && code < CODE_COUNT ? CODES[code].name : "UNRECOGNISED";
}

enum umb_status umbw_grpc_status(int code)
{
    return code >= 0 && code < CODE_COUNT ? CODES[code].received : UMB_E_PROTOCOL;
}

int umbw_grpc_code(enum umb_status status)
{
    for (int code = 0; status != UMB_OK && code < CODE_COUNT; code++) {
        for (int i = 0; i < SENT_MOST; i++) {
            if (CODES[code].sent[i] == status) {
                return code;
            }
        }
    }
    return status == UMB_OK ? UMBW_GRPC_OK : UMBW_GRPC_UNKNOWN;
}

enum umb_status umbw_timeout_parse(const char *text, size_t size, int64_t *nanoseconds)
{
    *nanoseconds = 0;
    if (size < 2 || size > TIMEOUT_DIGITS_MAX + 1) {
        return UMB_E_ARGUMENT;
    }
    int64_t value = 0;
    for (size_t i = 0; i + 1 < size; i++) {
        if (text[i] < '0' || text[i] > '9') {
            return UMB_E_ARGUMENT;
        }
        value = value * 10 + (text[i] - '0');
    }
    for (size_t i = 0; i < TIMEOUT_UNIT_COUNT; i++) {
        if (TIMEOUT_UNITS[i].letter == text[size - 1]) {
            if (__builtin_mul_overflow(value, TIMEOUT_UNITS[i].nanoseconds, nanoseconds)) {
                *nanoseconds = INT64_MAX;
            }
            return UMB_OK;
        }
    }
    return UMB_E_ARGUMENT;
}

size_t umbw_timeout_format(int64_t nanoseconds, char text[16])
{
    if (nanoseconds < 0) {
        nanoseconds = 0;
    }
    size_t unit = 0;
    int64_t value = nanoseconds;
    /* INT64_MAX ns are 2562048 hours, so the last unit always fits. */
    while (value > TIMEOUT_VALUE_MAX && unit + 1 < TIMEOUT_UNIT_COUNT) {
        unit++;
        int64_t step = TIMEOUT_UNITS[unit].nanoseconds;
        value = nanoseconds / step + (nanoseconds % step != 0);
    }
    return (size_t)snprintf(text, 16, "%lld%c", (long long)value, TIMEOUT_UNITS[unit].letter);
}

/* Writes the escaped form of one character, at most 12 bytes. */
static size_t escape_character(const uint8_t *bytes, size_t count, char out[12])
{
    static const char digits[] = "0123456789ABCDEF";
    size_t length = 0;
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] >= 0x20 && bytes[i] <= 0x7e && bytes[i] != '%') {
            out[length++] = (char)bytes[i];
        } else {
            out[length++] = '%';
            out[length++] = digits[bytes[i] >> 4];
            out[length++] = digits[bytes[i] & 15];
        }
    }
    return length;
}

size_t umbw_message_escape(const char *message, char *text, size_t capacity)
{
    static const uint8_t replacement[] = {0xef, 0xbf, 0xbd}; /* U+FFFD */
    if (capacity == 0) {
        return 0;
    }
    const uint8_t *bytes = (const uint8_t *)message;
    size_t size = strlen(message);
    size_t at = 0;
    size_t written = 0;
    while (at < size) {
        char escaped[12];
        size_t taken = umb__utf8_length(bytes + at, size - at);
        size_t length = taken == 0 ? escape_character(replacement, sizeof replacement, escaped)
                                   : escape_character(bytes + at, taken, escaped);
        if (length >= capacity - written) {
            break;
        }
        memcpy(text + written, escaped, length);
        written += length;
        at += taken == 0 ? 1 : taken;
    }
    text[written] = '\0';
    return written;
}

/* Returns the value of the escape at text, or -1 if there is no valid escape. An escaped NUL counts
 * as invalid, because the text would end there. */
static int escape_value(const char *text, size_t size)
{
    if (size < 3 || text[0] != '%') {
        return -1;
    }
    int high = umb__hex_value(text[1]);
    int low = umb__hex_value(text[2]);
    if (high < 0 || low < 0 || high + low == 0) {
        return -1;
    }
    return high * 16 + low;
}

size_t umbw_message_unescape(const char *text, size_t size, char *message, size_t capacity)
{
    if (capacity == 0) {
        return 0;
    }
    size_t written = 0;
    size_t at = 0;
    while (at < size && written + 1 < capacity) {
        int value = escape_value(text + at, size - at);
        message[written++] = value < 0 ? text[at] : (char)value;
        at += value < 0 ? 1 : 3;
    }
    if (at < size) {
        /* Drops the beginning of a character that was cut off. */
        size_t back = 0;
        while (back < 3 && back < written &&
               ((uint8_t)message[written - 1 - back] & 0xc0) == 0x80) {
            back++;
        }
        if (back < written && (uint8_t)message[written - 1 - back] >= 0xc0 &&
            umb__utf8_length((const uint8_t *)message + written - 1 - back, back + 1) == 0) {
            written -= back + 1;
        }
    }
    message[written] = '\0';
    return written;
}
