/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_CODEC_H
#define UMBRAGE_WIRE_CODEC_H
/*
 * One decoder and one encoder for all messages, driven by tables.
 *
 * A table maps a message of a .proto file to a C struct: a row for each field, in the order of the
 * field numbers. Number, name and type of a field come from protobuf-c's descriptor. The row has
 * the field's place in the struct and its limits.
 *
 * | field                          | member of the struct                                       |
 * |--------------------------------|------------------------------------------------------------|
 * | number, bool, enum             | 4 or 8 bytes, as the field's type; bool and enum: int      |
 * | repeated number                | array of 8-byte numbers; with a stride: any distance apart |
 * | string                         | char[], NUL-terminated; or char *                          |
 * | bytes                          | uint8_t[] of that exact length; or a pointer into the      |
 * |                                | message, with the length as the row's count, in records of |
 * |                                | `stride` bytes if there is a stride                        |
 * | repeated bytes                 | pointer to `stride` bytes each; the decoder gives the      |
 * |                                | last. Without a stride: as bytes, for one element          |
 * | message                        | struct at its place                                        |
 * | repeated message               | pointer to an array; or arrays in the parent's struct, if  |
 * |                                | the message has no struct (size 0)                         |
 * | message without a table (`of`) | pointer to its bytes and their length, or only a count     |
 *
 * Decoding follows protobuf: unknown fields are dropped, the last occurrence of a single field
 * counts, repeated numbers may be packed or not, and pieces of one sub-message are joined. Any
 * other mismatch is an error that names the field, the value and the limit. Encoding leaves out
 * zeros, empty texts and bytes, and fields whose count is 0.
 *
 * Trust: safe on hostile bytes. Memory is allocated only for a message that was checked whole.
 */
#include <protobuf-c/protobuf-c.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"
#include "wire/messages.h"

/* Most fields of a message or of a single sub-message, unknown fields included. So many take 1 ms
 * to read */
#define UMBW_FIELDS_MAX  65536
#define UMBW_NESTED_MAX  (1 << 20) /* Most fields of all its sub-messages */
#define UMBW_ROWS_MAX    63        /* Most rows of a table: the decoder has a bit for each */
#define UMBW_TABLE_SOUND ((uint64_t)1 << UMBW_ROWS_MAX) /* Bit of a table that was checked */

enum umbw_row_flags {
    UMBW_REQUIRED = 1, /* Text must not be empty; bytes or sub-message must be present; number: 1 to
                          `most` */
    UMBW_FILLED = 2,   /* Pointer, or enum with `values`: set if the field is absent, too */
    UMBW_CHECKED =
        4,           /* Text: the encoder checks UTF-8 too. Enum: only values of the .proto file are
                        valid */
    UMBW_FINITE = 8, /* Numbers must be finite */
    UMBW_SPARSE = 16,  /* Numbers that are left out if all are 0 */
    UMBW_NEWER = 32,   /* Enum: the decoder fails with E_UNSUPPORTED, not E_ARGUMENT */
    UMBW_PARTIAL = 64, /* Enum: the encoder does, for values that the .proto file does not have */
    UMBW_SENT = 128,   /* Field that the decoder skips */
    UMBW_LAST = 256,   /* Bytes at the end of the message, which the caller appends */
};

struct umbw_table;

struct umbw_row {
    uint32_t number;          /* Number of the field in the .proto file */
    uint32_t flags;           /* enum umbw_row_flags */
    size_t offset, size;      /* Place and bytes of the member */
    size_t count, count_size; /* Place and bytes of the member for the number of elements or bytes;
                                 for a single field it is set to 1 if the field is present.
                                 count_size 0: no such member */
    size_t stride;            /* Distance of elements, or length of records, in bytes; 0: none */
    double most;              /* Largest number, most elements, or most bytes of a single
                                 sub-message, all its pieces together; 0: no limit */
    const struct umbw_table *table; /* Table of a sub-message */
    const int
        *values; /* Values of the struct's enum, indexed by the .proto file's values; NULL: both
                    enums have the same values */
};

/* Place of a row's member, and of its count. */
#define UMBW_AT(type, member)                                                                      \
    .offset = offsetof(struct type, member), .size = sizeof(((struct type *)0)->member)
#define UMBW_COUNT(type, member)                                                                   \
    .count = offsetof(struct type, member), .count_size = sizeof(((struct type *)0)->member)

struct umbw_table {
    const ProtobufCMessageDescriptor *descriptor;
    /* Rows of the fields, in the descriptor's order. An array with more rows than the message has
     * fields serves other messages too. With fewer the codec fails. */
    const struct umbw_row *rows; /* [row_count] */
    unsigned row_count;
    /* Bits of the rows whose fields are decoded even if they are absent, and UMBW_TABLE_SOUND; 0
     * before the first use. */
    atomic_uint_fast64_t *bits;
    const char *prefix; /* Beginning of the fields' names in errors: "lights." */
    size_t size;        /* Bytes of the struct; 0: the members are in the parent's struct */
};

