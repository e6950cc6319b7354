/* SPDX-License-Identifier: Apache-2.0 */
/* Opening and describing assets; see umbrage/asset.h. */
#include <string.h>

#include "base/memory.h"
#include "base/reserved.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/asset_parts.h"
#include "format/receiver_mask.h"

#define DEFAULT_MAX_MEMORY ((uint64_t)64 << 30)

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "opening: out of memory");
}

/* Copies the parts of the head that outlive the file, and points `head` to the copies. Another
 * process may overwrite a mapped file, but not these checked copies. */
static enum umb_status keep_head(struct umb_asset *asset, struct umb__head *head,
                                 struct umb_error *error)
{
    asset->encoding = head->encoding;
    asset->file_bytes = head->file_length;
    memcpy(asset->id, head->id, UMB_ID_BYTES);
    asset->canonical_length = head->canonical_length;
    asset->canonical_bytes = umb__alloc(asset->alloc, (size_t)head->canonical_length, 1);
    asset->notes = umb__alloc(asset->alloc, (size_t)head->info_length + 1, 1);
    if (!asset->canonical_bytes || !asset->notes) {
        return no_memory(error);
    }
    memcpy(asset->canonical_bytes, head->canonical, (size_t)head->canonical_length);
    memcpy(asset->notes, head->info, head->info_length);
    asset->notes[head->info_length] = '\0';
    head->canonical = asset->canonical_bytes;
    head->info = (const uint8_t *)asset->notes;
    if (!umb__utf8_valid(head->info, head->info_length)) {
        return umb_fail(error, UMB_E_CORRUPT, "info: %u bytes are not UTF-8 text",
                        head->info_length);
    }
    return UMB_OK;
}

/* What is opened. */
struct source {
    const char *path; /* File; NULL: `bytes` */
    const void *bytes;
    size_t size;
    const struct umb_open_options *options;
    const struct umb__page_reader *reader; /* Reader of packed pages; NULL: umb__pack_read */
};

static enum umb_status open_packed(struct umb_asset *asset, const struct source *source,
                                   const uint8_t *bytes, const struct umb__head *head, int full,
                                   uint64_t max_memory, struct umb_error *error)
{
    const struct umb__page_reader *reader = source->reader;
    struct umb__octree octree;
    UMB__TRY(reader ? reader->read(reader->user, bytes, head, &asset->canonical, max_memory,
                                   &octree, error)
                    : umb__pack_read(bytes, head, &asset->canonical, full, max_memory, asset->alloc,
                                     &octree, error));
    const enum umb_status status =
        umb__mapped_build(&octree, &asset->canonical.content, max_memory, &asset->mapped, error);
    umb__octree_finish(&octree);
    return status;
}

static enum umb_status open_mapped(struct umb_asset *asset, const struct source *source,
                                   const uint8_t *bytes, const struct umb__head *head, int full,
                                   struct umb_error *error)
{
    if (source->reader) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "encoding: a mapped file has no pages");
    }
    if ((uintptr_t)bytes % 64 != 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "bytes: at an address %u bytes beyond a multiple of 64, a mapped asset "
                        "must be at one",
                        (unsigned)((uintptr_t)bytes % 64));
    }
    asset->mapped.alloc = asset->alloc;
    return umb__mapped_view(bytes, head, &asset->canonical.content, full, &asset->mapped, error);
}

static enum umb_status open_bytes(struct umb_asset *asset, const struct source *source,
                                  const uint8_t *bytes, size_t size, struct umb_error *error)
{
    const struct umb_open_options *options = source->options;
    const int full = !(options && options->trust == UMB_TRUST_VALIDATED);
    uint64_t max_memory =
        options && options->max_memory_bytes ? options->max_memory_bytes : DEFAULT_MAX_MEMORY;
    max_memory = max_memory < SIZE_MAX / 2 ? max_memory : SIZE_MAX / 2; /* Sizes fit size_t */
    struct umb__head head;
    UMB__TRY(umb__head_parse(bytes, size, &head, error));
    UMB__TRY(keep_head(asset, &head, error));
    UMB__TRY(umb__canonical_decode(head.canonical, head.canonical_length, asset->alloc,
                                   &asset->canonical, error));
    UMB__TRY(head.encoding == UMB_ENCODING_PACKED
                 ? open_packed(asset, source, bytes, &head, full, max_memory, error)
                 : open_mapped(asset, source, bytes, &head, full, error));
    asset->view = asset->mapped.view;
    return UMB_OK;
}

static enum umb_status open_file(struct umb_asset *asset, const struct source *source,
                                 struct umb_error *error)
{
    UMB__TRY(umb_file_open(source->path, &asset->file, error));
    UMB__TRY(open_bytes(asset, source, asset->file.bytes, asset->file.size, error));
    if (asset->encoding == UMB_ENCODING_PACKED) {
        umb_file_close(&asset->file); /* The asset is expanded: the file is no longer needed */
    }
    return UMB_OK;
}

