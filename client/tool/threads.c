/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Threads for slices, see threads.h. One mutex guards all state: a slice takes tens of microseconds
 * to milliseconds, so the time of a lock for each does not matter.
 */
#include "tool/threads.h"
#include "tool/tool_try.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <unistd.h>

struct worker {
    struct umbu_threads *threads;
    pthread_t thread;
    unsigned number;
};

struct umbu_threads {
    pthread_mutex_t lock;
    pthread_cond_t wake; /* Signals that there are slices to take, or that the threads must end */
    /* Signals that the last slice is done; any slice if the owner waits for one */
    pthread_cond_t idle;
    umbu_slice_fn run;
    void *user;
    uint32_t next, count, done;
    int ending;
    int is_owner_waiting;  /* 1: the owner is in umbu_threads_wait_until */
    unsigned worker_count; /* threads running */
    struct worker workers[];
};

/* Takes and runs one slice. Returns 0 if no slice is left. The caller holds the lock, and holds it
 * again on return. */
static int run_one(struct umbu_threads *threads, unsigned thread)
{
    if (threads->next == threads->count) {
        return 0;
    }
    const uint32_t slice = threads->next++;
    const umbu_slice_fn run = threads->run;
    void *user = threads->user;
    pthread_mutex_unlock(&threads->lock);
    run(user, slice, thread);
    pthread_mutex_lock(&threads->lock);
    threads->done++;
    if (threads->done == threads->count || threads->is_owner_waiting) {
        pthread_cond_signal(&threads->idle);
    }
    return 1;
}

static void *work(void *user)
{
    struct worker *worker = user;
    struct umbu_threads *threads = worker->threads;
    pthread_mutex_lock(&threads->lock);
    while (!threads->ending) {
        if (!run_one(threads, worker->number)) {
            pthread_cond_wait(&threads->wake, &threads->lock);
        }
    }
    pthread_mutex_unlock(&threads->lock);
    return NULL;
}

enum umb_status umbu_threads_create(unsigned count, struct umbu_threads **out,
                                    struct umb_error *error)
{
    *out = NULL;
    struct umbu_threads *threads = calloc(1, sizeof *threads + count * sizeof threads->workers[0]);
    if (threads == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u threads", count);
    }
    pthread_mutex_init(&threads->lock, NULL);
    pthread_cond_init(&threads->wake, NULL);
    pthread_cond_init(&threads->idle, NULL);
    for (unsigned i = 1; i < count; i++) {
        struct worker *worker = &threads->workers[i];
        worker->threads = threads;
        worker->number = i;
        if (pthread_create(&worker->thread, NULL, work, worker) != 0) {
            break; /* fewer threads, same results */
        }
        threads->worker_count = i;
    }
    *out = threads;
    return UMB_OK;
}

void umbu_threads_start(struct umbu_threads *threads, umbu_slice_fn run, void *user, uint32_t count)
{
    pthread_mutex_lock(&threads->lock);
    threads->run = run;
    threads->user = user;
    threads->next = 0;
    threads->done = 0;
    threads->count = count;
    pthread_cond_broadcast(&threads->wake);
    pthread_mutex_unlock(&threads->lock);
}

void umbu_threads_wait(struct umbu_threads *threads, void (*tick)(void *user), void *tick_user)
{
    pthread_mutex_lock(&threads->lock);
    while (run_one(threads, 0)) {
        if (tick != NULL) {
            pthread_mutex_unlock(&threads->lock);
            tick(tick_user);
            pthread_mutex_lock(&threads->lock);
        }
    }
    while (threads->done != threads->count) {
        pthread_cond_wait(&threads->idle, &threads->lock);
    }
    pthread_mutex_unlock(&threads->lock);
}

void umbu_threads_wait_until(struct umbu_threads *threads, int (*is_done)(void *user), void *user)
{
    pthread_mutex_lock(&threads->lock);
    while (!is_done(user) && run_one(threads, 0)) {
    }
    threads->is_owner_waiting = 1;
    while (!is_done(user) && threads->done != threads->count) {
        pthread_cond_wait(&threads->idle, &threads->lock);
    }
    threads->is_owner_waiting = 0;
    pthread_mutex_unlock(&threads->lock);
}

