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
 * Fairness: the next request is that of the owner with the fewest running requests. If several
 * owners have equally few, the owner served last comes last. If there are several threads, one
 * owner never has all of them. So one owner's large bundles, or many lists, do not delay other
 * owners.
 *
 * Order: requests of one upload run one after the other, because each is posted when the previous
 * one is done. Requests of different calls have no order.
 */
#include <stdatomic.h>
#include <sys/queue.h>
#include "umbrage/status.h"

struct umbj_service;
struct umbj_file_threads; /* opaque */

/* A request to the job service. `files` is called on a thread for files, then `run` on the
 * service's own thread, then `done`. `files` and `run` may be NULL. From `done` on the request is
 * the sender's again. When the service ends, `done` is called without `run`, or without both;
 * `skipped` is then set. */
struct umbj_request {
    STAILQ_ENTRY(umbj_request) next;
    void (*files)(struct umbj_request *request);
    void (*run)(struct umbj_request *request, struct umbj_service *service);
    void (*done)(struct umbj_request *request);
    const char *owner; /* Owner of the files: owners share the threads fairly. Lives until done */
    int reads;         /* 1 if `files` reads the table instead, on a separate thread */
    int skipped;
};

/* Requests in their order. */
STAILQ_HEAD(umbj_request_queue, umbj_request);

/* Calls request->done of a request that was not run. */
void umbj_request_skip(struct umbj_request *request);

/* Creates the threads. In: then: called after `files` of each request, on the same thread, without
 * a lock. Fails: E_NO_MEMORY, E_LIMIT (no thread). */
UMB_CHECKED enum umb_status umbj_file_threads_create(
    unsigned count, void (*then)(struct umbj_service *service, struct umbj_request *request),
    struct umbj_service *service, struct umbj_file_threads **out, struct umb_error *error);

/* Any thread. After the end the request is skipped at once. */
void umbj_file_threads_post(struct umbj_file_threads *threads, struct umbj_request *request);

/* Flag that is 1 after the end: long work polls it and stops. */
const atomic_int *umbj_file_threads_stop(const struct umbj_file_threads *threads);

/* Stops the work, skips waiting requests and joins the threads. Later posts are skipped. */
void umbj_file_threads_end(struct umbj_file_threads *threads);

/* Ends the threads if they run. NULL is allowed. */
void umbj_file_threads_destroy(struct umbj_file_threads *threads);

#endif
