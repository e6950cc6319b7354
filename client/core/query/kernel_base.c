/* SPDX-License-Identifier: Apache-2.0 */
/* The query kernel compiled for the baseline instruction set of the target. */
#define UMB__KERNEL         umb__kernel_base
#define UMB__PLACER         umb__placer
#define UMB__PLACER_INIT    umb__placer_init
#define UMB__PLACE          umb__place_block
#define UMB__PLACE_WINDOWS  umb__place_block
#define UMB__GRID           umb__grid_block
#define UMB__COMPARE_POINTS umb__compare_points
#define UMB__TAKE_HEADS     umb__take_heads
#define UMB__READ_RUNS      umb__read_runs
#define UMB__MAKE_MASKS     umb__make_masks
#define UMB__TAKE_WINDOWS   umb__take_heads
#define UMB__TOUCHED_STATES umb__touched_states
#define UMB__SPREAD_SETTLED umb__spread_settled
#define UMB__COUNT_WINDOWS  umb__count_windows
#define UMB__READ_BRICK     umb__read_brick
#define UMB__STEP_HEADS     umb__step_heads
#include "query/kernel_body.h"
