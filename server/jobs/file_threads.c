/* SPDX-License-Identifier: Apache-2.0 */
/* Threads for file work, see file_threads.h. */
#include "jobs/file_threads.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "jobs/job.h"

struct file_thread {
    struct umbj_file_threads *home;
    pthread_t thread;
    const char *owner; /* Owner of its current request, NULL = idle; under the mutex */
};

struct umbj_file_threads {
    void (*then)(struct umbj_service *service, struct umbj_request *request);
    struct umbj_service *service;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    struct umbj_request_queue queue; /* Waiting requests; under mutex */
    atomic_int stop;
    char served[UMBJ_OWNER_SIZE]; /* Owner of the request taken last; under mutex */
    unsigned count, running;      /* Number of threads, wanted and started */
    struct file_thread list[];
};

void umbj_request_skip(struct umbj_request *request)
{
    request->skipped = 1;
    request->done(request);
}

/* Number of an owner's requests that run. */
static unsigned at_work_for(const struct umbj_file_threads *threads, const char *owner)
{
    unsigned count = 0;
    for (unsigned i = 0; i < threads->running; i++) {
        const char *at = threads->list[i].owner;
        count += at != NULL && strcmp(at, owner) == 0;
    }
    return count;
}

/* Takes a request from the queue: the first one of the owner with the fewest running requests. If
 * several owners have equally few, the owner served last comes last. Returns NULL if the queue is
 * empty or all its owners have their share of the threads. */
static struct umbj_request *take_fairest(struct umbj_file_threads *threads)
{
    struct umbj_request *best = NULL, *at;
    unsigned fewest = 2 * (threads->count > 1 ? threads->count - 1 : 1);
    for (at = STAILQ_FIRST(&threads->queue); at != NULL; at = STAILQ_NEXT(at, next)) {
        const unsigned busy =
            2 * at_work_for(threads, at->owner) + (strcmp(threads->served, at->owner) == 0);
        if (busy < fewest) {
            fewest = busy;
            best = at;
        }
    }
    if (best != NULL) {
        STAILQ_REMOVE(&threads->queue, best, umbj_request, next);
        (void)snprintf(threads->served, sizeof threads->served, "%s", best->owner);
    }
    return best;
}

static void *run_thread(void *user)
{
    struct file_thread *thread = user;
    struct umbj_file_threads *threads = thread->home;
    pthread_mutex_lock(&threads->mutex);
    while (!atomic_load(&threads->stop)) {
        struct umbj_request *request = take_fairest(threads);
        if (request == NULL) {
            pthread_cond_wait(&threads->wake, &threads->mutex);
            continue;
        }
        thread->owner = request->owner;
        pthread_mutex_unlock(&threads->mutex);
        request->files(request);
        pthread_mutex_lock(&threads->mutex);
        thread->owner = NULL;
        pthread_cond_signal(&threads->wake); /* another request of this owner may go on */
        pthread_mutex_unlock(&threads->mutex);
        threads->then(threads->service, request);
        pthread_mutex_lock(&threads->mutex);
    }
    pthread_mutex_unlock(&threads->mutex);
    return NULL;
}

enum umb_status umbj_file_threads_create(
    unsigned count, void (*then)(struct umbj_service *service, struct umbj_request *request),
    struct umbj_service *service, struct umbj_file_threads **out, struct umb_error *error)
{
    *out = NULL;
    struct umbj_file_threads *threads =
        calloc(1, sizeof *threads + count * sizeof threads->list[0]);
    if (threads == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the file threads");
    }
    threads->then = then;
    threads->service = service;
    threads->count = count;
    STAILQ_INIT(&threads->queue);
    pthread_mutex_init(&threads->mutex, NULL);
    pthread_cond_init(&threads->wake, NULL);
    for (unsigned i = 0; i < count; i++) {
        threads->list[i] = (struct file_thread){.home = threads};
        const int code =
            pthread_create(&threads->list[i].thread, NULL, run_thread, &threads->list[i]);
        if (code != 0) {
            umbj_file_threads_destroy(threads);
            return umb_fail_errno(error, UMB_E_LIMIT, code, "no thread for the files of jobs");
        }
        pthread_mutex_lock(&threads->mutex);
        threads->running++;
        pthread_mutex_unlock(&threads->mutex);
    }
    *out = threads;
    return UMB_OK;
}

void umbj_file_threads_post(struct umbj_file_threads *threads, struct umbj_request *request)
{
    pthread_mutex_lock(&threads->mutex);
    const int stopped = atomic_load(&threads->stop);
    if (!stopped) {
        request->skipped = 0;
        STAILQ_INSERT_TAIL(&threads->queue, request, next);
        pthread_cond_signal(&threads->wake);
    }
    pthread_mutex_unlock(&threads->mutex);
    if (stopped) {
        umbj_request_skip(request);
    }
}

const atomic_int *umbj_file_threads_stop(const struct umbj_file_threads *threads)
{
    return &threads->stop;
}

void umbj_file_threads_end(struct umbj_file_threads *threads)
{
    pthread_mutex_lock(&threads->mutex);
    atomic_store(&threads->stop, 1);
    pthread_cond_broadcast(&threads->wake);
    pthread_mutex_unlock(&threads->mutex);
    for (unsigned i = 0; i < threads->running; i++) {
        pthread_join(threads->list[i].thread, NULL);
    }
    threads->running = 0;
    struct umbj_request *request;
    while ((request = STAILQ_FIRST(&threads->queue)) != NULL) {
        STAILQ_REMOVE_HEAD(&threads->queue, next);
        umbj_request_skip(request);
    }
}

void umbj_file_threads_destroy(struct umbj_file_threads *threads)
{
    if (threads != NULL) {
        umbj_file_threads_end(threads);
        pthread_cond_destroy(&threads->wake);
        pthread_mutex_destroy(&threads->mutex);
        free(threads);
    }
}
