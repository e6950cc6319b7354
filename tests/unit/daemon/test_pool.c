/* SPDX-License-Identifier: Apache-2.0 */
/* The worker pool: splitting, errors, deadlines, cancelling, bounds, fairness. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

#include "../store/store_fixture.h"
#include "daemon/work/batch.h"
#include "daemon/work/pool.h"
#include "tool/clock.h"

#define POINTS 50001 /* odd, several slices, the last one short */

struct fixture {
    struct folder folder;
    struct umbs_store *store;
    struct umbd_metrics metrics;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    int held, gate_open;
    size_t done;
    uint64_t order[64]; /* lanes in the order their batches ended */
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    uint8_t id[UMB_ID_BYTES];
    assert_non_null(f);
    folder_make(&f->folder);
    folder_asset(&f->folder, "slab.umb", 30, id);
    struct umbs_store_options options = {.folders = {f->folder.path}};
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    assert_int_equal(umbs_store_rescan(f->store, NULL, NULL), UMB_OK);
    pthread_mutex_init(&f->mutex, NULL);
    pthread_cond_init(&f->changed, NULL);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbs_store_close(f->store);
    folder_remove(&f->folder);
    pthread_mutex_destroy(&f->mutex);
    pthread_cond_destroy(&f->changed);
    free(f);
    return 0;
}

static void on_done(struct umbd_task *task)
{
    struct fixture *f = task->home;
    pthread_mutex_lock(&f->mutex);
    if (f->done < 64) {
        f->order[f->done] = task->lane;
    }
    f->done++;
    pthread_cond_broadcast(&f->changed);
    pthread_mutex_unlock(&f->mutex);
}

static void wait_done(struct fixture *f, size_t count)
{
    pthread_mutex_lock(&f->mutex);
    while (f->done < count) {
        pthread_cond_wait(&f->changed, &f->mutex);
    }
    pthread_mutex_unlock(&f->mutex);
}

/* A batch of pseudo-random points within the asset; the message holds the positions. */
static struct umbd_batch *make_batch(struct fixture *f, size_t count, uint64_t lane,
                                     enum umb_answer_format format)
{
    struct umbs_entry *entry;
    struct umbd_batch *batch;
    uint64_t seed = 0x9e3779b97f4a7c15;
    float *positions = malloc(count * 3 * sizeof *positions);
    assert_non_null(positions);
    for (size_t i = 0; i < 3 * count; i++) {
        positions[i] = (float)(random_unit(&seed) * 64.0);
    }
    struct umb_query_settings settings = {.taps = 3, .format = format};
    struct umb_points points = {.positions = positions, .format = UMB_POINT_F32, .count = count};
    assert_int_equal(umbs_store_acquire(f->store, "slab", &entry, NULL), UMB_OK);
    assert_int_equal(umbd_batch_create(1, &settings, &points, &batch, NULL), UMB_OK);
    batch->message = (uint8_t *)positions;
    assert_int_equal(umbd_batch_add(batch, entry, 0, NULL), UMB_OK);
    assert_int_equal(umbd_batch_reserve(batch, 0, NULL), UMB_OK);
    batch->task.lane = lane;
    batch->task.done = on_done;
    batch->task.home = f;
    batch->want_stats = 1;
    return batch;
}

static uint64_t started(struct fixture *f)
{
    return (uint64_t)atomic_load(&f->metrics.batches_started);
}

static void pool_split_batch_equals_one_run(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    static const enum umb_answer_format formats[] = {UMB_ANSWER_F32, UMB_ANSWER_U8, UMB_ANSWER_BIT};
    assert_int_equal(umbd_pool_create(3, 16, &f->metrics, &pool, NULL), UMB_OK);
    for (size_t i = 0; i < 3; i++) {
        struct umbd_batch *split = make_batch(f, POINTS, 1, formats[i]);
        struct umbd_batch *whole = make_batch(f, POINTS, 1, formats[i]);
        umbd_batch_run(whole, &f->metrics);
        assert_int_equal(whole->task.status, UMB_OK);
        assert_int_equal(umbd_pool_submit(pool, &split->task, NULL), UMB_OK);
        wait_done(f, i + 1);
        assert_int_equal(split->task.status, UMB_OK);
        assert_int_equal(split->value_bytes, whole->value_bytes);
        assert_memory_equal(split->values, whole->values, whole->value_bytes);
        assert_memory_equal(&split->task.stats, &whole->task.stats, sizeof whole->task.stats);
        assert_int_equal(split->task.stats.points, POINTS);
        assert_true(split->task.cpu_ns > 0);
        umbd_batch_destroy(split);
        umbd_batch_destroy(whole);
    }
    assert_int_equal(started(f), 6);
    assert_int_equal(atomic_load(&f->metrics.points), 6 * POINTS);
    umbd_pool_destroy(pool);
}

