/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See pack_order.h. Depth-first traversal with an explicit stack: depth never exceeds the bands.
 * What a visit reads of a node lies anywhere in memory, so it is asked for when the node goes onto
 * the stack, together with its siblings.
 */
#include "format/pack_order.h"

#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "format/layout.h"

/* Lowest level of each band, from the top. */
static const uint32_t band_lows[] = {13, 8, UMB_LEVEL_BRICK};
enum {
    BAND_COUNT = sizeof band_lows / sizeof band_lows[0],
    STACK_MAX = 8 * UMB_LEVEL_MAX + 8, /* at most 8 pending children a level */
};

/* With copies the lowest band may take 12/5 of what its nodes take once: the file is then about a
 * fifth larger (docs/streaming.md), as references, which copies make unnecessary, take the most. */
#define COPIES_MAX_FIFTHS 12U

/* Of a node that a band above has met: a page number that no page can have. */
#define PAGE_WAITING (UINT32_MAX - 1)

/* A growing list of nodes. */
struct node_list {
    struct umb__node_ref *nodes;
    size_t count, capacity;
};

struct traversal {
    const struct umb_octree *octree;
    struct umb__pack_order *order;
    struct umb_error *error;
    size_t page_bytes; /* estimate for the open page */
    uint32_t page_level_counts[UMB_LEVEL_MAX + 1];
    struct node_list waiting; /* roots of the next band */
    uint32_t band_low;
    bool alone;                       /* the band's pages refer to no other */
    uint64_t copied_bytes, own_bytes; /* estimates of such pages; of their nodes, each once */
};

uint32_t umb__octree_level_count(const struct umb_octree *octree, uint32_t level)
{
    return level == UMB_LEVEL_BRICK ? octree->brick_count : octree->level[level].count;
}

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for the order of the nodes");
}

static enum umb_status allocate(const struct umb_octree *octree, struct umb__pack_order *order,
                                struct umb_error *error)
{
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        size_t count = umb__octree_level_count(octree, level);
        struct umb__node_place *places = umb__alloc_large(order->alloc, count, sizeof *places);
        order->places[level] = places;
        if (!places) {
            return no_memory(error);
        }
        memset(places, 0xff, count * sizeof *places);
    }
    return UMB_OK;
}

/* Ends the open page, if it holds anything. */
static enum umb_status close_page(struct traversal *t)
{
    struct umb__pack_order *order = t->order;
    if (t->page_bytes == 0) {
        return UMB_OK;
    }
    if (order->page_count == PAGE_WAITING) {
        return umb_fail(t->error, UMB_E_TOO_LARGE, "packing: more than %u pages", PAGE_WAITING);
    }
    if (!umb__grow(order->alloc, &order->page_first, &order->page_capacity,
                   (size_t)order->page_count + 2, sizeof *order->page_first)) {
        return no_memory(t->error);
    }
    order->page_first[0] = 0;
    order->page_count++;
    order->page_first[order->page_count] = order->node_count;
    memset(t->page_level_counts, 0, sizeof t->page_level_counts);
    t->page_bytes = 0;
    return UMB_OK;
}

/* What a node will take in a page, roughly. */
static size_t estimate(const struct traversal *t, struct umb__node_ref node)
{
    if (node.level == UMB_LEVEL_BRICK) {
        const uint64_t *brick = t->octree->bricks[node.index];
        size_t runs = 1;
        for (size_t z = 1; z < 8; z++) {
            runs += brick[z] != brick[z - 1];
        }
        return 1 + 3 * runs;
    }
    const struct umb_octree_level *level = &t->octree->level[node.level];
    uint32_t children = level->first[node.index + 1] - level->first[node.index];
    size_t bytes = 2 + (size_t)children;
    for (uint32_t i = 0; i < children && !t->alone; i++) {
        uint32_t child = level->children[level->first[node.index] + i];
        uint32_t page = t->order->places[node.level - 1][child].page;
        bytes += page != UINT32_MAX && page != t->order->page_count ? 8 : 0;
    }
    return bytes;
}

