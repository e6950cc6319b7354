/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_ALIASING_H
#define UMBRAGE_ALIASING_H
/*
 * How well the texels of a shadow map fit the pixels of a camera, at a point of a surface.
 *
 * A texel covers a patch of the surface, and the patch a few pixels, or a part of one. Both ways
 * are linear near the point: with A the change of texel coordinates and B that of pixel coordinates
 * along the surface, one texel covers the parallelogram B A^-1 of pixels. Above 1 pixel the
 * map is undersampled there and its edges show steps.
 *
 * Along one axis of the map that is Lloyd's m; under a light from above and for a surface in the
 * plane of view it is Stamminger and Drettakis' dp/ds, the product of a perspective factor, which
 * another parametrisation (cascades, warps) can lower, and a projection factor, which it cannot.
 *
 * Sources: Stamminger, Drettakis 2002; Lloyd 2007, chapter 3 (seed 004).
 * Threads: pure functions.
 * Stability: experimental; umbrage/version.h says what that means.
 */
#include "umbrage/cascades.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_aliasing {
    double most;     /* pixels that a texel covers in its longest direction */
    double least;    /* and across it */
    double along[2]; /* pixels that a step of one texel in x, and in y, covers: Lloyd's m */
    double perspective, projection; /* factors of dp/ds, pixels a texel: (pixels a metre at the
                                       point's distance) x (metres a texel), and cos a / cos b */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Analyses a point that the camera sees and the light reaches.
 *
 * In:    camera: near_m and far_m are not read. width, height: pixels. normal: of any length above
 *        0, towards the camera.
 * Out:   all infinite where the light grazes the surface (cos b = 0) and the texel's patch has no
 *        end; never NaN.
 * Fails: E_NOT_FOUND, and zeros: the point lies behind the camera or the light, or faces away from
 *        either; or the camera spans no picture.
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
