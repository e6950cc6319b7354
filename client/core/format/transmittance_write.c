/* SPDX-License-Identifier: Apache-2.0 */
/* Writing transmittance maps (transmittance_write.h). */
#include "format/transmittance_write.h"

#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/numbers.h"
#include "base/try.h"

#define STEP_BYTES_MAX (2 * UMB__NUMBER_BYTES_MAX)

void umb__transmittance_bytes_finish(struct umb__transmittance_bytes *bytes)
{
    umb__free(bytes->alloc, bytes->data);
    memset(bytes, 0, sizeof *bytes);
}

static enum umb_status reserve(struct umb__transmittance_bytes *bytes, size_t more,
                               struct umb_error *error)
{
    return umb__grow(bytes->alloc, &bytes->data, &bytes->capacity, bytes->count + more, 1)
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "transmittance: no memory for %zu bytes",
                          bytes->count + more);
}

static enum umb_status check_limit(const struct umb__transmittance_bytes *bytes, size_t max_bytes,
                                   struct umb_error *error)
{
    return bytes->count <= max_bytes
               ? UMB_OK
               : umb_fail(error, UMB_E_LIMIT, "transmittance: more than %zu bytes", max_bytes);
}

static void put_varint(struct umb__transmittance_bytes *bytes, uint32_t value)
{
    bytes->count = (size_t)(umb__put_number(bytes->data + bytes->count, value) - bytes->data);
}

/* Makes room for a mask; returns its place. */
static size_t put_mask(struct umb__transmittance_bytes *bytes, uint64_t mask)
{
    const size_t at = bytes->count;
    umb__store64(bytes->data + at, mask);
    bytes->count += 8;
    return at;
}

static uint32_t fold(int64_t number)
{
    return (uint32_t)(number < 0 ? -2 * number - 1 : 2 * number);
}

/* Earlier steps of a square that a list may refer to. */
struct recent {
    int64_t first_z;                           /* First z of the list before */
    uint32_t drops[UMB__TRANSMITTANCE_RECENT]; /* Last drop by index modulo 8; 0: none yet */
};

/* Writes a list, for which there is room. */
static void put_list(struct umb__transmittance_bytes *bytes,
                     const struct umb__transmittance_list *list, struct recent *recent)
{
    for (uint32_t i = 0; i < list->count; i++) {
        const uint32_t z = list->steps[i].z, drop = list->steps[i].drop;
        const uint32_t step =
            i == 0 ? fold((int64_t)z - recent->first_z) : z - list->steps[i - 1].z - 1;
        uint32_t *last = &recent->drops[i % UMB__TRANSMITTANCE_RECENT];
        const uint32_t same = drop == *last, more = i + 1 < list->count;
        put_varint(bytes, 4 * step + 2 * same + more);
        if (drop != *last) {
            put_varint(bytes, drop - 1);
        }
        *last = drop;
    }
    recent->first_z = list->steps[0].z;
}

static const struct umb__transmittance_list *list_of(const struct umb__transmittance_list *lists,
                                                     uint32_t block, uint32_t texel)
{
    const size_t x = 8 * (block % 8) + texel % 8, y = 8 * (block / 8) + texel / 8;
    return &lists[y * UMB__TRANSMITTANCE_SIDE + x];
}

static enum umb_status put_block(struct umb__transmittance_bytes *bytes,
                                 const struct umb__transmittance_list *lists, uint32_t block,
                                 uint64_t texels, struct recent *recent, struct umb_error *error)
{
    UMB__TRY(reserve(bytes, 8, error));
    (void)put_mask(bytes, texels);
    for (; texels; texels &= texels - 1) {
        const struct umb__transmittance_list *list =
            list_of(lists, block, (uint32_t)__builtin_ctzll(texels));
        UMB__TRY(reserve(bytes, (size_t)list->count * STEP_BYTES_MAX, error));
        put_list(bytes, list, recent);
    }
    return UMB_OK;
}

enum umb_status umb__transmittance_square(struct umb__transmittance_bytes *bytes,
                                          const struct umb__transmittance_list *lists,
                                          size_t max_bytes, struct umb_error *error)
{
    uint64_t blocks = 0;
    struct recent recent = {0};
    UMB__TRY(reserve(bytes, 8, error));
    const size_t mask_at = put_mask(bytes, 0);
    for (uint32_t block = 0; block < 64; block++) {
        uint64_t texels = 0;
        for (uint32_t texel = 0; texel < 64; texel++) {
            texels |= (uint64_t)(list_of(lists, block, texel)->count > 0) << texel;
        }
        if (texels != 0) {
            blocks |= (uint64_t)1 << block;
            UMB__TRY(put_block(bytes, lists, block, texels, &recent, error));
        }
    }
    umb__store64(bytes->data + mask_at, blocks);
    return check_limit(bytes, max_bytes, error);
}

enum umb_status umb__transmittance_append(struct umb__transmittance_bytes *bytes, const void *data,
                                          size_t count, size_t max_bytes, struct umb_error *error)
{
    UMB__TRY(reserve(bytes, count, error));
    if (count > 0) {
        memcpy(bytes->data + bytes->count, data, count);
        bytes->count += count;
    }
    return check_limit(bytes, max_bytes, error);
}
