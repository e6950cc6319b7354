/* SPDX-License-Identifier: Apache-2.0 */
/* The steps between an octree in memory and an asset under its name. */
#include "bake/write/publish.h"

#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "bake/base/interrupt.h"
#include "bake/write/octree_part.h"
#include "bake/write/page_compare.h"
#include "common/sha256.h"
#include "format/asset_parts.h"

enum umb_status umbb_publish_begin(struct umbb_publish *publish, const char *path,
                                   struct umb_error *error)
{
    memset(publish, 0, sizeof *publish);
    publish->threads = 1;
    return umbu_output_begin(path, 0, &publish->file, error);
}

/* A sink that counts bytes, checks for signals, and passes bytes on to the file's sink. */
struct counter {
    struct umb_sink file;
    uint64_t bytes;
};

static enum umb_status counted_write(void *user, const void *bytes, size_t count)
{
    struct counter *counter = user;
    if (umbb_interrupted()) {
        return UMB_E_CANCELLED;
    }
    counter->bytes += count;
    return counter->file.write(counter->file.user, bytes, count);
}

enum umb_status umbb_publish_write(struct umbb_publish *publish, const struct umb__content *content,
                                   const struct umb__octree *octree, struct umb_error *error)
{
    struct counter counter = {.file = umbu_output_sink(&publish->file)};
    const struct umb_sink sink = {counted_write, &counter};
    if (error != NULL) {
        error->message[0] = '\0';
    }
    struct umbu_threads *jobs;
    UMB__TRY(umbu_threads_create(publish->threads, &jobs, error));
    const struct umb_workers workers = umbu_threads_workers(jobs);
    const struct umb__pack_job job = {.content = content,
                                      .octree = octree,
                                      .sha256 = &umbs_sha256,
                                      .sink = &sink,
                                      .workers = &workers,
                                      .kept = publish->kept,
                                      .made = publish->made,
                                      .made_user = publish->made_user,
                                      .cancelled = umbb_interrupted};
    enum umb_status status = umb__pack_run(&job, publish->id, error);
    umbu_threads_destroy(jobs);
    publish->bytes = counter.bytes;
    if (status == UMB_E_CANCELLED) {
        return umb_fail(error, status, "interrupted: nothing was written");
    }
    return status == UMB_OK ? UMB_OK : umbu_output_explain(&publish->file, status, error);
}

/* Data of a reader of pages that compares the written file with its octree. */
struct read_back {
    struct umbb_page_compare compare;
    struct umb__octree *octree;
    const struct umbb_proofs *part; /* the tiles to be laid out; NULL: all */
    int is_compared;                /* 1: the file was found to hold the octree */
};

/* Compares the pages with the octree. If they agree, hands the octree, or a copy of its part, over
 * as the result of reading the pages. */
static enum umb_status read_pages(void *user, const uint8_t *file, const struct umb__head *head,
                                  const struct umb__canonical *canonical, uint64_t max_memory_bytes,
                                  struct umb__octree *octree, struct umb_error *error)
{
    struct read_back *back = user;
    if (!back->is_compared) {
        UMB__TRY(
            umbb_pages_compare(&back->compare, file, head, canonical, max_memory_bytes, error));
        back->is_compared = 1;
    }
    if (back->part != NULL) {
        const enum umb_status status = umbb_octree_part(back->octree, back->part, octree, error);
        if (status != UMB_OK) {
            umb__octree_finish(octree);
        }
        return status;
    }
    *octree = *back->octree;
    memset(back->octree, 0, sizeof *back->octree);
    return UMB_OK;
}

/* Opens the written file. */
static enum umb_status reopen(const struct umbb_publish *publish, struct read_back *back,
                              uint64_t max_memory_bytes, struct umb_asset **asset,
                              struct umb_error *error)
{
    const struct umb_open_options options = {.max_memory_bytes = max_memory_bytes,
                                             .alloc = back->octree->alloc};
    struct umbu_threads *threads;
    struct umb_error cause;
    UMB__TRY(umbu_threads_create(publish->threads, &threads, error));
    const struct umb_workers workers = umbu_threads_workers(threads);
    back->compare = (struct umbb_page_compare){back->octree, &workers, umbb_interrupted};
    const struct umb__page_reader reader = {read_pages, back};
    const enum umb_status status =
        umb__asset_open_by(&reader, publish->file.temporary, &options, asset, &cause);
    umbu_threads_destroy(threads);
    if (status == UMB_E_TOO_LARGE) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: too little is left to check what was baked; give more or lower "
                        "the resolution (%s)",
                        cause.message);
    }
    if (status != UMB_OK && error != NULL) {
        *error = cause;
    }
    return status;
}

/* Keeps what the head of the opened file says, and compares its identity with the one written. */
static enum umb_status check_head(struct umbb_publish *publish, const struct umb_asset *asset,
                                  struct umb_error *error)
{
    struct umb_asset_info *info = &publish->info;
    umb_asset_get_info(asset, info);
    info->plan = info->settings = info->notes = NULL;
    info->grid_bytes = info->node_bytes = info->brick_bytes = info->memory_bytes = 0;
    return memcmp(info->id, publish->id, sizeof publish->id) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_INTERNAL,
                          "self-check: the identity read back is not the one written");
}

/* Compares an opened file with rays. In: asset: of the part; it is opened again where all voxels
 * are needed. */
static enum umb_status check_voxels(struct umbb_publish *publish, struct read_back *back,
                                    const struct umbb_check *check, struct umb_asset **asset,
                                    struct umb_error *error)
{
    int sample;
    UMB__TRY(umbb_self_check_part(*asset, check, &publish->checked, &sample, error));
    if (sample && back->part != NULL) {
        umb_asset_close(*asset);
        *asset = NULL;
        back->part = NULL;
        UMB__TRY(reopen(publish, back, check->max_memory_bytes, asset, error));
        UMB__TRY(check_head(publish, *asset, error));
    }
    return sample ? umbb_self_check_points(*asset, check, &publish->checked, error) : UMB_OK;
}

enum umb_status umbb_publish_check(struct umbb_publish *publish, struct umb__octree *octree,
                                   const struct umbb_check *check, struct umb_error *error)
{
    const int part =
        check->points > 0 && check->proofs != NULL && umbb_octree_part_pays(check->proofs);
    struct read_back back = {.octree = octree, .part = part ? check->proofs : NULL};
    struct umb_asset *asset = NULL;
    enum umb_status status = reopen(publish, &back, check->max_memory_bytes, &asset, error);
    if (status == UMB_OK) {
        status = check_head(publish, asset, error);
    }
    if (status == UMB_OK && check->points > 0) {
        status = check_voxels(publish, &back, check, &asset, error);
    }
    umb_asset_close(asset);
    if (status == UMB_OK && umbb_interrupted()) {
        status = umb_fail(error, UMB_E_CANCELLED, "interrupted: nothing was written");
    }
    return status;
}

enum umb_status umbb_publish_commit(struct umbb_publish *publish, struct umb_error *error)
{
    return umbu_output_commit(&publish->file, error);
}

void umbb_publish_abandon(struct umbb_publish *publish)
{
    umbu_output_abandon(&publish->file);
}
