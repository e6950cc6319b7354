/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See umbrage/region.h. An update goes in rounds. The held pages show which missing pages matter. A
 * round requests as many of these as its limit of bytes allows. Each page is verified when it
 * arrives, and all pages of a round are laid out together. Rounds grow with the pages held, so that
 * layout stays a small part of the time.
 */
#include "net/openssl_sha256.h" /* before any other header of OpenSSL */
#include "umbrage/region.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "format/layout.h"

enum {
    FIRST_BYTES = 16 << 10,
    ROUND_BYTES_MIN = 512 << 10,
    ROUND_ITEMS_MAX = 4096,
    BLOCK_BYTES = 4096, /* Bytes of a directory block with its links, as a round counts them */
};

struct umb_region {
    struct umb_region_source source;
    struct umb_partial *partial;
    uint64_t max_memory_bytes;
    bool resumed; /* True until the source has shown that it has the same asset */
    uint64_t received_bytes, requests, rounds, pages_received;
    uint32_t items[ROUND_ITEMS_MAX]; /* Numbers of blocks, then of pages */
    struct umb_range ranges[ROUND_ITEMS_MAX];
    uint32_t first_item[ROUND_ITEMS_MAX]; /* Number of each range's first block or page */
};

/* Reads bytes piece by piece, by read_at. */
static enum umb_status read_pieces(const struct umb_region_source *source, uint64_t offset,
                                   uint8_t *bytes, size_t length, size_t *size,
                                   struct umb_error *error)
{
    *size = 0;
    for (size_t got = 1; got > 0 && *size < length; *size += got) {
        const size_t left = length - *size;
        got = 0;
        UMB__TRY(source->read_at(source->user, offset + *size, bytes + *size, left, &got, error));
        if (got > left) {
            return umb_fail(error, UMB_E_PROTOCOL, "region: the source read %zu bytes of %zu", got,
                            left);
        }
    }
    return UMB_OK;
}

/* Reads one range by read_at. In and out: buffer: the bytes, allocated again if they do not fit. */
static enum umb_status read_range(const struct umb_region_source *source,
                                  const struct umb_range *range, uint8_t **buffer, size_t *size,
                                  struct umb_error *error)
{
    uint8_t *bytes = range->length <= SIZE_MAX ? realloc(*buffer, (size_t)range->length) : NULL;
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "region: no memory for %llu bytes",
                        (unsigned long long)range->length);
    }
    *buffer = bytes;
    return read_pieces(source, range->offset, bytes, (size_t)range->length, size, error);
}

/* Reads ranges by the source's read or read_at. */
static enum umb_status read_ranges(const struct umb_region_source *source,
                                   const struct umb_range *ranges, size_t count, umb_range_fn got,
                                   void *got_user, struct umb_error *error)
{
    uint8_t *buffer = NULL;
    enum umb_status status = UMB_OK;
    if (source->read) {
        return source->read(source->user, ranges, count, got, got_user, error);
    }
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        size_t size = 0;
        status = read_range(source, &ranges[i], &buffer, &size, error);
        if (status == UMB_OK) {
            status = got(got_user, i, buffer, size);
        }
    }
    free(buffer);
    return status;
}

/* The front of the file. */
struct front {
    uint8_t *bytes;
    size_t size, capacity;
    uint64_t received;
};

static enum umb_status take_front(void *user, size_t index, const void *bytes, size_t size)
{
    struct front *front = user;
    (void)index;
    if (size > front->capacity - front->size) {
        return UMB_E_PROTOCOL;
    }
    memcpy(front->bytes + front->size, bytes, size);
    front->size += size;
    front->received += size;
    return UMB_OK;
}

enum umb_status umb_region_source_read(const struct umb_region_source *source, uint64_t offset,
                                       void *bytes, size_t size, size_t *got,
                                       struct umb_error *error)
{
    const struct umb_range range = {offset, size};
    struct front part = {.bytes = bytes, .capacity = size};
    if (!source->read) {
        return read_pieces(source, offset, bytes, size, got, error);
    }
    const enum umb_status status = source->read(source->user, &range, 1, take_front, &part, error);
    *got = part.size;
    return status;
}

enum umb_status umb_region_source_id(const struct umb_region_source *source,
                                     uint8_t id[UMB_ID_BYTES], struct umb_error *error)
{
    uint8_t bytes[UMB__HEAD_SIZE];
    struct umb_file_head head;
    size_t got = 0;
    UMB__TRY(umb_region_source_read(source, 0, bytes, sizeof bytes, &got, error));
    UMB__TRY(umb_file_read_head(bytes, got, &head, error));
    memcpy(id, head.id, UMB_ID_BYTES);
    return UMB_OK;
}

