/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_BOUNDARY_H
#define UMBRAGE_LOAD_LOAD_BOUNDARY_H
/* Points close to where light turns to shadow, found through the service. */
#include "load/load_points.h"

/*
 * Replaces a pool of random points by points at the borders of shadows.
 *
 * Segments between one random point and another are halved 14 times between a lit and a shadowed
 * end, so that a point is within 1/16384 of the bounds' size of a border. Where segments cross no
 * border they are drawn anew, a few times.
 *
 * In:    pool: filled with random points in the bounds.
 * Fails: what the service says; E_NOT_FOUND (fewer than one segment in a thousand crosses a
 * border).
 */
UMB_CHECKED enum umb_status umbc_load_find_boundaries(struct umb_client *client,
                                                      const struct umbc_load_source *source,
                                                      const struct umb_box *bounds,
                                                      struct umbc_load_pool *pool,
                                                      struct umb_error *error);

#endif
