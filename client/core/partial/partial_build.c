/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Builds the lower and the upper asset of partial.h from the held pages. The first step makes a
 * graph: the octree of all held nodes, in which a child in a missing page is UMB__ABSENT | page.
 * The second step makes the lower and the upper octree, in which such a child is a uniform state,
 * and their mapped layouts. Both layouts share their bricks, which are the same.
 */
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "partial/partial_parts.h"

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY,
                    "partial asset: the pages at hand do not fit the "
                    "memory budget");
}

uint32_t umb__partial_page_of(const struct umb_partial *p, uint32_t level, uint32_t index)
{
    /* The page with the node is the last page whose first node of the level does not come after the
     * node. A page without nodes of the level has the same first number as the next page, and
     * stands before that page. */
    uint32_t low = 0, high = p->order_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (p->pages[p->order[middle]].links->first[level] <= index) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return p->order[low];
}

/* Numbers the nodes of all held pages, in the order of the file. */
static enum umb_status number_pages(struct umb_partial *p, uint64_t totals[UMB__LEVELS],
                                    struct umb_error *error)
{
    memset(totals, 0, UMB__LEVELS * sizeof *totals);
    p->order = umb__alloc(&p->alloc, p->held_count, sizeof *p->order);
    if (!p->order) {
        return no_memory(error);
    }
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        struct umb__links *links = p->pages[page].links;
        if (!p->pages[page].stored) {
            continue;
        }
        p->order[p->order_count++] = page;
        for (size_t level = 0; level < UMB__LEVELS; level++) {
            links->first[level] = (uint32_t)totals[level];
            totals[level] += links->count[level];
            if (totals[level] >= UMB__ABSENT) {
                return umb_fail(error, UMB_E_CORRUPT, "pages: one level has 2^31 nodes or more");
            }
        }
    }
    return UMB_OK;
}

/* Allocates the arrays for nodes. Those for children are allocated when their sizes are known. */
static bool allocate_graph(struct umb_partial *p, const uint64_t *totals)
{
    struct umb__octree *g = &p->graph;
    bool ok = true;
    g->alloc = &p->alloc;
    g->brick_count = (uint32_t)totals[UMB_LEVEL_BRICK];
    g->root_count = p->canonical.content.frustum_count;
    g->bricks = umb__alloc_large(&p->alloc, g->brick_count, sizeof *g->bricks);
    g->roots = umb__alloc_zeroed(&p->alloc, g->root_count, sizeof *g->roots);
    for (size_t l = UMB_LEVEL_BRICK + 1; l < UMB__LEVELS; l++) {
        struct umb__octree_level *level = &g->level[l];
        level->masks = umb__alloc(&p->alloc, (size_t)totals[l], sizeof *level->masks);
        level->first = umb__alloc_zeroed(&p->alloc, (size_t)totals[l] + 1, sizeof *level->first);
        level->children = umb__alloc(&p->alloc, 1, sizeof *level->children);
        ok = ok && level->masks && level->first && level->children;
    }
    return ok && g->bricks && g->roots;
}

/* Working memory for filling the graph from one page after another. */
struct filling {
    struct umb_partial *p;
    uint8_t *raw; /* Room for the longest page, uncompressed */
    /* For the nodes in other pages to which one level of a page refers: their numbers in the graph,
     * or UMB__ABSENT | page if that page is missing */
    uint32_t *others;
    uint64_t *leaves; /* Leaves of a page */
    size_t others_capacity, leaves_capacity;
    size_t children_capacity[UMB__LEVELS]; /* Capacities of the graph's children */
};

/* Finds the graph's numbers of the nodes in other pages to which level l of a page refers. Returns
 * false if out of memory. */
static bool read_others(struct filling *f, const struct umb__page *page, uint32_t l)
{
    const struct umb__held *pages = f->p->pages;
    struct umb__page_others others = umb__page_others(page, l);
    if (!umb__grow(&f->p->alloc, &f->others, &f->others_capacity, page->external_count[l],
                   sizeof *f->others)) {
        return false;
    }
    for (uint32_t i = 0; i < page->external_count[l]; i++) {
        const struct umb__node_place place = umb__page_others_next(&others);
        f->others[i] = pages[place.page].stored
                           ? pages[place.page].links->first[l - 1] + place.position
                           : UMB__ABSENT | place.page;
    }
    return true;
}

/* Appends one page's nodes of level l to the graph. Pages are appended in the order of the file.
 * Returns false if out of memory. */