static enum umb_status read_front(struct umb_region *region, struct front *front, uint64_t length,
                                  struct umb_error *error)
{
    const struct umb_range range = {front->size, length - front->size};
    uint8_t *bytes = length <= SIZE_MAX ? realloc(front->bytes, (size_t)length) : NULL;
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "region: no memory for %llu bytes",
                        (unsigned long long)length);
    }
    front->bytes = bytes;
    front->capacity = (size_t)length;
    region->requests++;
    region->rounds++;
    return read_ranges(&region->source, &range, 1, take_front, front, error);
}

/* Adds the pages that the first read contains. Pages beyond the memory budget stay missing. */
static enum umb_status add_front_pages(struct umb_region *region, const struct front *front,
                                       struct umb_error *error)
{
    struct umb_partial_stats stats;
    umb_partial_get_stats(region->partial, &stats);
    for (uint32_t page = 0; page < stats.page_count; page++) {
        uint64_t offset;
        uint32_t length;
        if (umb_partial_locate(region->partial, page, &offset, &length) != UMB_OK ||
            offset + length > front->size) {
            break;
        }
        enum umb_status status =
            umb_partial_add(region->partial, page, front->bytes + offset, length, error);
        if (status == UMB_E_NO_MEMORY) {
            break;
        }
        if (status != UMB_OK) {
            return status;
        }
        region->pages_received++;
    }
    return umb_partial_build(region->partial, error);
}

static struct umb_partial_options partial_options(const struct umb_region_options *options)
{
    return (struct umb_partial_options){
        .sha256 = umb_sha256_openssl(),
        .id = options ? options->id : NULL,
        .max_memory_bytes = options ? options->max_memory_bytes : 0,
    };
}

static enum umb_status open_front(struct umb_region *region,
                                  const struct umb_region_options *options, struct front *front,
                                  struct umb_error *error)
{
    const struct umb_partial_options partial = partial_options(options);
    const uint64_t limit = partial.max_memory_bytes ? partial.max_memory_bytes : (uint64_t)1 << 30;
    const uint64_t first = options && options->first_bytes ? options->first_bytes : FIRST_BYTES;
    struct umb_file_head head = {0};
    UMB__TRY(read_front(region, front, first, error));
    UMB__TRY(umb_file_read_head(front->bytes, front->size, &head, error));
    if (head.open_bytes > limit) {
        return umb_fail(error, UMB_E_TOO_LARGE, "head: %llu bytes, the memory budget is %llu",
                        (unsigned long long)head.open_bytes, (unsigned long long)limit);
    }
    if (head.open_bytes > front->size) {
        UMB__TRY(read_front(region, front, head.open_bytes, error));
    }
    region->received_bytes = front->received;
    UMB__TRY(umb_partial_open(front->bytes, front->size, &partial, &region->partial, error));
    return add_front_pages(region, front, error);
}

static enum umb_status make_region(const struct umb_region_source *source,
                                   const struct umb_region_options *options,
                                   struct umb_region **out, struct umb_error *error)
{
    *out = NULL;
    if (UMB__UNKNOWN(source, "source", error) ||
        (options && UMB__UNKNOWN(options, "options", error))) {
        return UMB_E_ARGUMENT;
    }
    if (!source->read && !source->read_at) {
        return umb_fail(error, UMB_E_ARGUMENT, "source: give read or read_at");
    }
    *out = calloc(1, sizeof **out);
    if (!*out) {
        return umb_fail(error, UMB_E_NO_MEMORY, "region: out of memory");
    }
    (*out)->source = *source;
    (*out)->max_memory_bytes = options ? options->max_memory_bytes : 0;
    return UMB_OK;
}

enum umb_status umb_region_open(const struct umb_region_source *source,
                                const struct umb_region_options *options, struct umb_region **out,
                                struct umb_error *error)
{
    struct front front = {0};
    struct umb_region *region;
    *out = NULL;
    UMB__TRY(make_region(source, options, &region, error));
    enum umb_status status = open_front(region, options, &front, error);
    free(front.bytes);
    if (status != UMB_OK) {
        umb_region_close(region);
        return status;
    }
    *out = region;
    return UMB_OK;
}

