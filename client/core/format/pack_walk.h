/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_WALK_H
#define UMBRAGE_CORE_FORMAT_PACK_WALK_H
/*
 * The way through an octree on which pages are filled: depth first from the roots of a band, which
 * pack_order.h explains. Pages go into an order, or are only measured, for a sample of them.
 */
#include <stdbool.h>
#include "format/pack_order.h"
#include "format/pack_survey.h"

/* A growing list of nodes. */
struct umb__node_list {
    struct umb__node_ref *nodes;
    size_t count, capacity;
};

struct umb__pack_walk {
    const struct umb_octree *octree;
    const struct umb__pack_survey *survey;
    struct umb__pack_order *order;
    struct umb_error *error;
    uint64_t *states[UMB_LEVEL_MAX + 1]; /* what became of each node, two bits */
    uint32_t next[UMB_LEVEL_MAX + 1];    /* ordinal */
    size_t page_bytes;                   /* estimate for the open page */
    uint64_t closed_bytes;               /* estimate of pages closed since this was 0 */
    struct umb__node_list waiting;       /* roots of the next band */
    uint32_t band_low;
    bool alone;         /* the band's pages refer to no other */
    bool numbers_roots; /* ordinals are noted of roots only: no page refers to another node */
    bool sample;        /* pages are only measured: the order gets none, and its ordinals stay */
};

/* Makes the states of the levels [low, high]. False: out of memory. */
bool umb__pack_walk_begin(struct umb__pack_walk *walk, uint32_t low, uint32_t high);
void umb__pack_walk_finish(struct umb__pack_walk *walk);

/* Makes room for the first ordinals of so many pages. False: out of memory. */
bool umb__pack_grow_pages(struct umb__pack_order *order, size_t needed);

UMB_CHECKED enum umb_status umb__node_list_add(const struct umb__pack_walk *walk,
                                               struct umb__node_list *list,
                                               struct umb__node_ref node);

/* Visits a root of the band, unless it stands below another one, or is the root of two frusta.
 * Fails: E_NO_MEMORY, E_TOO_LARGE (too many pages, or copies). */
UMB_CHECKED enum umb_status umb__pack_visit_root(struct umb__pack_walk *walk,
                                                 struct umb__node_ref root);

/* Ends the open page, if it holds anything. Fails: as umb__pack_visit_root. */
UMB_CHECKED enum umb_status umb__pack_close_page(struct umb__pack_walk *walk);

/* Takes back what the levels below `end` were given since the order had so many pages. */
void umb__pack_rewind(struct umb__pack_walk *walk, uint32_t page_count, uint32_t end);

#endif
