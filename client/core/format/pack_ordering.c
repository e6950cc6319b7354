/* SPDX-License-Identifier: Apache-2.0 */
/* The bands of an order and their roots; pack_walk.c has the walk below the roots, pack_copies.c
 * the decision about copies. */
#include "format/pack_ordering.h"

#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"
#include "format/pack_walk.h"

/* Lowest level of each band, from the top. */
static const uint32_t band_lows[] = {13, UMB__LOWEST_END, UMB_LEVEL_BRICK};
#define BAND_COUNT (sizeof band_lows / sizeof band_lows[0])

struct umb__pack_ordering {
    struct umb__pack_survey survey;
    struct umb__pack_walk walk;
    struct umb__node_list roots; /* Roots of the current band; in the end of the lowest one */
    size_t next_root;            /* Index of the next root to visit */
    bool complete;               /* True if all nodes are ordered */
    const struct umb_alloc *alloc;
};

static enum umb_status allocate(struct umb__pack_ordering *o)
{
    struct umb__pack_walk *t = &o->walk;
    struct umb__pack_order *order = t->order;
    bool complete =
        umb__pack_grow_pages(order, 1) && umb__pack_walk_begin(t, UMB_LEVEL_BRICK, UMB_LEVEL_MAX);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        const size_t count = umb__octree_level_count(t->octree, level);
        const size_t reached = (size_t)o->survey.counts[level]; /* With copies, arrays grow */
        order->ordinals[level] =
            umb__alloc_large(order->alloc, count, sizeof *order->ordinals[level]);
        order->nodes[level] = umb__alloc_large(order->alloc, reached, sizeof *order->nodes[level]);
        order->node_capacity[level] = reached;
        complete = order->ordinals[level] && order->nodes[level];
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        order->begins[level][0] = 0;
    }
    return complete ? UMB_OK : umb__pack_no_memory(t->error);
}

/* Visits roots until all are visited or the order has most_pages pages. In and out: next: index of
 * the next root to visit. */
static enum umb_status visit_roots(struct umb__pack_walk *t, const struct umb__node_list *roots,
                                   size_t *next, uint32_t most_pages)
{
    while (*next < roots->count && t->order->page_count < most_pages) {
        UMB__TRY(umb__pack_visit_root(t, roots->nodes[(*next)++]));
    }
    return *next == roots->count ? umb__pack_close_page(t) : UMB_OK;
}

static enum umb_status visit_band(struct umb__pack_walk *t, const struct umb__node_list *roots)
{
    size_t next = 0;
    return visit_roots(t, roots, &next, UINT32_MAX);
}

/* Returns true if roots of frusta lie below the roots of the lowest band. The canonical block then
 * names the last copy of such a root. */
static bool has_low_roots(const struct umb__octree *octree)
{
    bool has = false;
    for (uint32_t i = 0; i < octree->root_count; i++) {
        has = has || (octree->roots[i].state == UMB__NODE_MIXED &&
                      octree->roots[i].level < UMB__LOWEST_END - 1);
    }
    return has;
}

/* Visits the whole lowest band with copies, and undoes it if the copies take too much. */
static enum umb_status visit_all_with_copies(struct umb__pack_ordering *o, bool *worth)
{
    struct umb__pack_walk *t = &o->walk;
    const uint32_t page_count = t->order->page_count;
    t->closed_bytes = 0;
    UMB__TRY(visit_band(t, &o->roots));
    *worth = t->closed_bytes <= umb__pack_copies_most(&o->survey, &o->roots, o->roots.count);
    o->complete = *worth;
    if (!*worth) {
        umb__pack_rewind(t, page_count, UMB__LOWEST_END);
    }
    return UMB_OK;
}

/* Orders the lowest band. If copies of shared nodes cost little, only a sample is visited here, and
 * the pages are made later, step by step. */
static enum umb_status begin_lowest_band(struct umb__pack_ordering *o,
                                         const struct umb_workers *workers)
{
    struct umb__pack_walk *t = &o->walk;
    const uint32_t page_count = t->order->page_count;
    bool worth = false;
    t->alone = true;
    t->numbers_roots = !has_low_roots(t->octree);
    UMB__TRY(umb__pack_copies_asks_all(&o->roots)
                 ? visit_all_with_copies(o, &worth)
                 : umb__pack_copies(t, &o->roots, workers, &worth));
    t->order->alone_from = worth ? page_count : UINT32_MAX;
    if (worth) {
        return UMB_OK;
    }
    t->alone = false;
    t->numbers_roots = false;
    o->complete = true;
    return visit_band(t, &o->roots);
}

