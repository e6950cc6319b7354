/* SPDX-License-Identifier: Apache-2.0 */
/* Opens partial assets, and adds blocks of the directory; see partial.h. */
#include "umbrage/partial.h"

#include <float.h>
#include <string.h>
#include <zstd.h>

#include "base/reserved.h"
#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "partial/partial_parts.h"

#define DEFAULT_MAX_MEMORY ((uint64_t)1 << 30)

/* Checks that the head has the required id, and that the head's content hashes to this id. */
static enum umb_status check_id(struct umb_partial *p, const uint8_t *wanted,
                                struct umb_error *error)
{
    uint8_t id[UMB_ID_BYTES];
    if (wanted && memcmp(wanted, p->head.id, sizeof id) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: the head is that of another asset");
    }
    if (!umb__directory_identify(&p->head, p->sha256, &p->alloc, id)) {
        return umb__partial_no_memory(error, "the block hashes");
    }
    if (memcmp(id, p->head.id, sizeof id) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: does not match the canonical block and hashes");
    }
    return UMB_OK;
}

/* Makes room for the blocks. Adds the first one if the front holds all of it. */
static enum umb_status prepare_blocks(struct umb_partial *p, const uint8_t *front, size_t size,
                                      struct umb_error *error)
{
    p->blocks = umb__alloc_zeroed(&p->alloc, p->head.directory_count, sizeof *p->blocks);
    if (!p->blocks) {
        return umb_fail(error, UMB_E_TOO_LARGE, "directory: %u pages, the budget is %llu bytes",
                        p->head.page_count, (unsigned long long)p->meter.limit);
    }
    p->head.blocks = (const uint8_t *const *)p->blocks;
    const uint32_t first = p->head.first_block;
    return p->head.page_count > 0 && size - p->head.head_length >= first
               ? umb_partial_add_block(p, 0, front + p->head.head_length, first, error)
               : UMB_OK;
}

/* Finds the pages of the roots, and records which nodes these pages must have. */
static enum umb_status link_roots(struct umb_partial *p, struct umb_error *error)
{
    for (uint32_t i = 0; i < p->canonical.content.frustum_count; i++) {
        const struct umb__packed_root *root = &p->canonical.roots[i];
        const uint32_t level = p->canonical.content.frusta[i].log2_size;
        if (root->state != UMB__NODE_MIXED) {
            continue;
        }
        if (root->page >= p->head.page_count || root->position == UINT32_MAX) {
            return umb_fail(error, UMB_E_CORRUPT, "root %u: page %u is not there", i, root->page);
        }
        if (!umb__partial_note_link(p, level, root->page, root->position)) {
            return umb__partial_no_memory(error, "the roots");
        }
    }
    return UMB_OK;
}

static enum umb_status open_front(struct umb_partial *p, const void *front, size_t size,
                                  const uint8_t *id, struct umb_error *error)
{
    struct umb__head head;
    UMB__TRY(umb__head_parse_front(front, size, &head, error));
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "encoding: a mapped file has no pages");
    }
    p->head_bytes = umb__alloc(&p->alloc, (size_t)head.head_length, 1);
    if (!p->head_bytes) {
        return umb_fail(error, UMB_E_TOO_LARGE, "head: %llu bytes, the budget is %llu",
                        (unsigned long long)head.head_length, (unsigned long long)p->meter.limit);
    }
    memcpy(p->head_bytes, front, (size_t)head.head_length);
    UMB__TRY(umb__head_parse_front(p->head_bytes, (size_t)head.head_length, &p->head, error));
    UMB__TRY(check_id(p, id, error));
    UMB__TRY(umb__canonical_decode(p->head.canonical, p->head.canonical_length, &p->alloc,
                                   &p->canonical, error));
    p->zstd = ZSTD_createDCtx();
    p->pages = umb__alloc_zeroed(&p->alloc, p->head.page_count, sizeof *p->pages);
    p->heap = umb__alloc(&p->alloc, p->head.page_count, sizeof *p->heap);
    p->changed = umb__alloc(&p->alloc, p->head.page_count, sizeof *p->changed);
    if (!p->zstd || !p->pages || !p->heap || !p->changed) {
        return umb__partial_no_memory(error, "the list of pages");
    }
    UMB__TRY(link_roots(p, error));
    return prepare_blocks(p, front, size, error);
}

