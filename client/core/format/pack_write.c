/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a packed asset: makes the pages first, then writes the head and the pages. The file also
 * proves packed files. */
#include <stdbool.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/canonical.h"
#include "format/directory.h"
#include "format/head.h"
#include "format/layout.h"
#include "format/pack_pages.h"
#include "format/pack_read.h"

struct writer {
    const struct umb__octree *octree;
    const struct umb_sha256 *sha256;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    struct umb__pack_pages pages;
    uint8_t *blocks;    /* [block count * UMB__BLOCK_ENTRY] Table of blocks */
    uint8_t *canonical; /* [canonical_length] Canonical block */
    uint64_t canonical_length;
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: out of memory");
}

/* Encodes the canonical block: the content, the counts of nodes, and the places of the roots. */
static enum umb_status encode_canonical(struct writer *w, const struct umb__content *content)
{
    struct umb__canonical canonical = {.content = *content};
    memcpy(canonical.counts, w->pages.order.counts, sizeof canonical.counts);
    canonical.roots = umb__alloc_zeroed(w->alloc, content->frustum_count, sizeof *canonical.roots);
    if (!canonical.roots) {
        return no_memory(w->error);
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb__octree_root *root = &w->octree->roots[i];
        canonical.roots[i].state = (uint32_t)root->state;
        if (root->state == UMB__NODE_MIXED) {
            const struct umb__node_place place = umb__pack_place(
                &w->pages.order, root->level, w->pages.order.ordinals[root->level][root->index]);
            canonical.roots[i].page = place.page;
            canonical.roots[i].position = place.position;
        }
    }
    enum umb_status status =
        umb__canonical_encode(&canonical, w->alloc, &w->canonical, &w->canonical_length, w->error);
    umb__free(w->alloc, canonical.roots);
    return status;
}

/* Computes the places of pages and blocks, and the checksums and hashes of the blocks. Returns
 * false if no digest could be made. */
static bool lay_out(struct writer *w, struct umb__head *head)
{
    const uint32_t count = w->pages.order.page_count;
    head->file_length = head->head_length + umb__block_bytes(count, 0);
    for (uint32_t page = 0; page < count; page++) {
        uint8_t *entry = w->pages.entries + (size_t)page * UMB__PAGE_ENTRY;
        if (page == UMB__BLOCK_PAGES) {
            head->blocks_offset = head->file_length;
            head->file_length += umb__other_blocks_bytes(count);
        }
        umb__store64(entry + UMB__PAGE_OFFSET, head->file_length);
        head->file_length += umb__load32(entry + UMB__PAGE_STORED_LENGTH);
    }
    bool sealed = true;
    for (uint32_t block = 0; block < head->directory_count; block++) {
        sealed =
            umb__block_seal(w->pages.entries + (size_t)block * UMB__BLOCK_PAGES * UMB__PAGE_ENTRY,
                            umb__block_bytes(count, block), w->sha256,
                            w->blocks + (size_t)block * UMB__BLOCK_ENTRY) &&
            sealed;
    }
    return sealed;
}

/* Writes everything behind the head: the first block, its pages, the other blocks and pages. */
static enum umb_status write_blocks_and_pages(const struct writer *w, const struct umb_sink *sink)
{
    const uint32_t count = w->pages.order.page_count;
    const size_t first = umb__block_bytes(count, 0);
    if (count > 0) {
        UMB__TRY(sink->write(sink->user, w->pages.entries, first));
    }
    for (uint32_t page = 0; page < count; page++) {
        const uint8_t *entry = w->pages.entries + (size_t)page * UMB__PAGE_ENTRY;
        if (page == UMB__BLOCK_PAGES) {
            UMB__TRY(sink->write(sink->user, entry, (size_t)umb__other_blocks_bytes(count)));
        }
        UMB__TRY(sink->write(sink->user, w->pages.stored[page],
                             umb__load32(entry + UMB__PAGE_STORED_LENGTH)));
    }
    return UMB_OK;
}

static enum umb_status write_file(struct writer *w, const struct umb__content *content,
                                  const struct umb_sink *sink, uint8_t id[UMB_ID_BYTES])
{
    size_t info_length = content->notes ? strlen(content->notes) : 0;
    struct umb__head head = {
        .encoding = UMB_ENCODING_PACKED,
        .canonical = w->canonical,
        .canonical_length = w->canonical_length,
        .directory = w->blocks,
        .directory_count = umb__block_count(w->pages.order.page_count),
        .page_count = w->pages.order.page_count,
        .info = (const uint8_t *)content->notes,
        .info_length = (uint32_t)info_length,
    };
    head.head_length = umb__head_length(head.canonical_length, head.directory_count,
                                        UMB__BLOCK_ENTRY, head.info_length);
    if (!lay_out(w, &head) || !umb__directory_identify(&head, w->sha256, w->alloc, head.id)) {
        return no_memory(w->error);
    }
    uint8_t *bytes = umb__alloc(w->alloc, (size_t)head.head_length, 1);
    if (!bytes) {
        return no_memory(w->error);
    }
    umb__head_write(&head, UMB__BLOCK_ENTRY, bytes);
    enum umb_status status = sink->write(sink->user, bytes, (size_t)head.head_length);
    umb__free(w->alloc, bytes);
    status = status == UMB_OK ? write_blocks_and_pages(w, sink) : status;
    if (status != UMB_OK) {
        return umb_fail(w->error, status, "packing: %llu bytes of output: %s",
                        (unsigned long long)head.file_length, umb_status_text(status));
    }
    memcpy(id, head.id, UMB_ID_BYTES);
    return UMB_OK;
}

