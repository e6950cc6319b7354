/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_ALIASING_H
#define UMBRAGE_ALIASING_H
/*
 * Aliasing of a shadow map: how well its texels fit the pixels of a camera, at a point of a
 * surface.
 *
 * A texel covers a patch of the surface, and the patch covers a few pixels or a part of one. Both
 * maps are linear near the point. With A the derivative of texel coordinates along the surface and
 * B that of pixel coordinates, one texel covers the parallelogram B A^-1 of pixels. Where it is
 * longer than 1 pixel the map is undersampled and its edges show steps.
 *
 * Along one axis of the map this is Lloyd's m. Under a light from above and for a surface in the
 * plane of view it is dp/ds of Stamminger and Drettakis: a perspective factor, which another
 * parametrisation (cascades, warps) can lower, times a projection factor, which it cannot.
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
    double least;    /* Pixels that it covers across that direction */
    double along[2]; /* Pixels that a step of one texel in x, and in y, covers: Lloyd's m */
    double perspective, projection; /* Factors of dp/ds, pixels a texel: (pixels a metre at the
                                       point's distance) x (metres a texel), and cos a / cos b */
    uint64_t reserved[4];           /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Analyses a point that the camera sees and the light reaches.
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
