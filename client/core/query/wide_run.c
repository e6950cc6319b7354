/* SPDX-License-Identifier: Apache-2.0 */
/* Processors with AVX-512: the kernel that suits the batch. */
#include "query/query_parts.h"

#define FEW 512U /* points that are not worth a change of clock */

/* Wide vectors lower the processor's clock, which pays, since points are placed in fixed point
 * (kernel_place_avx512.h). */
void umb__run_wide(const struct umb__query *query, const struct umb_points *points, size_t first,
                   size_t count, struct umb_answers *answers)
{
    (count > FEW ? umb__kernel_avx512 : umb__kernel_avx2)(query, points, first, count, answers);
}
