/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See pack_order.h. Depth-first traversal with an explicit stack: depth never exceeds the bands.
 * Most of a traversal is finding that a child stands somewhere already. That, and whether it is in
 * the open page, are two bits a node, which fit the cache where ordinals do not.
 */
#include "format/pack_order.h"

#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "format/layout.h"
#include "format/pack_survey.h"

/* Lowest level of each band, from the top. */
static const uint32_t band_lows[] = {13, 8, UMB_LEVEL_BRICK};
enum {
    BAND_COUNT = sizeof band_lows / sizeof band_lows[0],
    STACK_MAX = 8 * UMB_LEVEL_MAX + 8, /* at most 8 pending children a level */
};

/* With copies the lowest band may take 12/5 of what its nodes take once: the file is then about a
 * fifth larger (docs/streaming.md), as references, which copies make unnecessary, take the most.
 * That is asked of 16384 roots or a few more, in runs of neighbours. */
#define COPIES_MAX_FIFTHS 12U
#define SAMPLE_ROOTS      16384U
#define SAMPLE_RUN        64U

#define PAGES_MAX  (UINT32_MAX - 1)
#define NODES_MAX  UINT32_MAX /* of a level, copies included */
#define LOWEST_END 8U         /* levels of the lowest band are below */

/* A growing list of nodes. */
struct node_list {
    struct umb__node_ref *nodes;
    size_t count, capacity;
};

/* What became of a node so far. */
enum node_state {
    NOT_MET = 0,
    WAITS = 1,  /* met by a band above, as a root of the next */
    BEFORE = 2, /* stands in a closed page only */
    HERE = 3,   /* stands in the open page */
};

struct traversal {
    const struct umb_octree *octree;
    const struct umb__pack_survey *survey;
    struct umb__pack_order *order;
    struct umb_error *error;
    uint64_t *states[UMB_LEVEL_MAX + 1]; /* enum node_state, two bits a node */
    uint32_t next[UMB_LEVEL_MAX + 1];    /* ordinal */
    size_t page_bytes;                   /* estimate for the open page */
    struct node_list waiting;            /* roots of the next band */
    uint32_t band_low;
    bool alone;            /* the band's pages refer to no other */
    uint64_t copied_bytes; /* estimate of such pages that are closed */
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for the order of the nodes");
}

static size_t state_words(const struct traversal *t, uint32_t level)
{
    return umb__octree_level_count(t->octree, level) / 32 + 1;
}

static enum node_state state_of(const struct traversal *t, struct umb__node_ref node)
{
    return (enum node_state)(t->states[node.level][node.index / 32] >> (2 * (node.index % 32)) & 3);
}

static void set_state(struct traversal *t, struct umb__node_ref node, enum node_state state)
{
    uint64_t *word = &t->states[node.level][node.index / 32];
    const unsigned shift = 2 * (node.index % 32);
    *word = (*word & ~((uint64_t)3 << shift)) | (uint64_t)state << shift;
}

/* Makes room for the begins of so many pages. */
static bool grow_pages(struct umb__pack_order *order, size_t needed)
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

static enum umb_status allocate(struct traversal *t)
{
    struct umb__pack_order *order = t->order;
    bool complete = grow_pages(order, 1);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        const size_t count = umb__octree_level_count(t->octree, level);
        const size_t reached = (size_t)t->survey->counts[level]; /* more with copies */
        t->states[level] =
            umb__alloc_zeroed(order->alloc, state_words(t, level), sizeof *t->states[level]);
        order->ordinals[level] =
            umb__alloc_large(order->alloc, count, sizeof *order->ordinals[level]);
        order->nodes[level] = umb__alloc_large(order->alloc, reached, sizeof *order->nodes[level]);
        order->node_capacity[level] = reached;
        complete = t->states[level] && order->ordinals[level] && order->nodes[level];
    }
    if (!complete) {
        return no_memory(t->error);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        order->begins[level][0] = 0;
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
    if (order->page_count == PAGES_MAX) {
        return umb_fail(t->error, UMB_E_TOO_LARGE, "packing: more than %u pages", PAGES_MAX);
    }
    if (!grow_pages(order, (size_t)order->page_count + 2)) {
        return no_memory(t->error);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        for (uint32_t i = order->begins[level][order->page_count]; i < t->next[level]; i++) {
            set_state(t, (struct umb__node_ref){level, order->nodes[level][i]}, BEFORE);
        }
        order->begins[level][order->page_count + 1] = t->next[level];
    }
    t->copied_bytes += t->page_bytes;
    order->page_count++;
    t->page_bytes = 0;
    return UMB_OK;
}

