/* SPDX-License-Identifier: Apache-2.0 */
/* The encoder of all messages, see codec.h, and its growing byte buffer. The same code first counts
 * the bytes and then writes them. */
#include "wire/codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/bytes.h"
#include "base/compat.h"
#include "base/try.h"
#include "base/utf8.h"

/* Destination of a message. */
struct sink {
    uint8_t *bytes;         /* NULL: only counts */
    size_t size;            /* Bytes so far */
    size_t last;            /* Bytes at the message's end that the caller appends */
    enum umb_status status; /* UMB_OK, or a failure */
    struct umb_error *error;
};

/* A field being encoded, and its source. */
struct slot {
    const struct umbw_table *table;
    const struct umbw_row *row;
    const ProtobufCFieldDescriptor *field;
    const uint8_t *in; /* Struct */
    size_t index;      /* Index in the arrays that rows with a stride describe */
    size_t count;      /* Count by the row; SIZE_MAX if the row has none */
};

/* Fails with a sentence that begins with the field's name. */
#define REFUSE(sink, slot, code, format, ...)                                                      \
    ((sink)->status = umb_fail((sink)->error, code, "%s%s: " format, (slot)->table->prefix,        \
                               (slot)->field->name, __VA_ARGS__))

static void put_struct(struct sink *sink, const struct umbw_table *table, const uint8_t *in,
                       size_t index);

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

static void put_bytes(struct sink *sink, const void *bytes, size_t size)
{
    if (sink->bytes != NULL && size > 0) {
        memcpy(sink->bytes + sink->size, bytes, size);
    }
    sink->size += size;
}

/* Writes a varint of several bytes. It is rare, and a function of its own so that the caller need
 * not save registers for it. */
static __attribute__((noinline)) void put_long(struct sink *sink, uint64_t value)
{
    uint8_t unused[10] UMB__UNSET;
    sink->size += umbw_varint_write(value, sink->bytes != NULL ? sink->bytes + sink->size : unused);
}

static inline void put_varint(struct sink *sink, uint64_t value)
{
    if (value >= 0x80) {
        put_long(sink, value);
        return;
    }
    if (sink->bytes != NULL) {
        sink->bytes[sink->size] = (uint8_t)value;
    }
    sink->size++;
}

static void put_fixed64(struct sink *sink, uint64_t value)
{
    if (sink->bytes != NULL) {
        umb__store64(sink->bytes + sink->size, value);
    }
    sink->size += sizeof value;
}

static void put_tag(struct sink *sink, const struct slot *slot, enum umbw_wire_type type)
{
    put_varint(sink, (uint64_t)slot->field->id << 3 | type);
}

static void put_piece(struct sink *sink, const struct slot *slot, const void *bytes, size_t size)
{
    put_tag(sink, slot, UMBW_WIRE_BYTES);
    put_varint(sink, size);
    put_bytes(sink, bytes, size);
}

/* Returns the count of a row's field; SIZE_MAX if the row has none. */
static inline size_t load_count(const struct umbw_row *row, const uint8_t *in)
{
    uint32_t narrow;
    size_t count = SIZE_MAX;
    if (row->count_size == sizeof narrow) {
        memcpy(&narrow, in + row->count, sizeof narrow);
        count = narrow;
    } else if (row->count_size > 0) {
        memcpy(&count, in + row->count, sizeof count);
    }
    return count;
}

static const void *load_pointer(const struct slot *slot)
{
    const void *pointer;
    memcpy(&pointer, slot->in + slot->row->offset, sizeof pointer);
    return pointer;
}

/* Returns the wire's number of a value of the struct's enum. */
static __attribute__((noinline)) uint64_t wire_enum(struct sink *sink, const struct slot *slot,
                                                    uint32_t value)
{
    const ProtobufCEnumDescriptor *type = slot->field->descriptor;
    for (unsigned i = 0; i < type->n_values; i++) { /* they count from 0 */
        if ((slot->row->values != NULL ? (uint32_t)slot->row->values[i] : i) == value) {
            return i;
        }
    }
    (void)REFUSE(sink, slot, slot->row->flags & UMBW_PARTIAL ? UMB_E_UNSUPPORTED : UMB_E_ARGUMENT,
                 "%ld is not one of the protocol's", (long)(int32_t)value);
    return 0;
}

