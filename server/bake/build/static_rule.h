/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_STATIC_RULE_H
#define UMBRAGE_SERVER_BAKE_BUILD_STATIC_RULE_H
/*
 * The static rule: nothing moves, so queries come only for points on surfaces. Voxels that no
 * window of such a point reads are undefined.
 *
 * A triangle is *asked* if some shadow touches it: it covers a texel centre where another caster
 * lies more than a voxel before it, or it covers no centre. A triangle that the light reaches all
 * over is not asked: points on such a triangle are lit, whatever voxels behind other casters their
 * windows read. Behind the first caster a column is undefined up to the first voxel that a window
 * of an asked triangle may read. Windows have any odd number of taps up to UMB_TAPS_MAX, the
 * automatic bias, and the triangle's own normal, or none on slopes of at most 3 in 4
 * (docs/explained/effects.md).
 *
 *     umbb_static_init(&rule, &casters, frustum, cells, &error);
 *     for every tile, drawn: umbb_static_survey(&rule, tile, jobs, cancelled); finds the asked
 *     for every tile, drawn: umbb_static_begin(&rule, tile);      then all bands, any threads:
 *                            umbb_static_band(&rule, tile, band);
 *     umbb_static_finish(&rule);
 *
 * Everything follows from triangles and `lit`, texel by texel: not from tiles, order or threads.
 * Source: Arvo and Hirvikorpi 2005; Sintorn et al. 2014, section 6.1 (between first and second
 * caster). The condition that windows must find all voxels they read is our own.
 */
#include "tool/threads.h"
#include "bake/depth/tile.h"

#define UMBB_STATIC_BAND 64 /* rows of texels of a tile in one slice */

struct umbb_static {
    const struct umbb_casters *casters; /* borrowed; of parallel light */
    double reach[3]; /* greatest number of voxels by which the automatic bias moves a point on each
                        axis; on z it moves towards -z */
    double longest_lift; /* voxels of the longest lift along the light, for the widest window */
    uint8_t *met;        /* [count] flags that the survey found for a triangle */
    uint32_t *list;      /* [list_count] asked triangles that may reach the current tile */
    size_t list_count;
};

/*
 * Starts the rule, and marks the cells with receivers.
 *
 * In:    casters: of parallel light. frustum: the casters' frustum, with voxel_step set.
 * Out:   cells: uint64[UMB__RECEIVER_MASK_WORDS] (format/receiver_mask.h).
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_static_init(struct umbb_static *rule,
                                             const struct umbb_casters *casters,
                                             const struct umb_frustum_info *frustum,
                                             uint64_t *cells, struct umb_error *error);
void umbb_static_finish(struct umbb_static *rule);

/* Finds the asked triangles from a tile's texels. Texels of squares that the pyramid marks as
 * background need not be set. In: jobs: idle threads, which all help. cancelled: may be called from
 * any thread; NULL: none. After `cancelled` returns 1 the remaining triangles are skipped. */
void umbb_static_survey(struct umbb_static *rule, const struct umbb_tile *tile,
                        struct umbu_threads *jobs, int (*cancelled)(void));

/* Lists the asked triangles that reach a tile. Survey all tiles first. */
void umbb_static_begin(struct umbb_static *rule, const struct umbb_tile *tile);

/*
 * Moves `end` of a band's texels to the end of the undefined region, and updates level 3 of the
 * pyramid. On entry `end` is that of the closed rule, or lit.
 *
 * In: tile: with an array `end` of its own. number: number of the band, whose first row is
 *     UMBB_STATIC_BAND * number.
 * Returns 0 if out of memory. Threads: different bands at once.
 */
int umbb_static_band(const struct umbb_static *rule, struct umbb_tile *tile, uint32_t number);

#endif