/* Writes a node at the end of the open page, where it will take so many bytes, roughly. */
static enum umb_status place(struct traversal *t, struct umb__node_ref node, size_t bytes)
{
    struct umb__pack_order *order = t->order;
    const uint32_t ordinal = t->next[node.level];
    if (ordinal == NODES_MAX) {
        return umb_fail(t->error, UMB_E_TOO_LARGE, "packing: level %u: more than %u copies",
                        node.level, NODES_MAX);
    }
    if (!umb__grow(order->alloc, &order->nodes[node.level], &order->node_capacity[node.level],
                   (size_t)ordinal + 1, sizeof *order->nodes[node.level])) {
        return no_memory(t->error);
    }
    t->page_bytes += bytes;
    set_state(t, node, HERE);
    order->ordinals[node.level][node.index] = ordinal;
    order->nodes[node.level][ordinal] = node.index;
    t->next[node.level] = ordinal + 1;
    /* Pages that stand alone end between the trees of two roots. */
    return !t->alone && t->page_bytes >= UMB__PAGE_RAW_TARGET ? close_page(t) : UMB_OK;
}

/* True if a node stands where it is needed: anywhere, or in the open page if that stands alone. */
static bool is_placed(const struct traversal *t, struct umb__node_ref node)
{
    return state_of(t, node) >= (t->alone ? HERE : BEFORE);
}

static enum umb_status list_add(struct traversal *t, struct node_list *list,
                                struct umb__node_ref node)
{
    if (!umb__grow(t->order->alloc, &list->nodes, &list->capacity, list->count + 1,
                   sizeof *list->nodes)) {
        return no_memory(t->error);
    }
    list->nodes[list->count++] = node;
    return UMB_OK;
}

/* Lets a node of the next band wait, once. */
static enum umb_status wait_for_next_band(struct traversal *t, struct umb__node_ref child)
{
    if (state_of(t, child) != NOT_MET) {
        return UMB_OK;
    }
    set_state(t, child, WAITS);
    return list_add(t, &t->waiting, child);
}

/* Nodes that are to be visited; the last one first. */
struct stack {
    struct umb__node_ref nodes[STACK_MAX];
    size_t depth;
};

/*
 * Looks at what a node leads to: children that stand nowhere yet and are to be visited in this band
 * go on the stack, but for bricks. Returns what the node will take in the open page, roughly.
 */
static size_t enter(const struct traversal *t, struct umb__node_ref node, struct stack *stack)
{
    const struct umb_octree_level *level = &t->octree->level[node.level];
    const struct umb_octree_level *below = &t->octree->level[node.level - 1];
    const uint32_t first = level->first[node.index], end = level->first[node.index + 1];
    const bool visits = node.level > t->band_low && node.level > UMB_LEVEL_BRICK + 1;
    const enum node_state stands = t->alone ? HERE : BEFORE;
    const size_t depth = stack->depth;
    size_t bytes = umb__node_estimate(end - first);
    /* The stack gives children back in reverse, so the last one goes first. */
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

/* Bricks stand right behind the node above them; what is read of them is asked for together. */
static enum umb_status place_bricks(struct traversal *t, const uint32_t *bricks, uint32_t count)
{
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < count; i++) {
        __builtin_prefetch(t->survey->brick_bytes + bricks[i]);
    }
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        const struct umb__node_ref brick = {UMB_LEVEL_BRICK, bricks[i]};
        status = is_placed(t, brick) ? UMB_OK : place(t, brick, t->survey->brick_bytes[bricks[i]]);
    }
    return status;
}

