/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The survey and the walk; see pack_walk.h. The survey goes from the top level down, so it knows
 * which nodes are reached before it comes to their level, and one pass over each level is enough.
 * The walk is depth first, with an explicit stack. Most of its work is to find that a child was
 * visited before. The state of each node takes two bits, which fit the cache better than ordinals
 * do.
 */
#include "format/pack_walk.h"

#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"

enum umb_status umb__pack_no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for the order of the nodes");
}

bool umb__pack_grow_pages(struct umb__pack_order *order, size_t needed)
{
    size_t capacity = order->page_capacity;
    bool complete = true;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        capacity = order->page_capacity;
        complete = umb__grow(order->alloc, &order->begins[level], &capacity, needed,
                             sizeof *order->begins[level]);
    }
    order->page_capacity = complete ? capacity : order->page_capacity;
    return complete;
}

/* --- survey ----------------------------------------------------------------------------------- */

/* Returns the words of a set of `count` nodes, a bit each. */
static size_t bits_words(size_t count)
{
    return count / 64 + 1;
}

static bool bits_has(const uint64_t *bits, uint32_t number)
{
    return bits[number / 64] >> (number % 64) & 1;
}

static void bits_add(uint64_t *bits, uint32_t number)
{
    bits[number / 64] |= (uint64_t)1 << (number % 64);
}

/* Estimates the bytes of a node with `children` mixed children, all in the node's page. */
static size_t node_estimate(uint32_t children)
{
    return 2 + (size_t)children;
}

struct surveyor {
    const struct umb__octree *octree;
    struct umb__pack_survey *survey;
    struct umb_error *error;
    uint64_t *reached[UMB_LEVEL_MAX + 1]; /* Set of the reached nodes of each level */
};

/* Marks the roots, and checks that they exist. */
static enum umb_status mark_roots(struct surveyor *s)
{
    for (uint32_t i = 0; i < s->octree->root_count; i++) {
        const struct umb__octree_root *root = &s->octree->roots[i];
        if (root->state != UMB__NODE_MIXED) {
            continue;
        }
        const uint32_t count = umb__octree_level_count(s->octree, root->level);
        if (root->index >= count) {
            return umb_fail(s->error, UMB_E_ARGUMENT,
                            "octree: node %u of level %u, the level has %u", root->index,
                            root->level, count);
        }
        bits_add(s->reached[root->level], root->index);
    }
    return UMB_OK;
}

/* Checks that a node has a possible mask and leads to existing nodes, and marks its children. */
static enum umb_status survey_node(struct surveyor *s, uint32_t number, uint32_t node)
{
    const struct umb__octree_level *level = &s->octree->level[number];
    const uint16_t mask = level->masks[node];
    const uint32_t first = level->first[node], end = level->first[node + 1];
    if ((mask & (mask >> 1) & 0x5555U) != 0 || end < first ||
        end - first != umb__mask_mixed_count(mask)) {
        return umb_fail(s->error, UMB_E_ARGUMENT,
                        "octree: node %u of level %u: mask 0x%04x does not fit its children %u to "
                        "%u",
                        node, number, mask, first, end);
    }
    const uint32_t below = umb__octree_level_count(s->octree, number - 1);
    for (uint32_t i = first; i < end; i++) {
        if (level->children[i] >= below) {
            return umb_fail(s->error, UMB_E_ARGUMENT,
                            "octree: node %u of level %u leads to %u, the level below has %u", node,
                            number, level->children[i], below);
        }
        bits_add(s->reached[number - 1], level->children[i]);
    }
    s->survey->counts[number]++;
    s->survey->bytes[number] += node_estimate(end - first);
    return UMB_OK;
}

static enum umb_status survey_level(struct surveyor *s, uint32_t number)
{
    const uint64_t *reached = s->reached[number];
    const size_t words = bits_words(s->octree->level[number].count);
    for (size_t i = 0; i < words; i++) {
        for (uint64_t bits = reached[i]; bits != 0; bits &= bits - 1) {
            const uint32_t node = (uint32_t)(64 * i) + (uint32_t)__builtin_ctzll(bits);
            UMB__TRY(survey_node(s, number, node));
        }
    }
    return UMB_OK;
}

