/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_PROVEN_SQUARES_H
#define UMBRAGE_SERVER_BAKE_DEPTH_PROVEN_SQUARES_H
/*
 * Squares of 64 x 64 texels whose columns are known from bounds alone, so that no texel of them is
 * ever drawn: a closed scene's bake then grows with the length of its silhouettes.
 *
 * A square is proven if nothing covers it; or if a multiple of 64 lies between a bound of its
 * greatest lit and the least of all back and open faces: lit then ends before that multiple and
 * nothing defined is shadowed before it. The bound is that of a single front face that covers every
 * texel; or, if a front face covers the middle and no border of the front side (front_marks.h)
 * comes near, the greatest lit that any front face could give: away from borders every texel has as
 * many front faces over it as the middle one, at least one. Behind each of them is a back face of
 * its solid: hence only where all that counts as closed was found closed.
 *
 * The bounds are the predicate's own values at the nearest or farthest texel (every rounded
 * operation is monotone). They depend on square and casters only, not on tiles, threads or paths.
 */
#include "bake/depth/tile.h"
#include "format/content.h"

/*
 * Fills tile->proven, and level UMBB_SQUARE_LOG2 of its pyramid where a square is proven: a bound
 * from above for max_lit, from below for min_end. Does nothing for a tile without `proven`.
 *
 * In: list: casters that may touch the tile or have a border within a texel of it; NULL: all.
 *     workers: who helps; NULL: nobody.
 */
void umbb_prove_squares(const struct umbb_casters *casters, const uint32_t *list, size_t count,
                        const struct umb_workers *workers, struct umbb_tile *tile);

#endif
