/* SPDX-License-Identifier: Apache-2.0 */
/* The coarse kernel compiled for the baseline instruction set of the target. */
#define UMB__COARSE umb__kernel_coarse
#include "query/kernel_coarse_body.h"
