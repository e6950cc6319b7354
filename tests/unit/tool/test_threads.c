/* SPDX-License-Identifier: Apache-2.0 */
/* Slices and ranges: each is done once, by the threads that exist, and a failure ends the rest. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "tool/threads.h"

#define ITEMS 10007

static atomic_int done[ITEMS];

static void clear(void)
{
    for (size_t i = 0; i < ITEMS; i++) {
        atomic_store(&done[i], 0);
    }
}

static void assert_each_once(size_t count)
{
    for (size_t i = 0; i < ITEMS; i++) {
        assert_int_equal(atomic_load(&done[i]), i < count ? 1 : 0);
    }
}

static void do_slice(void *user, uint32_t slice, unsigned thread)
{
    assert_true(thread < *(const unsigned *)user);
    atomic_fetch_add(&done[slice], 1);
}

static void slices_are_done_once_each(void **state)
{
    (void)state;
    for (unsigned count = 1; count <= 5; count++) {
        struct umbu_threads *threads;
        struct umb_error error;
        assert_int_equal(umbu_threads_create(count, &threads, &error), UMB_OK);
        for (uint32_t round = 0; round < 20; round++) {
            clear();
            umbu_threads_start(threads, do_slice, &count, round * 37);
            umbu_threads_wait(threads, NULL, NULL);
            assert_each_once(round * 37);
        }
        const struct umb_workers workers = umbu_threads_workers(threads);
        assert_true(workers.count >= 1 && workers.count <= count);
        clear();
        umbu_workers_run(&workers, do_slice, &count, 500);
        assert_each_once(500);
        clear();
        umbu_threads_start(threads, do_slice, &count, 300);
        umbu_threads_destroy(threads); /* which waits */
        assert_each_once(300);
    }
    clear();
    unsigned one = 1;
    umbu_workers_run(NULL, do_slice, &one, 100);
    assert_each_once(100);
    umbu_threads_destroy(NULL);
}

static int is_half_done(void *user)
{
    (void)user;
    return atomic_load(&done[50]) != 0;
}

static void count_tick(void *user)
{
    ++*(int *)user;
}

static void the_owner_waits_for_what_it_needs(void **state)
{
    struct umbu_threads *threads;
    unsigned count = 1;
    int ticks = 0;
    (void)state;
    clear();
    assert_int_equal(umbu_threads_create(count, &threads, NULL), UMB_OK);
    umbu_threads_start(threads, do_slice, &count, 100);
    umbu_threads_wait_until(threads, is_half_done, NULL);
    assert_each_once(51); /* alone, it has done no more than that */
    umbu_threads_wait(threads, count_tick, &ticks);
    assert_each_once(100);
    assert_int_equal(ticks, 49);
    umbu_threads_destroy(threads);
}

struct job {
    size_t block, fail_at;
    atomic_int calls;
};

static enum umb_status do_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct job *job = user;
    atomic_fetch_add(&job->calls, 1);
    assert_int_equal(first % job->block, 0);
    assert_true(count == job->block || first + count == ITEMS);
    if (first >= job->fail_at) {
        return umb_fail(error, UMB_E_BUSY, "block at %zu", first);
    }
    for (size_t i = first; i < first + count; i++) {
        atomic_fetch_add(&done[i], 1);
    }
    return UMB_OK;
}

static void ranges_are_done_in_blocks(void **state)
{
    static const size_t blocks[] = {1, 7, 1024, ITEMS, 2 * ITEMS};
    (void)state;
    for (unsigned threads = 0; threads <= 4; threads++) {
        for (size_t i = 0; i < sizeof blocks / sizeof blocks[0]; i++) {
            struct job job = {.block = blocks[i], .fail_at = SIZE_MAX};
            clear();
            assert_int_equal(umbu_range_run(threads, ITEMS, blocks[i], do_block, &job, NULL),
                             UMB_OK);
            assert_each_once(ITEMS);
        }
    }
    struct job none = {.block = 1, .fail_at = 0};
    assert_int_equal(umbu_range_run(4, 0, 10, do_block, &none, NULL), UMB_OK);
    assert_int_equal(atomic_load(&none.calls), 0);
}

static void do_item(void *user, size_t i)
{
    atomic_fetch_add(&((atomic_int *)user)[i], 1);
}

static void each_item_of_a_range_is_done_once(void **state)
{
    (void)state;
    for (unsigned threads = 0; threads <= 4; threads++) {
        clear();
        assert_int_equal(umbu_range_each(threads, ITEMS - 1, 100, do_item, done, NULL), UMB_OK);
        assert_each_once(ITEMS - 1);
    }
}

static void a_failed_block_ends_the_range(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= 4; threads++) {
        struct job job = {.block = 10, .fail_at = 100};
        struct umb_error error;
        assert_int_equal(umbu_range_run(threads, ITEMS, 10, do_block, &job, &error), UMB_E_BUSY);
        assert_int_equal(error.status, UMB_E_BUSY);
        assert_memory_equal(error.message, "block at ", 9);
        assert_true(atomic_load(&job.calls) <= 10 + (int)threads);
    }
}

static void processors_are_counted(void **state)
{
    (void)state;
    assert_true(umbu_processor_count() >= 1 && umbu_processor_count() <= UMBU_THREADS_MAX);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slices_are_done_once_each),
        cmocka_unit_test(the_owner_waits_for_what_it_needs),
        cmocka_unit_test(ranges_are_done_in_blocks),
        cmocka_unit_test(each_item_of_a_range_is_done_once),
        cmocka_unit_test(a_failed_block_ends_the_range),
        cmocka_unit_test(processors_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
