/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_PROVEN_SQUARES_H
#define UMBRAGE_SERVER_BAKE_DEPTH_PROVEN_SQUARES_H
/*
 * Proven squares: squares of 64 x 64 texels whose columns follow from bounds alone, so that none of
 * their texels is drawn. The cost of a closed scene's bake then grows with the length of its
 * silhouettes.
 *
 * A square is proven if nothing covers it. It is also proven if a multiple of 64 lies between a
 * bound of its greatest lit and the least lit of all back and open faces. Then lit ends before that
 * multiple, and nothing defined is shadowed before the multiple.
 *
 * There are two bounds of the greatest lit. Where a single front face covers every texel, it is
 * that face's greatest lit. Where a front face covers the middle and no border of the front side
 * (the marks below) comes near, it is the greatest lit that any front face could give: away from
 * borders every texel has as many front faces over it as the middle one, at least one. Behind each
 * front face lies a back face of the same solid; this holds only where every closed part was found
 * closed.
 *
 * The bounds are the predicate's own values at the nearest or farthest texel, as every rounded
 * operation is monotone. They depend on square and casters only, not on tiles, threads or paths.
 *
 * Suns: the bounds decide how undefined voxels are stored, because they may lie in another multiple
 * of 64 than the greatest lit and the least end of the texels. Spot and point lights: no voxel
 * changes. A square is proven only if the lit and the end of one of its corner texels lie in the
 * same multiples of 64 as the bounds. Greatest lit and least end lie between corner and bound, so
 * they lie there too, and the nodes of level UMBB_SQUARE_LOG2 and above depend on these multiples
 * only.
 */
#include "bake/depth/tile.h"
#include "umbrage/workers.h"

/*
 * Marks of closed triangles: whether a triangle surely faces the light, and which of its edges are
 * borders of the front side. Borders are the silhouettes, and any edge whose neighbour does not
 * fit.
 *
 * An edge is inner if a neighbour has the same two corners, equal in every bit, in the other
 * direction, also faces the light, and lies on the other side of the edge in the projection. Any
 * other edge is a border. Away from borders the number of front faces over a texel cannot change.
 * The file's adjacency is not used, because it cannot be trusted.
 */

/* Choice whether to prove squares of texels from bounds (closed rule only). Tests force one or the
 * other. */
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
 * In:    prove: whether to make the marks. UMBB_PROVE_AUTO: if there are many squares of texels for
 *        the number of triangles. The choice depends on the casters alone, because it changes the
 *        values of undefined voxels. workers: threads to use; NULL: only the caller's. The marks
 *        depend neither on threads nor on the order of casters, because keys of tiles hold the
 *        marks (umbb_tile_key).
 * Out:   marks: uint8[count], freed by the caller; NULL if no marks are made. None are made if some
 *        parts count as closed only because the options say so.
 * Fails: E_NO_MEMORY.
 * Cost:  a temporary table of up to 32 bytes a front face; about three cache misses an edge of a
 *        front face.
 */
UMB_CHECKED enum umb_status umbb_front_marks_make(const struct umbb_casters *casters,
                                                  enum umbb_prove prove,
                                                  const struct umb_workers *workers,
                                                  uint8_t **marks, struct umb_error *error);

/*
 * Fills tile->proven, and level UMBB_SQUARE_LOG2 of its pyramid where a square is proven: an upper
 * bound as max_lit, a lower bound as min_end. Does nothing for a tile without `proven`.
 *
 * In: list: casters that may touch the tile or have a border within a texel of it; NULL: all.
 *     workers: threads to use; NULL: only the caller's.
 */
void umbb_prove_squares(const struct umbb_casters *casters, const uint32_t *list, size_t count,
                        const struct umb_workers *workers, struct umbb_tile *tile);

#endif
