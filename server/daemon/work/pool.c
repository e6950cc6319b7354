/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The worker pool.
 *
 * Waiting batches form a ring of lanes: the first batch of each connection is in the ring and its
 * later ones follow it in a list. A worker takes a slice of the ring's first lane and moves the
 * lane to the back, so turns go round between connections. A slice may take many turns, as one
 * large box does. Its lane pays in advance: it gives up that many turns while other lanes want
 * them. So lanes of small slices do not wait for it again and again.
 *
 * Invariants, under the mutex: a batch is linked exactly while it has points not handed out. The
 * thread that finds it neither linked nor in flight gives it back (done). That happens once,
 * because both states end only under the same mutex. `done` is called without the mutex.
 *
 * The first error in point order wins: slices are handed out in order, so every slice before a
 * failed one has been handed out and will report before the batch is given back.
 */
#include <stdlib.h>

#include "daemon/work/batch_slice.h"

#include "tool/clock.h"

struct umbd_pool {
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    struct umbd_batch *first, *last; /* the ring of lanes */
    size_t depth, limit;             /* batches linked */
    int stopping;
    struct umbd_metrics *metrics;
    uint32_t thread_count;
    pthread_t threads[];
};

static void ring_append(struct umbd_pool *pool, struct umbd_batch *batch)
{
    batch->ring_next = NULL;
    batch->ring_previous = pool->last;
    if (pool->last != NULL) {
        pool->last->ring_next = batch;
    } else {
        pool->first = batch;
    }
    pool->last = batch;
}

static void ring_remove(struct umbd_pool *pool, struct umbd_batch *batch)
{
    if (batch->ring_previous != NULL) {
        batch->ring_previous->ring_next = batch->ring_next;
    } else {
        pool->first = batch->ring_next;
    }
    if (batch->ring_next != NULL) {
        batch->ring_next->ring_previous = batch->ring_previous;
    } else {
        pool->last = batch->ring_previous;
    }
    batch->ring_next = batch->ring_previous = NULL;
}

static struct umbd_batch *find_lane(const struct umbd_pool *pool, uint64_t lane)
{
    struct umbd_batch *head = pool->first;
    while (head != NULL && head->lane != lane) {
        head = head->ring_next;
    }
    return head;
}

static void link_batch(struct umbd_pool *pool, struct umbd_batch *batch)
{
    struct umbd_batch *head = find_lane(pool, batch->lane);
    batch->follower = batch->last_follower = NULL;
    batch->lane_count = 1;
    if (head != NULL) {
        head->lane_count++;
    }
    if (head == NULL) {
        ring_append(pool, batch);
    } else if (head->last_follower != NULL) {
        head->last_follower->follower = batch;
        head->last_follower = batch;
    } else {
        head->follower = head->last_follower = batch;
    }
    batch->linked = 1;
    pool->depth++;
}

/* Takes a batch out of its lane, from any place in it. */
static void unlink_batch(struct umbd_pool *pool, struct umbd_batch *batch)
{
    struct umbd_batch *head = find_lane(pool, batch->lane);
    if (head == batch) {
        struct umbd_batch *next = batch->follower;
        ring_remove(pool, batch);
        if (next != NULL) {
            next->lane_count = batch->lane_count - 1;
            next->last_follower = batch->last_follower != next ? batch->last_follower : NULL;
            ring_append(pool, next);
        }
    } else {
        struct umbd_batch *before = head;
        while (before->follower != batch) {
            before = before->follower;
        }
        before->follower = batch->follower;
        head->lane_count--;
        if (head->last_follower == batch) {
            head->last_follower = before != head ? before : NULL;
        }
    }
    batch->follower = batch->last_follower = NULL;
    batch->linked = 0;
    pool->depth--;
}

/* Ends a linked batch early. */
static void stop_batch(struct umbd_pool *pool, struct umbd_batch *batch, enum umb_status status)
{
    const char *what = status == UMB_E_DEADLINE ? "the deadline passed" : "cancelled";
    const char *items = batch->work != NULL ? batch->work_items : "points";
    unlink_batch(pool, batch);
    if (batch->status == UMB_OK) {
        batch->status = items == NULL
                            ? umb_fail(&batch->error, status, "%s", what)
                            : umb_fail(&batch->error, status, "%s after %zu of %zu %s", what,
                                       batch->next_point, batch->points.count, items);
        batch->error_point = batch->next_point;
    }
}

/* Records the end of a slice. */
static void slice_ended(struct umbd_pool *pool, struct umbd_batch *batch, size_t first,
                        enum umb_status status, const struct umbd__slice_result *result)
{
    batch->in_flight--;
    umb_query_stats_add(&batch->stats, &result->stats);
    batch->cpu_ns += result->cpu_ns;
    if (status == UMB_OK) {
        return;
    }
    if (batch->status == UMB_OK || first < batch->error_point) {
        batch->status = status;
        batch->error = result->error;
        batch->error_point = first;
    }
    if (batch->linked) {
        unlink_batch(pool, batch);
    }
}