/* Collects the band's roots: those of frusta, and the nodes that the band above led to. */
static enum umb_status find_roots(struct umb__pack_walk *t, uint32_t band_high,
                                  struct umb__node_list *roots)
{
    for (uint32_t i = 0; i < t->octree->root_count; i++) {
        const struct umb__octree_root *root = &t->octree->roots[i];
        if (root->state == UMB__NODE_MIXED && root->level >= t->band_low &&
            root->level <= band_high) {
            UMB__TRY(
                umb__node_list_add(t, roots, (struct umb__node_ref){root->level, root->index}));
        }
    }
    for (size_t i = 0; i < t->waiting.count; i++) {
        UMB__TRY(umb__node_list_add(t, roots, t->waiting.nodes[i]));
    }
    t->waiting.count = 0;
    return UMB_OK;
}

static enum umb_status visit_bands(struct umb__pack_ordering *o, const struct umb_workers *workers)
{
    struct umb__pack_walk *t = &o->walk;
    uint32_t band_high = UMB_LEVEL_MAX;
    UMB__TRY(allocate(o));
    for (size_t band = 0; band < BAND_COUNT; band++) {
        o->roots.count = 0;
        t->band_low = band_lows[band];
        UMB__TRY(find_roots(t, band_high, &o->roots));
        UMB__TRY(t->band_low == UMB_LEVEL_BRICK ? begin_lowest_band(o, workers)
                                                : visit_band(t, &o->roots));
        band_high = t->band_low - 1;
    }
    return UMB_OK;
}

/* Records, for each level, the pages of every 16th ordinal and of the last one. */
static enum umb_status make_hints(struct umb__pack_walk *t)
{
    struct umb__pack_order *order = t->order;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        const uint32_t count = t->next[level];
        const size_t hints = count / UMB__PACK_HINT + 2;
        uint32_t page = 0, *hint = umb__alloc(order->alloc, hints, sizeof *hint);
        order->hints[level] = hint;
        if (!hint) {
            return umb__pack_no_memory(t->error);
        }
        for (size_t i = 0; i < hints && count > 0; i++) {
            const size_t hinted = i * UMB__PACK_HINT;
            const size_t ordinal = hinted < count ? hinted : count - 1;
            while (order->begins[level][page + 1] <= ordinal) {
                page++;
            }
            hint[i] = page;
        }
    }
    return UMB_OK;
}

enum umb_status umb__pack_order_begin(const struct umb__octree *octree,
                                      const struct umb_workers *workers,
                                      struct umb__pack_order *order,
                                      struct umb__pack_ordering **out, struct umb_error *error)
{
    memset(order, 0, sizeof *order);
    order->alloc = octree->alloc;
    order->alone_from = UINT32_MAX;
    struct umb__pack_ordering *o = umb__alloc_zeroed(octree->alloc, 1, sizeof *o);
    *out = o;
    if (!o) {
        return umb__pack_no_memory(error);
    }
    o->alloc = octree->alloc;
    UMB__TRY(umb__pack_survey(octree, &o->survey, error));
    memcpy(order->counts, o->survey.counts, sizeof order->counts);
    o->walk = (struct umb__pack_walk){
        .octree = octree, .survey = &o->survey, .order = order, .error = error};
    UMB__TRY(visit_bands(o, workers));
    return o->complete ? make_hints(&o->walk) : UMB_OK;
}

bool umb__pack_order_complete(const struct umb__pack_ordering *o)
{
    return o->complete;
}

/* Returns the most nodes of a level in one independent page. A node takes at least 2 bytes, a page
 * ends when it reaches the target, and the last tree may add all nodes of the level that a tree can
 * have. */
static size_t page_nodes_most(uint32_t level)
{
    return UMB__PAGE_RAW_TARGET / 2 + ((size_t)1 << 3 * (UMB__LOWEST_END - 1 - level));
}

enum umb_status umb__pack_order_reserve(struct umb__pack_ordering *o, uint32_t pages)
{
    struct umb__pack_order *order = o->walk.order;
    bool complete = umb__pack_grow_pages(order, (size_t)order->page_count + pages + 2);
    for (uint32_t level = UMB_LEVEL_BRICK; level < UMB__LOWEST_END && complete; level++) {
        complete = umb__grow(order->alloc, &order->nodes[level], &order->node_capacity[level],
                             o->walk.next[level] + pages * page_nodes_most(level),
                             sizeof *order->nodes[level]);
    }
    return complete ? UMB_OK : umb__pack_no_memory(o->walk.error);
}

enum umb_status umb__pack_order_step(struct umb__pack_ordering *o, uint32_t pages)
{
    const uint32_t left = UINT32_MAX - o->walk.order->page_count;
    const uint32_t most = o->walk.order->page_count + (pages < left ? pages : left);
    UMB__TRY(visit_roots(&o->walk, &o->roots, &o->next_root, most));
    if (o->next_root < o->roots.count) {
        return UMB_OK;
    }
    o->complete = true;
    return make_hints(&o->walk);
}

void umb__pack_ordering_destroy(struct umb__pack_ordering *o)
{
    if (o) {
        const struct umb_alloc *alloc = o->alloc;
        umb__free(alloc, o->roots.nodes);
        umb__pack_walk_finish(&o->walk);
        umb__pack_survey_finish(&o->survey);
        umb__free(alloc, o);
    }
}
