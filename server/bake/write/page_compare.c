/* SPDX-License-Identifier: Apache-2.0 */
/* See page_compare.h. Workers share the pages: first they expand all of them, then they match the
 * nodes of one level after another, from the roots down. */
#include "bake/write/page_compare.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/try.h"
#include "common/sha256.h"
#include "format/directory.h"

/* Pages of a job. */
#define BLOCK 32U

/* Distance in nodes at which the octree's words are fetched: its order is not that of pages. */
#define AHEAD 8U

typedef uint32_t level_starts[UMB_LEVEL_MAX + 1];

/* Working memory of one worker. */
struct helper {
    ZSTD_DCtx *zstd;
    uint32_t *others; /* slots of the nodes in other pages to which a level of a page refers */
    uint64_t *leaves; /* leaves of a page */
    enum umb_status status; /* of the first failed page */
    struct umb_error error;
};

struct matching {
    const struct umbb_page_compare *compare;
    const uint8_t *file;
    const struct umb__head *head;
    uint8_t *raw;            /* all pages, uncompressed */
    uint64_t *raw_at;        /* [pages + 1] Offset of a page in `raw` */
    uint32_t *raw_length;    /* [pages] Bytes of a page, without its links */
    struct umb__page *pages; /* [pages] parsed; point into `raw` */
    level_starts *first;     /* [pages] Slot of a page's first node of each level */
    /* [slots of a level] Number of a node's partner in the octree, plus 1; 0: none yet */
    _Atomic uint32_t *partners[UMB_LEVEL_MAX + 1];
    struct helper *helpers; /* [workers] */
    uint32_t level;         /* level that is being matched */
    atomic_int failed;      /* 1: pages not yet begun are left out */
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "self-check: no memory for the pages of the file");
}

/* Fails because a page is not of the octree. */
static enum umb_status differs(struct umb_error *error, uint32_t page, uint32_t level,
                               const char *what)
{
    return umb_fail(error, UMB_E_INTERNAL, "self-check: page %u of the written file, level %u: %s",
                    page, level, what);
}

/* Returns the bytes of a page and, behind it, of its links. */
static uint64_t room_of(const struct umb__page_entry *entry)
{
    return (uint64_t)entry->raw_length + entry->links_length;
}

/* Uncompresses and parses a page. */
static enum umb_status expand_page(struct matching *m, struct helper *helper, uint32_t page)
{
    struct umb__page_entry entry = umb__directory_load(m->head, page);
    uint8_t *raw = m->raw + m->raw_at[page];
    /* Another process may have changed the entry. */
    if (room_of(&entry) != m->raw_at[page + 1] - m->raw_at[page] ||
        entry.offset > m->head->file_length ||
        entry.stored_length > m->head->file_length - entry.offset) {
        return umb_fail(&helper->error, UMB_E_CORRUPT,
                        "directory: page %u changed while it was read", page);
    }
    const uint8_t *stored = m->file + entry.offset;
    if (XXH3_64bits(stored, entry.stored_length) != entry.check) {
        return umb_fail(&helper->error, UMB_E_CORRUPT,
                        "page %u of the file: checksum does not match", page);
    }
    UMB__TRY(umb__page_expand(helper->zstd, stored, &entry, raw, &helper->error));
    umb__directory_links(m->head, &entry, raw + entry.raw_length);
    m->raw_length[page] = entry.raw_length;
    return umb__page_open(raw, &entry, &m->pages[page], &helper->error);
}

/* Compares the hashes of expanded pages with those of the directory. The writer takes the hashes of
 * kept pages over. */
static enum umb_status compare_hashes(const struct matching *m, struct helper *helper,
                                      uint32_t begin, uint32_t end)
{
    const uint8_t *messages[BLOCK] = {NULL};
    uint8_t digests[BLOCK][UMB_ID_BYTES];
    size_t sizes[BLOCK] = {0};
    for (uint32_t p = begin; p < end; p++) {
        messages[p - begin] = m->raw + m->raw_at[p];
        sizes[p - begin] = m->raw_length[p];
    }
    umb__digest_many(&umbs_sha256, messages, sizes, end - begin, digests);
    for (uint32_t p = begin; p < end; p++) {
        if (memcmp(digests[p - begin], umb__directory_hash(m->head, p), UMB_ID_BYTES) != 0) {
            return umb_fail(&helper->error, UMB_E_INTERNAL,
                            "self-check: page %u of the written file is not what its hash says", p);
        }
    }
    return UMB_OK;
}

