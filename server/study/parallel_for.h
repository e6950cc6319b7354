/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_PARALLEL_FOR_H
#define UMBRAGE_SERVER_STUDY_PARALLEL_FOR_H
/*
 * A loop over blocks of an index range on several threads. The calling thread takes part, so the
 * work is done even if no other thread can be started. Results do not depend on the thread count
 * as long as blocks write to disjoint places.
 */
#include <stddef.h>
#include "umbrage/status.h"

/* Does items first .. first + count - 1. */
typedef enum umb_status (*umbt_block_fn)(void *user, size_t first, size_t count,
                                         struct umb_error *error);

/*
 * Runs fn over 0..count-1 in blocks of at most `block` items (at least 1).
 *
 * In:    threads: at most this many, 1..256.
 * Fails: with the first failure of fn; blocks that had not started then are left out.
 */
UMB_CHECKED enum umb_status umbt_parallel_for(unsigned threads, size_t count, size_t block,
                                              umbt_block_fn fn, void *user,
                                              struct umb_error *error);

/* Number of processors this process may use, 1..256. */
unsigned umbt_processor_count(void);

#endif
