/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_NODE_PLACES_H
#define UMBRAGE_CORE_FORMAT_NODE_PLACES_H
/* Places of wide nodes, one after the other, in an array that begins at a cache line. */
#include <stdint.h>

#define UMB__LINE_WORDS 8U  /* Words of a cache line */
#define UMB__NODE_GAPS  16U /* Gaps that are remembered */

/* A gap: room that placing nodes left within a cache line. */
struct umb__node_gap {
    uint64_t word;
    uint64_t words;
};

/* Placement of the nodes of one level, one after the other. */
struct umb__node_places {
    uint64_t end;    /* First word behind all nodes so far */
    uint32_t oldest; /* Index of the gap to be replaced next */
    struct umb__node_gap gaps[UMB__NODE_GAPS];
};

/*
 * Returns the first word of a node of `length` words. A node that fits a cache line lies within
 * one, if possible in a gap that longer nodes left. A longer node begins at a line: its masks and
 * first numbers then cost one cache miss, and its other numbers one more.
 */
static inline uint64_t umb__place_node(struct umb__node_places *places, uint64_t length)
{
    const uint64_t used = places->end % UMB__LINE_WORDS;
    uint64_t begin = places->end;
    for (uint32_t i = 0; i < UMB__NODE_GAPS && length <= UMB__LINE_WORDS; i++) {
        struct umb__node_gap *gap = &places->gaps[i];
        if (gap->words >= length) {
            gap->word += length;
            gap->words -= length;
            return gap->word - length;
        }
    }
    if (used != 0 && used + length > UMB__LINE_WORDS) {
        begin += UMB__LINE_WORDS - used;
        places->gaps[places->oldest] = (struct umb__node_gap){places->end, UMB__LINE_WORDS - used};
        places->oldest = (places->oldest + 1) % UMB__NODE_GAPS;
    }
    places->end = begin + length;
    return begin;
}

#endif