/* Finds the slot of a node in the array of its level. */
static enum umb_status find_slot(const struct matching *m, uint32_t level, uint32_t page,
                                 uint32_t position, uint32_t *slot, struct umb_error *error)
{
    if (page >= m->head->page_count || position >= m->pages[page].node_count[level]) {
        return umb_fail(error, UMB_E_CORRUPT, "node %u of level %u in page %u: not there", position,
                        level, page);
    }
    *slot = m->first[page][level] + position;
    return UMB_OK;
}

/* Makes a node of the octree the partner of a slot. Returns 0 if the slot has another partner. */
static int pair(_Atomic uint32_t *slot, uint32_t node)
{
    uint32_t before = atomic_load_explicit(slot, memory_order_relaxed);
    return (before == 0 &&
            atomic_compare_exchange_strong_explicit(slot, &before, node + 1, memory_order_relaxed,
                                                    memory_order_relaxed)) ||
           before == node + 1;
}

/* Finds the slots of the nodes in other pages to which a level of a page refers. */
static enum umb_status find_others(const struct matching *m, struct helper *helper, uint32_t p,
                                   uint32_t level)
{
    const struct umb__page *page = &m->pages[p];
    struct umb__page_others others = umb__page_others(page, level);
    for (uint32_t i = 0; i < page->external_count[level]; i++) {
        const struct umb__node_place place = umb__page_others_next(&others);
        UMB__TRY(find_slot(m, level - 1, place.page, place.position, &helper->others[i],
                           &helper->error));
    }
    return UMB_OK;
}

/* Number in the octree of a slot's partner, plus 1; 0: none. */
static uint32_t partner(const _Atomic uint32_t *slot)
{
    return atomic_load_explicit(slot, memory_order_relaxed);
}

/* Prefetches the words of nodes that are matched soon: the entry of the partner of node i + AHEAD,
 * and the children of the partner of node i + AHEAD / 2. In: count: number of the page's nodes. */
static void fetch_nodes(const struct umb__octree_level *level, const _Atomic uint32_t *partners,
                        uint32_t i, uint32_t count)
{
    const uint32_t far = i + AHEAD < count ? partner(&partners[i + AHEAD]) : 0;
    const uint32_t near = i + AHEAD / 2 < count ? partner(&partners[i + AHEAD / 2]) : 0;
    if (far != 0) {
        __builtin_prefetch(&level->masks[far - 1]);
        __builtin_prefetch(&level->first[far - 1]);
    }
    if (near != 0) {
        __builtin_prefetch(&level->children[level->first[near - 1]]);
    }
}

/* Matches the nodes of one level of a page, and pairs their children. */
static enum umb_status match_nodes(struct matching *m, struct helper *helper, uint32_t p)
{
    const uint32_t l = m->level;
    const struct umb__page *page = &m->pages[p];
    const struct umb__octree_level *level = &m->compare->octree->level[l];
    const _Atomic uint32_t *partners = m->partners[l] + m->first[p][l];
    _Atomic uint32_t *below = m->partners[l - 1];
    const uint32_t own = m->first[p][l - 1];
    struct umb__page_nodes nodes = umb__page_nodes(page, l);
    UMB__TRY(find_others(m, helper, p, l));
    for (uint32_t i = 0; i < page->node_count[l]; i++) {
        const uint32_t node = partner(&partners[i]);
        uint32_t references[8];
        uint16_t mask;
        fetch_nodes(level, partners, i, page->node_count[l]);
        const unsigned count = umb__page_nodes_next(&nodes, &mask, references);
        if (node == 0) {
            return differs(&helper->error, p, l, "no root leads to a node");
        }
        if (mask != level->masks[node - 1]) {
            return differs(&helper->error, p, l, "a node has other children");
        }
        const uint32_t *children = level->children + level->first[node - 1];
        for (unsigned c = 0; c < count; c++) {
            const uint32_t slot = references[c] < nodes.own
                                      ? own + references[c]
                                      : helper->others[references[c] - nodes.own];
            if (!pair(&below[slot], children[c])) {
                return differs(&helper->error, p, l, "a child is another node");
            }
        }
    }
    return UMB_OK;
}

/* Matches the bricks of a page. */
static enum umb_status match_bricks(struct matching *m, struct helper *helper, uint32_t p)
{
    const struct umb__page *page = &m->pages[p];
    const _Atomic uint32_t *partners = m->partners[UMB_LEVEL_BRICK] + m->first[p][UMB_LEVEL_BRICK];
    struct umb__page_bricks bricks = umb__page_bricks(page, helper->leaves);
    const uint32_t count = page->node_count[UMB_LEVEL_BRICK];
    umb__page_leaves(page, helper->leaves);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t brick = partner(&partners[i]);
        const uint32_t next = i + AHEAD < count ? partner(&partners[i + AHEAD]) : 0;
        uint64_t slices[8];
        if (next != 0) {
            __builtin_prefetch(m->compare->octree->bricks[next - 1]);
        }
        umb__page_bricks_next(&bricks, slices);
        if (brick == 0) {
            return differs(&helper->error, p, UMB_LEVEL_BRICK, "no root leads to a brick");
        }
        if (memcmp(slices, m->compare->octree->bricks[brick - 1], sizeof slices) != 0) {
            return differs(&helper->error, p, UMB_LEVEL_BRICK, "a brick has other voxels");
        }
    }
    return UMB_OK;
}

