/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One mutex guards everything; a job is tens of microseconds to milliseconds of work, so that
 * taking a lock for each does not show.
 */
#include "bake/build/slice_pool.h"

#include <pthread.h>
#include <stdlib.h>

struct worker {
    struct umbb_slice_pool *jobs;
    pthread_t thread;
    unsigned number;
};

struct umbb_slice_pool {
    pthread_mutex_t lock;
    pthread_cond_t wake; /* jobs to take, or the end */
    pthread_cond_t idle; /* the last job is done, or any while the owner waits for one of them */
    umbb_slice_fn run;
    void *user;
    uint32_t next, count, done;
    int ending;
    int is_owner_waiting;  /* for what some job does */
    unsigned worker_count; /* threads running */
    struct worker workers[];
};

/* Takes and runs one job; 0 if none is left. Called and returns with the lock held. */
static int run_one(struct umbb_slice_pool *jobs, unsigned thread)
{
    if (jobs->next == jobs->count) {
        return 0;
    }
    const uint32_t job = jobs->next++;
    const umbb_slice_fn run = jobs->run;
    void *user = jobs->user;
    pthread_mutex_unlock(&jobs->lock);
    run(user, job, thread);
    pthread_mutex_lock(&jobs->lock);
    jobs->done++;
    if (jobs->done == jobs->count || jobs->is_owner_waiting) {
        pthread_cond_signal(&jobs->idle);
    }
    return 1;
}

static void *work(void *user)
{
    struct worker *worker = user;
    struct umbb_slice_pool *jobs = worker->jobs;
    pthread_mutex_lock(&jobs->lock);
    while (!jobs->ending) {
        if (!run_one(jobs, worker->number)) {
            pthread_cond_wait(&jobs->wake, &jobs->lock);
        }
    }
    pthread_mutex_unlock(&jobs->lock);
    return NULL;
}

enum umb_status umbb_slice_pool_create(unsigned threads, struct umbb_slice_pool **out,
                                       struct umb_error *error)
{
    *out = NULL;
    struct umbb_slice_pool *jobs = calloc(1, sizeof *jobs + threads * sizeof jobs->workers[0]);
    if (jobs == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "threads: memory for %u refused", threads);
    }
    pthread_mutex_init(&jobs->lock, NULL);
    pthread_cond_init(&jobs->wake, NULL);
    pthread_cond_init(&jobs->idle, NULL);
    for (unsigned i = 1; i < threads; i++) {
        struct worker *worker = &jobs->workers[i];
        worker->jobs = jobs;
        worker->number = i;
        if (pthread_create(&worker->thread, NULL, work, worker) != 0) {
            break; /* fewer threads, same results */
        }
        jobs->worker_count = i;
    }
    *out = jobs;
    return UMB_OK;
}

void umbb_slice_pool_start(struct umbb_slice_pool *jobs, umbb_slice_fn run, void *user,
                           uint32_t count)
{
    pthread_mutex_lock(&jobs->lock);
    jobs->run = run;
    jobs->user = user;
    jobs->next = 0;
    jobs->done = 0;
    jobs->count = count;
    pthread_cond_broadcast(&jobs->wake);
    pthread_mutex_unlock(&jobs->lock);
}

void umbb_slice_pool_wait(struct umbb_slice_pool *jobs, umbb_slice_pool_tick_fn tick,
                          void *tick_user)
{
    pthread_mutex_lock(&jobs->lock);
    while (run_one(jobs, 0)) {
        if (tick != NULL) {
            pthread_mutex_unlock(&jobs->lock);
            tick(tick_user);
            pthread_mutex_lock(&jobs->lock);
        }
    }
    while (jobs->done != jobs->count) {
        pthread_cond_wait(&jobs->idle, &jobs->lock);
    }
    pthread_mutex_unlock(&jobs->lock);
}

void umbb_slice_pool_wait_until(struct umbb_slice_pool *jobs, int (*is_done)(void *user),
                                void *user)
{
    pthread_mutex_lock(&jobs->lock);
    while (!is_done(user) && run_one(jobs, 0)) {
    }
    jobs->is_owner_waiting = 1;
    while (!is_done(user) && jobs->done != jobs->count) {
        pthread_cond_wait(&jobs->idle, &jobs->lock);
    }
    jobs->is_owner_waiting = 0;
    pthread_mutex_unlock(&jobs->lock);
}

static void run_all(void *user, umbb_slice_fn job, void *job_user, uint32_t count)
{
    umbb_slice_pool_start(user, job, job_user, count);
    umbb_slice_pool_wait(user, NULL, NULL);
}

struct umb_workers umbb_slice_pool_workers(struct umbb_slice_pool *jobs)
{
    return (struct umb_workers){jobs->worker_count + 1, run_all, jobs};
}

void umbb_workers_run(const struct umb_workers *workers, umbb_slice_fn run, void *user,
                      uint32_t count)
{
    if (workers != NULL && workers->count > 1 && count > 1) {
        workers->run(workers->user, run, user, count);
        return;
    }
    for (uint32_t job = 0; job < count; job++) {
        run(user, job, 0);
    }
}

void umbb_slice_pool_destroy(struct umbb_slice_pool *jobs)
{
    if (jobs == NULL) {
        return;
    }
    umbb_slice_pool_wait(jobs, NULL, NULL);
    pthread_mutex_lock(&jobs->lock);
    jobs->ending = 1;
    pthread_cond_broadcast(&jobs->wake);
    pthread_mutex_unlock(&jobs->lock);
    for (unsigned i = 1; i <= jobs->worker_count; i++) {
        pthread_join(jobs->workers[i].thread, NULL);
    }
    pthread_cond_destroy(&jobs->idle);
    pthread_cond_destroy(&jobs->wake);
    pthread_mutex_destroy(&jobs->lock);
    free(jobs);
}
