/* SPDX-License-Identifier: Apache-2.0 */
/* Parsing and encoding pages; see page.h. */
#include "format/page.h"

#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"

static enum umb_status damaged(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_CORRUPT, "page: %s", what);
}

/* Reads a list of numbers below a limit. */
static bool take_list(const uint8_t **at, const uint8_t *end, uint64_t count, uint64_t limit,
                      struct umb__number_list *list)
{
    const unsigned high_bits = umb__list_high_bits(limit);
    *list = (struct umb__number_list){.count = count, .high_bits = high_bits};
    return umb__take(at, end, umb__list_bytes(count, high_bits), 1, &list->bytes);
}

/* Checks the places of nodes in other pages: ascending, with positions below 2^32. */
static enum umb_status parse_others(const uint8_t **at, const uint8_t *end, uint32_t level,
                                    struct umb__page *page, struct umb_error *error)
{
    uint32_t *count = &page->external_count[level];
    if (!umb__take_number(at, end, count)) {
        return damaged(error, "counts are cut");
    }
    uint64_t last_link = 0, last_position = 0;
    uint32_t difference = 0;
    page->external_links[level] = *at;
    for (uint32_t i = 0; i < *count; i++) {
        if (!umb__take_number(at, end, &difference) ||
            (last_link += difference) >= UMB__PAGE_LINKS_MAX) {
            return damaged(error, "a link is not a number or out of range");
        }
    }
    const uint8_t *pages = page->external_links[level];
    page->external_positions[level] = *at;
    for (uint32_t i = 0; i < *count; i++) {
        const bool same = umb__next_number(&pages) == 0 && i > 0;
        if (!umb__take_number(at, end, &difference) ||
            (last_position = difference + (same ? last_position + 1 : 0)) > UINT32_MAX) {
            return damaged(error, "a position is not a number or out of range");
        }
    }
    if (*count > 0 && last_link >= page->link_count) {
        page->link_count = (uint32_t)last_link + 1;
    }
    return UMB_OK;
}

/* Finds the masks of a level in a page and counts the mixed children. Out: written: number of
 * children whose references the page holds. Returns false if a mask is cut off. */
static bool parse_masks(const uint8_t **at, const uint8_t *end, uint32_t level,
                        struct umb__page *page, uint64_t *written)
{
    const uint32_t nodes = page->node_count[level];
    if (!umb__take(at, end, nodes, 2, &page->masks[level])) {
        return false;
    }
    *written = 0;
    for (uint32_t i = 0; i < nodes; i++) {
        const unsigned mask = umb__load16(page->masks[level] + 2 * (size_t)i);
        const unsigned mixed = mask >> 1 & 0x5555U;
        page->child_count[level] += (unsigned)__builtin_popcount(mixed);
        *written += (unsigned)__builtin_popcount(mixed & ~mask);
    }
    return true;
}

static enum umb_status parse_nodes(const uint8_t **at, const uint8_t *end, uint32_t level,
                                   struct umb__page *page, struct umb_error *error)
{
    UMB__TRY(parse_others(at, end, level, page, error));
    const uint64_t limit = (uint64_t)page->node_count[level - 1] + page->external_count[level];
    uint64_t written;
    if (!parse_masks(at, end, level, page, &written)) {
        return damaged(error, "nodes are cut");
    }
    if (!take_list(at, end, written, limit, &page->references[level])) {
        return damaged(error, "references are cut");
    }
    struct umb__page_nodes nodes = umb__page_nodes(page, level);
    uint32_t greatest = 0;
    for (uint32_t i = 0; i < page->node_count[level]; i++) {
        uint16_t mask;
        uint32_t references[8];
        const unsigned count = umb__page_nodes_next(&nodes, &mask, references);
        for (unsigned c = 0; c < count; c++) {
            greatest = references[c] > greatest ? references[c] : greatest;
        }
    }
    if (nodes.next > nodes.own) {
        return damaged(error, "more next nodes than there are");
    }
    if (page->child_count[level] > 0 && greatest >= limit) {
        return damaged(error, "a reference is out of range");
    }
    return nodes.references.pending == 0 ? UMB_OK : damaged(error, "references end in no zeros");
}

