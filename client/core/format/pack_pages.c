/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Making all pages of a packed file; see pack_pages.h. Helper threads share the pages, each of
 * which is a job of its own. Only one thread at a time makes their order.
 */
#include "format/pack_pages.h"

#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/directory.h"
#include "format/layout.h"
#include "format/page.h"

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

/* Number of pages that a round orders for each worker. */
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
struct umb__page_worker {
    struct umb__page_encoder encoder;
    ZSTD_CCtx *zstd;
    struct raw_page raw[UMB__DIGESTS]; /* Pages of a job, until they are hashed together */
    struct chunk *chunks;              /* Chunks, the last one first */
    enum umb_status status;            /* Status of the first failed page */
    struct umb_error error;
};

/* Data that the workers share. */
struct packing {
    const struct umb__octree *octree;
    const struct umb_sha256 *sha256;
    int (*cancelled)(void); /* Nonzero cancels; NULL: never */
    struct umb__pack_pages *pages;
    struct umb__pack_ordering *ordering;
    uint32_t step;           /* Number of pages that a round orders */
    bool orders;             /* True if this round orders pages */
    enum umb_status ordered; /* Status of ordering */
    uint32_t done, ready;    /* Numbers of finished and of ordered pages */
    uint32_t alone;          /* Number of independent pages among the ordered ones */
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: out of memory");
}

/* Makes room for `needed` more bytes of compressed pages. */
static bool make_room(const struct umb_alloc *alloc, struct umb__page_worker *worker, size_t needed)
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
static enum umb_status compress_page(const struct packing *p, struct umb__page_worker *worker,
                                     uint32_t page, size_t *stored_length)
{
    const struct umb__page_encoder *e = &worker->encoder;
    const size_t bound = ZSTD_compressBound(e->raw_size);
    if (!make_room(p->pages->alloc, worker, bound)) {
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
    p->pages->stored[page] = stored;
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
static enum umb_status write_page(const struct packing *p, struct umb__page_worker *worker,
                                  uint32_t page, uint32_t number)
{
    struct umb__page_encoder *e = &worker->encoder;
    size_t length = 0;
    UMB__TRY(umb__page_encode(e, p->octree, &p->pages->order, page, &worker->error));
    UMB__TRY(compress_page(p, worker, page, &length));
    uint8_t *entry = p->pages->entries + (size_t)page * UMB__PAGE_ENTRY;
    memset(entry, 0, UMB__PAGE_ENTRY);
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)length);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)e->raw_size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(p->pages->stored[page], length));
    entry[UMB__PAGE_LEVEL_HIGH] = e->raw[1];
    entry[UMB__PAGE_LEVEL_LOW] = e->raw[2];
    umb__store32(entry + UMB__PAGE_RECORDS, e->node_count);
    keep_raw(e, &worker->raw[number]);
    return UMB_OK;
}

