/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One mutex guards everything. A slice is tens of microseconds to milliseconds of work, so the cost
 * of a lock for each is negligible.
 */
#include "bake/build/slice_pool.h"

#include <pthread.h>
#include <stdlib.h>

struct worker {
    struct umbb_slice_pool *pool;
    pthread_t thread;
    unsigned number;
};

struct umbb_slice_pool {
    pthread_mutex_t lock;
    pthread_cond_t wake; /* slices are waiting, or the pool ends */
    /* The last slice is done, or any slice while the owner waits for one of them. */
    pthread_cond_t idle;
    umbb_slice_fn run;
    void *user;
    uint32_t next, count, done;
    int ending;
    int is_owner_waiting;  /* 1 while the owner waits for the result of a slice */
    unsigned worker_count; /* number of running threads */
    struct worker workers[];
};

/* Takes and runs one slice; 0 if none is left. Called and returns with the lock held. */
static int run_one(struct umbb_slice_pool *pool, unsigned thread)
{
    if (pool->next == pool->count) {
        return 0;
    }
    const uint32_t slice = pool->next++;
    const umbb_slice_fn run = pool->run;
    void *user = pool->user;
    pthread_mutex_unlock(&pool->lock);
    run(user, slice, thread);
    pthread_mutex_lock(&pool->lock);
    pool->done++;
    if (pool->done == pool->count || pool->is_owner_waiting) {
        pthread_cond_signal(&pool->idle);
    }
    return 1;
}

static void *work(void *user)
{
    struct worker *worker = user;
    struct umbb_slice_pool *pool = worker->pool;
    pthread_mutex_lock(&pool->lock);
    while (!pool->ending) {
        if (!run_one(pool, worker->number)) {
            pthread_cond_wait(&pool->wake, &pool->lock);
        }
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

enum umb_status umbb_slice_pool_create(unsigned threads, struct umbb_slice_pool **out,
                                       struct umb_error *error)
{
    *out = NULL;
    struct umbb_slice_pool *pool = calloc(1, sizeof *pool + threads * sizeof pool->workers[0]);
    if (pool == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "threads: memory for %u refused", threads);
    }
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->wake, NULL);
    pthread_cond_init(&pool->idle, NULL);
    for (unsigned i = 1; i < threads; i++) {
        struct worker *worker = &pool->workers[i];
        worker->pool = pool;
        worker->number = i;
        if (pthread_create(&worker->thread, NULL, work, worker) != 0) {
            break; /* fewer threads, same results */
        }
        pool->worker_count = i;
    }
    *out = pool;
    return UMB_OK;
}

void umbb_slice_pool_start(struct umbb_slice_pool *pool, umbb_slice_fn run, void *user,
                           uint32_t count)
{
    pthread_mutex_lock(&pool->lock);
    pool->run = run;
    pool->user = user;
    pool->next = 0;
    pool->done = 0;
    pool->count = count;
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->lock);
}

void umbb_slice_pool_wait(struct umbb_slice_pool *pool, umbb_slice_pool_tick_fn tick,
                          void *tick_user)
{
    pthread_mutex_lock(&pool->lock);
    while (run_one(pool, 0)) {
        if (tick != NULL) {
            pthread_mutex_unlock(&pool->lock);
            tick(tick_user);
            pthread_mutex_lock(&pool->lock);
        }
    }
    while (pool->done != pool->count) {
        pthread_cond_wait(&pool->idle, &pool->lock);
    }
    pthread_mutex_unlock(&pool->lock);
}

void umbb_slice_pool_wait_until(struct umbb_slice_pool *pool, int (*is_done)(void *user),
                                void *user)
{
    pthread_mutex_lock(&pool->lock);
    while (!is_done(user) && run_one(pool, 0)) {
    }
    pool->is_owner_waiting = 1;
    while (!is_done(user) && pool->done != pool->count) {
        pthread_cond_wait(&pool->idle, &pool->lock);
    }
    pool->is_owner_waiting = 0;
    pthread_mutex_unlock(&pool->lock);
}

static void run_all(void *user, umbb_slice_fn slice, void *job_user, uint32_t count)
{
    umbb_slice_pool_start(user, slice, job_user, count);
    umbb_slice_pool_wait(user, NULL, NULL);
}

struct umb_workers umbb_slice_pool_workers(struct umbb_slice_pool *pool)
{
    return (struct umb_workers){pool->worker_count + 1, run_all, pool};
}

void umbb_workers_run(const struct umb_workers *workers, umbb_slice_fn run, void *user,
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

void umbb_slice_pool_destroy(struct umbb_slice_pool *pool)
{
    if (pool == NULL) {
        return;
    }
    umbb_slice_pool_wait(pool, NULL, NULL);
    pthread_mutex_lock(&pool->lock);
    pool->ending = 1;
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->lock);
    for (unsigned i = 1; i <= pool->worker_count; i++) {
        pthread_join(pool->workers[i].thread, NULL);
    }
    pthread_cond_destroy(&pool->idle);
    pthread_cond_destroy(&pool->wake);
    pthread_mutex_destroy(&pool->lock);
    free(pool);
}
