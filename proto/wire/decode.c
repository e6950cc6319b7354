/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The decoder of all messages, see codec.h.
 *
 * It passes over a message twice: a scan notes the count and the last occurrence of each field,
 * then each row decodes its field. The first read checks a message and counts the bytes of its
 * arrays and texts. If there are any, a second read fills their block.
 */
#include "wire/codec.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/bytes.h"
#include "base/compat.h"
#include "base/try.h"
#include "base/utf8.h"

#define FIELD_NUMBER_MAX 536870911U /* 2^29 - 1 */

/* Last occurrence of a field, and the number of all; zeros if the field is absent. */
struct found {
    const uint8_t *bytes; /* Payload of the last occurrence */
    size_t size;          /* Its bytes; of a single sub-message: those of all pieces */
    size_t count;
    uint64_t value; /* Last value of a varint or of 64 bits */
};

/* State of one message's decoding, sub-messages included. */
struct decoder {
    uint8_t *block; /* Memory for arrays and texts; NULL: they are only counted */
    size_t used;    /* Bytes of the block in use */
    bool has_block; /* The message has arrays or texts */
    size_t nested;  /* Number of fields of sub-messages so far */
    size_t unknown; /* Number of fields that their tables do not have */
    struct umb_error *error;
};

/* The bytes of a message. A sub-message may come in several pieces within its parent. Then this is
 * the current piece, with the rest of the parent, where further pieces of field `number` may
 * follow. The parent is a whole message. */
struct span {
    const uint8_t *start, *at, *end;
    const uint8_t *parent, *more, *more_end;
    uint32_t number; /* 0: a whole message */
};

/* A field of a message being decoded, and its destination. */
struct slot {
    struct decoder *decoder;
    const struct umbw_table *table;
    const struct umbw_row *row;
    const ProtobufCFieldDescriptor *field;
    const struct found *found;
    const struct span *span; /* of the message */
    uint8_t *out;            /* Struct, or NULL: the field is only checked */
    size_t index;            /* Index in the arrays that rows with a stride describe */
};

/* Fails with E_ARGUMENT, or another status, and a message that begins with the field's name. */
#define REFUSE_AS(slot, status, format, ...)                                                       \
    umb_fail((slot)->decoder->error, status, "%s%s: " format, (slot)->table->prefix,               \
             (slot)->field->name, __VA_ARGS__)
#define REFUSE(slot, format, ...) REFUSE_AS(slot, UMB_E_ARGUMENT, format, __VA_ARGS__)

static enum umb_status decode_struct(struct decoder *decoder, const struct umbw_table *table,
                                     const struct span *span, uint8_t *out, size_t index);

static __attribute__((noinline)) bool read_long_varint(const uint8_t **at, const uint8_t *end,
                                                       uint64_t *value)
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

/* Most varints have one byte. */
static inline bool read_varint(const uint8_t **at, const uint8_t *end, uint64_t *value)
{
    if (*at != end && **at < 0x80) {
        *value = *(*at)++;
        return true;
    }
    return read_long_varint(at, end, value);
}

/* Finds the payload of a field whose tag has been read. Returns false if the payload is cut off or
 * is a group. */
static inline bool read_payload(struct umbw_item *item, const uint8_t **at, const uint8_t *end)
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

static inline __attribute__((always_inline)) enum umb_status
read_item(const uint8_t *message, const uint8_t **at, const uint8_t *end, struct umbw_item *item,
          struct umb_error *error)
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

enum umb_status umbw_item_read(const uint8_t *message, const uint8_t **at, const uint8_t *end,
                               struct umbw_item *item, struct umb_error *error)
{
    return read_item(message, at, end, item, error);
}

/* Moves to the next piece of a sub-message that is not empty; at == end if no piece is left. */
static inline enum umb_status next_piece(struct span *span, struct umb_error *error)
{
    struct umbw_item piece UMB__UNSET;
    while (span->at == span->end && span->more != span->more_end) {
        UMB__TRY(umbw_item_read(span->parent, &span->more, span->more_end, &piece, error));
        if (piece.number == span->number) {
            span->start = span->at = piece.payload;
            span->end = piece.payload + piece.payload_size;
        }
    }
    return UMB_OK;
}

