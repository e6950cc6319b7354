/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_PARTIAL_ORACLE_BUILD_H
#define UMBRAGE_TESTS_PARTIAL_ORACLE_BUILD_H
/* Both assets of the oracle, made anew; see partial_oracle.h. */
#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/directory.h"
#include "format/mapped.h"
#include "partial/partial_parts.h"

/* Flag of a graph's child that is in a missing page; the other bits are the page's number. */
#define UMB__ABSENT 0x80000000U

struct oracle {
    const struct umb_partial *part;
    uint32_t (*first)[UMB__LEVELS]; /* [page] Numbers in the graph of a held page's first nodes */
    double *benefit;                /* [page] Marks */
    struct umb__octree graph; /* Without bricks; children and roots may be UMB__ABSENT | page */
    uint32_t *order;          /* [order_count] Pages in the graph, ascending */
    uint32_t order_count;
    float *seen[UMB__LEVELS];     /* Greatest benefit of a whole cube of each node */
    uint8_t *closed[UMB__LEVELS]; /* 1: everything below the node is in its page */
    bool walks_all; /* True: a want also walks below nodes whose whole tree is in one page */
    bool met_bound; /* True: the last want met the bound of its steps */
    struct umb_asset lower, upper;
};

/* Frees the last build; marks stay. */
static inline void oracle_unbuild(struct oracle *p)
{
    umb__mapped_finish(&p->upper.mapped); /* Its bricks belong to the lower asset */
    umb__mapped_finish(&p->lower.mapped);
    for (size_t level = 0; level < UMB__LEVELS; level++) {
        umb__free(NULL, p->seen[level]);
        umb__free(NULL, p->closed[level]);
        p->seen[level] = NULL;
        p->closed[level] = NULL;
    }
    umb__octree_finish(&p->graph);
    umb__free(NULL, p->order);
    p->order = NULL;
    p->order_count = 0;
    const uint32_t pages = p->part->head.page_count;
    p->first = p->first ? p->first : umb__alloc_zeroed(NULL, pages + 1, sizeof *p->first);
    p->benefit = p->benefit ? p->benefit : umb__alloc_zeroed(NULL, pages + 1, sizeof *p->benefit);
}

static inline void oracle_finish(struct oracle *p)
{
    oracle_unbuild(p);
    umb__free(NULL, p->first);
    umb__free(NULL, p->benefit);
}

static inline enum umb_status oracle_no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "oracle: out of memory");
}

static inline uint32_t oracle_page_of(const struct oracle *p, uint32_t level, uint32_t index)
{
    /* The wanted page is the last one whose first node of the level is not behind the node. A page
     * without nodes of the level has the same first number as the next page, and stands before that
     * page. */
    uint32_t low = 0, high = p->order_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (p->first[p->order[middle]][level] <= index) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return p->order[low];
}

/* Numbers the nodes of all held pages, in the order of the file. */
static inline enum umb_status number_pages(struct oracle *p, uint64_t totals[UMB__LEVELS],
                                           struct umb_error *error)
{
    memset(totals, 0, UMB__LEVELS * sizeof *totals);
    p->order = umb__alloc(NULL, p->part->held_count, sizeof *p->order);
    if (!p->order) {
        return oracle_no_memory(error);
    }
    for (uint32_t page = 0; page < p->part->head.page_count; page++) {
        if (!p->part->pages[page].stored) {
            continue;
        }
        p->order[p->order_count++] = page;
        for (size_t level = 0; level < UMB__LEVELS; level++) {
            p->first[page][level] = (uint32_t)totals[level];
            totals[level] += p->part->pages[page].links->count[level];
            if (totals[level] >= UMB__ABSENT) {
                return umb_fail(error, UMB_E_CORRUPT, "pages: one level has 2^31 nodes or more");
            }
        }
    }
    return UMB_OK;
}

/* Allocates the arrays for nodes. Those for children are allocated when their sizes are known. */
static inline bool allocate_graph(struct oracle *p, const uint64_t *totals)
{
    struct umb__octree *g = &p->graph;
    bool ok = true;
    g->brick_count = (uint32_t)totals[UMB_LEVEL_BRICK];
    g->root_count = p->part->canonical.content.frustum_count;
    g->bricks = umb__alloc_large(NULL, g->brick_count, sizeof *g->bricks);
    g->roots = umb__alloc_zeroed(NULL, g->root_count, sizeof *g->roots);
    for (size_t l = UMB_LEVEL_BRICK + 1; l < UMB__LEVELS; l++) {
        struct umb__octree_level *level = &g->level[l];
        level->masks = umb__alloc(NULL, (size_t)totals[l], sizeof *level->masks);
        level->first = umb__alloc_zeroed(NULL, (size_t)totals[l] + 1, sizeof *level->first);
        level->children = umb__alloc(NULL, 1, sizeof *level->children);
        ok = ok && level->masks && level->first && level->children;
    }
    return ok && g->bricks && g->roots;
}

