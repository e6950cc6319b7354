/* SPDX-License-Identifier: Apache-2.0 */
/* Packed answers, see umbrage/picture.h: what did not change XORs to zeros, which zstd makes
 * nothing of. */
#include <string.h>
#include <xxhash.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "umbrage/picture.h"

enum {
    ZSTD_FAST = 1
};

size_t umb_picture_room(size_t size)
{
    return ZSTD_compressBound(size);
}

uint64_t umb_picture_mark(const void *values, size_t size)
{
    const uint64_t mark = XXH3_64bits(values, size);
    return mark ? mark : 1;
}

/* out may be either of the two. */
static void combine(const uint8_t *a, const uint8_t *b, uint8_t *out, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        out[i] = a[i] ^ b[i];
    }
}

enum umb_status umb_picture_pack(const void *values, const void *base, size_t size, void *scratch,
                                 void *packed, size_t *packed_size, struct umb_error *error)
{
    if (base) {
        combine(values, base, scratch, size);
        values = scratch;
    }
    const size_t length = ZSTD_compress(packed, umb_picture_room(size), values, size, ZSTD_FAST);
    *packed_size = ZSTD_isError(length) ? 0 : length;
    return ZSTD_isError(length)
               ? umb_fail(error, UMB_E_NO_MEMORY, "frame: zstd: %s", ZSTD_getErrorName(length))
               : UMB_OK;
}

enum umb_status umb_picture_unpack(const void *packed, size_t packed_size, const void *base,
                                   void *values, size_t size, struct umb_error *error)
{
    uint8_t *out = values;
    const size_t got = ZSTD_decompress(out, size, packed, packed_size);
    if (ZSTD_isError(got) && ZSTD_getErrorCode(got) == ZSTD_error_memory_allocation) {
        return umb_fail(error, UMB_E_NO_MEMORY, "frame: no memory to unpack it");
    }
    if (ZSTD_isError(got) || got != size) {
        return umb_fail(error, UMB_E_CORRUPT, "frame: %zu packed bytes are not %zu answers' bytes",
                        packed_size, size);
    }
    if (base) {
        combine(out, base, out, size);
    }
    return UMB_OK;
}
