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
#include "format/directory.h"
#include "format/head.h"
#include "format/layout.h"
#include "format/pack_read.h"
#include "format/page.h"

/*
 * How pages are compressed: they are short, so that tables small enough for the first-level cache
 * find as much as large ones. Pages that refer to others repeat little but for neighbours: with
 * tables of 512 entries they take no more bytes than with 4096, and a quarter less time, as matches
 * that would cost more than they save are not found. Level 6 saves 5 % and takes three times as
 * long (docs/performance.md). Outside the identity, so it may change.
 */
#define TABLE_LOG2_ALONE  12
#define TABLE_LOG2_REFERS 9
#define SHORTEST_MATCH    4

/* Compressed pages, one behind the other. */
struct chunk {
    struct chunk *next;
    size_t used, size;
    uint8_t bytes[];
};

/* Sizes of a worker's first chunk, and of those that it doubles to: few large pages of the system,
 * and little that a small asset does not need. */
#define CHUNK_FIRST ((size_t)64 << 10)
#define CHUNK_MOST  (((size_t)4 << 20) - sizeof(struct chunk))

/* What one worker has to itself. */
struct page_worker {
    struct umb__page_encoder encoder;
    ZSTD_CCtx *zstd;
    struct chunk *chunks;   /* the last one first */
    enum umb_status status; /* of the first page it failed at */
    struct umb_error error;
};

struct writer {
    const struct umb_octree *octree;
    const struct umb_sha256 *sha256;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    struct umb__pack_order order;
    struct page_worker *workers;
    unsigned worker_count;
    uint8_t **stored; /* [page_count] compressed pages in the workers' chunks; lengths are in the
                         entries */
    uint8_t *entries; /* [page_count * UMB__PAGE_ENTRY] */
    uint8_t *blocks;  /* [block count * UMB__BLOCK_ENTRY] */
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: out of memory");
}

/* Makes room for `needed` more bytes of compressed pages. */
static bool make_room(const struct umb_alloc *alloc, struct page_worker *worker, size_t needed)
{
    const struct chunk *last = worker->chunks;
    if (last && last->size - last->used >= needed) {
        return true;
    }
    size_t size = last ? 2 * last->size : CHUNK_FIRST;
    size = size > CHUNK_MOST ? CHUNK_MOST : size;
    size = size < needed ? needed : size;
    struct chunk *chunk = umb__alloc_large(alloc, sizeof *chunk + size, 1);
    if (!chunk) {
        return false;
    }
    chunk->next = worker->chunks;
    chunk->used = 0;
    chunk->size = size;
    worker->chunks = chunk;
    return true;
}

/* Compresses the encoded page and keeps it. */
static enum umb_status compress_page(const struct writer *w, struct page_worker *worker,
                                     uint32_t page, size_t *stored_length)
{
    const struct umb__page_encoder *e = &worker->encoder;
    const size_t bound = ZSTD_compressBound(e->raw_size);
    if (!make_room(w->alloc, worker, bound)) {
        return no_memory(&worker->error);
    }
    struct chunk *chunk = worker->chunks;
    w->stored[page] = chunk->bytes + chunk->used;
    const size_t length = ZSTD_compress2(worker->zstd, w->stored[page], bound, e->raw, e->raw_size);
    if (ZSTD_isError(length)) {
        const bool memory = ZSTD_getErrorCode(length) == ZSTD_error_memory_allocation;
        return umb_fail(&worker->error, memory ? UMB_E_NO_MEMORY : UMB_E_INTERNAL,
                        "packing: zstd: %s", ZSTD_getErrorName(length));
    }
    chunk->used += length;
    *stored_length = length;
    return UMB_OK;
}

static enum umb_status write_page(const struct writer *w, struct page_worker *worker, uint32_t page)
{
    const struct umb__page_encoder *e = &worker->encoder;
    size_t length = 0;
    enum umb_status status =
        umb__page_encode(&worker->encoder, w->octree, &w->order, page, &worker->error);
    if (status == UMB_OK) {
        status = compress_page(w, worker, page, &length);
    }
    if (status != UMB_OK) {
        return status;
    }
    uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)length);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)e->raw_size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(w->stored[page], length));
    entry[UMB__PAGE_LEVEL_HIGH] = e->raw[1];
    entry[UMB__PAGE_LEVEL_LOW] = e->raw[2];
    umb__store32(entry + UMB__PAGE_RECORDS, e->node_count);
    const void *part = e->raw;
    w->sha256->digest(w->sha256->user, &part, &e->raw_size, 1, entry + UMB__PAGE_HASH);
    return umb__digest_made(entry + UMB__PAGE_HASH) ? UMB_OK : no_memory(&worker->error);
}

