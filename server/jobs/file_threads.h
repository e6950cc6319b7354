/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_FILE_THREADS_H
#define UMBRAGE_SERVER_JOBS_FILE_THREADS_H
/*
 * Threads for the file work of calls. They check, write, sync and remove bundles, so the service's
 * thread waits only for its table.
 *
 *     umbj_file_threads_create(count, service, &threads, &error);
 *     umbj_file_threads_post(threads, &request);     request.files is called on one of them
 *     umbj_file_threads_end(threads);                waiting requests are skipped
 *     umbj_file_threads_destroy(threads);
 *
 * Fairness: the next request is that of the owner with the fewest running requests; of several such
 * owners, not the one served last. If there are several threads, one owner never has all of them.
 * So one owner's large bundles, or many lists, do not delay other owners.
 *
 * Order: requests of one upload follow each other, because the next is posted when the one before
 * is done. Requests of different calls have no order.
 */
#include "jobs/service.h"

struct umbj_file_threads; /* opaque */

/* Fails: E_NO_MEMORY, E_LIMIT (no thread). */
UMB_CHECKED enum umb_status umbj_file_threads_create(unsigned count, struct umbj_service *service,
                                                     struct umbj_file_threads **out,
                                                     struct umb_error *error);

/* Any thread. After the end the request is skipped at once. */
void umbj_file_threads_post(struct umbj_file_threads *threads, struct umbj_request *request);

/* Flag that is 1 after the end: long work polls it and stops. */
const atomic_int *umbj_file_threads_stop(const struct umbj_file_threads *threads);

/* Stops the work, skips waiting requests, joins the threads. Later posts are skipped. */
void umbj_file_threads_end(struct umbj_file_threads *threads);

/* Ends the threads if they run. NULL is allowed. */
void umbj_file_threads_destroy(struct umbj_file_threads *threads);

#endif
