/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writes a packed asset: makes the pages first, then writes the head and the pages. Helper threads
 * share the pages, in jobs of UMB__DIGESTS pages each. Only one thread at a time orders pages.
 */
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/canonical.h"
#include "format/directory.h"
#include "format/pack_order.h"

/*
 * Compression settings of pages. Pages are short, so tables that fit the L1 cache find as many
 * matches as large ones. In pages with references mostly neighbours are alike: tables of 512
 * entries give no more bytes than tables of 4096, in a quarter less time. zstd's level 6 would save
 * 5 % and take three times as long (docs/results/bakes.md). Compression is outside the identity, so
 * it may change.
 */
#define TABLE_LOG2_ALONE  12
#define TABLE_LOG2_REFERS 9
#define SHORTEST_MATCH    4

/* Number of pages that a round orders for each worker thread. */
#define STEP_PAGES (2 * UMB__DIGESTS)

/* A block of memory for compressed pages, one behind the other. */
struct chunk {
    struct chunk *next;
    size_t used, size;
    uint8_t bytes[];
};

/* Bytes of a worker's first chunk and of its largest. Chunks double in size, so that there are few
 * of them, and small assets need little memory. */
#define CHUNK_FIRST ((size_t)64 << 10)
#define CHUNK_MOST  (((size_t)4 << 20) - sizeof(struct chunk))

/* An encoded page. */
struct raw_page {
    uint8_t *bytes;
    size_t size, capacity;
};

/* Data of one worker. */
struct worker {
    struct umb__page_encoder encoder;
    ZSTD_CCtx *zstd;
    struct raw_page raw[UMB__DIGESTS]; /* Pages of a job, until they are hashed together */
    struct chunk *chunks;              /* Chunks, the last one first */
    enum umb_status status;            /* Status of the first failed page */
    struct umb_error error;
};

/*
 * A file under way. All pages are ordered, encoded, compressed and hashed; then they wait in
 * memory, because the head in front of them holds their hashes.
 */
struct writer {
    const struct umb__pack_job *job;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    struct umb__pack_order order;
    struct umb__pack_ordering *ordering;
    uint8_t **stored; /* [order.page_count] Compressed pages, whose lengths are in the entries */
    uint8_t *entries; /* [order.page_count * UMB__PAGE_ENTRY] Entries of the directory, complete
                         except for the offsets of the pages in the file */
    size_t stored_capacity, entries_capacity; /* Pages that the arrays have room for */
    struct worker *workers;                   /* [worker_count] */
    unsigned worker_count;
    uint32_t step;           /* Number of pages that a round orders */
    bool orders;             /* True if this round orders pages */
    enum umb_status ordered; /* Status of ordering */
    uint32_t done, ready;    /* Numbers of finished and of ordered pages */
    uint32_t alone;          /* Number of independent pages among the ordered ones */
    uint8_t *blocks;         /* [block count * UMB__BLOCK_ENTRY] Table of blocks */
    uint8_t *canonical;      /* [canonical_length] Canonical block */
    uint64_t canonical_length;
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: out of memory");
}

/* Makes room for `needed` more bytes of compressed pages. */
static bool make_room(const struct umb_alloc *alloc, struct worker *worker, size_t needed)
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
static enum umb_status compress_page(const struct writer *w, struct worker *worker, uint32_t page,
                                     size_t *stored_length)
{
    const struct umb__page_encoder *e = &worker->encoder;
    const size_t bound = ZSTD_compressBound(e->raw_size);
    if (!make_room(w->alloc, worker, bound)) {
        return no_memory(&worker->error);
    }
    struct chunk *chunk = worker->chunks;
    uint8_t *stored = chunk->bytes + chunk->used;
    const size_t length = ZSTD_compress2(worker->zstd, stored, bound, e->raw, e->raw_size);
    if (ZSTD_isError(length)) {
        const bool memory = ZSTD_getErrorCode(length) == ZSTD_error_memory_allocation;
        return umb_fail(&worker->error, memory ? UMB_E_NO_MEMORY : UMB_E_INTERNAL,
                        "packing: zstd: %s", ZSTD_getErrorName(length));
    }
    w->stored[page] = stored;
    chunk->used += length;
    *stored_length = length;
    return UMB_OK;
}

