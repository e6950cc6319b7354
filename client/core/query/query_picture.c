/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures (umbrage/picture.h): computes points from depths, and packs answers. The XOR of
 * unchanged bytes is zero, which zstd compresses to almost nothing. */
#include <math.h>
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "base/bytes.h"
#include "base/reserved.h"
#include "base/vec.h"
#include "umbrage/picture.h"

enum {
    ZSTD_FAST = 1
};

/* The camera's axes: `forward` has length 1; `right` and `up` are half the picture's width and
 * height at distance 1. */
struct axes {
    double forward[3], right[3], up[3];
};

/* Sine of the angle up to which forward and up count as parallel: far above rounding errors. */
#define PARALLEL 1e-9

/* False for a vector without a direction. */
static bool scale_to(double v[3], double length)
{
    const double now = umb__length(v);
    if (!(now > 0 && isfinite(now))) {
        return false;
    }
    for (unsigned i = 0; i < 3; i++) {
        v[i] *= length / now;
    }
    return true;
}

static bool make_axes(const struct umb_picture *picture, struct axes *axes)
{
    const double tall = tan(picture->camera.fov_y / 2);
    memcpy(axes->forward, picture->camera.forward, sizeof axes->forward);
    if (!scale_to(axes->forward, 1)) {
        return false;
    }
    umb__cross(axes->forward, picture->camera.up, axes->right);
    if (!(umb__length(axes->right) > PARALLEL * umb__length(picture->camera.up)) ||
        !scale_to(axes->right, 1)) {
        return false;
    }
    umb__cross(axes->right, axes->forward, axes->up);
    return scale_to(axes->right, tall * picture->width / picture->height) &&
           scale_to(axes->up, tall);
}

enum umb_status umb_picture_check(const struct umb_picture *picture, struct umb_error *error)
{
    if (UMB__UNKNOWN(picture, "picture", error)) {
        return UMB_E_ARGUMENT;
    }
    struct axes axes;
    if (picture->width == 0 || picture->height == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "picture: %u x %u pixels, must be at least 1 x 1",
                        picture->width, picture->height);
    }
    if (!(picture->camera.fov_y > 0 && picture->camera.fov_y < 3.14159)) {
        return umb_fail(error, UMB_E_ARGUMENT, "picture: fov_y %g, must be between 0 and pi",
                        picture->camera.fov_y);
    }
    if (!isfinite(picture->camera.eye[0]) || !isfinite(picture->camera.eye[1]) ||
        !isfinite(picture->camera.eye[2])) {
        return umb_fail(error, UMB_E_ARGUMENT, "picture: eye (%g, %g, %g), must be finite",
                        picture->camera.eye[0], picture->camera.eye[1], picture->camera.eye[2]);
    }
    const double *forward = picture->camera.forward, *up = picture->camera.up;
    return make_axes(picture, &axes)
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "picture: forward (%g, %g, %g) and up (%g, %g, %g), must be finite, "
                          "longer than 0 and not parallel",
                          forward[0], forward[1], forward[2], up[0], up[1], up[2]);
}

/* Returns a pixel's depth; 0 for an empty pixel. */
static double depth_of(const struct umb_picture *picture, size_t pixel)
{
    const uint32_t bits = umb__load32((const uint8_t *)picture->depth + 4 * pixel);
    float depth;
    memcpy(&depth, &bits, sizeof depth);
    return depth > 0 && (double)depth <= UMB_DEPTH_MAX ? (double)depth : 0; /* NaN: 0 */
}

void umb_picture_points(const struct umb_picture *picture, size_t first, size_t count,
                        float *points)
{
    struct axes axes;
    (void)make_axes(picture, &axes);
    for (size_t i = 0; i < count; i++) {
        const size_t pixel = first + i;
        const double x = (2.0 * (double)(pixel % picture->width) + 1) / picture->width - 1;
        const double y = 1 - (2.0 * (double)(pixel / picture->width) + 1) / picture->height;
        const double depth = depth_of(picture, pixel);
        for (unsigned k = 0; k < 3; k++) {
            points[3 * i + k] =
                (float)(depth * (axes.forward[k] + x * axes.right[k] + y * axes.up[k]));
        }
    }
}

void umb_picture_fill(const struct umb_picture *picture, size_t first, size_t count,
                      enum umb_answer_format format, void *values)
{
    for (size_t pixel = first; pixel < first + count; pixel++) {
        if (depth_of(picture, pixel) > 0) {
            continue;
        }
        if (format == UMB_ANSWER_F32) {
            const float lit = 1;
            memcpy((uint8_t *)values + 4 * pixel, &lit, sizeof lit);
        } else if (format == UMB_ANSWER_U8) {
            ((uint8_t *)values)[pixel] = 255;
        } else {
            ((uint8_t *)values)[pixel / 8] |= (uint8_t)(1U << (pixel % 8));
        }
    }
}

size_t umb_picture_room(size_t size)
{
    return ZSTD_compressBound(size);
}

uint64_t umb_picture_mark(const void *values, size_t size)
{
    const uint64_t mark = XXH3_64bits(values, size);
    return mark ? mark : 1;
}

/* In: out: may be either of the two. */
static void combine(const uint8_t *a, const uint8_t *b, uint8_t *out, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        out[i] = a[i] ^ b[i];
    }
}

enum umb_status umb_picture_pack(const void *values, const void *base, size_t size, void *scratch,
                                 void *packed, size_t *packed_size, struct umb_error *error)
{
    if (base) {
        combine(values, base, scratch, size);
        values = scratch;
    }
    const size_t length = ZSTD_compress(packed, umb_picture_room(size), values, size, ZSTD_FAST);
    *packed_size = ZSTD_isError(length) ? 0 : length;
    return ZSTD_isError(length)
               ? umb_fail(error, UMB_E_NO_MEMORY, "frame: zstd: %s", ZSTD_getErrorName(length))
               : UMB_OK;
}

enum umb_status umb_picture_unpack(const void *packed, size_t packed_size, const void *base,
                                   void *values, size_t size, struct umb_error *error)
{
    uint8_t *out = values;
    const size_t got = ZSTD_decompress(out, size, packed, packed_size);
    if (ZSTD_isError(got) && ZSTD_getErrorCode(got) == ZSTD_error_memory_allocation) {
        return umb_fail(error, UMB_E_NO_MEMORY, "frame: no memory to unpack it");
    }
    if (ZSTD_isError(got) || got != size) {
        return umb_fail(error, UMB_E_CORRUPT, "frame: %zu packed bytes are not %zu answers' bytes",
                        packed_size, size);
    }
    if (base) {
        combine(out, base, out, size);
    }
    return UMB_OK;
}