/* Fails: the number is not within the row's limit. */
static __attribute__((noinline)) void refuse_number(struct sink *sink, const struct slot *slot,
                                                    double value)
{
    (void)REFUSE(sink, slot, UMB_E_ARGUMENT, "%.9g is not within 0..%.9g", value, slot->row->most);
}

/* Returns the bits of a member in the form in which a varint or a 64-bit field stores them. */
static inline uint64_t wire_number(struct sink *sink, const struct slot *slot, uint64_t bits)
{
    double value;
    switch (slot->field->type) {
    case PROTOBUF_C_TYPE_DOUBLE:
        memcpy(&value, &bits, sizeof value);
        if (slot->row->most > 0 && !(value >= 0 && value <= slot->row->most)) {
            refuse_number(sink, slot, value);
        }
        return value == 0 ? 0 : bits; /* -0 is left out, too */
    case PROTOBUF_C_TYPE_ENUM:
    case PROTOBUF_C_TYPE_INT32:
        return slot->row->flags & UMBW_CHECKED ? wire_enum(sink, slot, (uint32_t)bits)
                                               : (uint64_t)(int64_t)(int32_t)(uint32_t)bits;
    case PROTOBUF_C_TYPE_BOOL:
        return bits != 0;
    case PROTOBUF_C_TYPE_UINT32:
        if ((slot->row->flags & UMBW_REQUIRED) && (bits == 0 || (double)bits > slot->row->most)) {
            (void)REFUSE(sink, slot, UMB_E_ARGUMENT, "%lu, must be 1 to %.0f", (unsigned long)bits,
                         slot->row->most);
        }
        return bits;
    default:
        return bits;
    }
}

/* Returns the bits of a number's member. */
static inline uint64_t load_number(const struct slot *slot)
{
    const uint8_t *at = slot->in + slot->row->offset + slot->index * slot->row->stride;
    uint32_t narrow;
    uint64_t bits;
    if (slot->row->size == sizeof narrow) {
        memcpy(&narrow, at, sizeof narrow);
        return narrow;
    }
    memcpy(&bits, at, sizeof bits);
    return bits;
}

/* Writes a number that is not 0 in the struct. */
static void put_number(struct sink *sink, const struct slot *slot, uint64_t bits)
{
    const ProtobufCType type = slot->field->type;
    bits = wire_number(sink, slot, bits);
    if (bits == 0) {
        return;
    }
    if (type == PROTOBUF_C_TYPE_DOUBLE || type == PROTOBUF_C_TYPE_FIXED64) {
        put_tag(sink, slot, UMBW_WIRE_FIXED64);
        put_fixed64(sink, bits);
    } else {
        put_tag(sink, slot, UMBW_WIRE_VARINT);
        put_varint(sink, bits);
    }
}

/* Writes the elements of a repeated number, without tags. */
static void put_elements(struct sink *sink, const struct slot *slot, size_t count)
{
    const size_t step = slot->row->stride > 0 ? slot->row->stride : sizeof(uint64_t);
    const uint8_t *at = slot->in + slot->row->offset;
    for (size_t i = 0; i < count; i++, at += step) {
        uint64_t bits;
        memcpy(&bits, at, sizeof bits);
        if (slot->field->type == PROTOBUF_C_TYPE_DOUBLE) {
            put_fixed64(sink, bits);
        } else {
            put_varint(sink, bits);
        }
    }
}

/* Writes a repeated number, packed. */
static void put_numbers(struct sink *sink, const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const size_t most = row->stride > 0 ? (size_t)row->most : row->size / sizeof(double);
    const size_t count = slot->count == SIZE_MAX ? most : slot->count;
    struct sink packed = {0};
    bool all_zero = true;
    for (size_t i = 0; i < count && row->stride == 0; i++) {
        double value;
        memcpy(&value, slot->in + row->offset + i * sizeof value, sizeof value);
        all_zero = all_zero && value == 0;
        if ((row->flags & UMBW_FINITE) && !isfinite(value)) {
            (void)REFUSE(sink, slot, UMB_E_ARGUMENT, "number %zu is %g, must be finite", i, value);
        }
    }
    if (count == 0 || (all_zero && (row->flags & UMBW_SPARSE))) {
        return;
    }
    if (count > most) {
        (void)REFUSE(sink, slot, UMB_E_TOO_LARGE, "%zu are over the limit of %zu", count, most);
        return;
    }
    put_elements(&packed, slot, count);
    put_tag(sink, slot, UMBW_WIRE_BYTES);
    put_varint(sink, packed.size);
    put_elements(sink, slot, count);
}

