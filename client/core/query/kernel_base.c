/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernel compiled for the baseline instruction set of the target. */
#define UMB__KERNEL umb__kernel_base
#define UMB__PLACE  umb__place_block
#define UMB__GRID   umb__grid_block
#include "query/kernel_body.h"
