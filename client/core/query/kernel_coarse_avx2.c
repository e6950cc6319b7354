/* SPDX-License-Identifier: Apache-2.0 */
/* The coarse kernel compiled for x86-64 with AVX2, POPCNT and BMI; elsewhere it is the baseline. */
#define UMB__COARSE umb__kernel_coarse_avx2
#if defined(__AVX2__)
#include "query/kernel_lanes_avx2.h"
#include "query/kernel_place_lanes.h"
#define UMB__PLACER      umb__lane_placer
#define UMB__PLACER_INIT umb__lane_placer_init
#define UMB__PLACE       umb__lane_place_block
#endif
#include "query/kernel_coarse_body.h"
