/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernels compiled for x86-64 with AVX2, POPCNT and BMI; elsewhere they are the
 * baseline. */
#define UMB__KERNEL umb__kernel_avx2
#define UMB__TENT   umb__tent_avx2
#define UMB__COARSE umb__kernel_coarse_avx2
#if defined(__AVX2__)
#include "query/kernel_lanes_avx2.h"
#include "query/kernel_place_lanes.h"
#include "query/kernel_runs_avx2.h"
#include "query/kernel_runs_lanes.h"
#include "query/kernel_tent_avx2.h"
#define UMB__PLACER         umb__lane_placer
#define UMB__PLACER_INIT    umb__lane_placer_init
#define UMB__PLACE          umb__lane_place_block
#define UMB__PLACE_WINDOWS  umb__lane_place_block
#define UMB__GRID           umb__grid_block_avx2
#define UMB__COMPARE_POINTS umb__compare_points_avx2
#define UMB__READ_RUNS      umb__lane_read_runs
#define UMB__READ_BRICK     umb__lane_read_brick
#define UMB__WEIGH_ONE      umb__weigh_one_avx2
#endif
#include "query/kernel_body.h"
#include "query/kernel_coarse_body.h"