static void survey_bricks(struct surveyor *s)
{
    const uint64_t *reached = s->reached[UMB_LEVEL_BRICK];
    for (uint32_t i = 0; i < s->octree->brick_count; i++) {
        const unsigned runs = umb__brick_runs(s->octree->bricks[i]);
        s->survey->brick_bytes[i] = (uint8_t)(1 + 3 * __builtin_popcount(runs));
        if (bits_has(reached, i)) {
            s->survey->counts[UMB_LEVEL_BRICK]++;
            s->survey->bytes[UMB_LEVEL_BRICK] += s->survey->brick_bytes[i];
        }
    }
}

enum umb_status umb__pack_survey(const struct umb__octree *octree, struct umb__pack_survey *survey,
                                 struct umb_error *error)
{
    struct surveyor s = {.octree = octree, .survey = survey, .error = error};
    memset(survey, 0, sizeof *survey);
    survey->alloc = octree->alloc;
    survey->brick_bytes = umb__alloc(octree->alloc, octree->brick_count + 1, 1);
    enum umb_status status = survey->brick_bytes != NULL ? UMB_OK : umb__pack_no_memory(error);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && status == UMB_OK; level++) {
        const size_t words = bits_words(umb__octree_level_count(octree, level));
        s.reached[level] = umb__alloc_zeroed(octree->alloc, words, sizeof *s.reached[level]);
        status = s.reached[level] != NULL ? UMB_OK : umb__pack_no_memory(error);
    }
    status = status == UMB_OK ? mark_roots(&s) : status;
    for (uint32_t level = UMB_LEVEL_MAX; level > UMB_LEVEL_BRICK && status == UMB_OK; level--) {
        status = survey_level(&s, level);
    }
    if (status == UMB_OK) {
        survey_bricks(&s);
    } else {
        umb__pack_survey_finish(survey);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        umb__free(octree->alloc, s.reached[level]);
    }
    return status;
}

void umb__pack_survey_finish(struct umb__pack_survey *survey)
{
    umb__free(survey->alloc, survey->brick_bytes);
    memset(survey, 0, sizeof *survey);
}

/* --- walk ------------------------------------------------------------------------------------- */

#define STACK_MAX (8 * UMB_LEVEL_MAX + 8) /* Nodes on the stack: at most 8 children a level */
#define PAGES_MAX (UINT32_MAX - 1)
#define NODES_MAX UINT32_MAX /* Most nodes of a level, copies included */

/* State of a node during the walk. */
enum node_state {
    NOT_MET = 0,
    WAITS = 1,  /* Met by a band above, and a root of the next band */
    BEFORE = 2, /* Written, in a closed page only */
    HERE = 3,   /* Written in the open page */
};

static size_t state_words(const struct umb__pack_walk *t, uint32_t level)
{
    return umb__octree_level_count(t->octree, level) / 32 + 1;
}

static enum node_state state_of(const struct umb__pack_walk *t, struct umb__node_ref node)
{
    return (enum node_state)(t->states[node.level][node.index / 32] >> (2 * (node.index % 32)) & 3);
}

static void set_state(struct umb__pack_walk *t, struct umb__node_ref node, enum node_state state)
{
    uint64_t *word = &t->states[node.level][node.index / 32];
    const unsigned shift = 2 * (node.index % 32);
    *word = (*word & ~((uint64_t)3 << shift)) | (uint64_t)state << shift;
}

/* Closes the open page: the next page begins at the ordinals that follow. */
static enum umb_status add_page(struct umb__pack_walk *t)
{
    struct umb__pack_order *order = t->order;
    if (order->page_count == PAGES_MAX) {
        return umb_fail(t->error, UMB_E_TOO_LARGE, "packing: more than %u pages", PAGES_MAX);
    }
    if (!umb__pack_grow_pages(order, (size_t)order->page_count + 2)) {
        return umb__pack_no_memory(t->error);
    }
    order->page_count++;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        order->begins[level][order->page_count] = t->next[level];
    }
    return UMB_OK;
}

