/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernel compiled for the baseline instruction set of the target. */
#define UMB__KERNEL umb__kernel_base
#include "query/kernel_body.h"
