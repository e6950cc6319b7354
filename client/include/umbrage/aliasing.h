/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_ALIASING_H
#define UMBRAGE_ALIASING_H
/*
 * Aliasing of a shadow map: how well the map's texels fit a camera's pixels at a point of a
 * surface.
 *
 * A texel covers a patch of the surface, and the patch covers a few pixels or a part of one. Texel
 * and pixel coordinates are nearly linear around the point. Let A be the derivative of texel
 * coordinates along the surface and B that of pixel coordinates; then one texel covers the
 * parallelogram B A^-1 of pixels. Where the parallelogram is longer than 1 pixel, the map is
 * undersampled and shadow edges show steps.
 *
 * The length of the parallelogram along one axis of the map is Lloyd's m. For a light from above
 * and a surface in the plane of view, m is dp/ds of Stamminger and Drettakis: a perspective factor,
 * which another parametrisation (cascades, warps) can lower, times a projection factor, which none
 * can.
 *
 * Sources: Stamminger, Drettakis: Perspective shadow maps, 2002; Lloyd: Logarithmic perspective
 * shadow maps, 2007, chapter 3.
 * Threads: pure functions.
 * Stability: experimental; umbrage/version.h says what that means.
 */
#include "umbrage/cascades.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_aliasing {
    double most;     /* Pixels that a texel covers in its longest direction */
    double least;    /* Pixels that a texel covers across that direction */
    double along[2]; /* Pixels that a step of one texel in x, and in y, covers: Lloyd's m */
    /* The two factors of dp/ds. perspective: pixels a metre at the point's distance, times metres a
     * texel. projection: cos a / cos b, where a is the angle between the normal and the direction
     * to the camera, b that between the normal and the direction to the light. */
    double perspective, projection;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Computes the aliasing at a point that the camera sees and the light reaches.
 *
 * In:    camera: near_m and far_m are not read. width, height: pixels. normal: of any length above
 *        0, towards the camera.
 * Out:   aliasing: all infinite where the light grazes the surface (cos b = 0), since a texel's
 *        patch is unbounded there; never NaN; zeros on failure.
 * Fails: E_NOT_FOUND (the point lies behind the camera or the light, or faces away from either; or
 *        the camera has an empty picture).
 */
UMB_API UMB_CHECKED enum umb_status umb_aliasing_at(const struct umb_map_frustum *frustum,
                                                    const struct umb_camera *camera, uint32_t width,
                                                    uint32_t height, const double world[3],
                                                    const double normal[3],
                                                    struct umb_aliasing *aliasing);

#ifdef __cplusplus
}
#endif
#endif
