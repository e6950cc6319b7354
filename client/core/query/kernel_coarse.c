/* SPDX-License-Identifier: Apache-2.0 */
/* The coarse kernel compiled for the baseline instruction set of the target. */
#define UMB__COARSE      umb__kernel_coarse
#define UMB__PLACER      umb__placer
#define UMB__PLACER_INIT umb__placer_init
#define UMB__PLACE       umb__place_block
#include "query/kernel_coarse_body.h"
