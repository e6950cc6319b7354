/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_WALK_H
#define UMBRAGE_CORE_FORMAT_PACK_WALK_H
/*
 * The walk through an octree that fills pages: depth first from the roots of a band, as
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
    const struct umb__octree *octree;
    const struct umb__pack_survey *survey;
    struct umb__pack_order *order;
    struct umb_error *error;
    uint64_t *states[UMB_LEVEL_MAX + 1]; /* State of each node, two bits */
    uint32_t next[UMB_LEVEL_MAX + 1];    /* ordinal */
    size_t page_bytes;                   /* estimate for the open page */
    uint64_t closed_bytes;               /* estimate of pages closed since this was 0 */
    struct umb__node_list waiting;       /* roots of the next band */
    uint32_t band_low;
    bool alone;         /* The band's pages are independent */
    bool numbers_roots; /* Only roots get ordinals: no page refers to another node */
    bool sample;        /* Pages are only measured: the order gets no page, and keeps its
                           ordinals */
};

/* Allocates the states of the levels [low, high]. False: out of memory. */
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

/* Undoes the visits of levels below `end` since the order had so many pages. */
void umb__pack_rewind(struct umb__pack_walk *walk, uint32_t page_count, uint32_t end);

#endif
