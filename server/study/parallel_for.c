/* SPDX-License-Identifier: Apache-2.0 */
/* A loop over blocks: threads draw block numbers from one counter under a mutex. */
#include "study/parallel_for.h"

#include <pthread.h>
#include <string.h>
#include <unistd.h>

#define THREADS_MAX 256

struct loop {
    pthread_mutex_t mutex;
    size_t next, count, block; /* next: under mutex */
    umbt_block_fn fn;
    void *user;
    enum umb_status status; /* under mutex: first failure */
    struct umb_error error;
};

/* Draws the next block; returns its item count, 0 if none is left or one has failed. */
static size_t block_draw(struct loop *loop, size_t *first)
{
    size_t count = 0;
    pthread_mutex_lock(&loop->mutex);
    if (loop->status == UMB_OK && loop->next < loop->count) {
        const size_t left = loop->count - loop->next;
        count = left < loop->block ? left : loop->block;
        *first = loop->next;
        loop->next += count;
    }
    pthread_mutex_unlock(&loop->mutex);
    return count;
}

static void *worker(void *user)
{
    struct loop *loop = user;
    size_t first = 0;
    for (size_t count; (count = block_draw(loop, &first)) > 0;) {
        struct umb_error error = {0};
        const enum umb_status status = loop->fn(loop->user, first, count, &error);
        if (status != UMB_OK) {
            pthread_mutex_lock(&loop->mutex);
            if (loop->status == UMB_OK) {
                loop->status = status;
                loop->error = error;
            }
            pthread_mutex_unlock(&loop->mutex);
        }
    }
    return NULL;
}

enum umb_status umbt_parallel_for(unsigned threads, size_t count, size_t block, umbt_block_fn fn,
                                  void *user, struct umb_error *error)
{
    struct loop loop = {.count = count, .block = block > 0 ? block : 1, .fn = fn, .user = user};
    pthread_t started[THREADS_MAX];
    unsigned start_count = 0;
    if (pthread_mutex_init(&loop.mutex, NULL) != 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a mutex could not be made");
    }
    const size_t block_count = count / loop.block + (count % loop.block != 0);
    while (start_count + 1 < threads && start_count + 1 < THREADS_MAX &&
           start_count + 1 < block_count) {
        if (pthread_create(&started[start_count], NULL, worker, &loop) != 0) {
            break; /* fewer threads, same answers */
        }
        start_count++;
    }
    (void)worker(&loop);
    for (unsigned i = 0; i < start_count; i++) {
        pthread_join(started[i], NULL);
    }
    pthread_mutex_destroy(&loop.mutex);
    if (loop.status != UMB_OK && error != NULL) {
        *error = loop.error;
    }
    return loop.status;
}

unsigned umbt_processor_count(void)
{
    const long count = sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1U : count > THREADS_MAX ? (unsigned)THREADS_MAX : (unsigned)count;
}