/* Reads the next field of a message. Out: *any: false at its end. */
static inline enum umb_status next_item(struct span *span, struct umbw_item *item, bool *any,
                                        struct umb_error *error)
{
    UMB__TRY(next_piece(span, error));
    *any = span->at != span->end;
    return !*any ? UMB_OK : umbw_item_read(span->start, &span->at, span->end, item, error);
}

/* Returns the wire type of a field that is not packed. */
static uint32_t wire_type(const ProtobufCFieldDescriptor *field)
{
    switch (field->type) {
    case PROTOBUF_C_TYPE_DOUBLE:
    case PROTOBUF_C_TYPE_FIXED64:
        return UMBW_WIRE_FIXED64;
    case PROTOBUF_C_TYPE_STRING:
    case PROTOBUF_C_TYPE_BYTES:
    case PROTOBUF_C_TYPE_MESSAGE:
        return UMBW_WIRE_BYTES;
    default:
        return UMBW_WIRE_VARINT;
    }
}

/* Returns the index of a field in the descriptor's order; n_fields if the message does not have it.
 * The numbers are stored as ranges, of which a message has few; the range behind the last marks the
 * end. */
static inline unsigned index_of(const ProtobufCMessageDescriptor *message, uint32_t number)
{
    const ProtobufCIntRange *range = message->field_ranges;
    for (unsigned left = message->n_field_ranges; left > 0; left--, range++) {
        const uint32_t after = number - (uint32_t)range->start_value; /* wraps below the range */
        if (after < range[1].orig_index - range->orig_index) {
            return range->orig_index + after;
        }
    }
    return message->n_fields;
}

/* Fields of a message that the scan found, a bit for each, in the order of the table. */
struct seen {
    uint64_t bits;
    struct found fields[UMBW_ROWS_MAX]; /* Set where `bits` has a bit */
};

static enum umb_status note_item(struct decoder *decoder, const struct umbw_table *table,
                                 const struct umbw_item *item, bool nested, struct seen *seen)
{
    const unsigned i = index_of(table->descriptor, item->number);
    if (i == table->descriptor->n_fields) { /* It may come from a newer peer */
        return !nested || decoder->unknown++ < UMBW_FIELDS_MAX
                   ? UMB_OK
                   : umb_fail(decoder->error, UMB_E_TOO_LARGE,
                              "message: has more than %d unknown fields", UMBW_FIELDS_MAX);
    }
    const ProtobufCFieldDescriptor *field = &table->descriptor->fields[i];
    const struct umbw_row *row = &table->rows[i];
    struct found *found = &seen->fields[i];
    const bool repeated = field->label == PROTOBUF_C_LABEL_REPEATED;
    const uint32_t type = wire_type(field);
    if (item->type != type && !(repeated && item->type == UMBW_WIRE_BYTES)) {
        return umb_fail(decoder->error, UMB_E_ARGUMENT, "%s%s: wire type is %lu, must be %lu",
                        table->prefix, field->name, (unsigned long)item->type, (unsigned long)type);
    }
    const bool again = seen->bits >> i & 1;
    const size_t count = again ? found->count : 0;
    if (row->table != NULL && repeated && (double)count >= row->most) {
        return umb_fail(decoder->error, UMB_E_TOO_LARGE, "%s%s: %zu are over the limit of %.0f",
                        table->prefix, field->name, count + 1, row->most);
    }
    /* The pieces of a sub-message are joined: together they have its size. */
    const bool joined = again && row->table != NULL && !repeated;
    const size_t before = joined ? found->size : 0;
    *found = (struct found){item->payload, before + item->payload_size, count + 1, item->value};
    seen->bits |= (uint64_t)1 << i;
    return UMB_OK;
}