static bool fill_level(struct filling *f, uint32_t number, const struct umb__page *page, uint32_t l)
{
    struct umb__octree_level *level = &f->p->graph.level[l];
    const uint32_t own = f->p->pages[number].links->first[l - 1];
    const uint64_t end = level->first[level->count] + page->child_count[l];
    if (end >= UINT32_MAX || !read_others(f, page, l) ||
        !umb__grow(&f->p->alloc, &level->children, &f->children_capacity[l], (size_t)end,
                   sizeof *level->children)) {
        return false;
    }
    struct umb__page_nodes nodes = umb__page_nodes(page, l);
    for (uint32_t i = 0; i < page->node_count[l]; i++) {
        uint32_t references[8], *children = level->children + level->first[level->count];
        const unsigned count =
            umb__page_nodes_next(&nodes, &level->masks[level->count], references);
        for (unsigned c = 0; c < count; c++) {
            children[c] = references[c] < nodes.own ? own + references[c]
                                                    : f->others[references[c] - nodes.own];
        }
        level->first[level->count + 1] = level->first[level->count] + count;
        level->count++;
    }
    return true;
}

/* Adds one page's bricks to the graph. False: out of memory. */
static bool fill_bricks(struct filling *f, uint32_t number, const struct umb__page *page)
{
    uint64_t(*bricks)[8] = f->p->graph.bricks + f->p->pages[number].links->first[UMB_LEVEL_BRICK];
    if (!umb__grow(&f->p->alloc, &f->leaves, &f->leaves_capacity, page->leaf_count,
                   sizeof *f->leaves)) {
        return false;
    }
    umb__page_leaves(page, f->leaves);
    struct umb__page_bricks reader = umb__page_bricks(page, f->leaves);
    for (uint32_t i = 0; i < page->node_count[UMB_LEVEL_BRICK]; i++) {
        umb__page_bricks_next(&reader, bricks[i]);
    }
    return true;
}

static enum umb_status fill_page(struct filling *f, uint32_t number, struct umb_error *error)
{
    const struct umb_partial *p = f->p;
    const struct umb__page_entry entry = umb__directory_load(&p->head, number);
    struct umb__page page;
    UMB__TRY(umb__page_expand(p->zstd, p->pages[number].stored, &entry, f->raw, error));
    UMB__TRY(umb__page_open(f->raw, &entry, &page, error));
    bool filled = fill_bricks(f, number, &page);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX && filled; l++) {
        filled = fill_level(f, number, &page, l);
    }
    return filled ? UMB_OK : no_memory(error);
}

static enum umb_status fill_graph(struct umb_partial *p, struct umb_error *error)
{
    struct filling f = {.p = p};
    uint32_t longest = 1;
    for (uint32_t i = 0; i < p->order_count; i++) {
        uint32_t length = umb__directory_load(&p->head, p->order[i]).raw_length;
        longest = length > longest ? length : longest;
    }
    f.raw = umb__alloc(&p->alloc, longest, 1);
    enum umb_status status = f.raw ? UMB_OK : no_memory(error);
    for (uint32_t i = 0; i < p->order_count && status == UMB_OK; i++) {
        status = fill_page(&f, p->order[i], error);
    }
    umb__free(&p->alloc, f.raw);
    umb__free(&p->alloc, f.others);
    umb__free(&p->alloc, f.leaves);
    return status;
}

static void place_roots(struct umb_partial *p)
{
    for (uint32_t i = 0; i < p->graph.root_count; i++) {
        const struct umb__packed_root *packed = &p->canonical.roots[i];
        struct umb__octree_root *root = &p->graph.roots[i];
        root->state = (enum umb__node_state)packed->state;
        root->level = p->canonical.content.frusta[i].log2_size;
        if (root->state == UMB__NODE_MIXED) {
            root->index = p->pages[packed->page].stored
                              ? p->pages[packed->page].links->first[root->level] + packed->position
                              : UMB__ABSENT | packed->page;
        }
    }
}

static enum umb_status build_graph(struct umb_partial *p, struct umb_error *error)
{
    uint64_t totals[UMB__LEVELS];
    UMB__TRY(number_pages(p, totals, error));
    if (!allocate_graph(p, totals)) {
        return no_memory(error);
    }
    UMB__TRY(fill_graph(p, error));
    place_roots(p);
    for (size_t l = UMB_LEVEL_BRICK + 1; l < UMB__LEVELS; l++) {
        p->seen[l] = umb__alloc(&p->alloc, p->graph.level[l].count, sizeof *p->seen[l]);
        if (!p->seen[l]) {
            return no_memory(error);
        }
    }
    return UMB_OK;
}

/* Makes one level of an octree from the graph's level; children in missing pages become uniform
 * with the given `state`. Returns false if out of memory. */
