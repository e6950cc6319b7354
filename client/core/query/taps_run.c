/* SPDX-License-Identifier: Apache-2.0 */
/* One tap on processors with AVX-512: the kernel that suits how points lie to one another. */
#include "query/query_parts.h"

/* Whole blocks, so that the cost counted is that of a batch in one piece. */
#define PROBE 512U  /* points that are looked at before wide vectors are thought of */
#define PIECE 4096U /* points until they are looked at again */

/*
 * Wide vectors lower the processor's clock, which pays for points without normals, since these are
 * placed in fixed point (kernel_place_avx512.h). Of points with normals it pays where most of a
 * point's time goes into placing it and reading what it shares with its neighbours, and costs where
 * it goes into its own way down. Nodes visited a point tell the two apart: 0.2 to 0.7 in pictures
 * from inside a scene, more than 2 where every point goes alone. Short batches are not worth a
 * change of clock.
 */
void umb__run_taps(const struct umb__query *query, const struct umb_points *points, size_t first,
                   size_t count, struct umb_answers *answers)
{
    const bool quick = points->normals == NULL;
    size_t most = quick && count > PROBE ? count : PROBE;
    bool shared = false;
    for (const size_t end = first + count; first < end;) {
        const size_t n = end - first < most ? end - first : most;
        const uint64_t before = answers->stats.nodes;
        const bool wide = (quick || shared) && n > PROBE;
        (wide ? umb__kernel_avx512 : umb__kernel_avx2)(query, points, first, n, answers);
        shared = answers->stats.nodes - before < n;
        most = PIECE;
        first += n;
    }
}