static enum umb_status open_source(const struct source *source, struct umb_asset **out,
                                   struct umb_error *error)
{
    const struct umb_open_options *options = source->options;
    const struct umb_alloc *alloc = options ? options->alloc : NULL;
    *out = NULL;
    if (options && UMB__UNKNOWN(options, "options", error)) {
        return UMB_E_ARGUMENT;
    }
    struct umb_asset *asset = umb__alloc_zeroed(alloc, 1, sizeof *asset);
    if (!asset) {
        return no_memory(error);
    }
    asset->alloc = alloc;
    const enum umb_status status =
        source->path ? open_file(asset, source, error)
                     : open_bytes(asset, source, source->bytes, source->size, error);
    if (status != UMB_OK) {
        umb_asset_close(asset);
        return status;
    }
    *out = asset;
    return UMB_OK;
}

enum umb_status umb_asset_open_bytes(const void *bytes, size_t size,
                                     const struct umb_open_options *options, struct umb_asset **out,
                                     struct umb_error *error)
{
    const struct source source = {.bytes = bytes, .size = size, .options = options};
    return open_source(&source, out, error);
}

enum umb_status umb_asset_open_file(const char *path, const struct umb_open_options *options,
                                    struct umb_asset **out, struct umb_error *error)
{
    const struct source source = {.path = path, .options = options};
    return open_source(&source, out, error);
}

enum umb_status umb__asset_open_by(const struct umb__page_reader *reader, const char *path,
                                   const struct umb_open_options *options, struct umb_asset **out,
                                   struct umb_error *error)
{
    const struct source source = {.path = path, .options = options, .reader = reader};
    return open_source(&source, out, error);
}

void umb_asset_close(struct umb_asset *asset)
{
    if (!asset) {
        return;
    }
    const struct umb_alloc *alloc = asset->alloc;
    umb__mapped_finish(&asset->mapped);
    umb__canonical_finish(&asset->canonical, alloc);
    umb__free(alloc, asset->canonical_bytes);
    umb__free(alloc, asset->notes);
    umb_file_close(&asset->file);
    umb__free(alloc, asset);
}

void umb_asset_get_info(const struct umb_asset *asset, struct umb_asset_info *info)
{
    const struct umb__content *content = &asset->canonical.content;
    memset(info, 0, sizeof *info);
    memcpy(info->id, asset->id, UMB_ID_BYTES);
    info->encoding = asset->encoding;
    info->file_bytes = asset->file_bytes;
    info->grid_bytes = asset->view.grid_count * 4 +
                       asset->view.column_count * sizeof *asset->view.columns +
                       asset->view.piece_count * 4;
    info->node_bytes = asset->view.node_words * 8;
    info->brick_bytes = asset->view.brick_count * 64;
    info->occluder_depth_bytes = content->occluder_depth_words * 4;
    info->transmittance_bytes = content->transmittance_bytes;
    info->receiver_mask_bytes = content->receiver_mask_cells != NULL
                                    ? content->frustum_count * UMB__RECEIVER_MASK_WORDS * 8
                                    : 0;
    info->memory_bytes = info->grid_bytes + info->node_bytes + info->brick_bytes +
                         info->occluder_depth_bytes + info->transmittance_bytes +
                         info->receiver_mask_bytes;
    info->light_count = content->light_count;
    info->frustum_count = content->frustum_count;
    memcpy(info->level_nodes, asset->canonical.counts, sizeof info->level_nodes);
    info->packed_bytes = asset->encoding == UMB_ENCODING_PACKED ? asset->file_bytes : 0;
    info->bytes_2014 = content->bytes_2014;
    memcpy(info->origin, content->origin, sizeof info->origin);
    info->bounds = content->bounds;
    memcpy(info->scene_hash, content->scene_hash, UMB_ID_BYTES);
    info->plan = content->plan;
    info->settings = content->settings;
    info->notes = asset->notes;
}

const char *umb_light_kind_name(enum umb_light_kind kind)
{
    static const char *const names[UMB_LIGHT_KINDS] = {"directional", "spot", "point", "rectangle",
                                                       "disc"};
    return (unsigned)kind < UMB_LIGHT_KINDS ? names[kind] : "unknown";
}

enum umb_status umb_asset_get_light(const struct umb_asset *asset, uint32_t index,
                                    struct umb_light_info *info)
{
    if (index >= asset->canonical.content.light_count) {
        return UMB_E_NOT_FOUND;
    }
    *info = asset->canonical.content.lights[index];
    return UMB_OK;
}

enum umb_status umb_asset_get_frustum(const struct umb_asset *asset, uint32_t index,
                                      struct umb_frustum_info *info)
{
    if (index >= asset->canonical.content.frustum_count) {
        return UMB_E_NOT_FOUND;
    }
    *info = asset->canonical.content.frusta[index];
    return UMB_OK;
}