enum umb_status umb__pack_close_page(struct umb__pack_walk *t)
{
    const struct umb__pack_order *order = t->order;
    if (t->page_bytes == 0) {
        return UMB_OK;
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        const uint32_t begin = order->begins[level][order->page_count];
        for (uint32_t i = begin; i < t->next[level]; i++) {
            set_state(t, (struct umb__node_ref){level, order->nodes[level][i]}, BEFORE);
        }
        t->next[level] = t->sample ? begin : t->next[level];
    }
    t->closed_bytes += t->page_bytes;
    t->page_bytes = 0;
    return t->sample ? UMB_OK : add_page(t);
}

/* Writes a node at the end of the open page. In: bytes: its estimated size. */
static enum umb_status place(struct umb__pack_walk *t, struct umb__node_ref node, size_t bytes)
{
    struct umb__pack_order *order = t->order;
    const uint32_t ordinal = t->next[node.level];
    if (ordinal == NODES_MAX) {
        return umb_fail(t->error, UMB_E_TOO_LARGE, "packing: level %u: more than %u copies",
                        node.level, NODES_MAX);
    }
    if (!umb__grow(order->alloc, &order->nodes[node.level], &order->node_capacity[node.level],
                   (size_t)ordinal + 1, sizeof *order->nodes[node.level])) {
        return umb__pack_no_memory(t->error);
    }
    t->page_bytes += bytes;
    set_state(t, node, HERE);
    if (!t->numbers_roots) {
        order->ordinals[node.level][node.index] = ordinal;
    }
    order->nodes[node.level][ordinal] = node.index;
    t->next[node.level] = ordinal + 1;
    /* Closes a full page. Independent pages are closed only between two roots' trees. */
    return !t->alone && t->page_bytes >= UMB__PAGE_RAW_TARGET ? umb__pack_close_page(t) : UMB_OK;
}

/* Returns true if no further copy of a node is needed: it is in the open page or, unless pages are
 * independent, in any page. */
static bool is_placed(const struct umb__pack_walk *t, struct umb__node_ref node)
{
    return state_of(t, node) >= (t->alone ? HERE : BEFORE);
}

enum umb_status umb__node_list_add(const struct umb__pack_walk *t, struct umb__node_list *list,
                                   struct umb__node_ref node)
{
    if (!umb__grow(t->order->alloc, &list->nodes, &list->capacity, list->count + 1,
                   sizeof *list->nodes)) {
        return umb__pack_no_memory(t->error);
    }
    list->nodes[list->count++] = node;
    return UMB_OK;
}

/* Adds a node to the roots of the next band, once. */
static enum umb_status wait_for_next_band(struct umb__pack_walk *t, struct umb__node_ref child)
{
    if (state_of(t, child) != NOT_MET) {
        return UMB_OK;
    }
    set_state(t, child, WAITS);
    return umb__node_list_add(t, &t->waiting, child);
}

/* Nodes to be visited; the last one is visited first. */
struct stack {
    struct umb__node_ref nodes[STACK_MAX];
    size_t depth;
};

/*
 * Reads a node's children. Those that are not written yet and belong to this band go on the stack,
 * except bricks. Returns the node's estimated bytes in the open page.
 */
static size_t enter(const struct umb__pack_walk *t, struct umb__node_ref node, struct stack *stack)
{
    const struct umb__octree_level *level = &t->octree->level[node.level];
    const struct umb__octree_level *below = &t->octree->level[node.level - 1];
    const uint32_t first = level->first[node.index], end = level->first[node.index + 1];
    const bool visits = node.level > t->band_low && node.level > UMB_LEVEL_BRICK + 1;
    const enum node_state stands = t->alone ? HERE : BEFORE;
    const size_t depth = stack->depth;
    size_t bytes = node_estimate(end - first);
    /* The last child is pushed first, since the stack returns children in reverse. */
    for (uint32_t i = end; i-- > first;) {
        const struct umb__node_ref child = {node.level - 1, level->children[i]};
        const enum node_state state = state_of(t, child);
        bytes += !t->alone && (state == WAITS || state == BEFORE) ? 8 : 0;
        if (visits && state < stands) {
            __builtin_prefetch(below->first + child.index);
            stack->nodes[stack->depth++] = child;
        }
    }
    for (size_t i = depth; i < stack->depth; i++) {
        __builtin_prefetch(below->children + below->first[stack->nodes[i].index]);
    }
    return bytes;
}