static void run_all(void *user, umbu_slice_fn run, void *run_user, uint32_t count)
{
    umbu_threads_start(user, run, run_user, count);
    umbu_threads_wait(user, NULL, NULL);
}

struct umb_workers umbu_threads_workers(struct umbu_threads *threads)
{
    return (struct umb_workers){threads->worker_count + 1, run_all, threads};
}

void umbu_workers_run(const struct umb_workers *workers, umbu_slice_fn run, void *user,
                      uint32_t count)
{
    if (workers != NULL && workers->count > 1 && count > 1) {
        workers->run(workers->user, run, user, count);
        return;
    }
    for (uint32_t slice = 0; slice < count; slice++) {
        run(user, slice, 0);
    }
}

void umbu_threads_destroy(struct umbu_threads *threads)
{
    if (threads == NULL) {
        return;
    }
    umbu_threads_wait(threads, NULL, NULL);
    pthread_mutex_lock(&threads->lock);
    threads->ending = 1;
    pthread_cond_broadcast(&threads->wake);
    pthread_mutex_unlock(&threads->lock);
    for (unsigned i = 1; i <= threads->worker_count; i++) {
        pthread_join(threads->workers[i].thread, NULL);
    }
    pthread_cond_destroy(&threads->idle);
    pthread_cond_destroy(&threads->wake);
    pthread_mutex_destroy(&threads->lock);
    free(threads);
}

struct range {
    size_t count, block;
    umbu_block_fn fn;
    void *user;
    atomic_size_t next;
    pthread_mutex_t lock; /* guards status and error */
    atomic_int failed;
    enum umb_status status; /* first failure */
    struct umb_error error;
};

/* Takes blocks until none is left or one has failed. */
static void run_blocks(void *user, uint32_t slice, unsigned thread)
{
    struct range *range = user;
    (void)slice;
    (void)thread;
    while (!atomic_load(&range->failed)) {
        const size_t first = atomic_fetch_add(&range->next, range->block);
        if (first >= range->count) {
            return;
        }
        const size_t left = range->count - first;
        struct umb_error error = {0};
        const enum umb_status status =
            range->fn(range->user, first, left < range->block ? left : range->block, &error);
        if (status != UMB_OK) {
            pthread_mutex_lock(&range->lock);
            if (!atomic_load(&range->failed)) {
                range->status = status;
                range->error = error;
                atomic_store(&range->failed, 1);
            }
            pthread_mutex_unlock(&range->lock);
        }
    }
}

enum umb_status umbu_range_run(unsigned threads, size_t count, size_t block, umbu_block_fn fn,
                               void *user, struct umb_error *error)
{
    struct range range = {.count = count, .block = block > 0 ? block : 1, .fn = fn, .user = user};
    struct umbu_threads *crew;
    const size_t blocks = count / range.block + (count % range.block != 0);
    unsigned wanted = threads < UMBU_THREADS_MAX ? threads : UMBU_THREADS_MAX;
    wanted = wanted < blocks ? wanted : (unsigned)blocks;
    wanted = wanted > 0 ? wanted : 1;
    UMB__TRY(umbu_threads_create(wanted, &crew, error));
    pthread_mutex_init(&range.lock, NULL);
    umbu_threads_start(crew, run_blocks, &range, wanted);
    umbu_threads_destroy(crew);
    pthread_mutex_destroy(&range.lock);
    if (range.status != UMB_OK && error != NULL) {
        *error = range.error;
    }
    return range.status;
}

struct items {
    umbu_item_fn fn;
    void *user;
};

static enum umb_status run_items(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct items *items = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        items->fn(items->user, i);
    }
    return UMB_OK;
}

enum umb_status umbu_range_each(unsigned threads, size_t count, size_t block, umbu_item_fn fn,
                                void *user, struct umb_error *error)
{
    struct items items = {fn, user};
    return umbu_range_run(threads, count, block, run_items, &items, error);
}

unsigned umbu_processor_count(void)
{
    const long count = sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1U : count > UMBU_THREADS_MAX ? (unsigned)UMBU_THREADS_MAX : (unsigned)count;
}
