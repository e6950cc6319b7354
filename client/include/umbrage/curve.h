/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CURVE_H
#define UMBRAGE_CURVE_H
/*
 * Accuracy and its cost: the bound of an answer's error, the accuracy curve that an asset carries,
 * and the dial that turns a required accuracy or a budget into settings.
 *
 *     const struct umb_dial dial = {.max_error_m = 2};
 *     struct umb_curve_row row;
 *     if (umb_dial_choose(asset, &dial, NULL, &settings, &row, &error) ||  // level and taps
 *         umb_query_prepare(asset, &settings, &query, &error)) {
 *         return error.status;
 *     }
 *
 * The bound. A voxel's value is the true visibility of its centre (docs/reference/umb-format.md,
 * section 1). So an answer is wrong only if the look-up was on the other side of a true shadow
 * boundary than the point. The distance of a look-up from its point follows from the geometry: the
 * bias, plus half the diagonal of the window (of a whole cell where look-ups stop at one). This sum
 * is the bound: an answer is true, or a true boundary is no farther from the point than the bound.
 * It holds in defined space, for windows that do not reach into closed solids.
 *
 * The curve. The bake measures each level and filter of an asset on points of the scene's surfaces:
 * how much the answer depends on the place of the point within a voxel, and how much it reads.
 * Costs are counts, the same on every machine; umb_calibrate measures nanoseconds.
 *
 * Threads: any number of threads may call these functions at once. An asset is only read.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"
#include "umbrage/query.h"
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_CURVE_ROWS_MAX 24 /* rows a light */

/* Returns the highest level at which look-ups in a frustum of 1 << log2_size voxels a side can
 * stop: the least odd number that is at least log2_size - 7, and at least 3. */
UMB_API uint32_t umb_level_max(uint32_t log2_size);

/*
 * Returns the largest distance of a look-up with automatic bias from its point, metres.
 *
 * In:    level, taps: as in struct umb_query_settings.
 * Spot and point lights: at the frustum's far end, where voxels are largest.
 */
UMB_API double umb_frustum_bound_m(const struct umb_frustum_info *frustum, uint32_t level,
                                   uint32_t taps);

/* Returns the bound in metres of settings with their bias: the largest of all frusta of the light;
 * 0 if the asset has no such light. Penumbras and footprints also give 0: their width differs from
 * point to point, so no bound is stated. In: settings that umb_query_prepare accepts. */
UMB_API double umb_query_bound_m(const struct umb_asset *asset,
                                 const struct umb_query_settings *settings);

/* One setting of a light, with its accuracy and cost. */
struct umb_curve_row {
    uint32_t level, taps;
    double bound_m; /* Bound with automatic bias, metres; computed from the frusta, not stored */
    /* Root mean square difference of the answer, 0..1, when the point moves by up to half a voxel
     * across the light. For coarse rows, the difference from a full look-up. */
    double visibility_error;
    double nodes;         /* Mixed octree nodes above bricks on a point's path, on average */
    double lines;         /* Cache lines that a point reads: grid, wide nodes, bricks; on average */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Copies the curve of a light out of an asset, coarse levels first, then by taps.
 *
 * Out:   count: number of rows, 0 on failure.
 * Fails: E_NOT_FOUND (no such light, or the asset carries no curve).
 */
UMB_API enum umb_status umb_asset_get_curve(const struct umb_asset *asset, uint32_t light,
                                            struct umb_curve_row rows[UMB_CURVE_ROWS_MAX],
                                            size_t *count);

/* Costs of a curve's rows on this machine; umb_calibrate or umb_calibrate_points fills it in. */
struct umb_calibration {
    size_t count;                  /* Number of rows, in the order of umb_asset_get_curve */
    double ns[UMB_CURVE_ROWS_MAX]; /* Nanoseconds a point on one core */
    uint64_t reserved[2];          /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Measures the costs of a light's curve on this machine, for points spread over the scene and one
 * idle core. The function queries two kinds of points of its own: scattered ones, and ones where
 * the light first meets a caster. It interpolates between the two kinds by the counts of the
 * curve's points.
 *
 * In:    now_s: a clock in seconds that does not go back.
 * Out:   calibration: costs that do not fall where the counts of the curve rise.
 * Fails: E_NOT_FOUND (light), E_UNSUPPORTED (no curve), E_NO_MEMORY.
 * Cost:  about 100 ms of one core; 2 MiB for the points, freed again.
 */
UMB_API UMB_CHECKED enum umb_status umb_calibrate(const struct umb_asset *asset, uint32_t light,
                                                  double (*now_s)(void),
                                                  struct umb_calibration *calibration,
                                                  struct umb_error *error);

/*
 * Measures the costs of a light's curve for the caller's points. Costs vary up to tenfold with the
 * distance between points, their place and their normals. So calibrate a budget on the points that
 * will be queried, or on a fair sample of them: runs of a few thousand consecutive points.
 *
 * In:    points: as umb_points_check accepts them, at least one; 10^5 and more, spread over the
 *        scene, leave the caches as cold as the whole batch does. now_s: a clock in seconds that
 *        does not go back; on a busy machine use the CPU time of the calling thread.
 * Out:   calibration: median of interleaved runs; costs that do not fall where the counts of the
 *        curve rise.
 * Fails: E_ARGUMENT (no points), E_NOT_FOUND (light), E_UNSUPPORTED (no curve), E_NO_MEMORY.
 * Cost:  about 50 ms of one core; 32 KiB, freed again.
 */
UMB_API UMB_CHECKED enum umb_status
umb_calibrate_points(const struct umb_asset *asset, uint32_t light, const struct umb_points *points,
                     double (*now_s)(void), struct umb_calibration *calibration,
                     struct umb_error *error);

/* Requirements on answers; a field that is 0 requires nothing. */
struct umb_dial {
    double max_error_m;    /* Largest bound, metres */
    double max_visibility; /* Largest root mean square error of visibility, 0..1 */
    double budget_ns;      /* Nanoseconds a point on one core; needs a calibration */
    uint64_t reserved[4];  /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Chooses level and taps from the curve of settings->light.
 *
 * With max_error_m, max_visibility or both: the row with the fewest lines among the rows within
 * these limits. The choice is the same on every machine, and a smaller limit never gives a larger
 * bound or a lower cost. With budget_ns alone: the row with the least visibility error among the
 * rows within the budget. With a budget and limits, a row must keep all of them.
 *
 * In:    calibration: of this light; NULL unless budget_ns is given.
 *        settings: light is read; taps, level and footprint_m must be 0, filter must be box.
 * Out:   settings: level and taps. row: what they give; may be NULL. Untouched on failure.
 * Fails: E_ARGUMENT (a requirement that is not finite or below 0; no requirement; settings that
 *        leave no choice; no row meets the requirements: the message has the best that the asset
 *        offers), E_NOT_FOUND (light), E_UNSUPPORTED (the asset carries no curve).
 */
UMB_API UMB_CHECKED enum umb_status
umb_dial_choose(const struct umb_asset *asset, const struct umb_dial *dial,
                const struct umb_calibration *calibration, struct umb_query_settings *settings,
                struct umb_curve_row *row, struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
