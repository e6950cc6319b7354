/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The order of a packed file's nodes: its bands and their roots. pack_order.h explains bands and
 * copies; pack_walk.c has the walk below the roots.
 *
 * A sample of the lowest band's roots decides whether copies are worth their bytes there. Each run
 * of neighbouring roots is measured by itself, so helpers share the runs, each on a walk of its
 * own. Only where frusta are so small that their roots are in the lowest band may one tree be part
 * of another. Then one walk visits all runs in order.
 */
#include "format/pack_order.h"

#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/content.h"
#include "format/layout.h"
#include "format/pack_walk.h"

struct umb__node_place umb__pack_place(const struct umb__pack_order *order, uint32_t level,
                                       uint32_t ordinal)
{
    const uint32_t *hint = order->hints[level] + ordinal / UMB__PACK_HINT;
    uint32_t low = hint[0], high = hint[1];
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (order->begins[level][middle + 1] <= ordinal) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return (struct umb__node_place){low, ordinal - order->begins[level][low]};
}

void umb__pack_order_finish(struct umb__pack_order *order)
{
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(order->alloc, order->nodes[level]);
        umb__free(order->alloc, order->ordinals[level]);
        umb__free(order->alloc, order->begins[level]);
        umb__free(order->alloc, order->hints[level]);
    }
    memset(order, 0, sizeof *order);
}

/* --- decision about copies -------------------------------------------------------------------- */

#define SAMPLE_ROOTS 16384U /* Roots of a sample, at least; a few more are possible */
#define SAMPLE_RUN   64U    /* Neighbouring roots of each run */

/* Runs that are visited between two checks for too many bytes. */
#define ROUND_RUNS 32U

/* Most walks: each takes two bits a node, and more would not save time. */
#define SAMPLERS_MOST 8U

/* One walk, and the order that holds its open page. */
struct sampler {
    struct umb__pack_walk walk;
    struct umb__pack_order order;
    enum umb_status status;
};

struct sample {
    const struct umb__node_list *roots;
    struct sampler *samplers;
    unsigned sampler_count; /* Number of samplers; they share the runs of a round in turn */
    size_t step;            /* Distance between two visited runs */
    size_t first_run;       /* First run of the round */
    size_t round_runs;      /* Number of runs of the round */
};

static size_t sample_step(const struct umb__node_list *roots)
{
    return 1 + roots->count / SAMPLE_ROOTS;
}

/* Bytes of the lowest band's nodes, each once. */
static uint64_t own_bytes_of(const struct umb__pack_survey *survey)
{
    uint64_t bytes = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level < UMB__LOWEST_END; level++) {
        bytes += survey->bytes[level];
    }
    return bytes;
}

/* Returns the limit of bytes that `asked` sampled roots (at most 2^15) may take with copies. */
static uint64_t bytes_most(const struct umb__pack_survey *survey,
                           const struct umb__node_list *roots, uint64_t asked)
{
    /* No product overflows: at most 2^40 bytes and 2^15 roots. */
    return roots->count == 0
               ? 0
               : UMB__COPIES_MAX_FIFTHS * own_bytes_of(survey) * asked / (5 * roots->count);
}

/* Returns the bytes with copies as a multiple of the bytes without. In: bytes: taken by the sampled
 * roots with copies. most: their limit (bytes_most), which is UMB__COPIES_MAX times the bytes
 * without copies. */
static double copies_of(uint64_t bytes, uint64_t most)
{
    const double ratio = most > 0 ? (double)bytes / (double)most * UMB__COPIES_MAX : 1.0;
    return ratio > 1.0 ? ratio : 1.0;
}

static enum umb_status sampler_begin(struct sampler *sampler, const struct umb__pack_walk *walk)
{
    sampler->order.alloc = walk->order->alloc;
    sampler->walk = (struct umb__pack_walk){
        .octree = walk->octree,
        .survey = walk->survey,
        .order = &sampler->order,
        .band_low = walk->band_low,
        .alone = true,
        .numbers_roots = true,
        .sample = true,
    };
    return umb__pack_walk_begin(&sampler->walk, UMB__LOWEST_END - 1) ? UMB_OK : UMB_E_NO_MEMORY;
}

/* Returns the first root of visited run `run`. Out: count: number of the run's roots. */
static size_t run_first(const struct sample *s, size_t run, size_t *count)
{
    const size_t first = run * s->step * SAMPLE_RUN;
    const size_t left = first < s->roots->count ? s->roots->count - first : 0;
    *count = left < SAMPLE_RUN ? left : SAMPLE_RUN;
    return first;
}

