/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_FRONT_MARKS_H
#define UMBRAGE_SERVER_BAKE_DEPTH_FRONT_MARKS_H
/*
 * Which closed triangles surely face the light, and at which of their edges that front side ends:
 * the silhouettes, and wherever a neighbour does not fit.
 *
 * An edge is inner if the triangle on its other side faces the light too and lies on the other side
 * of it in the projection: it runs along the same two corners, equal in every bit, the other way.
 * Any other edge is a border. Away from borders the number of front faces over a texel cannot
 * change.
 *
 * Source: the project's measurements (output-sensitive bake); no adjacency of the file is trusted.
 */
#include "bake/depth/tile.h"
#include "format/content.h"

enum {
    UMBB_MARK_BORDER = 7, /* bit e: the edge from corner e to e + 1 is a border */
    UMBB_MARK_FRONT = 8,  /* faces the light by more than rounding could turn around */
};

/*
 * Finds the marks of all casters; open ones and those that do not surely face the light get 0.
 *
 * In:    prove: when to; by itself where squares of texels are many for the triangles, which
 *        depends on the casters alone, as it decides which undefined voxels are chosen.
 *        workers: who helps; NULL: nobody. The marks depend neither on them nor on the order of
 *        casters: keys of tiles hold them (tile_key.h).
 * Out:   marks: uint8[count], the caller's to free; NULL if they are not to be found, which is
 *        also so where parts count as closed on the caller's word only.
 * Fails: E_NO_MEMORY.
 * Cost:  a table of up to 32 bytes a front face for a while; about three missed cache lines an edge
 * of a front face.
 */
UMB_CHECKED enum umb_status umbb_front_marks_make(const struct umbb_casters *casters,
                                                  enum umbb_prove prove,
                                                  const struct umb_workers *workers,
                                                  uint8_t **marks, struct umb_error *error);

#endif
