/* SPDX-License-Identifier: Apache-2.0 */
#include "format/octree.h"

#include <string.h>

#include "base/memory.h"

void umb__octree_finish(struct umb__octree *octree)
{
    const struct umb_alloc *alloc = octree->alloc;
    umb__free(alloc, octree->bricks);
    umb__free(alloc, octree->roots);
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(alloc, octree->level[level].masks);
        umb__free(alloc, octree->level[level].first);
        umb__free(alloc, octree->level[level].children);
    }
    memset(octree, 0, sizeof *octree);
}
