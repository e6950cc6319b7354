/* SPDX-License-Identifier: Apache-2.0 */
/* The coarse kernel compiled for x86-64 with AVX2, POPCNT and BMI; elsewhere it is the baseline. */
#define UMB__COARSE umb__kernel_coarse_avx2
#if defined(__AVX2__)
#include "query/kernel_place_avx2.h"
#define UMB__PLACER      umb__placer_avx2
#define UMB__PLACER_INIT umb__placer_init_avx2
#define UMB__PLACE       umb__place_block_avx2
#else
#define UMB__PLACER      umb__placer
#define UMB__PLACER_INIT umb__placer_init
#define UMB__PLACE       umb__place_block
#endif
#include "query/kernel_coarse_body.h"
