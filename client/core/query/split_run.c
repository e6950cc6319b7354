/* SPDX-License-Identifier: Apache-2.0 */
/* Splits a batch: into slices that several threads answer at once, and into blocks for several
 * lights; see umbrage/query.h. */
#include "query/stages.h"

/*
 * A slice takes about 0.2 to 0.5 ms. That is long compared with the time to hand it to a thread,
 * and short enough that the threads do not wait long for the last slice. The number of points is a
 * multiple of 512, so that answers fill whole cache lines in every format.
 */
#define SLICE_POINTS 8192U

/* Number of points in a block for several lights. Their 12 KiB of doubles and 6 KiB of normals stay
 * in half of an L1 cache. */
#define BLOCK 512U

size_t umb_query_slice(const struct umb_query *query)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    const size_t own = umb__filter_of(q.filter)->slice;
    const int32_t taps = q.taps;
    return own > 0     ? own
           : taps <= 5 ? SLICE_POINTS
           : taps <= 9 ? SLICE_POINTS / 2
                       : SLICE_POINTS / 4;
}

struct split {
    const struct umb_query *query;
    const struct umb_points *points;
    size_t slice;
    struct umb_answers *answers;
};

static void add(uint64_t *to, uint64_t more)
{
    (void)__atomic_fetch_add(to, more, __ATOMIC_RELAXED);
}

/* Adds up counters that all threads share; called once a slice. */
static void add_stats(struct umb_query_stats *to, const struct umb_query_stats *from)
{
    add(&to->points, from->points);
    add(&to->outside, from->outside);
    add(&to->before, from->before);
    add(&to->behind, from->behind);
    add(&to->facing_away, from->facing_away);
    add(&to->undefined, from->undefined);
    add(&to->nodes, from->nodes);
    add(&to->bricks, from->bricks);
}

static void run_slice(void *user, uint32_t number, unsigned worker)
{
    const struct split *split = user;
    size_t first = number * split->slice, left = split->points->count - first;
    struct umb_answers own = {.values = split->answers->values};
    (void)worker;
    umb_query_run(split->query, split->points, first, left < split->slice ? left : split->slice,
                  &own);
    add_stats(&split->answers->stats, &own.stats);
}

void umb_query_run_split(const struct umb_query *query, const struct umb_points *points,
                         const struct umb_workers *workers, struct umb_answers *answers)
{
    struct split split = {query, points, umb_query_slice(query), answers};
    size_t slices = points->count / split.slice + (points->count % split.slice != 0);
    if (slices < 2 || slices > UINT32_MAX) {
        umb_query_run(query, points, 0, points->count, answers);
    } else {
        workers->run(workers->user, run_slice, &split, (uint32_t)slices);
    }
}

void umb_query_run_lights(const struct umb_query *queries, size_t query_count,
                          const struct umb_points *points, size_t first, size_t count,
                          struct umb_light_answers *answers)
{
    for (size_t done = 0; done < count; done += BLOCK) {
        size_t block = count - done < BLOCK ? count - done : BLOCK;
        for (size_t k = 0; k < query_count; k++) {
            struct umb_answers one = {.values = answers->values[k], .stats = answers->stats[k]};
            umb_query_run(&queries[k], points, first + done, block, &one);
            answers->stats[k] = one.stats;
        }
    }
}
