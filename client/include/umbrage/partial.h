/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_PARTIAL_H
#define UMBRAGE_PARTIAL_H
/*
 * Partial assets: queries on some pages of a packed file, each proven by its hash.
 *
 *     struct umb_partial *partial;
 *     if (umb_partial_open(front, size, &options, &partial, &error) ||  // head.open_bytes
 *         umb_partial_build(partial, &error)) {                         // coarse answers
 *         return error.status;
 *     }
 *     uint32_t list[64];
 *     uint64_t offset;
 *     uint32_t length;
 *     size_t blocks, pages;
 *     do {
 *         if (umb_partial_want(partial, &view, 0, &error)) {  // which pages matter, and how much
 *             return error.status;
 *         }
 *         blocks = umb_partial_missing_blocks(partial, 0, list, 64);  // of the directory
 *         for (size_t i = 0; i < blocks; i++) {
 *             umb_partial_locate_block(partial, list[i], &offset, &length);
 *             // ... read `length` bytes at `offset` of the file into `stored`
 *             if (umb_partial_add_block(partial, list[i], stored, length, &error)) {
 *                 return error.status;
 *             }
 *         }
 *         pages = umb_partial_missing(partial, list, 64, 0);  // the best first
 *         for (size_t i = 0; i < pages; i++) {
 *             umb_partial_locate(partial, list[i], &offset, &length);
 *             // ... and in the same way its bytes
 *             if (umb_partial_add(partial, list[i], stored, length, &error)) {
 *                 return error.status;
 *             }
 *         }
 *         if (umb_partial_build(partial, &error)) {  // lays out what is here
 *             return error.status;
 *         }
 *     } while (blocks + pages > 0);
 *     if (umb_partial_query(partial, &settings, &points, 0, &answers, &error)) {
 *         return error.status;
 *     }
 *     umb_partial_close(partial);
 *
 * umbrage/region.h does all of that over a source of byte ranges.
 *
 * Answers without a page: the held pages are laid out as two assets. In the lower asset every
 * missing subtree is all shadowed, in the upper asset all lit. Both are ordinary assets, so every
 * query runs on them unchanged. A page is expanded once, when it comes; no other page is touched,
 * but for the nodes that refer to it. A window counts lit voxels, so the truth lies between the two
 * answers. Where they are equal, the answer is exact: bit for bit that of the whole file. Elsewhere
 * the answer is the occupancy of the deepest node held, clamped to the two.
 *
 * Trust: safe on hostile bytes. Head, directory and canonical block are checked against the id.
 * Each page is checked against its SHA-256 in the directory, for its structure, and for its links
 * to the held pages. A wrong page is refused by its number, and the held ones stay.
 * Memory: everything stays within options.max_memory_bytes: pages as stored, which umb_partial_save
 * writes, and their nodes. A build that does not fit drops the pages of the least benefit, which
 * are then missing again.
 * zstd's working memory (about 0.2 MiB) comes from malloc on top.
 * Threads: one at a time; but between two builds any number may query.
 * Space: voxels and boxes as in umbrage/geom.h.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/file.h"
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_partial; /* opaque */

struct umb_partial_options {
    const struct umb_sha256 *sha256; /* Hash that proves pages: umb_sha256_openssl() of libumbrage,
                                        or the caller's (umbrage/file.h); needed; borrowed until
                                        close */
    const uint8_t *id;               /* uint8[UMB_ID_BYTES], the id to require; NULL: any */
    uint64_t max_memory_bytes;       /* Memory budget; 0 = 1 GiB; too little for the head:
                                        E_TOO_LARGE */
    const struct umb_alloc *alloc;   /* NULL = malloc; must outlive the partial asset */
    uint64_t reserved[4];            /* Zero: room for later versions (umbrage/version.h) */
};

