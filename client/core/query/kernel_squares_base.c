/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels of footprints compiled for the baseline instruction set of the target. */
#define UMB__RECEIVERS_FN umb__receivers_base
#define UMB__SQUARES_FN   umb__squares_base
#include "query/kernel_squares_body.h"
