/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_ALPHA_PYRAMID_H
#define UMBRAGE_SERVER_SCENE_ALPHA_PYRAMID_H
/*
 * The least and greatest alpha in rectangles of a texture, from a pyramid of blocks. The smallest
 * blocks have 16 x 16 texels; each level doubles the side, up to a single block. A look-up descends
 * only into blocks that straddle the rectangle's edge and may still widen the range. So its cost
 * grows with the rectangle's sides, not with its area.
 */
#include "scene/scene.h"

#define UMBS_PYRAMID_LEVELS_MAX 13U /* the single block of the last level has 2^16 texels a side */

struct umbs_alpha_range {
    uint8_t low, high;
};

/* Pyramid of a texture; zeroed before it is made. */
struct umbs_alpha_pyramid {
    const struct umbs_texture *texture; /* borrowed */
    const uint8_t *texels;              /* borrowed */
    /* Blocks of each level, row by row; the first pointer owns the memory of all. */
    struct umbs_alpha_range *level[UMBS_PYRAMID_LEVELS_MAX];
    uint32_t levels; /* number of levels; the last one is a single block */
};

/* Makes the pyramid of texture `number`, unless it is made already. Fails: E_NO_MEMORY. Cost: reads
 * every texel; memory of 2 bytes for 192 texels. */
UMB_CHECKED enum umb_status umbs_alpha_pyramid_find(const struct umbs_scene_view *view,
                                                    uint32_t number,
                                                    struct umbs_alpha_pyramid *pyramid,
                                                    struct umb_error *error);
void umbs_alpha_pyramid_finish(struct umbs_alpha_pyramid *pyramid);

/* Widens a range by the texels x[0] .. x[1], y[0] .. y[1], all within the texture. */
void umbs_alpha_pyramid_range(const struct umbs_alpha_pyramid *pyramid, const uint32_t x[2],
                              const uint32_t y[2], struct umbs_alpha_range *range);

#endif
