/* SPDX-License-Identifier: Apache-2.0 */
/* Durations in buckets, see load_histogram.h. */
#include "load/load_histogram.h"

#include <math.h>
#include <stddef.h>

#define EXACT     256 /* each value below has a bucket */
#define CUTS      128 /* buckets of a power of two */
#define CUTS_LOG2 7

static unsigned log2_floor(uint64_t value)
{
    unsigned bits = 0;
    while (value >>= 1) {
        bits++;
    }
    return bits;
}

/* Returns the number of a value's bucket. The value's 8 leading bits choose it, which gives 128
 * buckets for each power of two. */
static size_t bucket_of(uint64_t ns)
{
    if (ns < EXACT) {
        return (size_t)ns;
    }
    unsigned shift = log2_floor(ns) - CUTS_LOG2;
    return (size_t)shift * CUTS + (size_t)(ns >> shift);
}

static uint64_t upper_edge(size_t bucket)
{
    if (bucket < EXACT) {
        return bucket;
    }
    unsigned shift = (unsigned)(bucket / CUTS) - 1;
    uint64_t leading = bucket - (uint64_t)shift * CUTS;
    return ((leading + 1) << shift) - 1;
}

void umbc_histogram_record(struct umbc_histogram *histogram, uint64_t ns)
{
    ns = ns > UMBC_HISTOGRAM_MAX_NS ? UMBC_HISTOGRAM_MAX_NS : ns;
    histogram->min_ns = histogram->count == 0 || ns < histogram->min_ns ? ns : histogram->min_ns;
    histogram->max_ns = ns > histogram->max_ns ? ns : histogram->max_ns;
    histogram->count++;
    histogram->sum_ns += (double)ns;
    histogram->buckets[bucket_of(ns)]++;
}

void umbc_histogram_merge(struct umbc_histogram *sum, const struct umbc_histogram *part)
{
    if (part->count == 0) {
        return;
    }
    sum->min_ns = sum->count == 0 || part->min_ns < sum->min_ns ? part->min_ns : sum->min_ns;
    sum->max_ns = part->max_ns > sum->max_ns ? part->max_ns : sum->max_ns;
    sum->count += part->count;
    sum->sum_ns += part->sum_ns;
    for (size_t i = 0; i < UMBC_HISTOGRAM_BUCKETS; i++) {
        sum->buckets[i] += part->buckets[i];
    }
}

uint64_t umbc_histogram_percentile(const struct umbc_histogram *histogram, double share)
{
    uint64_t rank = (uint64_t)ceil(share * (double)histogram->count);
    uint64_t seen = 0;
    rank = rank == 0 ? 1 : rank;
    for (size_t i = 0; i < UMBC_HISTOGRAM_BUCKETS; i++) {
        seen += histogram->buckets[i];
        if (seen >= rank) {
            uint64_t edge = upper_edge(i);
            return edge < histogram->max_ns ? edge : histogram->max_ns;
        }
    }
    return histogram->max_ns;
}

double umbc_histogram_mean(const struct umbc_histogram *histogram)
{
    return histogram->count == 0 ? 0 : histogram->sum_ns / (double)histogram->count;
}
