/* SPDX-License-Identifier: Apache-2.0 */
/* Readers of the store: look-ups must never wait, while versions come and go. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

#include "store/store_internal.h"
#include "store_fixture.h"

#define THREADS 3
#define ROUNDS  12

struct fixture {
    struct folder folder;
    struct umbs_store *store;
    atomic_int retired; /* calls */
};

static void count_retired(void *user)
{
    atomic_fetch_add((atomic_int *)user, 1);
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    struct umbs_store_options options = {
        .folders = {f->folder.path}, .retired = count_retired, .owner = &f->retired};
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    alarm(120); /* a look-up that waits for a lock would wait for ever */
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    alarm(0);
    umbs_store_close(f->store);
    folder_remove(&f->folder);
    free(f);
    return 0;
}

/* Adds a version and publishes it. */
static void publish(struct fixture *f, uint32_t height, uint8_t id[UMB_ID_BYTES])
{
    struct umbs_store_report report;
    folder_asset(&f->folder, "city.umb", height, id);
    assert_int_equal(umbs_store_rescan(f->store, &report, NULL), UMB_OK);
    assert_int_equal(report.loaded, 1);
}

/* Versions of assets that exist. */
static size_t alive(struct fixture *f)
{
    return atomic_load(&f->store->holders) - 1;
}

static void reader_finds_what_was_published_before_it_looks(void **state)
{
    struct fixture *f = *state;
    struct umbs_reader *reader;
    struct umbs_entry *entry;
    struct umb_error error;
    uint8_t first[UMB_ID_BYTES];
    uint8_t second[UMB_ID_BYTES];
    assert_int_equal(umbs_reader_open(f->store, &reader, NULL), UMB_OK);
    assert_int_equal(umbs_reader_acquire(reader, "city", &entry, &error), UMB_E_NOT_FOUND);
    assert_null(entry);
    publish(f, 20, first);
    assert_int_equal(umbs_reader_acquire(reader, "city", &entry, &error), UMB_OK);
    assert_memory_equal(umbs_entry_item(entry)->id, first, UMB_ID_BYTES);
    publish(f, 30, second);
    publish(f, 20, first); /* mail that was never fetched is replaced */
    publish(f, 30, second);
    assert_true(umbs_reader_has(reader, second, 1));
    assert_false(umbs_reader_has(reader, second, 0)); /* in none of no folders */
    assert_false(umbs_reader_has(reader, first, 1));
    assert_memory_equal(umbs_entry_item(entry)->id, first, UMB_ID_BYTES);
    assert_true(is_lit(umbs_entry_asset(entry), 10)); /* what is held stays */
    umbs_entry_release(entry);
    assert_int_equal(umbs_reader_acquire(reader, "city", &entry, &error), UMB_OK);
    assert_memory_equal(umbs_entry_item(entry)->id, second, UMB_ID_BYTES);
    umbs_entry_release(entry);
    umbs_reader_close(reader);
}

static void reader_takes_no_lock_of_the_store(void **state)
{
    struct fixture *f = *state;
    struct umbs_reader *reader;
    struct umbs_entry *old;
    struct umbs_entry *fresh;
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    assert_int_equal(umbs_reader_open(f->store, &reader, NULL), UMB_OK);
    publish(f, 20, id);
    assert_int_equal(umbs_reader_acquire(reader, "city", &old, &error), UMB_OK);
    publish(f, 30, id);
    const int before = atomic_load(&f->retired);
    /* Other threads hold every lock there is. */
    pthread_mutex_lock(&f->store->scan);
    pthread_mutex_lock(&f->store->mutex);
    umbs_reader_refresh(reader); /* lets go of the old table, as the last one */
    assert_int_equal(umbs_reader_acquire(reader, "city", &fresh, &error), UMB_OK);
    assert_memory_equal(umbs_entry_item(fresh)->id, id, UMB_ID_BYTES);
    assert_true(umbs_reader_has(reader, id, 1));
    umbs_entry_retain(fresh);
    umbs_entry_release(fresh);
    umbs_entry_release(fresh);
    umbs_entry_release(old);
    pthread_mutex_unlock(&f->store->mutex);
    pthread_mutex_unlock(&f->store->scan);
    assert_true(atomic_load(&f->retired) > before); /* the reaper was told */
    umbs_store_reap(f->store);
    assert_int_equal(alive(f), 1);
    umbs_reader_close(reader);
}