/* Notes all fields of a message. */
static enum umb_status scan(struct decoder *decoder, const struct umbw_table *table,
                            struct span span, struct seen *seen)
{
    const bool is_one_of_many = span.number != 0 && span.parent == NULL;
    struct umbw_item item UMB__UNSET;
    seen->bits = 0;
    for (size_t fields = 0;; fields++) {
        UMB__TRY(next_piece(&span, decoder->error));
        if (span.at == span.end) {
            return UMB_OK;
        }
        UMB__TRY(read_item(span.start, &span.at, span.end, &item, decoder->error));
        if (!is_one_of_many && fields == UMBW_FIELDS_MAX) {
            return umb_fail(decoder->error, UMB_E_ARGUMENT, "message: has more than %d fields",
                            UMBW_FIELDS_MAX);
        }
        if (span.number != 0 && decoder->nested++ == UMBW_NESTED_MAX) {
            return umb_fail(decoder->error, UMB_E_TOO_LARGE,
                            "message: its parts have more than %d fields", UMBW_NESTED_MAX);
        }
        UMB__TRY(note_item(decoder, table, &item, span.number != 0, seen));
    }
}

static void store(const struct slot *slot, size_t offset, const void *value, size_t size)
{
    if (slot->out != NULL) {
        memcpy(slot->out + offset, value, size);
    }
}

static void store_count(const struct slot *slot, size_t count)
{
    const uint32_t narrow = (uint32_t)count;
    const struct umbw_row *row = slot->row;
    if (row->count_size == sizeof narrow) {
        store(slot, row->count, &narrow, sizeof narrow);
    } else if (row->count_size > 0) {
        store(slot, row->count, &count, sizeof count);
    }
}

/* Takes bytes of the block; NULL while these are only counted. */
static void *grab(struct decoder *decoder, size_t size, size_t alignment)
{
    decoder->used = (decoder->used + alignment - 1) / alignment * alignment;
    void *at = decoder->block != NULL ? decoder->block + decoder->used : NULL;
    decoder->used += size;
    decoder->has_block = true;
    return at;
}

/* Fails: the .proto file does not have the enum's value. */
static __attribute__((noinline)) enum umb_status refuse_enum(const struct slot *slot,
                                                             uint32_t value)
{
    const ProtobufCEnumDescriptor *type = slot->field->descriptor;
    char names[160] = "";
    size_t length = 0;
    for (unsigned i = 0; i < type->n_values && length < sizeof names; i++) {
        const char *name = strchr(type->values[i].name, '_');
        length += (size_t)snprintf(names + length, sizeof names - length, "%s%d (%s)",
                                   i > 0 ? ", " : "", type->values[i].value, name + 1);
    }
    return REFUSE_AS(slot, slot->row->flags & UMBW_NEWER ? UMB_E_UNSUPPORTED : UMB_E_ARGUMENT,
                     "%ld is not one of %s", (long)(int32_t)value, names);
}

/* Stores a single number at `offset` of the struct. As protobuf requires, a value is cut to the
 * bits of its type. */
static enum umb_status take_number(const struct slot *slot, uint64_t bits, size_t offset)
{
    const struct umbw_row *row = slot->row;
    uint32_t narrow = (uint32_t)bits;
    switch (slot->field->type) {
    case PROTOBUF_C_TYPE_DOUBLE: {
        double value;
        memcpy(&value, &bits, sizeof value);
        if (row->most > 0 && !(value >= 0 && value <= row->most)) {
            return REFUSE(slot, "%.9g is not within 0..%.9g", value, row->most);
        }
        store(slot, offset, &bits, sizeof bits);
        return UMB_OK;
    }
    case PROTOBUF_C_TYPE_ENUM:
        if (row->flags & UMBW_CHECKED) {
            const ProtobufCEnumDescriptor *type = slot->field->descriptor;
            if (narrow >= type->n_values) { /* they count from 0 */
                return refuse_enum(slot, narrow);
            }
            narrow = row->values != NULL ? (uint32_t)row->values[narrow] : narrow;
        }
        break;
    case PROTOBUF_C_TYPE_BOOL:
        narrow = bits != 0;
        break;
    case PROTOBUF_C_TYPE_INT32:
    case PROTOBUF_C_TYPE_UINT32:
        if ((row->flags & UMBW_REQUIRED) && (narrow == 0 || narrow > (uint32_t)row->most)) {
            return REFUSE(slot, "%u, must be 1 to %.0f", narrow, row->most);
        }
        if (row->most > 0 && bits > (uint64_t)row->most) {
            return REFUSE(slot, "%llu is over %.0f", (unsigned long long)bits, row->most);
        }
        break;
    default:
        store(slot, offset, &bits, sizeof bits);
        return UMB_OK;
    }
    store(slot, offset, &narrow, sizeof narrow);
    return UMB_OK;
}

