/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNELS_H
#define UMBRAGE_CORE_QUERY_KERNELS_H
/* The kernels for each set of instructions. */
#include "query/receivers.h"

struct umb__kernels {
    umb__kernel *windows;         /* Windows of equal weights (kernel_body.h) ... */
    umb__kernel *tents;           /* ... and of a tent's */
    umb__kernel *coarse;          /* Look-ups that stop at a level (kernel_coarse_body.h) */
    umb__receivers_fn *receivers; /* Footprints (kernel_squares_body.h) ... */
    umb__squares_fn *squares;     /* ... and their look-ups */
};

/* Returns the kernels that are fastest on this processor. */
const struct umb__kernels *umb__kernels_here(void);

#endif
