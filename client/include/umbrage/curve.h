/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CURVE_H
#define UMBRAGE_CURVE_H
/*
 * How far an answer may be off.
 *
 * The bound. A voxel's value is the true visibility of its centre (docs/umb-format.md, section 1),
 * so an answer that differs from the truth at a point looked at a place on the other side of a
 * true shadow boundary. How far a look-up is from its point follows from the geometry alone: the
 * bias, and half the diagonal of the window (of a whole cell where look-ups stop at one). The bound
 * is the sum: whatever a query answers, a true boundary is no farther from the point than that, or
 * the answer is true. It holds in defined space, for windows that do not reach into closed solids.
 *
 * Threads: any.
 */
#include <stdint.h>
#include "umbrage/asset.h"
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

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
 * a light's frusta. 0 for a light that the asset does not have. */
UMB_API double umb_query_bound_m(const struct umb_asset *asset,
                                 const struct umb_query_settings *settings);

#ifdef __cplusplus
}
#endif
#endif
