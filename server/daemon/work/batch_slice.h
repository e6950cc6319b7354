/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_BATCH_SLICE_H
#define UMBRAGE_SERVER_DAEMON_WORK_BATCH_SLICE_H
/* Answering one slice of a batch: called by batch.c and pool.c. */
#include "daemon/work/pool.h"

/* Result of a slice. error: valid only on failure. */
struct umbd__slice_result {
    struct umb_query_stats stats;
    uint64_t cpu_ns;
    struct umb_error error;
};

/*
 * Checks and answers points first .. first + count - 1, or does that part of other work.
 * Fails: E_ARGUMENT, naming the index within the whole batch. Threads: disjoint slices at once.
 */
UMB_CHECKED enum umb_status umbd__slice_run(const struct umbd_batch *batch, size_t first,
                                            size_t count, struct umbd__slice_result *result);

/* Sets slice_points so that slices take about equally long, whatever a point costs. Leaves it
 * unchanged if there are no points to answer. */
void umbd__batch_set_slice(struct umbd_batch *batch);

#endif