/* Hashes the pages of a job into their entries. */
static enum umb_status hash_pages(const struct packing *p, struct umb__page_worker *worker,
                                  const uint32_t *pages, uint32_t count)
{
    const uint8_t *messages[UMB__DIGESTS] = {NULL};
    size_t sizes[UMB__DIGESTS] = {0};
    uint8_t digests[UMB__DIGESTS][UMB_ID_BYTES];
    for (uint32_t i = 0; i < count; i++) {
        messages[i] = worker->raw[i].bytes;
        sizes[i] = worker->raw[i].size;
    }
    umb__digest_many(p->sha256, messages, sizes, count, digests);
    for (uint32_t i = 0; i < count; i++) {
        uint8_t *entry = p->pages->entries + (size_t)pages[i] * UMB__PAGE_ENTRY;
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
static void encode_pages(const struct packing *p, uint32_t job, unsigned number)
{
    struct umb__page_worker *worker = &p->pages->workers[number];
    const uint32_t first = p->done + job * UMB__DIGESTS, left = p->ready - first;
    const uint32_t count = left < UMB__DIGESTS ? left : UMB__DIGESTS;
    uint32_t pages[UMB__DIGESTS] = {0};
    if (worker->status == UMB_OK && p->cancelled && p->cancelled()) {
        worker->status = umb_fail(&worker->error, UMB_E_CANCELLED, "packing: cancelled");
    }
    for (uint32_t i = 0; i < count && worker->status == UMB_OK; i++) {
        pages[i] = page_of_turn(&p->pages->order, p->alone, first + i);
        worker->status = write_page(p, worker, pages[i], i);
    }
    if (worker->status == UMB_OK) {
        worker->status = hash_pages(p, worker, pages, count);
    }
}

/* Runs one job of a round. The first job orders the pages of the next round; the other jobs make
 * the pages already ordered. */
static void round_job(void *user, uint32_t job, unsigned number)
{
    struct packing *p = user;
    if (!p->orders) {
        encode_pages(p, job, number);
    } else if (job > 0) {
        encode_pages(p, job - 1, number);
    } else {
        p->ordered = umb__pack_order_step(p->ordering, p->step);
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

static enum umb_status create_workers(struct umb__pack_pages *pages, struct umb_error *error)
{
    pages->workers = umb__alloc_zeroed(pages->alloc, pages->worker_count, sizeof *pages->workers);
    bool complete = pages->workers != NULL;
    for (unsigned i = 0; complete && i < pages->worker_count; i++) {
        pages->workers[i].zstd = compressor_create(pages->order.alone_from != UINT32_MAX);
        complete = pages->workers[i].zstd != NULL;
    }
    return complete ? UMB_OK : no_memory(error);
}

/* Makes room for the pages that the round makes and, with helpers, for those that it orders. */
static enum umb_status begin_round(struct packing *p, bool helped, struct umb_error *error)
{
    struct umb__pack_pages *pages = p->pages;
    const uint32_t count = pages->order.page_count;
    const bool complete = umb__pack_order_complete(p->ordering);
    p->alone = pages->order.alone_from < count ? count - pages->order.alone_from : 0;
    p->ready = complete ? count : p->alone - (p->alone - p->done) % UMB__DIGESTS;
    p->orders = !complete;
    if (!umb__grow(pages->alloc, &pages->stored, &pages->stored_capacity, count,
                   sizeof *pages->stored) ||
        !umb__grow(pages->alloc, &pages->entries, &pages->entries_capacity, count,
                   UMB__PAGE_ENTRY)) {
        return no_memory(error);
    }
    return p->orders && helped ? umb__pack_order_reserve(p->ordering, p->step) : UMB_OK;
}

static enum umb_status end_round(struct packing *p, struct umb_error *error)
{
    p->done = p->ready;
    for (unsigned i = 0; i < p->pages->worker_count && p->ordered == UMB_OK; i++) {
        const struct umb__page_worker *worker = &p->pages->workers[i];
        if (worker->status != UMB_OK) {
            return umb_fail(error, worker->status, "%s", worker->error.message);
        }
    }
    return p->ordered;
}

/* Makes all pages. One thread orders independent pages while the others make those ordered in the
 * round before. Rounds are short, because no page is made in the first one. */
static enum umb_status make_pages(struct packing *p, const struct umb_workers *workers,
                                  struct umb_error *error)
{
    while (!umb__pack_order_complete(p->ordering) || p->done < p->pages->order.page_count) {
        UMB__TRY(begin_round(p, workers != NULL, error));
        const uint32_t count = p->ready - p->done;
        const uint32_t jobs = p->orders + count / UMB__DIGESTS + (count % UMB__DIGESTS > 0);
        if (workers) {
            workers->run(workers->user, round_job, p, jobs);
        } else {
            for (uint32_t job = jobs; job-- > 0;) { /* The last pages are still in the
                                                       cache */
                round_job(p, job, 0);
            }
        }
        UMB__TRY(end_round(p, error));
    }
    return UMB_OK;
}

enum umb_status umb__pack_pages(const struct umb__pack_job *job, struct umb__pack_pages *pages,
                                struct umb_error *error)
{
    struct packing p = {
        .octree = job->octree, .sha256 = job->sha256, .cancelled = job->cancelled, .pages = pages};
    memset(pages, 0, sizeof *pages);
    pages->alloc = job->octree->alloc;
    pages->worker_count = job->workers ? job->workers->count : 1;
    p.step = STEP_PAGES * pages->worker_count;
    enum umb_status status =
        umb__pack_order_begin(job->octree, job->workers, &pages->order, &p.ordering, error);
    status = status == UMB_OK ? create_workers(pages, error) : status;
    status = status == UMB_OK ? make_pages(&p, job->workers, error) : status;
    umb__pack_ordering_destroy(p.ordering);
    return status;
}

static void worker_finish(struct umb__page_worker *worker, const struct umb_alloc *alloc)
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

void umb__pack_pages_finish(struct umb__pack_pages *pages)
{
    for (unsigned i = 0; pages->workers && i < pages->worker_count; i++) {
        worker_finish(&pages->workers[i], pages->alloc);
    }
    umb__free(pages->alloc, pages->workers);
    umb__free(pages->alloc, (void *)pages->stored);
    umb__free(pages->alloc, pages->entries);
    umb__pack_order_finish(&pages->order);
    memset(pages, 0, sizeof *pages);
}
