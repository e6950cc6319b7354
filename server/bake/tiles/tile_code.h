/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_CODE_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_CODE_H
/*
 * A tile's result as bytes, for later bakes and other machines.
 *
 * Little-endian, no padding:
 *
 *     int32  max_lit, min_end
 *     uint32 runs
 *     uint32 bricks
 *     uint32 nodes, children      for each level from 4 to the tile's
 *     uint32 z_end, ref           for each run
 *     then for each level from the tile's down to 4:
 *       uint16 mask               for each node
 *       uint32 child              for each mixed child of each node
 *     uint64 slice[8]             for each brick
 *     and where first occluders are kept:
 *       uint32 squares            of 64 x 64 texels that have any
 *       then for each, in ascending order:
 *         uint32 number           in the tile, row by row
 *         uint32 words[words[0]]  format/occluder_depth_build.h
 *
 * A ref is the number of a node of the tile's level, or UMB__REF_LIT or UMB__REF_SHADOWED. Nodes
 * are numbered in the order in which a reader meets them: the runs' nodes first, then their
 * children, and so on down. So equal results give equal bytes, whatever the pool's own numbers
 * were. A reader checks that each number is known or the next new one. Then all numbers are in
 * range, and the runs lead to every node. Words of first occluders do not depend on the square's
 * place or frustum, nor on squares added before.
 */
#include "bake/build/tile_loop.h"
#include "format/occluder_depth_build.h"

/* Parameters of both directions: the frustum, and the tile's place in it. */
struct umbb_tile_shape {
    uint32_t log2_size; /* size of the frustum */
    uint32_t tile_log2; /* UMB_LEVEL_BRICK + 1 .. log2_size; at least 6 with occluder_depth */
    /* Occluder depth map of the frustum: encoding reads the tile's first occluders from the map,
     * decoding adds them. NULL: there is no map. Borrowed. */
    struct umb__occluder_depth *occluder_depth;
    uint32_t occluder_depth_x, occluder_depth_y; /* the tile's first square there */
};

/* Returns the place of tile `number` of a frustum. */
static inline struct umbb_tile_place umbb_tile_place_of(const struct umbb_tile_shape *shape,
                                                        uint32_t number)
{
    const uint32_t across_log2 = shape->log2_size - shape->tile_log2;
    return (struct umbb_tile_place){
        .x0 = (int32_t)((number & ((1U << across_log2) - 1U)) << shape->tile_log2),
        .y0 = (int32_t)(number >> across_log2 << shape->tile_log2),
        .number = number,
    };
}

/*
 * Writes a result.
 *
 * In:    nodes: the column's nodes and runs; max_bytes: limit of all allocations.
 * Out:   bytes: malloced; size.
 * Fails: E_LIMIT (max_bytes), E_NO_MEMORY.
 * Cost:  linear in the result; 4 bytes of address space a node of the pool, touched where used.
 */
UMB_CHECKED enum umb_status umbb_tile_encode(const struct umbb_tile_shape *shape,
                                             const struct umbb_tile_nodes *nodes,
                                             const struct umbb_tile_result *result, uint8_t **bytes,
                                             size_t *size, struct umb_error *error);

/* A result that was read and checked. Start zeroed, with a loose pool (umb__pool_init_loose). The
 * struct can be used again and again. */
struct umbb_tile_parsed {
    struct umb__pool pool; /* the result's nodes */
    struct umbb_tile_result result;
    uint32_t *top;       /* refs of the nodes of the tile's level in the pool, malloced */
    const uint8_t *runs; /* the column's runs, in the bytes that were read */
    uint32_t run_count;
    uint32_t *occluder_depth; /* words of the part of first occluders, malloced; NULL: none */
};

/* Frees what a result holds, for the next; finish also frees the pool. */
void umbb_tile_parsed_clear(struct umbb_tile_parsed *parsed);
void umbb_tile_parsed_finish(struct umbb_tile_parsed *parsed);

/*
 * Reads a result.
 *
 * In:    bytes: result of umbb_tile_encode; borrowed until the result is joined.
 * Out:   parsed: cleared first.
 * Fails: E_CORRUPT, E_NO_MEMORY, E_LIMIT (of the loose pool).
 * Trust: safe on hostile bytes.
 * Threads: several results may be read at once. Cost: linear in the bytes.
 */
UMB_CHECKED enum umb_status umbb_tile_parse(const struct umbb_tile_shape *shape,
                                            const uint8_t *bytes, size_t size,
                                            struct umbb_tile_parsed *parsed,
                                            struct umb_error *error);

/*
 * Adds a result that was read to a pool.
 *
 * In:    shape: its occluder depth map gets the tile's first occluders. numbers: working memory.
 *        nodes: max_bytes is not read.
 * Out:   result: its column's runs are appended to nodes->runs.
 * Fails: as umb__pool_merge and umb__occluder_depth_add_square.
 */
UMB_CHECKED enum umb_status
umbb_tile_join(const struct umbb_tile_shape *shape, const struct umbb_tile_parsed *parsed,
               const struct umbb_tile_nodes *nodes, struct umb__pool_numbers *numbers,
               struct umbb_tile_result *result, struct umb_error *error);

/* Reads a result and adds it to a pool: does both of the above. Fails: E_CORRUPT (pool, runs and
 * occluder depth map are unchanged), and as both. */
UMB_CHECKED enum umb_status umbb_tile_decode(const struct umbb_tile_shape *shape,
                                             const uint8_t *bytes, size_t size,
                                             const struct umbb_tile_nodes *nodes,
                                             struct umbb_tile_result *result,
                                             struct umb_error *error);

#endif
