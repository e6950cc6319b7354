/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_PROVEN_SQUARES_H
#define UMBRAGE_SERVER_BAKE_DEPTH_PROVEN_SQUARES_H
/*
 * Proven squares: squares of 64 x 64 texels whose columns follow from bounds alone, so that none of
 * their texels is drawn. The cost of a closed scene's bake then grows with the length of its
 * silhouettes.
 *
 * A square is proven if nothing covers it. It is also proven if a multiple of 64 lies between a
 * bound of its greatest lit and the least of all back and open faces: lit then ends before that
 * multiple and nothing defined is shadowed before it. The bound is that of a single front face that
 * covers every texel. Or, if a front face covers the middle and no border of the front side
 * (front_marks.h) comes near, it is the greatest lit that any front face could give: away from
 * borders every texel has as many front faces over it as the middle one, at least one. Behind each
 * of them is a back face of its solid; this holds only where every closed part was found closed.
 *
 * The bounds are the predicate's own values at the nearest or farthest texel (every rounded
 * operation is monotone). They depend on square and casters only, not on tiles, threads or paths.
 */
#include "bake/depth/tile.h"
#include "umbrage/workers.h"

/*
 * Fills tile->proven, and level UMBB_SQUARE_LOG2 of its pyramid where a square is proven: a bound
 * from above for max_lit, from below for min_end. Does nothing for a tile without `proven`.
 *
 * In: list: casters that may touch the tile or have a border within a texel of it; NULL: all.
 *     workers: threads to use; NULL: only the caller's.
 */
void umbb_prove_squares(const struct umbb_casters *casters, const uint32_t *list, size_t count,
                        const struct umb_workers *workers, struct umbb_tile *tile);

#endif
