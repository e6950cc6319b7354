/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_ASSET_PARTS_H
#define UMBRAGE_CORE_FORMAT_ASSET_PARTS_H
/* The parts of an open asset; private to the core. */
#include "format/mapped.h"

struct umb_asset {
    const struct umb_alloc *alloc;
    struct umb__canonical canonical; /* Content and counts */
    struct umb__view view;           /* Arrays that queries read */
    struct umb__mapped mapped;       /* Owner of the view's arrays if the file was packed */
    uint8_t *canonical_bytes;        /* Canonical block as it stands in the file */
    uint64_t canonical_length;
    char *notes;
    uint8_t id[UMB_ID_BYTES];
    enum umb_encoding encoding;
    uint64_t file_bytes;
    struct umb_file file; /* Mapped file of this asset; zeroed if there is none */
};

/*
 * Expands all pages of a packed file.
 *
 * In:    check: 1 also verifies the XXH3 of each page; the structure is always checked.
 *        max_memory_bytes: limit of pages and octree together.
 * Out:   octree: numbered in the file's order, with copies of a node merged; finish it with
 *        umb__octree_finish.
 * Fails: E_CORRUPT, E_TRUNCATED, E_TOO_LARGE, E_NO_MEMORY.
 * Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umb__pack_read(const uint8_t *file, const struct umb__head *head,
                                           const struct umb__canonical *canonical, int check,
                                           uint64_t max_memory_bytes, const struct umb_alloc *alloc,
                                           struct umb__octree *octree, struct umb_error *error);

/* A reader of the pages of packed files, other than umb__pack_read. */
struct umb__page_reader {
    /* Makes the octree of the file's pages, with the allocator of the asset. Fails as
     * umb__pack_read. */
    enum umb_status (*read)(void *user, const uint8_t *file, const struct umb__head *head,
                            const struct umb__canonical *canonical, uint64_t max_memory_bytes,
                            struct umb__octree *octree, struct umb_error *error);
    void *user;
};

/* Opens a packed file as umb_asset_open_file does, with another reader of its pages. Fails: also
 * E_UNSUPPORTED (a mapped file). */
UMB_CHECKED enum umb_status umb__asset_open_by(const struct umb__page_reader *reader,
                                               const char *path,
                                               const struct umb_open_options *options,
                                               struct umb_asset **out, struct umb_error *error);

#endif