/* Checks notes and content. Content that a reader would refuse is the caller's mistake:
 * E_ARGUMENT. */
static enum umb_status check_content(const struct umb__content *content, struct umb_error *error)
{
    size_t length = content->notes ? strlen(content->notes) : 0;
    if (length > UMB__INFO_MAX || !umb__utf8_valid((const uint8_t *)content->notes, length)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "notes: %zu bytes, must be UTF-8 text of at most %u bytes", length,
                        UMB__INFO_MAX);
    }
    const bool is_sound = umb__content_check(content, error) == UMB_OK;
    if (!is_sound && error) {
        error->status = UMB_E_ARGUMENT;
    }
    return is_sound ? UMB_OK : UMB_E_ARGUMENT;
}

static enum umb_status check_roots(const struct umb__content *content,
                                   const struct umb__octree *octree, struct umb_error *error)
{
    if (octree->root_count != content->frustum_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "roots: %u, the content has %u frusta",
                        octree->root_count, content->frustum_count);
    }
    for (uint32_t i = 0; i < octree->root_count; i++) {
        if (octree->roots[i].level != content->frusta[i].log2_size) {
            return umb_fail(error, UMB_E_ARGUMENT, "roots[%u].level: %u, its frustum has %u", i,
                            octree->roots[i].level, content->frusta[i].log2_size);
        }
        if ((unsigned)octree->roots[i].state > UMB__NODE_MIXED) {
            return umb_fail(error, UMB_E_ARGUMENT, "roots[%u].state: %d, allowed 0 to 2", i,
                            (int)octree->roots[i].state);
        }
    }
    return UMB_OK;
}

static enum umb_status write_asset(struct writer *w, const struct umb__pack_job *job,
                                   uint8_t id[UMB_ID_BYTES])
{
    UMB__TRY(check_content(job->content, w->error));
    UMB__TRY(check_roots(job->content, job->octree, w->error));
    UMB__TRY(umb__pack_pages(job, &w->pages, w->error));
    w->blocks =
        umb__alloc_zeroed(w->alloc, umb__block_count(w->pages.order.page_count), UMB__BLOCK_ENTRY);
    if (!w->blocks) {
        return no_memory(w->error);
    }
    UMB__TRY(encode_canonical(w, job->content));
    return write_file(w, job->content, job->sink, id);
}

enum umb_status umb__pack_run(const struct umb__pack_job *job, uint8_t id[UMB_ID_BYTES],
                              struct umb_error *error)
{
    struct writer w = {
        .octree = job->octree, .sha256 = job->sha256, .alloc = job->octree->alloc, .error = error};
    const enum umb_status status = write_asset(&w, job, id);
    umb__pack_pages_finish(&w.pages);
    umb__free(w.alloc, w.blocks);
    umb__free(w.alloc, w.canonical);
    return status;
}

enum umb_status umb__pack_write(const struct umb__content *content,
                                const struct umb__octree *octree, const struct umb_sha256 *sha256,
                                const struct umb_sink *sink, uint8_t id[UMB_ID_BYTES],
                                struct umb_error *error)
{
    const struct umb__pack_job job = {
        .content = content, .octree = octree, .sha256 = sha256, .sink = sink};
    return umb__pack_run(&job, id, error);
}

enum umb_status umb_packed_prove(const void *bytes, size_t size, const uint8_t *id,
                                 const struct umb_sha256 *sha256, struct umb_error *error)
{
    struct umb__head head;
    uint8_t made[UMB_ID_BYTES];
    if (!sha256) {
        return umb_fail(error, UMB_E_ARGUMENT, "sha256: NULL, a proof needs one");
    }
    UMB__TRY(umb__head_parse(bytes, size, &head, error));
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "encoding: a mapped file is a cache and proves nothing");
    }
    if (id && memcmp(id, head.id, UMB_ID_BYTES) != 0) {
        char has[UMB_ID_TEXT_SIZE], wanted[UMB_ID_TEXT_SIZE];
        umb_id_to_text(head.id, has);
        umb_id_to_text(id, wanted);
        return umb_fail(error, UMB_E_CORRUPT, "id: the file is of asset %s, asked for was %s", has,
                        wanted);
    }
    if (!umb__directory_identify(&head, sha256, NULL, made)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proving: out of memory");
    }
    if (memcmp(made, head.id, sizeof made) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: does not match the canonical block and hashes");
    }
    return umb__pages_prove(bytes, &head, sha256, error);
}
