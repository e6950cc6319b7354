/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BAKE_FRUSTA_H
#define UMBRAGE_SERVER_BAKE_BAKE_FRUSTA_H
/*
 * Baking all frusta of an asset, one after another, into one pool of nodes. The order of the
 * frusta, which enters an asset's id, follows from the order of the lights alone.
 */
#include "bake/analysis/analysis.h"
#include "bake/build/tile_loop.h"
#include "bake/memory_plan.h"
#include "bake/tiles/tile_folder.h"

/* The first occluders of all frusta, as an asset's content holds them. */
struct umbb_occluder_depth_words {
    uint32_t *words; /* free with umb__occluder_depth_words_free(NULL, words); NULL: not kept */
    uint64_t count;
};

/* Input of baking all frusta. */
struct umbb_frusta_job {
    struct umbb_analysis *analysis; /* may be left without corners */
    const struct umbs_scene_view *view;
    const struct umbb_options *options;
    const struct umbb_memory_plan *memory; /* division of memory for these options */
    struct umbb_tile_folder *tile_folder;  /* NULL: no tile is kept or found */
    /* Result: the occluder depth map; NULL: not wanted. */
    struct umbb_occluder_depth_words *occluder_depth;
    size_t occluder_depth_max_bytes; /* limit of the map: umbb_head_occluder_depth_bytes */
    /* [frustum_count][UMB__RECEIVER_MASK_WORDS] Result: the cells with receivers. The static rule
     * is on if this is not NULL. */
    uint64_t *receiver_mask_cells;
};

/* Returns the number of tiles of all frusta. Tiles are numbered frustum by frustum, row by row. */
uint64_t umbb_tile_count(const struct umbb_analysis *analysis, uint32_t tile_log2);

/*
 * Bakes all frusta.
 *
 * Out:   octree: canonical, a root for each frustum; the caller finishes it. With task tile it
 *        stays empty: the results are in `tile_folder`. figures: sums.
 * Fails: E_NO_MEMORY, E_LIMIT (--memory), E_CANCELLED, E_INTERNAL (Embree), and the errors of the
 *        tile cache (tile_folder.h).
 */
UMB_CHECKED enum umb_status umbb_bake_frusta(const struct umbb_frusta_job *job,
                                             struct umb__octree *octree,
                                             struct umbb_bake_figures *figures,
                                             struct umb_error *error);

#endif
