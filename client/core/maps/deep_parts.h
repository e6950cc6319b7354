/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_DEEP_PARTS_H
#define UMBRAGE_CORE_MAPS_DEEP_PARTS_H
/*
 * Deep shadow maps: a texel's light as a falling staircase of depth.
 *
 * A list has a node for each depth at which light is absorbed, nearest first, with the
 * transmittance left behind that depth. A receiver at depth t gets the light left behind the last
 * node nearer than t; nodes at t itself do not count, as for shadow maps.
 *
 * Transmittance is a whole number of units of 2^-30, so that sums over a window are exact in any
 * order, and all ways of umb_map_deep_way give the same bits.
 *
 * Links (Fuerst, Mattausch, Scherzer 2013): each node stores the number of the node nearest in
 * depth in the list of the texel to the right, and in that of the texel above. A wide filter
 * searches its first list only. From the node found it follows the link to the next texel and walks
 * a step or two there. The result equals that of a search.
 *
 * Streams: the light at depth t is 1 minus the drops of all nodes of a texel nearer than t, where a
 * node's drop is the light before the node minus the light behind it. The lists of a window's row
 * are contiguous, so the row's sum is one pass over all nodes, without a branch and whatever the
 * list a node is in. That is faster than any search if lists are short.
 */
#include "maps/map_parts.h"

#define UMB__DEEP_ONE ((uint32_t)1 << 30) /* Number of units of transmittance 1 */

struct umb__deep_node {
    float depth;
    uint32_t left; /* Transmittance behind the node; in a stream the drop at the node */
};

/* A node with its links behind it, in the same cache line. */
struct umb__deep_linked {
    struct umb__deep_node node;
    uint32_t right, upper; /* Numbers of the linked nodes within their lists */
};

struct umb__deep {
    struct umb_map_deep_settings settings;
    uint32_t width, height;
    uint64_t *first;           /* [width * height + 1] Number of each texel's first node */
    uint8_t *nodes;            /* [first[width * height]] struct umb__deep_node or _linked */
    size_t stride;             /* Bytes of each node */
    enum umb_map_deep_way way; /* Way of searching, chosen: not AUTO */
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

/* Return the number of a list's nodes nearer than depth: by bisection, or by a walk from a
 * guess. */
uint32_t umb__deep_search(const struct umb__deep_list *list, double depth);
uint32_t umb__deep_walk(const struct umb__deep_list *list, uint32_t guess, double depth);

/* Checks fragments. Fails: E_ARGUMENT (`first` that falls, 2^32 - 1 fragments or more in a texel, a
 * depth or alpha outside 0..1). */
UMB_CHECKED enum umb_status umb__fragments_check(const struct umb_map_fragments *in, size_t texels,
                                                 struct umb_error *error);

/* Fills error with E_NO_MEMORY for `count` fragments, and returns that status. */
enum umb_status umb__fragments_no_memory(uint64_t count, struct umb_error *error);

/* Writes the list of one texel and returns its length. In: sorted: the texel's fragments, sorted by
 * depth, then by alpha, so that fragments in any order give equal products. used: number of
 * elements of the lists before this one. */
typedef size_t umb__list_writer(void *user, const struct umb_map_fragment *sorted, size_t count,
                                uint64_t used);

/* Writes the lists of all texels, one after another. Out: first: [texels + 1] number of elements
 * before each list. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__lists_write(const struct umb_map_fragments *in, size_t texels,
                                             const struct umb_alloc *alloc, umb__list_writer *write,
                                             void *user, uint64_t *first, struct umb_error *error);

/*
 * Makes the channels of a map of MOMENTS or ABSORBANCE (deep_moments.c).
 *
 * Fails: as umb__fragments_check; E_NO_MEMORY; as umb__channels_init.
 */
UMB_CHECKED enum umb_status umb__translucent_init(struct umb__channels *channels,
                                                  const struct umb_map *map,
                                                  const struct umb_map_fragments *in,
                                                  struct umb_error *error);

void umb__deep_destroy(struct umb__deep *deep, const struct umb_alloc *alloc);

/* Makes the lists of all texels. Fails: as umb__fragments_check; E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__deep_create(const struct umb_map_frustum *frustum,
                                             const struct umb_map_fragments *fragments,
                                             const struct umb_map_deep_settings *settings,
                                             const struct umb_alloc *alloc, struct umb__deep **out,
                                             struct umb_error *error);

#endif
