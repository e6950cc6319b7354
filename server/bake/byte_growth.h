/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BYTE_GROWTH_H
#define UMBRAGE_SERVER_BAKE_BYTE_GROWTH_H
/*
 * Bytes of nodes and of packed files at a resolution, from bakes at lower ones.
 *
 * The bytes of the nodes of each level, each node once, are continued from one doubling to the
 * next: a level's growth follows its own trend and that of the level below. The ratio of the bytes
 * under the closed and the open rule is continued in the same way, because it changes more steadily
 * than the bytes of either. Both forecasts use no function of libm, because ids depend on them.
 *
 * The bytes of a file are a product: bytes of nodes, each once; copies of nodes that several pages
 * need; bytes of the file for each byte in its pages. The factors are continued for small and for
 * large pages. The copies of small pages decide which of the two the file will have.
 */
#include "bake/small_bake.h"

/* Bakes of one rule at resolutions that double. */
struct umbb_growth_samples {
    const struct umbb_costs *costs; /* [count] in ascending order of the resolution */
    uint32_t count;                 /* 2 or 3 */
};

/* Bytes of each rule: of nodes before compression, or of a file. */
struct umbb_rule_bytes {
    double open, closed;
};

/* Forecasts the bytes of nodes `doublings` above the last samples. Equal on every machine. */
struct umbb_rule_bytes umbb_growth_nodes(const struct umbb_growth_samples *open,
                                         const struct umbb_growth_samples *closed,
                                         uint32_t doublings);

/* Forecasts the packed bytes of one rule. In: samples with packed bytes. */
double umbb_growth_packed(const struct umbb_growth_samples *samples, uint32_t doublings);

/* Returns a factor: the packed bytes are between a forecast divided by it and multiplied by it. The
 * factor is measured, not proven (docs/results/effects.md). */
double umbb_growth_packed_factor(uint32_t samples, uint32_t doublings);

/* Sum of the estimated bytes of all levels, at least 1. */
double umbb_level_bytes_sum(const struct umbb_costs *costs);

#endif