/* Stores the encoded page for hashing, and gives the encoder the memory of an earlier page. */
static void keep_raw(struct umb__page_encoder *e, struct raw_page *raw)
{
    const struct raw_page before = *raw;
    *raw = (struct raw_page){e->raw, e->raw_size, e->raw_capacity};
    e->raw = before.bytes;
    e->raw_size = 0;
    e->raw_capacity = before.capacity;
}

/* Encodes and compresses a page, and writes the page's entry without the hash. In: number: index of
 * the page in its job. */
static enum umb_status write_page(const struct writer *w, struct worker *worker, uint32_t page,
                                  uint32_t number)
{
    struct umb__page_encoder *e = &worker->encoder;
    size_t length = 0;
    UMB__TRY(umb__page_encode(e, w->job->octree, &w->order, page, &worker->error));
    UMB__TRY(compress_page(w, worker, page, &length));
    uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
    memset(entry, 0, UMB__PAGE_ENTRY);
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)length);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)e->raw_size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(w->stored[page], length));
    entry[UMB__PAGE_LEVEL_HIGH] = e->raw[1];
    entry[UMB__PAGE_LEVEL_LOW] = e->raw[2];
    umb__store32(entry + UMB__PAGE_RECORDS, e->node_count);
    keep_raw(e, &worker->raw[number]);
    return UMB_OK;
}

/* Hashes the pages of a job into their entries. */
static enum umb_status hash_pages(const struct writer *w, struct worker *worker,
                                  const uint32_t *pages, uint32_t count)
{
    const uint8_t *messages[UMB__DIGESTS] = {NULL};
    size_t sizes[UMB__DIGESTS] = {0};
    uint8_t digests[UMB__DIGESTS][UMB_ID_BYTES];
    for (uint32_t i = 0; i < count; i++) {
        messages[i] = worker->raw[i].bytes;
        sizes[i] = worker->raw[i].size;
    }
    umb__digest_many(w->job->sha256, messages, sizes, count, digests);
    for (uint32_t i = 0; i < count; i++) {
        uint8_t *entry = w->entries + (size_t)pages[i] * UMB__PAGE_ENTRY;
        if (!umb__digest_made(digests[i])) {
            return no_memory(&worker->error);
        }
        memcpy(entry + UMB__PAGE_HASH, digests[i], UMB_ID_BYTES);
    }
    return UMB_OK;
}

/* Returns the number of the page that is made in turn `turn`. Independent pages take the first
 * turns: they are ordered last, but each can be encoded as soon as it is ordered. */
static uint32_t page_of_turn(const struct umb__pack_order *order, uint32_t alone, uint32_t turn)
{
    return turn < alone ? order->alone_from + turn : turn - alone;
}

/* Makes the pages of a job and hashes them together. After a failure a worker skips its further
 * jobs. */
static void encode_pages(const struct writer *w, uint32_t job, unsigned number)
{
    struct worker *worker = &w->workers[number];
    const uint32_t first = w->done + job * UMB__DIGESTS, left = w->ready - first;
    const uint32_t count = left < UMB__DIGESTS ? left : UMB__DIGESTS;
    uint32_t pages[UMB__DIGESTS] = {0};
    if (worker->status == UMB_OK && w->job->cancelled && w->job->cancelled()) {
        worker->status = umb_fail(&worker->error, UMB_E_CANCELLED, "packing: cancelled");
    }
    for (uint32_t i = 0; i < count && worker->status == UMB_OK; i++) {
        pages[i] = page_of_turn(&w->order, w->alone, first + i);
        worker->status = write_page(w, worker, pages[i], i);
    }
    if (worker->status == UMB_OK) {
        worker->status = hash_pages(w, worker, pages, count);
    }
}

/* Runs one job of a round. The first job orders the pages of the next round; the other jobs make
 * the pages already ordered. */
static void round_job(void *user, uint32_t job, unsigned number)
{
    struct writer *w = user;
    if (!w->orders) {
        encode_pages(w, job, number);
    } else if (job > 0) {
        encode_pages(w, job - 1, number);
    } else {
        w->ordered = umb__pack_order_step(w->ordering, w->step);
    }
}

