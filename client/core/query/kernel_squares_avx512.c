/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels of footprints compiled for x86-64 with AVX-512 as kernel_avx512.c is; elsewhere they
 * are the baseline. */
#define UMB__RECEIVERS_FN umb__receivers_avx512
#define UMB__SQUARES_FN   umb__squares_avx512
#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512BW__) &&                      \
    defined(__AVX512DQ__) && defined(__AVX512CD__)
#include "query/kernel_square_steps_avx512.h"
#define UMB__PLACE_SAMPLES umb__place_samples_avx512
#define UMB__CHILD_BYTES   umb__child_bytes_avx512
#define UMB__CHILDREN_IN   umb__children_in_avx512
#define UMB__SAMPLES_IN    umb__samples_in_avx512
#define UMB__SLICE_PLACES  umb__slice_places_avx512
#define UMB__LIT_IN_BRICK  umb__lit_in_brick_avx512
#endif
#include "query/kernel_squares_body.h"
