/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_PUBLISH_H
#define UMBRAGE_SERVER_BAKE_WRITE_PUBLISH_H
/*
 * From octree to file: write a temporary, open it again as a stranger would, compare it with traced
 * rays, and only then give it its name. What fails a check never appears under the name.
 *
 *     umbb_publish_begin(&publish, "city.umb", &error);      early: refuses an unwritable place
 *     umbb_publish_write(&publish, &content, &octree, &error);
 *     umbb_publish_check(&publish, &check, &error);
 *     umbb_publish_commit(&publish, &error);
 *     umbb_publish_abandon(&publish);                        harmless after commit
 */
#include "tool/output.h"
#include "scene/scene_alpha.h"
#include "format/content.h"
#include "rays/verify.h"

struct umbb_publish {
    struct umbu_output file;
    unsigned threads; /* that write may use: 1 after begin, the caller's to raise */
    uint8_t id[UMB_ID_BYTES];
    uint64_t bytes;                     /* of the file */
    struct umb_asset_info info;         /* after check; its strings are gone */
    struct umbr_verify_result verified; /* after check, sums; zero if not asked for */
};

/* What the written asset is compared with. */
struct umbb_check {
    const double (*corners)[3][3]; /* world */
    const uint8_t *closed;         /* uint8[count] 1 = of a closed part; NULL = no closed rule */
    const struct umbs_cuts *cuts;  /* `of`: [count] */
    size_t count;
    size_t open_on_word; /* parts that --closed on takes for closed and that are not */
    uint64_t points;     /* of all lights together; 0 = open and validate only */
    unsigned threads;
    int quiet; /* no progress on a terminal */
    uint64_t max_memory_bytes;
};

/* Starts the temporary. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_publish_begin(struct umbb_publish *publish, const char *path,
                                               struct umb_error *error);

/* Writes the asset. Fails: as umb_pack_write; E_IO; E_CANCELLED after a signal. */
UMB_CHECKED enum umb_status umbb_publish_write(struct umbb_publish *publish,
                                               const struct umb_content *content,
                                               const struct umb_octree *octree,
                                               struct umb_error *error);

/*
 * Opens the temporary with full validation, compares its identity, and traces rays.
 *
 * Many lights get fewer points each, but not below 20000 of those that were asked for.
 * Fails: E_INTERNAL if the file is not what was written or disagrees with rays outside the band
 *        of one voxel (how many, and where), E_BAD_SCENE if it disagrees with open_on_word parts;
 *        E_LIMIT if opening takes more than max_memory_bytes; what else opening and tracing fail
 *        with.
 */
UMB_CHECKED enum umb_status umbb_publish_check(struct umbb_publish *publish,
                                               const struct umbb_check *check,
                                               struct umb_error *error);

/* Gives the file its name. Fails: E_IO, E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_publish_commit(struct umbb_publish *publish,
                                                struct umb_error *error);

void umbb_publish_abandon(struct umbb_publish *publish);

#endif