enum umb_status umb_region_resume(const void *bytes, size_t size,
                                  const struct umb_region_source *source,
                                  const struct umb_region_options *options, struct umb_region **out,
                                  struct umb_error *error)
{
    const struct umb_partial_options partial = partial_options(options);
    struct umb_region *region;
    *out = NULL;
    UMB__TRY(make_region(source, options, &region, error));
    enum umb_status status = umb_partial_open_saved(bytes, size, &partial, &region->partial, error);
    if (status != UMB_OK) {
        umb_region_close(region);
        return status;
    }
    region->resumed = true;
    *out = region;
    return UMB_OK;
}

void umb_region_close(struct umb_region *region)
{
    if (region) {
        umb_partial_close(region->partial);
        free(region);
    }
}

/* Data of a round: blocks of the directory, and pages. */
enum item_kind {
    ITEM_BLOCK,
    ITEM_PAGE,
};

static void locate(const struct umb_region *region, enum item_kind kind, uint32_t item,
                   uint64_t *offset, uint32_t *length)
{
    if (kind == ITEM_BLOCK) {
        umb_partial_locate_block(region->partial, item, offset, length);
    } else {
        (void)umb_partial_locate(region->partial, item, offset, length);
    }
}

/* A round under way. */
struct round {
    struct umb_region *region;
    size_t block_ranges; /* Number of ranges of blocks, which come first */
    size_t ranges;
    bool full;            /* True if the memory budget is full: further pages are discarded */
    size_t blocks, pages; /* that came */
    struct umb_error *error;
};

/* Adds byte ranges for blocks or pages in ascending order. Neighbours in the file share a range. */
static void join_items(struct round *round, enum item_kind kind, const uint32_t *items,
                       size_t count)
{
    struct umb_region *region = round->region;
    const size_t start = round->ranges;
    for (size_t i = 0; i < count; i++) {
        uint64_t offset;
        uint32_t length;
        locate(region, kind, items[i], &offset, &length);
        struct umb_range *last = round->ranges > start ? &region->ranges[round->ranges - 1] : NULL;
        if (last && items[i] == items[i - 1] + 1 && last->offset + last->length == offset) {
            last->length += length;
            continue;
        }
        region->ranges[round->ranges] = (struct umb_range){offset, length};
        region->first_item[round->ranges++] = items[i];
    }
}

static enum umb_status take_item(struct round *round, enum item_kind kind, uint32_t item,
                                 const uint8_t *bytes, uint32_t length)
{
    struct umb_region *region = round->region;
    enum umb_status status =
        kind == ITEM_BLOCK
            ? umb_partial_add_block(region->partial, item, bytes, length, round->error)
            : umb_partial_add(region->partial, item, bytes, length, round->error);
    if (status == UMB_E_NO_MEMORY) {
        round->full = true;
        return UMB_OK;
    }
    if (status == UMB_OK && kind == ITEM_PAGE) {
        region->pages_received++;
        round->pages++;
    } else if (status == UMB_OK) {
        round->blocks++;
    }
    return status;
}

static enum umb_status take_range(void *user, size_t index, const void *bytes, size_t size)
{
    struct round *round = user;
    struct umb_region *region = round->region;
    const enum item_kind kind = index < round->block_ranges ? ITEM_BLOCK : ITEM_PAGE;
    const uint8_t *at = bytes;
    uint32_t item = region->first_item[index];
    region->received_bytes += size;
    if (size != region->ranges[index].length) {
        return umb_fail(round->error, UMB_E_TRUNCATED,
                        "%s %u of the file: %zu bytes came of a range of %llu",
                        kind == ITEM_BLOCK ? "directory block" : "page", item, size,
                        (unsigned long long)region->ranges[index].length);
    }
    while (size > 0 && !round->full) {
        uint64_t offset;
        uint32_t length;
        locate(region, kind, item, &offset, &length);
        UMB__TRY(take_item(round, kind, item, at, length));
        at += length;
        size -= length;
        item++;
    }
    return UMB_OK;
}

