/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Brings the lower and the upper asset of partial.h up to date with the held pages. Only pages that
 * came or went since the last build are touched: their nodes and bricks, the wide nodes of other
 * pages that depend on them, and, if they have nodes high in the tree, the grids.
 *
 * A build that does not fit the memory budget drops the spares of another version, then the page of
 * the least benefit, and goes on. If
 * memory runs out while wide nodes are written, the layout is given up and made anew from the
 * stored pages, with an eighth fewer.
 */
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "partial/partial_parts.h"

/* Stands for an array without entries: queries compute addresses of entries that they do not read,
 * and a null pointer has none. */
static const uint64_t no_entries[8];

static const void *entries_of(const struct umb__arena *arena)
{
    return arena->base != NULL ? (const void *)arena->base : no_entries;
}

/* Makes an asset for queries from the layout. The partial asset still owns content and id. */
static void set_view(const struct umb_partial *p, size_t i, struct umb_asset *asset)
{
    asset->alloc = &p->alloc;
    asset->canonical = p->canonical;
    asset->view = (struct umb__view){
        .tops = p->tops,
        .grid = p->grids[i],
        .nodes = entries_of(&p->nodes[i]),
        .bricks = entries_of(&p->bricks),
        .columns = p->columns,
        .pieces = p->pieces[i],
        .grid_count = p->grid_count,
        .node_words = (uint64_t)p->node_extents.end * 8,
        .brick_count = p->brick_extents.end,
        .column_count = p->column_count,
        .piece_count = p->piece_count,
    };
    asset->notes = (char *)(uintptr_t) "";
    asset->encoding = UMB_ENCODING_PACKED;
    asset->file_bytes = p->head.file_length;
    memcpy(asset->id, p->head.id, UMB_ID_BYTES);
}

/* Takes pages that are no longer held out of the layout, and lays out those that came. */
static enum umb_status change_pages(struct umb_partial *p, struct umb_error *error)
{
    for (uint32_t i = 0; i < p->changed_count; i++) {
        const struct umb__held *held = &p->pages[p->changed[i]];
        if (held->laid && !held->stored) {
            umb__partial_unlay(p, p->changed[i]);
        }
    }
    umb__partial_trim(p);
    for (uint32_t i = 0; i < p->changed_count; i++) {
        const struct umb__held *held = &p->pages[p->changed[i]];
        if (held->stored && !held->laid) {
            UMB__TRY(umb__partial_lay(p, p->changed[i], error));
        }
    }
    return UMB_OK;
}

/* Writes the wide nodes of pages that came, and those that depend on pages that came or went. */
static bool write_nodes(struct umb_partial *p)
{
    for (uint32_t i = 0; i < p->changed_count && !p->broken; i++) {
        const uint32_t page = p->changed[i];
        const struct umb__laid *laid = p->pages[page].laid;
        p->broken = laid && !laid->written && !umb__wide_write_page(p, page);
    }
    p->broken = p->broken || !umb__wide_write_marked(p);
    return !p->broken;
}

static enum umb_status try_build(struct umb_partial *p, struct umb_error *error)
{
    if (!p->tops) {
        UMB__TRY(umb__tops_make(p, error));
    }
    UMB__TRY(change_pages(p, error));
    if (!write_nodes(p)) {
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "partial asset: the links of the pages at hand do not fit the memory "
                        "budget");
    }
    if (p->tops_stale) {
        umb__tops_fill(p);
    }
    for (uint32_t i = 0; i < p->changed_count; i++) {
        p->pages[p->changed[i]].changed = false;
    }
    p->changed_count = 0;
    set_view(p, 0, &p->lower);
    set_view(p, 1, &p->upper);
    p->built = true;
    p->builds++;
    return UMB_OK;
}

/* Drops pages of the least benefit: at least one, and about so many stored bytes. */
static void shed(struct umb_partial *p, uint64_t bytes)
{
    const uint64_t goal = p->held_bytes - bytes;
    do {
        umb_partial_drop(p, umb__partial_worst(p));
        p->dropped++;
    } while (p->held_count > 0 && p->held_bytes > goal);
}

enum umb_status umb_partial_build(struct umb_partial *p, struct umb_error *error)
{
    enum umb_status status = try_build(p, error);
    /* Ends: each round drops spares or a page, or frees the uncompressed pages */
    while (status == UMB_E_NO_MEMORY && (p->held_count > 0 || p->spares)) {
        if (p->broken) {
            umb__partial_unbuild(p);
            if (!umb__spares_drop(p)) {
                shed(p, p->held_bytes / 8);
            }
        } else if (!umb__partial_free_raw(p) && !umb__spares_drop(p)) {
            shed(p, 1);
        }
        status = try_build(p, error);
    }
    if (status != UMB_OK) {
        umb__partial_unbuild(p);
    }
    return status;
}
