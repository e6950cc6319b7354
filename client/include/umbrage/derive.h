/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_DERIVE_H
#define UMBRAGE_DERIVE_H
/*
 * Maps for GPUs, made from an asset alone: no scene, no rays. Any rectangle of a light's voxels, or
 * the cascades of a camera, as depth, VSM, ESM, EVSM or MSM, filtered beforehand, with mip levels.
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
 * finds it: depth is right to half a voxel along the light for the ray through that column's
 * centre, which lies within half a voxel of the texel's on each axis across. A map rendered from
 * the scene with the same frustum differs by no more, but where a silhouette runs between the two
 * rays. A texel wider than a voxel samples its centre only, as a rendered map does; derive finer
 * and take a mip level for averages.
 *
 * Assets: directional lights. Under the closed rule the depth of first occluders is there only with
 * the effect `front`.
 * Precision: texel centres become voxel coordinates in doubles (2^-50 of the frustum); depth is
 * rounded once to the format.
 * Threads: derive from one asset on any number of threads; a derived map is immutable.
 * Sources: seed 000 (the DAG); seeds 001, 002, 004 (the techniques); KTX 2.0 (Khronos).
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

#define UMB_DERIVE_TEXELS_MAX (UINT64_C(1) << 26) /* of all maps of one call */

struct umb_derive_settings {
    uint32_t light;
    uint32_t width, height; /* texels, 1..16384; powers of two with mips; equal for cascades */
    double rect[4]; /* x0 y0 x1 y1 in voxels of the light's frustum, may reach beyond it, where
                       nothing casts; all 0: the whole frustum. Not with cascades */
    /* technique: PCF (depth), VSM, ESM, EVSM or MSM; format: F32, F16 or U16; access: BASE or MIPS.
     * ESM and EVSM: exponent 0 = as large as the format allows, at most 80 and 40, and for EVSM
     * negative_exponent likewise, at most 5; `linear` is taken as 1: exponentials, as GPUs filter.
     */
    struct umb_map_settings map;
    const struct umb_camera *camera;      /* The view that cascades divide; else not read */
    struct umb_cascade_settings cascades; /* count 0: one map, of rect; resolution is width */
    int (*cancelled)(void *user);         /* NULL, or asked for each row: nonzero gives up */
    void *cancel_user;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Maps that belong together: one, or a cascade each. Made by umb_derive alone. */
struct umb_derived {
    uint32_t count;
    struct umb_map *maps[UMB_CASCADES_MAX];
    struct umb_map_frustum frusta[UMB_CASCADES_MAX];
    double splits[UMB_CASCADES_MAX + 1]; /* cascades: metres along the view */
    struct umb_derive_settings settings; /* with what was filled in; pointers NULL */
    uint8_t asset_id[UMB_ID_BYTES];
    double texel_error_m; /* half a voxel along the light: the stated error of depth */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Derives maps.
 *
 * In:    alloc: NULL = malloc; must outlive the result.
 * Out:   out: NULL on failure.
 * Owns:  the caller frees it with umb_derived_destroy.
 * Fails: E_ARGUMENT naming the field (sizes, rect, camera, settings), E_NOT_FOUND (light),
 *        E_UNSUPPORTED (a light that is not directional, a closed asset without front, a technique
 *        or format that GPUs have none for), E_TOO_LARGE (texels), E_NO_MEMORY, E_CANCELLED.
 * Cost:  a column query a texel, 0.05 to 1 us, and the map's build; about 40 bytes a texel
 * meanwhile.
 */
UMB_API UMB_CHECKED enum umb_status umb_derive(const struct umb_asset *asset,
                                               const struct umb_derive_settings *settings,
                                               const struct umb_alloc *alloc,
                                               struct umb_derived **out, struct umb_error *error);

/* Frees maps and file. NULL is allowed. */
UMB_API void umb_derived_destroy(struct umb_derived *derived);

/* Most bytes that umb_derive and umb_derived_ktx2 hold at once for these settings. */
UMB_API uint64_t umb_derive_bytes(const struct umb_derive_settings *settings);

/*
 * Lays the maps out as a KTX 2.0 file: a 2D texture, or an array with a layer for each cascade, its
 * mip levels, and under the key "umbrage.map" a JSON text that tells the asset, the technique and
 * how to get from world space to a texel (docs/guide/gpu-maps.md). The same maps give the same
 * bytes.
 *
 * Out:   bytes: uint8[size], borrowed until umb_derived_destroy; NULL on failure. Later calls give
 *        the same ones.
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
