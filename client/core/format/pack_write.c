/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writing a packed asset: order the nodes, encode and compress each page, then head and pages.
 * Compressed pages wait in memory, because the head in front of them holds their hashes.
 */
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/utf8.h"
#include "format/canonical.h"
#include "format/head.h"
#include "format/layout.h"
#include "format/pack_read.h"
#include "format/page.h"

/* Within 0.2 % of level 9's bytes at half its time; outside the identity, so it may change. */
enum { ZSTD_LEVEL = 6 };

struct writer {
    const struct umb_octree *octree;
    const struct umb_sha256 *sha256;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    struct umb__pack_order order;
    ZSTD_CCtx *zstd;
    uint8_t *raw;
    size_t raw_capacity;
    uint8_t *stored; /* all compressed pages, one after the other */
    size_t stored_size, stored_capacity;
    uint8_t *directory;
};

static enum umb_status no_memory(struct writer *w)
{
    return umb_fail(w->error, UMB_E_NO_MEMORY, "packing: out of memory");
}

static enum umb_status write_page(struct writer *w, uint32_t page)
{
    size_t size;
    enum umb_status status = umb__page_encode(w->octree, &w->order, page, &w->raw,
                                              &w->raw_capacity, &size, w->error);
    if (status != UMB_OK) {
        return status;
    }
    size_t bound = ZSTD_compressBound(size);
    if (!umb__grow(w->alloc, &w->stored, &w->stored_capacity, w->stored_size + bound, 1)) {
        return no_memory(w);
    }
    uint8_t *stored = w->stored + w->stored_size;
    size_t stored_length = ZSTD_compressCCtx(w->zstd, stored, bound, w->raw, size, ZSTD_LEVEL);
    if (ZSTD_isError(stored_length)) {
        const bool no_memory = ZSTD_getErrorCode(stored_length) == ZSTD_error_memory_allocation;
        return umb_fail(w->error, no_memory ? UMB_E_NO_MEMORY : UMB_E_INTERNAL, "packing: zstd: %s",
                        ZSTD_getErrorName(stored_length));
    }
    uint8_t *entry = w->directory + (size_t)page * UMB__PAGE_ENTRY;
    umb__store64(entry + UMB__PAGE_OFFSET, w->stored_size); /* made absolute later */
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)stored_length);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(stored, stored_length));
    entry[UMB__PAGE_LEVEL_HIGH] = w->raw[1];
    entry[UMB__PAGE_LEVEL_LOW] = w->raw[2];
    umb__store32(entry + UMB__PAGE_RECORDS,
                 (uint32_t)(w->order.page_first[page + 1] - w->order.page_first[page]));
    const void *part = w->raw;
    w->sha256->digest(w->sha256->user, &part, &size, 1, entry + UMB__PAGE_HASH);
    w->stored_size += stored_length;
    return umb__digest_made(entry + UMB__PAGE_HASH) ? UMB_OK : no_memory(w);
}

static enum umb_status write_pages(struct writer *w)
{
    w->zstd = ZSTD_createCCtx();
    w->directory = umb__alloc_zeroed(w->alloc, w->order.page_count, UMB__PAGE_ENTRY);
    if (!w->zstd || !w->directory) {
        return no_memory(w);
    }
    enum umb_status status = UMB_OK;
    for (uint32_t page = 0; page < w->order.page_count && status == UMB_OK; page++) {
        status = write_page(w, page);
    }
    return status;
}

/* The identity: SHA-256 over the canonical block and the page hashes. False: out of memory. */
static bool identify(const struct umb_sha256 *sha256, const struct umb__head *head,
                     const struct umb_alloc *alloc, uint8_t id[UMB_ID_BYTES])
{
    size_t parts = (size_t)head->directory_count + 1;
    const void **pointers = umb__alloc(alloc, parts, sizeof *pointers);
    size_t *sizes = umb__alloc(alloc, parts, sizeof *sizes);
    bool made = pointers && sizes;
    if (made) {
        pointers[0] = head->canonical;
        sizes[0] = (size_t)head->canonical_length;
        for (size_t page = 0; page + 1 < parts; page++) {
            pointers[page + 1] = head->directory + page * UMB__PAGE_ENTRY + UMB__PAGE_HASH;
            sizes[page + 1] = UMB_ID_BYTES;
        }
        sha256->digest(sha256->user, pointers, sizes, parts, id);
        made = umb__digest_made(id);
    }
    umb__free(alloc, (void *)pointers);
    umb__free(alloc, sizes);
    return made;
}

/* Content plus the roots' places, as the canonical block wants them. */
static enum umb_status encode_canonical(struct writer *w, const struct umb_content *content,
                                        uint8_t **bytes, uint64_t *length)
{
    struct umb__canonical canonical = {.content = *content};
    memcpy(canonical.counts, w->order.counts, sizeof canonical.counts);
    canonical.roots = umb__alloc_zeroed(w->alloc, content->frustum_count, sizeof *canonical.roots);
    if (!canonical.roots) {
        return no_memory(w);
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb_octree_root *root = &w->octree->roots[i];
        canonical.roots[i].state = (uint32_t)root->state;
        if (root->state == UMB_NODE_MIXED) {
            canonical.roots[i].page = w->order.page_of[root->level][root->index];
            canonical.roots[i].position = w->order.position_of[root->level][root->index];
        }
    }
    enum umb_status status =
        umb__canonical_encode(&canonical, w->alloc, bytes, length, w->error);
    umb__free(w->alloc, canonical.roots);
    return status;
}

