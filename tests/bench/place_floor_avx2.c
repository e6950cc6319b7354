/* SPDX-License-Identifier: Apache-2.0 */
/* The floor of place_floor.h with AVX2. */
#include "query/kernel_lanes_avx2.h"

#define PLACE_FLOOR place_floor_avx2
#include "place_floor_body.h"