static void visit_run(const struct sample *s, struct sampler *sampler, size_t run)
{
    size_t count;
    const size_t first = run_first(s, run, &count);
    for (size_t i = 0; i < count && sampler->status == UMB_OK; i++) {
        sampler->status = umb__pack_visit_root(&sampler->walk, s->roots->nodes[first + i]);
    }
    sampler->status =
        sampler->status == UMB_OK ? umb__pack_close_page(&sampler->walk) : sampler->status;
}

/* Visits the runs that one sampler has in a round. */
static void run_job(void *user, uint32_t job, unsigned worker)
{
    const struct sample *s = user;
    (void)worker;
    for (size_t run = job; run < s->round_runs; run += s->sampler_count) {
        visit_run(s, &s->samplers[job], s->first_run + run);
    }
}

/* Visits all runs, but stops when their pages take more than `most` bytes. Out: bytes: estimated
 * bytes so far. */
static enum umb_status visit_runs(struct sample *s, size_t runs, uint64_t most,
                                  const struct umb_workers *workers, uint64_t *bytes)
{
    enum umb_status status = UMB_OK;
    *bytes = 0;
    while (s->first_run < runs && *bytes <= most && status == UMB_OK) {
        const size_t left = runs - s->first_run;
        s->round_runs = left < ROUND_RUNS ? left : ROUND_RUNS;
        if (workers) {
            workers->run(workers->user, run_job, s, s->sampler_count);
        } else {
            run_job(s, 0, 0);
        }
        s->first_run += s->round_runs;
        *bytes = 0;
        for (unsigned i = 0; i < s->sampler_count; i++) {
            *bytes += s->samplers[i].walk.closed_bytes;
            status = status == UMB_OK ? s->samplers[i].status : status;
        }
    }
    return status;
}

/* Returns true if roots of frusta lie below a level. */
static bool has_roots_below(const struct umb__octree *octree, uint32_t level)
{
    bool has = false;
    for (uint32_t i = 0; i < octree->root_count; i++) {
        has = has || (octree->roots[i].state == UMB__NODE_MIXED && octree->roots[i].level < level);
    }
    return has;
}

/*
 * Visits some runs of the lowest band's roots with copies. Compares the estimated bytes of their
 * pages with their share of the band's bytes without copies. The result is the same for any
 * workers.
 *
 * In:    walk: at the beginning of the lowest band; only read. workers: or NULL.
 * Fails: E_NO_MEMORY.
 */
static enum umb_status sample_copies(const struct umb__pack_walk *walk,
                                     const struct umb__node_list *roots,
                                     const struct umb_workers *workers, bool *worth)
{
    const struct umb_alloc *alloc = walk->order->alloc;
    /* Without roots of frusta in the band, no root of the band is another root, or lies below
     * one. */
    workers = has_roots_below(walk->octree, UMB__LOWEST_END) ? NULL : workers;
    const unsigned helpers = workers ? workers->count : 1;
    const unsigned count = helpers < SAMPLERS_MOST ? helpers : SAMPLERS_MOST;
    struct sample s = {.roots = roots, .sampler_count = count, .step = sample_step(roots)};
    const size_t all_runs = roots->count / SAMPLE_RUN + (roots->count % SAMPLE_RUN > 0);
    const size_t runs = all_runs / s.step + (all_runs % s.step > 0);
    uint64_t asked = 0, bytes = 0;
    for (size_t run = 0; run < runs; run++) {
        size_t in_run;
        (void)run_first(&s, run, &in_run);
        asked += in_run;
    }
    const uint64_t most = bytes_most(walk->survey, roots, asked);
    s.samplers = umb__alloc_zeroed(alloc, count, sizeof *s.samplers);
    enum umb_status status = s.samplers ? UMB_OK : UMB_E_NO_MEMORY;
    for (unsigned i = 0; i < count && status == UMB_OK; i++) {
        status = sampler_begin(&s.samplers[i], walk);
    }
    status = status == UMB_OK ? visit_runs(&s, runs, most, workers, &bytes) : status;
    for (unsigned i = 0; s.samplers && i < count; i++) {
        umb__pack_walk_finish(&s.samplers[i].walk);
        umb__pack_order_finish(&s.samplers[i].order);
    }
    umb__free(alloc, s.samplers);
    *worth = bytes <= most;
    walk->order->copies = copies_of(bytes, most);
    return status == UMB_OK
               ? UMB_OK
               : umb_fail(walk->error, status, "packing: no memory for a sample of the pages");
}

/* --- bands ------------------------------------------------------------------------------------ */

