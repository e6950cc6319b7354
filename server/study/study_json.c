/* SPDX-License-Identifier: Apache-2.0 */
/* Strings in JSON output. File names may hold any bytes; the output is always valid UTF-8. */
#include "study/study_json.h"

#include <stddef.h>

/* Length of the well-formed UTF-8 sequence at s, or 0. Source: RFC 3629, section 4. */
static size_t sequence_length(const unsigned char *s)
{
    size_t count = 0;
    unsigned char low = 0x80, high = 0xbf; /* of the second byte */
    if (s[0] < 0x80) {
        return 1;
    }
    if (s[0] >= 0xc2 && s[0] <= 0xdf) {
        count = 2;
    } else if (s[0] >= 0xe0 && s[0] <= 0xef) {
        count = 3;
        low = s[0] == 0xe0 ? 0xa0 : low;
        high = s[0] == 0xed ? 0x9f : high;
    } else if (s[0] >= 0xf0 && s[0] <= 0xf4) {
        count = 4;
        low = s[0] == 0xf0 ? 0x90 : low;
        high = s[0] == 0xf4 ? 0x8f : high;
    } else {
        return 0;
    }
    if (s[1] < low || s[1] > high) {
        return 0;
    }
    for (size_t i = 2; i < count; i++) {
        if (s[i] < 0x80 || s[i] > 0xbf) {
            return 0; /* also at the final NUL, so that nothing behind it is read */
        }
    }
    return count;
}

void umbt_json_text(FILE *out, const char *text)
{
    const unsigned char *s = (const unsigned char *)text;
    fputc('"', out);
    while (*s != '\0') {
        const size_t length = sequence_length(s);
        if (length == 0) {
            fputs("\\ufffd", out);
            s++;
        } else if (*s == '"' || *s == '\\') {
            fprintf(out, "\\%c", *s++);
        } else if (*s < 0x20) {
            fprintf(out, "\\u%04x", *s++);
        } else {
            fwrite(s, 1, length, out);
            s += length;
        }
    }
    fputc('"', out);
}
