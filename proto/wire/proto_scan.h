/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_PROTO_SCAN_H
#define UMBRAGE_WIRE_PROTO_SCAN_H
/*
 * One look at the top level of a protobuf message before protobuf-c sees it.
 *
 * A message type gives a table of its fields. The scan walks the message once and
 *   - leaves large and checked byte fields in place: pointers into the message, last one wins;
 *   - counts repeated sub-messages, so that a limit is met before anything is allocated;
 *   - copies the other known fields to a small scratch block for protobuf-c;
 *   - drops unknown fields (they may come from a newer peer);
 *   - names the field when a length or a wire type is wrong.
 * So protobuf-c never sees more than UMBW_SCRATCH_MAX bytes of the messages that use the scratch.
 *
 * Trust: safe on hostile bytes. Cost: O(fields), no allocation.
 * Source: Protocol Buffers, "Encoding" (varints of at most 10 bytes, wire types 0, 1, 2, 5).
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBW_FIELDS_MAX                                                                            \
    65536 /* Most fields in one message, unknown ones too: a millisecond of
                                  scanning */
#define UMBW_SCRATCH_MAX                                                                           \
    4096 /* Most bytes of small fields in one message; a full request needs
                                  400 */

enum umbw_wire_type {
    UMBW_WIRE_VARINT = 0,
    UMBW_WIRE_FIXED64 = 1,
    UMBW_WIRE_BYTES = 2,
    UMBW_WIRE_FIXED32 = 5,
};

enum umbw_field_kind {
    UMBW_FIELD_SCALAR,   /* To the scratch; the wire type must be `type` */
    UMBW_FIELD_PACKED,   /* Repeated number, `type` or packed: to the scratch */
    UMBW_FIELD_MESSAGE,  /* Sub-message: to the scratch, counted */
    UMBW_FIELD_IN_PLACE, /* Bytes, string or sub-message: left in place in the message */
};

struct umbw_field {
    uint32_t number;
    enum umbw_field_kind kind;
    enum umbw_wire_type type; /* of one element */
    const char *name;         /* Name as in the .proto file, for errors */
};

/* Result of the scan for the field at the same place of the table. */
struct umbw_field_found {
    const uint8_t *bytes; /* In place: the last occurrence; NULL if absent */
    size_t size;
    size_t count;    /* occurrences */
    uint64_t number; /* Last value of a varint or fixed64 */
};

/* Fixed storage for the fields that protobuf-c decodes. */
struct umbw_scratch {
    uint8_t bytes[UMBW_SCRATCH_MAX];
    size_t size;
};

/*
 * Scans a message.
 *
 * In:    fields, field_count: the table. scratch: may be NULL, then scalars and sub-messages are
 *        only checked and counted (the caller gives the whole message to protobuf-c).
 * Out:   found: [field_count].
 * Fails: E_ARGUMENT (not a protobuf message, a wrong wire type, more than the scratch holds, more
 *        than UMBW_FIELDS_MAX fields).
 */
UMB_CHECKED enum umb_status umbw_proto_scan(const uint8_t *message, size_t size,
                                            const struct umbw_field *fields, size_t field_count,
                                            struct umbw_field_found *found,
                                            struct umbw_scratch *scratch, struct umb_error *error);

/* One field in a message. */
struct umbw_item {
    uint32_t number;
    uint32_t type;          /* enum umbw_wire_type */
    const uint8_t *start;   /* of its tag */
    const uint8_t *payload; /* Payload, behind the length of bytes */
    size_t payload_size;
};

/*
 * Reads the field at *at and moves *at behind it, for messages whose repeated fields are read one
 * by one. In: end: of the message; *at < end. Fails: E_ARGUMENT (not a protobuf message).
 */
UMB_CHECKED enum umb_status umbw_item_read(const uint8_t *message, const uint8_t **at,
                                           const uint8_t *end, struct umbw_item *item,
                                           struct umb_error *error);

/* Writes a varint (at most 10 bytes) and returns its length. */
size_t umbw_varint_write(uint64_t value, uint8_t out[10]);

/* Collects a repeated double of three, packed or not. Few messages have one, so it has a walk of
 * its own. Fails: E_ARGUMENT, naming the field. */
UMB_CHECKED enum umb_status umbw_scan_vector(const uint8_t *message, size_t size,
                                             const struct umbw_field *field, double vector[3],
                                             struct umb_error *error);

#endif
