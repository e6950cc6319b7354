/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BASE_VECTORS_H
#define UMBRAGE_SERVER_BAKE_BASE_VECTORS_H
/*
 * Sets of vector instructions that the bake has kernels for. A table has a row of kernels for each
 * set (depth/depth_kernels.h, build/brick_slices.h). All rows give equal bits: the choice affects
 * time only. A file NAME_avx2.c or NAME_avx512.c is compiled for its set, and is empty on
 * processors other than x86-64.
 */

/* Each set contains those before it. */
enum umbb_vectors {
    UMBB_VECTORS_NONE = 0, /* the baseline, which every processor of the build's kind has */
    UMBB_VECTORS_AVX2 = 1,
    UMBB_VECTORS_AVX512 = 2, /* F, VL, BW and DQ */
};

/* The best set that this build has kernels for and this processor runs. */
static inline enum umbb_vectors umbb_vectors_best(void)
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq")) {
        return UMBB_VECTORS_AVX512;
    }
    if (__builtin_cpu_supports("avx2")) {
        return UMBB_VECTORS_AVX2;
    }
#endif
    return UMBB_VECTORS_NONE;
}

#endif
