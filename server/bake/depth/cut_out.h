/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_CUT_OUT_H
#define UMBRAGE_SERVER_BAKE_DEPTH_CUT_OUT_H
/*
 * Cut-out casters: which of the covered texels (coverage.h) a caster's texture keeps.
 *
 * A triangle's edge functions at a texel's centre are the centre's barycentric weights on the
 * triangle's plane. Edge functions are homogeneous (Olano, Greer 1997): the corners stay X, Y, W,
 * so a triangle cut by the eye's plane needs no other formula. Each weight is clamped to 0..1, so
 * texture coordinates stay within the triangle's own: at an edge the predicate may cover a centre
 * that lies outside by rounding. All paths use this one function of triangle, texel and texture.
 */
#include "bake/depth/coverage.h"
#include "bake/depth/tile.h"
#include "scene/scene_alpha.h"

/* The edge functions of a triangle in light space. */
struct umbb_cut_plane {
    double anchor[2];  /* texel coordinates of the functions' origin */
    double edge[3][3]; /* function of the edge opposite each corner: coefficients of x, y, 1 */
};

/* Cut-out casters of a frustum. */
struct umbb_cuts {
    const uint32_t *of; /* [casters] index of a plane or UMBS_CUT_NONE; NULL: none is cut out */
    const struct umbb_cut_plane *planes; /* [table->count] */
    const struct umbs_cuts *table;
};

/* Makes the edge functions. In: corners: X, Y, W of each corner; W is 1 for directional lights. */
void umbb_cut_plane_find(const double corners[3][3], struct umbb_cut_plane *plane);

/* 1 if cut number `cut` casts at the centre of texel (x, y). */
int umbb_cut_casts(const struct umbb_cuts *cuts, uint32_t cut, int32_t x, int32_t y);

/* Returns the share of light that translucent cut number `cut` absorbs at texel (x, y)'s centre. */
double umbb_cut_takes(const struct umbb_cuts *cuts, uint32_t cut, int32_t x, int32_t y);

/* Index of a caster's cut, UMBS_CUT_NONE if it casts all over. */
static inline uint32_t umbb_cut_of(const struct umbb_cuts *cuts, size_t caster)
{
    return cuts == NULL || cuts->of == NULL ? UMBS_CUT_NONE : cuts->of[caster];
}

#endif
