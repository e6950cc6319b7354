/* SPDX-License-Identifier: Apache-2.0 */
/* The writing half of page.h: level by level from the top, the tables of each as it comes. */
#include "format/page.h"

#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "format/layout.h"

/* The open page. */
struct writer {
    const struct umb_octree *octree;
    const struct umb__pack_order *order;
    struct umb__page_encoder *e;
    uint32_t page;
    bool failed; /* out of memory: checked at the end */
    uint32_t level_high, level_low;
    uint32_t node_count[UMB_LEVEL_MAX + 1];
    size_t node_first[UMB_LEVEL_MAX + 1];      /* of the level, in e->nodes */
    size_t reference_count[UMB_LEVEL_MAX + 1]; /* [3]: runs of all bricks */
};

static uint8_t *append(struct writer *w, size_t count)
{
    struct umb__page_encoder *e = w->e;
    if (w->failed || !umb__grow(w->order->alloc, &e->raw, &e->raw_capacity, e->raw_size + count,
                                sizeof *e->raw)) {
        w->failed = true;
        return NULL;
    }
    uint8_t *at = e->raw + e->raw_size;
    e->raw_size += count;
    return at;
}

/* Bit z: slice z differs from slice z - 1; bit 0 is set. */
static unsigned brick_runs(const uint64_t *brick)
{
    unsigned bits = 1;
    for (unsigned z = 1; z < 8; z++) {
        bits |= (unsigned)(brick[z] != brick[z - 1]) << z;
    }
    return bits;
}

/* How many nodes or children ahead of the one at work memory is asked for. */
#define AHEAD 16U

static void ask_ahead(const struct umb_octree *octree, struct umb__node_ref node)
{
    if (node.level == UMB_LEVEL_BRICK) {
        __builtin_prefetch(octree->bricks[node.index]);
    } else {
        __builtin_prefetch(octree->level[node.level].first + node.index);
    }
}

/* Sorts the page's nodes by level, in the order of the page, and counts. False: out of memory. */
static bool collect(struct writer *w)
{
    const size_t first = w->order->page_first[w->page], end = w->order->page_first[w->page + 1];
    const struct umb__node_ref *sequence = w->order->sequence;
    w->level_high = UMB_LEVEL_BRICK;
    w->level_low = UMB_LEVEL_MAX;
    for (size_t s = first; s < end; s++) {
        const uint32_t level = sequence[s].level;
        w->node_count[level]++;
        w->level_high = level > w->level_high ? level : w->level_high;
        w->level_low = level < w->level_low ? level : w->level_low;
    }
    if (!umb__grow(w->order->alloc, &w->e->nodes, &w->e->nodes_capacity, end - first,
                   sizeof *w->e->nodes)) {
        return false;
    }
    size_t place[UMB_LEVEL_MAX + 1], next = 0;
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        place[level] = w->node_first[level] = next;
        next += w->node_count[level];
    }
    for (size_t s = first; s < end; s++) {
        const struct umb__node_ref node = sequence[s];
        if (s + AHEAD < end) {
            ask_ahead(w->octree, sequence[s + AHEAD]);
        }
        w->e->nodes[place[node.level]++] = node.index;
        if (node.level == UMB_LEVEL_BRICK) {
            w->reference_count[UMB_LEVEL_BRICK] +=
                (size_t)__builtin_popcount(brick_runs(w->octree->bricks[node.index]));
        } else {
            const uint32_t *begins = w->octree->level[node.level].first + node.index;
            w->reference_count[node.level] += begins[1] - begins[0];
        }
    }
    return true;
}

/* Writes what is known of the counts; the others are put in as the levels are written. */
static void write_counts(struct writer *w)
{
    const size_t levels = w->level_high - w->level_low + 1;
    const size_t tables = levels; /* external nodes of each level but bricks, which have leaves */
    uint8_t *head = append(w, 4 + 4 * (levels + tables));
    if (!head) {
        return;
    }
    head[0] = UMB__PAGE_ENCODING;
    head[1] = (uint8_t)w->level_high;
    head[2] = (uint8_t)w->level_low;
    head[3] = 0;
    for (size_t i = 0; i < levels; i++) {
        umb__store32(head + 4 + 4 * i, w->node_count[w->level_high - i]);
    }
}

