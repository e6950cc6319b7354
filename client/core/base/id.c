/* SPDX-License-Identifier: Apache-2.0 */
/* Asset ids as text. */
#include "umbrage/asset.h"

#include <string.h>

#include "base/bytes.h"

void umb_id_to_text(const uint8_t id[UMB_ID_BYTES], char text[UMB_ID_TEXT_SIZE])
{
    static const char digits[] = "0123456789abcdef";
    for (size_t i = 0; i < UMB_ID_BYTES; i++) {
        text[2 * i] = digits[id[i] >> 4];
        text[2 * i + 1] = digits[id[i] & 15];
    }
    text[2 * UMB_ID_BYTES] = '\0';
}

enum umb_status umb_id_from_text(const char *text, uint8_t id[UMB_ID_BYTES])
{
    uint8_t bytes[UMB_ID_BYTES];
    if (strlen(text) != 2 * UMB_ID_BYTES) {
        return UMB_E_ARGUMENT;
    }
    for (size_t i = 0; i < UMB_ID_BYTES; i++) {
        int high = umb__hex_value(text[2 * i]);
        int low = umb__hex_value(text[2 * i + 1]);
        if (high < 0 || low < 0) {
            return UMB_E_ARGUMENT;
        }
        bytes[i] = (uint8_t)(high * 16 + low);
    }
    memcpy(id, bytes, sizeof bytes);
    return UMB_OK;
}
