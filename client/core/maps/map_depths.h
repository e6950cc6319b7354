/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_DEPTHS_H
#define UMBRAGE_CORE_MAPS_MAP_DEPTHS_H
/*
 * Depths as a shadow map stores them: IEEE singles, or 24- or 16-bit steps of 1/(2^b - 1), rounded
 * to nearest. The greatest value means "no caster" and is never reached by a caster: one that
 * would round up to it is stored one step nearer.
 */
#include "maps/map_parts.h"

/* Stores a layer. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__depths_init(struct umb__depths *depths, const struct umb_map *map,
                                             const float *layer, struct umb_error *error);
void umb__depths_finish(struct umb__depths *depths, const struct umb_map *map);

/* Depth of a texel; INFINITY where there is no caster, as beyond the border. */
double umb__depth_at(const struct umb__depths *depths, int64_t x, int64_t y);

#endif
