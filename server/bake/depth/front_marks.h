/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_FRONT_MARKS_H
#define UMBRAGE_SERVER_BAKE_DEPTH_FRONT_MARKS_H
/*
 * Marks of closed triangles: whether a triangle surely faces the light, and at which of its edges
 * that front side ends: the silhouettes, and any edge whose neighbour does not fit.
 *
 * An edge is inner if the triangle on its other side also faces the light and lies on the other
 * side of it in the projection: it has the same two corners, equal in every bit, in the other
 * direction. Any other edge is a border. Away from borders the number of front faces over a texel
 * cannot change. The file's adjacency is not used, because it cannot be trusted.
 */
#include "bake/depth/tile.h"
#include "umbrage/workers.h"

/* Whether to prove squares of texels from bounds (closed rule only); tests force it. */
enum umbb_prove {
    UMBB_PROVE_AUTO = 0,
    UMBB_PROVE_ALWAYS = 1,
    UMBB_PROVE_NEVER = 2,
};

enum {
    UMBB_MARK_BORDER = 7, /* bit e: the edge from corner e to e + 1 is a border */
    UMBB_MARK_FRONT = 8,  /* faces the light by more than rounding could reverse */
};

/*
 * Makes the marks of all casters; open ones, and those that do not surely face the light, get 0.
 *
 * In:    prove: whether to make them. By itself: if squares of texels are many for the number of
 *        triangles. This depends on the casters alone, because it decides which undefined voxels
 *        are chosen. workers: threads to use; NULL: only the caller's. The marks depend neither on
 *        them nor on the order of casters: keys of tiles hold them (tile_key.h).
 * Out:   marks: uint8[count], freed by the caller; NULL if none are made, which is always so where
 *        parts count as closed on the caller's word only.
 * Fails: E_NO_MEMORY.
 * Cost:  a temporary table of up to 32 bytes a front face; about three cache misses an edge of a
 *        front face.
 */
UMB_CHECKED enum umb_status umbb_front_marks_make(const struct umbb_casters *casters,
                                                  enum umbb_prove prove,
                                                  const struct umb_workers *workers,
                                                  uint8_t **marks, struct umb_error *error);

#endif