/* The points that a program will ask about, and how exactly. World space, metres, radians. */
struct umb_partial_view {
    uint32_t light;     /* Index of the light; UINT32_MAX: all lights */
    int has_box;        /* 1: only pages that answer points in `box` */
    struct umb_box box; /* Box: finite, min <= max */
    int has_camera;     /* 1: only pages that answer points in the camera's view; near ones first */
    struct umb_camera camera; /* near_m is not read; far_m: distance from the eye, 0 = no limit */
    double max_error_m;       /* Edge in metres of cells that need no finer pages; 0: exact */
    double max_error_rad;     /* Angle at the eye of cells that need no finer pages, such as half a
                                 pixel; 0: exact */
    uint32_t taps;            /* Widest window of the queries to come, texels; 0 = UMB_TAPS_MAX */
    double bias_m;            /* Amount in metres by which the longest bias of later queries exceeds
                                 that of UMB_BIAS_AUTO */
    uint64_t reserved[4];     /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_partial_stats {
    uint32_t page_count, pages_held;          /* Pages of the asset; pages held */
    uint64_t asset_bytes;                     /* Length of the packed file */
    uint64_t head_bytes;                      /* Length of its head */
    uint64_t held_bytes;                      /* Stored bytes of the pages held */
    uint64_t memory_bytes, memory_peak_bytes; /* Memory in use now and at most */
    uint64_t pages_dropped;                   /* Pages that the budget dropped since open */
    uint64_t builds;                          /* Number of builds */
    uint32_t block_count, blocks_held;        /* Blocks of the directory; blocks held */
    uint64_t pages_inherited; /* Pages taken over from another version (umb_partial_inherit) */
    uint64_t spare_bytes;     /* Stored bytes of another version's pages that no entry has named */
    uint64_t reserved[2];     /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Opens a partial asset from the front of a packed file: the file's head, and the first block of
 * the directory if all of it is there. Bytes behind that block are ignored.
 *
 * In:    front: uint8[size], copied. options: copied, except what it borrows.
 * Out:   out: the partial asset without a page, or NULL on failure.
 * Fails: as umb_asset_open_bytes; E_UNSUPPORTED (a mapped file), E_CORRUPT (not the required id, or
 *        a content that its id does not name), E_TOO_LARGE (head or directory beyond the budget).
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_open(const void *front, size_t size,
                                                     const struct umb_partial_options *options,
                                                     struct umb_partial **out,
                                                     struct umb_error *error);

/* Frees a partial asset. NULL is allowed. */
UMB_API void umb_partial_close(struct umb_partial *partial);

/*
 * Adds one block of the directory as stored in the file: the places and hashes of some pages. A
 * page can be added once its block is held.
 *
 * In:    bytes: uint8[size], copied.
 * Fails: E_ARGUMENT (no such block), E_EXISTS (the block is held), E_CORRUPT (length, checksum,
 *        SHA-256, or pages beyond the file), E_VERSION. The block is then not held.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_add_block(struct umb_partial *partial,
                                                          uint32_t block, const void *bytes,
                                                          size_t size, struct umb_error *error);

/* Fills in where a block stands in the file, in bytes. In: block: below block_count. */
UMB_API void umb_partial_locate_block(const struct umb_partial *partial, uint32_t block,
                                      uint64_t *offset, uint32_t *length);

/*
 * Lists missing blocks in the order of the file. all: every missing block; else those with missing
 * pages that matter. In place of a block that is in another version too (umb_partial_inherit), the
 * list has the block before it that tells its place. Returns the number of listed blocks, at most
 * room.
 */
UMB_API size_t umb_partial_missing_blocks(const struct umb_partial *partial, int all,
                                          uint32_t *list, size_t room);

/*
 * Adds one page as stored in the file; queries use it from the next build on. If the memory budget
 * is used up, pages of less benefit are dropped for the new page.
 *
 * In:    stored: uint8[size], copied.
 * Fails: E_ARGUMENT (no such page), E_STATE (its block of the directory is missing), E_EXISTS (the
 *        page is held), E_CORRUPT (length, checksum, SHA-256, structure, or links to or from held
 *        pages), E_VERSION, E_NO_MEMORY (beyond the budget, and no held page is of less benefit).
 *        The page is then not held.
 * Cost:  linear in the page.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_add(struct umb_partial *partial, uint32_t page,
                                                    const void *stored, size_t size,
                                                    struct umb_error *error);

/*
 * Takes over pages of another version of the asset: those that `from` holds, and those that it had
 * inherited and not used; and blocks of the directory that both versions have, as soon as their
 * neighbours tell the places of their pages. From now on a page whose hash stands in a held block
 * of the directory, or in one that is added later, is held without having been read again. Each
 * such page passes the checks of umb_partial_add; a page that fails them stays missing. `from` is
 * then only good for queries of its last build, and for umb_partial_close.
 *
 * In:    from: another partial asset with the same allocator.
 * Fails: E_ARGUMENT (from), E_STATE (has inherited before, and some of it is left), E_NO_MEMORY
 *        (list of the pages). `from` then keeps its pages.
 * Cost:  here and in all later umb_partial_add_block together: each page is tried once, so linear
 *        in the pages that `from` held, and a binary search for each entry of the directory. Pages
 *        without an entry take memory until the budget needs it.
 */
UMB_API UMB_CHECKED enum umb_status
umb_partial_inherit(struct umb_partial *partial, struct umb_partial *from, struct umb_error *error);

/* Drops a page; it can be added again. Queries still use its nodes until the next build. */
UMB_API void umb_partial_drop(struct umb_partial *partial, uint32_t page);

/* Returns 1 if a page is held, else 0. */
UMB_API int umb_partial_has(const struct umb_partial *partial, uint32_t page);

/* Fills in where a page stands in the file, in bytes. In: page: below page_count. Fails:
 * E_NOT_FOUND (its block of the directory is missing); offset and length are then 0. */
UMB_API enum umb_status umb_partial_locate(const struct umb_partial *partial, uint32_t page,
                                           uint64_t *offset, uint32_t *length);

/* A page, as its entry in the directory describes it. */
struct umb_partial_page {
    uint8_t hash[UMB_ID_BYTES];       /* SHA-256 of the page's uncompressed bytes */
    uint64_t offset;                  /* Place in the file */
    uint32_t stored_bytes, raw_bytes; /* Length as stored, and uncompressed */
    uint32_t level_high, level_low;   /* Highest and lowest level of its nodes */
    uint32_t node_count;              /* Number of nodes and bricks */
    int held;                         /* 1 if the page is held */
    uint64_t reserved[4];             /* Zero: room for later versions (umbrage/version.h) */
};

/* Fills in the description of a page. In: page: below page_count. Fails: E_NOT_FOUND (its block of
 * the directory is missing); the description is then zero. */
UMB_API enum umb_status umb_partial_get_page(const struct umb_partial *partial, uint32_t page,
                                             struct umb_partial_page *info);

/* Returns the head's bytes: uint8[head_bytes], borrowed until close. */
UMB_API const uint8_t *umb_partial_head(const struct umb_partial *partial);

/*
 * Sets which pages matter from now on. Every page that the view needs gets a benefit, as far as the
 * pages of the last build tell. `add` keeps the benefits of earlier views, for several lights or
 * cameras.
 *
 * Fails: E_ARGUMENT (view; the field is named), E_STATE (nothing built yet).
 * Cost:  linear in the nodes of the pages held: at most 17 steps for each node, plus 1024. If a
 *        view needs more steps, pages beyond the view's border get a benefit too. Only hostile
 *        assets need more steps: in such an asset a few nodes stand for very many cubes at the
 *        border.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_want(struct umb_partial *partial,
                                                     const struct umb_partial_view *view, int add,
                                                     struct umb_error *error);

/*
 * Lists missing pages that matter and whose place is known, the greatest benefit per stored byte
 * first.
 *
 * In:    room: length of list. budget_bytes: most stored bytes to list; 0 = no limit.
 * Out:   list: page numbers. Returns their number; 0: no needed page is missing, or all are too
 *        large.
 */
UMB_API size_t umb_partial_missing(const struct umb_partial *partial, uint32_t *list, size_t room,
                                   uint64_t budget_bytes);

/*
 * Brings the layout for queries up to date with the held pages. To keep within the memory budget,
 * it drops pages without benefit first, then those of the least benefit.
 *
 * Fails: E_NO_MEMORY (the budget is too small even without pages), E_CORRUPT.
 * Cost:  linear in the pages added or dropped since the last build, and in the references of other
 *        held pages to them. If a page has nodes of level 9 or above, also in the cells of the
 *        grids: at most 2^18 a frustum, and a sixteenth of the memory budget.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_build(struct umb_partial *partial,
                                                      struct umb_error *error);

/* Returns the lower asset of the last build, in which every missing subtree is shadowed. Its info,
 * lights and frusta are those of the whole asset. Borrowed until the next build; NULL before the
 * first. */
UMB_API const struct umb_asset *umb_partial_lower(const struct umb_partial *partial);

/* Answers of a partial asset. Arrays of points->count; only values is needed. */
struct umb_partial_answers {
    float *values;     /* Best estimates, within [low, high] */
    float *low, *high; /* Bounds of the true answer; equal where it is known */
    float *error_m;    /* Widest edge in metres of the missing cubes, 0 where exact; under a spot or
                          point light, that of the cube's far side */
    uint64_t exact;    /* Out: number of points whose low and high are equal */
    double worst_error_m;         /* Out: greatest error_m */
    struct umb_query_stats stats; /* Counts of the run on the lower asset, added to */
    uint64_t reserved[4];         /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Answers points as umb_query_run does, as exactly as the held pages allow.
 *
 * In:    settings: format is ignored; answers are floats.
 *        want: 1 adds a benefit of 1 to each page that an inexact point needs, so that
 *        umb_partial_missing lists it; no other thread may then query.
 * Fails: as umb_query_prepare and umb_points_check; E_STATE (nothing built yet), E_NO_MEMORY,
 *        E_UNSUPPORTED (penumbras and footprints, which no two bounds enclose).
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_query(struct umb_partial *partial,
                                                      const struct umb_query_settings *settings,
                                                      const struct umb_points *points, int want,
                                                      struct umb_partial_answers *answers,
                                                      struct umb_error *error);

/* Fills in stats. Never fails. */
UMB_API void umb_partial_get_stats(const struct umb_partial *partial,
                                   struct umb_partial_stats *stats);

/*
 * Writes the held blocks and pages as a partial file (docs/reference/umb-format.md, section 7).
 *
 * Fails: E_NO_MEMORY, or what the sink returns.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_save(const struct umb_partial *partial,
                                                     const struct umb_sink *sink,
                                                     struct umb_error *error);

/*
 * Opens a partial file from memory, and builds it.
 *
 * In:    bytes: uint8[size], copied.
 * Owns:  the caller closes it with umb_partial_close.
 * Fails: as umb_partial_open, umb_partial_add and umb_partial_build; E_FORMAT, E_TRUNCATED.
 */
UMB_API UMB_CHECKED enum umb_status
umb_partial_open_saved(const void *bytes, size_t size, const struct umb_partial_options *options,
                       struct umb_partial **out, struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