/* Makes a zstd context. In: alone: true if the order has independent pages. */
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

static enum umb_status create_workers(struct writer *w)
{
    w->workers = umb__alloc_zeroed(w->alloc, w->worker_count, sizeof *w->workers);
    bool complete = w->workers != NULL;
    for (unsigned i = 0; complete && i < w->worker_count; i++) {
        w->workers[i].zstd = compressor_create(w->order.alone_from != UINT32_MAX);
        complete = w->workers[i].zstd != NULL;
    }
    return complete ? UMB_OK : no_memory(w->error);
}

/* Makes room for the pages that the round makes and, with helpers, for those that it orders. */
static enum umb_status begin_round(struct writer *w)
{
    const uint32_t count = w->order.page_count;
    const bool complete = umb__pack_order_complete(w->ordering);
    w->alone = w->order.alone_from < count ? count - w->order.alone_from : 0;
    w->ready = complete ? count : w->alone - (w->alone - w->done) % UMB__DIGESTS;
    w->orders = !complete;
    if (!umb__grow(w->alloc, &w->stored, &w->stored_capacity, count, sizeof *w->stored) ||
        !umb__grow(w->alloc, &w->entries, &w->entries_capacity, count, UMB__PAGE_ENTRY)) {
        return no_memory(w->error);
    }
    return w->orders && w->job->workers ? umb__pack_order_reserve(w->ordering, w->step) : UMB_OK;
}

static enum umb_status end_round(struct writer *w)
{
    w->done = w->ready;
    for (unsigned i = 0; i < w->worker_count && w->ordered == UMB_OK; i++) {
        const struct worker *worker = &w->workers[i];
        if (worker->status != UMB_OK) {
            return umb_fail(w->error, worker->status, "%s", worker->error.message);
        }
    }
    return w->ordered;
}

/* Makes the pages round by round. One thread orders independent pages while the others make those
 * ordered in the round before. Rounds are short, because in the first one pages are only
 * ordered. */
static enum umb_status make_rounds(struct writer *w)
{
    const struct umb_workers *workers = w->job->workers;
    while (!umb__pack_order_complete(w->ordering) || w->done < w->order.page_count) {
        UMB__TRY(begin_round(w));
        const uint32_t count = w->ready - w->done;
        const uint32_t jobs = w->orders + count / UMB__DIGESTS + (count % UMB__DIGESTS > 0);
        if (workers) {
            workers->run(workers->user, round_job, w, jobs);
        } else {
            for (uint32_t job = jobs; job-- > 0;) { /* The last pages are still in the
                                                       cache */
                round_job(w, job, 0);
            }
        }
        UMB__TRY(end_round(w));
    }
    return UMB_OK;
}

static enum umb_status make_pages(struct writer *w)
{
    w->worker_count = w->job->workers ? w->job->workers->count : 1;
    w->step = STEP_PAGES * w->worker_count;
    enum umb_status status = umb__pack_order_begin(
        w->job->octree, w->job->workers, w->job->never_copies, &w->order, &w->ordering, w->error);
    status = status == UMB_OK ? create_workers(w) : status;
    status = status == UMB_OK ? make_rounds(w) : status;
    umb__pack_ordering_destroy(w->ordering);
    return status;
}

static void worker_finish(struct worker *worker, const struct umb_alloc *alloc)
{
    umb__page_encoder_finish(&worker->encoder, alloc);
    ZSTD_freeCCtx(worker->zstd);
    for (size_t i = 0; i < UMB__DIGESTS; i++) {
        umb__free(alloc, worker->raw[i].bytes);
    }
    for (struct chunk *chunk = worker->chunks, *next; chunk; chunk = next) {
        next = chunk->next;
        umb__free(alloc, chunk);
    }
}

/* --- file ------------------------------------------------------------------------------------- */