static void pool_reports_the_first_bad_point_of_the_whole_batch(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    assert_int_equal(umbd_pool_create(2, 16, &f->metrics, &pool, NULL), UMB_OK);
    for (size_t round = 0; round < 5; round++) {
        struct umbd_batch *batch = make_batch(f, POINTS, 1, UMB_ANSWER_U8);
        float *positions = (float *)(void *)batch->message;
        positions[3 * 30001 + 1] = (float)NAN;
        positions[3 * 20002 + 2] = (float)INFINITY;
        positions[3 * 49999] = (float)NAN;
        assert_int_equal(umbd_pool_submit(pool, &batch->task, NULL), UMB_OK);
        wait_done(f, round + 1);
        assert_int_equal(batch->task.status, UMB_E_ARGUMENT);
        assert_non_null(strstr(batch->task.error.message, "[20002].z"));
        umbd_batch_destroy(batch);
    }
    assert_int_equal(atomic_load(&f->metrics.points), 0);
    umbd_pool_destroy(pool);
}

static void pool_never_begins_an_expired_batch(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    struct umbd_batch *batch = make_batch(f, POINTS, 1, UMB_ANSWER_U8);
    assert_int_equal(umbd_pool_create(2, 16, &f->metrics, &pool, NULL), UMB_OK);
    batch->task.deadline_ns = umbu_clock_ns() - 1;
    assert_int_equal(umbd_pool_submit(pool, &batch->task, NULL), UMB_OK);
    wait_done(f, 1);
    assert_int_equal(batch->task.status, UMB_E_DEADLINE);
    assert_non_null(strstr(batch->task.error.message, "the deadline passed after 0 of "));
    assert_non_null(strstr(batch->task.error.message, " points"));
    assert_int_equal(started(f), 0);
    umbd_batch_destroy(batch);
    umbd_pool_destroy(pool);
}

static enum umb_status no_work(struct umbd_task *task, size_t first, size_t count,
                               struct umbd_slice_result *result)
{
    (void)task;
    (void)first;
    (void)count;
    (void)result;
    return UMB_OK;
}

static void work_that_ends_early_says_what_of_in_its_own_words(void **state)
{
    struct fixture *f = *state;
    static const char *const items[2] = {"segments", NULL};
    static const char *const words[2] = {"cancelled after 0 of 300 segments", "cancelled"};
    for (size_t i = 0; i < 2; i++) {
        struct umbd_task task = {.run = no_work, .count = 300, .slice = 100, .items = items[i]};
        struct umbd_pool *pool;
        assert_int_equal(umbd_pool_create(0, 3, &f->metrics, &pool, NULL), UMB_OK);
        task.done = on_done;
        task.home = f;
        assert_int_equal(umbd_pool_submit(pool, &task, NULL), UMB_OK);
        umbd_pool_destroy(pool);
        assert_int_equal(task.status, UMB_E_CANCELLED);
        assert_string_equal(task.error.message, words[i]);
    }
}

/*
 * A pool without workers keeps everything waiting, so a queue can be inspected without a race.
 * Destroying the pool returns all of it as cancelled.
 */
static void pool_refuses_beyond_its_queue(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    struct umb_error error;
    struct umbd_batch *batches[4];
    assert_int_equal(umbd_pool_create(0, 3, &f->metrics, &pool, NULL), UMB_OK);
    for (size_t i = 0; i < 4; i++) {
        batches[i] = make_batch(f, 100, i % 2, UMB_ANSWER_U8);
        assert_int_equal(umbd_pool_submit(pool, &batches[i]->task, &error),
                         i < 3 ? UMB_OK : UMB_E_BUSY);
    }
    assert_non_null(strstr(error.message, "3 (--queue)"));
    assert_int_equal(umbd_pool_depth(pool), 3);
    umbd_pool_destroy(pool);
    assert_int_equal(f->done, 3);
    assert_int_equal(started(f), 0);
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(batches[i]->task.status, i < 3 ? UMB_E_CANCELLED : UMB_OK);
        umbd_batch_destroy(batches[i]);
    }
}

