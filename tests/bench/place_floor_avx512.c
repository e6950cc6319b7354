/* SPDX-License-Identifier: Apache-2.0 */
/* The floor of place_floor.h with AVX-512. */
#include "query/kernel_place_avx512.h"

#define PLACE_FLOOR place_floor_avx512
#define PLACER      umb__wide_placer
#define PLACER_INIT umb__wide_placer_init
#define PLACE       umb__wide_place_points
#include "place_floor_body.h"
