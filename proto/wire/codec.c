/* SPDX-License-Identifier: Apache-2.0 */
/* Shared helpers of the message codecs, see codec.h. */
#include "wire/codec.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "base/utf8.h"
#include "wire/proto_scan.h"
#include "wire/wire_buffer.h"

#define EXPANSION_FACTOR 16 /* Largest growth: a Light of 150 bytes takes about 450 */
#define EXPANSION_BASE   ((size_t)1 << 20)

/* Counts what protobuf-c allocates during one unpack. */
struct budget {
    size_t left;
    bool exceeded, refused; /* By the budget; by malloc */
};

static void *budget_alloc(void *user, size_t size)
{
    struct budget *budget = user;
    if (size > budget->left) {
        budget->exceeded = true;
        return NULL;
    }
    budget->left -= size;
    void *block = malloc(size == 0 ? 1 : size);
    budget->refused = budget->refused || block == NULL;
    return block;
}

static void budget_free(void *user, void *block)
{
    (void)user;
    free(block);
}

/*
 * Counts the fields that the descriptor does not have, in sub-messages too. protobuf-c allocates
 * memory for each, so two bytes of a message become a hundred bytes of memory.
 */
static enum umb_status count_unknown(const ProtobufCMessageDescriptor *descriptor,
                                     const uint8_t *bytes, size_t size, size_t *count,
                                     struct umb_error *error)
{
    const uint8_t *at = bytes;
    const uint8_t *const end = bytes + size;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK && at < end) {
        struct umbw_item item;
        UMB__TRY(umbw_item_read(bytes, &at, end, &item, error));
        const ProtobufCFieldDescriptor *field =
            protobuf_c_message_descriptor_get_field(descriptor, item.number);
        if (field == NULL && ++*count > UMBW_FIELDS_MAX) {
            return umb_fail(error, UMB_E_TOO_LARGE, "message: has more than %d unknown fields",
                            UMBW_FIELDS_MAX);
        }
        if (field != NULL && field->type == PROTOBUF_C_TYPE_MESSAGE &&
            item.type == UMBW_WIRE_BYTES) {
            status =
                count_unknown(field->descriptor, item.payload, item.payload_size, count, error);
        }
    }
    return status;
}

enum umb_status umbw_message_unpack(const ProtobufCMessageDescriptor *descriptor,
                                    const uint8_t *bytes, size_t size, ProtobufCMessage **out,
                                    struct umb_error *error)
{
    static const uint8_t nothing;
    struct budget budget = {.left = EXPANSION_BASE};
    size_t unknown = 0;
    *out = NULL;
    if (size > UMBW_SCRATCH_MAX) { /* Fewer bytes hold too few fields to matter */
        UMB__TRY(count_unknown(descriptor, bytes, size, &unknown, error));
    }
    if (size < (SIZE_MAX - EXPANSION_BASE) / EXPANSION_FACTOR) {
        budget.left += size * EXPANSION_FACTOR;
    }
    ProtobufCAllocator allocator = {budget_alloc, budget_free, &budget};
    *out = protobuf_c_message_unpack(descriptor, &allocator, size, size == 0 ? &nothing : bytes);
    if (*out != NULL) {
        return UMB_OK;
    }
    if (budget.exceeded) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: %zu bytes of %s would take more than %zu bytes and %d times that",
                        size, descriptor->name, EXPANSION_BASE, EXPANSION_FACTOR);
    }
    if (budget.refused) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a %s of %zu bytes",
                        descriptor->name, size);
    }
    return umb_fail(error, UMB_E_ARGUMENT, "message: %zu bytes are not a valid %s", size,
                    descriptor->name);
}

void umbw_message_free(ProtobufCMessage *message)
{
    if (message != NULL) {
        struct budget budget = {.left = 0};
        ProtobufCAllocator allocator = {budget_alloc, budget_free, &budget};
        protobuf_c_message_free_unpacked(message, &allocator);
    }
}

enum umb_status umbw_message_append(const ProtobufCMessage *message, struct umbw_buffer *buffer,
                                    struct umb_error *error)
{
    size_t size = protobuf_c_message_get_packed_size(message);
    enum umb_status status = umbw_buffer_begin_message(buffer, size, size, error);
    if (status == UMB_OK) {
        buffer->size += protobuf_c_message_pack(message, buffer->bytes + buffer->size);
    }
    return status;
}

enum umb_status umbw_text_copy(const char *name, const uint8_t *bytes, size_t size, size_t max,
                               char *out, struct umb_error *error)
{
    out[0] = '\0';
    if (size > max) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: %zu bytes are over the limit of %zu bytes",
                        name, size, max);
    }
    if (!umb__utf8_valid(bytes, size)) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: not UTF-8 text without NUL", name);
    }
    if (size > 0) {
        memcpy(out, bytes, size);
    }
    out[size] = '\0';
    return UMB_OK;
}

enum umb_status umbw_asset_copy(const uint8_t *bytes, size_t size,
                                char out[UMBW_ASSET_NAME_MAX + 1], struct umb_error *error)
{
    if (size == 0) {
        out[0] = '\0';
        return umb_fail(error, UMB_E_ARGUMENT, "asset: is empty, must be a name or an id");
    }
    return umbw_text_copy("asset", bytes, size, UMBW_ASSET_NAME_MAX, out, error);
}

enum umb_status umbw_id_copy(const char *name, const uint8_t *bytes, size_t size,
                             uint8_t out[UMB_ID_BYTES], struct umb_error *error)
{
    if (size != UMB_ID_BYTES) {
        memset(out, 0, UMB_ID_BYTES);
        return umb_fail(error, UMB_E_ARGUMENT, "%s: length is %zu bytes, must be %d", name, size,
                        UMB_ID_BYTES);
    }
    memcpy(out, bytes, UMB_ID_BYTES);
    return UMB_OK;
}

enum umb_status umbw_vector_copy(const char *name, const double *values, size_t count,
                                 double out[3], struct umb_error *error)
{
    memset(out, 0, 3 * sizeof *out);
    if (count != 0 && count != 3) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: has %zu numbers, must have none or three", name,
                        count);
    }
    if (count == 3) {
        memcpy(out, values, 3 * sizeof *out);
    }
    return UMB_OK;
}
