/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CASCADES_H
#define UMBRAGE_CASCADES_H
/*
 * Cascades: several maps of a directional light for one camera, each for a slice of the view (PSSM,
 * parallel-split shadow maps), so that texels are dense where pixels are.
 *
 *     struct umb_cascade_plan plan;
 *     if (umb_cascades_plan(&camera, to_light, &scene, &settings, &plan, &error)) {
 *         return error.status;
 *     }
 *     for (uint32_t i = 0; i < plan.count; i++) {
 *         // ... fill layers[i].depth along umb_map_frustum_point(&plan.frusta[i], ...)
 *         if (umb_map_build(&plan.frusta[i], &layers[i], &map_settings, NULL, &maps[i], &error) ||
 *             umb_map_prepare(maps[i], &filter, &queries[i], &error)) {
 *             return error.status;
 *         }
 *     }
 *     umb_cascades_run(&plan, queries, &points, 0, points.count, values);
 *
 * Each map (layer) is built and filtered as any other (umbrage/maps.h); with VSM or EVSM layers
 * this is PSSM + VSM. Where two layers meet, texels change their size, so a filter of n texels
 * changes its width and shows a seam. `blend` softens the seam, and so does the contrast C of the
 * coarser layer (umb_cascades_match).
 *
 * Sources: Zhang et al. 2006 (practical split, parallel splits); Fu, Liu 2013 (VSM and C for each
 * layer); Wimmer, Scherzer, Purgathofer 2004 (LiSPSM).
 * Threads, ownership: as umbrage/maps.h.
 * Stability: experimental; umbrage/version.h says what that means.
 */
#include "umbrage/maps.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_CASCADES_MAX 8

enum umb_cascade_fit {
    UMB_CASCADE_SLICE = 0, /* Sphere around the slice, for any scene. The sphere's size stays when
                              the camera turns, and the texels stay on a grid of the world when the
                              camera moves (texel snapping), so that shadows do not swim */
    UMB_CASCADE_SCENE,     /* Intersection of slice and scene: finer texels, but they move with the
                              camera and the scene */
    UMB_CASCADE_LISPSM, /* Intersection of slice and scene, warped so that texels are finer near the
                           eye */
};

struct umb_cascade_settings {
    uint32_t count; /* Number of slices, 1..8 */
    double weight;  /* Weight of logarithmic against uniform splits, 0..1 */
    enum umb_cascade_fit fit;
    uint32_t resolution[UMB_CASCADES_MAX]; /* Texels a side of each layer, 4..16384 */
    double blend;         /* Share of a slice at its far end that fades into the next, 0..0.5 */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_cascade_plan {
    double eye[3], forward[3]; /* Camera's position and unit direction of view; splits are distances
                                  from `eye` along `forward` */
    uint32_t count;
    double blend;
    double splits[UMB_CASCADES_MAX + 1]; /* Distances along forward, metres: near .. far */
    struct umb_map_frustum frusta[UMB_CASCADES_MAX];
    int warped[UMB_CASCADES_MAX]; /* 1: warped by LISPSM; 0 e.g. for a view along the light */
    uint64_t reserved[4];         /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Computes the count + 1 distances of the splits, metres. With n = near_m and f = far_m, split i is
 * weight * n (f/n)^(i/count) + (1 - weight) * (n + (f - n) i/count).
 * Precision: that of pow, 1 ulp; the first and the last split are exactly near_m and far_m.
 */
UMB_API void umb_cascades_split(double near_m, double far_m, uint32_t count, double weight,
                                double *splits);

/*
 * Splits the view and fits a frustum to each slice. Depth runs from the scene's near end, so that
 * casters before a slice are in its map.
 *
 * In:    camera: eye within 1e30 m, 1e-30 <= near_m < far_m <= 1e30 along forward, tangents of half
 *        its angles 1e-6 to below 1000. to_light: any length above 0. scene: of all casters,
 *        metres, world space.
 * Fails: E_ARGUMENT (camera, light, box or settings), naming the field; also an eye that is more
 *        than 2^40 times a slice's size from the scene.
 */
UMB_API UMB_CHECKED enum umb_status
umb_cascades_plan(const struct umb_camera *camera, const double to_light[3],
                  const struct umb_box *scene, const struct umb_cascade_settings *settings,
                  struct umb_cascade_plan *plan, struct umb_error *error);

/*
 * Answers points, each by the map of the slice that it lies in. Points before the first slice use
 * the first map, points behind the last slice the last. Where two slices blend, both maps answer.
 *
 * In:    queries: struct umb_map_query[plan->count], prepared on maps of plan->frusta.
 */
UMB_API void umb_cascades_run(const struct umb_cascade_plan *plan,
                              const struct umb_map_query *queries, const struct umb_points *points,
                              size_t first, size_t count, float *values);

/* A seam between two layers: the maps on both sides and their filters. */
struct umb_cascade_seam {
    const struct umb_map *fine, *coarse;
    struct umb_map_filter fine_filter, coarse_filter;
    double contrast;      /* Out: C for the coarse filter, 1/1024..1024 */
    double difference;    /* Out: root mean square of coarse - fine with C = 1 */
    double after;         /* Out: root mean square of coarse - fine with `contrast` */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Finds the contrast C (struct umb_map_filter) at which the coarser layer's answers differ least
 * from the finer layer's.
 *
 * In:    points: along the seam, at least one. scratch: float[2 * points->count].
 * Fails: as umb_map_prepare.
 * Cost:  24 runs of the points.
 */
UMB_API UMB_CHECKED enum umb_status umb_cascades_match(struct umb_cascade_seam *seam,
                                                       const struct umb_points *points,
                                                       float *scratch, struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