/* Whether a lane's head has given up enough turns. An expired head is due, so that it is failed. */
static int is_due(const struct umbd_batch *head)
{
    return head->waited + 1 >= head->slice_turns ||
           (head->deadline_ns != 0 && umbu_clock_ns() >= head->deadline_ns);
}

/* Moves the lane whose turn it is to the front of the ring, which is not empty. */
static void turn_ring(struct umbd_pool *pool)
{
    const struct umbd_batch *const last = pool->last;
    uint64_t least = UINT64_MAX;
    for (int rounded = 0; !rounded && !is_due(pool->first);) {
        struct umbd_batch *head = pool->first;
        head->waited++;
        const uint64_t left = head->slice_turns - 1 - head->waited;
        least = left < least ? left : least;
        rounded = head == last;
        ring_remove(pool, head);
        ring_append(pool, head);
        if (rounded) { /* no lane took a turn: skips as many rounds as make one due */
            for (head = pool->first; head != NULL; head = head->ring_next) {
                head->waited += least;
            }
        }
    }
    while (!is_due(pool->first)) { /* one lane is due */
        struct umbd_batch *head = pool->first;
        ring_remove(pool, head);
        ring_append(pool, head);
    }
}

/*
 * Hands out the next slice of the ring's first lane. Returns the batch with *count points from
 * *first on. *count is 0 if the batch expired and must be given back. Returns NULL if there was
 * none to run (an expired batch whose other slices still run).
 */
static struct umbd_batch *take_slice(struct umbd_pool *pool, size_t *first, size_t *count)
{
    turn_ring(pool);
    struct umbd_batch *batch = pool->first;
    batch->waited = 0;
    *first = batch->next_point;
    *count = 0;
    if (batch->deadline_ns != 0 && umbu_clock_ns() >= batch->deadline_ns) {
        stop_batch(pool, batch, UMB_E_DEADLINE);
        return batch->in_flight == 0 ? batch : NULL;
    }
    size_t left = batch->points.count - batch->next_point;
    *count = left < batch->slice_points ? left : batch->slice_points;
    batch->next_point += *count;
    batch->in_flight++;
    if (!batch->begun) {
        batch->begun = 1;
        umbd_count(&pool->metrics->batches_started, 1);
        umbd_observe(&pool->metrics->queued, umbu_clock_ns() - batch->queued_ns);
    }
    if (batch->next_point == batch->points.count) {
        unlink_batch(pool, batch);
    } else {
        ring_remove(pool, batch);
        ring_append(pool, batch);
    }
    return batch;
}

static void give_back(struct umbd_pool *pool, struct umbd_batch *batch)
{
    if (batch->status == UMB_OK) {
        umbd_count(&pool->metrics->points, batch->points.count * batch->part_count);
    }
    if (batch->status == UMB_OK && batch->picture_work.pack) {
        umbd_picture_work_pack(batch);
    }
    if (batch->status == UMB_OK && batch->work_end != NULL) {
        batch->status = batch->work_end(batch, &batch->error);
    }
    batch->done(batch);
}

static void *worker(void *argument)
{
    struct umbd_pool *pool = argument;
    pthread_mutex_lock(&pool->mutex);
    for (;;) {
        while (pool->first == NULL && !pool->stopping) {
            pthread_cond_wait(&pool->wake, &pool->mutex);
        }
        if (pool->first == NULL) {
            break;
        }
        size_t first = 0;
        size_t count = 0;
        struct umbd_batch *batch = take_slice(pool, &first, &count);
        if (batch == NULL) {
            continue;
        }
        pthread_mutex_unlock(&pool->mutex);
        if (count > 0) {
            struct umbd__slice_result result;
            enum umb_status status = umbd__slice_run(batch, first, count, &result);
            pthread_mutex_lock(&pool->mutex);
            slice_ended(pool, batch, first, status, &result);
            int last = !batch->linked && batch->in_flight == 0;
            pthread_mutex_unlock(&pool->mutex);
            if (last) {
                give_back(pool, batch);
            }
        } else {
            give_back(pool, batch);
        }
        pthread_mutex_lock(&pool->mutex);
    }
    pthread_mutex_unlock(&pool->mutex);
    return NULL;
}

static void join_all(struct umbd_pool *pool)
{
    pthread_mutex_lock(&pool->mutex);
    pool->stopping = 1;
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->mutex);
    for (uint32_t i = 0; i < pool->thread_count; i++) {
        pthread_join(pool->threads[i], NULL);
    }
    pthread_cond_destroy(&pool->wake);
    pthread_mutex_destroy(&pool->mutex);
    free(pool);
}

