/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_READ_H
#define UMBRAGE_CORE_FORMAT_PACK_READ_H
/* Reading the pages of a packed file into an octree. */
#include <stdbool.h>
#include "format/canonical.h"
#include "format/head.h"

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

/* Compares each block of the directory with its hash in the head, and each page's uncompressed
 * bytes with its hash in the block. */
UMB_CHECKED enum umb_status umb__pages_prove(const uint8_t *file, const struct umb__head *head,
                                             const struct umb_sha256 *sha256,
                                             struct umb_error *error);

#endif
