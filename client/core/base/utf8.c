/* SPDX-License-Identifier: Apache-2.0 */
/* UTF-8 checks, see utf8.h. */
#include "base/utf8.h"

#include <string.h>

/* Returns the length in bytes of a character of two to four bytes, or 0 if it is malformed. The
 * bounds of the second byte depend on the first (Unicode, table 3-7); the later bytes have fixed
 * bounds. */
static size_t multibyte_length(const uint8_t *bytes, size_t size)
{
    uint8_t first = bytes[0];
    uint8_t low = 0x80;
    uint8_t high = 0xbf;
    size_t length;
    if (first >= 0xc2 && first <= 0xdf) {
        length = 2;
    } else if (first >= 0xe0 && first <= 0xef) {
        length = 3;
        low = first == 0xe0 ? 0xa0 : low;
        high = first == 0xed ? 0x9f : high;
    } else if (first >= 0xf0 && first <= 0xf4) {
        length = 4;
        low = first == 0xf0 ? 0x90 : low;
        high = first == 0xf4 ? 0x8f : high;
    } else {
        return 0;
    }
    if (size < length || bytes[1] < low || bytes[1] > high) {
        return 0;
    }
    for (size_t i = 2; i < length; i++) {
        if ((bytes[i] & 0xc0) != 0x80) {
            return 0;
        }
    }
    return length;
}

size_t umb__utf8_length(const uint8_t *bytes, size_t size)
{
    if (size == 0) {
        return 0;
    }
    return bytes[0] < 0x80 ? 1 : multibyte_length(bytes, size);
}

bool umb__utf8_valid(const uint8_t *bytes, size_t size)
{
    size_t at = 0;
    while (at < size) {
        /* NUL is no character here, and multibyte_length refuses it. */
        const bool is_ascii = bytes[at] > 0 && bytes[at] < 0x80;
        const size_t length = is_ascii ? 1 : multibyte_length(bytes + at, size - at);
        if (length == 0) {
            return false;
        }
        at += length;
    }
    return true;
}

/* Returns true for control characters: C0 and DEL of one byte, C1 (U+0080 to U+009F) of two. */
static bool is_control(const uint8_t *bytes, size_t length)
{
    return (length == 1 && (bytes[0] < 0x20 || bytes[0] == 0x7f)) ||
           (length == 2 && bytes[0] == 0xc2 && bytes[1] < 0xa0);
}

size_t umb__utf8_printable(const uint8_t *bytes, size_t size, char *out, size_t capacity)
{
    size_t at = 0;
    while (at < size) {
        size_t length = umb__utf8_length(bytes + at, size - at);
        size_t needed = length == 0 ? 1 : length;
        if (needed >= capacity - at) {
            break;
        }
        if (length == 0) {
            out[at] = '?';
        } else if (is_control(bytes + at, length)) {
            memset(out + at, ' ', length);
        } else {
            memmove(out + at, bytes + at, length);
        }
        at += needed;
    }
    out[at] = '\0';
    return at;
}
