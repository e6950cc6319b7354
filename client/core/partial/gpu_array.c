/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The array of umbrage/gpu.h: head, two entries for each frustum, grids, nodes, bricks, the words
 * of the occluder depth. It is the mapped layout as it stands (format/view.h), with grids padded to
 * whole entries.
 *
 * The lower and the upper asset of a partial asset become one: a missing child, which is shadowed
 * in one and lit in the other, has a 1 in both masks of its node. No other child has. A missing
 * cell has a link of its own.
 */
#include <string.h>

#include "format/asset_parts.h"
#include "partial/partial_parts.h"
#include "umbrage/gpu.h"

#define HEAD_MAGIC    0x47424d55U /* "UMBG" */
#define HEAD_VERSION  2U
#define MISSING_CELL  UINT32_MAX
#define ENTRIES_MOST  ((uint64_t)1 << 28)
#define NODE_WORDS    2U /* 8-byte words of an entry of nodes */
#define BRICK_ENTRIES 4U

/* What a frustum's second entry says of first occluders. */
enum depth_kind {
    DEPTHS_UNKNOWN,   /* A closed bake without the effect */
    DEPTHS_OF_VOXELS, /* Columns stay shadowed behind their first occluder */
    DEPTHS_STORED,
};

_Static_assert(sizeof(struct umb_gpu_placement) == 192, "struct UmbragePlacement of the shaders");

/* Returns the entries of a frustum's grid. */
static uint64_t grid_entries(const struct umb__top *top)
{
    return (((uint64_t)1 << (3 * top->grid_log2)) + 3) / 4;
}

static uint64_t node_entries(const struct umb__view *view)
{
    return (view->node_words + NODE_WORDS - 1) / NODE_WORDS;
}

static uint64_t depth_entries(const struct umb__content *content)
{
    return (content->occluder_depth_words + 3) / 4;
}

/* Estimates the share of nodes, at about four entries each, in the entries for the whole asset's
 * nodes and bricks. */
static double node_share(const struct umb_asset *asset)
{
    const uint64_t *counts = asset->canonical.counts;
    double nodes = 1;
    for (uint32_t level = UMB__WIDE_FIRST; level <= UMB_LEVEL_MAX; level += 2) {
        nodes += (double)counts[level];
    }
    return nodes / (nodes + (double)counts[UMB_LEVEL_BRICK]);
}

enum umb_status umb_gpu_layout_make(const struct umb_asset *asset, uint32_t spare,
                                    struct umb_gpu_layout *layout, struct umb_error *error)
{
    const struct umb__view *view = &asset->view;
    const uint32_t frusta = asset->canonical.content.frustum_count;
    const uint64_t nodes = node_entries(view), bricks = view->brick_count * BRICK_ENTRIES;
    const uint64_t both = nodes + bricks;
    const uint64_t depths = depth_entries(&asset->canonical.content);
    uint64_t tops = 1 + 2 * (uint64_t)frusta;
    for (uint32_t i = 0; i < frusta; i++) {
        tops += grid_entries(&view->tops[i]);
    }
    tops = (tops + 3) / 4 * 4;
    const uint64_t node_room = (nodes + (uint64_t)(node_share(asset) * spare) + 3) / 4 * 4;
    const uint64_t brick_room = (both + spare + 7) / 4 * 4 - node_room;
    const uint64_t entries = tops + node_room + brick_room + depths;
    if (entries > ENTRIES_MOST) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "asset: %llu entries of %d bytes for the GPU, must be at most %llu",
                        (unsigned long long)(tops + both + depths), UMB_GPU_ENTRY_BYTES,
                        (unsigned long long)ENTRIES_MOST);
    }
    *layout = (struct umb_gpu_layout){.entries = (uint32_t)entries,
                                      .node_first = (uint32_t)tops,
                                      .node_room = (uint32_t)node_room,
                                      .brick_first = (uint32_t)(tops + node_room),
                                      .brick_room = (uint32_t)brick_room};
    return UMB_OK;
}

int umb_gpu_layout_fits(const struct umb_asset *asset, const struct umb_gpu_layout *layout)
{
    return node_entries(&asset->view) <= layout->node_room &&
           asset->view.brick_count * BRICK_ENTRIES <= layout->brick_room;
}

/* --- writing ---------------------------------------------------------------------------------- */

/* A part of the array that is being written. */
struct writing {
    const struct umb__view *lower, *upper;
    const struct umb__content *content;
    const struct umb_gpu_layout *layout;
    uint32_t first, end; /* Entries */
    uint32_t *entries;   /* Words of entry `first` and up */
};

/* Returns the words of an entry, or NULL if it is not wanted. */
static uint32_t *entry_at(const struct writing *w, uint64_t at)
{
    return at >= w->first && at < w->end ? w->entries + 4 * (at - w->first) : NULL;
}

static void put(const struct writing *w, uint64_t at, uint32_t a, uint32_t b, uint32_t c,
                uint32_t d)
{
    uint32_t *entry = entry_at(w, at);
    if (entry != NULL) {
        entry[0] = a;
        entry[1] = b;
        entry[2] = c;
        entry[3] = d;
    }
}

