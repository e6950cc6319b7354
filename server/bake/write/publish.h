/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_PUBLISH_H
#define UMBRAGE_SERVER_BAKE_WRITE_PUBLISH_H
/*
 * From octree to file: write a temporary, read it again and compare it with the octree, compare the
 * octree with traced rays, and only then give the file its name. A file that fails a check never
 * appears under the name.
 *
 *     umbb_publish_begin(&publish, "city.umb", &error);     early: shows an unwritable place
 *     umbb_publish_write(&publish, &content, &octree, &error);
 *     umbb_publish_check(&publish, &octree, &check, &error);
 *     umbb_publish_commit(&publish, &error);
 *     umbb_publish_abandon(&publish);                       no effect after commit
 */
#include "tool/output.h"
#include "bake/write/self_check.h"
#include "format/content.h"

struct umbb_publish {
    struct umbu_output file;
    unsigned threads; /* threads that write may use: 1 after begin, the caller may raise it */
    const struct umb__pack_kept *kept; /* as in struct umb__pack_job, set by the caller: NULL */
    void (*made)(void *user, const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                 uint32_t page_count);
    void *made_user;
    uint8_t id[UMB_ID_BYTES];
    uint64_t bytes;              /* size of the file */
    struct umb_asset_info info;  /* set by check, without strings and sizes in memory */
    struct umbb_checked checked; /* set by check */
};

/* Starts the temporary. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_publish_begin(struct umbb_publish *publish, const char *path,
                                               struct umb_error *error);

/* Writes the asset. Fails: the errors of umb__pack_write; E_IO; E_CANCELLED after a signal. */
UMB_CHECKED enum umb_status umbb_publish_write(struct umbb_publish *publish,
                                               const struct umb__content *content,
                                               const struct umb__octree *octree,
                                               struct umb_error *error);

/*
 * Opens the temporary with full validation, compares all its nodes with the octree's
 * (write/page_compare.h) and its identity with the one written, and traces rays.
 *
 * With many lights each gets fewer points, but not fewer than 20000 (or the requested number).
 * In:    octree: as for umbb_publish_write. It may be taken over; finish it anyway. check: with
 *        records, only the tiles that were not inherited are laid out (write/octree_part.h).
 * Fails: E_INTERNAL if the file differs from what was written; E_LIMIT if opening takes more than
 *        max_memory_bytes; the errors of umbb_self_check_part, and other failures of opening.
 */
UMB_CHECKED enum umb_status umbb_publish_check(struct umbb_publish *publish,
                                               struct umb__octree *octree,
                                               const struct umbb_check *check,
                                               struct umb_error *error);

/* Gives the file its name. Fails: E_IO, E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_publish_commit(struct umbb_publish *publish,
                                                struct umb_error *error);

void umbb_publish_abandon(struct umbb_publish *publish);

#endif
