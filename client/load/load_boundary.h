/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_BOUNDARY_H
#define UMBRAGE_LOAD_LOAD_BOUNDARY_H
/* Points close to shadow boundaries, found by queries to the service. */
#include "load/load_points.h"

/*
 * Replaces a pool of random points by points at shadow boundaries.
 *
 * Each point comes from a segment between a lit and a shadowed random point, halved 14 times. Its
 * distance from the boundary is at most 1/16384 of the bounds' size. Segments that cross no
 * boundary are drawn anew, a few times.
 *
 * In:    pool: filled with random points in the bounds.
 * Fails: as the service; E_NOT_FOUND (fewer than one segment in a thousand crosses a boundary).
 */
UMB_CHECKED enum umb_status umbc_load_find_boundaries(struct umb_client *client,
                                                      const struct umbc_load_source *source,
                                                      const struct umb_box *bounds,
                                                      struct umbc_load_pool *pool,
                                                      struct umb_error *error);

#endif
