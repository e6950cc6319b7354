/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The worker pool.
 *
 * Waiting tasks form a ring of lanes, one for each connection: the ring has the first task of each
 * lane, and the lane's later tasks follow that task in a list. A worker takes a slice of the ring's
 * first lane and moves the lane to the back, so connections take turns. A slice may count as many
 * turns, such as one with a large box. Its lane pays in advance: it gives up that many turns while
 * other lanes want them. So lanes of small slices do not wait for large slices again and again.
 *
 * Invariants, under the mutex: a task is linked exactly while some of its records are not handed
 * out. When a task is neither linked nor in flight, the thread that finds this gives it back
 * (done). That happens once, because both states end only under the same mutex. `done` is called
 * without the mutex.
 *
 * The first error in record order wins. Slices are handed out in order, so all slices before a
 * failed one have been handed out and report before the task is given back.
 */
#include <stdlib.h>
#include <string.h>

#include "daemon/work/pool.h"
#include "tool/clock.h"

struct umbd_pool {
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    struct umbd_tasks ring; /* heads of the lanes */
    size_t depth, limit;    /* tasks linked */
    int stopping;
    struct umbd_metrics *metrics;
    uint32_t thread_count;
    pthread_t threads[];
};

static struct umbd_task *find_lane(const struct umbd_pool *pool, uint64_t lane)
{
    struct umbd_task *head = TAILQ_FIRST(&pool->ring);
    while (head != NULL && head->lane != lane) {
        head = TAILQ_NEXT(head, link);
    }
    return head;
}

static void link_task(struct umbd_pool *pool, struct umbd_task *task)
{
    struct umbd_task *head = find_lane(pool, task->lane);
    TAILQ_INIT(&task->followers);
    task->lane_count = 1;
    if (head != NULL) {
        head->lane_count++;
    }
    TAILQ_INSERT_TAIL(head != NULL ? &head->followers : &pool->ring, task, link);
    task->linked = 1;
    pool->depth++;
}

/* Takes a task out of its lane, from any place in it. */
static void unlink_task(struct umbd_pool *pool, struct umbd_task *task)
{
    struct umbd_task *head = find_lane(pool, task->lane);
    struct umbd_task *next = TAILQ_FIRST(&task->followers);
    TAILQ_REMOVE(head == task ? &pool->ring : &head->followers, task, link);
    head->lane_count--;
    if (head == task && next != NULL) { /* the new head */
        TAILQ_REMOVE(&task->followers, next, link);
        TAILQ_CONCAT(&next->followers, &task->followers, link);
        next->lane_count = task->lane_count;
        TAILQ_INSERT_TAIL(&pool->ring, next, link);
    }
    task->linked = 0;
    pool->depth--;
}

/* Ends a linked task early. */
static void stop_task(struct umbd_pool *pool, struct umbd_task *task, enum umb_status status)
{
    const char *what = status == UMB_E_DEADLINE ? "the deadline passed" : "cancelled";
    unlink_task(pool, task);
    if (task->status == UMB_OK) {
        task->status = task->items == NULL
                           ? umb_fail(&task->error, status, "%s", what)
                           : umb_fail(&task->error, status, "%s after %zu of %zu %s", what,
                                      task->next_record, task->count, task->items);
        task->error_record = task->next_record;
    }
}

/* Records the end of a slice. */
static void slice_ended(struct umbd_pool *pool, struct umbd_task *task, size_t first,
                        enum umb_status status, const struct umbd_slice_result *result)
{
    task->in_flight--;
    umb_query_stats_add(&task->stats, &result->stats);
    task->cpu_ns += result->cpu_ns;
    if (status == UMB_OK) {
        return;
    }
    if (task->status == UMB_OK || first < task->error_record) {
        task->status = status;
        task->error = result->error;
        task->error_record = first;
    }
    if (task->linked) {
        unlink_task(pool, task);
    }
}