/* Lane 1 has filled the queue. Each newcomer replaces its last batch until all lanes have as
 * many. */
static void pool_full_of_one_lane_makes_room_for_others(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    struct umb_error error;
    struct umbd_batch *batches[13];
    static const uint64_t lanes[13] = {1, 1, 1, 1, 1, 1, 2, 2, 3, 1, 3, 2, 3};
    static const int taken[13] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 1, 0, 0};
    static const size_t victims[4] = {5, 4, 3, 2}; /* from the end of lane 1, none begun */
    assert_int_equal(umbd_pool_create(0, 6, &f->metrics, &pool, NULL), UMB_OK);
    for (size_t i = 0; i < 13; i++) {
        batches[i] = make_batch(f, 100, lanes[i], UMB_ANSWER_U8);
        assert_int_equal(umbd_pool_submit(pool, &batches[i]->task, &error),
                         taken[i] ? UMB_OK : UMB_E_BUSY);
        assert_in_range(umbd_pool_depth(pool), 1, 6);
    }
    assert_int_equal(f->done, 4);
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(f->order[i], 1);
        assert_int_equal(batches[victims[i]]->task.status, UMB_E_BUSY);
        assert_non_null(strstr(batches[victims[i]]->task.error.message, "6 (--queue)"));
    }
    umbd_pool_destroy(pool);
    assert_int_equal(f->done, 10);
    assert_int_equal(started(f), 0);
    for (size_t i = 0; i < 13; i++) {
        umbd_batch_destroy(batches[i]);
    }
}

/* Heads, middles and tails of lanes leave in every order; the others must stay linked. */
static void pool_cancel_takes_a_waiting_batch_out_anywhere(void **state)
{
    struct fixture *f = *state;
    uint64_t seed = 12345;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (size_t round = 0; round < 50; round++) {
        struct umbd_pool *pool;
        struct umbd_batch *batches[9];
        int cancelled[9] = {0};
        f->done = 0;
        assert_int_equal(umbd_pool_create(0, 16, &f->metrics, &pool, NULL), UMB_OK);
        for (size_t i = 0; i < 9; i++) {
            batches[i] = make_batch(f, 10, next_random(&seed) % 3, UMB_ANSWER_U8);
            assert_int_equal(umbd_pool_submit(pool, &batches[i]->task, NULL), UMB_OK);
        }
        size_t count = 0;
        for (size_t k = 0; k < 6; k++) {
            size_t i = (size_t)(next_random(&seed) % 9);
            umbd_task_cancel(&batches[i]->task); /* twice is allowed */
            count += !cancelled[i];
            cancelled[i] = 1;
            assert_int_equal(batches[i]->task.status, UMB_E_CANCELLED);
            assert_int_equal(f->done, count);
            assert_int_equal(umbd_pool_depth(pool), 9 - count);
        }
        umbd_pool_destroy(pool);
        assert_int_equal(f->done, 9);
        for (size_t i = 0; i < 9; i++) {
            umbd_batch_destroy(batches[i]);
        }
    }
}

static void pool_cancel_of_a_running_batch_ends_it_once(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    assert_int_equal(umbd_pool_create(2, 16, &f->metrics, &pool, NULL), UMB_OK);
    for (size_t round = 0; round < 20; round++) {
        struct umbd_batch *batch = make_batch(f, POINTS, 1, UMB_ANSWER_U8);
        assert_int_equal(umbd_pool_submit(pool, &batch->task, NULL), UMB_OK);
        umbd_task_cancel(&batch->task);
        wait_done(f, round + 1);
        assert_true(batch->task.status == UMB_E_CANCELLED || batch->task.status == UMB_OK);
        umbd_task_cancel(&batch->task); /* after its end: nothing */
        umbd_batch_destroy(batch);
    }
    assert_int_equal(f->done, 20);
    umbd_pool_destroy(pool);
}

/* Occupies its worker until the test opens the gate, so that the rest of the queue stands still. */
static void hold_worker(struct umbd_task *task)
{
    struct fixture *f = task->home;
    pthread_mutex_lock(&f->mutex);
    f->held = 1;
    pthread_cond_broadcast(&f->changed);
    while (!f->gate_open) {
        pthread_cond_wait(&f->changed, &f->mutex);
    }
    pthread_mutex_unlock(&f->mutex);
}

