/* SPDX-License-Identifier: Apache-2.0 */
/* See field.h. */
#include "wire/field.h"

#include "base/bytes.h"

#define FIELD_NUMBER_MAX 536870911U /* 2^29 - 1 */

bool umbw_varint_read(const uint8_t **at, const uint8_t *end, uint64_t *value)
{
    uint64_t result = 0;
    for (unsigned i = 0; i < 10; i++) {
        if (*at == end) {
            return false;
        }
        uint8_t byte = *(*at)++;
        if (i == 9 && byte > 1) {
            return false;
        }
        result |= (uint64_t)(byte & 0x7f) << (7 * i);
        if (byte < 0x80) {
            *value = result;
            return true;
        }
    }
    return false;
}

/* umbw_varint_read; most varints have one byte. */
static inline bool read_varint(const uint8_t **at, const uint8_t *end, uint64_t *value)
{
    if (*at != end && **at < 0x80) {
        *value = *(*at)++;
        return true;
    }
    return umbw_varint_read(at, end, value);
}

/* Finds the payload of a field whose tag has been read. Returns false if the payload is cut off or
 * is a group. */
static bool read_payload(struct umbw_item *item, const uint8_t **at, const uint8_t *end)
{
    uint64_t size;
    item->payload = *at;
    item->value = 0;
    switch (item->type) {
    case UMBW_WIRE_VARINT:
        if (!read_varint(at, end, &item->value)) {
            return false;
        }
        item->payload_size = (size_t)(*at - item->payload);
        return true;
    case UMBW_WIRE_FIXED64:
        size = 8;
        break;
    case UMBW_WIRE_FIXED32:
        size = 4;
        break;
    case UMBW_WIRE_BYTES:
        if (!read_varint(at, end, &size)) {
            return false;
        }
        break;
    default:
        return false;
    }
    if (size > (uint64_t)(end - *at)) {
        return false;
    }
    item->payload = *at;
    item->payload_size = (size_t)size;
    *at += size;
    if (item->type == UMBW_WIRE_FIXED64) {
        item->value = umb__load64(item->payload);
    }
    return true;
}

enum umb_status umbw_item_read(const uint8_t *message, const uint8_t **at, const uint8_t *end,
                               struct umbw_item *item, struct umb_error *error)
{
    uint64_t tag;
    size_t offset = (size_t)(*at - message);
    if (!read_varint(at, end, &tag) || (tag >> 3) == 0 || (tag >> 3) > FIELD_NUMBER_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "message: no valid field tag at byte %zu", offset);
    }
    item->number = (uint32_t)(tag >> 3);
    item->type = (uint32_t)(tag & 7);
    if (!read_payload(item, at, end)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "message: field %lu at byte %zu (wire type %lu) is broken or cut short",
                        (unsigned long)item->number, offset, (unsigned long)item->type);
    }
    return UMB_OK;
}

size_t umbw_varint_write(uint64_t value, uint8_t out[10])
{
    size_t length = 0;
    while (value >= 0x80) {
        out[length++] = (uint8_t)(value | 0x80);
        value >>= 7;
    }
    out[length++] = (uint8_t)value;
    return length;
}
