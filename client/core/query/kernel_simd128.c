/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernels with WebAssembly's vectors of 128 bits. */
#define UMB__KERNEL umb__kernel_simd128
#define UMB__TENT   umb__tent_simd128
#define UMB__COARSE umb__kernel_coarse_simd128
#include "query/kernel_lanes_simd128.h"
#include "query/kernel_place_lanes.h"
#include "query/kernel_runs_simd128.h"
#include "query/kernel_runs_lanes.h"
#include "query/kernel_tent_simd128.h"
#define UMB__PLACER         umb__lane_placer
#define UMB__PLACER_INIT    umb__lane_placer_init
#define UMB__PLACE          umb__lane_place_block
#define UMB__PLACE_WINDOWS  umb__lane_place_block
#define UMB__GRID           umb__grid_block
#define UMB__COMPARE_POINTS umb__compare_points_simd128
#define UMB__READ_RUNS      umb__lane_read_runs
#define UMB__READ_BRICK     umb__lane_read_brick
#define UMB__WEIGH_ONE      umb__weigh_one_simd128
#include "query/kernel_body.h"
#include "query/kernel_coarse_body.h"