static bool settle_level(struct umb_partial *p, const struct umb__octree_level *from,
                         enum umb__node_state state, struct umb__octree_level *to)
{
    to->masks = umb__alloc(&p->alloc, from->count, sizeof *to->masks);
    to->first = umb__alloc_zeroed(&p->alloc, (size_t)from->count + 1, sizeof *to->first);
    to->children = umb__alloc(&p->alloc, from->first[from->count], sizeof *to->children);
    if (!to->masks || !to->first || !to->children) {
        return false;
    }
    to->count = from->count;
    uint32_t next = 0;
    for (uint32_t node = 0; node < from->count; node++) {
        const uint32_t *child = from->children + from->first[node];
        uint16_t mask = from->masks[node];
        for (unsigned c = 0; c < 8; c++) {
            if (umb__mask_state(mask, c) != UMB__NODE_MIXED) {
                continue;
            }
            if (*child & UMB__ABSENT) {
                mask = (uint16_t)((mask & ~(3U << (2 * c))) | (unsigned)state << (2 * c));
            } else {
                to->children[next++] = *child;
            }
            child++;
        }
        to->masks[node] = mask;
        to->first[node + 1] = next;
    }
    return true;
}

/* Makes the mapped layout of the graph, in which children in missing pages are uniform with the
 * given `state`. In: bricks: the layout takes them over; NULL for a layout that will share the
 * other's bricks. */
static enum umb_status lay_out(struct umb_partial *p, enum umb__node_state state,
                               uint64_t (*bricks)[8], struct umb__mapped *mapped,
                               struct umb_error *error)
{
    struct umb__octree octree = {.alloc = &p->alloc,
                                 .brick_count = p->graph.brick_count,
                                 .bricks = bricks,
                                 .root_count = p->graph.root_count};
    octree.roots = umb__alloc(&p->alloc, octree.root_count, sizeof *octree.roots);
    bool ok = octree.roots != NULL;
    for (size_t l = UMB_LEVEL_BRICK + 1; l < UMB__LEVELS && ok; l++) {
        ok = settle_level(p, &p->graph.level[l], state, &octree.level[l]);
    }
    enum umb_status status = UMB_E_NO_MEMORY;
    if (ok) {
        memcpy(octree.roots, p->graph.roots, octree.root_count * sizeof *octree.roots);
        for (uint32_t i = 0; i < octree.root_count; i++) {
            struct umb__octree_root *root = &octree.roots[i];
            if (root->state == UMB__NODE_MIXED && (root->index & UMB__ABSENT)) {
                root->state = state;
                root->index = 0;
            }
        }
        status = umb__mapped_build(&octree, &p->canonical.content, p->meter.limit, mapped, error);
    }
    umb__octree_finish(&octree);
    return status == UMB_OK ? UMB_OK : no_memory(error);
}

/* Makes an asset for queries from a layout. The partial asset still owns content and id. */
static void init_view(const struct umb_partial *p, struct umb_asset *asset)
{
    asset->alloc = &p->alloc;
    asset->canonical = p->canonical;
    asset->view = asset->mapped.view;
    asset->notes = (char *)(uintptr_t) "";
    asset->encoding = UMB_ENCODING_PACKED;
    asset->file_bytes = p->head.file_length;
    memcpy(asset->id, p->head.id, UMB_ID_BYTES);
}

static enum umb_status try_build(struct umb_partial *p, struct umb_error *error)
{
    umb__partial_unbuild(p);
    UMB__TRY(build_graph(p, error));
    uint64_t(*bricks)[8] = p->graph.bricks;
    p->graph.bricks = NULL;
    UMB__TRY(lay_out(p, UMB__NODE_SHADOWED, bricks, &p->lower.mapped, error));
    UMB__TRY(lay_out(p, UMB__NODE_LIT, NULL, &p->upper.mapped, error));
    p->upper.mapped.view.bricks = p->lower.mapped.view.bricks;
    init_view(p, &p->lower);
    init_view(p, &p->upper);
    p->built = true;
    p->builds++;
    return UMB_OK;
}

/* Drops the pages of the least benefit, about an eighth of the bytes. */
static void shed(struct umb_partial *p)
{
    const uint64_t goal = p->held_bytes - p->held_bytes / 8;
    do {
        umb_partial_drop(p, umb__partial_worst(p));
        p->dropped++;
    } while (p->held_count > 0 && p->held_bytes > goal);
}

enum umb_status umb_partial_build(struct umb_partial *p, struct umb_error *error)
{
    enum umb_status status = try_build(p, error);
    while (status == UMB_E_NO_MEMORY &&
           p->held_count > 0) { /* Ends, since each round drops a page */
        umb__partial_unbuild(p);
        shed(p);
        status = try_build(p, error);
    }
    if (status != UMB_OK) {
        umb__partial_unbuild(p);
    }
    return status;
}
