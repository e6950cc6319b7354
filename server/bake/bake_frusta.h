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
#include "bake/tiles/tile_keeping.h"

/* The first occluders of all frusta, as an asset's content holds them. */
struct umbb_front_words {
    uint32_t *words; /* free with umb_front_words_free(NULL, words); NULL: not kept */
    uint64_t count;
};

/* What is to be baked. */
struct umbb_frusta_job {
    struct umbb_analysis *analysis; /* its corners end up in some voxel space */
    const struct umbs_scene_view *view;
    const struct umbb_options *options;
    const struct umbb_memory_plan *memory; /* as divided for these options */
    struct umbb_tile_keeping *keeping;     /* NULL: no tile is kept or found */
    struct umbb_front_words *front;        /* gets the front; NULL: not wanted */
    size_t front_max_bytes;                /* for it: umbb_head_front_bytes */
    uint64_t *near_cells; /* [frustum_count][UMB__NEAR_WORDS] gets the cells that hold receivers,
                           * and the static rule holds; NULL: off */
};

/* Tiles of all frusta together; frustum by frustum, row by row is how they are numbered. */
uint64_t umbb_tile_count(const struct umbb_analysis *analysis, uint32_t tile_log2);

/*
 * Bakes.
 *
 * Out:   octree: canonical, a root for each frustum; the caller finishes it. With task tile it
 *        stays empty: the results are with `keeping`. figures: sums.
 * Fails: E_NO_MEMORY, E_LIMIT (--memory), E_CANCELLED, E_INTERNAL (Embree), what the keeper says
 *        (tile_keeping.h).
 */
UMB_CHECKED enum umb_status umbb_bake_frusta(const struct umbb_frusta_job *job,
                                             struct umb_octree *octree,
                                             struct umbb_bake_figures *figures,
                                             struct umb_error *error);

#endif