/* Defines a table of rows that have a name. */
#define UMBW_TABLE_OF(name, message, field_prefix, struct_size, row_array)                         \
    _Static_assert(sizeof(row_array) / sizeof((row_array)[0]) <= UMBW_ROWS_MAX,                    \
                   #row_array " has more rows than UMBW_ROWS_MAX: the decoder needs more bits");   \
    static atomic_uint_fast64_t name##_BITS;                                                       \
    static const struct umbw_table name = {                                                        \
        &message##__descriptor, row_array,    sizeof(row_array) / sizeof((row_array)[0]),          \
        &name##_BITS,           field_prefix, struct_size}

/* Defines a table. The last arguments are its rows, in braces. */
#define UMBW_TABLE(name, message, field_prefix, struct_size, ...)                                  \
    UMBW_ROWS(name##_ROWS, __VA_ARGS__);                                                           \
    UMBW_TABLE_OF(name, message, field_prefix, struct_size, name##_ROWS)
#define UMBW_ROWS(name, ...) static const struct umbw_row name[] = {__VA_ARGS__}

/*
 * Decodes a message into a struct.
 *
 * Out:   out: the struct; zeros on failure. Its pointers lead into the message, or into a block of
 *        memory that begins with the first array or text of the table. The caller frees that one.
 * Fails: E_ARGUMENT (not the message, or a field out of its limits), E_TOO_LARGE, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbw_decode(const struct umbw_table *table, const uint8_t *message,
                                        size_t size, void *out, struct umb_error *error);

/*
 * Decodes a message into one malloc block with the struct, its arrays and its texts.
 *
 * Out:   out: the struct; NULL on failure. Fails: as umbw_decode.
 */
UMB_CHECKED enum umb_status umbw_decode_new(const struct umbw_table *table, const uint8_t *message,
                                            size_t size, void **out, struct umb_error *error);

/* Appends the 5-byte prefix and the message. Fails: E_ARGUMENT (a text or enum that the message
 * cannot hold), E_TOO_LARGE (an array over its limit, or a message over 4 GiB), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbw_encode(const struct umbw_table *table, const void *in,
                                        struct umbw_buffer *buffer, struct umb_error *error);

/* Defines the functions that UMBW_MESSAGE (messages.h) declares, for messages that need no more
 * than their table. */
#define UMBW_CODEC(name, type, table)                                                              \
    enum umb_status umbw_decode_##name(const uint8_t *message, size_t size, type *out,             \
                                       struct umb_error *error)                                    \
    {                                                                                              \
        return umbw_decode(&(table), message, size, out, error);                                   \
    }                                                                                              \
    UMBW_ENCODER(name, type, table)

#define UMBW_ENCODER(name, type, table)                                                            \
    enum umb_status umbw_encode_##name(const type *in, struct umbw_buffer *buffer,                 \
                                       struct umb_error *error)                                    \
    {                                                                                              \
        return umbw_encode(&(table), in, buffer, error);                                           \
    }

/* Writes the prefix and the message, except for bytes that the caller appends itself. If bytes is
 * NULL it only counts. Returns the number of bytes. The struct must be valid for the message. */
size_t umbw_write(const struct umbw_table *table, const void *in, uint8_t *bytes);

/* Checks a table against its message's descriptor, and stores the result in table->bits. Returns 0
 * and fails with E_INTERNAL if the rows are too few, or not in the order of the fields. */
uint64_t umbw_table_check(const struct umbw_table *table, struct umb_error *error);

/* Returns table->bits, which the first use of a table sets. */
static inline uint64_t umbw_table_bits(const struct umbw_table *table, struct umb_error *error)
{
    const uint64_t bits = atomic_load_explicit(table->bits, memory_order_relaxed);
    return bits != 0 ? bits : umbw_table_check(table, error);
}

/* --- Single fields: tag and payload --- */

enum umbw_wire_type {
    UMBW_WIRE_VARINT = 0,
    UMBW_WIRE_FIXED64 = 1,
    UMBW_WIRE_BYTES = 2,
    UMBW_WIRE_FIXED32 = 5,
};

/* One field in a message. */
struct umbw_item {
    uint32_t number;
    uint32_t type;          /* enum umbw_wire_type */
    const uint8_t *payload; /* Payload, behind the length of bytes */
    size_t payload_size;
    uint64_t value; /* Value of a varint or of 64 bits, else 0 */
};

/*
 * Reads the field at *at and moves *at to the byte after the field.
 *
 * In:    message: start of the message, for offsets in errors. end: end of the message; *at < end.
 * Fails: E_ARGUMENT (not a protobuf message).
 * Source: Protocol Buffers, "Encoding" (varints of at most 10 bytes, wire types 0, 1, 2, 5).
 */
UMB_CHECKED enum umb_status umbw_item_read(const uint8_t *message, const uint8_t **at,
                                           const uint8_t *end, struct umbw_item *item,
                                           struct umb_error *error);

/* Writes a varint (at most 10 bytes) and returns its length. */
size_t umbw_varint_write(uint64_t value, uint8_t out[10]);

#endif
