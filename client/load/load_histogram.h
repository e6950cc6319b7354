/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_HISTOGRAM_H
#define UMBRAGE_LOAD_LOAD_HISTOGRAM_H
/*
 * Histogram of durations. The width of a bucket grows with its value, so high percentiles need no
 * more memory than the median.
 *
 * Below 256 ns each nanosecond has a bucket; above, each power of two has 128. A percentile is the
 * upper edge of its bucket: never too small, and too large by less than 1/128 (0.8 %). A longer
 * duration than UMBC_HISTOGRAM_MAX_NS counts as UMBC_HISTOGRAM_MAX_NS.
 * Memory: zeroed memory is an empty histogram. No allocation. One owner at a time.
 * Source: the layout of G. Tene's HdrHistogram.
 */
#include <stdint.h>

#define UMBC_HISTOGRAM_MAX_NS  (((uint64_t)1 << 42) - 1) /* 73 minutes */
#define UMBC_HISTOGRAM_BUCKETS (256 + 34 * 128)

struct umbc_histogram {
    uint64_t count;
    uint64_t min_ns, max_ns; /* shortest and longest duration; 0 while empty */
    double sum_ns;
    uint64_t buckets[UMBC_HISTOGRAM_BUCKETS];
};

void umbc_histogram_record(struct umbc_histogram *histogram, uint64_t ns);
void umbc_histogram_merge(struct umbc_histogram *sum, const struct umbc_histogram *part);

/* Returns the value that `share` (0..1) of the records do not exceed; 0 without records. */
uint64_t umbc_histogram_percentile(const struct umbc_histogram *histogram, double share);

/* Mean in nanoseconds; 0 if there are no records. */
double umbc_histogram_mean(const struct umbc_histogram *histogram);

#endif
