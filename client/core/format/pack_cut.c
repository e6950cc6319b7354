/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See pack_cut.h. The levels are cut from the bottom up. The sum of the children's estimates is a
 * bound of a piece; only where it exceeds a page, the piece is walked to count shared nodes once.
 * The nodes of a level do not depend on each other, so helpers share them.
 */
#include "format/pack_cut.h"

#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"
#include "format/pack_kept.h"

#define LINK_BYTES  2U    /* Estimated bytes of a child in another page */
#define SMALL_BYTES 256U  /* Most bytes of whole pieces that stay with a coarse node */
#define JOB_NODES   4096U /* Nodes of one level that a helper takes at a time */
#define HELPERS_MAX 64U

#define COARSE 0x80000000U /* Flag of a sum */

/* A node takes at least 2 of a page's bytes, so slots for that many nodes are at most half full. A
 * page and the piece that does not fit any more have at most twice the bytes of a page. */
#define SLOTS_LOG2_MIN 14U

/* Place of the number of the page in a slot: levels have 5 bits, numbers of nodes 32. */
#define MET_PAGE ((uint64_t)1 << 37)

/* Working memory of one helper. */
struct cutter {
    /* [1 << slots_log2] The nodes of the open page, by open addressing: number of the page, level,
     * number of the node. Slots of earlier pages are free, so that no page clears them. */
    uint64_t *slots;
    unsigned slots_log2;
    uint64_t page;       /* Number of the open page times MET_PAGE */
    uint64_t page_bytes; /* Estimated bytes of all pages cut so far */
    size_t met;          /* Number of nodes in the open page */
    bool is_full;        /* True: half of the slots are taken. Only false sums of kept cuts lead to
                            a page of so many nodes. */
};

struct cutting {
    struct umb__pack_cuts *cuts;
    const struct umb__octree *octree;
    const struct umb__pack_survey *survey;
    const struct umb__pack_kept *kept; /* NULL: nothing is kept for pages of this size */
    struct cutter cutters[HELPERS_MAX];
    unsigned helpers;
    uint32_t level;      /* Level that the helpers cut */
    uint64_t once;       /* Estimated bytes of all nodes, each once */
    uint64_t most_bytes; /* Estimated bytes of all pages above which the cut is given up */
};

static uint32_t children_of(const struct cutting *c, uint32_t level, uint32_t node,
                            const uint32_t **children)
{
    const struct umb__octree_level *nodes = &c->octree->level[level];
    *children = nodes->children + nodes->first[node];
    return nodes->first[node + 1] - nodes->first[node];
}

/* Adds a node to the open page. Returns false if the page has it already, or is full. */
static bool meet(struct cutter *cutter, uint32_t level, uint32_t node)
{
    const uint64_t key = cutter->page | (uint64_t)level << 32 | node;
    const size_t last = ((size_t)1 << cutter->slots_log2) - 1;
    size_t at =
        (size_t)(((key & (MET_PAGE - 1)) * 0x9e3779b97f4a7c15ULL) >> (64 - cutter->slots_log2));
    for (; cutter->slots[at] >= cutter->page; at = (at + 1) & last) {
        if (cutter->slots[at] == key) {
            return false;
        }
    }
    if (cutter->met > last / 2) {
        cutter->is_full = true;
        return false;
    }
    cutter->met++;
    cutter->slots[at] = key;
    return true;
}

/* Adds a node's piece to the open page. Returns the estimated bytes that this adds. The depth of
 * the recursion is that of the tree. */
static uint32_t add_piece(const struct cutting *c, struct cutter *cutter, uint32_t level,
                          uint32_t node)
{
    const uint32_t *children;
    if (!meet(cutter, level, node)) {
        return 0;
    }
    if (level == UMB_LEVEL_BRICK) {
        return c->survey->brick_bytes[node];
    }
    const uint32_t count = children_of(c, level, node, &children);
    const uint32_t parts = umb__pack_parts(c->cuts, level, node);
    uint32_t bytes = umb__pack_node_estimate(count);
    for (uint32_t i = 0; i < count; i++) {
        bytes +=
            umb__part_of(parts, i) != 0 ? LINK_BYTES : add_piece(c, cutter, level - 1, children[i]);
    }
    return bytes;
}

/* Begins a page. */
static void begin_page(struct cutter *cutter)
{
    cutter->page += MET_PAGE;
    cutter->met = 0;
    if (cutter->page == 0) { /* The numbers are used up: the slots must be cleared once */
        memset(cutter->slots, 0, sizeof *cutter->slots << cutter->slots_log2);
        cutter->page = MET_PAGE;
    }
}