static enum umb_status parse_leaves(const uint8_t **at, const uint8_t *end, struct umb__page *page,
                                    struct umb_error *error)
{
    const uint8_t *rows;
    uint64_t differ = 0;
    if (!umb__take_number(at, end, &page->leaf_count)) {
        return damaged(error, "counts are cut");
    }
    if (!umb__take(at, end, page->leaf_count, 1, &page->leaves)) {
        return damaged(error, "leaves are cut");
    }
    for (uint32_t i = 0; i < page->leaf_count; i++) {
        differ += (unsigned)__builtin_popcount(page->leaves[i]);
    }
    return umb__take(at, end, differ, 1, &rows) ? UMB_OK : damaged(error, "leaves are cut");
}

static enum umb_status parse_bricks(const uint8_t **at, const uint8_t *end, struct umb__page *page,
                                    struct umb_error *error)
{
    const uint32_t bricks = page->node_count[UMB_LEVEL_BRICK];
    struct umb__number_list *numbers = &page->references[UMB_LEVEL_BRICK];
    UMB__TRY(parse_leaves(at, end, page, error));
    if (!umb__take(at, end, bricks, 1, &page->runs)) {
        return damaged(error, "bricks are cut");
    }
    uint64_t runs = 0;
    for (uint32_t i = 0; i < bricks; i++) {
        if ((page->runs[i] & 1) == 0) {
            return damaged(error, "a brick's first slice does not start a run");
        }
        runs += (unsigned)__builtin_popcount(page->runs[i]);
    }
    if (!take_list(at, end, runs, page->leaf_count, numbers)) {
        return damaged(error, "leaf numbers are cut");
    }
    struct umb__list_reader reader = umb__list_read(numbers);
    uint32_t greatest = 0;
    for (uint64_t i = 0; i < runs; i++) {
        const uint32_t number = umb__list_next(&reader);
        greatest = number > greatest ? number : greatest;
    }
    if (runs > 0 && greatest >= page->leaf_count) {
        return damaged(error, "a leaf number is out of range");
    }
    return reader.pending == 0 ? UMB_OK : damaged(error, "leaf numbers end in no zeros");
}

enum umb_status umb__page_parse(const uint8_t *raw, size_t size, struct umb__page *page,
                                struct umb_error *error)
{
    const uint8_t *at = raw, *end = raw + size, *head;
    memset(page, 0, sizeof *page);
    if (!umb__take(&at, end, 1, 3, &head)) {
        return damaged(error, "shorter than its head");
    }
    if (head[0] != UMB__PAGE_ENCODING) {
        return umb_fail(error, UMB_E_VERSION, "page: encoding %u, this reader knows %u%s", head[0],
                        UMB__PAGE_ENCODING,
                        head[0] < UMB__PAGE_ENCODING
                            ? "; made by an earlier version: bake the scene again"
                            : "; made by a later version");
    }
    page->level_high = head[1];
    page->level_low = head[2];
    if (page->level_high > UMB_LEVEL_MAX || page->level_low < UMB_LEVEL_BRICK ||
        page->level_low > page->level_high) {
        return damaged(error, "levels out of range");
    }
    /* Levels that the page lacks read as empty, from a valid address. */
    page->leaves = at;
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        page->references[level].bytes = at;
    }
    for (uint32_t level = page->level_high; level >= page->level_low; level--) {
        if (!umb__take_number(&at, end, &page->node_count[level])) {
            return damaged(error, "counts are cut");
        }
    }
    for (uint32_t level = page->level_high; level >= page->level_low && level > UMB_LEVEL_BRICK;
         level--) {
        UMB__TRY(parse_nodes(&at, end, level, page, error));
    }
    if (page->level_low == UMB_LEVEL_BRICK) {
        UMB__TRY(parse_bricks(&at, end, page, error));
    }
    return at == end ? UMB_OK : damaged(error, "bytes are left over");
}

enum umb_status umb__page_set_links(struct umb__page *page, const uint8_t *links, size_t size,
                                    struct umb_error *error)
{
    const uint8_t *at = links, *end = links + size;
    int64_t number = -1;
    uint32_t count = 0, folded;
    while (at < end) {
        if (!umb__take_number(&at, end, &folded)) {
            return damaged(error, "a link is not a number");
        }
        number += 1 + umb__unfold(folded);
        if (number < 0 || number > INT32_MAX) {
            return damaged(error, "a link leads to no page");
        }
        count++;
    }
    if (count != page->link_count) {
        return umb_fail(error, UMB_E_CORRUPT, "page: has %u links, its nodes use %u", count,
                        page->link_count);
    }
    page->links = links;
    return UMB_OK;
}

