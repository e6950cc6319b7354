/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_TILE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_TILE_H
/*
 * A tile: a square of the light's texels with their two integers, `lit` and `end`, and the casters
 * that determine both.
 *
 * lit: number of voxels of the column whose centre lies before the first caster. end: number of
 * voxels whose centre lies before the end of the first undefined region, never less than lit.
 * Without the closed rule end = lit, and the two share one array. Background: both are `size`.
 *
 * Texels are stored by 8x8 blocks, row by row in a block, blocks row by row in the tile, so that
 * texels which the build reads together lie together. Above them a pyramid holds the greatest lit
 * and the least end of each square of 8, 16, .. texels up to the tile. A square whose pyramid says
 * "background only" may have texels that were never written; the build does not read them.
 *
 * Threads: disjoint blocks of UMBB_BLOCK texels may be filled at once.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"

#define UMBB_BLOCK_LOG2 8
/* Texels a side of a block, the unit of depth work: its layers fit the second-level cache. */
#define UMBB_BLOCK (1 << UMBB_BLOCK_LOG2)

/* Log2 of the texels a side of a square that may be proven from bounds. */
#define UMBB_SQUARE_LOG2 6

/* Class of a triangle. */
enum umbb_caster {
    UMBB_CASTER_OPEN = 0,           /* casts; bounds no solid */
    UMBB_CASTER_CLOSED = 1,         /* casts; in a closed part, winding outward */
    UMBB_CASTER_CLOSED_FLIPPED = 2, /* casts; in a closed part, winding inward */
};

struct umbb_cuts;

struct umbb_casters {
    const double (*corners)[3][3]; /* [count] triangle, corner, x y z in voxel space */
    const uint8_t *kinds;          /* [count] enum umbb_caster */
    size_t count;                  /* at most UINT32_MAX - 1 */
    int32_t size;                  /* voxels a side of the frustum, a power of two */
    int closed_rule;               /* 0: every caster counts as open */
    /* 1 if some parts are closed only because the caller says so. Their front faces may have no
     * back faces behind them, so no square is proven. */
    int open_on_word;
    /* Constants of z = depth_scale / q + depth_offset, for rays that start in one point. A corner's
     * third coordinate is then q, the reciprocal of its distance (depth_perspective.h). Without
     * such rays depth_scale is 0, and the third coordinate is z. */
    double depth_scale, depth_offset;
    const uint8_t *marks;         /* [count] of umbb_front_marks_make; NULL: no square is proven */
    const struct umbb_cuts *cuts; /* cut_out.h: open casters with holes; NULL: there are none */
};

/* Layers of fragments. Each texel of a layer holds the nearest face of one kind. */
enum umbb_layer {
    UMBB_LAYER_OPEN = 0,  /* nearest face of open casters */
    UMBB_LAYER_FRONT = 1, /* nearest front face of closed parts */
    UMBB_LAYER_BACK = 2,  /* nearest back face of closed parts */
    UMBB_LAYER_COUNT = 3,
};

/* Working memory of umbb_prove_squares for one square. */
struct umbb_proof {
    int32_t cover;      /* least bound of lit by a front face that covers the whole square */
    int32_t back_least; /* least lit of back faces */
    int32_t back_most;  /* greatest lit of back faces, or more */
    int32_t corners[4][UMBB_LAYER_COUNT]; /* nearest fragments of the four corner texels */
};

struct umbb_tile {
    int32_t x0, y0; /* first texel */
    uint32_t log2_size;
    int32_t size; /* texels a side */
    int32_t *lit; /* [size * size] by 8x8 blocks */
    int32_t *end; /* [size * size] by 8x8 blocks; the same array as `lit` without the closed rule */
    int32_t *max_lit[UMB_LEVEL_MAX + 1]; /* [level]: (size >> level)^2, row by row; levels 3.. */
    int32_t *min_end[UMB_LEVEL_MAX + 1];
    /* [(size >> UMBB_SQUARE_LOG2)^2] 1 for a square known from bounds, row by row. Its texels and
     * levels below UMBB_SQUARE_LOG2 were never written. NULL without the closed rule. */
    uint8_t *proven;
    struct umbb_proof *proofs; /* [(size >> UMBB_SQUARE_LOG2)^2] of umbb_prove_squares */
    int32_t background;        /* voxels a side of the frustum; set by begin */
    int32_t *memory;
};

