/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_PARTIAL_PARTS_H
#define UMBRAGE_CORE_PARTIAL_PARTIAL_PARTS_H
/* The parts of a partial asset; private to client/core/partial. */
#include <stdbool.h>
#include "format/asset_parts.h"
#include "partial/expanded_page.h"
#include "partial/extents.h"
#include "umbrage/partial.h"

/* Facts about a page's nodes, level by level. */
struct umb__links {
    uint32_t count[UMB__LEVELS];  /* Number of nodes in the page, if the page is held */
    uint32_t needed[UMB__LEVELS]; /* Number of nodes that references require: one more than the
                                     highest position that a reference names */
};

/* A page in the last build: its nodes, and their places in the layout. */
struct umb__laid {
    struct umb__expanded *nodes;
    uint32_t node_extent, brick_extent; /* Ranges of both arrays; UMB__NO_EXTENT: none */
    uint32_t first_brick;               /* Number of the page's first brick */
    bool written;                       /* True: its wide nodes are written */
    /* [count] Of the wide nodes of an odd level: first words, and first entries in the list of
     * watches, plus 1 (0: the wide node depends on no other page). NULL for other levels */
    uint32_t *words[UMB__LEVELS], *watches[UMB__LEVELS];
};

/*
 * A wide node whose content depends on another page, held or missing: on a node of the level below,
 * or two levels below. It stands in two lists: that of the wide node, and that of the other page.
 */
struct umb__watch {
    uint32_t page, wide;     /* Wide node: its page, and umb__wide_name of level and position */
    uint32_t watched;        /* Number of the other page */
    uint32_t next_of_wide;   /* Next entry of the wide node, plus 1; of an unused entry the next
                                unused one, plus 1 */
    uint32_t previous, next; /* Entries of the other page, plus 1; 0: none */
};

/* Name of a wide node in its page. A page of 1 MiB has fewer than 2^20 nodes. */
struct umb__wide_ref {
    uint32_t page, wide;
};

static inline uint32_t umb__wide_name(uint32_t level, uint32_t position)
{
    return level << 24 | position;
}

/* Mark of a wide node, in its `watches`: it must be written again. */
#define UMB__WIDE_DIRTY 0x80000000U

struct umb__held {
    uint8_t *stored;          /* Stored bytes, which umb_partial_save writes; NULL: not held */
    uint8_t *raw;             /* Uncompressed bytes of a page that waits for the next build; or
                                 NULL */
    struct umb__links *links; /* NULL: the page is not held, and no page refers to it */
    struct umb__laid *laid;   /* NULL: the page is not in the last build */
    uint32_t stored_length; /* Number of stored bytes of a held page; the entry's, unless foreign */
    double benefit;         /* Sum of the page's benefits for the wanted views; 0: none */
    uint32_t watchers;      /* First watch of the page, plus 1; 0: none */
    bool changed;           /* True: the page is in the list of changed pages */
    bool foreign; /* True: the bytes came from another version, and this one's file has another zstd
                     frame for them */
};

/* A page of another version of the asset, which waits for an entry of the directory with its
 * hash. */
struct umb__spare {
    uint8_t hash[UMB_ID_BYTES];
    uint8_t *stored; /* [length] Stored bytes; NULL: taken */
    uint32_t length;
    uint32_t gone; /* In the first of spares of equal hashes: number of these that are taken */
};

/* An array of the layout, which begins at a cache line and grows. */
struct umb__arena {
    uint8_t *block; /* Memory; NULL: none yet */
    uint8_t *base;  /* First byte of the array */
    size_t bytes;   /* Bytes of the array */
};

/* Counts of allocated bytes; an allocation beyond the limit is refused. */
struct umb__meter {
    const struct umb_alloc *inner;
    uint64_t used, peak, limit;
};

/* A bit for each line of an array: 1 if it changed. */
struct umb__line_bits {
    uint64_t *bits; /* [capacity] */
    size_t capacity;
};

/* What builds have written since a program copied it to its GPU (gpu_changes.c). */
struct umb__changes {
    bool wanted; /* True: a program has asked for changes */
    bool all;    /* True: everything may have changed */
    bool tops;   /* True: grids have changed */
    struct umb__line_bits nodes, bricks;
};

