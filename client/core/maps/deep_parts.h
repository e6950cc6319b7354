/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_DEEP_PARTS_H
#define UMBRAGE_CORE_MAPS_DEEP_PARTS_H
/*
 * Deep shadow maps: a texel's light as a falling staircase of depth.
 *
 * A list holds the depths at which something takes light, nearest first, each once, with the
 * transmittance left behind it. A receiver at depth t gets what is left behind the last node
 * nearer than t; nodes at t itself do not count, as for shadow maps.
 *
 * What is left is a whole number of 2^-30, so that sums over a window are exact in any order: the
 * three ways of umb_map_deep_way give the same bits.
 *
 * Links (Bavoil et al., seed 003): each node knows the node nearest in depth in the list of the
 * texel to the right and above. A wide filter searches its first list only, follows the link of
 * the node it found to the next texel, and walks a step or two there. The place it ends at is the
 * one a search finds.
 *
 * Streams: what a texel gets is 1 less the drops (what is left before a node less what is left
 * behind it) of all its nodes nearer than t. The lists of a row of a window lie one after another:
 * its sum is one pass over them that knows nothing of where lists begin, without a branch. Cheaper
 * than any search as long as lists are short.
 */
#include "maps/map_parts.h"

#define UMB__DEEP_ONE ((uint32_t)1 << 30) /* transmittance 1 */

struct umb__deep_node {
    float depth;
    uint32_t left; /* transmittance behind it; in a stream the drop at it */
};

/* With links a node is followed by them, in the same cache line. */
struct umb__deep_linked {
    struct umb__deep_node node;
    uint32_t right, upper; /* node numbers within that list */
};

struct umb__deep {
    struct umb_map_deep_settings settings;
    uint32_t width, height;
    uint64_t *first;           /* [width * height + 1] */
    uint8_t *nodes;            /* first[width * height] of umb__deep_node, or _linked */
    size_t stride;             /* bytes of one of them */
    enum umb_map_deep_way way; /* that was chosen */
    uint64_t bytes;
};

/* A list of nodes, `stride` bytes apart. */
struct umb__deep_list {
    const uint8_t *nodes;
    size_t stride;
    uint32_t count;
};

static inline const struct umb__deep_node *umb__deep_at(const struct umb__deep_list *list,
                                                        uint32_t i)
{
    return (const struct umb__deep_node *)(const void *)(list->nodes + i * list->stride);
}

/* Number of nodes of a list nearer than depth: by halving, and by walking from a guess. */
uint32_t umb__deep_search(const struct umb__deep_list *list, double depth);
uint32_t umb__deep_walk(const struct umb__deep_list *list, uint32_t guess, double depth);

/* Fails: E_ARGUMENT (first not rising, 2^32 - 1 fragments in a texel or more, a depth or alpha not
 * 0..1). */
UMB_CHECKED enum umb_status umb__fragments_check(const struct umb_map_fragments *in, size_t texels,
                                                 struct umb_error *error);

/* Fragments of the texel that has the most: room for umb__fragments_sort. */
uint64_t umb__fragments_longest(const struct umb_map_fragments *in, size_t texels);

/* Copies those of one texel by depth, then by alpha, and returns their number. Equal lists give
 * equal products whatever order they came in. */
size_t umb__fragments_sort(const struct umb_map_fragments *in, size_t texel,
                           struct umb_map_fragment *sorted);

/*
 * The channels of a map of MOMENTS or ABSORBANCE (deep_moments.c).
 *
 * Fails: as umb__fragments_check; E_NO_MEMORY; as umb__channels_init.
 */
UMB_CHECKED enum umb_status umb__translucent_init(struct umb__channels *channels,
                                                  const struct umb_map *map,
                                                  const struct umb_map_fragments *in,
                                                  struct umb_error *error);

void umb__deep_destroy(struct umb__deep *deep, const struct umb_alloc *alloc);

/*
 * Sorts, multiplies, ends and links all lists.
 *
 * Fails: E_ARGUMENT (first not rising, 2^32 - 1 fragments in a texel or more, a depth or alpha not
 *        0..1), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__deep_create(const struct umb_map_frustum *frustum,
                                             const struct umb_map_fragments *fragments,
                                             const struct umb_map_deep_settings *settings,
                                             const struct umb_alloc *alloc, struct umb__deep **out,
                                             struct umb_error *error);

#endif