static int by_number(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/*
 * Lists the blocks of a round. If the missing blocks are a small part of the round, all are listed,
 * so that no later round waits for a block. Otherwise only those are listed whose pages are needed
 * now.
 */
static size_t list_blocks(struct umb_region *region, uint64_t bytes)
{
    struct umb_partial_stats stats;
    umb_partial_get_stats(region->partial, &stats);
    const uint64_t missing = stats.block_count - stats.blocks_held;
    const bool all = missing * BLOCK_BYTES <= bytes / 16;
    const uint64_t most = bytes / BLOCK_BYTES;
    return umb_partial_missing_blocks(region->partial, all, region->items,
                                      most < ROUND_ITEMS_MAX / 2 ? (size_t)most
                                                                 : ROUND_ITEMS_MAX / 2);
}

/* Reads the missing blocks and pages that matter most, up to `bytes` bytes. Out: round: empty if
 * nothing is missing. */
static enum umb_status run_round(struct umb_region *region, uint64_t bytes, struct round *round)
{
    const size_t blocks = umb_partial_missing_blocks(region->partial, 0, region->items, 1) > 0 ||
                                  umb_partial_missing(region->partial, region->items, 1, 0) > 0
                              ? list_blocks(region, bytes)
                              : 0;
    const uint64_t used = (uint64_t)blocks * BLOCK_BYTES;
    uint32_t *pages = region->items + blocks;
    const size_t count = used < bytes ? umb_partial_missing(region->partial, pages,
                                                            ROUND_ITEMS_MAX - blocks, bytes - used)
                                      : 0;
    if (blocks + count == 0) {
        return UMB_OK;
    }
    /* A round needs all its pages before the layout, so any order is right. In the order of the
     * file, neighbours share a range. */
    qsort(pages, count, sizeof *pages, by_number);
    join_items(round, ITEM_BLOCK, region->items, blocks);
    round->block_ranges = round->ranges;
    join_items(round, ITEM_PAGE, pages, count);
    region->requests += round->ranges;
    region->rounds++;
    return read_ranges(&region->source, region->ranges, round->ranges, take_range, round,
                       round->error);
}

static enum umb_status want_views(struct umb_region *region,
                                  const struct umb_region_request *request, struct umb_error *error)
{
    for (size_t i = 0; i < request->view_count; i++) {
        UMB__TRY(umb_partial_want(region->partial, &request->views[i], i > 0, error));
    }
    return UMB_OK;
}

/* Returns the bytes that the next round may take; 0 if the limit is reached. */
static uint64_t round_bytes(const struct umb_region *region,
                            const struct umb_region_request *request, uint64_t start)
{
    struct umb_partial_stats stats;
    umb_partial_get_stats(region->partial, &stats);
    uint64_t bytes = request->round_bytes ? request->round_bytes : stats.held_bytes / 4;
    if (!request->round_bytes && bytes < ROUND_BYTES_MIN) {
        bytes = ROUND_BYTES_MIN;
    }
    if (request->max_bytes > 0) {
        const uint64_t used = region->received_bytes - start;
        const uint64_t left = used < request->max_bytes ? request->max_bytes - used : 0;
        bytes = bytes < left ? bytes : left;
    }
    return bytes;
}

/* Returns true if an id is that of the region's asset. */
static bool is_id_of(const struct umb_region *region, const uint8_t *id)
{
    return memcmp(id, umb_partial_head(region->partial) + UMB__HEAD_ID, UMB_ID_BYTES) == 0;
}

/* Checks that the source has the asset of the region that was saved. */
static enum umb_status check_source(struct umb_region *region, struct umb_error *error)
{
    struct front front = {0};
    enum umb_status status = read_front(region, &front, UMB__HEAD_SIZE, error);
    region->received_bytes += front.received;
    if (status == UMB_OK &&
        (front.size < UMB__HEAD_SIZE || !is_id_of(region, front.bytes + UMB__HEAD_ID))) {
        status = umb_fail(error, UMB_E_CORRUPT,
                          "region: the source has another asset than what was saved");
    }
    region->resumed = status != UMB_OK;
    free(front.bytes);
    return status;
}

/* Lays out the pages of a round. In: status: that of the round. */
static enum umb_status lay_out(struct umb_region *region, struct round *round,
                               enum umb_status status)
{
    struct umb_partial_stats before, after;
    umb_partial_get_stats(region->partial, &before);
    const enum umb_status built =
        umb_partial_build(region->partial, status == UMB_OK ? round->error : NULL);
    umb_partial_get_stats(region->partial, &after);
    round->full = round->full || after.pages_dropped > before.pages_dropped;
    return status == UMB_OK ? built : status;
}

enum umb_status umb_region_update(struct umb_region *region,
                                  const struct umb_region_request *request, struct umb_error *error)
{
    static const struct umb_partial_view all_lights = {.light = UINT32_MAX};
    static const struct umb_region_request whole = {.views = &all_lights, .view_count = 1};
    request = request ? request : &whole;
    if (UMB__UNKNOWN(request, "request", error)) {
        return UMB_E_ARGUMENT;
    }
    const uint64_t start = region->received_bytes;
    if (region->resumed) {
        UMB__TRY(check_source(region, error));
    }
    for (;;) { /* Terminates: every round but the last adds a page or a block */
        struct round round = {.region = region, .error = error};
        struct umb_partial_stats before, after;
        const uint64_t bytes = round_bytes(region, request, start);
        enum umb_status status = want_views(region, request, error);
        if (status != UMB_OK || bytes == 0) {
            return status;
        }
        umb_partial_get_stats(region->partial, &before);
        status = run_round(region, bytes, &round);
        umb_partial_get_stats(region->partial, &after);
        const bool came = round.pages > 0 || after.pages_inherited > before.pages_inherited;
        if (came) {
            status = lay_out(region, &round, status);
        }
        if (status == UMB_OK && came && request->progress) {
            status = request->progress(request->progress_user, region);
        }
        if (status != UMB_OK || round.pages + round.blocks == 0 || round.full) {
            return status;
        }
    }
}

/* Returns the bytes up to the end of the directory's first block, and some more. Another version's
 * are about as many. */
static uint64_t front_bytes(const struct umb_region *region)
{
    enum {
        MORE = 256
    };
    struct umb_partial_stats stats;
    uint64_t offset;
    uint32_t length;
    umb_partial_get_stats(region->partial, &stats);
    if (stats.block_count == 0) {
        return stats.head_bytes + MORE;
    }
    umb_partial_locate_block(region->partial, 0, &offset, &length);
    return offset + length + MORE;
}

/* Exchanges the versions of two regions, with their sources. */
static void exchange(struct umb_region *region, struct umb_region *other)
{
    struct umb_partial *partial = region->partial;
    region->partial = other->partial;
    other->partial = partial;
    region->max_memory_bytes = other->max_memory_bytes;
}

enum umb_status umb_region_retarget(struct umb_region *region,
                                    const struct umb_region_source *source,
                                    const struct umb_region_options *options,
                                    struct umb_error *error)
{
    struct umb_region_options own = {.max_memory_bytes = region->max_memory_bytes,
                                     .first_bytes = front_bytes(region)};
    struct umb_region *other;
    if (options) {
        if (UMB__UNKNOWN(options, "options", error)) {
            return UMB_E_ARGUMENT;
        }
        own.id = options->id;
        own.max_memory_bytes =
            options->max_memory_bytes ? options->max_memory_bytes : own.max_memory_bytes;
        own.first_bytes = options->first_bytes ? options->first_bytes : own.first_bytes;
    }
    UMB__TRY(umb_region_open(source ? source : &region->source, &own, &other, error));
    const bool same = is_id_of(region, umb_partial_head(other->partial) + UMB__HEAD_ID);
    enum umb_status status =
        same ? UMB_OK : umb_partial_inherit(other->partial, region->partial, error);
    if (status == UMB_OK) {
        region->source = other->source;
        region->resumed = false;
        region->received_bytes += other->received_bytes;
        region->requests += other->requests;
        region->rounds += other->rounds;
        region->pages_received += same ? 0 : other->pages_received;
        if (!same) {
            exchange(region, other);
        }
    }
    umb_region_close(other);
    return status == UMB_OK && !same ? umb_partial_build(region->partial, error) : status;
}

enum umb_status umb_region_query(struct umb_region *region,
                                 const struct umb_query_settings *settings,
                                 const struct umb_points *points, int want,
                                 struct umb_partial_answers *answers, struct umb_error *error)
{
    return umb_partial_query(region->partial, settings, points, want, answers, error);
}

void umb_region_get_stats(const struct umb_region *region, struct umb_region_stats *stats)
{
    *stats = (struct umb_region_stats){.received_bytes = region->received_bytes,
                                       .requests = region->requests,
                                       .rounds = region->rounds,
                                       .pages_received = region->pages_received};
    umb_partial_get_stats(region->partial, &stats->partial);
}

const struct umb_sha256 *umb_sha256_openssl(void)
{
    static const struct umb_sha256 sha256 = {.digest = umbn_sha256};
    return &sha256;
}

struct umb_partial *umb_region_partial(struct umb_region *region)
{
    return region->partial;
}
