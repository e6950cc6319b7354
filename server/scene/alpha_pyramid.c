/* SPDX-License-Identifier: Apache-2.0 */
/* Pyramids of alpha (alpha_pyramid.h). A look-up recurses at most once for each level. */
#include "scene/alpha_pyramid.h"

#include <stdlib.h>
#include <string.h>

#define BLOCK_LOG2 4U /* texels a side of a block of level 0 */

/* A rectangle of texels; both ends are included. */
struct rectangle {
    uint32_t x[2], y[2];
};

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static uint32_t greatest(uint32_t a, uint32_t b)
{
    return a > b ? a : b;
}

static void widen(struct umbs_alpha_range *range, struct umbs_alpha_range by)
{
    range->low = by.low < range->low ? by.low : range->low;
    range->high = by.high > range->high ? by.high : range->high;
}

/* Number of blocks along an axis of n texels. */
static uint32_t block_count(uint32_t n, uint32_t level)
{
    return ((n - 1) >> (BLOCK_LOG2 + level)) + 1;
}

static struct umbs_alpha_range *block_at(const struct umbs_alpha_pyramid *pyramid, uint32_t level,
                                         uint32_t x, uint32_t y)
{
    return &pyramid->level[level][(size_t)y * block_count(pyramid->texture->width, level) + x];
}

/* The rectangle of texels that a block covers. */
static struct rectangle block_texels(const struct umbs_texture *texture, uint32_t level, uint32_t x,
                                     uint32_t y)
{
    const uint32_t log2 = BLOCK_LOG2 + level;
    return (struct rectangle){
        .x = {x << log2, least((x + 1) << log2, texture->width) - 1},
        .y = {y << log2, least((y + 1) << log2, texture->height) - 1},
    };
}

/* Widens a range texel by texel. */
static void texels_add(const struct umbs_alpha_pyramid *pyramid, const struct rectangle *r,
                       struct umbs_alpha_range *range)
{
    for (uint32_t y = r->y[0]; y <= r->y[1]; y++) {
        const uint8_t *row = pyramid->texels + (size_t)y * pyramid->texture->width;
        for (uint32_t x = r->x[0]; x <= r->x[1]; x++) {
            widen(range, (struct umbs_alpha_range){row[x], row[x]});
        }
    }
}

static void level_fill(const struct umbs_alpha_pyramid *pyramid, uint32_t level)
{
    const struct umbs_texture *texture = pyramid->texture;
    const uint32_t width = block_count(texture->width, level);
    const uint32_t height = block_count(texture->height, level);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            struct umbs_alpha_range *to = block_at(pyramid, level, x, y);
            *to = (struct umbs_alpha_range){UINT8_MAX, 0};
            if (level == 0) {
                const struct rectangle texels = block_texels(texture, level, x, y);
                texels_add(pyramid, &texels, to);
                continue;
            }
            const uint32_t right = least(2 * x + 1, block_count(texture->width, level - 1) - 1);
            const uint32_t top = least(2 * y + 1, block_count(texture->height, level - 1) - 1);
            widen(to, *block_at(pyramid, level - 1, 2 * x, 2 * y));
            widen(to, *block_at(pyramid, level - 1, right, 2 * y));
            widen(to, *block_at(pyramid, level - 1, 2 * x, top));
            widen(to, *block_at(pyramid, level - 1, right, top));
        }
    }
}

enum umb_status umbs_alpha_pyramid_find(const struct umbs_scene_view *view, uint32_t number,
                                        struct umbs_alpha_pyramid *pyramid, struct umb_error *error)
{
    const struct umbs_texture *texture = &view->textures[number];
    size_t first[UMBS_PYRAMID_LEVELS_MAX], count = 0;
    uint32_t levels = 0;
    if (pyramid->levels > 0) {
        return UMB_OK;
    }
    for (uint32_t side = 0; levels < UMBS_PYRAMID_LEVELS_MAX && side != 1; levels++) {
        const uint32_t width = block_count(texture->width, levels);
        const uint32_t height = block_count(texture->height, levels);
        first[levels] = count;
        count += (size_t)width * height;
        side = greatest(width, height);
    }
    struct umbs_alpha_range *ranges = malloc(count * sizeof *ranges);
    if (ranges == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "texture %u: memory refused", number);
    }
    *pyramid = (struct umbs_alpha_pyramid){
        .texture = texture, .texels = view->alpha + texture->offset, .levels = levels};
    for (uint32_t level = 0; level < levels; level++) {
        pyramid->level[level] = ranges + first[level];
        level_fill(pyramid, level);
    }
    return UMB_OK;
}

void umbs_alpha_pyramid_finish(struct umbs_alpha_pyramid *pyramid)
{
    free(pyramid->level[0]);
    memset(pyramid, 0, sizeof *pyramid);
}

/* Adds the part of a rectangle that lies in a block, unless the block is known to add nothing. */
static void block_add(const struct umbs_alpha_pyramid *pyramid, const struct rectangle *r,
                      uint32_t level, uint32_t x, uint32_t y, struct umbs_alpha_range *range)
{
    const struct umbs_texture *texture = pyramid->texture;
    if (x >= block_count(texture->width, level) || y >= block_count(texture->height, level)) {
        return;
    }
    const struct rectangle whole = block_texels(texture, level, x, y);
    const struct rectangle part = {
        .x = {greatest(whole.x[0], r->x[0]), least(whole.x[1], r->x[1])},
        .y = {greatest(whole.y[0], r->y[0]), least(whole.y[1], r->y[1])},
    };
    const struct umbs_alpha_range one = *block_at(pyramid, level, x, y);
    if (part.x[0] > part.x[1] || part.y[0] > part.y[1] ||
        (one.low >= range->low && one.high <= range->high)) {
        return;
    }
    if (memcmp(&part, &whole, sizeof part) == 0) {
        widen(range, one);
    } else if (level == 0) {
        texels_add(pyramid, &part, range);
    } else {
        for (uint32_t q = 0; q < 4; q++) {
            block_add(pyramid, r, level - 1, 2 * x + (q & 1), 2 * y + (q >> 1), range);
        }
    }
}

void umbs_alpha_pyramid_range(const struct umbs_alpha_pyramid *pyramid, const uint32_t x[2],
                              const uint32_t y[2], struct umbs_alpha_range *range)
{
    const struct rectangle r = {{x[0], x[1]}, {y[0], y[1]}};
    block_add(pyramid, &r, pyramid->levels - 1, 0, 0, range);
}