/* One page; after a failure of its own a worker leaves the others out. */
static void page_job(void *user, uint32_t page, unsigned number)
{
    const struct writer *w = user;
    struct page_worker *worker = &w->workers[number];
    if (worker->status == UMB_OK) {
        worker->status = write_page(w, worker, page);
    }
}

/* In: alone: for pages of which most refer to no other. */
static ZSTD_CCtx *compressor_create(bool alone)
{
    const struct {
        ZSTD_cParameter name;
        int value;
    } settings[] = {
        {ZSTD_c_compressionLevel, 1},
        {ZSTD_c_strategy, ZSTD_fast},
        {ZSTD_c_hashLog, alone ? TABLE_LOG2_ALONE : TABLE_LOG2_REFERS},
        {ZSTD_c_minMatch, SHORTEST_MATCH},
    };
    ZSTD_CCtx *zstd = ZSTD_createCCtx();
    for (size_t i = 0; zstd && i < sizeof settings / sizeof settings[0]; i++) {
        if (ZSTD_isError(ZSTD_CCtx_setParameter(zstd, settings[i].name, settings[i].value))) {
            ZSTD_freeCCtx(zstd);
            zstd = NULL;
        }
    }
    return zstd;
}

static enum umb_status write_pages(struct writer *w, const struct umb_workers *workers)
{
    const uint32_t count = w->order.page_count;
    w->worker_count = workers ? workers->count : 1;
    w->workers = umb__alloc_zeroed(w->alloc, w->worker_count, sizeof *w->workers);
    w->stored = umb__alloc_zeroed(w->alloc, count, sizeof *w->stored);
    w->entries = umb__alloc_zeroed(w->alloc, count, UMB__PAGE_ENTRY);
    w->blocks = umb__alloc_zeroed(w->alloc, umb__block_count(count), UMB__BLOCK_ENTRY);
    if (!w->workers || !w->stored || !w->entries || !w->blocks) {
        return no_memory(w->error);
    }
    for (unsigned i = 0; i < w->worker_count; i++) {
        w->workers[i].zstd = compressor_create(w->order.alone_from != UINT32_MAX);
        if (!w->workers[i].zstd) {
            return no_memory(w->error);
        }
    }
    if (workers) {
        workers->run(workers->user, page_job, w, count);
    } else {
        for (uint32_t page = 0; page < count; page++) {
            page_job(w, page, 0);
        }
    }
    for (unsigned i = 0; i < w->worker_count; i++) {
        if (w->workers[i].status != UMB_OK) {
            return umb_fail(w->error, w->workers[i].status, "%s", w->workers[i].error.message);
        }
    }
    return UMB_OK;
}

static void writer_finish(struct writer *w)
{
    for (unsigned i = 0; w->workers && i < w->worker_count; i++) {
        umb__page_encoder_finish(&w->workers[i].encoder, w->alloc);
        ZSTD_freeCCtx(w->workers[i].zstd);
        for (struct chunk *chunk = w->workers[i].chunks, *next; chunk; chunk = next) {
            next = chunk->next;
            umb__free(w->alloc, chunk);
        }
    }
    umb__free(w->alloc, w->workers);
    umb__free(w->alloc, (void *)w->stored);
    umb__free(w->alloc, w->entries);
    umb__free(w->alloc, w->blocks);
    umb__pack_order_finish(&w->order);
}

/* Content plus the roots' places, as the canonical block wants them. */
static enum umb_status encode_canonical(struct writer *w, const struct umb_content *content,
                                        uint8_t **bytes, uint64_t *length)
{
    struct umb__canonical canonical = {.content = *content};
    memcpy(canonical.counts, w->order.counts, sizeof canonical.counts);
    canonical.roots = umb__alloc_zeroed(w->alloc, content->frustum_count, sizeof *canonical.roots);
    if (!canonical.roots) {
        return no_memory(w->error);
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb_octree_root *root = &w->octree->roots[i];
        canonical.roots[i].state = (uint32_t)root->state;
        if (root->state == UMB_NODE_MIXED) {
            const struct umb__node_place place = umb__pack_place(
                &w->order, root->level, w->order.ordinals[root->level][root->index]);
            canonical.roots[i].page = place.page;
            canonical.roots[i].position = place.position;
        }
    }
    enum umb_status status = umb__canonical_encode(&canonical, w->alloc, bytes, length, w->error);
    umb__free(w->alloc, canonical.roots);
    return status;
}