static enum umb_status write_file(struct writer *w, const struct umb_content *content,
                                  const uint8_t *canonical, uint64_t canonical_length,
                                  const struct umb_sink *sink, uint8_t id[UMB_ID_BYTES])
{
    size_t info_length = content->notes ? strlen(content->notes) : 0;
    struct umb__head head = {
        .encoding = UMB_ENCODING_PACKED,
        .canonical = canonical,
        .canonical_length = canonical_length,
        .directory = w->directory,
        .directory_count = w->order.page_count,
        .info = (const uint8_t *)content->notes,
        .info_length = (uint32_t)info_length,
    };
    head.head_length = umb__head_length(canonical_length, head.directory_count, UMB__PAGE_ENTRY,
                                        head.info_length);
    head.file_length = head.head_length + w->stored_size;
    for (size_t page = 0; page < w->order.page_count; page++) {
        uint8_t *entry = w->directory + page * UMB__PAGE_ENTRY;
        umb__store64(entry + UMB__PAGE_OFFSET, umb__load64(entry) + head.head_length);
    }
    if (!identify(w->sha256, &head, w->alloc, head.id)) {
        return no_memory(w);
    }
    uint8_t *bytes = umb__alloc(w->alloc, (size_t)head.head_length, 1);
    if (!bytes) {
        return no_memory(w);
    }
    umb__head_write(&head, UMB__PAGE_ENTRY, bytes);
    enum umb_status status = sink->write(sink->user, bytes, (size_t)head.head_length);
    umb__free(w->alloc, bytes);
    if (status == UMB_OK && w->stored_size > 0) {
        status = sink->write(sink->user, w->stored, w->stored_size);
    }
    if (status != UMB_OK) {
        return umb_fail(w->error, status, "packing: %llu bytes of output: %s",
                        (unsigned long long)head.file_length, umb_status_text(status));
    }
    memcpy(id, head.id, UMB_ID_BYTES);
    return UMB_OK;
}

/* What a program hands over and a reader would refuse is that program's mistake. */
static enum umb_status check_content(const struct umb_content *content, struct umb_error *error)
{
    size_t length = content->notes ? strlen(content->notes) : 0;
    if (length > UMB__INFO_MAX ||
        !umb__utf8_valid((const uint8_t *)content->notes, length)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "notes: %zu bytes, must be UTF-8 text of at most %u bytes", length,
                        UMB__INFO_MAX);
    }
    enum umb_status status = umb__content_check(content, error);
    if (status == UMB_OK) {
        return UMB_OK;
    }
    if (error) {
        error->status = UMB_E_ARGUMENT;
    }
    return UMB_E_ARGUMENT;
}

static enum umb_status check_roots(const struct umb_content *content,
                                   const struct umb_octree *octree, struct umb_error *error)
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
        if ((unsigned)octree->roots[i].state > UMB_NODE_MIXED) {
            return umb_fail(error, UMB_E_ARGUMENT, "roots[%u].state: %d, allowed 0 to 2", i,
                            (int)octree->roots[i].state);
        }
    }
    return UMB_OK;
}

enum umb_status umb_pack_write(const struct umb_content *content, const struct umb_octree *octree,
                               const struct umb_sha256 *sha256, const struct umb_sink *sink,
                               uint8_t id[UMB_ID_BYTES], struct umb_error *error)
{
    struct writer w = {
        .octree = octree, .sha256 = sha256, .alloc = octree->alloc, .error = error};
    uint8_t *canonical = NULL;
    uint64_t canonical_length = 0;
    enum umb_status status = check_content(content, error);
    if (status == UMB_OK) {
        status = check_roots(content, octree, error);
    }
    if (status == UMB_OK) {
        status = umb__pack_order(octree, &w.order, error);
    }
    if (status == UMB_OK) {
        status = write_pages(&w);
    }
    if (status == UMB_OK) {
        status = encode_canonical(&w, content, &canonical, &canonical_length);
    }
    if (status == UMB_OK) {
        status = write_file(&w, content, canonical, canonical_length, sink, id);
    }
    ZSTD_freeCCtx(w.zstd);
    umb__free(w.alloc, canonical);
    umb__free(w.alloc, w.directory);
    umb__free(w.alloc, w.stored);
    umb__free(w.alloc, w.raw);
    umb__pack_order_finish(&w.order);
    return status;
}

enum umb_status umb_pack_prove(const void *bytes, size_t size, int check_pages,
                               const struct umb_sha256 *sha256, struct umb_error *error)
{
    struct umb__head head;
    uint8_t id[UMB_ID_BYTES];
    enum umb_status status = umb__head_parse(bytes, size, &head, error);
    if (status != UMB_OK) {
        return status;
    }
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "encoding: a mapped file is a cache and proves nothing");
    }
    if (!identify(sha256, &head, NULL, id)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proving: out of memory");
    }
    if (memcmp(id, head.id, sizeof id) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: does not match the canonical block and hashes");
    }
    return check_pages ? umb__pages_prove(bytes, &head, sha256, error) : UMB_OK;
}