/* What follows a node besides what is on the stack: bricks, or children that wait. */
static enum umb_status follow(struct traversal *t, struct umb__node_ref node)
{
    const struct umb_octree_level *level = &t->octree->level[node.level];
    const uint32_t *children = level->children + level->first[node.index];
    const uint32_t count = level->first[node.index + 1] - level->first[node.index];
    enum umb_status status = UMB_OK;
    if (node.level == UMB_LEVEL_BRICK + 1) {
        return place_bricks(t, children, count);
    }
    for (uint32_t i = 0; i < count && node.level == t->band_low && status == UMB_OK; i++) {
        status = wait_for_next_band(t, (struct umb__node_ref){node.level - 1, children[i]});
    }
    return status;
}

/* Asks for the states of what a node leads to, which is to be visited next but one. */
static void ask_for_states(const struct traversal *t, struct umb__node_ref node)
{
    const struct umb_octree_level *level = &t->octree->level[node.level];
    for (uint32_t i = level->first[node.index]; i < level->first[node.index + 1]; i++) {
        __builtin_prefetch(t->states[node.level - 1] + level->children[i] / 32);
    }
}

/* Visits a subtree down to the band's lowest level. */
static enum umb_status visit(struct traversal *t, struct umb__node_ref root)
{
    struct stack stack = {.nodes = {root}, .depth = 1};
    enum umb_status status = UMB_OK;
    while (stack.depth > 0 && status == UMB_OK) {
        const struct umb__node_ref node = stack.nodes[--stack.depth];
        if (stack.depth > 0) {
            ask_for_states(t, stack.nodes[stack.depth - 1]);
        }
        if (!is_placed(t, node)) {
            const size_t bytes = enter(t, node, &stack);
            status = place(t, node, bytes);
            status = status == UMB_OK ? follow(t, node) : status;
        }
    }
    return status;
}

/* Visits a root of the band, unless it stands below another one, or is the root of two frusta. */
static enum umb_status visit_root(struct traversal *t, struct umb__node_ref root)
{
    if (state_of(t, root) >= BEFORE) {
        return UMB_OK;
    }
    const enum umb_status status = visit(t, root);
    const bool ends = t->alone && t->page_bytes >= UMB__PAGE_RAW_TARGET;
    return status == UMB_OK && ends ? close_page(t) : status;
}

static enum umb_status visit_band(struct traversal *t, const struct node_list *roots)
{
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < roots->count && status == UMB_OK; i++) {
        status = visit_root(t, roots->nodes[i]);
    }
    return status == UMB_OK ? close_page(t) : status;
}

/* Takes back what the lowest band has placed. */
static void rewind_to(struct traversal *t, uint32_t page_count)
{
    t->order->page_count = page_count;
    for (uint32_t level = UMB_LEVEL_BRICK; level < LOWEST_END; level++) {
        t->next[level] = t->order->begins[level][page_count];
        memset(t->states[level], 0, state_words(t, level) * sizeof *t->states[level]);
    }
}

/* Every how many runs of roots one is visited. */
static size_t sample_step(const struct node_list *roots)
{
    return 1 + roots->count / SAMPLE_ROOTS;
}

static bool is_sampled(size_t root, size_t step)
{
    return root / SAMPLE_RUN % step == 0;
}

/* Visits some runs of the lowest band's roots with copies, and says whether the estimate of their
 * pages is small beside their share of all nodes, each once. */