/* Where pages and blocks stand, and the blocks' checks and hashes. False: no digest. */
static bool lay_out(struct writer *w, struct umb__head *head)
{
    const uint32_t count = w->order.page_count;
    head->file_length = head->head_length + umb__block_bytes(count, 0);
    for (uint32_t page = 0; page < count; page++) {
        uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
        if (page == UMB__BLOCK_PAGES) {
            head->blocks_offset = head->file_length;
            head->file_length += umb__other_blocks_bytes(count);
        }
        umb__store64(entry + UMB__PAGE_OFFSET, head->file_length);
        head->file_length += umb__load32(entry + UMB__PAGE_STORED_LENGTH);
    }
    bool sealed = true;
    for (uint32_t block = 0; block < head->directory_count; block++) {
        sealed = umb__block_seal(w->entries + (size_t)block * UMB__BLOCK_PAGES * UMB__PAGE_ENTRY,
                                 umb__block_bytes(count, block), w->sha256,
                                 w->blocks + (size_t)block * UMB__BLOCK_ENTRY) &&
                 sealed;
    }
    return sealed;
}

/* All but the head. */
static enum umb_status write_blocks_and_pages(const struct writer *w, const struct umb_sink *sink)
{
    const uint32_t count = w->order.page_count;
    const size_t first = umb__block_bytes(count, 0);
    enum umb_status status = sink->write(sink->user, w->entries, first);
    for (uint32_t page = 0; page < count && status == UMB_OK; page++) {
        const uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
        if (page == UMB__BLOCK_PAGES) {
            status = sink->write(sink->user, entry, (size_t)umb__other_blocks_bytes(count));
        }
        if (status == UMB_OK) {
            status = sink->write(sink->user, w->stored[page],
                                 umb__load32(entry + UMB__PAGE_STORED_LENGTH));
        }
    }
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
        .directory = w->blocks,
        .directory_count = umb__block_count(w->order.page_count),
        .page_count = w->order.page_count,
        .info = (const uint8_t *)content->notes,
        .info_length = (uint32_t)info_length,
    };
    head.head_length = umb__head_length(canonical_length, head.directory_count, UMB__BLOCK_ENTRY,
                                        head.info_length);
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
    if (status == UMB_OK) {
        status = write_blocks_and_pages(w, sink);
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
    if (length > UMB__INFO_MAX || !umb__utf8_valid((const uint8_t *)content->notes, length)) {
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

enum umb_status umb_pack_run(const struct umb_pack_job *job, uint8_t id[UMB_ID_BYTES],
                             struct umb_error *error)
{
    const struct umb_octree *octree = job->octree;
    struct writer w = {
        .octree = octree, .sha256 = job->sha256, .alloc = octree->alloc, .error = error};
    uint8_t *canonical = NULL;
    uint64_t canonical_length = 0;
    enum umb_status status = check_content(job->content, error);
    if (status == UMB_OK) {
        status = check_roots(job->content, octree, error);
    }
    if (status == UMB_OK) {
        status = umb__pack_order(octree, &w.order, error);
    }
    if (status == UMB_OK) {
        status = write_pages(&w, job->workers);
    }
    if (status == UMB_OK) {
        status = encode_canonical(&w, job->content, &canonical, &canonical_length);
    }
    if (status == UMB_OK) {
        status = write_file(&w, job->content, canonical, canonical_length, job->sink, id);
    }
    umb__free(w.alloc, canonical);
    writer_finish(&w);
    return status;
}

enum umb_status umb_pack_write(const struct umb_content *content, const struct umb_octree *octree,
                               const struct umb_sha256 *sha256, const struct umb_sink *sink,
                               uint8_t id[UMB_ID_BYTES], struct umb_error *error)
{
    const struct umb_pack_job job = {
        .content = content, .octree = octree, .sha256 = sha256, .sink = sink};
    return umb_pack_run(&job, id, error);
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
    if (!umb__directory_identify(&head, sha256, NULL, id)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proving: out of memory");
    }
    if (memcmp(id, head.id, sizeof id) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: does not match the canonical block and hashes");
    }
    return umb__pages_prove(bytes, &head, check_pages, sha256, error);
}
