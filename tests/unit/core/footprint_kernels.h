/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FOOTPRINT_KERNELS_H
#define UMBRAGE_TESTS_FOOTPRINT_KERNELS_H
/* Footprints by one kernel after another. */
#include <string.h>

#include "query/kernels.h"

/* The kernels that this processor can run, the simplest first. */
static inline size_t list_kernels(struct umb__kernels kernels[3])
{
    size_t count = 0;
    kernels[count++] =
        (struct umb__kernels){.receivers = umb__receivers_base, .squares = umb__squares_base};
#if defined(__x86_64__)
    const struct umb__kernels *here = umb__kernels_here();
    if (here->squares != umb__squares_base) {
        kernels[count++] =
            (struct umb__kernels){.receivers = umb__receivers_avx2, .squares = umb__squares_avx2};
    }
    if (here->squares == umb__squares_avx512) {
        kernels[count++] = (struct umb__kernels){.receivers = umb__receivers_avx512,
                                                 .squares = umb__squares_avx512};
    }
#endif
    return count;
}

/* Makes a query of footprints use these kernels. */
static inline void use_kernels(struct umb_query *query, const struct umb__kernels *kernels)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    q.kernels = kernels;
    memcpy(query->opaque, &q, sizeof q);
}

#endif
