/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_NEAR_CASTERS_H
#define UMBRAGE_SERVER_BAKE_WRITE_NEAR_CASTERS_H
/* The casters that the rays of some squares of a directional light can meet. */
#include "bake/write/self_check.h"
#include "rays/verify_squares.h"

struct umbb_near_casters {
    const double (*corners)[3][3]; /* [count] world */
    const uint8_t *closed;         /* [count]; NULL: no closed rule */
    struct umbs_cuts cuts;         /* of: [count], or NULL */
    size_t count;
    void *memory[3]; /* what is freed */
};

/*
 * Finds the casters within four texels of boxes around squares that lie close together.
 *
 * In:    squares: of light `light`.
 * Out:   found: 0 if all casters are needed: the light is no directional one, or the squares are
 *        spread too widely. near: to be finished if found is 1.
 * Fails: E_NO_MEMORY.
 * Cost:  a pass over the triangles.
 */
UMB_CHECKED enum umb_status umbb_near_casters_find(const struct umb_asset *asset, uint32_t light,
                                                   const struct umbb_check *check,
                                                   const struct umbr_square *squares, size_t count,
                                                   struct umbb_near_casters *near, int *found,
                                                   struct umb_error *error);
void umbb_near_casters_finish(struct umbb_near_casters *near);

#endif
