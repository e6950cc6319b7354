/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_PARTIAL_H
#define UMBRAGE_PARTIAL_H
/*
 * Partial assets: some pages of a packed file, proven one by one, and what can be answered from
 * them.
 *
 *     struct umb_partial *partial;
 *     if (umb_partial_open(front, size, &options, &partial, &error) ||  // head.open_bytes
 *         umb_partial_build(partial, &error)) {                         // coarse answers
 *         return error.status;
 *     }
 *     uint32_t pages[64];
 *     size_t count;
 *     do {
 *         if (umb_partial_want(partial, &view, 0, &error)) {  // which pages matter, and how much
 *             return error.status;
 *         }
 *         count = umb_partial_missing(partial, pages, 64, 0);  // the best first
 *         for (size_t i = 0; i < count; i++) {
 *             uint64_t offset;
 *             uint32_t length;
 *             umb_partial_locate(partial, pages[i], &offset, &length);
 *             // ... read `length` bytes at `offset` of the file into `stored`
 *             if (umb_partial_add(partial, pages[i], stored, length, &error)) {
 *                 return error.status;
 *             }
 *         }
 *         if (umb_partial_build(partial, &error)) {  // lays out what is here
 *             return error.status;
 *         }
 *     } while (count > 0);
 *     if (umb_partial_query(partial, &settings, &points, 0, &answers, &error)) {
 *         return error.status;
 *     }
 *     umb_partial_close(partial);
 *
 * umbrage/region.h does all of that over a source of byte ranges.
 *
 * How a missing page is answered. What is there is laid out twice: in the lower asset every subtree
 * that is not there is all shadowed, in the upper one all lit. Both are ordinary assets, so that
 * every query runs on them as it is, and since a window counts lit voxels the truth lies between
 * the two answers. Where they are equal, the answer is exact, bit for bit that of the whole file.
 * Elsewhere it is the occupancy of the deepest node that is there, put between the two.
 *
 * Trust: head, directory and canonical block are checked against the id, each page against its
 * SHA-256 in the directory, its structure and its links to the pages that are there. Safe on
 * hostile bytes; what is wrong is refused with the page named, and the rest stays as it was.
 * Memory: everything, stored pages included, stays within options.max_memory_bytes: a build that
 * does not fit drops the pages that matter least and tries again. zstd's working memory (about 0.2
 * MiB) comes from malloc on top. A dropped page is missing again.
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
    const uint8_t *id;               /* uint8[UMB_ID_BYTES] that was asked for; NULL: any */
    uint64_t max_memory_bytes;       /* 0 = 1 GiB; less than the head takes: E_TOO_LARGE */
    const struct umb_alloc *alloc;   /* NULL = malloc; must outlive the partial */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* What one wants to see. World space, metres, radians. */
