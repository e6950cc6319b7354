/* SPDX-License-Identifier: Apache-2.0 */
/* See pack_order.h. This file has the bands and their roots; pack_walk.c has the walk below
 * them. */
#include "format/pack_order.h"

#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "format/layout.h"
#include "format/pack_copies.h"
#include "format/pack_walk.h"

/* Lowest level of each band, from the top. */
static const uint32_t band_lows[] = {13, UMB__LOWEST_END, UMB_LEVEL_BRICK};
#define BAND_COUNT (sizeof band_lows / sizeof band_lows[0])

struct umb__pack_ordering {
    struct umb__pack_survey survey;
    struct umb__pack_walk walk;
    struct umb__node_list roots; /* of the lowest band */
    size_t next_root;            /* Index of the next root to visit */
    bool complete;
    const struct umb_alloc *alloc;
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for the order of the nodes");
}

static enum umb_status allocate(struct umb__pack_ordering *o)
{
    struct umb__pack_walk *t = &o->walk;
    struct umb__pack_order *order = t->order;
    bool complete =
        umb__pack_grow_pages(order, 1) && umb__pack_walk_begin(t, UMB_LEVEL_BRICK, UMB_LEVEL_MAX);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        const size_t count = umb__octree_level_count(t->octree, level);
        const size_t reached = (size_t)o->survey.counts[level]; /* more with copies */
        order->ordinals[level] =
            umb__alloc_large(order->alloc, count, sizeof *order->ordinals[level]);
        order->nodes[level] = umb__alloc_large(order->alloc, reached, sizeof *order->nodes[level]);
        order->node_capacity[level] = reached;
        complete = order->ordinals[level] && order->nodes[level];
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        order->begins[level][0] = 0;
    }
    return complete ? UMB_OK : no_memory(t->error);
}

/* Visits roots until the order has so many pages. Returns the next root. */
static enum umb_status visit_roots(struct umb__pack_walk *t, const struct umb__node_list *roots,
                                   size_t *next, uint32_t most_pages)
{
    enum umb_status status = UMB_OK;
    while (*next < roots->count && t->order->page_count < most_pages && status == UMB_OK) {
        status = umb__pack_visit_root(t, roots->nodes[(*next)++]);
    }
    return status == UMB_OK && *next == roots->count ? umb__pack_close_page(t) : status;
}

static enum umb_status visit_band(struct umb__pack_walk *t, const struct umb__node_list *roots)
{
    size_t next = 0;
    return visit_roots(t, roots, &next, UINT32_MAX);
}

/* True if the canonical block names nodes of the lowest band: the last copy of each. */
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
    enum umb_status status = visit_band(t, &o->roots);
    *worth = t->closed_bytes <= umb__pack_copies_most(&o->survey, &o->roots, o->roots.count);
    o->complete = *worth;
    if (!*worth) {
        umb__pack_rewind(t, page_count, UMB__LOWEST_END);
    }
    return status;
}

/* Orders the band of the bricks. Its trees have copies of shared nodes if that costs little; such
 * pages are made step by step. */
static enum umb_status begin_lowest_band(struct umb__pack_ordering *o,
                                         const struct umb_workers *workers)
{
    struct umb__pack_walk *t = &o->walk;
    const uint32_t page_count = t->order->page_count;
    bool worth = false;
    t->alone = true;
    t->numbers_roots = !has_low_roots(t->octree);
    enum umb_status status = umb__pack_copies_asks_all(&o->roots)
                                 ? visit_all_with_copies(o, &worth)
                                 : umb__pack_copies(t, &o->roots, workers, &worth);
    if (status != UMB_OK) {
        return status;
    }
    t->order->alone_from = worth ? page_count : UINT32_MAX;
    if (!worth) {
        t->alone = false;
        t->numbers_roots = false;
        o->complete = true;
        status = visit_band(t, &o->roots);
    }
    return status;
}