static uint32_t sum_of(const struct cutting *c, uint32_t level, uint32_t node)
{
    return level == UMB_LEVEL_BRICK ? c->survey->brick_bytes[node] : c->cuts->sums[level][node];
}

/* The pages of a node that is cut. */
struct division {
    uint32_t parts, part_count;
    uint64_t bytes; /* Estimated bytes of these pages */
    uint32_t open;  /* Those of the last page */
};

/* Adds the whole or the coarse children of a node to its pages, in their order. The memory is there
 * already. */
static void divide(const struct cutting *c, struct cutter *cutter, uint32_t level, uint32_t node,
                   bool coarse, struct division *division)
{
    const uint32_t *children;
    const uint32_t count = children_of(c, level, node, &children);
    uint32_t page = 0;
    for (uint32_t i = 0; i < count; i++) {
        const bool is_coarse =
            level - 1 > UMB_LEVEL_BRICK && (sum_of(c, level - 1, children[i]) & COARSE) != 0;
        if (is_coarse != coarse) {
            continue;
        }
        uint32_t more = page > 0 ? add_piece(c, cutter, level - 1, children[i]) : 0;
        if (page == 0 || page + more > c->cuts->page_bytes) {
            begin_page(cutter);
            division->part_count++;
            division->bytes += page;
            page = 0;
            more = add_piece(c, cutter, level - 1, children[i]);
        }
        page += more;
        division->parts |= division->part_count << 4 * i;
    }
    division->bytes += page;
    division->open = page;
}

/* Sums the bounds of the whole or of the coarse children of a node. */
static uint32_t sum_children(const struct cutting *c, uint32_t level, uint32_t node, uint32_t flag)
{
    const uint32_t *children;
    const uint32_t count = children_of(c, level, node, &children);
    uint32_t bytes = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t sum = sum_of(c, level - 1, children[i]);
        bytes += (sum & COARSE) == flag ? sum & ~COARSE : 0;
    }
    return bytes;
}

static uint32_t coarse_children(const struct cutting *c, uint32_t level, uint32_t node)
{
    const uint32_t *children;
    const uint32_t count = children_of(c, level, node, &children);
    uint32_t coarse = 0;
    for (uint32_t i = 0; i < count; i++) {
        coarse += (sum_of(c, level - 1, children[i]) & COARSE) != 0;
    }
    return coarse;
}

/* Cuts a node, if it must be, and bounds its piece. */
static void cut_node(const struct cutting *c, struct cutter *cutter, uint32_t level, uint32_t node)
{
    const uint32_t *children, most = c->cuts->page_bytes;
    const uint32_t count = children_of(c, level, node, &children);
    const uint32_t own = umb__pack_node_estimate(count);
    const bool above = level >= UMB__CUT_LOWEST && coarse_children(c, level, node) > 0;
    uint32_t whole = sum_children(c, level, node, 0);
    struct division division = {0};
    if (!above && own + whole > most && level >= UMB__CUT_LOWEST) {
        divide(c, cutter, level, node, false, &division);
        if (division.part_count == 1 && own + division.open <= most) {
            whole = division.open;
            division = (struct division){0};
        }
    } else if (above && whole > SMALL_BYTES) {
        divide(c, cutter, level, node, false, &division);
    }
    uint32_t bytes = own + (division.part_count > 0 ? LINK_BYTES * count : whole);
    if (above || division.part_count > 0) {
        const uint32_t coarse = sum_children(c, level, node, COARSE);
        if (bytes + coarse > most) {
            divide(c, cutter, level, node, true, &division);
            bytes = own + LINK_BYTES * count + (whole > SMALL_BYTES ? 0 : whole);
        } else {
            bytes += coarse;
        }
        bytes |= COARSE;
    }
    if (level >= UMB__CUT_LOWEST) {
        c->cuts->parts[level][node] = division.parts;
        c->cuts->bytes[level][node] = (uint32_t)division.bytes;
    }
    cutter->page_bytes += division.bytes;
    c->cuts->sums[level][node] = bytes;
}

/* Returns the number of the first node whose cuts are not kept. */
static uint32_t first_node(const struct cutting *c, uint32_t level)
{
    return c->kept ? c->kept->counts[level] : 0;
}

/* Returns true if a node may have these parts: each child has none or one of them, and each of them
 * has a child. */
static bool are_parts(uint32_t parts, uint32_t children)
{
    const uint32_t count = umb__part_count(parts);
    uint32_t seen = 0;
    for (uint32_t i = 0; i < children; i++) {
        seen |= 1U << umb__part_of(parts, i);
    }
    return (children == 8 || parts >> 4 * children == 0) && (seen | 1U) == (2U << count) - 1;
}