/* Takes element i of a repeated number. */
static enum umb_status take_element(const struct slot *slot, uint64_t bits, size_t i)
{
    const size_t step = slot->row->stride > 0 ? slot->row->stride : sizeof bits;
    double value;
    memcpy(&value, &bits, sizeof value);
    if ((slot->row->flags & UMBW_FINITE) && !isfinite(value)) {
        return REFUSE(slot, "number %zu is %g, must be finite", i, value);
    }
    store(slot, slot->row->offset + i * step, &bits, sizeof bits);
    return UMB_OK;
}

/* Stores the elements of one occurrence of a repeated number: a packed list or a single element. It
 * stops at the first one beyond `most`, since a packed list may be as long as the message. Elements
 * of 8 bytes are counted nevertheless. */
static enum umb_status take_elements(const struct slot *slot, const uint8_t *at, size_t size,
                                     size_t most, size_t *count)
{
    const bool fixed = slot->field->type == PROTOBUF_C_TYPE_DOUBLE;
    const uint8_t *end = at + size;
    uint64_t bits;
    if (fixed && size % sizeof bits != 0) {
        return REFUSE(slot, "length is %zu bytes, must be a multiple of 8", size);
    }
    for (; at < end && *count <= most; (*count)++) {
        if (fixed) {
            bits = umb__load64(at);
            at += sizeof bits;
        } else if (!read_varint(&at, end, &bits)) {
            return REFUSE(slot, "number %zu is broken or cut short", *count);
        }
        if (*count < most) {
            UMB__TRY(take_element(slot, bits, *count));
        }
    }
    *count += fixed ? (size_t)(end - at) / sizeof bits : 0;
    return UMB_OK;
}

/* Stores a repeated number. An array without a stride must be absent or complete; one with a stride
 * may have up to row->most elements. */
static enum umb_status take_numbers(const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const struct found *found = slot->found;
    const size_t most = row->stride > 0 ? (size_t)row->most : row->size / sizeof(uint64_t);
    struct span span = *slot->span;
    struct umbw_item item;
    size_t count = 0;
    bool any = found->count > 1;
    if (!any) {
        UMB__TRY(take_elements(slot, found->bytes, found->size, most, &count));
    }
    while (any) {
        UMB__TRY(next_item(&span, &item, &any, slot->decoder->error));
        if (any && item.number == slot->field->id) {
            UMB__TRY(take_elements(slot, item.payload, item.payload_size, most, &count));
        }
    }
    store_count(slot, count);
    if (row->stride > 0) {
        return count <= most ? UMB_OK : REFUSE(slot, "%zu are over the limit of %zu", count, most);
    }
    return count == 0 || count == most
               ? UMB_OK
               : REFUSE(slot, "has %zu numbers, must have none or %zu", count, most);
}

static enum umb_status take_text(const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const uint8_t *bytes = slot->found->bytes;
    const size_t size = slot->found->size;
    const bool owned = row->size == sizeof(char *);
    if (size == 0 && (row->flags & UMBW_REQUIRED)) {
        return REFUSE(slot, "%s", "is empty, must be a name or an id");
    }
    if (!owned && size >= row->size) {
        return REFUSE(slot, "%zu bytes are over the limit of %zu bytes", size, row->size - 1);
    }
    if (!umb__utf8_valid(bytes, size)) {
        return REFUSE(slot, "%s", "not UTF-8 text without NUL");
    }
    if (!owned) {
        store(slot, row->offset, size > 0 ? (const void *)bytes : "", size);
        return UMB_OK;
    }
    char *text = grab(slot->decoder, size + 1, 1);
    if (text != NULL && size > 0) {
        memcpy(text, bytes, size);
    }
    store(slot, row->offset, &text, sizeof text);
    return UMB_OK;
}

