/* SPDX-License-Identifier: Apache-2.0 */
/* From depths to points, see umbrage/picture.h. */
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "base/reserved.h"
#include "base/vec.h"
#include "umbrage/picture.h"

/* The camera's axes: forward of length 1, right and up of half the picture's width and height at
 * distance 1. */
struct axes {
    double forward[3], right[3], up[3];
};

/* Sine of the angle up to which forward and up count as parallel: far above what rounding leaves.
 */
#define PARALLEL 1e-9

/* False for what has no direction. */
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

/* A pixel's depth; 0: nothing is there. */
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
