/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernel compiled for x86-64 with AVX2, POPCNT and BMI; elsewhere it is the baseline. */
#define UMB__KERNEL umb__kernel_avx2
#include "query/kernel_body.h"
