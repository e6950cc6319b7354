/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writes a packed asset: cuts the tree, makes the pages, then writes the head and the pages. Helper
 * threads share the pages. A page names those below it by links, so all pages of a round can be
 * made before the pages of the next round are numbered.
 */
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/canonical.h"
#include "format/directory.h"
#include "format/pack_cut.h"
#include "format/pack_kept.h"
#include "format/page_compress.h"

/* Most pages of a file: differences of their numbers have 32 bits. */
#define PAGES_MAX ((uint32_t)INT32_MAX)

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

/* A page that is made. */
struct made {
    const uint8_t *stored;            /* Compressed page, whose length is in the entry */
    const struct umb__node_ref *cuts; /* [cut_count] Cut nodes that it links to */
    size_t cut_count;
    const uint8_t *links; /* [links_length] Its links, as the directory has them */
    uint32_t links_length;
};

/*
 * A file under way. All pages are encoded, compressed and hashed; then they wait in memory, because
 * the head in front of them holds their hashes.
 */
struct writer {
    const struct umb__pack_job *job;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    struct umb__pack_survey survey;
    struct umb__pack_cuts cuts;
    struct umb__pack_page *pages; /* [page_count] Pages in the order of the file */
    struct made *made;            /* [page_count] */
    uint8_t *entries; /* [page_count * UMB__PAGE_ENTRY] Entries of the directory, complete except
                         for the offsets of the pages in the file */
    uint32_t page_count;
    size_t pages_capacity, made_capacity, entries_capacity; /* In pages */
    /* [count of the level] Number of the first page of each cut node that has pages; else 0. */
    uint32_t *first_page[UMB_LEVEL_MAX + 1];
    struct worker *workers; /* [worker_count] */
    unsigned worker_count;
    uint32_t done, ready; /* Numbers of finished pages, and of those of this round */
    uint8_t *table;       /* [block count * UMB__BLOCK_ENTRY] Table of blocks */
    uint8_t *blocks;      /* [blocks_length] Blocks of the directory */
    size_t blocks_length;
    uint8_t *canonical; /* [canonical_length] Canonical block */
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
    const size_t bound = umb__page_compress_bound(e);
    if (!make_room(w->alloc, worker, bound)) {
        return no_memory(&worker->error);
    }
    struct chunk *chunk = worker->chunks;
    uint8_t *stored = chunk->bytes + chunk->used;
    size_t length = 0;
    UMB__TRY(umb__page_compress(worker->zstd, e, stored, &length, &worker->error));
    w->made[page].stored = stored;
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

/* Keeps the list of the cut nodes of the encoded page. */
static enum umb_status keep_cuts(const struct writer *w, struct worker *worker, uint32_t page)
{
    const struct umb__page_encoder *e = &worker->encoder;
    const size_t bytes = e->cut_count * sizeof *e->cuts, align = sizeof *e->cuts;
    if (e->cut_count == 0) {
        return UMB_OK;
    }
    if (!make_room(w->alloc, worker, bytes + align)) {
        return no_memory(&worker->error);
    }
    struct chunk *chunk = worker->chunks;
    chunk->used += (align - chunk->used % align) % align;
    memcpy(chunk->bytes + chunk->used, e->cuts, bytes);
    w->made[page].cuts = (const void *)(chunk->bytes + chunk->used);
    w->made[page].cut_count = e->cut_count;
    chunk->used += bytes;
    return UMB_OK;
}

/* Encodes and compresses a page, and writes the page's entry without the hash. In: number: index of
 * the page in its job. */
static enum umb_status write_page(const struct writer *w, struct worker *worker, uint32_t page,
                                  uint32_t number)
{
    struct umb__page_encoder *e = &worker->encoder;
    size_t length = 0;
    UMB__TRY(umb__page_encode(e, &w->cuts, &w->pages[page], &worker->error));
    UMB__TRY(compress_page(w, worker, page, &length));
    UMB__TRY(keep_cuts(w, worker, page));
    uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
    memset(entry, 0, UMB__PAGE_ENTRY);
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)length);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)e->raw_size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(w->made[page].stored, length));
    entry[UMB__PAGE_LEVEL_HIGH] = e->raw[1];
    entry[UMB__PAGE_LEVEL_LOW] = e->raw[2];
    umb__store32(entry + UMB__PAGE_RECORDS, e->node_count);
    keep_raw(e, &worker->raw[number]);
    return UMB_OK;
}