struct umb_partial {
    struct umb__meter meter;
    struct umb_alloc alloc; /* Allocator through the meter */
    const struct umb_sha256 *sha256;
    void *zstd;           /* Decoder, a ZSTD_DCtx */
    uint8_t *head_bytes;  /* [head.head_length] */
    uint8_t **blocks;     /* [head.directory_count] Blocks of entries; NULL: not held */
    uint32_t block_count; /* Number of held blocks */
    struct umb__head head;
    struct umb__canonical canonical;
    struct umb__held *pages; /* [head.page_count] */
    uint32_t *heap;          /* [heap_count] Heap of pages, the worst first (umb__partial_worst) */
    uint32_t heap_count;
    bool heap_fresh; /* False if pages or benefits have changed since the heap was built */
    uint32_t held_count;
    uint64_t held_bytes;
    uint64_t dropped, builds;
    struct umb__spare *spares; /* [spare_count] In the order of their hashes; NULL: none */
    uint8_t **spare_blocks;    /* [head.directory_count] Blocks of another version with the hash of
                                  this one's; NULL: none. Entries may be NULL */
    uint32_t spare_count;
    uint64_t spare_bytes; /* Stored bytes of spares that are not taken */
    uint64_t inherited;   /* Number of spares that became pages */

    /* Pages that were added or dropped since the last build: [changed_count], each once. */
    uint32_t *changed; /* [head.page_count] */
    uint32_t changed_count;

    /* The last build. */
    bool built;
    uint64_t node_count;                             /* Number of nodes and bricks of its pages */
    struct umb__extents node_extents, brick_extents; /* In lines of 8 words, and in bricks */
    struct umb__arena nodes[2], bricks; /* Wide nodes of the lower and the upper asset, at the same
                                           words; bricks of both */
    struct umb__watch *watches;         /* [watch_count] */
    size_t watch_count, watch_capacity;
    uint32_t watch_spare;        /* First unused watch, plus 1 */
    struct umb__wide_ref *dirty; /* [dirty_count] Wide nodes to be written again */
    size_t dirty_count, dirty_capacity;
    uint32_t level_highest;      /* Highest level of the grids' cells: no wide node is above it */
    uint32_t level_lowest;       /* Lowest level of the grids' cells */
    bool tops_stale;             /* True: nodes of the grids' cells or above have come or gone */
    bool broken;                 /* True: memory ran out while wide nodes were written; only
                        umb__partial_unbuild is safe */
    struct umb__top *tops;       /* [frustum_count] */
    struct umb__column *columns; /* One list of all cells for each column of the grid */
    uint32_t *grids[2], *pieces[2]; /* Of the lower and the upper asset */
    uint64_t grid_count, column_count, piece_count;
    struct umb__changes changes;
    uint64_t want_steps;           /* Number of cubes and nodes that the last want visited */
    struct umb_asset lower, upper; /* Assets for queries, which borrow `canonical` */
};

/* Returns true if the block of a page's entry is held: umb__directory_load may then be called. */
static inline bool umb__partial_knows(const struct umb_partial *p, uint32_t page)
{
    return p->blocks[page / UMB__BLOCK_PAGES];
}

/* Notes that a page was added or dropped. */
void umb__partial_note_change(struct umb_partial *p, uint32_t page);

/* Starts a meter of allocated bytes, and makes an allocator that counts with it. In: meter: must
 * stay at its address. */
void umb__meter_init(struct umb__meter *meter, const struct umb_alloc *inner, uint64_t limit,
                     struct umb_alloc *alloc);

/* Fails because the memory budget has no room for `what`. */
enum umb_status umb__partial_no_memory(struct umb_error *error, const char *what);

/* Records that a page must have the node at a given position of a level. False: out of memory. */
bool umb__partial_note_link(struct umb_partial *p, uint32_t level, uint32_t page,
                            uint32_t position);

/* Frees uncompressed pages, else the spares of another version, else the page of the least benefit,
 * if that is below `benefit`. Returns false if there is none. */
bool umb__partial_give_way(struct umb_partial *p, double benefit);

/* Takes a held page out. Returns its stored bytes, which the caller owns; NULL: it is not held. */
uint8_t *umb__partial_release(struct umb_partial *p, uint32_t page);

/* Counts an allocated block as another partial asset's; both have the same allocator. Returns false
 * if it does not fit the budget; it stays where it was. */
bool umb__partial_move(struct umb_partial *to, struct umb_partial *from, const void *block);