/* Writes a node at the end of the open page. */
static enum umb_status place(struct traversal *t, struct umb__node_ref node)
{
    struct umb__pack_order *order = t->order;
    struct umb__node_place *place = &order->places[node.level][node.index];
    if (!umb__grow(order->alloc, &order->sequence, &order->sequence_capacity, order->node_count + 1,
                   sizeof *order->sequence)) {
        return no_memory(t->error);
    }
    const size_t bytes = estimate(t, node);
    const bool first = place->page >= PAGE_WAITING;
    t->page_bytes += bytes;
    t->copied_bytes += t->alone ? bytes : 0;
    t->own_bytes += t->alone && first ? bytes : 0;
    order->counts[node.level] += first;
    *place = (struct umb__node_place){
        .page = order->page_count,
        .position = t->page_level_counts[node.level]++,
    };
    order->sequence[order->node_count++] = node;
    /* Pages that stand alone end between the trees of two roots. */
    return !t->alone && t->page_bytes >= UMB__PAGE_RAW_TARGET ? close_page(t) : UMB_OK;
}

/* Proves that a node exists, has a possible mask, and leads to nodes that exist: whatever order
 * they are visited in, nothing is read of a node before this. */
static enum umb_status check_node(const struct traversal *t, struct umb__node_ref node)
{
    uint32_t count = umb__octree_level_count(t->octree, node.level);
    if (node.index >= count) {
        return umb_fail(t->error, UMB_E_ARGUMENT, "octree: node %u of level %u, the level has %u",
                        node.index, node.level, count);
    }
    if (node.level == UMB_LEVEL_BRICK) {
        return UMB_OK;
    }
    const struct umb_octree_level *level = &t->octree->level[node.level];
    uint16_t mask = level->masks[node.index];
    uint32_t first = level->first[node.index], end = level->first[node.index + 1];
    if ((mask & (mask >> 1) & 0x5555U) != 0 || end < first ||
        end - first != umb_mask_mixed_count(mask)) {
        return umb_fail(t->error, UMB_E_ARGUMENT,
                        "octree: node %u of level %u: mask 0x%04x does not fit its children %u to "
                        "%u",
                        node.index, node.level, mask, first, end);
    }
    uint32_t below = umb__octree_level_count(t->octree, node.level - 1);
    for (uint32_t i = first; i < end; i++) {
        if (level->children[i] >= below) {
            return umb_fail(t->error, UMB_E_ARGUMENT,
                            "octree: node %u of level %u leads to %u, the level below has %u",
                            node.index, node.level, level->children[i], below);
        }
    }
    return UMB_OK;
}

/* Marks a node of a lower band as waiting, once. */
static enum umb_status wait_for_next_band(struct traversal *t, struct umb__node_ref node)
{
    uint32_t *page = &t->order->places[node.level][node.index].page;
    if (*page != UINT32_MAX) {
        return UMB_OK;
    }
    *page = PAGE_WAITING;
    if (!umb__grow(t->order->alloc, &t->waiting.nodes, &t->waiting.capacity, t->waiting.count + 1,
                   sizeof *t->waiting.nodes)) {
        return no_memory(t->error);
    }
    t->waiting.nodes[t->waiting.count++] = node;
    return UMB_OK;
}

/* True if a node stands where it is needed: anywhere, or in the open page if that stands alone. */
static bool is_placed(const struct traversal *t, struct umb__node_ref node)
{
    const uint32_t page = t->order->places[node.level][node.index].page;
    return t->alone ? page == t->order->page_count : page < PAGE_WAITING;
}

/* Asks for what visiting a node, which exists, will read of it first. */
static void ask_ahead(const struct traversal *t, struct umb__node_ref node)
{
    if (node.level == UMB_LEVEL_BRICK) {
        __builtin_prefetch(t->octree->bricks[node.index]);
    } else {
        __builtin_prefetch(t->octree->level[node.level].first + node.index);
        __builtin_prefetch(t->octree->level[node.level].masks + node.index);
    }
}