/* Writes a node's bricks directly after the node, with one prefetch for all their sizes. */
static enum umb_status place_bricks(struct umb__pack_walk *t, const uint32_t *bricks,
                                    uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        __builtin_prefetch(t->survey->brick_bytes + bricks[i]);
    }
    for (uint32_t i = 0; i < count; i++) {
        const struct umb__node_ref brick = {UMB_LEVEL_BRICK, bricks[i]};
        if (!is_placed(t, brick)) {
            UMB__TRY(place(t, brick, t->survey->brick_bytes[bricks[i]]));
        }
    }
    return UMB_OK;
}

/* Handles the children that are not put on the stack: bricks, and roots of the next band. */
static enum umb_status follow(struct umb__pack_walk *t, struct umb__node_ref node)
{
    const struct umb__octree_level *level = &t->octree->level[node.level];
    const uint32_t *children = level->children + level->first[node.index];
    const uint32_t count = level->first[node.index + 1] - level->first[node.index];
    if (node.level == UMB_LEVEL_BRICK + 1) {
        return place_bricks(t, children, count);
    }
    for (uint32_t i = 0; i < count && node.level == t->band_low; i++) {
        UMB__TRY(wait_for_next_band(t, (struct umb__node_ref){node.level - 1, children[i]}));
    }
    return UMB_OK;
}

/* Prefetches the states of the children of a node that will be visited soon. */
static void ask_for_states(const struct umb__pack_walk *t, struct umb__node_ref node)
{
    const struct umb__octree_level *level = &t->octree->level[node.level];
    for (uint32_t i = level->first[node.index]; i < level->first[node.index + 1]; i++) {
        __builtin_prefetch(t->states[node.level - 1] + level->children[i] / 32);
    }
}

/* Visits a subtree down to the band's lowest level. */
static enum umb_status visit(struct umb__pack_walk *t, struct umb__node_ref root)
{
    struct stack stack = {.nodes = {root}, .depth = 1};
    while (stack.depth > 0) {
        const struct umb__node_ref node = stack.nodes[--stack.depth];
        if (stack.depth > 0) {
            ask_for_states(t, stack.nodes[stack.depth - 1]);
        }
        if (!is_placed(t, node)) {
            const size_t bytes = enter(t, node, &stack);
            UMB__TRY(place(t, node, bytes));
            UMB__TRY(follow(t, node));
        }
    }
    return UMB_OK;
}

enum umb_status umb__pack_visit_root(struct umb__pack_walk *t, struct umb__node_ref root)
{
    if (state_of(t, root) >= BEFORE) {
        return UMB_OK;
    }
    if (t->numbers_roots && !t->sample) {
        t->order->ordinals[root.level][root.index] = t->next[root.level];
    }
    UMB__TRY(visit(t, root));
    return t->alone && t->page_bytes >= UMB__PAGE_RAW_TARGET ? umb__pack_close_page(t) : UMB_OK;
}

bool umb__pack_walk_begin(struct umb__pack_walk *t, uint32_t high)
{
    bool complete = umb__pack_grow_pages(t->order, 1);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        t->order->begins[level][0] = 0;
        if (level <= high) {
            t->states[level] =
                umb__alloc_zeroed(t->order->alloc, state_words(t, level), sizeof *t->states[level]);
            complete = t->states[level] != NULL;
        }
    }
    return complete;
}

void umb__pack_walk_finish(struct umb__pack_walk *walk)
{
    if (walk->order) {
        umb__free(walk->order->alloc, walk->waiting.nodes);
        for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
            umb__free(walk->order->alloc, walk->states[level]);
        }
    }
    memset(walk, 0, sizeof *walk);
}

void umb__pack_rewind(struct umb__pack_walk *walk, uint32_t page_count, uint32_t end)
{
    walk->order->page_count = page_count;
    for (uint32_t level = UMB_LEVEL_BRICK; level < end; level++) {
        walk->next[level] = walk->order->begins[level][page_count];
        memset(walk->states[level], 0, state_words(walk, level) * sizeof *walk->states[level]);
    }
}
