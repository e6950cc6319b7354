/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_ORACLE_DEPTH_H
#define UMBRAGE_TESTS_ORACLE_DEPTH_H
/*
 * lit and end of every texel by brute force over triangles, in long double, from the definition:
 *
 *   lit  voxels whose centre z + 0.5 lies before the first occluder
 *   end  lit; but where closed solids count, and their nearest front face is the first occluder or
 *        falls on the same voxel index, the voxels whose centre lies before their nearest back face
 *
 * Each texel's ray is intersected with the planes of the triangles in space, by determinants of the
 * homogeneous corners (X, Y, W): nothing is cut, and W may have any sign.
 *
 * A texel is a tie, and has no answer, if its centre lies within ORACLE_TIE voxels of a projected
 * edge, or if a depth that decides lies within ORACLE_TIE of a voxel centre: there rounding may
 * rightly fall either way. 1e-7 is far above the error of doubles at 2^20 voxels (about 1e-9) and
 * far below anything one can see.
 */
#include <stddef.h>
#include <stdint.h>
#include "oracle_scene.h"

#define ORACLE_TIE 1e-7L

struct oracle_texel {
    uint32_t lit, end;
    int tie;
};

struct oracle_view {
    const double *m;      /* 16, row major: world minus origin to (X, Y, Z, W) */
    const double *origin; /* 3 */
    uint32_t side;        /* voxels */
    int closed;           /* the closed rule holds */
};

struct oracle_caster; /* a projected triangle */

struct oracle_depth {
    uint32_t side;
    int closed;
    struct oracle_caster *casters;
    size_t *row_first; /* side + 1: where a row's casters begin in row_items */
    uint32_t *row_items;
    struct oracle_hits *hits; /* a row's */
};

/* 0 if there is no memory or M mirrors everything onto a plane; finish it all the same. */
int oracle_depth_init(struct oracle_depth *depth, const struct oracle_scene *scene,
                      const struct oracle_view *view);

/* Fills `side` texels of row y, every `step`-th of them. */
void oracle_depth_row(struct oracle_depth *depth, uint32_t y, uint32_t step,
                      struct oracle_texel *row);

void oracle_depth_finish(struct oracle_depth *depth);

#endif