static enum umb_status try_copies(struct traversal *t, const struct node_list *roots, bool *worth)
{
    const size_t step = sample_step(roots);
    uint64_t own_bytes = 0, sampled = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level < LOWEST_END; level++) {
        own_bytes += t->survey->bytes[level];
    }
    for (size_t i = 0; i < roots->count; i++) {
        sampled += is_sampled(i, step);
    }
    const uint64_t most = /* at most 2^40 bytes, 2^15 roots */
        roots->count == 0 ? 0 : COPIES_MAX_FIFTHS * own_bytes * sampled / (5 * roots->count);
    enum umb_status status = UMB_OK;
    t->copied_bytes = 0;
    for (size_t i = 0; i < roots->count && status == UMB_OK && t->copied_bytes <= most; i++) {
        status = is_sampled(i, step) ? visit_root(t, roots->nodes[i]) : UMB_OK;
        if (status == UMB_OK && is_sampled(i, step) && !is_sampled(i + 1, step)) {
            status = close_page(t);
        }
    }
    status = status == UMB_OK ? close_page(t) : status;
    *worth = t->copied_bytes <= most;
    return status;
}

/* The band of the bricks: with copies of what its trees share, if that costs little. */
static enum umb_status visit_lowest_band(struct traversal *t, const struct node_list *roots)
{
    struct umb__pack_order *order = t->order;
    const uint32_t page_count = order->page_count;
    bool worth;
    t->alone = true;
    enum umb_status status = try_copies(t, roots, &worth);
    if (status != UMB_OK) {
        return status;
    }
    order->alone_from = worth ? page_count : UINT32_MAX;
    if (worth && sample_step(roots) == 1) {
        return UMB_OK; /* all roots were visited */
    }
    rewind_to(t, page_count);
    t->alone = worth;
    return visit_band(t, roots);
}

/* The band's roots: those of frusta, and what the band above ended in. */
static enum umb_status find_roots(struct traversal *t, uint32_t band_high, struct node_list *roots)
{
    enum umb_status status = UMB_OK;
    memset(roots, 0, sizeof *roots);
    for (uint32_t i = 0; i < t->octree->root_count && status == UMB_OK; i++) {
        const struct umb_octree_root *root = &t->octree->roots[i];
        if (root->state == UMB_NODE_MIXED && root->level >= t->band_low &&
            root->level <= band_high) {
            status = list_add(t, roots, (struct umb__node_ref){root->level, root->index});
        }
    }
    for (size_t i = 0; i < t->waiting.count && status == UMB_OK; i++) {
        status = list_add(t, roots, t->waiting.nodes[i]);
    }
    t->waiting.count = 0;
    return status;
}

static enum umb_status visit_bands(struct traversal *t)
{
    enum umb_status status = allocate(t);
    uint32_t band_high = UMB_LEVEL_MAX;
    for (size_t band = 0; band < BAND_COUNT && status == UMB_OK; band++) {
        struct node_list roots;
        t->band_low = band_lows[band];
        status = find_roots(t, band_high, &roots);
        if (status == UMB_OK) {
            status = t->band_low == UMB_LEVEL_BRICK ? visit_lowest_band(t, &roots)
                                                    : visit_band(t, &roots);
        }
        umb__free(t->order->alloc, roots.nodes);
        band_high = t->band_low - 1;
    }
    return status;
}

/* Notes the pages of every 16th ordinal of each level, and of the last. */
static enum umb_status make_hints(struct traversal *t)
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

enum umb_status umb__pack_order(const struct umb_octree *octree, struct umb__pack_order *order,
                                struct umb_error *error)
{
    struct umb__pack_survey survey;
    memset(order, 0, sizeof *order);
    order->alloc = octree->alloc;
    order->alone_from = UINT32_MAX;
    enum umb_status status = umb__pack_survey(octree, &survey, error);
    if (status != UMB_OK) {
        return status;
    }
    memcpy(order->counts, survey.counts, sizeof order->counts);
    struct traversal t = {.octree = octree, .survey = &survey, .order = order, .error = error};
    status = visit_bands(&t);
    status = status == UMB_OK ? make_hints(&t) : status;
    umb__free(order->alloc, t.waiting.nodes);
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(order->alloc, t.states[level]);
    }
    umb__pack_survey_finish(&survey);
    if (status != UMB_OK) {
        umb__pack_order_finish(order);
    }
    return status;
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