/* Takes over the cuts of the nodes that are kept. Returns false if a node cannot have its parts. */
static bool take_kept(struct cutting *c, uint32_t level)
{
    const uint32_t *children, count = first_node(c, level);
    if (count > 0) {
        memcpy(c->cuts->sums[level], c->kept->sums[level], count * sizeof(uint32_t));
    }
    if (count > 0 && level >= UMB__CUT_LOWEST) {
        memcpy(c->cuts->parts[level], c->kept->parts[level], count * sizeof(uint32_t));
        memcpy(c->cuts->bytes[level], c->kept->bytes[level], count * sizeof(uint32_t));
        for (uint32_t node = 0; node < count; node++) {
            c->cutters[0].page_bytes += c->kept->bytes[level][node];
            if (!are_parts(c->kept->parts[level][node], children_of(c, level, node, &children))) {
                return false;
            }
        }
    }
    return true;
}

/* Cuts some of the level's nodes, unless this helper's pages alone exceed the limit. */
static void cut_job(void *user, uint32_t job, unsigned worker)
{
    struct cutting *c = user;
    if (c->cutters[worker].page_bytes > c->most_bytes || c->cutters[worker].is_full) {
        return;
    }
    const uint32_t first = first_node(c, c->level) + job * JOB_NODES;
    const uint32_t left = c->octree->level[c->level].count - first;
    const uint32_t count = left < JOB_NODES ? left : JOB_NODES;
    for (uint32_t node = first; node < first + count; node++) {
        if (umb__pack_reached(c->survey, c->level, node)) {
            cut_node(c, &c->cutters[worker], c->level, node);
        }
    }
}

/* Returns the estimated bytes of all pages cut so far. */
static uint64_t page_bytes(const struct cutting *c)
{
    uint64_t bytes = 0;
    for (unsigned i = 0; i < c->helpers; i++) {
        bytes += c->cutters[i].page_bytes;
    }
    return bytes;
}

/* Returns true if a page of any helper took more nodes than a page has. */
static bool is_full(const struct cutting *c)
{
    bool full = false;
    for (unsigned i = 0; i < c->helpers; i++) {
        full = full || c->cutters[i].is_full;
    }
    return full;
}

/* Cuts level after level. Pages are only ever added, so once they exceed the limit the result is
 * known, and the levels above are left out. Returns false if the cuts that are kept are false. */
static bool cut_levels(struct cutting *c, const struct umb_workers *workers)
{
    for (c->level = UMB_LEVEL_BRICK + 1;
         c->level <= UMB_LEVEL_MAX && page_bytes(c) <= c->most_bytes; c->level++) {
        if (is_full(c) || !take_kept(c, c->level)) {
            return false;
        }
        const uint32_t count = c->octree->level[c->level].count - first_node(c, c->level);
        const uint32_t jobs = count / JOB_NODES + (count % JOB_NODES > 0);
        if (workers && jobs > 1) {
            workers->run(workers->user, cut_job, c, jobs);
        }
        for (uint32_t job = 0; job < jobs && (!workers || jobs == 1); job++) {
            cut_job(c, job, 0);
        }
    }
    return !is_full(c);
}

/* Divides the mixed roots into pages, in the order of the frusta. Roots without a page between them
 * are of one page, too. */
static void cut_roots(struct cutting *c)
{
    struct umb__pack_cuts *cuts = c->cuts;
    struct cutter *cutter = &c->cutters[0];
    uint32_t page = 0;
    cuts->top_count = 0;
    for (uint32_t i = 0; i < c->octree->root_count; i++) {
        const struct umb__octree_root *root = &c->octree->roots[i];
        if (root->state != UMB__NODE_MIXED) {
            continue;
        }
        uint32_t more = page > 0 ? add_piece(c, cutter, root->level, root->index) : 0;
        if (page == 0 || page + more > cuts->page_bytes) {
            begin_page(cutter);
            cutter->page_bytes += page;
            page = 0;
            more = add_piece(c, cutter, root->level, root->index);
            cuts->tops[cuts->top_count++] = (struct umb__pack_page){.node = i};
        }
        page += more;
        struct umb__pack_page *top = &cuts->tops[cuts->top_count - 1];
        top->part = i + 1 - top->node;
    }
    cutter->page_bytes += page;
}