/* Runs one job: expands its pages at first, then matches their nodes of one level. */
static void run_job(void *user, uint32_t job, unsigned worker)
{
    struct matching *m = user;
    struct helper *helper = &m->helpers[worker];
    const uint32_t begin = job * BLOCK, left = m->head->page_count - begin;
    const uint32_t end = begin + (left < BLOCK ? left : BLOCK);
    if (helper->status == UMB_OK && m->compare->cancelled()) {
        helper->status = umb_fail(&helper->error, UMB_E_CANCELLED, "self-check: cancelled");
    }
    for (uint32_t p = begin; p < end && helper->status == UMB_OK &&
                             !atomic_load_explicit(&m->failed, memory_order_relaxed);
         p++) {
        if (m->level == 0) {
            helper->status = expand_page(m, helper, p);
        } else if (m->pages[p].node_count[m->level] > 0) {
            helper->status = m->level == UMB_LEVEL_BRICK ? match_bricks(m, helper, p)
                                                         : match_nodes(m, helper, p);
        }
    }
    if (helper->status == UMB_OK && m->level == 0 &&
        !atomic_load_explicit(&m->failed, memory_order_relaxed)) {
        helper->status = compare_hashes(m, helper, begin, end);
    }
    if (helper->status != UMB_OK) {
        atomic_store_explicit(&m->failed, 1, memory_order_relaxed);
    }
}

/* Runs all jobs of a level; of level 0: expands the pages. */
static enum umb_status run_level(struct matching *m, uint32_t level, struct umb_error *error)
{
    const struct umb_workers *workers = m->compare->workers;
    const uint32_t pages = m->head->page_count;
    m->level = level;
    if (pages > 0) {
        workers->run(workers->user, run_job, m, pages / BLOCK + (pages % BLOCK > 0));
    }
    for (unsigned i = 0; i < workers->count; i++) {
        if (m->helpers[i].status != UMB_OK) {
            return umb_fail(error, m->helpers[i].status, "%s", m->helpers[i].error.message);
        }
    }
    return UMB_OK;
}

/* Allocates memory for the pages. In: raw_total: bytes of all pages, uncompressed. */
static enum umb_status open_pages(struct matching *m, uint64_t raw_total, struct umb_error *error)
{
    const size_t count = m->head->page_count, workers = m->compare->workers->count;
    m->raw = malloc((size_t)raw_total + 1);
    m->raw_at = malloc((count + 1) * sizeof *m->raw_at);
    m->raw_length = malloc((count + 1) * sizeof *m->raw_length);
    m->pages = malloc((count + 1) * sizeof *m->pages);
    m->first = malloc((count + 1) * sizeof *m->first);
    m->helpers = calloc(workers, sizeof *m->helpers);
    if (m->raw == NULL || m->raw_at == NULL || m->raw_length == NULL || m->pages == NULL ||
        m->first == NULL || m->helpers == NULL) {
        return no_memory(error);
    }
    uint64_t at = 0;
    for (uint32_t page = 0; page < count; page++) {
        const struct umb__page_entry entry = umb__directory_load(m->head, page);
        const uint64_t length = room_of(&entry);
        m->raw_at[page] = at;
        if (length > raw_total - at) {
            return umb_fail(error, UMB_E_CORRUPT, "directory: page %u changed while it was read",
                            page);
        }
        at += length;
    }
    m->raw_at[count] = at;
    for (size_t i = 0; i < workers; i++) {
        m->helpers[i].zstd = ZSTD_createDCtx();
        if (m->helpers[i].zstd == NULL) {
            return no_memory(error);
        }
    }
    return UMB_OK;
}