/* Lowest level of each band, from the top. */
static const uint32_t band_lows[] = {13, UMB__LOWEST_END, UMB_LEVEL_BRICK};
#define BAND_COUNT (sizeof band_lows / sizeof band_lows[0])

struct umb__pack_ordering {
    struct umb__pack_survey survey;
    struct umb__pack_walk walk;
    struct umb__node_list roots; /* Roots of the current band; in the end of the lowest one */
    size_t next_root;            /* Index of the next root to visit */
    bool complete;               /* True if all nodes are ordered */
    bool never_copies;
    const struct umb_alloc *alloc;
};

static enum umb_status allocate(struct umb__pack_ordering *o)
{
    struct umb__pack_walk *t = &o->walk;
    struct umb__pack_order *order = t->order;
    bool complete = umb__pack_walk_begin(t, UMB_LEVEL_MAX);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        const size_t count = umb__octree_level_count(t->octree, level);
        const size_t reached = (size_t)o->survey.counts[level]; /* With copies, arrays grow */
        order->ordinals[level] =
            umb__alloc_large(order->alloc, count, sizeof *order->ordinals[level]);
        order->nodes[level] = umb__alloc_large(order->alloc, reached, sizeof *order->nodes[level]);
        order->node_capacity[level] = reached;
        complete = order->ordinals[level] && order->nodes[level];
    }
    return complete ? UMB_OK : umb__pack_no_memory(t->error);
}

/* Visits roots until all are visited or the order has most_pages pages. In and out: next: index of
 * the next root to visit. */
static enum umb_status visit_roots(struct umb__pack_walk *t, const struct umb__node_list *roots,
                                   size_t *next, uint32_t most_pages)
{
    while (*next < roots->count && t->order->page_count < most_pages) {
        UMB__TRY(umb__pack_visit_root(t, roots->nodes[(*next)++]));
    }
    return *next == roots->count ? umb__pack_close_page(t) : UMB_OK;
}

static enum umb_status visit_band(struct umb__pack_walk *t, const struct umb__node_list *roots)
{
    size_t next = 0;
    return visit_roots(t, roots, &next, UINT32_MAX);
}

/* Visits the whole lowest band with copies, and undoes it if the copies take too much. */
static enum umb_status visit_all_with_copies(struct umb__pack_ordering *o, bool *worth)
{
    struct umb__pack_walk *t = &o->walk;
    const uint32_t page_count = t->order->page_count;
    t->closed_bytes = 0;
    UMB__TRY(visit_band(t, &o->roots));
    const uint64_t most = bytes_most(&o->survey, &o->roots, o->roots.count);
    *worth = t->closed_bytes <= most && !o->never_copies;
    t->order->copies = copies_of(t->closed_bytes, most);
    o->complete = *worth;
    if (!*worth) {
        umb__pack_rewind(t, page_count, UMB__LOWEST_END);
    }
    return UMB_OK;
}

/* Orders the lowest band. If copies of shared nodes cost little, only a sample is visited here, and
 * the pages are made later, step by step. */
static enum umb_status begin_lowest_band(struct umb__pack_ordering *o,
                                         const struct umb_workers *workers)
{
    struct umb__pack_walk *t = &o->walk;
    const uint32_t page_count = t->order->page_count;
    bool worth = false;
    t->alone = true;
    /* If a frustum's root lies below the band's roots, the canonical block names its last copy. */
    t->numbers_roots = !has_roots_below(t->octree, UMB__LOWEST_END - 1);
    UMB__TRY(sample_step(&o->roots) == 1 ? visit_all_with_copies(o, &worth)
                                         : sample_copies(t, &o->roots, workers, &worth));
    worth = worth && !o->never_copies;
    t->order->alone_from = worth ? page_count : UINT32_MAX;
    if (worth) {
        return UMB_OK;
    }
    t->alone = false;
    t->numbers_roots = false;
    o->complete = true;
    return visit_band(t, &o->roots);
}

/* Collects the band's roots: the roots of frusta, and the nodes to which the band above
 * referred. */
static enum umb_status find_roots(struct umb__pack_walk *t, uint32_t band_high,
                                  struct umb__node_list *roots)
{
    for (uint32_t i = 0; i < t->octree->root_count; i++) {
        const struct umb__octree_root *root = &t->octree->roots[i];
        if (root->state == UMB__NODE_MIXED && root->level >= t->band_low &&
            root->level <= band_high) {
            UMB__TRY(
                umb__node_list_add(t, roots, (struct umb__node_ref){root->level, root->index}));
        }
    }
    for (size_t i = 0; i < t->waiting.count; i++) {
        UMB__TRY(umb__node_list_add(t, roots, t->waiting.nodes[i]));
    }
    t->waiting.count = 0;
    return UMB_OK;
}

