/* SPDX-License-Identifier: Apache-2.0 */
/* The floor of place_floor.h with AVX2. */
#include "query/kernel_lanes_avx2.h"
#include "query/kernel_place_lanes.h"

#define PLACE_FLOOR place_floor_avx2
#define PLACER      umb__lane_placer
#define PLACER_INIT umb__lane_placer_init
#define PLACE       umb__lane_place_block
#include "place_floor_body.h"