/* Allocates partners and tables, and numbers the slots of all levels. */
static enum umb_status open_slots(struct matching *m, struct umb_error *error)
{
    uint64_t totals[UMB_LEVEL_MAX + 1] = {0};
    uint32_t others = 0, leaves = 0;
    for (uint32_t p = 0; p < m->head->page_count; p++) {
        const struct umb__page *page = &m->pages[p];
        leaves = page->leaf_count > leaves ? page->leaf_count : leaves;
        for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
            m->first[p][level] = (uint32_t)totals[level];
            totals[level] += page->node_count[level];
            others = page->external_count[level] > others ? page->external_count[level] : others;
            if (totals[level] >= UINT32_MAX) {
                return umb_fail(error, UMB_E_CORRUPT, "level %zu: too many nodes", level);
            }
        }
    }
    int complete = 1;
    for (size_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        m->partners[level] = calloc((size_t)totals[level] + 1, sizeof *m->partners[level]);
        complete = complete && m->partners[level] != NULL;
    }
    for (size_t i = 0; i < m->compare->workers->count; i++) {
        struct helper *helper = &m->helpers[i];
        helper->others = malloc(((size_t)others + 1) * sizeof *helper->others);
        helper->leaves = malloc(((size_t)leaves + 1) * sizeof *helper->leaves);
        complete = complete && helper->others != NULL && helper->leaves != NULL;
    }
    return complete ? UMB_OK : no_memory(error);
}

static void matching_finish(struct matching *m)
{
    for (size_t i = 0; m->helpers != NULL && i < m->compare->workers->count; i++) {
        ZSTD_freeDCtx(m->helpers[i].zstd);
        free(m->helpers[i].others);
        free(m->helpers[i].leaves);
    }
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        free((void *)m->partners[level]);
    }
    free(m->helpers);
    free(m->raw);
    free(m->raw_at);
    free(m->raw_length);
    free(m->pages);
    free(m->first);
}

/* Most bytes of everything that is allocated: each leaf, and each node in another page, takes at
 * least one byte of a page. */
static uint64_t most_bytes(const struct matching *m, uint64_t raw_total)
{
    uint64_t bytes = raw_total + (m->head->page_count + 1) *
                                     (uint64_t)(sizeof *m->pages + sizeof *m->first +
                                                sizeof *m->raw_at + sizeof *m->raw_length);
    uint64_t longest = 1;
    for (uint32_t page = 0; page < m->head->page_count; page++) {
        const struct umb__page_entry entry = umb__directory_load(m->head, page);
        bytes += sizeof(uint32_t) * (uint64_t)entry.records;
        longest = entry.raw_length > longest ? entry.raw_length : longest;
    }
    return bytes + m->compare->workers->count *
                       (sizeof *m->helpers->others + sizeof *m->helpers->leaves) * longest;
}

/* Compares the counts of nodes, and pairs the roots. */
static enum umb_status pair_roots(struct matching *m, const struct umb__canonical *canonical,
                                  struct umb_error *error)
{
    const struct umb__octree *octree = m->compare->octree;
    int same = octree->root_count == canonical->content.frustum_count;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        same = same && canonical->counts[level] == umb__octree_level_count(octree, level);
    }
    for (uint32_t i = 0; same && i < octree->root_count; i++) {
        const struct umb__octree_root *root = &octree->roots[i];
        const struct umb__packed_root *packed = &canonical->roots[i];
        uint32_t slot = 0;
        same = packed->state == (uint32_t)root->state;
        if (same && root->state == UMB__NODE_MIXED) {
            UMB__TRY(find_slot(m, root->level, packed->page, packed->position, &slot, error));
            same = root->level == canonical->content.frusta[i].log2_size &&
                   pair(&m->partners[root->level][slot], root->index);
        }
    }
    return same ? UMB_OK
                : umb_fail(error, UMB_E_INTERNAL,
                           "self-check: the written file has other roots or counts of nodes");
}

static enum umb_status match(struct matching *m, const struct umb__canonical *canonical,
                             uint64_t max_memory_bytes, struct umb_error *error)
{
    uint64_t raw_total;
    UMB__TRY(umb__directory_check(m->head, &raw_total, error));
    const uint64_t bytes = most_bytes(m, raw_total);
    if (bytes > max_memory_bytes) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "asset: reading it back takes up to %llu bytes, the limit is %llu",
                        (unsigned long long)bytes, (unsigned long long)max_memory_bytes);
    }
    UMB__TRY(open_pages(m, raw_total, error));
    UMB__TRY(run_level(m, 0, error));
    UMB__TRY(open_slots(m, error));
    UMB__TRY(pair_roots(m, canonical, error));
    for (uint32_t level = UMB_LEVEL_MAX; level >= UMB_LEVEL_BRICK; level--) {
        UMB__TRY(run_level(m, level, error));
    }
    return UMB_OK;
}

enum umb_status umbb_pages_compare(const struct umbb_page_compare *compare, const uint8_t *file,
                                   const struct umb__head *head,
                                   const struct umb__canonical *canonical,
                                   uint64_t max_memory_bytes, struct umb_error *error)
{
    struct matching m = {.compare = compare, .file = file, .head = head};
    atomic_init(&m.failed, 0);
    const enum umb_status status = match(&m, canonical, max_memory_bytes, error);
    matching_finish(&m);
    return status;
}
