/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels of footprints compiled for x86-64 with AVX2, POPCNT and BMI; elsewhere they are the
 * baseline. */
#define UMB__RECEIVERS_FN umb__receivers_avx2
#define UMB__SQUARES_FN   umb__squares_avx2
#if defined(__AVX2__)
#include "query/kernel_square_steps_avx2.h"
#define UMB__PLACE_SAMPLES umb__place_samples_avx2
#define UMB__CHILD_BYTES   umb__child_bytes_avx2
#define UMB__CHILDREN_IN   umb__children_in_avx2
#define UMB__SAMPLES_IN    umb__samples_in_avx2
#endif
#include "query/kernel_squares_body.h"