void umb__page_leaves(const struct umb__page *page, uint64_t *leaves)
{
    const uint8_t *row = page->leaves + page->leaf_count;
    uint64_t leaf = 0;
    for (uint32_t i = 0; i < page->leaf_count; i++) {
        for (unsigned rows = page->leaves[i]; rows != 0;) {
            const unsigned y = 31U - (unsigned)__builtin_clz(rows);
            leaf = (leaf & ~((uint64_t)0xff << (8 * y))) | (uint64_t)*row++ << (8 * y);
            rows &= ~(1U << y);
        }
        leaves[i] = leaf;
    }
}

/* --- encoding --------------------------------------------------------------------------------- */

/* The open page. */
struct writer {
    const struct umb__octree *octree;
    const struct umb__pack_cuts *cuts;
    const struct umb_alloc *alloc;
    struct umb__page_encoder *e;
    bool failed; /* True once memory was short; checked at the end */
    uint32_t level_high, level_low;
    uint32_t level_roots; /* Lowest level that has roots of the page */
};

/* Makes room for at most `most` further bytes of the page. Returns the address of these bytes; NULL
 * if out of memory. */
static uint8_t *reserve(struct writer *w, size_t most)
{
    struct umb__page_encoder *e = w->e;
    if (w->failed ||
        !umb__grow(w->alloc, &e->raw, &e->raw_capacity, e->raw_size + most, sizeof *e->raw)) {
        w->failed = true;
        return NULL;
    }
    return e->raw + e->raw_size;
}

/* Notes that a part of the page begins at `at`. */
static void begin_part(const struct writer *w, const uint8_t *at)
{
    w->e->parts[w->e->part_count++] = (size_t)(at - w->e->raw);
}

/* Counts the bytes written up to `end` as part of the page. */
static void keep(struct writer *w, const uint8_t *end)
{
    w->e->raw_size = (size_t)(end - w->e->raw);
}

/* Writes the first `count` references as a list: two parts, the lowest bytes and the bits above. */
static void write_list(struct writer *w, uint8_t *at, size_t count, unsigned high_bits)
{
    begin_part(w, at);
    begin_part(w, at + count);
    keep(w, umb__put_list(at, w->e->references, count, high_bits));
}

/* Distance in nodes or children at which memory is prefetched. */
#define AHEAD 16U

static struct umb__value_set *nodes_of(const struct writer *w, uint32_t level)
{
    return &w->e->nodes[level & 1];
}

/* Begins the set of a level's nodes. The roots of frusta on this level come first. */
static void begin_level(struct writer *w, const struct umb__pack_page *page, uint32_t level,
                        size_t most)
{
    struct umb__value_set *nodes = nodes_of(w, level);
    const size_t roots = page->level == 0 ? page->part : 0;
    if (w->failed || !umb__value_set_begin(nodes, w->alloc, most + roots + 8)) {
        w->failed = true;
        return;
    }
    for (uint32_t i = page->node; i < page->node + roots; i++) {
        const struct umb__octree_root *root = &w->octree->roots[i];
        if (root->state == UMB__NODE_MIXED && root->level == level) {
            (void)umb__value_set_add(nodes, root->index);
        }
    }
}

/* Finds the highest level of the page and its nodes there. */
static void begin_page(struct writer *w, const struct umb__pack_page *page)
{
    uint32_t high = 0;
    w->level_roots = UMB_LEVEL_MAX;
    if (page->level == 0) {
        for (uint32_t i = page->node; i < page->node + page->part; i++) {
            const struct umb__octree_root *root = &w->octree->roots[i];
            const bool mixed = root->state == UMB__NODE_MIXED;
            high = mixed && root->level > high ? root->level : high;
            w->level_roots = mixed && root->level < w->level_roots ? root->level : w->level_roots;
        }
        begin_level(w, page, high, 0);
    } else {
        const struct umb__octree_level *level = &w->octree->level[page->level];
        const uint32_t *children = level->children + level->first[page->node];
        const uint32_t count = level->first[page->node + 1] - level->first[page->node];
        const uint32_t parts = umb__pack_parts(w->cuts, page->level, page->node);
        high = page->level - 1;
        begin_level(w, page, high, count);
        for (uint32_t i = 0; i < count && !w->failed; i++) {
            if (umb__part_of(parts, i) == page->part + 1) {
                (void)umb__value_set_add(nodes_of(w, high), children[i]);
            }
        }
    }
    w->level_high = high;
    w->level_low = high;
}