/* Returns true if the page is one of a node whose cuts are kept. */
static bool is_kept(const struct writer *w, const struct umb__pack_page *page)
{
    const struct umb__pack_kept *kept = w->job->kept;
    return kept && kept->page_bytes == w->cuts.page_bytes && page->level > 0 &&
           page->node < kept->counts[page->level];
}

/* Takes over a page that is kept. */
static enum umb_status take_kept(const struct writer *w, struct worker *worker, uint32_t page)
{
    const struct umb__kept_page *found = umb__pack_kept_find(w->job->kept, &w->pages[page]);
    uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
    if (!found) { /* To make it here would take as long as false cuts want */
        return umb_fail(&worker->error, UMB_E_CORRUPT,
                        "kept pages: page %u of node %u of level %u is missing",
                        w->pages[page].part, w->pages[page].node, w->pages[page].level);
    }
    memcpy(entry, found->entry, UMB__PAGE_ENTRY);
    umb__store64(entry + UMB__PAGE_OFFSET, 0);
    umb__store16(entry + UMB__PAGE_LINKS, 0);
    w->made[page] =
        (struct made){.stored = found->stored, .cuts = found->cuts, .cut_count = found->cut_count};
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
    uint32_t fresh = 0;
    for (uint32_t page = first; page < first + count && worker->status == UMB_OK; page++) {
        if (is_kept(w, &w->pages[page])) {
            worker->status = take_kept(w, worker, page);
        } else {
            worker->status = write_page(w, worker, page, fresh);
            pages[fresh++] = page;
        }
    }
    if (worker->status == UMB_OK && fresh > 0) {
        worker->status = hash_pages(w, worker, pages, fresh);
    }
}

/* Runs one job of a round. */
static void round_job(void *user, uint32_t job, unsigned number)
{
    encode_pages(user, job, number);
}

static enum umb_status create_workers(struct writer *w)
{
    w->workers = umb__alloc_zeroed(w->alloc, w->worker_count, sizeof *w->workers);
    bool complete = w->workers != NULL;
    for (unsigned i = 0; complete && i < w->worker_count; i++) {
        w->workers[i].zstd = umb__page_compressor();
        complete = w->workers[i].zstd != NULL;
    }
    return complete ? UMB_OK : no_memory(w->error);
}

static enum umb_status end_round(const struct writer *w)
{
    for (unsigned i = 0; i < w->worker_count; i++) {
        const struct worker *worker = &w->workers[i];
        if (worker->status != UMB_OK) {
            return umb_fail(w->error, worker->status, "%s", worker->error.message);
        }
    }
    return UMB_OK;
}

/* Appends the pages of a cut node. */
static enum umb_status add_pages(struct writer *w, struct umb__node_ref node, uint32_t count)
{
    if (w->page_count > PAGES_MAX - count) {
        return umb_fail(w->error, UMB_E_TOO_LARGE, "packing: more than %u pages", PAGES_MAX);
    }
    if (!umb__grow(w->alloc, &w->pages, &w->pages_capacity, (size_t)w->page_count + count,
                   sizeof *w->pages)) {
        return no_memory(w->error);
    }
    w->first_page[node.level][node.index] = w->page_count;
    for (uint32_t part = 0; part < count; part++) {
        w->pages[w->page_count++] = (struct umb__pack_page){node.level, node.index, part};
    }
    return UMB_OK;
}