static void put_text(struct sink *sink, const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const bool owned = row->size == sizeof(char *);
    const char *text = owned ? load_pointer(slot) : (const char *)slot->in + row->offset;
    if (slot->field->label == PROTOBUF_C_LABEL_REPEATED) {
        const char *const *texts = load_pointer(slot);
        for (size_t i = 0; i < slot->count; i++) {
            put_piece(sink, slot, texts[i], strlen(texts[i]));
        }
        return;
    }
    const size_t size = text == NULL ? 0 : owned ? strlen(text) : strnlen(text, row->size);
    if (size == 0 && (row->flags & UMBW_REQUIRED)) {
        (void)REFUSE(sink, slot, UMB_E_ARGUMENT, "%s", "is empty, must be a name or an id");
    } else if (!owned && size == row->size) {
        (void)REFUSE(sink, slot, UMB_E_ARGUMENT, "over the limit of %zu bytes", size - 1);
    } else if ((row->flags & UMBW_CHECKED) && !umb__utf8_valid((const uint8_t *)text, size)) {
        (void)REFUSE(sink, slot, UMB_E_ARGUMENT, "%s", "not UTF-8 text without NUL");
    } else if (size > 0) {
        put_piece(sink, slot, text, size);
    }
}

static void put_blob(struct sink *sink, const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const bool in_place = row->size == sizeof(uint8_t *);
    const uint8_t *bytes = in_place ? load_pointer(slot) : slot->in + row->offset;
    const size_t each = row->stride > 0 ? row->stride : 1;
    if (row->flags & UMBW_LAST) {
        put_tag(sink, slot, UMBW_WIRE_BYTES);
        put_varint(sink, slot->count);
        sink->last += slot->count;
    } else if (row->stride > 0 && slot->field->label == PROTOBUF_C_LABEL_REPEATED) {
        for (size_t i = 0; i < slot->count; i++) {
            put_piece(sink, slot, sink->bytes != NULL ? bytes + i * row->stride : NULL,
                      row->stride);
        }
    } else {
        put_piece(sink, slot, bytes, in_place ? slot->count * each : row->size);
    }
}

/* Writes one sub-message. */
static void put_part(struct sink *sink, const struct slot *slot, const uint8_t *in, size_t index)
{
    uint8_t length[10];
    put_tag(sink, slot, UMBW_WIRE_BYTES);
    const size_t at = sink->size + 1; /* of the part, if its length takes one byte */
    sink->size = at;
    put_struct(sink, slot->row->table, in, index);
    const size_t size = sink->size - at, more = umbw_varint_write(size, length) - 1;
    if (sink->bytes != NULL && more > 0) {
        memmove(sink->bytes + at + more, sink->bytes + at, size);
    }
    sink->size = at - 1;
    put_bytes(sink, length, more + 1);
    sink->size += size;
}

static void put_message(struct sink *sink, const struct slot *slot)
{
    const struct umbw_row *row = slot->row;
    const size_t count = slot->count;
    if (row->table == NULL) {
        put_piece(sink, slot, load_pointer(slot), count);
        return;
    }
    if (slot->field->label != PROTOBUF_C_LABEL_REPEATED) {
        put_part(sink, slot, slot->in + row->offset, 0);
        return;
    }
    const bool own = row->table->size > 0;
    const uint8_t *array = own ? load_pointer(slot) : slot->in;
    if ((double)count > row->most) {
        (void)REFUSE(sink, slot, UMB_E_TOO_LARGE, "%zu are over the limit of %.0f", count,
                     row->most);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        put_part(sink, slot, own ? array + i * row->table->size : array, own ? 0 : i);
    }
}

/* Writes a field that is not a single number. */
static void put_field(struct sink *sink, const struct slot *slot)
{
    switch (slot->field->type) {
    case PROTOBUF_C_TYPE_STRING:
        put_text(sink, slot);
        break;
    case PROTOBUF_C_TYPE_BYTES:
        put_blob(sink, slot);
        break;
    case PROTOBUF_C_TYPE_MESSAGE:
        put_message(sink, slot);
        break;
    default:
        put_numbers(sink, slot);
    }
}

