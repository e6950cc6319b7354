/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_HARNESS_BAKE_FRUSTUM_H
#define UMBRAGE_TESTS_HARNESS_BAKE_FRUSTUM_H
/* Baking one frustum alone. */
#include <string.h>

#include "bake/build/tile_loop.h"
#include "base/page_alloc.h"

/* umbb_bake_into with a pool of its own. Out: octree: canonical, one root; the caller finishes
 * it. */
static inline enum umb_status
bake_frustum(const struct umbb_depth *depth, const struct umbb_bake_options *options,
             struct umb__octree *octree, struct umbb_bake_figures *figures, struct umb_error *error)
{
    struct umb__pool pool;
    uint32_t root = UMB__REF_LIT;
    memset(octree, 0, sizeof *octree);
    umb__pool_init(&pool, &umb__page_alloc, options->octree_max_bytes);
    enum umb_status status = umbb_bake_into(depth, options, &pool, &root, figures, error);
    if (status == UMB_OK) {
        status = umb__pool_take(&pool, &root, &options->log2_size, 1, octree, error);
    }
    umb__pool_finish(&pool);
    return status;
}

#endif
