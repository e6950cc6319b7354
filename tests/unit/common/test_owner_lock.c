/* SPDX-License-Identifier: Apache-2.0 */
/* A lock file must have one owner: on this machine by locks, between machines by a number that its
 * owner keeps changing. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tool/clock.h"
#include "common/owner_lock.h"
#include "folder_fixture.h"

#define WATCH_MS 600

struct fixture {
    struct folder folder;
    char path[128];
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    snprintf(f->path, sizeof f->path, "%s/lock", f->folder.path);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    folder_remove(&f->folder);
    free(f);
    return 0;
}

/* Writes what an owner on another machine left, or keeps writing. */
static void write_owner(const struct fixture *f, unsigned number)
{
    FILE *file = fopen(f->path, "w");
    assert_non_null(file);
    fprintf(file, "far-host 11111111-2222-3333-4444-555555555555 4711 0123456789abcdef %u\n",
            number);
    assert_int_equal(fclose(file), 0);
}

static void second_owner_is_refused_and_told_who_is_the_first(void **state)
{
    struct fixture *f = *state;
    struct umbs_owner_lock first, second;
    struct umb_error error;
    char host[128] = "", pid[32];
    assert_int_equal(umbs_owner_lock_take(f->path, &first, &error), UMB_OK);
    assert_int_equal(umbs_owner_lock_take(f->path, &second, &error), UMB_E_BUSY);
    (void)gethostname(host, sizeof host - 1);
    snprintf(pid, sizeof pid, "pid %ld ", (long)getpid());
    assert_non_null(strstr(error.message, pid));
    assert_non_null(strstr(error.message, host));
    assert_int_equal(umbs_owner_lock_beat(&first, &error), UMB_OK);
    umbs_owner_lock_release(&second);
    umbs_owner_lock_release(&first);
    assert_int_equal(umbs_owner_lock_take(f->path, &second, &error), UMB_OK);
    umbs_owner_lock_release(&second);
}

static void owner_that_was_killed_is_followed_at_once(void **state)
{
    struct fixture *f = *state;
    struct umbs_owner_lock lock;
    struct umb_error error;
    static const enum umbs_reach reaches[] = {UMBS_REACH_LOCAL, UMBS_REACH_UNKNOWN};
    for (size_t i = 0; i < 2; i++) {
        const pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) { /* the same boot: its lock is gone with it */
            _exit(umbs__owner_lock_take(f->path, reaches[i], WATCH_MS, &lock, &error) != UMB_OK);
        }
        int status = 1;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_int_equal(status, 0);
        assert_true(folder_size(&f->folder, "lock") > 0);
        const int64_t from = umbu_clock_ms();
        assert_int_equal(umbs__owner_lock_take(f->path, reaches[i], 600000, &lock, &error), UMB_OK);
        assert_true(umbu_clock_ms() - from < 300000);
        umbs_owner_lock_release(&lock);
    }
}

static void line_of_another_machine_is_believed_only_where_locks_are_not_enough(void **state)
{
    struct fixture *f = *state;
    struct umbs_owner_lock lock;
    struct umb_error error;
    write_owner(f, 5);
    assert_int_equal(umbs__owner_lock_take(f->path, UMBS_REACH_LOCAL, 600000, &lock, &error),
                     UMB_OK);
    umbs_owner_lock_release(&lock);
    write_owner(f, 5);
    const int64_t from = umbu_clock_ms();
    assert_int_equal(umbs__owner_lock_take(f->path, UMBS_REACH_NETWORK, WATCH_MS, &lock, &error),
                     UMB_OK);
    assert_true(umbu_clock_ms() - from >= WATCH_MS); /* its number stood still for so long */
    umbs_owner_lock_release(&lock);
}

struct beating {
    struct fixture *fixture;
    atomic_int stop;
};

static void *beat(void *user)
{
    struct beating *beating = user;
    const struct timespec pause = {.tv_nsec = 20 * 1000000L};
    for (unsigned number = 10; !atomic_load(&beating->stop); number++) {
        write_owner(beating->fixture, number);
        (void)nanosleep(&pause, NULL);
    }
    return NULL;
}

static void owner_on_another_machine_that_is_alive_is_not_followed(void **state)
{
    struct fixture *f = *state;
    struct beating beating = {.fixture = f};
    struct umbs_owner_lock lock;
    struct umb_error error;
    pthread_t thread;
    write_owner(f, 9);
    assert_int_equal(pthread_create(&thread, NULL, beat, &beating), 0);
    enum umb_status status = UMB_OK;
    for (int i = 0; i < 50; i++) { /* a look may fall between truncation and writing */
        status = umbs__owner_lock_take(f->path, UMBS_REACH_NETWORK, 60000, &lock, &error);
        if (status == UMB_E_BUSY) {
            break;
        }
        umbs_owner_lock_release(&lock);
    }
    atomic_store(&beating.stop, 1);
    pthread_join(thread, NULL);
    assert_int_equal(status, UMB_E_BUSY);
    assert_non_null(strstr(error.message, "pid 4711 on host 'far-host'"));
}

static void owner_that_was_followed_finds_out_by_its_next_beat(void **state)
{
    struct fixture *f = *state;
    struct umbs_owner_lock lock;
    struct umb_error error;
    assert_int_equal(umbs__owner_lock_take(f->path, UMBS_REACH_NETWORK, WATCH_MS, &lock, &error),
                     UMB_OK);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(umbs_owner_lock_beat(&lock, &error), UMB_OK);
    }
    write_owner(f, 1);
    assert_int_equal(umbs_owner_lock_beat(&lock, &error), UMB_E_STATE);
    assert_non_null(strstr(error.message, "far-host"));
    umbs_owner_lock_release(&lock);
    assert_true(folder_size(&f->folder, "lock") > 0); /* the line of the other stays */
}

static void file_that_was_removed_is_no_lock(void **state)
{
    struct fixture *f = *state;
    struct umbs_owner_lock first, second;
    struct umb_error error;
    assert_int_equal(umbs_owner_lock_take(f->path, &first, &error), UMB_OK);
    assert_true(umbs_owner_lock_is_there(&first));
    assert_int_equal(unlink(f->path), 0);
    assert_false(umbs_owner_lock_is_there(&first));
    assert_int_equal(umbs_owner_lock_take(f->path, &second, &error), UMB_OK);
    assert_false(umbs_owner_lock_is_there(&first));
    umbs_owner_lock_release(&first);
    umbs_owner_lock_release(&second);
}

int main(void)
{
#define LOCK_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        LOCK_TEST(second_owner_is_refused_and_told_who_is_the_first),
        LOCK_TEST(owner_that_was_killed_is_followed_at_once),
        LOCK_TEST(line_of_another_machine_is_believed_only_where_locks_are_not_enough),
        LOCK_TEST(owner_on_another_machine_that_is_alive_is_not_followed),
        LOCK_TEST(owner_that_was_followed_finds_out_by_its_next_beat),
        LOCK_TEST(file_that_was_removed_is_no_lock),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
