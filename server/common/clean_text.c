/* SPDX-License-Identifier: Apache-2.0 */
/* Clean text, see clean_text.h. */
#include "common/clean_text.h"

#include <string.h>

#include "base/utf8.h"

/* Returns the length in bytes of the clean character at the start of text, or 0. U+0080 to U+009F
 * are control characters too, which terminals obey. */
static size_t clean_char(const char *text, size_t length)
{
    const uint8_t *bytes = (const uint8_t *)text;
    const size_t count = umb__utf8_length(bytes, length);
    const int is_control = (count == 1 && (bytes[0] < 0x20 || bytes[0] == 0x7f)) ||
                           (count == 2 && bytes[0] == 0xc2 && bytes[1] < 0xa0);
    return is_control ? 0 : count;
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