static enum umb_status take_bytes(const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const struct found *found = slot->found;
    const bool in_place = row->size == sizeof found->bytes;
    const bool repeated = row->stride > 0 && slot->field->label == PROTOBUF_C_LABEL_REPEATED;
    const size_t exact = !in_place ? row->size : repeated ? row->stride : 0;
    const size_t each = row->stride > 0 ? row->stride : 1;
    const bool empty = found->size == 0 && row->stride == 0 && !(row->flags & UMBW_REQUIRED);
    if (exact > 0 && found->size != exact && !empty) {
        return REFUSE(slot, "length is %zu bytes, must be %zu", found->size, exact);
    }
    if (found->size % each != 0) {
        return REFUSE(slot, "length is %zu bytes, must be a multiple of %zu", found->size, each);
    }
    if (in_place) {
        store(slot, row->offset, &found->bytes, sizeof found->bytes);
        store_count(slot, repeated ? found->count : found->size / each);
    } else if (found->size > 0) {
        store(slot, row->offset, found->bytes, found->size);
        store_count(slot, 1);
    }
    return UMB_OK;
}

/* Takes a repeated sub-message. */
static enum umb_status take_structs(const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const size_t count = slot->found->count;
    const bool own = row->table->size > 0;
    struct span span = *slot->span;
    struct umbw_item item;
    uint8_t *array = slot->out;
    bool any = true;
    store_count(slot, count);
    if (own) {
        array = grab(slot->decoder, count * row->table->size, sizeof(uint64_t));
        store(slot, row->offset, &array, sizeof array);
    }
    for (size_t i = 0; i < count;) { /* as many items as were counted are there */
        UMB__TRY(next_item(&span, &item, &any, slot->decoder->error));
        if (item.number != slot->field->id) {
            continue;
        }
        const uint8_t *end = item.payload + item.payload_size;
        const struct span part = {
            .start = item.payload, .at = item.payload, .end = end, .number = slot->field->id};
        uint8_t *out = own && array != NULL ? array + i * row->table->size : array;
        UMB__TRY(decode_struct(slot->decoder, row->table, &part, out, own ? 0 : i));
        i++;
    }
    return UMB_OK;
}

static enum umb_status take_message(const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const struct found *found = slot->found;
    if (row->table == NULL) { /* It stays in the message */
        if (row->size > 0) {
            store(slot, row->offset, &found->bytes, sizeof found->bytes);
        }
        store_count(slot, row->size > 0 ? found->size : found->count);
        return UMB_OK;
    }
    if (slot->field->label == PROTOBUF_C_LABEL_REPEATED) {
        return take_structs(slot);
    }
    if (found->count == 0) {
        return row->flags & UMBW_REQUIRED ? REFUSE(slot, "%s", "is missing") : UMB_OK;
    }
    if (row->most > 0 && (double)found->size > row->most) {
        return REFUSE(slot, "%zu bytes, at most %.0f", found->size, row->most);
    }
    store_count(slot, 1);
    const struct span *parent = slot->span;
    const struct span parts = {.parent = parent->start,
                               .more = parent->start,
                               .more_end = parent->end,
                               .number = slot->field->id};
    return decode_struct(slot->decoder, row->table, &parts,
                         slot->out != NULL ? slot->out + row->offset : NULL, 0);
}

static enum umb_status take_field(const struct slot *slot)
{
    if (slot->row->flags & UMBW_SENT) {
        return UMB_OK;
    }
    switch (slot->field->type) {
    case PROTOBUF_C_TYPE_STRING:
        return take_text(slot);
    case PROTOBUF_C_TYPE_BYTES:
        return take_bytes(slot);
    case PROTOBUF_C_TYPE_MESSAGE:
        return take_message(slot);
    default:
        return slot->field->label == PROTOBUF_C_LABEL_REPEATED
                   ? take_numbers(slot)
                   : take_number(slot, slot->found->value,
                                 slot->row->offset + slot->index * slot->row->stride);
    }
}