enum umb_status umb_partial_open(const void *front, size_t size,
                                 const struct umb_partial_options *options,
                                 struct umb_partial **out, struct umb_error *error)
{
    *out = NULL;
    if (UMB__UNKNOWN(options, "options", error)) {
        return UMB_E_ARGUMENT;
    }
    struct umb_partial *p = umb__alloc_zeroed(options->alloc, 1, sizeof *p);
    if (!p) {
        return umb__partial_no_memory(error, "itself");
    }
    umb__meter_init(&p->meter, options->alloc,
                    options->max_memory_bytes ? options->max_memory_bytes : DEFAULT_MAX_MEMORY,
                    &p->alloc);
    p->meter.used = sizeof *p;
    p->node_extents.alloc = p->brick_extents.alloc = &p->alloc;
    p->sha256 = options->sha256;
    enum umb_status status = open_front(p, front, size, options->id, error);
    if (status != UMB_OK) {
        umb_partial_close(p);
        return status;
    }
    *out = p;
    return UMB_OK;
}

void umb_partial_close(struct umb_partial *p)
{
    if (!p) {
        return;
    }
    umb__partial_unbuild(p);
    (void)umb__spares_drop(p);
    for (uint32_t page = 0; p->pages && page < p->head.page_count; page++) {
        umb__free(&p->alloc, p->pages[page].stored);
        umb__free(&p->alloc, p->pages[page].raw);
        umb__free(&p->alloc, p->pages[page].links);
    }
    umb__free(&p->alloc, p->pages);
    umb__free(&p->alloc, p->changed);
    umb__free(&p->alloc, p->heap);
    for (uint32_t block = 0; p->blocks && block < p->head.directory_count; block++) {
        umb__free(&p->alloc, p->blocks[block]);
    }
    umb__free(&p->alloc, (void *)p->blocks);
    umb__canonical_finish(&p->canonical, &p->alloc);
    umb__free(&p->alloc, p->head_bytes);
    ZSTD_freeDCtx(p->zstd);
    umb__free(p->meter.inner, p);
}

enum umb_status umb_partial_add_block(struct umb_partial *p, uint32_t block, const void *bytes,
                                      size_t size, struct umb_error *error)
{
    if (block >= p->head.directory_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "directory: block %u, the asset has %u", block,
                        p->head.directory_count);
    }
    if (p->blocks[block]) {
        return umb_fail(error, UMB_E_EXISTS, "directory: block %u is held already", block);
    }
    const uint32_t length = umb__block_bytes(&p->head, block);
    if (size != length) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: block %u: %zu bytes came, it has %u",
                        block, size, length);
    }
    UMB__TRY(umb__block_check(&p->head, block, bytes, length, NULL, error));
    UMB__TRY(umb__block_prove(&p->head, block, bytes, length, p->sha256, error));
    uint8_t *copy;
    do { /* Pages without benefit give way. Ends: each step frees something */
        copy = umb__alloc(&p->alloc, size, 1);
    } while (!copy && umb__partial_give_way(p, DBL_MIN));
    if (!copy) {
        return umb__partial_no_memory(error, "a block of the directory");
    }
    memcpy(copy, bytes, size);
    p->blocks[block] = copy;
    p->block_count++;
    umb__spares_use(p, block);
    return UMB_OK;
}

void umb_partial_locate_block(const struct umb_partial *p, uint32_t block, uint64_t *offset,
                              uint32_t *length)
{
    *offset = umb__block_offset(&p->head, block);
    *length = umb__block_bytes(&p->head, block);
}

const uint8_t *umb_partial_head(const struct umb_partial *p)
{
    return p->head_bytes;
}

const struct umb_asset *umb_partial_lower(const struct umb_partial *p)
{
    return p->built ? &p->lower : NULL;
}

void umb_partial_get_stats(const struct umb_partial *p, struct umb_partial_stats *stats)
{
    *stats = (struct umb_partial_stats){
        .page_count = p->head.page_count,
        .pages_held = p->held_count,
        .asset_bytes = p->head.file_length,
        .head_bytes = p->head.head_length,
        .held_bytes = p->held_bytes,
        .block_count = p->head.directory_count,
        .blocks_held = p->block_count,
        .memory_bytes = p->meter.used,
        .memory_peak_bytes = p->meter.peak,
        .pages_dropped = p->dropped,
        .builds = p->builds,
        .pages_inherited = p->inherited,
        .spare_bytes = p->spare_bytes,
    };
}
