/* SPDX-License-Identifier: Apache-2.0 */
/* The span in plain C, straight from the predicate. */
#include "bake/depth/depth_span.h"

void umbb_span_plain(const struct umbb_coverage *coverage, double row_z, int32_t x_first,
                     int32_t x_last, int32_t x_origin, int32_t *layer)
{
    for (int32_t x = x_first; x <= x_last; x++) {
        const int32_t lit = umbb_coverage_lit(coverage, row_z, x);
        int32_t *at = layer + (x - x_origin);
        *at = lit < *at ? lit : *at;
    }
}
