/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_PAGE_COMPARE_H
#define UMBRAGE_SERVER_BAKE_WRITE_PAGE_COMPARE_H
/*
 * Comparison of a written packed file with the octree that it was written from.
 *
 * A client that reads a file makes an octree of it, and looks up each node among those that it has.
 * The bake has the octree already. So it reads the same pages with the same checks, and matches
 * their nodes with the octree's: first the roots, then the children of each matched pair. The file
 * holds exactly the octree if
 *
 * - no node of the file has two partners, and each has one;
 * - partners have the same states of children, or the same voxels;
 * - their mixed children are partners, too;
 * - the file counts as many nodes as the octree has.
 *
 * Each page must also have the hash that the directory names: clients look pages up by it.
 *
 * The comparison uses nothing that the writer noted about pages. So it finds errors of the writer,
 * of the compression and of the disk.
 */
#include "format/canonical.h"
#include "format/head.h"
#include "format/octree.h"
#include "umbrage/workers.h"

struct umbb_page_compare {
    const struct umb__octree *octree; /* canonical */
    const struct umb_workers *workers;
    int (*cancelled)(void); /* called every few pages on any of the threads */
};

/*
 * Compares the pages of a file with an octree.
 *
 * In:    file, head, canonical: the file's bytes, and its parsed head and canonical block.
 *        max_memory_bytes: limit of the memory for pages and their tables.
 * Fails: E_INTERNAL (the file is not of this octree), E_CORRUPT and E_VERSION (a page cannot be
 *        read), E_TOO_LARGE (max_memory_bytes), E_NO_MEMORY, E_CANCELLED.
 * Trust: safe on hostile bytes, also if another process overwrites them.
 * Cost:  linear in the file, shared by the workers.
 */
UMB_CHECKED enum umb_status umbb_pages_compare(const struct umbb_page_compare *compare,
                                               const uint8_t *file, const struct umb__head *head,
                                               const struct umb__canonical *canonical,
                                               uint64_t max_memory_bytes, struct umb_error *error);

#endif