/* Writes the wanted cells of a grid that begins at entry `begin`. */
static void write_grid(const struct writing *w, const struct umb__top *top, uint64_t begin)
{
    const uint64_t end = begin + grid_entries(top), cells = (uint64_t)1 << (3 * top->grid_log2);
    for (uint64_t at = begin < w->first ? w->first : begin; at < end && at < w->end; at++) {
        uint32_t *entry = entry_at(w, at);
        for (uint64_t k = 0; k < 4 && 4 * (at - begin) + k < cells; k++) {
            const uint64_t cell = top->first_cell + 4 * (at - begin) + k;
            const uint32_t low = w->lower->grid[cell], high = w->upper->grid[cell];
            entry[k] = low == high ? low : MISSING_CELL;
        }
    }
}

/* Returns the entry of the first word of the occluder depth. */
static uint64_t first_depth(const struct umb_gpu_layout *layout)
{
    return (uint64_t)layout->brick_first + layout->brick_room;
}

/* Writes what shaders read to find first occluders of a frustum. */
static void write_depth_head(const struct writing *w, uint32_t frustum)
{
    const struct umb__content *content = w->content;
    const bool stored = content->frusta[frustum].closed && content->occluder_depth != NULL;
    const enum depth_kind kind = stored                            ? DEPTHS_STORED
                                 : content->frusta[frustum].closed ? DEPTHS_UNKNOWN
                                                                   : DEPTHS_OF_VOXELS;
    put(w, 1 + (uint64_t)content->frustum_count + frustum, (uint32_t)first_depth(w->layout),
        stored ? content->occluder_depth[frustum] : 0, kind, 0);
}

static void write_tops(const struct writing *w)
{
    const uint32_t frusta = w->content->frustum_count;
    uint64_t grid = 1 + 2 * (uint64_t)frusta;
    put(w, 0, HEAD_MAGIC, HEAD_VERSION, frusta, w->layout->entries);
    for (uint32_t i = 0; i < frusta; i++) {
        const struct umb__top *top = &w->lower->tops[i];
        const uint32_t n = w->content->frusta[i].log2_size, level = n - top->grid_log2;
        put(w, 1 + (uint64_t)i, n | level << 8, (uint32_t)grid, w->layout->node_first,
            w->layout->brick_first);
        write_depth_head(w, i);
        write_grid(w, top, grid);
        grid += grid_entries(top);
    }
}

/* Writes the wanted nodes. A node's first entry is its two masks; in its other entries, padding
 * included, both assets have the same words. Between nodes anything may stand. */
static void write_nodes(const struct writing *w)
{
    const uint64_t begin = w->layout->node_first, end = begin + w->lower->node_words / NODE_WORDS;
    for (uint64_t at = begin < w->first ? w->first : begin; at < end && at < w->end; at++) {
        const uint64_t *low = w->lower->nodes + NODE_WORDS * (at - begin);
        const uint64_t *high = w->upper->nodes + NODE_WORDS * (at - begin);
        const uint64_t missing = low[1] ^ high[1], mixed = low[0] | missing;
        const uint64_t lit = low[1] | missing;
        put(w, at, (uint32_t)mixed, (uint32_t)(mixed >> 32), (uint32_t)lit, (uint32_t)(lit >> 32));
    }
}

static void write_bricks(const struct writing *w)
{
    const uint64_t begin = w->layout->brick_first;
    const uint64_t end = begin + w->lower->brick_count * BRICK_ENTRIES;
    for (uint64_t at = begin < w->first ? w->first : begin; at < end && at < w->end; at++) {
        const uint64_t *pair =
            w->lower->bricks[(at - begin) / BRICK_ENTRIES] + 2 * ((at - begin) % BRICK_ENTRIES);
        put(w, at, (uint32_t)pair[0], (uint32_t)(pair[0] >> 32), (uint32_t)pair[1],
            (uint32_t)(pair[1] >> 32));
    }
}

/* Writes the wanted words of the occluder depth, which all pages share. */
static void write_depths(const struct writing *w)
{
    const uint64_t words = w->content->occluder_depth_words, begin = first_depth(w->layout);
    const uint64_t end = begin + depth_entries(w->content);
    for (uint64_t at = begin < w->first ? w->first : begin; at < end && at < w->end; at++) {
        const uint64_t word = 4 * (at - begin), left = words - word;
        memcpy(entry_at(w, at), w->content->occluder_depth + word,
               (size_t)(4 * (left < 4 ? left : 4)));
    }
}

void umb_gpu_write(const struct umb_asset *asset, const struct umb_partial *partial,
                   const struct umb_gpu_layout *layout, uint32_t first, uint32_t count,
                   uint32_t *entries)
{
    const struct writing w = {.lower = &asset->view,
                              .upper = partial != NULL ? &partial->upper.view : &asset->view,
                              .content = &asset->canonical.content,
                              .layout = layout,
                              .first = first,
                              .end = first + count,
                              .entries = entries};
    memset(entries, 0, (size_t)count * UMB_GPU_ENTRY_BYTES);
    if (first < layout->node_first) {
        write_tops(&w);
    }
    write_nodes(&w);
    write_bricks(&w);
    write_depths(&w);
}
