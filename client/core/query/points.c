/* SPDX-License-Identifier: Apache-2.0 */
/* Checks batches of points, computes sizes of answers, and adds up counts. */
#include <float.h>
#include <math.h>

#include "base/reserved.h"
#include "query/query_parts.h"

#define CHECK_WORDS 96 /* divides into whole points */

/*
 * Returns whether all of CHECK_WORDS numbers are finite. The exponent is in the upper 32 bits of
 * either format. For finite numbers, adding one to its lowest bit never changes the sign bit. The
 * loop has no branch and a fixed length, so compilers vectorise it.
 */
UMB__INLINE bool all_finite(const uint8_t *bytes, bool wide)
{
    const uint32_t exponent = wide ? 0x7ff00000U : 0x7f800000U, lowest = exponent & (0 - exponent);
    uint32_t carry = 0;
    for (size_t i = 0; i < CHECK_WORDS; i++) {
        uint32_t upper;
        if (wide) {
            uint64_t number;
            memcpy(&number, bytes + i * sizeof number, sizeof number);
            upper = (uint32_t)(number >> 32);
        } else {
            memcpy(&upper, bytes + i * sizeof upper, sizeof upper);
        }
        carry |= (upper & exponent) + lowest;
    }
    return carry >> 31 == 0;
}

/* Number of coordinates that are proven finite, in whole blocks. */
static size_t count_finite(const struct umb_points *points)
{
    const size_t block = CHECK_WORDS / 3;
    const bool wide = points->format == UMB_POINT_F64;
    const size_t stride = CHECK_WORDS * (wide ? sizeof(double) : sizeof(float));
    const uint8_t *bytes = points->positions;
    size_t count = 0;
    while (points->count - count >= block &&
           (wide ? all_finite(bytes, true) : all_finite(bytes, false))) {
        bytes += stride;
        count += block;
    }
    return count;
}

enum umb_status umb_points_check(const struct umb_points *points, struct umb_error *error)
{
    if (UMB__UNKNOWN(points, "points", error)) {
        return UMB_E_ARGUMENT;
    }
    static const char axes[] = "xyz";
    for (unsigned axis = 0; axis < 3; axis++) {
        if (!isfinite(points->origin[axis])) {
            return umb_fail(error, UMB_E_ARGUMENT, "origin.%c: %g, must be finite", axes[axis],
                            points->origin[axis]);
        }
    }
    if (points->format != UMB_POINT_F32 && points->format != UMB_POINT_F64) {
        return umb_fail(error, UMB_E_ARGUMENT, "points: unknown format %d", (int)points->format);
    }
    for (size_t i = count_finite(points); i < points->count; i++) {
        for (unsigned axis = 0; axis < 3; axis++) {
            double value = umb__coordinate(points, i, axis);
            if (!isfinite(value)) {
                return umb_fail(error, UMB_E_ARGUMENT, "points[%zu].%c: %g, must be finite", i,
                                axes[axis], value);
            }
        }
    }
    for (size_t i = 0; points->footprints != NULL && i < points->count; i++) {
        float side;
        memcpy(&side, (const uint8_t *)points->footprints + i * sizeof side, sizeof side);
        if (!(side >= 0 && side <= FLT_MAX)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "footprints[%zu]: %g, must be finite and not below 0", i, (double)side);
        }
    }
    return UMB_OK;
}

size_t umb_answer_bytes(enum umb_answer_format format, size_t count)
{
    switch (format) {
    case UMB_ANSWER_F32:
        return count * sizeof(float);
    case UMB_ANSWER_U8:
        return count;
    case UMB_ANSWER_BIT:
        return count / 8 + (count % 8 != 0);
    }
    return 0;
}

void umb_query_stats_add(struct umb_query_stats *to, const struct umb_query_stats *from)
{
    to->points += from->points;
    to->outside += from->outside;
    to->before += from->before;
    to->behind += from->behind;
    to->facing_away += from->facing_away;
    to->undefined += from->undefined;
    to->nodes += from->nodes;
    to->bricks += from->bricks;
}