uint64_t umbw_table_check(const struct umbw_table *table, struct umb_error *error)
{
    const ProtobufCMessageDescriptor *message = table->descriptor;
    uint64_t bits = UMBW_TABLE_SOUND;
    if (message->n_fields > table->row_count) {
        (void)umb_fail(error, UMB_E_INTERNAL, "%s: has %u fields, its table has %u rows",
                       message->name, message->n_fields, table->row_count);
        return 0;
    }
    for (unsigned i = 0; i < message->n_fields; i++) {
        if (table->rows[i].number != message->fields[i].id) {
            (void)umb_fail(error, UMB_E_INTERNAL, "%s%s: row %u of the table stands here",
                           table->prefix, message->fields[i].name, table->rows[i].number);
            return 0;
        }
        bits |= (uint64_t)((table->rows[i].flags & (UMBW_REQUIRED | UMBW_FILLED)) != 0) << i;
    }
    atomic_store_explicit(table->bits, bits, memory_order_relaxed);
    return bits;
}

static enum umb_status decode_struct(struct decoder *decoder, const struct umbw_table *table,
                                     const struct span *span, uint8_t *out, size_t index)
{
    static const struct found absent;
    struct seen seen UMB__UNSET; /* set by the scan */
    const uint64_t bits = umbw_table_bits(table, decoder->error);
    if (bits == 0) {
        return UMB_E_INTERNAL;
    }
    UMB__TRY(scan(decoder, table, *span, &seen));
    struct slot slot = {
        .decoder = decoder, .table = table, .span = span, .out = out, .index = index};
    /* The struct of any other field is zero already. */
    for (uint64_t left = seen.bits | (bits & ~UMBW_TABLE_SOUND); left != 0; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctzll(left);
        slot.row = &table->rows[i];
        slot.field = &table->descriptor->fields[i];
        slot.found = seen.bits >> i & 1 ? &seen.fields[i] : &absent;
        UMB__TRY(take_field(&slot));
    }
    return UMB_OK;
}

/* Decodes a message. In: out: the struct; NULL: it is at the start of the block. Out: block: the
 * caller frees it, on failure too. */
static enum umb_status decode(const struct umbw_table *table, const uint8_t *message, size_t size,
                              void *out, uint8_t **block, struct umb_error *error)
{
    static const uint8_t nothing;
    const uint8_t *start = size > 0 ? message : &nothing;
    const struct span whole = {.start = start, .at = start, .end = start + size};
    const size_t head = out == NULL ? table->size : 0;
    struct decoder decoder = {.used = head, .has_block = out == NULL, .error = error};
    *block = NULL;
    UMB__TRY(decode_struct(&decoder, table, &whole, out, 0));
    if (!decoder.has_block) {
        return UMB_OK;
    }
    *block = calloc(1, decoder.used + 1);
    if (*block == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a %s of %zu bytes",
                        table->descriptor->name, size);
    }
    decoder = (struct decoder){.block = *block, .used = head, .error = error};
    return decode_struct(&decoder, table, &whole, out != NULL ? out : *block, 0);
}

enum umb_status umbw_decode(const struct umbw_table *table, const uint8_t *message, size_t size,
                            void *out, struct umb_error *error)
{
    uint8_t *block;
    memset(out, 0, table->size);
    const enum umb_status status = decode(table, message, size, out, &block, error);
    if (status != UMB_OK) {
        memset(out, 0, table->size);
        free(block);
    }
    return status;
}

enum umb_status umbw_decode_new(const struct umbw_table *table, const uint8_t *message, size_t size,
                                void **out, struct umb_error *error)
{
    uint8_t *block;
    const enum umb_status status = decode(table, message, size, NULL, &block, error);
    if (status != UMB_OK) {
        free(block);
        block = NULL;
    }
    *out = block;
    return status;
}