enum umb_status umbd_pool_create(uint32_t workers, size_t queue_limit, struct umbd_metrics *metrics,
                                 struct umbd_pool **out, struct umb_error *error)
{
    *out = NULL;
    struct umbd_pool *pool = calloc(1, sizeof *pool + workers * sizeof(pthread_t));
    if (pool == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u workers", workers);
    }
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->wake, NULL);
    pool->limit = queue_limit;
    pool->metrics = metrics;
    for (uint32_t i = 0; i < workers; i++) {
        int code = pthread_create(&pool->threads[i], NULL, worker, pool);
        if (code != 0) {
            enum umb_status status = umb_fail_errno(error, UMB_E_LIMIT, code,
                                                    "cannot start worker %u of %u", i + 1, workers);
            join_all(pool);
            return status;
        }
        pool->thread_count++;
    }
    *out = pool;
    return UMB_OK;
}

void umbd_pool_destroy(struct umbd_pool *pool)
{
    if (pool == NULL) {
        return;
    }
    pthread_mutex_lock(&pool->mutex);
    while (pool->first != NULL) {
        struct umbd_batch *batch = pool->first;
        stop_batch(pool, batch, UMB_E_CANCELLED);
        if (batch->in_flight == 0) {
            pthread_mutex_unlock(&pool->mutex);
            give_back(pool, batch);
            pthread_mutex_lock(&pool->mutex);
        }
    }
    pthread_mutex_unlock(&pool->mutex);
    join_all(pool);
}

static enum umb_status queue_full(const struct umbd_pool *pool, struct umb_error *error)
{
    return umb_fail(error, UMB_E_BUSY,
                    "queue: %zu batches are waiting, the limit is %zu (--queue); try again later",
                    pool->depth, pool->limit);
}

/*
 * Takes the last batch of the longest lane out of a full queue, if that lane stays the longer one
 * with a further batch of this lane. Otherwise a few greedy connections would fill the queue. Only
 * heads are ever begun, and the victim is not a head. Returns it, to be given back, or NULL.
 */
static struct umbd_batch *make_room(struct umbd_pool *pool, uint64_t lane)
{
    const struct umbd_batch *own = find_lane(pool, lane);
    struct umbd_batch *longest = pool->first;
    for (struct umbd_batch *head = pool->first; head != NULL; head = head->ring_next) {
        longest = head->lane_count > longest->lane_count ? head : longest;
    }
    if (longest == NULL || longest->lane_count <= 1 + (own != NULL ? own->lane_count : 0)) {
        return NULL;
    }
    struct umbd_batch *victim = longest->last_follower;
    victim->status = queue_full(pool, &victim->error);
    unlink_batch(pool, victim);
    return victim;
}

enum umb_status umbd_pool_submit(struct umbd_pool *pool, struct umbd_batch *batch,
                                 struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbd_batch *victim = NULL;
    pthread_mutex_lock(&pool->mutex);
    if (pool->depth >= pool->limit && !pool->stopping) {
        victim = make_room(pool, batch->lane);
    }
    if (pool->depth >= pool->limit || pool->stopping) {
        status = queue_full(pool, error);
    } else if (batch->points.count == 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "points: an empty batch needs no worker");
    } else {
        umbd__batch_set_slice(batch);
        batch->queued_ns = umbu_clock_ns();
        batch->next_point = 0;
        batch->in_flight = 0;
        batch->status = UMB_OK;
        link_batch(pool, batch);
        if (batch->points.count > batch->slice_points) {
            pthread_cond_broadcast(&pool->wake);
        } else {
            pthread_cond_signal(&pool->wake);
        }
    }
    pthread_mutex_unlock(&pool->mutex);
    if (victim != NULL) {
        give_back(pool, victim);
    }
    return status;
}

void umbd_pool_cancel(struct umbd_pool *pool, struct umbd_batch *batch)
{
    int last = 0;
    atomic_store_explicit(&batch->given_up, 1, memory_order_relaxed);
    pthread_mutex_lock(&pool->mutex);
    if (batch->linked) {
        stop_batch(pool, batch, UMB_E_CANCELLED);
        last = batch->in_flight == 0;
    }
    pthread_mutex_unlock(&pool->mutex);
    if (last) {
        give_back(pool, batch);
    }
}

size_t umbd_pool_depth(struct umbd_pool *pool)
{
    pthread_mutex_lock(&pool->mutex);
    size_t depth = pool->depth;
    pthread_mutex_unlock(&pool->mutex);
    return depth;
}

int umbd_pool_has_room(struct umbd_pool *pool)
{
    return umbd_pool_depth(pool) <= pool->limit / 2;
}