/* True for a single number. */
static inline bool is_number(const ProtobufCFieldDescriptor *field)
{
    return field->type < PROTOBUF_C_TYPE_STRING && field->label != PROTOBUF_C_LABEL_REPEATED;
}

static void put_struct(struct sink *sink, const struct umbw_table *table, const uint8_t *in,
                       size_t index)
{
    const struct umbw_row *last = NULL;
    struct slot slot = {table, table->rows, table->descriptor->fields, in, index, SIZE_MAX};
    if (umbw_table_bits(table, sink->error) == 0) {
        sink->status = UMB_E_INTERNAL;
        return;
    }
    for (unsigned left = table->descriptor->n_fields; left > 0; left--) {
        if (is_number(slot.field)) {
            const uint64_t bits = load_number(&slot);
            if (bits != 0 || slot.row->values != NULL || slot.row->flags & UMBW_REQUIRED) {
                put_number(sink, &slot, bits);
            }
        } else {
            slot.count = load_count(slot.row, in);
            if (slot.row->flags & UMBW_LAST) {
                last = slot.row;
            } else if (slot.count > 0) {
                put_field(sink, &slot);
            }
        }
        slot.row++;
        slot.field++;
    }
    if (last != NULL && load_count(last, in) > 0) {
        slot.row = last;
        slot.field = &table->descriptor->fields[last - table->rows];
        slot.count = load_count(last, in);
        put_field(sink, &slot);
    }
}

/* --- The growing byte buffer --- */

void umbw_buffer_finish(struct umbw_buffer *buffer)
{
    free(buffer->bytes);
    buffer->bytes = NULL;
    buffer->size = 0;
    buffer->capacity = 0;
}

enum umb_status umbw_buffer_reserve(struct umbw_buffer *buffer, size_t count,
                                    struct umb_error *error)
{
    size_t needed;
    if (__builtin_add_overflow(buffer->size, count, &needed)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", count);
    }
    if (needed <= buffer->capacity) {
        return UMB_OK;
    }
    size_t capacity = buffer->capacity > SIZE_MAX / 2 ? needed : buffer->capacity * 2;
    if (capacity < needed) {
        capacity = needed;
    }
    uint8_t *bytes = realloc(buffer->bytes, capacity);
    if (bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", count);
    }
    buffer->bytes = bytes;
    buffer->capacity = capacity;
    return UMB_OK;
}

void umbw_prefix_write(uint64_t message_size, uint8_t bytes[UMBW_PREFIX_BYTES])
{
    bytes[0] = 0; /* not compressed */
    for (unsigned i = 0; i < 4; i++) {
        bytes[1 + i] = (uint8_t)(message_size >> (24 - 8 * i));
    }
}

enum umb_status umbw_buffer_begin_message(struct umbw_buffer *buffer, uint64_t message_size,
                                          size_t room, struct umb_error *error)
{
    if (message_size > UINT32_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: %llu bytes are over the limit of %lu bytes",
                        (unsigned long long)message_size, (unsigned long)UINT32_MAX);
    }
    if (room > SIZE_MAX - UMBW_PREFIX_BYTES) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", room);
    }
    UMB__TRY(umbw_buffer_reserve(buffer, UMBW_PREFIX_BYTES + room, error));
    umbw_prefix_write(message_size, buffer->bytes + buffer->size);
    buffer->size += UMBW_PREFIX_BYTES;
    return UMB_OK;
}

/* --- Whole messages --- */

size_t umbw_write(const struct umbw_table *table, const void *in, uint8_t *bytes)
{
    struct sink sink = {.bytes = bytes != NULL ? bytes + UMBW_PREFIX_BYTES : NULL};
    put_struct(&sink, table, in, 0);
    if (bytes != NULL) {
        umbw_prefix_write(sink.size + sink.last, bytes);
    }
    return UMBW_PREFIX_BYTES + sink.size;
}

enum umb_status umbw_encode(const struct umbw_table *table, const void *in,
                            struct umbw_buffer *buffer, struct umb_error *error)
{
    struct sink sink = {.error = error};
    put_struct(&sink, table, in, 0);
    if (sink.status != UMB_OK) {
        return sink.status;
    }
    UMB__TRY(umbw_buffer_begin_message(buffer, sink.size + sink.last, sink.size, error));
    sink = (struct sink){.bytes = buffer->bytes + buffer->size};
    put_struct(&sink, table, in, 0);
    buffer->size += sink.size;
    return UMB_OK;
}
