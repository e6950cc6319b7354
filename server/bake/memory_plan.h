/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_MEMORY_PLAN_H
#define UMBRAGE_SERVER_BAKE_MEMORY_PLAN_H
/*
 * Division of --memory among triangles, depth and tiles; the octree may take the rest. The tile may
 * become smaller than requested, which changes no bit of the result.
 *
 * Three phases count: the search for parts, the bake, and the comparison with rays. Triangles take
 * the most memory in the first and the last. During the bake, lists of triangles may use the
 * difference.
 *
 * The space in an asset's head is divided before the work, too. Readers accept canonical blocks of
 * up to 64 MiB (docs/reference/umb-format.md); without the division a bake would fail only at its
 * end.
 */
#include <stddef.h>
#include <stdint.h>
#include "format/content.h"

struct umbb_memory_input {
    uint64_t memory_bytes;
    uint64_t scene_bytes; /* the importer's buffer */
    size_t triangles;
    uint32_t log2_size;
    uint32_t tile_log2; /* the largest wanted tile */
    unsigned threads;
    int closed_rule;       /* Closed or static rule: tiles have an `end` of their own */
    uint32_t ruled_frusta; /* frusta under the static rule; 0: off */
    int copies;            /* 1: the world corners stay beside those in voxel space */
    int merging;           /* 1: every tile is found, none is drawn */
    int traced;            /* 1: depth by rays, with a bounding volume hierarchy */
    int projected; /* 1: spot or point lights, triangles are kept beside their projections */
};

struct umbb_memory_plan {
    uint32_t tile_log2;
    size_t octree_max_bytes;
    size_t shared_max_bytes;    /* see umbb_bake_options */
    size_t projected_max_bytes; /* limit of projected triangles */
    uint64_t check_max_bytes;   /* limit of the finished asset during the comparison with rays */
    uint64_t fixed_bytes;       /* everything but the octree */
};

/* Divides the memory. Fails: E_LIMIT, naming the need of the smallest bake. */
UMB_CHECKED enum umb_status umbb_memory_divide(const struct umbb_memory_input *input,
                                               struct umbb_memory_plan *plan,
                                               struct umb_error *error);

/*
 * Computes the limit in bytes of the occluder depth map: 48 MiB, or the space that everything else
 * leaves in the head.
 *
 * In:    content: counts of lights and frusta and both texts are read; receiver_mask_cells: only
 *        whether it is NULL. The curve counts in full. translucent: 1 if maps of translucent
 *        casters follow.
 * Fails: E_BAD_SCENE (so many lights and frusta do not fit even without an occluder depth map).
 */
UMB_CHECKED enum umb_status umbb_head_occluder_depth_bytes(const struct umb__content *content,
                                                           int translucent, size_t *bytes,
                                                           struct umb_error *error);

#endif
