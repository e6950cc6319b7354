/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RUNS_H
#define UMBRAGE_CORE_QUERY_KERNEL_RUNS_H
/*
 * Runs: neighbouring points that share a look-up. Where pixels are denser than voxels, most points
 * of a picture are in the brick of the point before. So a block is cut into runs of points in one
 * brick. Only the first point of a run, the head, is looked up, and the head's brick answers all
 * points of the run. The heads form a block, which goes through the stages like any other.
 *
 * For windows, a run is a sequence of windows that begin in one brick: they touch the same bricks,
 * or fewer.
 */
#include "query/kernel_parts.h"

#define UMB__RUNS_MAX   40 /* Most runs of a block: with more, every point descends by itself */
#define UMB__MERGED_MAX 32

struct umb__runs {
    uint64_t starts; /* Bit i: a run begins with point i */
    uint32_t count;
    uint8_t first[UMB__BLOCK + 1]; /* First point of each run; behind the last: the size */
    bool merged;                   /* True: a head may stand for several runs (AVX-512) */
    _Alignas(64) uint32_t head[UMB__MERGED_MAX]; /* Head of each run, if merged */
};

static const uint64_t umb__uniform_bricks[2][8] = {
    {0},
    {UINT64_MAX, UINT64_MAX, UINT64_MAX, UINT64_MAX, UINT64_MAX, UINT64_MAX, UINT64_MAX,
     UINT64_MAX},
};

/* Where neighbouring points of a block are in different bricks. */
struct umb__closeness {
    uint64_t changes; /* Bit i: point i is in another brick than the point before */
    uint32_t spread;  /* Bits in which a coordinate of any point differs from the point before;
                         UINT32_MAX if the block is not full or some point has no look-up */
};

static inline struct umb__closeness umb__compare_points(const struct umb__block *block)
{
    struct umb__closeness close = {0};
    for (uint32_t i = 1; i < block->size; i++) {
        uint32_t differ = (uint32_t)(block->x[i] ^ block->x[i - 1]) |
                          (uint32_t)(block->y[i] ^ block->y[i - 1]) |
                          (uint32_t)(block->z[i] ^ block->z[i - 1]);
        close.spread |= differ;
        close.changes |= (uint64_t)(differ > 7) << i;
    }
    close.spread |= block->todo == UINT64_MAX ? 0 : UINT32_MAX;
    return close;
}

/* Returns a word whose bit i is set if a run begins at point i. A run never has both points with a
 * look-up and points without. */
static inline uint64_t umb__run_starts(const struct umb__block *block, uint64_t changes)
{
    uint64_t inside = UINT64_MAX >> (UMB__BLOCK - block->size);
    return (1 | changes | (block->todo ^ block->todo << 1)) & inside;
}

/* Makes the block of heads: one for each run. The head of several windows begins at the last texel
 * of its brick at which a window may begin, so that it touches all bricks that any of these windows
 * touches. */
static inline void umb__take_heads(const struct umb__query *q, const struct umb__block *block,
                                   uint64_t starts, struct umb__block *heads,
                                   struct umb__runs *runs)
{
    int32_t last = ((int32_t)1 << q->log2_size) - q->taps;
    uint32_t count = 0;
    heads->todo = 0;
    runs->starts = starts;
    while (starts) {
        uint32_t i = umb__first_bit(starts);
        starts &= starts - 1;
        uint32_t next = starts ? umb__first_bit(starts) : block->size;
        int32_t within = next - i > 1 ? 7 : 0;
        int32_t x = block->x[i] | within, y = block->y[i] | within;
        heads->x[count] = x < last ? x : last;
        heads->y[count] = y < last ? y : last;
        heads->z[count] = block->z[i];
        heads->todo |= (block->todo >> i & 1) << count;
        runs->first[count] = (uint8_t)i;
        count++;
    }
    runs->first[count] = (uint8_t)block->size;
    runs->count = count;
    heads->size = count;
    umb__pad_block(heads);
}

/* One tap: answers a whole block from one brick. */
static inline void umb__read_brick(struct umb__block *block, const uint64_t brick[8])
{
    for (uint32_t i = 0; i < UMB__BLOCK; i++) {
        uint32_t bit = ((uint32_t)block->x[i] & 7) | ((uint32_t)block->y[i] & 7) << 3;
        block->lit[i] = (uint32_t)(brick[block->z[i] & 7] >> bit & 1);
    }
}

/* For one tap: answers the points of all runs from the bricks of their heads. */
static inline void umb__read_runs(struct umb__block *block, const struct umb__block *heads,
                                  const struct umb__runs *runs,
                                  const uint64_t *const brick[UMB__BLOCK])
{
    for (uint64_t rest = heads->todo; rest; rest &= rest - 1) {
        uint32_t h = umb__first_bit(rest);
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i++) {
            uint32_t bit = ((uint32_t)block->x[i] & 7) | ((uint32_t)block->y[i] & 7) << 3;
            block->lit[i] = (uint32_t)(brick[h][block->z[i] & 7] >> bit & 1);
        }
    }
}

#endif
