/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SAMPLE_H
#define UMBRAGE_SAMPLE_H
/*
 * Sample points of an asset, drawn near its shadow boundaries, without the scene. They are what a
 * load test or a first try of a server needs: points whose answers are neither all lit nor all
 * shadowed.
 *
 *     const struct umb_sample_settings settings = {.count = 1000, .seed = 7};
 *     double positions[3 * 1000];
 *     struct umb_sample sample;
 *     if (umb_asset_sample(asset, &settings, positions, &sample, &error)) {
 *         return error.status;
 *     }
 *     const struct umb_points points = {.positions = positions,
 *                                       .format = UMB_POINT_F64,
 *                                       .origin = {sample.origin[0], sample.origin[1],
 *                                                  sample.origin[2]},
 *                                       .count = sample.count};
 *
 * A shadow boundary is a common face of two stored voxels of one frustum, of which one is lit and
 * the other shadowed. Each point at a boundary lies in one of these two voxels, drawn at random, so
 * it is at most one voxel's diagonal away from the boundary. About half of the points belong to
 * boundaries across the light's direction: the surfaces that the light meets first. The others
 * belong to boundaries between neighbouring columns, the edges of shadows; such a point is moved
 * along the light to the surface that receives the shadow, if the edge reaches that far.
 *
 * Points are spread over all parts of the light's frusta that hold boundaries, and their order is
 * mixed: a part of a sample is itself a sample. Normals are not known, because an asset stores
 * visibility, not surfaces; queries without normals move points towards the light.
 *
 * The same asset, light, seed, count and share give the same bits on every machine. Points are
 * doubles. Rounded to floats they stay in their voxel, unless the floats' origin is so far away
 * that a float's step there is above a sixteenth of a voxel.
 *
 * Spot and point lights: voxels of a face are drawn only where this face answers.
 * Closed assets: a boundary inside a closed solid is that of stored voxels, which mean nothing.
 * Static rule: only voxels in cells that hold receivers are drawn.
 * Translucent casters are not voxels and have no boundaries.
 * Threads: any number of threads may sample one asset.
 * Stability: experimental; umbrage/version.h says what that means.
 */
#include "umbrage/client.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_SAMPLE_MAX       65536 /* Points of one sample; other seeds give further points */
#define UMB_SAMPLE_NOTE_SIZE 256   /* Bytes of a note with its NUL */

struct umb_sample_settings {
    uint32_t light; /* Index of the light */
    uint32_t count; /* Number of points, 1 to UMB_SAMPLE_MAX */
    uint64_t seed;  /* Other seeds draw other points */
    /* Share of the points that lie anywhere in the bounds of the casters, 0..1. The others, by
     * default all, lie at shadow boundaries. */
    double scattered;
    /* Called now and then by umb_asset_sample; nonzero stops. May be NULL. umb_client_sample does
     * not call it. */
    int (*cancelled)(void *user);
    void *cancel_user;    /* First argument of `cancelled` */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_sample {
    size_t count;                    /* Number of points, at most settings.count */
    double origin[3];                /* Origin of the positions, metres, world space */
    uint8_t asset_id[UMB_ID_BYTES];  /* Id of the asset that was sampled */
    char note[UMB_SAMPLE_NOTE_SIZE]; /* Reason for which there are fewer points than wanted, UTF-8;
                                        empty if there are all */
    uint64_t reserved[4];            /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Draws points from an open asset.
 *
 * Out:   positions: double[3 * settings->count], of which the first 3 * sample->count are set:
 *        x y z interleaved, metres, world space minus sample->origin, finite. sample: zeroed on
 *        failure. A light without boundaries gives no points at them, and a note.
 * Fails: E_ARGUMENT (count or share out of range, which the message names), E_NOT_FOUND (light),
 *        E_CANCELLED.
 * Trust: safe on any open asset.
 * Cost:  two passes over the grids of the light's frusta (0.5 ms for a usual one, at most 0.1 s),
 *        and about a microsecond a point. No allocation.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_sample(const struct umb_asset *asset,
                                                     const struct umb_sample_settings *settings,
                                                     double *positions, struct umb_sample *sample,
                                                     struct umb_error *error);

/*
 * Asks a daemon for the points that umb_asset_sample draws from the same asset, bit for bit.
 *
 * In:    asset: name, or id in hexadecimal: 1 to 255 bytes of UTF-8. async: NULL: waits for the
 *        points.
 * Out:   positions, sample: as umb_asset_sample; unspecified on failure.
 * Fails: as umb_client_query; E_TOO_LARGE (more points than the server's limit for one request).
 * Threads: as umb_client_query.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_sample(struct umb_client *client, const char *asset,
                                                      const struct umb_sample_settings *settings,
                                                      double *positions, struct umb_sample *sample,
                                                      struct umb_client_async *async,
                                                      struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
