/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_ORACLE_READER_H
#define UMBRAGE_TESTS_ORACLE_READER_H
/*
 * A second reader of packed (.umb) and mapped (.umbm) files, slow and obvious, written from
 * docs/reference/umb-format.md alone: it shares no line and no header with the real one, so that a
 * misunderstanding on either side shows as a difference.
 *
 * Life: oracle_open checks everything the page states and refuses the file with a sentence, or
 * leaves an oracle whose voxels can be asked one by one; oracle_close frees it. The file's bytes
 * are borrowed until then.
 *
 * Not checked, because the page leaves it to writers: the order of nodes and where pages end
 * (section 5), the size of the top grids (section 6). A mapped file cannot prove its id, as it
 * holds no page hashes: compare it with the packed file's.
 *
 * Threads: an open oracle is read-only. Trust: safe on hostile bytes. Cost: memory of about ten
 * times the file; opening sorts every level.
 */
#include <stddef.h>
#include <stdint.h>

enum {
    ORACLE_ERROR_SIZE = 256,
    ORACLE_LEVELS = 21, /* levels 0..20; nodes have 3..20 */
};

enum oracle_form {
    ORACLE_PACKED = 0,
    ORACLE_MAPPED = 1,
};

struct oracle_light {
    uint32_t kind; /* 0 directional, 1 spot, 2 point, 3 rectangle, 4 disc */
    uint32_t first_frustum, frustum_count;
    double direction[3], position[3];
    char name[64]; /* NUL-terminated */
};

struct oracle_frustum {
    uint32_t n; /* 2^n voxels a side */
    uint32_t light;
    uint32_t flags;      /* bit 0: baked under the closed rule */
    double m[16];        /* world minus origin to voxels, row major */
    uint32_t root_state; /* 0 shadowed, 1 lit, 2 mixed */
    uint32_t root_page;  /* if mixed */
    uint32_t root_position;
    uint32_t root;         /* packed: number among all nodes of level n */
    uint32_t grid_log2;    /* mapped */
    uint64_t grid_first;   /* mapped */
    uint32_t column_level; /* these three: mapped */
    uint64_t column_first, piece_first;
    uint32_t map_level; /* of translucent casters: 2^map_level texels a side, or 0 */
    uint64_t map_first; /* number of the map's first square */
};

/* A node of level 4 and up of a packed file; child[c] is a number among all of the level below. */
struct oracle_node {
    uint16_t mask;
    uint32_t child[8]; /* 0 where not mixed */
};

struct oracle_brick {
    uint64_t slice[8];
};

struct oracle_section {
    const uint8_t *data;
    uint64_t size;
};

struct oracle {
    enum oracle_form form;
    const uint8_t *bytes;
    size_t size;
    uint64_t head_size, block_size;      /* block: the canonical block, from byte 128 */
    uint32_t directory_count, info_size; /* directory: blocks (packed) or sections (mapped) */
    uint32_t page_count;                 /* packed */
    uint64_t blocks_at;                  /* packed: the second block, or 0 */
    uint64_t first_block;                /* packed: bytes of the first block */
    uint8_t id[32];
    double origin[3], box_min[3], box_max[3];
    struct oracle_light *lights;
    uint32_t light_count;
    struct oracle_frustum *frusta;
    uint32_t frustum_count;
    struct oracle_section frnt, trns, receiver_mask; /* the canonical block's, or none */
    uint64_t *map_squares;                           /* where squares begin in trns */
    uint64_t unique[ORACLE_LEVELS];                  /* as CNTS states them */

    struct oracle_node *nodes[ORACLE_LEVELS]; /* packed, levels 4..20 */
    struct oracle_brick *bricks;              /* packed */
    uint64_t counts[ORACLE_LEVELS];           /* packed: nodes found */

    struct oracle_section tops, lvls, grid, node, brik, cols, piec; /* mapped */
};

/*
 * Opens a file held in memory.
 * In: bytes: the whole file, borrowed until oracle_close. Out: oracle: to close, also after
 * failure. Fails: 0 with a sentence in `error`; 1 if the file is all that the page says.
 */
int oracle_open(struct oracle *oracle, const uint8_t *bytes, size_t size,
                char error[ORACLE_ERROR_SIZE]);

/* Returns 1 if the cell of a voxel is marked in NEAR, 0 if not; -1 if there is no such entry or
 * voxel. */
int oracle_receiver_mask(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y,
                         uint32_t z);

/*
 * 1 if voxel (x, y, z) is lit, 0 if shadowed, -1 outside the frustum or if there is no such
 * frustum.
 */
int oracle_voxel(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z);

/* Reads `lit` of a texel from the occluder depth map: -1 if the map leaves the answer to the tree,
 * -2 if the map is malformed there. */
int64_t oracle_occluder_depth(const struct oracle *oracle, uint32_t frustum, uint32_t x,
                              uint32_t y);

/* Light that translucent casters leave voxel (x, y, z), inside the frustum, in units of 2^-21. */
int64_t oracle_transmittance(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y,
                             uint32_t z);

void oracle_close(struct oracle *oracle);

#endif
