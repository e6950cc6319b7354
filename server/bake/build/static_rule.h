/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_STATIC_RULE_H
#define UMBRAGE_SERVER_BAKE_BUILD_STATIC_RULE_H
/*
 * The static rule: nothing moves, so that only points on surfaces are ever asked for, and what no
 * window of theirs reads is undefined.
 *
 * A triangle is *asked* if some shadow touches it: at some texel centre that it covers another
 * caster lies more than a voxel before it, or it covers none. Those that the light reaches all over
 * are not: their answer is lit, whatever their windows meet behind another caster's front. Behind
 * the first caster a column is undefined up to the first voxel that a window of an asked triangle
 * may read: any odd number of taps up to UMB_TAPS_MAX, the automatic bias, and the triangle's own
 * normal, or none on slopes of at most 3 in 4 (docs/explained/effects.md).
 *
 *     umbb_static_init(&rule, &casters, frustum, cells, &error);
 *     for every tile, drawn: umbb_static_survey(&rule, tile, jobs, cancelled);  who is asked
 *     for every tile, drawn: umbb_static_begin(&rule, tile);      then all bands, any threads:
 *                            umbb_static_band(&rule, tile, band);
 *     umbb_static_finish(&rule);
 *
 * Everything follows from triangles and `lit`, texel by texel: not from tiles, order or threads.
 * Source: Arvo and Hirvikorpi 2005; Sintorn et al. 2014, section 6.1 (between first and second
 * caster); that windows must find what they read is ours.
 */
#include "tool/threads.h"
#include "bake/depth/tile.h"

#define UMBB_STATIC_BAND 64 /* rows of texels of a tile that are one job */

struct umbb_static {
    const struct umbb_casters *casters; /* borrowed; of parallel light */
    double reach[3]; /* voxels that an automatic bias moves a point at most, towards -z on z */
    uint8_t *met;    /* [count] what the survey saw of a triangle */
    uint32_t *list;  /* [list_count] asked triangles that may reach the tile at hand */
    size_t list_count;
};

/*
 * Starts, and marks the cells that hold receivers.
 *
 * In:    casters: of parallel light. frustum: theirs, voxel_step set.
 * Out:   cells: uint64[UMB__RECEIVER_MASK_WORDS] (format/receiver_mask.h).
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_static_init(struct umbb_static *rule,
                                             const struct umbb_casters *casters,
                                             const struct umb_frustum_info *frustum,
                                             uint64_t *cells, struct umb_error *error);
void umbb_static_finish(struct umbb_static *rule);

/* Finds out which triangles are asked, from a tile's texels; those of squares that the pyramid says
 * are background need not be set. In: jobs: idle; all its threads help. cancelled: any thread, or
 * NULL; once it says 1, and it must stay so, the rest is left out. */
void umbb_static_survey(struct umbb_static *rule, const struct umbb_tile *tile,
                        struct umbu_threads *jobs, int (*cancelled)(void));

/* Lists what reaches a tile. All tiles have been surveyed. */
void umbb_static_begin(struct umbb_static *rule, const struct umbb_tile *tile);

/*
 * Moves `end` of a band's texels to where the undefined region ends, and level 3 of the pyramid
 * with it. Before: the end under the closed rule, or lit.
 *
 * In: tile: with an array `end` of its own. number: of the band, which begins
 * at row UMBB_STATIC_BAND * number.
 * Returns 0 if there is no memory. Threads: different bands at once.
 */
int umbb_static_band(const struct umbb_static *rule, struct umbb_tile *tile, uint32_t number);

#endif