static void pool_takes_turns_between_lanes(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    struct umbd_batch *batches[6];
    struct umbd_batch *gate = make_batch(f, 10, 9, UMB_ANSWER_U8);
    assert_int_equal(umbd_pool_create(1, 32, &f->metrics, &pool, NULL), UMB_OK);
    gate->task.done = hold_worker;
    assert_int_equal(umbd_pool_submit(pool, &gate->task, NULL), UMB_OK);
    pthread_mutex_lock(&f->mutex);
    while (!f->held) {
        pthread_cond_wait(&f->changed, &f->mutex);
    }
    pthread_mutex_unlock(&f->mutex);
    for (size_t i = 0; i < 6; i++) {
        batches[i] = make_batch(f, i == 5 ? 100 : POINTS, i == 5 ? 2 : 1, UMB_ANSWER_U8);
        assert_int_equal(umbd_pool_submit(pool, &batches[i]->task, NULL), UMB_OK);
    }
    pthread_mutex_lock(&f->mutex);
    f->gate_open = 1;
    pthread_cond_broadcast(&f->changed);
    pthread_mutex_unlock(&f->mutex);
    wait_done(f, 6);
    /* The last batch in the queue must wait for one slice of the other lane, not for its five
     * batches. */
    assert_int_equal(f->order[0], 2);
    umbd_pool_destroy(pool);
    for (size_t i = 0; i < 6; i++) {
        assert_int_equal(batches[i]->task.status, UMB_OK);
        umbd_batch_destroy(batches[i]);
    }
    umbd_batch_destroy(gate);
}

static void slices_of_many_turns_let_others_pass_first(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    struct umbd_batch *batches[4];
    struct umbd_batch *gate = make_batch(f, 10, 9, UMB_ANSWER_U8);
    static const size_t counts[4] = {100, 100, 100, POINTS};
    static const uint64_t lanes[4] = {1, 2, 3, 4}, turns[4] = {1000, 3, 2000, 0};
    assert_int_equal(umbd_pool_create(1, 32, &f->metrics, &pool, NULL), UMB_OK);
    gate->task.done = hold_worker;
    assert_int_equal(umbd_pool_submit(pool, &gate->task, NULL), UMB_OK);
    pthread_mutex_lock(&f->mutex);
    while (!f->held) {
        pthread_cond_wait(&f->changed, &f->mutex);
    }
    pthread_mutex_unlock(&f->mutex);
    for (size_t i = 0; i < 4; i++) {
        batches[i] = make_batch(f, counts[i], lanes[i], UMB_ANSWER_U8);
        batches[i]->task.turns = turns[i];
        assert_int_equal(umbd_pool_submit(pool, &batches[i]->task, NULL), UMB_OK);
    }
    pthread_mutex_lock(&f->mutex);
    f->gate_open = 1;
    pthread_cond_broadcast(&f->changed);
    pthread_mutex_unlock(&f->mutex);
    wait_done(f, 4);
    /* Lane 4 has more slices than lane 2 waits for. The other lanes wait for all of these, but no
     * longer. */
    static const uint64_t order[4] = {2, 4, 1, 3};
    assert_memory_equal(f->order, order, sizeof order);
    umbd_pool_destroy(pool);
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(batches[i]->task.status, UMB_OK);
        umbd_batch_destroy(batches[i]);
    }
    umbd_batch_destroy(gate);
}

static void batch_of_parts_answers_each_as_if_alone(void **state)
{
    struct fixture *f = *state;
    struct umbd_pool *pool;
    struct umbs_entry *entry;
    struct umbd_batch *alone = make_batch(f, POINTS, 1, UMB_ANSWER_BIT);
    struct umbd_batch *twice;
    assert_int_equal(umbd_pool_create(2, 16, &f->metrics, &pool, NULL), UMB_OK);
    assert_int_equal(umbd_batch_create(2, &alone->settings, &alone->points, &twice, NULL), UMB_OK);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(umbs_store_acquire(f->store, "slab", &entry, NULL), UMB_OK);
        assert_int_equal(umbd_batch_add(twice, entry, 0, NULL), UMB_OK);
    }
    assert_int_equal(umbd_batch_reserve(twice, 7, NULL), UMB_OK);
    twice->task.done = on_done;
    twice->task.home = f;
    umbd_batch_run(alone, &f->metrics);
    assert_int_equal(umbd_pool_submit(pool, &twice->task, NULL), UMB_OK);
    wait_done(f, 1);
    assert_int_equal(twice->task.status, UMB_OK);
    assert_int_equal(twice->value_bytes, 2 * alone->value_bytes);
    assert_memory_equal(twice->values, alone->values, alone->value_bytes);
    assert_memory_equal(twice->values + twice->part_bytes, alone->values, alone->value_bytes);
    assert_ptr_equal(twice->values, twice->reply + 7);
    umbd_pool_destroy(pool);
    umbd_batch_destroy(twice);
    umbd_batch_destroy(alone);
}