/* Bit of a reference to a node in another page. References without it are positions in the page. */
#define IN_OTHER 0x80000000U

/* Finds the position of a cut node's child among the nodes of its level in its page. Equal children
 * are one node. */
static uint32_t position_of(const uint32_t *children, uint32_t parts, uint32_t child)
{
    const uint32_t part = umb__part_of(parts, child);
    uint32_t position = 0, met[8];
    for (uint32_t i = 0; i <= child; i++) {
        if (umb__part_of(parts, i) != part) {
            continue;
        }
        uint32_t k = 0;
        while (k < position && met[k] != children[i]) {
            k++;
        }
        if (i == child) {
            return k;
        }
        met[k] = children[i];
        position += k == position;
    }
    return position;
}

/* Lists the children of a cut node. Those in other pages are items of the table by link and
 * position. In: reference: where the first reference goes. Returns where the next one goes. */
static uint32_t *list_cut(struct writer *w, struct umb__node_ref node, uint32_t parts,
                          uint32_t *reference)
{
    struct umb__page_encoder *e = w->e;
    const struct umb__octree_level *nodes = &w->octree->level[node.level];
    const uint32_t *children = nodes->children + nodes->first[node.index];
    const uint32_t count = nodes->first[node.index + 1] - nodes->first[node.index];
    const uint32_t part_count = umb__part_count(parts);
    uint32_t first[8];
    e->cuts[e->cut_count++] = node;
    for (uint32_t part = 0; part < part_count; part++) {
        uint32_t positions = 0;
        first[part] = (uint32_t)e->other_count;
        for (uint32_t i = 0; i < count; i++) {
            if (umb__part_of(parts, i) == part + 1 &&
                position_of(children, parts, i) == positions) {
                e->others[e->other_count++] =
                    (struct umb__node_place){e->link_count + part, positions++};
            }
        }
    }
    e->link_count += part_count;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t part = umb__part_of(parts, i);
        *reference++ = part == 0 ? umb__value_set_add(nodes_of(w, node.level - 1), children[i])
                                 : IN_OTHER | (first[part - 1] + position_of(children, parts, i));
    }
    return reference;
}

/* Lists the children of a level's nodes as references, and collects the nodes of the level below.
 * Returns the number of references. */
static size_t list_children(struct writer *w, const struct umb__pack_page *page, uint32_t level)
{
    struct umb__page_encoder *e = w->e;
    const struct umb__octree_level *nodes = &w->octree->level[level];
    const struct umb__value_set *here = nodes_of(w, level);
    const size_t most = 8 * here->count;
    begin_level(w, page, level - 1, most);
    if (w->failed ||
        !umb__grow(w->alloc, &e->references, &e->references_capacity, most + 1,
                   sizeof *e->references) ||
        !umb__grow(w->alloc, &e->others, &e->others_capacity, most + 1, sizeof *e->others) ||
        !umb__grow(w->alloc, &e->cuts, &e->cuts_capacity, e->cut_count + here->count,
                   sizeof *e->cuts)) {
        w->failed = true;
        return 0;
    }
    struct umb__value_set *below = nodes_of(w, level - 1);
    uint32_t *reference = e->references;
    e->other_count = 0;
    for (size_t i = 0; i < here->count; i++) {
        const uint32_t node = (uint32_t)here->values[i];
        const uint32_t parts = umb__pack_parts(w->cuts, level, node);
        if (i + AHEAD < here->count) {
            __builtin_prefetch(nodes->children + nodes->first[here->values[i + AHEAD]]);
        }
        if (parts != 0) {
            reference = list_cut(w, (struct umb__node_ref){level, node}, parts, reference);
            continue;
        }
        for (uint32_t c = nodes->first[node]; c < nodes->first[node + 1]; c++) {
            *reference++ = umb__value_set_add(below, nodes->children[c]);
        }
    }
    return (size_t)(reference - e->references);
}

/* Writes the places of the level's nodes in other pages: their links, then their positions. */
static uint8_t *put_others(const struct writer *w, uint8_t *at)
{
    const struct umb__page_encoder *e = w->e;
    uint32_t last = 0;
    for (size_t i = 0; i < e->other_count; i++) {
        at = umb__put_number(at, e->others[i].page - last);
        last = e->others[i].page;
    }
    for (size_t i = 0; i < e->other_count; i++) {
        const struct umb__node_place *other = &e->others[i];
        const bool same = i > 0 && other->page == e->others[i - 1].page;
        at = umb__put_number(at, same ? other->position - e->others[i - 1].position - 1
                                      : other->position);
    }
    return at;
}

