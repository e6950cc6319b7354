/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_DERIVE_H
#define UMBRAGE_DERIVE_H
/*
 * Shadow maps for GPUs, made from an asset alone, without the scene and without rays. A map covers
 * a rectangle of a light's voxels, or a cascade of a camera. It holds depth, VSM, ESM, EVSM or MSM,
 * prefiltered, with mip levels.
 *
 *     const struct umb_derive_settings settings = {
 *         .width = 1024, .height = 1024, .map = {.technique = UMB_MAP_EVSM}};
 *     struct umb_derived *derived;
 *     if (umb_derive(asset, &settings, NULL, &derived, &error) ||
 *         umb_derived_ktx2(derived, &bytes, &size, &error)) {  // what a GPU loads
 *         return error.status;
 *     }
 *     // ... or ask derived->maps[0] here, see umbrage/maps.h
 *     umb_derived_destroy(derived);
 *
 * Each texel is the first occluder of the column of voxels at its centre, as umb_volume_columns
 * finds it. Its depth is right to half a voxel along the light for the ray through that column's
 * centre, which lies within half a voxel of the texel's centre on each axis. A map rendered from
 * the scene with the same frustum differs by no more, except where a silhouette runs between the
 * two rays. A texel wider than a voxel samples its centre only, as a rendered map does; for
 * averages derive a finer map and use a mip level.
 *
 * Assets: directional lights. Assets baked under the closed rule need the effect `front`, which
 * stores the depth of first occluders.
 * Precision: texel centres become voxel coordinates in doubles (2^-50 of the frustum); depth is
 * rounded once to the format.
 * Threads: derive from one asset on any number of threads; a derived map is immutable.
 * Sources: docs/explained/sources.md has the publications of each technique; KTX 2.0 (Khronos).
 * Stability: experimental; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/alloc.h"
#include "umbrage/asset.h"
#include "umbrage/cascades.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_DERIVE_TEXELS_MAX (UINT64_C(1) << 26) /* Texels of all maps of one call */

struct umb_derive_settings {
    uint32_t light;         /* Index of the light */
    uint32_t width, height; /* Texels, 1..16384; powers of two with mips; equal for cascades */
    /* Rectangle x0 y0 x1 y1 in voxels of the light's frustum. The rectangle may reach beyond the
     * frustum, where nothing casts shadows. All 0: the whole frustum. Not for cascades. */
    double rect[4];
    /* Settings of the maps. technique: PCF (depth), VSM, ESM, EVSM or MSM; format: F32, F16 or U16;
     * access: BASE or MIPS. Exponents: 0 = as large as the format allows, at most 80 for ESM, 40
     * for EVSM, and 5 for its negative_exponent. `linear` counts as 1, because GPUs filter the
     * exponentials linearly.
     */
    struct umb_map_settings map;
    const struct umb_camera *camera; /* View that the cascades divide; not read without cascades */
    /* Cascades of one camera; count 0: one map, of rect. The field `resolution` is not read: each
     * cascade has `width`. */
    struct umb_cascade_settings cascades;
    int (*cancelled)(void *user); /* Called for each row; nonzero stops. May be NULL */
    void *cancel_user;            /* First argument of `cancelled` */
    double contrast; /* VSM, EVSM: contrast C of the maps' filter (umbrage/maps.h), 1e-6..1e6; 0 =
                           1. With match_contrast: of the first map */
    int match_contrast; /* 1: the C of each later cascade is the one that hides the seam before it,
                           by umb_cascades_match at points all over the view at that split */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/* The maps of one call: one map, or one for each cascade. Made by umb_derive only. */
struct umb_derived {
    uint32_t count;
    struct umb_map *maps[UMB_CASCADES_MAX];
    struct umb_map_frustum frusta[UMB_CASCADES_MAX];
    double splits[UMB_CASCADES_MAX + 1]; /* Splits of cascades, metres along the view */
    struct umb_derive_settings settings; /* Settings, defaults filled in; pointers are NULL */
    uint8_t asset_id[UMB_ID_BYTES];
    double texel_error_m;   /* Stated error of depth, metres: half a voxel along the light */
    const double *contrast; /* double[count]: contrast C to filter each map with; lives as long as
                               this struct */
    uint64_t reserved[3];   /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Derives maps from an asset.
 *
 * In:    alloc: NULL = malloc; must outlive the result.
 * Out:   out: NULL on failure.
 * Owns:  the caller frees it with umb_derived_destroy.
 * Fails: E_ARGUMENT naming the field (sizes, rect, camera, settings), E_NOT_FOUND (light),
 *        E_UNSUPPORTED (a light that is not directional, a closed asset without front, a technique
 *        or format without a GPU format), E_TOO_LARGE (texels), E_NO_MEMORY, E_CANCELLED.
 * Cost:  a column query a texel, 0.05 to 1 us, and the map's build; about 40 bytes a texel during
 *        the call. match_contrast: 15 to 30 ms a seam.
 */
UMB_API UMB_CHECKED enum umb_status umb_derive(const struct umb_asset *asset,
                                               const struct umb_derive_settings *settings,
                                               const struct umb_alloc *alloc,
                                               struct umb_derived **out, struct umb_error *error);

/* Frees the derived maps and their KTX file. NULL is allowed. */
UMB_API void umb_derived_destroy(struct umb_derived *derived);

/* Returns the most bytes that umb_derive and umb_derived_ktx2 hold at once for these settings. */
UMB_API uint64_t umb_derive_bytes(const struct umb_derive_settings *settings);

/*
 * Lays the maps out as a KTX 2.0 file: a 2D texture, or an array with a layer for each cascade, and
 * its mip levels. Under the key "umbrage.map" stands a JSON text with the asset, the technique and
 * the transform from world space to texels (docs/guide/gpu-maps.md). The same maps give the same
 * bytes.
 *
 * Out:   bytes: uint8[size], borrowed until umb_derived_destroy; NULL on failure. Later calls
 *        return the same block.
 * Fails: E_NO_MEMORY.
 * Threads: one at a time.
 */
UMB_API UMB_CHECKED enum umb_status umb_derived_ktx2(struct umb_derived *derived,
                                                     const uint8_t **bytes, size_t *size,
                                                     struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