/* Working memory for filling the graph from one page after another. */
struct filling {
    struct oracle *p;
    uint8_t *raw; /* Room for the longest page, uncompressed */
    /* Numbers in the graph of the nodes of other pages to which a page's level refers; UMB__ABSENT
     * | page if that page is missing */
    uint32_t *others;
    uint64_t *leaves; /* Leaves of a page */
    size_t others_capacity, leaves_capacity;
    size_t children_capacity[UMB__LEVELS]; /* Capacities of the graph's children */
};

/* Finds the graph's numbers of the nodes in other pages to which level l of a page refers. Returns
 * false if out of memory. */
static inline bool read_others(struct filling *f, const struct umb__page *page, uint32_t l)
{
    const struct umb__held *pages = f->p->part->pages;
    struct umb__page_others others = umb__page_others(page, l);
    if (!umb__grow(NULL, &f->others, &f->others_capacity, page->external_count[l],
                   sizeof *f->others)) {
        return false;
    }
    for (uint32_t i = 0; i < page->external_count[l]; i++) {
        const struct umb__node_place place = umb__page_others_next(&others);
        f->others[i] = pages[place.page].stored ? f->p->first[place.page][l - 1] + place.position
                                                : UMB__ABSENT | place.page;
    }
    return true;
}

/* Appends one page's nodes of level l to the graph. Pages are appended in the order of the file.
 * Returns false if out of memory. */