/* Writes the masks, which mark the children that are the next nodes (page.h). Moves the references
 * of all other children to the front of the list, as they are written, and returns their number. */
static size_t put_masks(const struct writer *w, uint32_t level, uint8_t *at)
{
    const uint16_t *masks = w->octree->level[level].masks;
    const struct umb__value_set *here = nodes_of(w, level);
    const uint32_t own = (uint32_t)nodes_of(w, level - 1)->count;
    const uint32_t *reference = w->e->references;
    uint32_t *written = w->e->references;
    uint32_t next = 0;
    for (size_t i = 0; i < here->count; i++, at += 2) {
        unsigned mask = masks[here->values[i]];
        for (unsigned mixed = mask >> 1 & 0x5555U; mixed != 0; mixed &= mixed - 1) {
            const uint32_t to = *reference++;
            const bool is_next = to == next;
            mask |= is_next ? mixed & -mixed : 0;
            *written = to & IN_OTHER ? own + (to & ~IN_OTHER) : to;
            written += !is_next;
            next = to >= next && to < own ? to + 1 : next;
        }
        umb__store16(at, (uint16_t)mask);
    }
    return (size_t)(written - w->e->references);
}

/* Writes a level's nodes, and collects those of the level below. */
static void write_nodes(struct writer *w, const struct umb__pack_page *page, uint32_t level)
{
    const size_t children = list_children(w, page, level);
    if (w->failed) {
        return;
    }
    const size_t nodes = nodes_of(w, level)->count, own = nodes_of(w, level - 1)->count;
    const unsigned high_bits = umb__list_high_bits((uint64_t)own + w->e->other_count);
    uint8_t *at = reserve(w, UMB__NUMBER_BYTES_MAX * (1 + 2 * w->e->other_count) + 2 * nodes +
                                 (size_t)umb__list_bytes(children, high_bits));
    if (!at) {
        return;
    }
    begin_part(w, at);
    at = umb__put_number(at, (uint32_t)w->e->other_count);
    at = put_others(w, at);
    begin_part(w, at);
    const size_t written = put_masks(w, level, at);
    at += 2 * nodes;
    write_list(w, at, written, high_bits);
}

/* Divides the page's bricks into runs of equal slices, and finds the leaf of each run: the mask of
 * one slice. Returns the number of runs. */
static size_t list_leaves(struct writer *w)
{
    const struct umb__value_set *nodes = nodes_of(w, UMB_LEVEL_BRICK);
    uint32_t *reference = w->e->references;
    for (size_t i = 0; i < nodes->count; i++) {
        if (i + AHEAD < nodes->count) {
            __builtin_prefetch(w->octree->bricks[nodes->values[i + AHEAD]]);
        }
        const uint64_t *brick = w->octree->bricks[nodes->values[i]];
        w->e->runs[i] = (uint8_t)umb__brick_runs(brick);
        for (unsigned runs = w->e->runs[i]; runs != 0; runs &= runs - 1) {
            *reference++ = umb__value_set_add(&w->e->table, brick[__builtin_ctz(runs)]);
        }
    }
    return (size_t)(reference - w->e->references);
}

/* Writes the table's leaves: for each leaf the bits of the rows that differ from the leaf before,
 * then all these rows. One byte after them may be overwritten. */
static uint8_t *put_leaves(const struct umb__value_set *table, uint8_t *at)
{
    uint8_t *row = at + table->count;
    uint64_t last = 0;
    for (size_t i = 0; i < table->count; i++) {
        const uint64_t leaf = table->values[i], changed = leaf ^ last;
        unsigned differ = 0;
        for (unsigned y = 8; y-- > 0;) {
            const bool differs = (changed >> (8 * y) & 0xff) != 0;
            *row = (uint8_t)(leaf >> (8 * y));
            row += differs;
            differ |= (unsigned)differs << y;
        }
        at[i] = (uint8_t)differ;
        last = leaf;
    }
    return row;
}