/* Adds a missing page from the stored bytes of another version. If the page is not what the
 * directory says, or does not fit, it stays missing. In: stored: uint8[length], taken over. */
void umb__partial_add_spare(struct umb_partial *p, uint32_t page, uint8_t *stored, uint32_t length);

/* --- pages of another version (partial_spares.c) ---------------------------------------------- */

/* Adds the missing pages of a held block for which there is a spare, and the neighbouring blocks
 * that can now be placed, with their pages. Cost: a look-up for each page of the blocks, and the
 * pages found. */
void umb__spares_use(struct umb_partial *p, uint32_t block);

/* Returns the block to read for a missing one: itself, or the block before it by which its spare
 * one can be placed. */
uint32_t umb__spares_before(const struct umb_partial *p, uint32_t block);

/* Frees the spares. Returns false if there are none. */
bool umb__spares_drop(struct umb_partial *p);

/* --- the layout (partial_layout.c): pages come and go ----------------------------------------- */

/* Lays out a held page: expands it and finds places for its bricks and wide nodes. Fails:
 * E_NO_MEMORY; the page is then not laid out. Cost: linear in the page and in the references of
 * other pages to it. */
UMB_CHECKED enum umb_status umb__partial_lay(struct umb_partial *p, uint32_t page,
                                             struct umb_error *error);

/* Frees the uncompressed bytes of pages that wait for the build. Returns false if there are none.
 * */
bool umb__partial_free_raw(struct umb_partial *p);

/* Takes a page out of the layout. */
void umb__partial_unlay(struct umb_partial *p, uint32_t page);

/* Returns memory that the arrays of the layout do not need. */
void umb__partial_trim(struct umb_partial *p);

/* --- wide nodes (partial_wide.c) -------------------------------------------------------------- */

/* Returns the most words that a wide node can take. */
uint64_t umb__wide_words_most(const struct umb_partial *p, uint32_t page,
                              const struct umb__expanded *nodes, uint32_t level, uint32_t position);

/* Marks the wide nodes that depend on a page: they must be written again. */
void umb__wide_mark_watchers(struct umb_partial *p, uint32_t page);

/* Removes the watches of a page's wide nodes. */
void umb__wide_forget(struct umb_partial *p, const struct umb__laid *laid);

/* Writes the wide nodes of a page that was laid out. Returns false if out of memory. */
bool umb__wide_write_page(struct umb_partial *p, uint32_t page);

/* Writes the marked wide nodes. Returns false if out of memory. */
bool umb__wide_write_marked(struct umb_partial *p);

/* --- changes for a GPU (gpu_changes.c) -------------------------------------------------------- */

/* Notes that so many words of nodes were written, at least 1. */
void umb__changes_note_nodes(struct umb_partial *p, uint32_t word, uint64_t words);
void umb__changes_note_bricks(struct umb_partial *p, uint32_t first, uint32_t count);
void umb__changes_note_tops(struct umb_partial *p);

/* Notes that everything may have changed. */
void umb__changes_note_all(struct umb_partial *p);

/* --- grids and columns (partial_tops.c) ------------------------------------------------------- */

/* Chooses the sizes of the grids, and allocates grids and columns. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__tops_make(struct umb_partial *p, struct umb_error *error);
void umb__tops_finish(struct umb_partial *p);

/* Fills grids and columns. Cost: linear in their cells. */
void umb__tops_fill(struct umb_partial *p);

/* -----------------------------------------------------------------------------------------------
 * */

/* Frees the last build. Held pages count as changed, since the next build has to lay them out. */
void umb__partial_unbuild(struct umb_partial *p);

/* Returns the held page of the least benefit; among equal ones the last in the file; UINT32_MAX if
 * none is held. Cost: logarithmic; linear in the first call after a change of benefits (heap_fresh
 * false). */
uint32_t umb__partial_worst(struct umb_partial *p);

/* The missing cubes in a box of voxels of one frustum. */
struct umb__lack {
    uint32_t level; /* Level of the largest missing cube; 0: none is missing */
    /* Lit share of the node above the largest missing cube; mixed and missing children count one
     * half */
    double occupancy;
};

/* Looks a box of voxels up in the graph. In: low, high: bounds, inclusive and inside the frustum.
 * want: true adds a benefit of 1 to each missing page found. */
struct umb__lack umb__partial_look(struct umb_partial *p, uint32_t frustum, const uint32_t low[3],
                                   const uint32_t high[3], bool want);

#endif