/* Writes the links of a page, and appends the pages that it is the first to link to. */
static enum umb_status link_page(struct writer *w, uint32_t page)
{
    struct worker *worker = &w->workers[0];
    struct made *made = &w->made[page];
    const size_t most = 8 * UMB__NUMBER_BYTES_MAX * made->cut_count;
    uint32_t last = UINT32_MAX;
    if (made->cut_count == 0) {
        return UMB_OK;
    }
    if (!make_room(w->alloc, worker, most)) {
        return no_memory(w->error);
    }
    uint8_t *links = worker->chunks->bytes + worker->chunks->used, *at = links;
    for (size_t i = 0; i < made->cut_count; i++) {
        const struct umb__node_ref node = made->cuts[i];
        const uint32_t count = umb__part_count(umb__pack_parts(&w->cuts, node.level, node.index));
        if (w->first_page[node.level][node.index] == 0) {
            UMB__TRY(add_pages(w, node, count));
        }
        for (uint32_t part = 0; part < count; part++) {
            const uint32_t number = w->first_page[node.level][node.index] + part;
            at = umb__put_number(at, umb__fold((int64_t)number - (uint32_t)(last + 1)));
            last = number;
        }
    }
    made->links = links;
    made->links_length = (uint32_t)(at - links);
    worker->chunks->used += made->links_length;
    if (made->links_length > UINT16_MAX) {
        return umb_fail(w->error, UMB_E_INTERNAL, "packing: page %u: %u bytes of links, at most %u",
                        page, made->links_length, UINT16_MAX);
    }
    umb__store16(w->entries + (size_t)page * UMB__PAGE_ENTRY + UMB__PAGE_LINKS,
                 (uint16_t)made->links_length);
    return UMB_OK;
}

/* Makes the pages round by round: first those of the roots, then in each round the pages to which
 * those of the round before link. */
static enum umb_status make_rounds(struct writer *w)
{
    const struct umb_workers *workers = w->job->workers;
    for (; w->done < w->page_count; w->done = w->ready) {
        w->ready = w->page_count;
        if (!umb__grow(w->alloc, &w->made, &w->made_capacity, w->ready, sizeof *w->made) ||
            !umb__grow(w->alloc, &w->entries, &w->entries_capacity, w->ready, UMB__PAGE_ENTRY)) {
            return no_memory(w->error);
        }
        memset(w->made + w->done, 0, (w->ready - w->done) * sizeof *w->made);
        const uint32_t count = w->ready - w->done;
        const uint32_t jobs = count / UMB__DIGESTS + (count % UMB__DIGESTS > 0);
        if (workers) {
            workers->run(workers->user, round_job, w, jobs);
        } else {
            for (uint32_t job = 0; job < jobs; job++) {
                round_job(w, job, 0);
            }
        }
        UMB__TRY(end_round(w));
        for (uint32_t page = w->done; page < w->ready; page++) {
            UMB__TRY(link_page(w, page));
        }
    }
    return UMB_OK;
}

/* Begins with the pages of the roots. */
static enum umb_status begin_pages(struct writer *w)
{
    const struct umb__octree *octree = w->job->octree;
    w->page_count = w->cuts.top_count;
    bool complete = umb__grow(w->alloc, &w->pages, &w->pages_capacity, (size_t)w->page_count + 1,
                              sizeof *w->pages);
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX && complete; level++) {
        if (w->cuts.parts[level]) {
            const size_t count = (size_t)octree->level[level].count + 1;
            w->first_page[level] = umb__alloc_zeroed(w->alloc, count, sizeof *w->first_page[level]);
            complete = w->first_page[level] != NULL;
        }
    }
    if (!complete) {
        return no_memory(w->error);
    }
    memcpy(w->pages, w->cuts.tops, w->page_count * sizeof *w->pages);
    return UMB_OK;
}

