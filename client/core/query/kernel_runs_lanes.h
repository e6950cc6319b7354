/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RUNS_LANES_H
#define UMBRAGE_CORE_QUERY_KERNEL_RUNS_LANES_H
/*
 * umb__read_brick and umb__read_runs of kernel_runs.h, eight points at a time. A file includes
 * kernel_runs_avx2.h or kernel_runs_simd128.h before this one: they have a brick's registers
 * (struct umb__brick_lanes, umb__load_brick) and answer eight points from it (umb__read_eight).
 */
#include "query/kernel_runs.h"

static inline void umb__lane_read_brick(struct umb__block *block, const uint64_t brick[8])
{
    const struct umb__brick_lanes lanes = umb__load_brick(brick);
    for (uint32_t i = 0; i < UMB__BLOCK; i += 8) {
        umb__read_eight(block, i, lanes);
    }
}

/* Always writes eight points; the next run overwrites the excess. */
static inline void umb__lane_read_runs(struct umb__block *block, const struct umb__block *heads,
                                       const struct umb__runs *runs,
                                       const uint64_t *const brick[UMB__BLOCK])
{
    const uint64_t settled = ~block->todo & UINT64_MAX >> (UMB__BLOCK - block->size);
    uint32_t kept[UMB__BLOCK];
    (void)heads;
    if (settled) {
        memcpy(kept, block->lit, sizeof kept);
    }
    for (uint32_t h = 0; h < runs->count; h++) {
        const struct umb__brick_lanes lanes = umb__load_brick(brick[h]);
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i += 8) {
            umb__read_eight(block, i, lanes);
        }
    }
    for (uint64_t rest = settled; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        block->lit[i] = kept[i];
    }
}

#endif