/* Puts a level's number of external nodes (or leaves) into its place among the counts. */
static void put_table_count(struct writer *w, uint32_t level, size_t count)
{
    const size_t levels = w->level_high - w->level_low + 1;
    umb__store32(w->e->raw + 4 + 4 * (levels + w->level_high - level), (uint32_t)count);
}

/* Makes room for a level's references and an empty table. False: out of memory. */
static bool begin_table(struct writer *w, uint32_t level)
{
    struct umb__page_encoder *e = w->e;
    const size_t count = w->reference_count[level];
    if (w->failed ||
        !umb__grow(w->order->alloc, &e->references, &e->references_capacity, count + 1,
                   sizeof *e->references) ||
        !umb__value_set_begin(&e->table, w->order->alloc, count)) {
        w->failed = true;
    }
    return !w->failed;
}

static bool sort_table(struct writer *w)
{
    w->failed = w->failed || !umb__value_set_sort(&w->e->table, w->order->alloc);
    return !w->failed;
}

/* Marks a reference to the table; the page's own nodes are numbered by position. */
#define IN_TABLE 0x80000000U

/* Lists the children of a level's nodes, in their order. */
static void list_children(struct writer *w, uint32_t node_level)
{
    const struct umb_octree_level *level = &w->octree->level[node_level];
    const uint32_t *nodes = w->e->nodes + w->node_first[node_level];
    size_t n = 0;
    for (uint32_t i = 0; i < w->node_count[node_level]; i++) {
        for (uint32_t c = level->first[nodes[i]]; c < level->first[nodes[i] + 1]; c++) {
            w->e->references[n++] = level->children[c];
        }
    }
}

/* Turns children into positions in the page, where all of them stand: the set numbers nodes as it
 * meets them, which is their order in the page. False: out of memory. */
static bool number_own(struct writer *w, uint32_t node_level)
{
    struct umb__value_set *own = &w->e->own;
    const uint32_t *below = w->e->nodes + w->node_first[node_level - 1];
    if (!umb__value_set_begin(own, w->order->alloc, w->node_count[node_level - 1])) {
        return false;
    }
    for (uint32_t i = 0; i < w->node_count[node_level - 1]; i++) {
        (void)umb__value_set_add(own, below[i]);
    }
    for (size_t i = 0; i < w->reference_count[node_level]; i++) {
        w->e->references[i] = umb__value_set_add(own, w->e->references[i]);
    }
    return true;
}

/* Turns children into positions in the page, or numbers in the table of those in others. */
static void number_all(struct writer *w, uint32_t node_level)
{
    const struct umb__node_place *places = w->order->places[node_level - 1];
    const size_t count = w->reference_count[node_level];
    uint32_t *references = w->e->references;
    for (size_t i = 0; i < count; i++) {
        if (i + AHEAD < count) {
            __builtin_prefetch(places + references[i + AHEAD]);
        }
        const struct umb__node_place place = places[references[i]];
        const uint64_t far = (uint64_t)place.page << 32 | place.position;
        references[i] = place.page == w->page ? place.position
                                              : IN_TABLE | umb__value_set_add(&w->e->table, far);
    }
}

