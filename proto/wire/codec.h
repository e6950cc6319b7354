/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_CODEC_H
#define UMBRAGE_WIRE_CODEC_H
/*
 * One decoder and one encoder for all messages, driven by tables.
 *
 * A table ties a message of a .proto file to a C struct: a row for each field, in the order of
 * their numbers. Number, name and type of a field come from protobuf-c's descriptor; the row says
 * where the field stands in the struct, and its limits.
 *
 * | field                          | member of the struct                                       |
 * |--------------------------------|------------------------------------------------------------|
 * | number, bool, enum             | 4 or 8 bytes, as the field's type; bool and enum: int      |
 * | repeated number                | array of 8-byte numbers; with a stride: any distance apart |
 * | string                         | char[], NUL-terminated; or char *                          |
 * | bytes                          | uint8_t[], exactly as long; or a pointer into the message, |
 * |                                | and its length as the row's count                          |
 * | repeated bytes                 | pointer to `stride` bytes each; the decoder gives the last |
 * | message                        | struct at its place                                        |
 * | repeated message               | pointer to an array; without a struct of its own (size 0): |
 * |                                | arrays in the parent's struct                              |
 * | message without a table (`of`) | pointer to its bytes and their length, or only a count     |
 *
 * Decoding does as protobuf says: unknown fields are dropped, of repeated single fields the last
 * one counts, repeated numbers may be packed or not, and pieces of one sub-message are joined.
 * Everything else that does not fit is an error that names the field, the value and the limit.
 * Encoding leaves out zeros, empty texts and bytes, and the fields whose count is 0.
 *
 * Trust: safe on hostile bytes. Memory is allocated only for a message that was checked whole.
 */
#include <protobuf-c/protobuf-c.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"
#include "wire/messages.h"

/* Most fields of a message, or of a single sub-message, unknown ones too: 1 ms of reading */
#define UMBW_FIELDS_MAX 65536
#define UMBW_NESTED_MAX (1 << 20) /* Most fields of all its sub-messages */
#define UMBW_ROWS_MAX   32        /* Most rows of a table */

enum umbw_row_flags {
    UMBW_REQUIRED = 1, /* Text that must not be empty; bytes or sub-message that must be present */
    UMBW_FILLED = 2,   /* char * or enum with `values`: set if the field is absent, too */
    UMBW_CHECKED =
        4,           /* Text: the encoder checks UTF-8, too. Enum: only values of the .proto file */
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
    size_t count, count_size; /* Place and bytes of the member that counts elements or bytes, or is
                                       1 if the field is present; count_size 0: none */
    size_t stride;            /* Distance of elements in bytes; 0: none */
    double most;              /* Largest number, most elements, or most bytes of a single
                                       sub-message, all its pieces together; 0: any */
    const struct umbw_table *table; /* Table of a sub-message */
    const int
        *values; /* Values of the struct's enum, by those of the .proto file; NULL: the same */
};

/* Place of a row's member, and of its count. */
#define UMBW_AT(type, member)                                                                      \
    .offset = offsetof(struct type, member), .size = sizeof(((struct type *)0)->member)
#define UMBW_COUNT(type, member)                                                                   \
    .count = offsetof(struct type, member), .count_size = sizeof(((struct type *)0)->member)

struct umbw_table {
    const ProtobufCMessageDescriptor *descriptor;
    const struct umbw_row
        *rows;          /* [descriptor->n_fields], in its order; a longer array serves messages
                                    that have more fields */
    const char *prefix; /* Beginning of the fields' names in errors: "lights." */
    size_t size;        /* Bytes of the struct */
    /* Place of the pointer to the memory of arrays and texts, for free(); block_size 0: the struct
     * needs none. */
    size_t block, block_size;
};

#define UMBW_BLOCK(type, member)                                                                   \
    .block = offsetof(struct type, member), .block_size = sizeof(((struct type *)0)->member)

/* Defines a table. The last arguments: bytes of the struct, and UMBW_BLOCK if it needs one. */
#define UMBW_TABLE(name, message, row_array, field_prefix, ...)                                    \
    static const struct umbw_table name = {.descriptor = &message##__descriptor,                   \
                                           .rows = row_array,                                      \
                                           .prefix = field_prefix,                                 \
                                           .size = __VA_ARGS__}

/*
 * Decodes a message into a struct.
 *
 * Out:   out: the struct; zeros on failure. Pointers lead into the message, or into the block,
 *        which the caller frees.
 * Fails: E_ARGUMENT (not the message, or a field that does not fit), E_TOO_LARGE, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbw_decode(const struct umbw_table *table, const uint8_t *message,
                                        size_t size, void *out, struct umb_error *error);

/* Decodes a message into a struct from malloc, which holds its arrays and texts, too. Out: out:
 * NULL on failure. Fails: as umbw_decode. */
UMB_CHECKED enum umb_status umbw_decode_new(const struct umbw_table *table, const uint8_t *message,
                                            size_t size, void **out, struct umb_error *error);

/* Appends prefix and message. Fails: E_ARGUMENT (a text or enum that the message cannot hold),
 * E_TOO_LARGE (an array over its limit, or over 4 GiB), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbw_encode(const struct umbw_table *table, const void *in,
                                        struct umbw_buffer *buffer, struct umb_error *error);

/* Defines what UMBW_MESSAGE (messages.h) declares. */
#define UMBW_CODEC(name, type, table)                                                              \
    enum umb_status umbw_decode_##name(const uint8_t *message, size_t size, type *out,             \
                                       struct umb_error *error)                                    \
    {                                                                                              \
        return umbw_decode(table, message, size, out, error);                                      \
    }                                                                                              \
    enum umb_status umbw_encode_##name(const type *in, struct umbw_buffer *buffer,                 \
                                       struct umb_error *error)                                    \
    {                                                                                              \
        return umbw_encode(table, in, buffer, error);                                              \
    }

/* Writes prefix and message without bytes that the caller appends. In: bytes: NULL: only counts.
 * Returns their number. The struct must fit the message. */
size_t umbw_write(const struct umbw_table *table, const void *in, uint8_t *bytes);

#endif