/* Returns 1 if a lane's head (its first task) has given up enough turns. An expired head counts as
 * due too, so that the caller fails it. */
static int is_due(const struct umbd_task *head)
{
    return head->waited + 1 >= head->turns ||
           (head->deadline_ns != 0 && umbu_clock_ns() >= head->deadline_ns);
}

/* Moves the lane whose turn it is to the front of the ring. The ring must not be empty. */
static void turn_ring(struct umbd_pool *pool)
{
    const struct umbd_task *const last = TAILQ_LAST(&pool->ring, umbd_tasks);
    uint64_t least = UINT64_MAX;
    for (int rounded = 0; !rounded && !is_due(TAILQ_FIRST(&pool->ring));) {
        struct umbd_task *head = TAILQ_FIRST(&pool->ring);
        head->waited++;
        const uint64_t left = head->turns - 1 - head->waited;
        least = left < least ? left : least;
        rounded = head == last;
        TAILQ_REMOVE(&pool->ring, head, link);
        TAILQ_INSERT_TAIL(&pool->ring, head, link);
        if (rounded) { /* no lane took a turn: skips as many rounds as make one due */
            for (head = TAILQ_FIRST(&pool->ring); head != NULL; head = TAILQ_NEXT(head, link)) {
                head->waited += least;
            }
        }
    }
    while (!is_due(TAILQ_FIRST(&pool->ring))) { /* one lane is due */
        struct umbd_task *head = TAILQ_FIRST(&pool->ring);
        TAILQ_REMOVE(&pool->ring, head, link);
        TAILQ_INSERT_TAIL(&pool->ring, head, link);
    }
}

/*
 * Hands out the next slice of the ring's first lane. Returns the task with *count records from
 * *first on. If the task expired and must be given back, *count is 0. Returns NULL if there is
 * nothing to run because an expired task still has slices under way.
 */
static struct umbd_task *take_slice(struct umbd_pool *pool, size_t *first, size_t *count)
{
    turn_ring(pool);
    struct umbd_task *task = TAILQ_FIRST(&pool->ring);
    task->waited = 0;
    *first = task->next_record;
    *count = 0;
    if (task->deadline_ns != 0 && umbu_clock_ns() >= task->deadline_ns) {
        stop_task(pool, task, UMB_E_DEADLINE);
        return task->in_flight == 0 ? task : NULL;
    }
    size_t left = task->count - task->next_record;
    *count = left < task->slice ? left : task->slice;
    task->next_record += *count;
    task->in_flight++;
    if (!task->begun) {
        task->begun = 1;
        umbd_count(&pool->metrics->batches_started, 1);
        umbd_observe(&pool->metrics->queued, umbu_clock_ns() - task->queued_ns);
    }
    if (task->next_record == task->count) {
        unlink_task(pool, task);
    } else {
        TAILQ_REMOVE(&pool->ring, task, link);
        TAILQ_INSERT_TAIL(&pool->ring, task, link);
    }
    return task;
}

static void give_back(struct umbd_pool *pool, struct umbd_task *task)
{
    if (task->status == UMB_OK) {
        umbd_count(&pool->metrics->points, task->answered);
    }
    if (task->status == UMB_OK && task->end != NULL) {
        task->status = task->end(task, &task->error);
    }
    task->done(task);
}

