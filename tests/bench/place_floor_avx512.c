/* SPDX-License-Identifier: Apache-2.0 */
/* The floor of place_floor.h with AVX-512. */
#include "query/kernel_lanes_avx512.h"

#define PLACE_FLOOR place_floor_avx512
#include "place_floor_body.h"
