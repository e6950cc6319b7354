/* SPDX-License-Identifier: Apache-2.0 */
/* Escapes as in C. */
#include "bake/base/print_text.h"

#include <string.h>

#include "base/utf8.h"

void umbb_escape(const char *text, char *out, size_t size)
{
    static const char digits[] = "0123456789abcdef";
    size_t used = 0;
    const char *const text_end = text + strlen(text);
    while (text < text_end) {
        const unsigned char byte = (unsigned char)*text;
        const size_t length = umb__utf8_length((const uint8_t *)text, (size_t)(text_end - text));
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