static void *worker(void *argument)
{
    struct umbd_pool *pool = argument;
    pthread_mutex_lock(&pool->mutex);
    for (;;) {
        while (TAILQ_EMPTY(&pool->ring) && !pool->stopping) {
            pthread_cond_wait(&pool->wake, &pool->mutex);
        }
        if (TAILQ_EMPTY(&pool->ring)) {
            break;
        }
        size_t first = 0;
        size_t count = 0;
        struct umbd_task *task = take_slice(pool, &first, &count);
        if (task == NULL) {
            continue;
        }
        pthread_mutex_unlock(&pool->mutex);
        if (count > 0) {
            struct umbd_slice_result result;
            memset(&result.stats, 0, sizeof result.stats);
            result.cpu_ns = 0;
            enum umb_status status = task->run(task, first, count, &result);
            pthread_mutex_lock(&pool->mutex);
            slice_ended(pool, task, first, status, &result);
            int last = !task->linked && task->in_flight == 0;
            pthread_mutex_unlock(&pool->mutex);
            if (last) {
                give_back(pool, task);
            }
        } else {
            give_back(pool, task);
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
    TAILQ_INIT(&pool->ring);
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
    while (!TAILQ_EMPTY(&pool->ring)) {
        struct umbd_task *task = TAILQ_FIRST(&pool->ring);
        stop_task(pool, task, UMB_E_CANCELLED);
        if (task->in_flight == 0) {
            pthread_mutex_unlock(&pool->mutex);
            give_back(pool, task);
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
 * Removes the last task of the longest lane from a full queue, to make room for a task of `lane`.
 * The longest lane must still be longer than `lane` with the new task. Otherwise a few greedy
 * connections would fill the queue. The removed task is never a head, and only heads are ever
 * begun. Returns the task, to be given back, or NULL.
 */
static struct umbd_task *make_room(struct umbd_pool *pool, uint64_t lane)
{
    const struct umbd_task *own = find_lane(pool, lane);
    struct umbd_task *longest = TAILQ_FIRST(&pool->ring);
    for (struct umbd_task *head = TAILQ_FIRST(&pool->ring); head != NULL;
         head = TAILQ_NEXT(head, link)) {
        longest = head->lane_count > longest->lane_count ? head : longest;
    }
    if (longest == NULL || longest->lane_count <= 1 + (own != NULL ? own->lane_count : 0)) {
        return NULL;
    }
    struct umbd_task *victim = TAILQ_LAST(&longest->followers, umbd_tasks);
    victim->status = queue_full(pool, &victim->error);
    unlink_task(pool, victim);
    return victim;
}

enum umb_status umbd_pool_submit(struct umbd_pool *pool, struct umbd_task *task,
                                 struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbd_task *victim = NULL;
    pthread_mutex_lock(&pool->mutex);
    if (pool->depth >= pool->limit && !pool->stopping) {
        victim = make_room(pool, task->lane);
    }
    if (pool->depth >= pool->limit || pool->stopping) {
        status = queue_full(pool, error);
    } else if (task->count == 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "points: an empty batch needs no worker");
    } else {
        task->queued_ns = umbu_clock_ns();
        task->next_record = 0;
        task->in_flight = 0;
        task->status = UMB_OK;
        task->pool = pool;
        link_task(pool, task);
        if (task->count > task->slice) {
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

void umbd_task_cancel(struct umbd_task *task)
{
    struct umbd_pool *pool = task->pool;
    int last = 0;
    atomic_store_explicit(&task->given_up, 1, memory_order_relaxed);
    pthread_mutex_lock(&pool->mutex);
    if (task->linked) {
        stop_task(pool, task, UMB_E_CANCELLED);
        last = task->in_flight == 0;
    }
    pthread_mutex_unlock(&pool->mutex);
    if (last) {
        give_back(pool, task);
    }
}

enum umb_status umbd_task_stopped(const struct umbd_task *task)
{
    if (atomic_load_explicit(&task->given_up, memory_order_relaxed)) {
        return UMB_E_CANCELLED;
    }
    return task->deadline_ns != 0 && umbu_clock_ns() >= task->deadline_ns ? UMB_E_DEADLINE : UMB_OK;
}

enum umb_status umbd_task_result(const struct umbd_task *task, enum umb_status status,
                                 struct umb_error *error)
{
    return status == UMB_E_CANCELLED && umbd_task_stopped(task) == UMB_E_DEADLINE
               ? umb_fail(error, UMB_E_DEADLINE, "the deadline passed")
               : status;
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
