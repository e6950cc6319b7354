/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Decides whether copies in the lowest band are worth their bytes, by a sample of the band's roots.
 *
 * Each run of neighbouring roots is measured by itself, so helpers share the runs, each on a walk
 * of its own. Only where frusta are so small that their roots are in the lowest band may one tree
 * be part of another. Then one walk visits all runs in order.
 */
#include "format/pack_walk.h"

#include <string.h>

#include "base/memory.h"

/* Largest bytes of the lowest band with copies, in fifths of the bytes of the band's nodes without
 * copies. At this limit the file is about a quarter larger (docs/results/paging.md), since copies
 * save references, which take many bytes. */
#define COPIES_MAX_FIFTHS 12U
#define SAMPLE_ROOTS      16384U /* Roots of a sample, at least; a few more are possible */
#define SAMPLE_RUN        64U    /* Neighbouring roots of each run */

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

bool umb__pack_copies_asks_all(const struct umb__node_list *roots)
{
    return sample_step(roots) == 1;
}

uint64_t umb__pack_copies_most(const struct umb__pack_survey *survey,
                               const struct umb__node_list *roots, uint64_t asked)
{
    uint64_t own_bytes = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level < UMB__LOWEST_END; level++) {
        own_bytes += survey->bytes[level];
    }
    /* No product overflows: at most 2^40 bytes and 2^15 roots. */
    return roots->count == 0 ? 0 : COPIES_MAX_FIFTHS * own_bytes * asked / (5 * roots->count);
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
    bool complete = umb__pack_walk_begin(&sampler->walk, UMB_LEVEL_BRICK, UMB__LOWEST_END - 1) &&
                    umb__pack_grow_pages(&sampler->order, 1);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        sampler->order.begins[level][0] = 0;
    }
    return complete ? UMB_OK : UMB_E_NO_MEMORY;
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

/* Visits a sampler's runs of a round. */
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

/* Returns true if certainly no root of the lowest band is below or equal to another. */
static bool roots_are_apart(const struct umb__octree *octree)
{
    bool apart = true;
    for (uint32_t i = 0; i < octree->root_count; i++) {
        apart = apart && (octree->roots[i].state != UMB__NODE_MIXED ||
                          octree->roots[i].level >= UMB__LOWEST_END);
    }
    return apart;
}

enum umb_status umb__pack_copies(const struct umb__pack_walk *walk,
                                 const struct umb__node_list *roots,
                                 const struct umb_workers *workers, bool *worth)
{
    const struct umb_alloc *alloc = walk->order->alloc;
    workers = roots_are_apart(walk->octree) ? workers : NULL;
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
    const uint64_t most = umb__pack_copies_most(walk->survey, roots, asked);
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
    return status == UMB_OK
               ? UMB_OK
               : umb_fail(walk->error, status, "packing: no memory for a sample of the pages");
}
