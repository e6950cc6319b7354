/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_MEMORY_PLAN_H
#define UMBRAGE_SERVER_BAKE_MEMORY_PLAN_H
/*
 * How --memory is divided: triangles, depth, tiles; what is left may be taken by the octree.
 * The tile may come out smaller than asked for; that changes no bit of the result.
 *
 * Three moments count: the search for parts, the bake, and the comparison with rays. Triangles take
 * the most in the first and the last; in the bake what they take less may go to lists of triangles.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

struct umbb_memory_input {
    uint64_t memory_bytes;
    uint64_t scene_bytes; /* the importer's buffer */
    size_t triangles;
    uint32_t log2_size;
    uint32_t tile_log2; /* the largest wanted */
    unsigned threads;
    int closed_rule;       /* or ruled: tiles with an `end` of their own */
    uint32_t ruled_frusta; /* by the static rule; 0: not */
    int merging;           /* every tile is found: none is drawn */
    int traced;            /* depth by rays: a bounding volume hierarchy */
    int projected;         /* spot or point lights: triangles stand beside their projections */
};

struct umbb_memory_plan {
    uint32_t tile_log2;
    size_t octree_max_bytes;
    size_t shared_max_bytes;    /* see umbb_bake_options */
    size_t projected_max_bytes; /* for projected triangles */
    uint64_t check_max_bytes;   /* for the finished asset while it is compared with rays */
    uint64_t fixed_bytes;       /* everything but the octree */
};

/* Divides. Fails: E_LIMIT, naming what the smallest bake would need. */
UMB_CHECKED enum umb_status umbb_memory_divide(const struct umbb_memory_input *input,
                                               struct umbb_memory_plan *plan,
                                               struct umb_error *error);

#endif
