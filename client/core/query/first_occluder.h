/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_FIRST_OCCLUDER_H
#define UMBRAGE_CORE_QUERY_FIRST_OCCLUDER_H
/*
 * First occluders of single columns, which the blocker searches of penumbras read.
 *
 * Columns are those of open bakes: lit down to their first occluder, then shadowed. Under the
 * closed rule the occluder depth map gives the first occluders (format/occluder_depth.h), because a
 * single voxel then proves nothing about the rest of its column.
 */
#include "query/query_parts.h"

/* The columns of one frustum. */
struct umb__occluders {
    struct umb__tree tree;
    const uint32_t *occluder_depth; /* Occluder depth map; NULL: columns stay shadowed */
    uint32_t occluder_depth_root;   /* Root of the frustum in that map */
    uint32_t last;                  /* Depth of the occluder found last, a good guess for the next
                                       column; UINT32_MAX at first */
    struct umb_volume_stats read;   /* Counts, added to */
};

/* Finds the first occluder of column (x, y) inside the frustum. In: limit: a voxel of the column.
 * Returns whether the occluder is at voxel `limit` or before; *depth is then its depth in
 * voxels. */
bool umb__first_occluder(struct umb__occluders *occluders, uint32_t x, uint32_t y, uint32_t limit,
                         uint32_t *depth);

#endif