static void batch_create_names_what_is_wrong_and_keeps_nothing(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umbd_batch *batch;
    struct umb_error error;
    struct umb_query_settings settings = {.taps = 4};
    struct umb_points points = {.count = 0};
    assert_int_equal(umbs_store_acquire(f->store, "slab", &entry, NULL), UMB_OK);
    assert_int_equal(umbd_batch_create(1, &settings, &points, &batch, &error), UMB_OK);
    assert_int_equal(umbd_batch_add(batch, entry, 0, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "taps"));
    assert_int_equal(batch->part_count, 0);
    umbd_batch_destroy(batch);
}

static void batch_in_used_memory_repeats_only_the_same_volume_query_of_the_same_turn(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umbd_batch *spare = NULL;
    struct umbd_batch *batch;
    struct umb_query_settings settings = {.taps = 3};
    struct umb_query_settings other = {.taps = 5};
    struct umb_query_settings wrong = {.taps = 4};
    struct umb_points points = {.count = 0};
    assert_int_equal(umbs_store_acquire(f->store, "slab", &entry, NULL), UMB_OK);
    assert_int_equal(umbd_batch_reuse(&spare, &settings, &points, &batch, NULL), UMB_OK);
    batch->is_borrowed = 1;
    assert_false(umbd_batch_repeat(batch, entry, 7)); /* fresh memory knows nothing */
    assert_int_equal(umbd_batch_add(batch, entry, 0, NULL), UMB_OK);
    batch->parts[0].serial = 7;
    umbd_batch_recycle(batch, &spare);
    assert_ptr_equal(spare, batch);
    assert_int_equal(umbd_batch_reuse(&spare, &other, &points, &batch, NULL), UMB_OK);
    assert_false(umbd_batch_repeat(batch, entry, 7));
    umbd_batch_recycle(batch, &spare);
    assert_int_equal(umbd_batch_reuse(&spare, &settings, &points, &batch, NULL), UMB_OK);
    assert_null(spare);
    assert_int_equal(batch->part_count, 0);
    assert_false(umbd_batch_repeat(batch, entry, 8));
    assert_false(umbd_batch_repeat(batch, NULL, 7));
    batch->is_borrowed = 1;
    assert_true(umbd_batch_repeat(batch, entry, 7));
    assert_int_equal(batch->part_count, 1);
    assert_int_equal(umb_query_taps(&batch->parts[0].query), 3);
    umbd_batch_recycle(batch, &spare);
    /* A query that could not be prepared leaves nothing to repeat. */
    assert_int_equal(umbd_batch_reuse(&spare, &wrong, &points, &batch, NULL), UMB_OK);
    batch->is_borrowed = 1;
    assert_int_equal(umbd_batch_add(batch, entry, 0, NULL), UMB_E_ARGUMENT);
    umbd_batch_recycle(batch, &spare);
    assert_int_equal(umbd_batch_reuse(&spare, &settings, &points, &batch, NULL), UMB_OK);
    assert_false(umbd_batch_repeat(batch, entry, 7));
    umbd_batch_destroy(batch);
    umbs_entry_release(entry);
}

int main(void)
{
#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH_STORE(pool_split_batch_equals_one_run),
        WITH_STORE(pool_reports_the_first_bad_point_of_the_whole_batch),
        WITH_STORE(pool_never_begins_an_expired_batch),
        WITH_STORE(work_that_ends_early_says_what_of_in_its_own_words),
        WITH_STORE(pool_refuses_beyond_its_queue),
        WITH_STORE(pool_full_of_one_lane_makes_room_for_others),
        WITH_STORE(pool_cancel_takes_a_waiting_batch_out_anywhere),
        WITH_STORE(pool_cancel_of_a_running_batch_ends_it_once),
        WITH_STORE(pool_takes_turns_between_lanes),
        WITH_STORE(slices_of_many_turns_let_others_pass_first),
        WITH_STORE(batch_of_parts_answers_each_as_if_alone),
        WITH_STORE(batch_in_used_memory_repeats_only_the_same_volume_query_of_the_same_turn),
        WITH_STORE(batch_create_names_what_is_wrong_and_keeps_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
