/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_INTERN_H
#define UMBRAGE_CORE_FORMAT_INTERN_H
/*
 * Building an octree bottom-up with equal nodes merged ("hash-consing"): intern a node, get the
 * number of the one node that equals it. Whole keys are compared, hashes only find candidates.
 *
 * Life: umb_intern_init, umb_intern_brick and umb_intern_node bottom-up, umb_intern_take.
 * Threads: one builder, one thread.
 * Cost: amortised O(1) a node; 64 bytes a brick, about 20 to 40 a node, and the tables.
 */
#include "format/octree.h"

struct umb_intern_table {
    uint32_t *slots; /* number + 1, or 0 */
    uint32_t *tags;  /* upper hash bits of each slot */
    size_t size;     /* a power of two, or 0 */
};

struct umb_intern {
    struct umb_octree octree;
    struct umb_intern_table tables[UMB_LEVEL_MAX + 1];
    size_t brick_capacity;
    size_t mask_capacity[UMB_LEVEL_MAX + 1];
    size_t first_capacity[UMB_LEVEL_MAX + 1];
    size_t child_capacity[UMB_LEVEL_MAX + 1];
};

/* A child of a node to be interned, or the result of interning. */
struct umb_node_value {
    enum umb_node_state state;
    uint32_t index; /* if mixed */
};

UMB_API void umb_intern_init(struct umb_intern *intern, const struct umb_alloc *alloc);
UMB_API void umb_intern_finish(struct umb_intern *intern);

/*
 * Interns a brick; all-zero and all-one bricks become uniform values.
 * Fails: E_NO_MEMORY, E_TOO_LARGE (2^32 - 2 bricks).
 */
UMB_API UMB_CHECKED enum umb_status umb_intern_brick(struct umb_intern *intern,
                                                     const uint64_t brick[8],
                                                     struct umb_node_value *value,
                                                     struct umb_error *error);

/* Interns a node of level 4 and up; eight equal uniform children become their state. */
UMB_API UMB_CHECKED enum umb_status umb_intern_node(struct umb_intern *intern, uint32_t level,
                                                    const struct umb_node_value children[8],
                                                    struct umb_node_value *value,
                                                    struct umb_error *error);

/* Hands the octree over (roots still to be set) and empties the builder. */
UMB_API void umb_intern_take(struct umb_intern *intern, struct umb_octree *octree);

#endif