static inline bool fill_level(struct filling *f, uint32_t number, const struct umb__page *page,
                              uint32_t l)
{
    struct umb__octree_level *level = &f->p->graph.level[l];
    const uint32_t own = f->p->first[number][l - 1];
    const uint64_t end = level->first[level->count] + page->child_count[l];
    if (end >= UINT32_MAX || !read_others(f, page, l) ||
        !umb__grow(NULL, &level->children, &f->children_capacity[l], (size_t)end,
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
static inline bool fill_bricks(struct filling *f, uint32_t number, const struct umb__page *page)
{
    uint64_t(*bricks)[8] = f->p->graph.bricks + f->p->first[number][UMB_LEVEL_BRICK];
    if (!umb__grow(NULL, &f->leaves, &f->leaves_capacity, page->leaf_count, sizeof *f->leaves)) {
        return false;
    }
    umb__page_leaves(page, f->leaves);
    struct umb__page_bricks reader = umb__page_bricks(page, f->leaves);
    for (uint32_t i = 0; i < page->node_count[UMB_LEVEL_BRICK]; i++) {
        umb__page_bricks_next(&reader, bricks[i]);
    }
    return true;
}

static inline enum umb_status fill_page(struct filling *f, uint32_t number, struct umb_error *error)
{
    const struct oracle *p = f->p;
    struct umb__page_entry entry = umb__directory_load(&p->part->head, number);
    umb__directory_links(&p->part->head, &entry, NULL);
    struct umb__page page;
    UMB__TRY(umb__page_expand(p->part->zstd, p->part->pages[number].stored, &entry, f->raw, error));
    UMB__TRY(umb__page_open(f->raw, &entry, &page, error));
    bool filled = fill_bricks(f, number, &page);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX && filled; l++) {
        filled = fill_level(f, number, &page, l);
    }
    return filled ? UMB_OK : oracle_no_memory(error);
}

static inline enum umb_status fill_graph(struct oracle *p, struct umb_error *error)
{
    struct filling f = {.p = p};
    uint32_t longest = 1;
    for (uint32_t i = 0; i < p->order_count; i++) {
        uint32_t length = umb__directory_load(&p->part->head, p->order[i]).raw_length;
        longest = length > longest ? length : longest;
    }
    f.raw = umb__alloc(NULL, longest, 1);
    enum umb_status status = f.raw ? UMB_OK : oracle_no_memory(error);
    for (uint32_t i = 0; i < p->order_count && status == UMB_OK; i++) {
        status = fill_page(&f, p->order[i], error);
    }
    umb__free(NULL, f.raw);
    umb__free(NULL, f.others);
    umb__free(NULL, f.leaves);
    return status;
}

static inline void place_roots(struct oracle *p)
{
    for (uint32_t i = 0; i < p->graph.root_count; i++) {
        const struct umb__packed_root *packed = &p->part->canonical.roots[i];
        struct umb__octree_root *root = &p->graph.roots[i];
        root->state = (enum umb__node_state)packed->state;
        root->level = p->part->canonical.content.frusta[i].log2_size;
        if (root->state == UMB__NODE_MIXED) {
            root->index = p->part->pages[packed->page].stored
                              ? p->first[packed->page][root->level] + packed->position
                              : UMB__ABSENT | packed->page;
        }
    }
}

/* Finds the nodes of a level below which everything is in their page. */
static inline bool find_closed(struct oracle *p, uint32_t l)
{
    const struct umb__octree_level *level = &p->graph.level[l];
    p->closed[l] = umb__alloc_zeroed(NULL, level->count, 1);
    for (uint32_t i = 0; i < level->count && p->closed[l]; i++) {
        uint8_t closed = 1;
        for (uint32_t c = level->first[i]; c < level->first[i + 1]; c++) {
            const uint32_t child = level->children[c];
            closed &= !(child & UMB__ABSENT) &&
                      oracle_page_of(p, l - 1, child) == oracle_page_of(p, l, i) &&
                      (l - 1 == UMB_LEVEL_BRICK || p->closed[l - 1][child]);
        }
        p->closed[l][i] = closed;
    }
    return p->closed[l] != NULL;
}

static inline enum umb_status build_graph(struct oracle *p, struct umb_error *error)
{
    uint64_t totals[UMB__LEVELS];
    UMB__TRY(number_pages(p, totals, error));
    if (!allocate_graph(p, totals)) {
        return oracle_no_memory(error);
    }
    UMB__TRY(fill_graph(p, error));
    place_roots(p);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l < UMB__LEVELS; l++) {
        p->seen[l] = umb__alloc(NULL, p->graph.level[l].count, sizeof *p->seen[l]);
        if (!p->seen[l] || !find_closed(p, l)) {
            return oracle_no_memory(error);
        }
    }
    return UMB_OK;
}

/* Makes one level of an octree from the graph's level; absent children get `state`. Returns false
 * if out of memory. */
static inline bool settle_level(const struct umb__octree_level *from, enum umb__node_state state,
                                struct umb__octree_level *to)
{
    to->masks = umb__alloc(NULL, from->count, sizeof *to->masks);
    to->first = umb__alloc_zeroed(NULL, (size_t)from->count + 1, sizeof *to->first);
    to->children = umb__alloc(NULL, from->first[from->count], sizeof *to->children);
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

/* Makes the mapped layout of the graph, with `state` in place of absent children. In: bricks: the
 * layout takes them over; NULL for a layout that will share the other's bricks. */
static inline enum umb_status lay_out(struct oracle *p, enum umb__node_state state,
                                      uint64_t (*bricks)[8], struct umb__mapped *mapped,
                                      struct umb_error *error)
{
    struct umb__octree octree = {.alloc = NULL,
                                 .brick_count = p->graph.brick_count,
                                 .bricks = bricks,
                                 .root_count = p->graph.root_count};
    octree.roots = umb__alloc(NULL, octree.root_count, sizeof *octree.roots);
    bool ok = octree.roots != NULL;
    for (size_t l = UMB_LEVEL_BRICK + 1; l < UMB__LEVELS && ok; l++) {
        ok = settle_level(&p->graph.level[l], state, &octree.level[l]);
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
        status =
            umb__mapped_build(&octree, &p->part->canonical.content, UINT64_MAX / 2, mapped, error);
    }
    umb__octree_finish(&octree);
    return status == UMB_OK ? UMB_OK : oracle_no_memory(error);
}

/* Makes an asset for queries from a layout. The partial asset still owns content and id. */
static inline void init_view(const struct oracle *p, struct umb_asset *asset)
{
    asset->alloc = NULL;
    asset->canonical = p->part->canonical;
    asset->view = asset->mapped.view;
    asset->notes = (char *)(uintptr_t) "";
    asset->encoding = UMB_ENCODING_PACKED;
    asset->file_bytes = p->part->head.file_length;
    memcpy(asset->id, p->part->head.id, UMB_ID_BYTES);
}

/* Builds both assets from the pages that the partial asset holds. */
static inline enum umb_status oracle_build(struct oracle *p, struct umb_error *error)
{
    oracle_unbuild(p);
    UMB__TRY(build_graph(p, error));
    uint64_t(*bricks)[8] = p->graph.bricks;
    p->graph.bricks = NULL;
    UMB__TRY(lay_out(p, UMB__NODE_SHADOWED, bricks, &p->lower.mapped, error));
    UMB__TRY(lay_out(p, UMB__NODE_LIT, NULL, &p->upper.mapped, error));
    p->upper.mapped.view.bricks = p->lower.mapped.view.bricks;
    init_view(p, &p->lower);
    init_view(p, &p->upper);
    return UMB_OK;
}

#endif