static void write_nodes(struct writer *w, uint32_t node_level)
{
    const struct umb__value_set *table = &w->e->table;
    if (!begin_table(w, node_level)) {
        return;
    }
    list_children(w, node_level);
    if (w->page >= w->order->alone_from) {
        w->failed = !number_own(w, node_level);
    } else {
        number_all(w, node_level);
    }
    if (!sort_table(w)) {
        return;
    }
    const size_t externals = table->count, nodes = w->node_count[node_level];
    const uint32_t own = w->node_count[node_level - 1];
    const unsigned width = umb__narrow_width((uint64_t)own + externals);
    uint8_t *at = append(w, 8 * externals + 2 * nodes + width * w->reference_count[node_level]);
    if (!at) {
        return;
    }
    put_table_count(w, node_level, externals);
    for (size_t i = 0; i < externals; i++) {
        umb__store32(at + 4 * i, (uint32_t)(table->values[i] >> 32));
        umb__store32(at + 4 * (externals + i), (uint32_t)table->values[i]);
    }
    at += 8 * externals;
    for (size_t i = 0; i < nodes; i++, at += 2) {
        const uint32_t node = w->e->nodes[w->node_first[node_level] + i];
        umb__store16(at, w->octree->level[node_level].masks[node]);
    }
    for (size_t i = 0; i < w->reference_count[node_level]; i++, at += width) {
        const uint32_t reference = w->e->references[i];
        const uint32_t number =
            reference & IN_TABLE ? own + table->rank[reference & ~IN_TABLE] : reference;
        umb__store_narrow(at, number, width);
    }
}

static void write_bricks(struct writer *w)
{
    const struct umb__value_set *table = &w->e->table;
    const uint32_t *nodes = w->e->nodes + w->node_first[UMB_LEVEL_BRICK];
    const size_t bricks = w->node_count[UMB_LEVEL_BRICK];
    if (!begin_table(w, UMB_LEVEL_BRICK)) {
        return;
    }
    uint32_t *reference = w->e->references;
    for (size_t i = 0; i < bricks; i++) {
        const uint64_t *brick = w->octree->bricks[nodes[i]];
        for (unsigned runs = brick_runs(brick); runs != 0; runs &= runs - 1) {
            *reference++ = umb__value_set_add(&w->e->table, brick[__builtin_ctz(runs)]);
        }
    }
    if (!sort_table(w)) {
        return;
    }
    const unsigned width = umb__narrow_width(table->count);
    const size_t references = w->reference_count[UMB_LEVEL_BRICK];
    uint8_t *at = append(w, 8 * table->count + bricks + width * references);
    if (!at) {
        return;
    }
    put_table_count(w, UMB_LEVEL_BRICK, table->count);
    for (size_t i = 0; i < table->count; i++, at += 8) {
        umb__store64(at, table->values[i]);
    }
    for (size_t i = 0; i < bricks; i++) {
        *at++ = (uint8_t)brick_runs(w->octree->bricks[nodes[i]]);
    }
    for (size_t i = 0; i < references; i++, at += width) {
        umb__store_narrow(at, table->rank[w->e->references[i]], width);
    }
}

enum umb_status umb__page_encode(struct umb__page_encoder *encoder, const struct umb_octree *octree,
                                 const struct umb__pack_order *order, uint32_t page,
                                 struct umb_error *error)
{
    struct writer w = {.octree = octree, .order = order, .e = encoder, .page = page};
    encoder->raw_size = 0;
    w.failed = !collect(&w);
    write_counts(&w);
    for (uint32_t level = w.level_high; level >= w.level_low && level > UMB_LEVEL_BRICK; level--) {
        write_nodes(&w, level);
    }
    if (w.level_low == UMB_LEVEL_BRICK && !w.failed) {
        write_bricks(&w);
    }
    if (w.failed) {
        return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for page %u", page);
    }
    if (encoder->raw_size > UMB__PAGE_RAW_MAX) {
        return umb_fail(error, UMB_E_INTERNAL, "packing: page %u takes %zu bytes, at most %u", page,
                        encoder->raw_size, UMB__PAGE_RAW_MAX);
    }
    return UMB_OK;
}

void umb__page_encoder_finish(struct umb__page_encoder *encoder, const struct umb_alloc *alloc)
{
    umb__free(alloc, encoder->raw);
    umb__free(alloc, encoder->nodes);
    umb__free(alloc, encoder->references);
    umb__value_set_finish(&encoder->table, alloc);
    umb__value_set_finish(&encoder->own, alloc);
    memset(encoder, 0, sizeof *encoder);
}
