/* SPDX-License-Identifier: Apache-2.0 */
/* The top-level scan of protobuf messages, see proto_scan.h. */
#include "wire/proto_scan.h"

#include <string.h>
#include "base/try.h"
#include "wire/codec.h"

#define FIELD_NUMBER_MAX 536870911U /* 2^29 - 1 */

/* Reads a varint and moves *at behind it; false if it ends too early or has more than 64 bits. */
static bool read_varint(const uint8_t **at, const uint8_t *end, uint64_t *value)
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

/* Finds the payload of an item whose tag is read; false if it does not fit or is a group. */
static bool read_payload(struct umbw_item *item, const uint8_t **at, const uint8_t *end)
{
    uint64_t value;
    uint64_t size;
    item->payload = *at;
    switch (item->type) {
    case UMBW_WIRE_VARINT:
        if (!read_varint(at, end, &value)) {
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
    return true;
}

enum umb_status umbw_item_read(const uint8_t *message, const uint8_t **at, const uint8_t *end,
                               struct umbw_item *item, struct umb_error *error)
{
    uint64_t tag;
    size_t offset = (size_t)(*at - message);
    item->start = *at;
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

static enum umb_status keep_item(const struct umbw_item *item, const struct umbw_field *field,
                                 struct umbw_field_found *found, const uint8_t *item_end,
                                 struct umbw_scratch *scratch, struct umb_error *error)
{
    bool packed = field->kind == UMBW_FIELD_PACKED && item->type == UMBW_WIRE_BYTES;
    if (item->type != (uint32_t)field->type && !packed) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: wire type is %lu, must be %d", field->name,
                        (unsigned long)item->type, (int)field->type);
    }
    found->count++;
    if (field->kind == UMBW_FIELD_IN_PLACE) {
        found->bytes = item->payload;
        found->size = item->payload_size;
        return UMB_OK;
    }
    if (item->type == UMBW_WIRE_VARINT) {
        const uint8_t *at = item->payload;
        (void)read_varint(&at, item_end, &found->number); /* Checked before, so it is a varint */
    } else if (item->type == UMBW_WIRE_FIXED64) {
        found->number = 0;
        for (unsigned i = 0; i < 8; i++) {
            found->number |= (uint64_t)item->payload[i] << (8 * i);
        }
    }
    if (scratch == NULL) {
        return UMB_OK;
    }
    size_t size = (size_t)(item_end - item->start);
    if (size > sizeof scratch->bytes - scratch->size) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: the small fields of the message are over the limit of %zu bytes",
                        field->name, sizeof scratch->bytes);
    }
    memcpy(scratch->bytes + scratch->size, item->start, size);
    scratch->size += size;
    return UMB_OK;
}

enum umb_status umbw_proto_scan(const uint8_t *message, size_t size,
                                const struct umbw_field *fields, size_t field_count,
                                struct umbw_field_found *found, struct umbw_scratch *scratch,
                                struct umb_error *error)
{
    memset(found, 0, field_count * sizeof *found);
    if (scratch != NULL) {
        scratch->size = 0;
    }
    if (size == 0) {
        return UMB_OK; /* message may be NULL */
    }
    const uint8_t *at = message;
    const uint8_t *end = message + size;
    for (size_t fields_seen = 0; at < end; fields_seen++) {
        struct umbw_item item = {0};
        if (fields_seen == UMBW_FIELDS_MAX) {
            return umb_fail(error, UMB_E_ARGUMENT, "message: has more than %d fields",
                            UMBW_FIELDS_MAX);
        }
        enum umb_status status = umbw_item_read(message, &at, end, &item, error);
        for (size_t i = 0; status == UMB_OK && i < field_count; i++) {
            if (fields[i].number == item.number) {
                status = keep_item(&item, &fields[i], &found[i], at, scratch, error);
                break;
            }
        }
        if (status != UMB_OK) {
            return status;
        }
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

static double load_double(const uint8_t *bytes)
{
    uint64_t bits = 0;
    double value;
    for (unsigned i = 0; i < 8; i++) {
        bits |= (uint64_t)bytes[i] << (8 * i);
    }
    memcpy(&value, &bits, sizeof value);
    return value;
}

enum umb_status umbw_scan_vector(const uint8_t *message, size_t size,
                                 const struct umbw_field *field, double vector[3],
                                 struct umb_error *error)
{
    const uint8_t *at = message;
    const uint8_t *end = message + size;
    double values[3] = {0};
    size_t count = 0;
    while (at < end) {
        struct umbw_item item;
        UMB__TRY(umbw_item_read(message, &at, end, &item, error));
        if (item.number != field->number) {
            continue;
        }
        if (item.payload_size % sizeof(double) != 0) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "%s: length is %zu bytes, must be a multiple of 8", field->name,
                            item.payload_size);
        }
        for (size_t i = 0; i < item.payload_size; i += sizeof(double), count++) {
            values[count % 3] = load_double(item.payload + i);
        }
    }
    return umbw_vector_copy(field->name, values, count, vector, error);
}