struct umb_partial_view {
    uint32_t light;     /* UINT32_MAX: all lights */
    int has_box;        /* only what answers points in `box` */
    struct umb_box box; /* finite, min <= max */
    int has_camera;     /* only what answers points in the camera's pyramid; nearer is better */
    struct umb_camera camera; /* near_m is not read; far_m: distance from the eye, 0 = no limit */
    double max_error_m;       /* cells this small need not be looked into; 0: exact */
    double max_error_rad;     /* the same, as seen from the eye: half a pixel, say; 0: exact */
    uint32_t taps;            /* widest window that will be asked; 0 = UMB_TAPS_MAX */
    double bias_m;            /* longest bias that will be asked beyond UMB_BIAS_AUTO's */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_partial_stats {
    uint32_t page_count, pages_held;          /* of the asset; here */
    uint64_t asset_bytes;                     /* of the packed file */
    uint64_t head_bytes;                      /* of its head */
    uint64_t held_bytes;                      /* stored bytes of the pages here */
    uint64_t memory_bytes, memory_peak_bytes; /* taken now and at most */
    uint64_t pages_dropped;                   /* by the budget, since open */
    uint64_t builds;
    uint32_t block_count, blocks_held; /* of the directory; here */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Opens the front of a packed file: its head at least. If the first block of the directory follows
 * whole, it is taken too; what comes behind is not looked at.
 *
 * In:    front: uint8[size], copied. options: copied, but for what it borrows.
 * Out:   out: the partial asset without a page, or NULL.
 * Fails: as umb_asset_open_bytes; E_UNSUPPORTED (a mapped file), E_CORRUPT (not the id that was
 *        asked for, or not what its own id says), E_TOO_LARGE (head or directory beyond the
 *        budget).
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_open(const void *front, size_t size,
                                                     const struct umb_partial_options *options,
                                                     struct umb_partial **out,
                                                     struct umb_error *error);

/* Frees it. NULL is allowed. */
UMB_API void umb_partial_close(struct umb_partial *partial);

/*
 * Takes one block of the directory as it stands in the file: where some pages stand, and their
 * hashes. A page can be added once its block is here.
 *
 * In:    bytes: uint8[size], copied.
 * Fails: E_ARGUMENT (no such block), E_EXISTS (it is here), E_CORRUPT (length, checksum, SHA-256,
 *        or pages that are not in the file), E_VERSION. The block is then not here.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_add_block(struct umb_partial *partial,
                                                          uint32_t block, const void *bytes,
                                                          size_t size, struct umb_error *error);

/* Where a block stands in the file. In: block: below block_count. */
UMB_API void umb_partial_locate_block(const struct umb_partial *partial, uint32_t block,
                                      uint64_t *offset, uint32_t *length);

/*
 * Lists blocks that are not here: those of pages that matter and are missing or, with `all`, every
 * one. In the order of the file. Returns how many; at most room.
 */
UMB_API size_t umb_partial_missing_blocks(const struct umb_partial *partial, int all,
                                          uint32_t *list, size_t room);

/*
 * Takes one page as it stands in the file.
 *
 * In:    stored: uint8[size], copied.
 * Fails: E_ARGUMENT (no such page), E_STATE (its block of the directory is not here), E_EXISTS (it
 *        is here), E_CORRUPT (length, checksum, SHA-256,
 *        structure, or links to or from pages that are here), E_VERSION, E_NO_MEMORY (beyond the
 *        budget, and no page here matters less: those are dropped first). The page is then not
 * here.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_add(struct umb_partial *partial, uint32_t page,
                                                    const void *stored, size_t size,
                                                    struct umb_error *error);

/* Forgets a page; it can be added again. The last build stays as it is. */
UMB_API void umb_partial_drop(struct umb_partial *partial, uint32_t page);

/* 1 if a page is here. */
UMB_API int umb_partial_has(const struct umb_partial *partial, uint32_t page);

/* Says where a page stands in the file. In: page: below page_count. Fails: E_NOT_FOUND, and zeros
 * (its block of the directory is not here). */
UMB_API enum umb_status umb_partial_locate(const struct umb_partial *partial, uint32_t page,
                                           uint64_t *offset, uint32_t *length);

/* The head's bytes: uint8[head_bytes], borrowed until close. */
UMB_API const uint8_t *umb_partial_head(const struct umb_partial *partial);

/*
 * Says what matters from now on: gives every page that a view leads to a benefit, as far as the
 * pages of the last build tell. `add` keeps what earlier views said, for several lights or cameras.
 *
 * Fails: E_ARGUMENT (view, named), E_STATE (nothing built yet).
 * Cost:  linear in the nodes of the pages held: at most 65 steps for each, plus 1024. A view that
 *        needs more gets pages beyond its border too. Only hostile assets need more: their border
 *        cuts very many cubes of few nodes.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_want(struct umb_partial *partial,
                                                     const struct umb_partial_view *view, int add,
                                                     struct umb_error *error);

/*
 * Lists missing pages that matter and whose place is known, the greatest benefit per stored byte
 * first.
 *
 * In:    room: of list. budget_bytes: stop before more stored bytes than this; 0 = no limit.
 * Out:   list: page numbers. Returns how many; 0: all that the view needs is here, or too large.
 */
UMB_API size_t umb_partial_missing(const struct umb_partial *partial, uint32_t *list, size_t room,
                                   uint64_t budget_bytes);

/*
 * Lays out what is there for queries. Within the memory budget: drops pages of no benefit first,
 * then those of least.
 *
 * Fails: E_NO_MEMORY (not even without pages), E_CORRUPT.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_build(struct umb_partial *partial,
                                                      struct umb_error *error);

/* The lower asset of the last build, in which every missing subtree is shadowed. It also says what
 * the whole asset is: info, lights, frusta. Borrowed until the next build; NULL before the first.
 */
UMB_API const struct umb_asset *umb_partial_lower(const struct umb_partial *partial);

/* Answers of a partial asset. Arrays of points->count; only values is needed. */
struct umb_partial_answers {
    float *values;     /* best guess, within [low, high] */
    float *low, *high; /* the truth lies between; equal where it is known */
    float *error_m;    /* 0 where exact, else the widest edge of a cube that is not there, metres:
                          its far side's, where rays part */
    uint64_t exact;    /* out: points whose low and high are equal */
    double worst_error_m;         /* out: greatest of error_m */
    struct umb_query_stats stats; /* of the lower asset, added to */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Answers points as umb_query_run does, as well as the pages at hand allow.
 *
 * In:    settings: format is ignored; answers are floats. want: 1 gives the pages that inexact
 *        points miss a benefit of 1 a point (umb_partial_missing then lists them); needs that no
 *        other thread queries.
 * Fails: as umb_query_prepare and umb_points_check; E_STATE (nothing built yet), E_NO_MEMORY,
 *        E_UNSUPPORTED (penumbras: their answers at the bounds do not enclose the truth).
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_query(struct umb_partial *partial,
                                                      const struct umb_query_settings *settings,
                                                      const struct umb_points *points, int want,
                                                      struct umb_partial_answers *answers,
                                                      struct umb_error *error);

UMB_API void umb_partial_get_stats(const struct umb_partial *partial,
                                   struct umb_partial_stats *stats);

/*
 * Writes what is here as a partial file (docs/reference/umb-format.md, section 7).
 *
 * Fails: E_NO_MEMORY, or what the sink returns.
 */
UMB_API UMB_CHECKED enum umb_status umb_partial_save(const struct umb_partial *partial,
                                                     const struct umb_sink *sink,
                                                     struct umb_error *error);

/*
 * Opens a partial file from memory, and builds it.
 * Fails: as umb_partial_open, umb_partial_add and umb_partial_build; E_FORMAT, E_TRUNCATED.
 */
UMB_API UMB_CHECKED enum umb_status
umb_partial_open_saved(const void *bytes, size_t size, const struct umb_partial_options *options,
                       struct umb_partial **out, struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