/* Bytes that a tile takes, saturating at SIZE_MAX. */
size_t umbb_tile_bytes(uint32_t log2_size, int closed_rule);

/* Allocates the arrays. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_tile_init(struct umbb_tile *tile, uint32_t log2_size,
                                           int closed_rule, struct umb_error *error);
void umbb_tile_finish(struct umbb_tile *tile);

/* Returns the index of texel (x, y), relative to x0, y0, in the tile's lit and end. */
static inline size_t umbb_tile_index(const struct umbb_tile *tile, int32_t x, int32_t y)
{
    const size_t block = (size_t)(y >> 3) * (size_t)(tile->size >> 3) + (size_t)(x >> 3);
    return block * 64 + (size_t)((y & 7) * 8 + (x & 7));
}

/* Marks n x n blocks of 8x8 texels, from block (bx, by) on, as background in level 3. */
void umbb_tile_clear(struct umbb_tile *tile, int32_t bx, int32_t by, int32_t n, int32_t background);

/* Fills level 3 of the pyramid for n x n blocks, from block (bx, by) on, from their texels. */
void umbb_tile_reduce(struct umbb_tile *tile, int32_t bx, int32_t by, int32_t n);

/* Fills the pyramid above level 3, except where a square is proven. */
void umbb_tile_pyramid(struct umbb_tile *tile);

/* One step of a pyramid: reduces 2n x 2n squares of greatest lit and least end to n x n. */
void umbb_pyramid_step(const int32_t *lit, const int32_t *end, size_t n, int32_t *max_lit,
                       int32_t *min_end);

/* Texels a side of the blocks of a tile. */
static inline int32_t umbb_tile_block(const struct umbb_tile *tile)
{
    return tile->size < UMBB_BLOCK ? tile->size : UMBB_BLOCK;
}

/* Class of a caster under the casters' rule: enum umbb_caster. */
static inline uint8_t umbb_caster_kind(const struct umbb_casters *casters, size_t caster)
{
    return casters->closed_rule ? casters->kinds[caster] : UMBB_CASTER_OPEN;
}

/* Returns the layer of a caster's fragment. kind: result of umbb_caster_kind. front: 1 if the
 * caster, by its winding, faces the light in the fragment's row. */
static inline enum umbb_layer umbb_layer_of(uint8_t kind, int front)
{
    if (kind == UMBB_CASTER_OPEN) {
        return UMBB_LAYER_OPEN;
    }
    return front != (kind == UMBB_CASTER_CLOSED_FLIPPED) ? UMBB_LAYER_FRONT : UMBB_LAYER_BACK;
}

/*
 * Decides lit and end of a texel from its three nearest fragments.
 *
 * In: nearest: `lit` of the nearest fragment in each layer (enum umbb_layer), or the background.
 * From the nearest front face of a closed part to the nearest back face the column is inside that
 * part: it was entered there, and no closed part was left before. If a face lies in front of the
 * nearest front face, no inside is known, and end = lit. The same holds if nothing lies behind it:
 * only the caller's word makes such a part a solid.
 * Source: Sintorn et al. 2014, section 6.1, with the nearest back face instead of their counter
 * (always valid; the end may come earlier where solids overlap).
 */
static inline void umbb_texel_decide(const int32_t nearest[3], int32_t background, int32_t *lit,
                                     int32_t *end)
{
    const int32_t open = nearest[0], front = nearest[1], back = nearest[2];
    int32_t first = back < open ? back : open;
    first = front < first ? front : first;
    *lit = first;
    *end = front == first && back < background ? back : first;
}

/* Decides and writes texel number `at` of a tile. In: nearest: [enum umbb_layer]. */
static inline void umbb_tile_put(struct umbb_tile *tile, size_t at, const int32_t nearest[3])
{
    int32_t end;
    umbb_texel_decide(nearest, tile->background, &tile->lit[at], &end);
    tile->end[at] = end; /* lit's array without the closed rule; end equals lit then */
}

#endif