static void reader_that_refreshes_keeps_nothing_old(void **state)
{
    struct fixture *f = *state;
    struct umbs_reader *idle;
    uint8_t id[UMB_ID_BYTES];
    publish(f, 20, id);
    assert_int_equal(umbs_reader_open(f->store, &idle, NULL), UMB_OK);
    publish(f, 30, id);
    publish(f, 40, id);
    umbs_store_reap(f->store);
    assert_int_equal(alive(f), 2); /* the newest, and that of its last look */
    umbs_reader_refresh(idle);
    umbs_store_reap(f->store);
    assert_int_equal(alive(f), 1);
    publish(f, 50, id);
    umbs_reader_close(idle); /* with mail not fetched */
    umbs_store_reap(f->store);
    assert_int_equal(alive(f), 1);
}

struct worker {
    struct fixture *fixture;
    atomic_int *stop;
    int reopens; /* 1: opens and closes a reader for each look-up */
    atomic_uint answered;
    atomic_int failed;
    pthread_t thread;
};

/* Each entry must be complete, and answer as its id says, until it is released. */
static int look(struct umbs_reader *reader)
{
    struct umbs_entry *entry;
    struct umb_asset_info info;
    if (umbs_reader_acquire(reader, "city", &entry, NULL) != UMB_OK) {
        return 0;
    }
    umbs_entry_retain(entry);
    umbs_entry_release(entry);
    umb_asset_get_info(umbs_entry_asset(entry), &info);
    int good = memcmp(info.id, umbs_entry_item(entry)->id, UMB_ID_BYTES) == 0 &&
               is_lit(umbs_entry_asset(entry), 10) && !is_lit(umbs_entry_asset(entry), 60);
    umbs_entry_release(entry);
    return good;
}

static void *work(void *argument)
{
    struct worker *worker = argument;
    struct umbs_reader *reader = NULL;
    while (!worker->failed && !atomic_load(worker->stop)) {
        worker->failed =
            (reader == NULL && umbs_reader_open(worker->fixture->store, &reader, NULL) != UMB_OK) ||
            !look(reader);
        if (worker->reopens) {
            umbs_reader_close(reader);
            reader = NULL;
        }
        worker->answered++;
    }
    umbs_reader_close(reader);
    return NULL;
}

/* Waits until each of the threads has answered once more, or failed. */
static void wait_for_all(struct worker workers[THREADS])
{
    for (size_t i = 0; i < THREADS; i++) {
        for (unsigned seen = workers[i].answered;
             workers[i].answered == seen && !workers[i].failed;) {
            (void)sched_yield();
        }
    }
}

static void readers_look_while_versions_are_swapped_and_freed(void **state)
{
    struct fixture *f = *state;
    struct worker workers[THREADS];
    atomic_int stop = 0;
    uint8_t id[UMB_ID_BYTES];
    publish(f, 20, id);
    for (size_t i = 0; i < THREADS; i++) {
        workers[i] = (struct worker){.fixture = f, .stop = &stop, .reopens = i == 0};
        assert_int_equal(pthread_create(&workers[i].thread, NULL, work, &workers[i]), 0);
    }
    for (uint32_t round = 0; round < ROUNDS; round++) {
        struct umbs_store_counts counts;
        wait_for_all(workers);
        publish(f, 30 + round % 2 * 10, id);
        umbs_store_count(f->store, &counts);
        assert_int_equal(counts.healthy, 1);
        umbs_store_reap(f->store);
    }
    atomic_store(&stop, 1);
    for (size_t i = 0; i < THREADS; i++) {
        pthread_join(workers[i].thread, NULL);
        assert_false(workers[i].failed);
    }
    umbs_store_reap(f->store);
    assert_int_equal(alive(f), 1); /* each version but the last was freed, once */
}

int main(void)
{
#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH_STORE(reader_finds_what_was_published_before_it_looks),
        WITH_STORE(reader_takes_no_lock_of_the_store),
        WITH_STORE(reader_that_refreshes_keeps_nothing_old),
        WITH_STORE(readers_look_while_versions_are_swapped_and_freed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
