/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_HALF_H
#define UMBRAGE_CORE_MAPS_MAP_HALF_H
/* IEEE 754 half precision as GPUs filter it, converted without hardware. Pure. */
#include <math.h>
#include <stdint.h>

#define UMB__HALF_MAX 65504.0

/* Rounds to the nearest half, ties to even. Numbers beyond the range become infinite, NaN a NaN. */
static inline uint16_t umb__half_from(double value)
{
    const uint16_t sign = signbit(value) ? 0x8000U : 0;
    double size = fabs(value);
    if (isnan(value)) {
        return 0x7e00;
    }
    if (size >= 65520.0) { /* Halfway from the greatest half to the next number */
        return (uint16_t)(sign | 0x7c00U);
    }
    int exponent = 0;
    (void)frexp(size, &exponent); /* size = f 2^exponent with f in [1/2, 1) */
    exponent = exponent < -13 || size == 0.0 ? -13 : exponent; /* Subnormals share one exponent */
    /* The size in units of 2^(exponent - 11), at most 2048. A size of 2048 carries into the
     * exponent's bits, which is right. */
    const uint32_t units = (uint32_t)nearbyint(ldexp(size, 11 - exponent));
    return (uint16_t)(sign | (((uint32_t)(exponent + 13) << 10) + units));
}

static inline double umb__half_to(uint16_t half)
{
    const int exponent = (half >> 10) & 31;
    const double fraction = (double)(half & 0x3ffU);
    double size;
    if (exponent == 31) {
        size = fraction > 0.0 ? NAN : INFINITY;
    } else if (exponent == 0) {
        size = ldexp(fraction, -24);
    } else {
        size = ldexp(fraction + 1024.0, exponent - 25);
    }
    return half & 0x8000U ? -size : size;
}

#endif
