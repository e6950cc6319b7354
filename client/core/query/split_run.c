/* SPDX-License-Identifier: Apache-2.0 */
/* Splits a batch into slices that several threads answer at once; see umbrage/query.h. */
#include "query/query_parts.h"

/*
 * Slices take some 0.2 to 0.5 ms each: long compared with handing one out, short compared with the
 * wait for the last. All are multiples of 512 points, whose answers fill whole cache lines in every
 * format.
 */
#define SLICE_POINTS 8192U
#define WIDE_POINTS  512U /* penumbras of 0.3 to 5 us each, footprints of up to 4 */

void umb_query_stats_add(struct umb_query_stats *to, const struct umb_query_stats *from)
{
    to->points += from->points;
    to->outside += from->outside;
    to->before += from->before;
    to->behind += from->behind;
    to->facing_away += from->facing_away;
    to->undefined += from->undefined;
    to->nodes += from->nodes;
    to->bricks += from->bricks;
}

size_t umb_query_slice(const struct umb_query *query)
{
    uint32_t taps = umb_query_taps(query);
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    if (q.filter == UMB_FILTER_PENUMBRA || q.filter == UMB_FILTER_FOOTPRINT) {
        return WIDE_POINTS;
    }
    return taps <= 5 ? SLICE_POINTS : taps <= 9 ? SLICE_POINTS / 2 : SLICE_POINTS / 4;
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

/* Threads synchronise here, once a slice. */
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
