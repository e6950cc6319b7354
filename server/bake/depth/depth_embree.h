/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_EMBREE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_EMBREE_H
/*
 * Depth by casting one ray a texel with Embree.
 *
 * Embree only proposes candidates: every triangle is a user primitive with a padded box, and every
 * decision is the predicate's (coverage.h). So it gives the same integers as the rasteriser in
 * another way, slower by an order of magnitude.
 */
#include "bake/depth/depth_raster.h"

/* As umbb_depth_raster_create. Fails: E_NO_MEMORY, E_INTERNAL (with Embree's message). */
UMB_CHECKED enum umb_status umbb_depth_embree_create(const struct umbb_casters *casters,
                                                     const struct umbb_depth_options *options,
                                                     struct umbb_depth *depth,
                                                     struct umb_error *error);

#endif
