/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the kernels by what the processor has. */
#include "query/kernels.h"

/* Number of points of a batch up to which a change of the processor's clock does not pay */
#define FEW 512U

/* Runs short batches with AVX2 and others with AVX-512. Wide vectors lower the processor's clock,
 * but pay for longer batches, because points are placed in fixed point (kernel_place_avx512.h). */
void umb__run_wide(const struct umb__query *query, const struct umb_points *points, size_t first,
                   size_t count, struct umb_answers *answers)
{
    (count > FEW ? umb__kernel_avx512 : umb__kernel_avx2)(query, points, first, count, answers);
}

void umb__tent_wide(const struct umb__query *query, const struct umb_points *points, size_t first,
                    size_t count, struct umb_answers *answers)
{
    (count > FEW ? umb__tent_avx512 : umb__tent_avx2)(query, points, first, count, answers);
}

const struct umb__kernels *umb__kernels_here(void)
{
#if defined(__wasm_simd128__)
    static const struct umb__kernels simd128 = {umb__kernel_simd128, umb__tent_simd128,
                                                umb__kernel_coarse_simd128, umb__receivers_base,
                                                umb__squares_base};
    return &simd128;
#else
    static const struct umb__kernels base = {umb__kernel_base, umb__tent_base, umb__kernel_coarse,
                                             umb__receivers_base, umb__squares_base};
#if defined(__x86_64__)
    static const struct umb__kernels avx2 = {umb__kernel_avx2, umb__tent_avx2,
                                             umb__kernel_coarse_avx2, umb__receivers_avx2,
                                             umb__squares_avx2};
    static const struct umb__kernels wide = {umb__run_wide, umb__tent_wide, umb__kernel_coarse_avx2,
                                             umb__receivers_avx512, umb__squares_avx512};
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("popcnt") &&
        __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2")) {
        const bool is_wide =
            __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
            __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
            __builtin_cpu_supports("avx512cd");
        return is_wide ? &wide : &avx2;
    }
#endif
    return &base;
#endif
}
