/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CURVE_H
#define UMBRAGE_CURVE_H
/*
 * What accuracy costs: how far an answer may be off, the accuracy curve that an asset carries, and
 * the dial that turns a wanted accuracy or a budget into settings.
 *
 *     const struct umb_dial dial = {.max_error_m = 1};
 *     struct umb_curve_row row;
 *     if (umb_dial_choose(asset, &dial, NULL, &settings, &row, &error) ||  // level and taps
 *         umb_query_prepare(asset, &settings, &query, &error)) {
 *         return error.status;
 *     }
 *
 * The bound. A voxel's value is the true visibility of its centre (docs/reference/umb-format.md,
 * section 1), so an answer that differs from the truth at a point looked at a place on the other
 * side of a true shadow boundary. How far a look-up is from its point follows from the geometry
 * alone: the bias, and half the diagonal of the window (of a whole cell where look-ups stop at
 * one). The bound is the sum: whatever a query answers, a true boundary is no farther from the
 * point than that, or the answer is true. It holds in defined space, for windows that do not reach
 * into closed solids.
 *
 * The curve. For each level and filter that an asset answers with, measured by the bake on points
 * on the scene's surfaces: how much the answer depends on where in a voxel the point lies, and what
 * it reads. Costs are counts, the same on every machine; nanoseconds come from umb_calibrate.
 *
 * Threads: everything here may be called at once; only struct umb_calibration is written to.
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

/* Returns the highest level that look-ups in a frustum of 1 << log2_size voxels a side can stop at:
 * the least odd number that is not below log2_size - 7, nor below 3. */
UMB_API uint32_t umb_level_max(uint32_t log2_size);

/*
 * Returns how far from a point a look-up with automatic bias can be, in metres.
 *
 * In:    level, taps: as in struct umb_query_settings.
 * Spot and point lights: at the frustum's far end, where voxels are largest.
 */
UMB_API double umb_frustum_bound_m(const struct umb_frustum_info *frustum, uint32_t level,
                                   uint32_t taps);

/* Returns the bound of settings that umb_query_prepare accepts, whatever their bias; the largest of
 * a light's frusta. 0 for a light that the asset does not have, and for penumbras and footprints:
 * they are as wide as each point needs, and no bound is stated. */
UMB_API double umb_query_bound_m(const struct umb_asset *asset,
                                 const struct umb_query_settings *settings);

/* One setting and what it gives, of one light. */
struct umb_curve_row {
    uint32_t level, taps;
    double bound_m; /* with automatic bias; follows from the frusta, not stored */
    /* Root mean square difference of the answer, 0..1, when the point is moved by up to half a
     * voxel across the light; of coarse rows, to a full look-up there. */
    double visibility_error;
    double nodes; /* mixed octree nodes above bricks that a point's look-up goes through */
    double lines; /* cache lines it reads: grid, wide nodes, bricks */
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

/* What rows cost on this machine; umb_calibrate or umb_calibrate_points fills it in. */
struct umb_calibration {
    size_t count;                  /* rows, in the order of umb_asset_get_curve */
    double ns[UMB_CURVE_ROWS_MAX]; /* nanoseconds a point on one core */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Measures what the rows of a light's curve cost here: asks the asset about points of its own, some
 * that lie anywhere and some where the light first meets a caster, and goes as far from the ones to
 * the others as the curve's points do. For points spread over the scene, on one core that does
 * nothing else.
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
 * Measures what the rows of a light's curve cost for points like these: as near to each other, as
 * hard, as often facing away. Costs depend on all of that, up to tenfold; so a budget for points at
 * hand is best calibrated on them, or on a fair sample: intervals of a few thousand consecutive
 * points from all over them.
 *
 * In:    points: as umb_points_check accepts them, at least one; 10^5 and more spread over the
 *        scene leave the caches as cold as all of them do. now_s: a clock in seconds that does not
 *        go back; the calling thread's CPU time suits a busy machine.
 * Out:   calibration: median of interleaved runs; costs that do not fall where the counts of the
 *        curve rise.
 * Fails: E_ARGUMENT (no points), E_NOT_FOUND (light), E_UNSUPPORTED (no curve), E_NO_MEMORY.
 * Cost:  about 50 ms of one core; 32 KiB, freed again.
 */
UMB_API UMB_CHECKED enum umb_status
umb_calibrate_points(const struct umb_asset *asset, uint32_t light, const struct umb_points *points,
                     double (*now_s)(void), struct umb_calibration *calibration,
                     struct umb_error *error);

/* What is wanted of an answer; 0 where nothing is. */
struct umb_dial {
    double max_error_m;    /* bound, metres */
    double max_visibility; /* root mean square error of visibility, 0..1 */
    double budget_ns;      /* nanoseconds a point on one core; needs a calibration */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Chooses level and taps from the curve of settings->light.
 *
 * With max_error_m, max_visibility or both: the row that reads the fewest lines of those that keep
 * to them, so that every machine chooses the same. Asking for less error therefore never gives a
 * larger bound and never a lower cost. With budget_ns alone: of the rows that cost no more, the one
 * with the least visibility error. With both, a row must keep to all.
 *
 * In:    calibration: of this light; NULL unless budget_ns is given.
 *        settings: light is read; taps, level and footprint_m must be 0, filter must be box.
 * Out:   settings: level and taps. row: what they give; may be NULL. Untouched on failure.
 * Fails: E_ARGUMENT (not finite or below 0; nothing wanted; settings that leave no choice; no row
 *        keeps to what is wanted: says what the asset can do), E_NOT_FOUND (light), E_UNSUPPORTED
 *        (the asset carries no curve).
 */
UMB_API UMB_CHECKED enum umb_status
umb_dial_choose(const struct umb_asset *asset, const struct umb_dial *dial,
                const struct umb_calibration *calibration, struct umb_query_settings *settings,
                struct umb_curve_row *row, struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
