/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BAKE_FRUSTA_H
#define UMBRAGE_SERVER_BAKE_BAKE_FRUSTA_H
/*
 * Baking all frusta of an asset, one after another, into one pool of nodes. The ids of assets
 * depend on their order only through the lights' own.
 */
#include "bake/analysis/analysis.h"
#include "bake/build/tile_loop.h"
#include "bake/memory_plan.h"

/*
 * Bakes.
 *
 * In:    analysis: its corners end up in some voxel space. memory: as divided for these options.
 * Out:   octree: canonical, a root for each frustum; the caller finishes it. figures: sums.
 * Fails: E_NO_MEMORY, E_LIMIT (--memory), E_CANCELLED, E_INTERNAL (Embree).
 */
UMB_CHECKED enum umb_status
umbb_bake_frusta(struct umbb_analysis *analysis, const struct umbs_scene_view *view,
                 const struct umbb_options *options, const struct umbb_memory_plan *memory,
                 struct umb_octree *octree, struct umbb_bake_figures *figures,
                 struct umb_error *error);

#endif