static enum umb_status visit_bands(struct umb__pack_ordering *o, const struct umb_workers *workers)
{
    struct umb__pack_walk *t = &o->walk;
    uint32_t band_high = UMB_LEVEL_MAX;
    UMB__TRY(allocate(o));
    for (size_t band = 0; band < BAND_COUNT; band++) {
        o->roots.count = 0;
        t->band_low = band_lows[band];
        UMB__TRY(find_roots(t, band_high, &o->roots));
        UMB__TRY(t->band_low == UMB_LEVEL_BRICK ? begin_lowest_band(o, workers)
                                                : visit_band(t, &o->roots));
        band_high = t->band_low - 1;
    }
    return UMB_OK;
}

/* Records for each level the page of every 16th ordinal, and of the last one. */
static enum umb_status make_hints(struct umb__pack_walk *t)
{
    struct umb__pack_order *order = t->order;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        const uint32_t count = t->next[level];
        const size_t hints = count / UMB__PACK_HINT + 2;
        uint32_t page = 0, *hint = umb__alloc(order->alloc, hints, sizeof *hint);
        order->hints[level] = hint;
        if (!hint) {
            return umb__pack_no_memory(t->error);
        }
        for (size_t i = 0; i < hints && count > 0; i++) {
            const size_t hinted = i * UMB__PACK_HINT;
            const size_t ordinal = hinted < count ? hinted : count - 1;
            while (order->begins[level][page + 1] <= ordinal) {
                page++;
            }
            hint[i] = page;
        }
    }
    return UMB_OK;
}

enum umb_status umb__pack_order_begin(const struct umb__octree *octree,
                                      const struct umb_workers *workers, bool never_copies,
                                      struct umb__pack_order *order,
                                      struct umb__pack_ordering **out, struct umb_error *error)
{
    memset(order, 0, sizeof *order);
    order->alloc = octree->alloc;
    order->alone_from = UINT32_MAX;
    struct umb__pack_ordering *o = umb__alloc_zeroed(octree->alloc, 1, sizeof *o);
    *out = o;
    if (!o) {
        return umb__pack_no_memory(error);
    }
    o->alloc = octree->alloc;
    o->never_copies = never_copies;
    UMB__TRY(umb__pack_survey(octree, &o->survey, error));
    memcpy(order->counts, o->survey.counts, sizeof order->counts);
    o->walk = (struct umb__pack_walk){
        .octree = octree, .survey = &o->survey, .order = order, .error = error};
    UMB__TRY(visit_bands(o, workers));
    return o->complete ? make_hints(&o->walk) : UMB_OK;
}

bool umb__pack_order_complete(const struct umb__pack_ordering *o)
{
    return o->complete;
}

/* Returns the most nodes of a level in one independent page. A node takes at least 2 bytes, a page
 * ends when it reaches the target, and the last tree may add all nodes of the level that a tree can
 * have. */
static size_t page_nodes_most(uint32_t level)
{
    return UMB__PAGE_RAW_TARGET / 2 + ((size_t)1 << 3 * (UMB__LOWEST_END - 1 - level));
}

enum umb_status umb__pack_order_reserve(struct umb__pack_ordering *o, uint32_t pages)
{
    struct umb__pack_order *order = o->walk.order;
    bool complete = umb__pack_grow_pages(order, (size_t)order->page_count + pages + 2);
    for (uint32_t level = UMB_LEVEL_BRICK; level < UMB__LOWEST_END && complete; level++) {
        complete = umb__grow(order->alloc, &order->nodes[level], &order->node_capacity[level],
                             o->walk.next[level] + pages * page_nodes_most(level),
                             sizeof *order->nodes[level]);
    }
    return complete ? UMB_OK : umb__pack_no_memory(o->walk.error);
}

enum umb_status umb__pack_order_step(struct umb__pack_ordering *o, uint32_t pages)
{
    const uint32_t left = UINT32_MAX - o->walk.order->page_count;
    const uint32_t most = o->walk.order->page_count + (pages < left ? pages : left);
    UMB__TRY(visit_roots(&o->walk, &o->roots, &o->next_root, most));
    if (o->next_root < o->roots.count) {
        return UMB_OK;
    }
    o->complete = true;
    return make_hints(&o->walk);
}

void umb__pack_ordering_destroy(struct umb__pack_ordering *o)
{
    if (o) {
        const struct umb_alloc *alloc = o->alloc;
        umb__free(alloc, o->roots.nodes);
        umb__pack_walk_finish(&o->walk);
        umb__pack_survey_finish(&o->survey);
        umb__free(alloc, o);
    }
}