/* Visits a subtree down to the band's lowest level. */
static enum umb_status visit(struct traversal *t, struct umb__node_ref root)
{
    struct umb__node_ref stack[STACK_MAX];
    size_t depth = 0;
    stack[depth++] = root;
    while (depth > 0) {
        struct umb__node_ref node = stack[--depth];
        if (is_placed(t, node)) {
            continue;
        }
        enum umb_status status = check_node(t, node);
        status = status == UMB_OK ? place(t, node) : status;
        if (status != UMB_OK) {
            return status;
        }
        if (node.level == UMB_LEVEL_BRICK) {
            continue;
        }
        const struct umb_octree_level *level = &t->octree->level[node.level];
        uint32_t first = level->first[node.index];
        uint32_t count = level->first[node.index + 1] - first;
        for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
            /* The stack gives children back in reverse, so push the last one first. */
            bool below = node.level == t->band_low;
            uint32_t k = below ? i : count - 1 - i;
            struct umb__node_ref child = {node.level - 1, level->children[first + k]};
            if (below) {
                status = wait_for_next_band(t, child);
            } else {
                stack[depth++] = child;
                ask_ahead(t, child);
            }
        }
        if (status != UMB_OK) {
            return status;
        }
    }
    return UMB_OK;
}

/* Visits a root of the band. */
static enum umb_status visit_root(struct traversal *t, struct umb__node_ref root)
{
    if (t->order->places[root.level][root.index].page < PAGE_WAITING) {
        return UMB_OK; /* stands below another root, or is the root of two frusta */
    }
    enum umb_status status = visit(t, root);
    const bool ends = t->alone && t->page_bytes >= UMB__PAGE_RAW_TARGET;
    return status == UMB_OK && ends ? close_page(t) : status;
}

static enum umb_status visit_band(struct traversal *t, uint32_t band_high)
{
    struct node_list roots = t->waiting;
    enum umb_status status = UMB_OK;
    memset(&t->waiting, 0, sizeof t->waiting);
    for (uint32_t i = 0; i < t->octree->root_count && status == UMB_OK; i++) {
        const struct umb_octree_root *root = &t->octree->roots[i];
        if (root->state == UMB_NODE_MIXED && root->level >= t->band_low &&
            root->level <= band_high) {
            struct umb__node_ref node = {root->level, root->index};
            status = check_node(t, node);
            status = status == UMB_OK ? visit_root(t, node) : status;
        }
    }
    for (size_t i = 0; i < roots.count && status == UMB_OK; i++) {
        status = visit_root(t, roots.nodes[i]);
    }
    umb__free(t->order->alloc, roots.nodes);
    return status == UMB_OK ? close_page(t) : status;
}

/* In: copies: of what trees of the lowest band share. Out: worth: false if they are too many. */
static enum umb_status order_nodes(const struct umb_octree *octree, bool copies,
                                   struct umb__pack_order *order, bool *worth,
                                   struct umb_error *error)
{
    memset(order, 0, sizeof *order);
    order->alloc = octree->alloc;
    order->alone_from = UINT32_MAX;
    struct traversal t = {.octree = octree, .order = order, .error = error};
    enum umb_status status = allocate(octree, order, error);
    uint32_t band_high = UMB_LEVEL_MAX;
    for (size_t band = 0; band < BAND_COUNT && status == UMB_OK; band++) {
        t.band_low = band_lows[band];
        t.alone = copies && t.band_low == UMB_LEVEL_BRICK;
        order->alone_from = t.alone ? order->page_count : order->alone_from;
        status = visit_band(&t, band_high);
        band_high = t.band_low - 1;
    }
    umb__free(t.order->alloc, t.waiting.nodes);
    if (status != UMB_OK) {
        umb__pack_order_finish(order);
    }
    *worth = 5 * t.copied_bytes <= COPIES_MAX_FIFTHS * t.own_bytes;
    return status;
}

enum umb_status umb__pack_order(const struct umb_octree *octree, struct umb__pack_order *order,
                                struct umb_error *error)
{
    bool worth;
    enum umb_status status = order_nodes(octree, true, order, &worth, error);
    if (status == UMB_OK && !worth) {
        umb__pack_order_finish(order);
        status = order_nodes(octree, false, order, &worth, error);
    }
    return status;
}

void umb__pack_order_finish(struct umb__pack_order *order)
{
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(order->alloc, order->places[level]);
    }
    umb__free(order->alloc, order->sequence);
    umb__free(order->alloc, order->page_first);
    memset(order, 0, sizeof *order);
}
