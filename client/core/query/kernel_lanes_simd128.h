/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_LANES_SIMD128_H
#define UMBRAGE_CORE_QUERY_KERNEL_LANES_SIMD128_H
/* Lanes (kernel_place_lanes.h) of WebAssembly's vectors of 128 bits: two doubles, and eight
 * integers in two vectors. */
#include <wasm_simd128.h>
#include "query/kernel_parts.h"

#define UMB__LANES 2U

typedef double umb__lanes __attribute__((vector_size(16)));
typedef v128_t umb__lane_ints; /* In the lower half */
typedef long long umb__lane_mask __attribute__((vector_size(16)));

#define UMB__LANES_OF(value)      ((umb__lanes)wasm_f64x2_splat(value))
#define UMB__LANES_SQRT(a)        ((umb__lanes)wasm_f64x2_sqrt((v128_t)(a)))
#define UMB__LANES_ABS(a)         ((umb__lanes)wasm_f64x2_abs((v128_t)(a)))
#define UMB__LANES_ABOVE(a, b)    ((umb__lane_mask)((a) > (b)))
#define UMB__LANES_AT_LEAST(a, b) ((umb__lane_mask)((a) >= (b)))
#define UMB__LANES_NONE(mask)     (!wasm_v128_any_true((v128_t)(mask)))
#define UMB__LANES_ALL(mask)      wasm_i64x2_all_true((v128_t)(mask))
#define UMB__MASK_AND(a, b)       ((a) & (b))
#define UMB__MASK_BITS(mask)      ((unsigned)wasm_i64x2_bitmask((v128_t)(mask)))
#define UMB__LANES_SELECT(mask, yes, no)                                                           \
    ((umb__lanes)wasm_v128_bitselect((v128_t)(yes), (v128_t)(no), (v128_t)(mask)))
/* Rounds towards zero; INT32_MIN or INT32_MAX for numbers beyond 32 bits, 0 for NaN. */
#define UMB__LANES_TRUNCATE(a)  wasm_i32x4_trunc_sat_f64x2_zero((v128_t)(a))
#define UMB__LANES_FROM_INTS(i) ((umb__lanes)wasm_f64x2_convert_low_i32x4(i))

/* Returns the lanes in which any of three numbers is negative, -0 or NaN; and perhaps lanes with
 * infinite numbers. */
static inline unsigned umb__lanes_negative(umb__lanes a, umb__lanes b, umb__lanes c)
{
    const umb__lanes sum = a + b + c;
    const v128_t sign = (v128_t)a | (v128_t)b | (v128_t)c;
    return UMB__MASK_BITS(sign | (v128_t)(sum != sum));
}

/* Loads three floats a point, x y z interleaved, of two points. */
static inline void umb__lanes_load_f32(const uint8_t *at, umb__lanes axis[3])
{
    const v128_t a = wasm_v128_load(at), b = wasm_v128_load64_zero(at + 16);
    axis[0] = (umb__lanes)wasm_f64x2_promote_low_f32x4(wasm_i32x4_shuffle(a, b, 0, 3, 0, 3));
    axis[1] = (umb__lanes)wasm_f64x2_promote_low_f32x4(wasm_i32x4_shuffle(a, b, 1, 4, 1, 4));
    axis[2] = (umb__lanes)wasm_f64x2_promote_low_f32x4(wasm_i32x4_shuffle(a, b, 2, 5, 2, 5));
}

/* Loads three doubles a point, x y z interleaved, of two points. */
static inline void umb__lanes_load_f64(const uint8_t *at, umb__lanes axis[3])
{
    const v128_t a = wasm_v128_load(at), b = wasm_v128_load(at + 16), c = wasm_v128_load(at + 32);
    axis[0] = (umb__lanes)wasm_i64x2_shuffle(a, b, 0, 3);
    axis[1] = (umb__lanes)wasm_i64x2_shuffle(a, c, 1, 2);
    axis[2] = (umb__lanes)wasm_i64x2_shuffle(b, c, 0, 3);
}

typedef struct {
    v128_t low, high;
} umb__eight;
typedef uint32_t umb__eight_shift; /* Number of bits of a shift */

static inline umb__eight umb__eight_of(int32_t value)
{
    const v128_t four = wasm_i32x4_splat(value);
    return (umb__eight){four, four};
}

static inline umb__eight_shift umb__eight_shift_of(uint32_t bits)
{
    return bits;
}

static inline umb__eight umb__eight_add(umb__eight a, umb__eight b)
{
    return (umb__eight){wasm_i32x4_add(a.low, b.low), wasm_i32x4_add(a.high, b.high)};
}

static inline umb__eight umb__eight_sub(umb__eight a, umb__eight b)
{
    return (umb__eight){wasm_i32x4_sub(a.low, b.low), wasm_i32x4_sub(a.high, b.high)};
}

static inline umb__eight umb__eight_or(umb__eight a, umb__eight b)
{
    return (umb__eight){a.low | b.low, a.high | b.high};
}

/* Returns the lanes that are 0 to 1 << bits, exclusive. */
static inline unsigned umb__eight_below(umb__eight v, umb__eight_shift bits)
{
    const v128_t zero = wasm_i32x4_splat(0);
    const v128_t low = wasm_i32x4_eq(wasm_u32x4_shr(v.low, bits), zero);
    const v128_t high = wasm_i32x4_eq(wasm_u32x4_shr(v.high, bits), zero);
    return (unsigned)(wasm_i32x4_bitmask(low) | wasm_i32x4_bitmask(high) << 4);
}

/* Sets lanes to 0. */
static inline umb__eight umb__eight_clear(umb__eight v, unsigned lanes)
{
    const v128_t bits = wasm_i32x4_make(1, 2, 4, 8), zero = wasm_i32x4_splat(0);
    const v128_t low = wasm_i32x4_splat((int32_t)lanes) & bits;
    const v128_t high = wasm_i32x4_splat((int32_t)(lanes >> 4)) & bits;
    return (umb__eight){v.low & wasm_i32x4_eq(low, zero), v.high & wasm_i32x4_eq(high, zero)};
}

static inline void umb__eight_store(int32_t *to, umb__eight v)
{
    wasm_v128_store(to, v.low);
    wasm_v128_store(to + 4, v.high);
}

/* Eight integers from four times two lanes. */
static inline umb__eight umb__join_ints(const umb__lane_ints part[8 / UMB__LANES])
{
    return (umb__eight){wasm_i64x2_shuffle(part[0], part[1], 0, 2),
                        wasm_i64x2_shuffle(part[2], part[3], 0, 2)};
}

#endif
