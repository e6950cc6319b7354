/* SPDX-License-Identifier: Apache-2.0 */
/* One UTF-8 check, two ways to write what it finds. */
#include "bake/print_text.h"

#include <string.h>

/* Bytes of the well-formed UTF-8 character at text (Unicode 15, table 3-7); 0 if it is none. */
static size_t character_length(const char *text)
{
    const unsigned char *b = (const unsigned char *)text;
    if (b[0] < 0x80) {
        return b[0] != 0;
    }
    const size_t length = b[0] >= 0xc2 && b[0] <= 0xdf   ? 2
                          : b[0] >= 0xe0 && b[0] <= 0xef ? 3
                          : b[0] >= 0xf0 && b[0] <= 0xf4 ? 4
                                                         : 0;
    for (size_t i = 1; i < length; i++) {
        if ((b[i] & 0xc0) != 0x80) { /* also a NUL */
            return 0;
        }
    }
    const int bad = (b[0] == 0xe0 && b[1] < 0xa0) || (b[0] == 0xed && b[1] > 0x9f) ||
                    (b[0] == 0xf0 && b[1] < 0x90) || (b[0] == 0xf4 && b[1] > 0x8f);
    return bad ? 0 : length;
}

void umbb_escape(const char *text, char *out, size_t size)
{
    static const char digits[] = "0123456789abcdef";
    size_t used = 0;
    while (*text != '\0') {
        const unsigned char byte = (unsigned char)*text;
        const size_t length = character_length(text);
        const int plain = length > 0 && byte >= 0x20 && byte != 0x7f && byte != '"' &&
                          byte != '\\' && !(byte == 0xc2 && (unsigned char)text[1] < 0xa0);
        const size_t needed = plain ? length : 4;
        if (used + needed >= size) {
            break;
        }
        if (plain) {
            memcpy(out + used, text, length);
            text += length;
        } else {
            out[used] = '\\';
            out[used + 1] = 'x';
            out[used + 2] = digits[byte >> 4];
            out[used + 3] = digits[byte & 15];
            text++;
        }
        used += needed;
    }
    out[used] = '\0';
}

void umbb_json_string(FILE *to, const char *text)
{
    fputc('"', to);
    while (*text != '\0') {
        const unsigned char byte = (unsigned char)*text;
        const size_t length = character_length(text);
        if (length == 0) {
            fputs("\\ufffd", to);
        } else if (byte == '"' || byte == '\\') {
            fprintf(to, "\\%c", byte);
        } else if (byte < 0x20) {
            fprintf(to, "\\u%04x", byte);
        } else {
            fwrite(text, 1, length, to);
        }
        text += length == 0 ? 1 : length;
    }
    fputc('"', to);
}
