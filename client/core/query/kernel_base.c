/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernels compiled for the baseline instruction set of the target. */
#define UMB__KERNEL umb__kernel_base
#define UMB__TENT   umb__tent_base
#define UMB__COARSE umb__kernel_coarse
#include "query/kernel_body.h"
#include "query/kernel_coarse_body.h"
