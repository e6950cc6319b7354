/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_FIELD_H
#define UMBRAGE_WIRE_FIELD_H
/*
 * Single fields of protobuf messages: tag and payload.
 *
 * Trust: safe on hostile bytes. No allocation.
 * Source: Protocol Buffers, "Encoding" (varints of at most 10 bytes, wire types 0, 1, 2, 5).
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

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
 */
UMB_CHECKED enum umb_status umbw_item_read(const uint8_t *message, const uint8_t **at,
                                           const uint8_t *end, struct umbw_item *item,
                                           struct umb_error *error);

/* Reads a varint and moves *at past the varint. Returns false if the varint is cut off or has more
 * than 64 bits. */
bool umbw_varint_read(const uint8_t **at, const uint8_t *end, uint64_t *value);

/* Writes a varint (at most 10 bytes) and returns its length. */
size_t umbw_varint_write(uint64_t value, uint8_t out[10]);

#endif