/* Encodes the canonical block: the content, the counts of nodes, and the places of the roots. */
static enum umb_status encode_canonical(struct writer *w)
{
    const struct umb__content *content = w->job->content;
    struct umb__canonical canonical = {.content = *content};
    memcpy(canonical.counts, w->order.counts, sizeof canonical.counts);
    canonical.roots = umb__alloc_zeroed(w->alloc, content->frustum_count, sizeof *canonical.roots);
    if (!canonical.roots) {
        return no_memory(w->error);
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb__octree_root *root = &w->job->octree->roots[i];
        canonical.roots[i].state = (uint32_t)root->state;
        if (root->state == UMB__NODE_MIXED) {
            const struct umb__node_place place = umb__pack_place(
                &w->order, root->level, w->order.ordinals[root->level][root->index]);
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
                                 umb__block_bytes(count, block), w->job->sha256,
                                 w->blocks + (size_t)block * UMB__BLOCK_ENTRY) &&
                 sealed;
    }
    return sealed;
}

/* Writes everything behind the head: the first block, its pages, the other blocks and pages. */
static enum umb_status write_blocks_and_pages(const struct writer *w)
{
    const struct umb_sink *sink = w->job->sink;
    const uint32_t count = w->order.page_count;
    const size_t first = umb__block_bytes(count, 0);
    if (count > 0) {
        UMB__TRY(sink->write(sink->user, w->entries, first));
    }
    for (uint32_t page = 0; page < count; page++) {
        const uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
        if (page == UMB__BLOCK_PAGES) {
            UMB__TRY(sink->write(sink->user, entry, (size_t)umb__other_blocks_bytes(count)));
        }
        UMB__TRY(
            sink->write(sink->user, w->stored[page], umb__load32(entry + UMB__PAGE_STORED_LENGTH)));
    }
    return UMB_OK;
}

static enum umb_status write_file(struct writer *w, uint8_t id[UMB_ID_BYTES])
{
    const struct umb_sink *sink = w->job->sink;
    const char *notes = w->job->content->notes;
    struct umb__head head = {
        .encoding = UMB_ENCODING_PACKED,
        .canonical = w->canonical,
        .canonical_length = w->canonical_length,
        .directory = w->blocks,
        .directory_count = umb__block_count(w->order.page_count),
        .page_count = w->order.page_count,
        .info = (const uint8_t *)notes,
        .info_length = notes ? (uint32_t)strlen(notes) : 0,
    };
    head.head_length = umb__head_length(&head);
    if (!lay_out(w, &head) || !umb__directory_identify(&head, w->job->sha256, w->alloc, head.id)) {
        return no_memory(w->error);
    }
    uint8_t *bytes = umb__head_make(&head, w->alloc);
    if (!bytes) {
        return no_memory(w->error);
    }
    enum umb_status status = sink->write(sink->user, bytes, (size_t)head.head_length);
    umb__free(w->alloc, bytes);
    status = status == UMB_OK ? write_blocks_and_pages(w) : status;
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

static enum umb_status write_asset(struct writer *w, uint8_t id[UMB_ID_BYTES])
{
    UMB__TRY(check_content(w->job->content, w->error));
    UMB__TRY(check_roots(w->job->content, w->job->octree, w->error));
    UMB__TRY(make_pages(w));
    w->blocks =
        umb__alloc_zeroed(w->alloc, umb__block_count(w->order.page_count), UMB__BLOCK_ENTRY);
    if (!w->blocks) {
        return no_memory(w->error);
    }
    UMB__TRY(encode_canonical(w));
    return write_file(w, id);
}

enum umb_status umb__pack_run(const struct umb__pack_job *job, uint8_t id[UMB_ID_BYTES],
                              struct umb_error *error)
{
    struct writer w = {.job = job, .alloc = job->octree->alloc, .error = error};
    const enum umb_status status = write_asset(&w, id);
    for (unsigned i = 0; w.workers && i < w.worker_count; i++) {
        worker_finish(&w.workers[i], w.alloc);
    }
    umb__free(w.alloc, w.workers);
    umb__free(w.alloc, (void *)w.stored);
    umb__free(w.alloc, w.entries);
    if (job->figures != NULL) {
        job->figures->copies = w.order.copies;
    }
    umb__pack_order_finish(&w.order);
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