static bool allocate(struct cutting *c)
{
    struct umb__pack_cuts *cuts = c->cuts;
    cuts->tops = umb__alloc(cuts->alloc, (size_t)c->octree->root_count + 1, sizeof *cuts->tops);
    bool complete = cuts->tops != NULL;
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX && complete; level++) {
        const size_t count = (size_t)c->octree->level[level].count + 1;
        cuts->sums[level] = umb__alloc(cuts->alloc, count, sizeof *cuts->sums[level]);
        complete = cuts->sums[level] != NULL;
        if (level >= UMB__CUT_LOWEST && complete) {
            c->cuts->parts[level] =
                umb__alloc_zeroed(c->cuts->alloc, count, sizeof *c->cuts->parts[level]);
            cuts->bytes[level] = umb__alloc_zeroed(cuts->alloc, count, sizeof *cuts->bytes[level]);
            complete = cuts->parts[level] != NULL && cuts->bytes[level] != NULL;
        }
    }
    return complete;
}

/* Makes room for the nodes of pages of page_bytes. */
static bool begin_cutters(struct cutting *c, uint32_t page_bytes)
{
    const struct umb_alloc *alloc = c->cuts->alloc;
    unsigned log2 = SLOTS_LOG2_MIN;
    while (((size_t)1 << log2) < 2 * (size_t)page_bytes) {
        log2++;
    }
    for (unsigned i = 0; i < c->helpers; i++) {
        umb__free(alloc, c->cutters[i].slots);
        c->cutters[i] = (struct cutter){
            .slots = umb__alloc_zeroed(alloc, (size_t)1 << log2, sizeof(uint64_t)),
            .slots_log2 = log2,
        };
        if (!c->cutters[i].slots) {
            return false;
        }
    }
    return true;
}

/* Cuts the octree into pages of at most `most` bytes. With a limit of copies, the cut is given up
 * as soon as it exceeds the limit. */
static enum umb_status cut_all(struct cutting *c, const struct umb_workers *workers,
                               const struct umb__pack_kept *kept, uint32_t most, double copies_max,
                               struct umb_error *error)
{
    struct umb__pack_cuts *cuts = c->cuts;
    c->kept = kept && kept->page_bytes == most ? kept : NULL;
    cuts->page_bytes = most;
    c->most_bytes = copies_max > 0.0 ? (uint64_t)(copies_max * (double)c->once) : UINT64_MAX;
    if (!begin_cutters(c, most)) {
        return umb__pack_no_memory(error);
    }
    bool true_cuts = cut_levels(c, workers);
    if (true_cuts && page_bytes(c) <= c->most_bytes) {
        cut_roots(c);
        true_cuts = !is_full(c);
    }
    if (!true_cuts) {
        return umb_fail(error, UMB_E_CORRUPT, "kept pages: cuts that no octree has");
    }
    const uint64_t bytes = page_bytes(c);
    cuts->copies = c->once > 0 && bytes > c->once ? (double)bytes / (double)c->once : 1.0;
    return UMB_OK;
}

enum umb_status umb__pack_cut(const struct umb__octree *octree,
                              const struct umb__pack_survey *survey,
                              const struct umb_workers *workers, uint32_t most,
                              const struct umb__pack_kept *kept, struct umb__pack_cuts *cuts,
                              struct umb_error *error)
{
    const struct umb_alloc *alloc = octree->alloc;
    *cuts = (struct umb__pack_cuts){.octree = octree, .alloc = alloc};
    workers = workers && workers->count <= HELPERS_MAX ? workers : NULL;
    struct cutting *c = umb__alloc_zeroed(alloc, 1, sizeof *c);
    if (!c) {
        return umb__pack_no_memory(error);
    }
    c->cuts = cuts;
    c->octree = octree;
    c->survey = survey;
    c->helpers = workers ? workers->count : 1;
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        c->once += survey->bytes[level];
    }
    enum umb_status status = allocate(c) ? UMB_OK : umb__pack_no_memory(error);
    if (status == UMB_OK && most > 0) {
        status = cut_all(c, workers, kept, most, 0.0, error);
    } else if (status == UMB_OK) {
        status = cut_all(c, workers, kept, UMB__PAGE_BYTES, UMB__PAGE_COPIES_MAX, error);
        if (status == UMB_OK && cuts->copies > UMB__PAGE_COPIES_MAX) {
            status = cut_all(c, workers, kept, UMB__PAGE_BYTES_SHARED, 0.0, error);
        }
    }
    for (unsigned i = 0; i < c->helpers; i++) {
        umb__free(alloc, c->cutters[i].slots);
    }
    umb__free(alloc, c);
    return status;
}

void umb__pack_cuts_finish(struct umb__pack_cuts *cuts)
{
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(cuts->alloc, cuts->parts[level]);
        umb__free(cuts->alloc, cuts->bytes[level]);
        umb__free(cuts->alloc, cuts->sums[level]);
    }
    umb__free(cuts->alloc, cuts->tops);
    memset(cuts, 0, sizeof *cuts);
}
