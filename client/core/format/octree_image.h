/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_OCTREE_IMAGE_H
#define UMBRAGE_CORE_FORMAT_OCTREE_IMAGE_H
/*
 * The nodes of an octree as bytes, in its own order, for a later bake that adds to them.
 *
 * Little-endian, no padding:
 *
 *     uint32 bricks
 *     uint32 nodes, children      for each level from 4 to UMB_LEVEL_MAX
 *     then for each level from 4 up:
 *       uint16 mask               for each node
 *       uint32 child              for each mixed child of each node
 *     uint64 slice[8]             for each brick
 */
#include "format/node_pool.h"

/* Returns the size in bytes of an octree's image. */
uint64_t umb__octree_image_bytes(const struct umb__octree *octree);

/* Writes the image. In: to: uint8[umb__octree_image_bytes(octree)]. */
void umb__octree_image_write(const struct umb__octree *octree, uint8_t *to);

/*
 * Loads an image into an empty pool, whose numbers are then those of the octree.
 *
 * In:    pool: not a loose one. bytes: an image of a canonical octree.
 * Fails: E_CORRUPT (counts that do not fit the bytes, a number out of range, an impossible mask, a
 *        uniform node or brick), E_NO_MEMORY, E_LIMIT (max_bytes). The pool must then be cleared.
 * Trust: safe on hostile bytes; but equal nodes of a hostile image stay apart.
 */
UMB_CHECKED enum umb_status umb__pool_load(struct umb__pool *pool, const uint8_t *bytes,
                                           size_t size, struct umb_error *error);

/* Map from the numbers of an octree to those after umb__octree_compact. */
struct umb__octree_map {
    uint32_t *numbers[UMB_LEVEL_MAX + 1]; /* [count before] UINT32_MAX: removed */
    const struct umb_alloc *alloc;
};

/*
 * Removes all nodes that no root reaches, and keeps the order of the others.
 * Out: map: finish it also after a failure. Fails: as umb__pack_survey; the octree is then
 * unchanged.
 */
UMB_CHECKED enum umb_status umb__octree_compact(struct umb__octree *octree,
                                                struct umb__octree_map *map,
                                                struct umb_error *error);
void umb__octree_map_finish(struct umb__octree_map *map);

#endif
