/* SPDX-License-Identifier: Apache-2.0 */
/* Source: RFC 8259, section 7. */
#include "common/json_text.h"

#include <string.h>

#include "base/utf8.h"

void umbs_json_bytes(FILE *to, const char *text, size_t length)
{
    fputc('"', to);
    for (size_t at = 0; at < length;) {
        const unsigned char byte = (unsigned char)text[at];
        const size_t bytes = umb__utf8_length((const uint8_t *)text + at, length - at);
        if (bytes == 0) {
            fputs("\\ufffd", to);
        } else if (byte == '"' || byte == '\\') {
            fprintf(to, "\\%c", byte);
        } else if (byte < 0x20) {
            fprintf(to, "\\u%04x", byte);
        } else {
            fwrite(text + at, 1, bytes, to);
        }
        at += bytes == 0 ? 1 : bytes;
    }
    fputc('"', to);
}

void umbs_json_text(FILE *to, const char *text)
{
    umbs_json_bytes(to, text, strlen(text));
}
