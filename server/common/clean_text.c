/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Clean text (scene_text.h). The UTF-8 rules are those of RFC 3629: shortest form only, no
 * surrogates, nothing above U+10FFFF.
 */
#include "common/clean_text.h"

#include <stdint.h>
#include <string.h>

/* Length in bytes of the clean character that text starts with, or 0. */
static size_t clean_char(const char *text, size_t length)
{
    const unsigned char *byte = (const unsigned char *)text;
    if (byte[0] < 0x80) {
        return byte[0] >= 0x20 && byte[0] != 0x7f ? 1 : 0;
    }
    size_t count = byte[0] >= 0xf0 ? 4 : byte[0] >= 0xe0 ? 3 : 2;
    if (byte[0] < 0xc2 || byte[0] > 0xf4 || count > length) {
        return 0;
    }
    uint32_t code = (uint32_t)byte[0] & (0x7fU >> count);
    for (size_t i = 1; i < count; i++) {
        if ((byte[i] & 0xc0) != 0x80) {
            return 0;
        }
        code = code << 6 | (byte[i] & 0x3fU);
    }
    static const uint32_t least[5] = {0, 0, 0x80, 0x800, 0x10000};
    /* U+0080..U+009F are control characters too, and terminals obey them. */
    if (code < least[count] || code < 0xa0 || code > 0x10ffff ||
        (code >= 0xd800 && code < 0xe000)) {
        return 0;
    }
    return count;
}

void umbs_text_clean(char *out, size_t size, const char *text, size_t length)
{
    size_t used = 0;
    size_t at = 0;
    while (at < length && text[at] != '\0') {
        size_t count = clean_char(text + at, length - at);
        size_t width = count > 0 ? count : 1;
        if (used + width >= size) {
            break;
        }
        if (count > 0) {
            memcpy(out + used, text + at, count);
        } else {
            out[used] = '?';
        }
        used += width;
        at += width;
    }
    memset(out + used, 0, size - used);
}

int umbs_text_is_clean(const char *text, size_t length, int newlines)
{
    size_t at = 0;
    while (at < length) {
        if (newlines && text[at] == '\n') {
            at++;
            continue;
        }
        size_t count = clean_char(text + at, length - at);
        if (count == 0) {
            return 0;
        }
        at += count;
    }
    return 1;
}