/* Collects the band's roots: those of frusta, and the nodes that the band above led to. */
static enum umb_status find_roots(struct umb__pack_walk *t, uint32_t band_high,
                                  struct umb__node_list *roots)
{
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < t->octree->root_count && status == UMB_OK; i++) {
        const struct umb__octree_root *root = &t->octree->roots[i];
        if (root->state == UMB__NODE_MIXED && root->level >= t->band_low &&
            root->level <= band_high) {
            status = umb__node_list_add(t, roots, (struct umb__node_ref){root->level, root->index});
        }
    }
    for (size_t i = 0; i < t->waiting.count && status == UMB_OK; i++) {
        status = umb__node_list_add(t, roots, t->waiting.nodes[i]);
    }
    t->waiting.count = 0;
    return status;
}

static enum umb_status visit_bands(struct umb__pack_ordering *o, const struct umb_workers *workers)
{
    struct umb__pack_walk *t = &o->walk;
    enum umb_status status = allocate(o);
    uint32_t band_high = UMB_LEVEL_MAX;
    for (size_t band = 0; band < BAND_COUNT && status == UMB_OK; band++) {
        o->roots.count = 0;
        t->band_low = band_lows[band];
        status = find_roots(t, band_high, &o->roots);
        if (status == UMB_OK) {
            status = t->band_low == UMB_LEVEL_BRICK ? begin_lowest_band(o, workers)
                                                    : visit_band(t, &o->roots);
        }
        band_high = t->band_low - 1;
    }
    return status;
}

/* Records the pages of every 16th ordinal of each level, and of the last. */
static enum umb_status make_hints(struct umb__pack_walk *t)
{
    struct umb__pack_order *order = t->order;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        const uint32_t count = t->next[level];
        const size_t hints = count / UMB__PACK_HINT + 2;
        uint32_t page = 0, *hint = umb__alloc(order->alloc, hints, sizeof *hint);
        order->hints[level] = hint;
        if (!hint) {
            return no_memory(t->error);
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

struct umb__node_place umb__pack_place(const struct umb__pack_order *order, uint32_t level,
                                       uint32_t ordinal)
{
    const uint32_t *hint = order->hints[level] + ordinal / UMB__PACK_HINT;
    uint32_t low = hint[0], high = hint[1];
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (order->begins[level][middle + 1] <= ordinal) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return (struct umb__node_place){low, ordinal - order->begins[level][low]};
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
        return no_memory(error);
    }
    o->alloc = octree->alloc;
    enum umb_status status = umb__pack_survey(octree, &o->survey, error);
    if (status == UMB_OK) {
        memcpy(order->counts, o->survey.counts, sizeof order->counts);
        o->walk = (struct umb__pack_walk){
            .octree = octree, .survey = &o->survey, .order = order, .error = error};
        status = visit_bands(o, workers);
        status = status == UMB_OK && o->complete ? make_hints(&o->walk) : status;
    }
    return status;
}

bool umb__pack_order_complete(const struct umb__pack_ordering *o)
{
    return o->complete;
}

/* Returns the most bytes of a level in one independent page: less than the target, and one whole
 * tree. */
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
    return complete ? UMB_OK : no_memory(o->walk.error);
}

enum umb_status umb__pack_order_step(struct umb__pack_ordering *o, uint32_t pages)
{
    const uint32_t left = UINT32_MAX - o->walk.order->page_count;
    const uint32_t most = o->walk.order->page_count + (pages < left ? pages : left);
    enum umb_status status = visit_roots(&o->walk, &o->roots, &o->next_root, most);
    if (status == UMB_OK && o->next_root == o->roots.count) {
        o->complete = true;
        status = make_hints(&o->walk);
    }
    return status;
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

void umb__pack_order_finish(struct umb__pack_order *order)
{
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(order->alloc, order->nodes[level]);
        umb__free(order->alloc, order->ordinals[level]);
        umb__free(order->alloc, order->begins[level]);
        umb__free(order->alloc, order->hints[level]);
    }
    memset(order, 0, sizeof *order);
}
