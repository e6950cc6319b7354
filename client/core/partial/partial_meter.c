/* SPDX-License-Identifier: Apache-2.0 */
/* The memory budget of a partial asset: an allocator that counts what is allocated. */
#include <string.h>

#include "base/memory.h"
#include "partial/partial_parts.h"

/* The size of each block is stored before it, in 16 bytes, which keep the block aligned. */
#define PREFIX 16U

static void *resize(void *user, void *block, size_t bytes)
{
    struct umb__meter *meter = user;
    uint8_t *old = block ? (uint8_t *)block - PREFIX : NULL;
    uint64_t had = 0;
    if (old) {
        memcpy(&had, old, sizeof had);
    }
    if (bytes == 0) {
        umb__free(meter->inner, old);
        meter->used -= had;
        return NULL;
    }
    const uint64_t all = (uint64_t)bytes + PREFIX;
    if (all < bytes || all > meter->limit || meter->used - had > meter->limit - all) {
        return NULL;
    }
    uint8_t *made = umb__resize(meter->inner, old, (size_t)all);
    if (!made) {
        return NULL;
    }
    memcpy(made, &all, sizeof all);
    meter->used += all - had;
    meter->peak = meter->used > meter->peak ? meter->used : meter->peak;
    return made + PREFIX;
}

bool umb__partial_move(struct umb_partial *to, struct umb_partial *from, const void *block)
{
    uint64_t all;
    memcpy(&all, (const uint8_t *)block - PREFIX, sizeof all);
    if (all > to->meter.limit - to->meter.used) {
        return false;
    }
    from->meter.used -= all;
    to->meter.used += all;
    to->meter.peak = to->meter.used > to->meter.peak ? to->meter.used : to->meter.peak;
    return true;
}

void umb__meter_init(struct umb__meter *meter, const struct umb_alloc *inner, uint64_t limit,
                     struct umb_alloc *alloc)
{
    *meter = (struct umb__meter){.inner = inner, .limit = limit};
    *alloc = (struct umb_alloc){.resize = resize, .user = meter};
}