static void write_bricks(struct writer *w)
{
    struct umb__page_encoder *e = w->e;
    const struct umb__value_set *table = &e->table;
    const size_t bricks = nodes_of(w, UMB_LEVEL_BRICK)->count;
    if (!umb__grow(w->alloc, &e->runs, &e->runs_capacity, bricks, 1) ||
        !umb__grow(w->alloc, &e->references, &e->references_capacity, 8 * bricks + 1,
                   sizeof *e->references) ||
        !umb__value_set_begin(&e->table, w->alloc, 8 * bricks)) {
        w->failed = true;
        return;
    }
    const size_t count = list_leaves(w);
    if (!umb__value_set_sort(&e->table, w->alloc)) {
        w->failed = true;
        return;
    }
    const unsigned high_bits = umb__list_high_bits(table->count);
    uint8_t *at = reserve(w, UMB__NUMBER_BYTES_MAX + 9 * table->count + 1 + bricks +
                                 (size_t)umb__list_bytes(count, high_bits));
    if (!at) {
        return;
    }
    begin_part(w, at);
    at = umb__put_number(at, (uint32_t)table->count);
    begin_part(w, at + table->count);
    at = put_leaves(table, at);
    begin_part(w, at);
    memcpy(at, e->runs, bricks);
    for (size_t i = 0; i < count; i++) {
        e->references[i] = table->rank[e->references[i]];
    }
    write_list(w, at + bricks, count, high_bits);
}

/* Encodes the levels in turn, into a place behind the counts, which are known at the end only. */
static void write_levels(struct writer *w, const struct umb__pack_page *page,
                         uint32_t counts[UMB_LEVEL_MAX + 1])
{
    uint32_t level = w->level_high;
    /* Between roots of different levels, a page may have levels without nodes. */
    const uint32_t roots = page->level == 0 ? w->level_roots : UMB_LEVEL_MAX;
    for (; !w->failed && (nodes_of(w, level)->count > 0 || level >= roots); level--) {
        counts[level] = (uint32_t)nodes_of(w, level)->count;
        w->e->node_count += counts[level];
        w->level_low = level;
        if (level == UMB_LEVEL_BRICK) {
            write_bricks(w);
            return;
        }
        write_nodes(w, page, level);
    }
}

/* Puts the head of the page before the levels. */
static void write_head(struct writer *w, const uint32_t counts[UMB_LEVEL_MAX + 1])
{
    uint8_t head[3 + UMB__NUMBER_BYTES_MAX * (UMB_LEVEL_MAX + 1)], *end = head + 3;
    head[0] = UMB__PAGE_ENCODING;
    head[1] = (uint8_t)w->level_high;
    head[2] = (uint8_t)w->level_low;
    for (uint32_t level = w->level_high; level >= w->level_low; level--) {
        end = umb__put_number(end, counts[level]);
    }
    const size_t size = (size_t)(end - head);
    if (!reserve(w, size)) {
        return;
    }
    memmove(w->e->raw + size, w->e->raw, w->e->raw_size);
    memcpy(w->e->raw, head, size);
    w->e->raw_size += size;
    for (size_t i = 0; i < w->e->part_count; i++) {
        w->e->parts[i] += size;
    }
}

enum umb_status umb__page_encode(struct umb__page_encoder *encoder,
                                 const struct umb__pack_cuts *cuts,
                                 const struct umb__pack_page *page, struct umb_error *error)
{
    struct writer w = {.octree = cuts->octree, .cuts = cuts, .alloc = cuts->alloc, .e = encoder};
    uint32_t counts[UMB_LEVEL_MAX + 1] = {0};
    encoder->raw_size = encoder->cut_count = encoder->other_count = 0;
    encoder->link_count = encoder->node_count = 0;
    encoder->part_count = 0;
    begin_page(&w, page);
    write_levels(&w, page, counts);
    write_head(&w, counts);
    if (w.failed) {
        return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for a page");
    }
    if (encoder->raw_size > UMB__PAGE_RAW_MAX) {
        return umb_fail(error, UMB_E_INTERNAL, "packing: a page takes %zu bytes, at most %u",
                        encoder->raw_size, UMB__PAGE_RAW_MAX);
    }
    return UMB_OK;
}

void umb__page_encoder_finish(struct umb__page_encoder *encoder, const struct umb_alloc *alloc)
{
    umb__free(alloc, encoder->raw);
    umb__free(alloc, encoder->cuts);
    umb__free(alloc, encoder->references);
    umb__free(alloc, encoder->others);
    umb__free(alloc, encoder->runs);
    umb__value_set_finish(&encoder->table, alloc);
    umb__value_set_finish(&encoder->nodes[0], alloc);
    umb__value_set_finish(&encoder->nodes[1], alloc);
    memset(encoder, 0, sizeof *encoder);
}
