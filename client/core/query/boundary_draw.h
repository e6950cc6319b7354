/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_BOUNDARY_DRAW_H
#define UMBRAGE_CORE_QUERY_BOUNDARY_DRAW_H
/*
 * Draws a shadow boundary of a frustum at random: two voxels with a common face, one lit and the
 * other shadowed.
 *
 * From a cell of the grid a walk goes down the nodes, at each one to a mixed child drawn at random.
 * A mixed node holds both states, so a boundary lies somewhere inside, and the walk finds one
 * without going back. It ends in a brick, or in a node whose children are all uniform, with one of
 * the faces where both states meet.
 *
 * Masks of nodes and bricks are copied before use: a mapped file that changes meanwhile gives
 * useless boundaries, but loops end and no index leaves its array.
 */
#include "query/voxel_tree.h"

/* Random numbers: number i is a function of key and i. */
struct umb__draws {
    uint64_t key, count;
};

/* Returns the numbers of point `point` under a seed. */
struct umb__draws umb__draws_of(uint64_t seed, uint32_t point);

uint64_t umb__draw(struct umb__draws *draws);

/* Returns a number in 0 .. limit - 1. */
uint32_t umb__draw_below(struct umb__draws *draws, uint32_t limit);

/* Returns a number in [0, 1). */
double umb__draw_unit(struct umb__draws *draws);

struct umb__boundary {
    uint32_t lit[3], shadowed[3]; /* Voxels; they differ on one axis, by one */
};

/* A cell of the grid that is mixed, or whose next cell on an axis has the other state: a boundary
 * lies in it or at its face. */
struct umb__boundary_cell {
    struct umb__link link;
    uint32_t first[3]; /* First voxel */
    uint64_t faces[3]; /* Bit 0: the next cell on z, x or y has the other state; if not mixed */
};

/* Reads cell (x, y, z) of the grid. Returns false if no boundary lies in it or at its faces; `cell`
 * may then not be set. */
bool umb__boundary_cell_read(const struct umb__tree *tree, uint32_t x, uint32_t y, uint32_t z,
                             struct umb__boundary_cell *cell);

/*
 * Draws a boundary of a cell. Where the walk ends with both kinds, a boundary across the light and
 * one between neighbouring columns have equal chances. A boundary between columns is the edge of a
 * shadow: it is moved along the light to the surface that receives the shadow, unless the shadowed
 * voxels end before that surface.
 *
 * Returns false if there is no boundary, which happens only in files that change meanwhile.
 */
bool umb__boundary_draw(const struct umb__tree *tree, const struct umb__boundary_cell *cell,
                        struct umb__draws *draws, struct umb__boundary *boundary);

#endif