static enum umb_status make_pages(struct writer *w)
{
    const struct umb__octree *octree = w->job->octree;
    w->worker_count = w->job->workers ? w->job->workers->count : 1;
    UMB__TRY(umb__pack_survey(octree, &w->survey, w->error));
    UMB__TRY(umb__pack_cut(octree, &w->survey, w->job->workers, w->job->page_bytes, w->job->kept,
                           &w->cuts, w->error));
    UMB__TRY(begin_pages(w));
    UMB__TRY(create_workers(w));
    return make_rounds(w);
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

/* Finds the places of the roots of one page: equal roots are one node. */
static bool place_roots(const struct writer *w, uint32_t page, struct umb__value_set *met,
                        uint32_t *positions, struct umb__packed_root *places)
{
    const struct umb__pack_page *top = &w->pages[page];
    uint32_t next[UMB_LEVEL_MAX + 1] = {0};
    if (!umb__value_set_begin(met, w->alloc, top->part)) {
        return false;
    }
    for (uint32_t i = top->node; i < top->node + top->part; i++) {
        const struct umb__octree_root *root = &w->job->octree->roots[i];
        if (root->state == UMB__NODE_MIXED) {
            const size_t before = met->count;
            const uint32_t number =
                umb__value_set_add(met, (uint64_t)root->level << 32 | root->index);
            if (number == before) {
                positions[number] = next[root->level]++;
            }
            places[i].page = page;
            places[i].position = positions[number];
        }
    }
    return true;
}

/* Encodes the canonical block: the content, the counts of nodes, and the places of the roots. */
static enum umb_status encode_canonical(struct writer *w)
{
    const struct umb__content *content = w->job->content;
    struct umb__canonical canonical = {.content = *content};
    struct umb__value_set met = {0};
    memcpy(canonical.counts, w->survey.counts, sizeof canonical.counts);
    canonical.roots = umb__alloc_zeroed(w->alloc, content->frustum_count, sizeof *canonical.roots);
    uint32_t *positions =
        umb__alloc(w->alloc, (size_t)content->frustum_count + 1, sizeof *positions);
    bool complete = canonical.roots && positions;
    for (uint32_t i = 0; i < content->frustum_count && complete; i++) {
        canonical.roots[i].state = (uint32_t)w->job->octree->roots[i].state;
    }
    for (uint32_t page = 0; page < w->cuts.top_count && complete; page++) {
        complete = place_roots(w, page, &met, positions, canonical.roots);
    }
    const enum umb_status status = complete
                                       ? umb__canonical_encode(&canonical, w->alloc, &w->canonical,
                                                               &w->canonical_length, w->error)
                                       : no_memory(w->error);
    umb__value_set_finish(&met, w->alloc);
    umb__free(w->alloc, positions);
    umb__free(w->alloc, canonical.roots);
    return status;
}

/* Makes the blocks: entries, then links. The offsets of the pages are still missing. */
static bool make_blocks(struct writer *w)
{
    const uint32_t count = w->page_count;
    for (uint32_t page = 0; page < count; page++) {
        w->blocks_length += UMB__PAGE_ENTRY + w->made[page].links_length;
    }
    w->table = umb__alloc_zeroed(w->alloc, umb__block_count(count), UMB__BLOCK_ENTRY);
    w->blocks = umb__alloc(w->alloc, w->blocks_length, 1);
    if (!w->table || !w->blocks) {
        return false;
    }
    uint8_t *at = w->blocks;
    for (uint32_t block = 0; block < umb__block_count(count); block++) {
        const uint32_t first = block * UMB__BLOCK_PAGES;
        const uint32_t entries = umb__block_entry_bytes(count, block);
        memcpy(at, w->entries + (size_t)first * UMB__PAGE_ENTRY, entries);
        at += entries;
        for (uint32_t i = first; i < first + entries / UMB__PAGE_ENTRY; i++) {
            if (w->made[i].links_length > 0) {
                memcpy(at, w->made[i].links, w->made[i].links_length);
                at += w->made[i].links_length;
            }
        }
        umb__store64(w->table + (size_t)block * UMB__BLOCK_ENTRY + UMB__BLOCK_END,
                     (uint64_t)(at - w->blocks));
    }
    return true;
}

/* Returns the offset of the end of a block in `blocks`. */
static size_t block_end(const struct writer *w, uint32_t block)
{
    return (size_t)umb__load64(w->table + (size_t)block * UMB__BLOCK_ENTRY + UMB__BLOCK_END);
}

/* Computes the places of pages and blocks, and the checksums and hashes of the blocks. Returns
 * false if no digest could be made. */
static bool lay_out(struct writer *w, struct umb__head *head)
{
    bool sealed = true;
    head->first_block = w->page_count > 0 ? (uint32_t)block_end(w, 0) : 0;
    head->file_length = head->head_length + head->first_block;
    for (uint32_t block = 0; block < head->directory_count; block++) {
        uint8_t *bytes = w->blocks + (block > 0 ? block_end(w, block - 1) : 0);
        const uint32_t size = (uint32_t)(w->blocks + block_end(w, block) - bytes);
        const uint32_t pages = umb__block_entry_bytes(w->page_count, block) / UMB__PAGE_ENTRY;
        if (block == 1) {
            head->blocks_offset = head->file_length;
            head->file_length += w->blocks_length - head->first_block;
        }
        for (uint32_t i = 0; i < pages; i++) {
            uint8_t *entry = bytes + (size_t)i * UMB__PAGE_ENTRY;
            umb__store64(entry + UMB__PAGE_OFFSET, head->file_length);
            head->file_length += umb__load32(entry + UMB__PAGE_STORED_LENGTH);
        }
        sealed = umb__block_seal(bytes, size, pages, w->job->sha256,
                                 w->table + (size_t)block * UMB__BLOCK_ENTRY) &&
                 sealed;
    }
    return sealed;
}

/* Writes everything behind the head: the first block, its pages, the other blocks and pages. */
static enum umb_status write_blocks_and_pages(const struct writer *w, size_t first_block)
{
    const struct umb_sink *sink = w->job->sink;
    if (w->page_count > 0) {
        UMB__TRY(sink->write(sink->user, w->blocks, first_block));
    }
    for (uint32_t page = 0; page < w->page_count; page++) {
        const uint8_t *entry = w->entries + (size_t)page * UMB__PAGE_ENTRY;
        if (page == UMB__BLOCK_PAGES) {
            UMB__TRY(
                sink->write(sink->user, w->blocks + first_block, w->blocks_length - first_block));
        }
        UMB__TRY(sink->write(sink->user, w->made[page].stored,
                             umb__load32(entry + UMB__PAGE_STORED_LENGTH)));
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
        .directory = w->table,
        .directory_count = umb__block_count(w->page_count),
        .page_count = w->page_count,
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
    status = status == UMB_OK ? write_blocks_and_pages(w, head.first_block) : status;
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

/* Hands all pages to the caller. */
static enum umb_status tell_pages(const struct writer *w)
{
    struct umb__kept_page *pages =
        w->job->made ? umb__alloc(w->alloc, (size_t)w->page_count + 1, sizeof *pages) : NULL;
    if (!w->job->made) {
        return UMB_OK;
    }
    if (!pages) {
        return no_memory(w->error);
    }
    for (uint32_t i = 0; i < w->page_count; i++) {
        pages[i] = (struct umb__kept_page){
            .page = i < w->cuts.top_count ? (struct umb__pack_page){0} : w->pages[i],
            .entry = w->entries + (size_t)i * UMB__PAGE_ENTRY,
            .stored = w->made[i].stored,
            .cuts = w->made[i].cuts,
            .cut_count = (uint32_t)w->made[i].cut_count,
        };
    }
    w->job->made(w->job->made_user, &w->cuts, pages, w->page_count);
    umb__free(w->alloc, pages);
    return UMB_OK;
}

static enum umb_status write_asset(struct writer *w, uint8_t id[UMB_ID_BYTES])
{
    UMB__TRY(check_content(w->job->content, w->error));
    UMB__TRY(check_roots(w->job->content, w->job->octree, w->error));
    UMB__TRY(make_pages(w));
    if (!make_blocks(w)) {
        return no_memory(w->error);
    }
    UMB__TRY(encode_canonical(w));
    UMB__TRY(write_file(w, id));
    return tell_pages(w);
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
    umb__free(w.alloc, w.pages);
    umb__free(w.alloc, w.made);
    umb__free(w.alloc, w.entries);
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(w.alloc, w.first_page[level]);
    }
    umb__pack_cuts_finish(&w.cuts);
    umb__pack_survey_finish(&w.survey);
    umb__free(w.alloc, w.table);
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
