/* SPDX-License-Identifier: Apache-2.0 */
/* The place of the job table, and the rule that one daemon uses it. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "jobs/folder.h"
#include "jobs/job_place.h"
#include "jobs/job_sql.h"

struct fixture {
    char folder[64], jobs[100], other[100], table[120];
    struct umb_error error;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-place-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->jobs, sizeof f->jobs, "%s/jobs", f->folder);
    snprintf(f->other, sizeof f->other, "%s/other", f->folder);
    snprintf(f->table, sizeof f->table, "%s/state.db", f->folder);
    assert_int_equal(mkdir(f->jobs, 0700), 0);
    assert_int_equal(mkdir(f->other, 0700), 0);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbj_folder_remove(AT_FDCWD, f->folder);
    free(f);
    return 0;
}

static void table_is_in_the_folder_or_where_the_option_says(void **state)
{
    struct fixture *f = *state;
    struct umbj_place place;
    char wanted[140];
    assert_int_equal(umbj_place_check(f->jobs, NULL, &place, &f->error), UMB_OK);
    snprintf(wanted, sizeof wanted, "%s/jobs.db", f->jobs);
    assert_string_equal(place.table_path, wanted);
    assert_int_equal(umbj_place_check(f->jobs, f->table, &place, &f->error), UMB_OK);
    assert_string_equal(place.table_path, f->table);
    umbj_place_release(&place);
}

static void second_daemon_on_the_folder_or_the_table_is_refused_by_name(void **state)
{
    struct fixture *f = *state;
    struct umbj_place first, second;
    char pid[32];
    snprintf(pid, sizeof pid, "pid %ld on host", (long)getpid());
    assert_int_equal(umbj_place_take(f->jobs, f->table, &first, &f->error), UMB_OK);
    assert_int_equal(umbj_place_take(f->jobs, NULL, &second, &f->error), UMB_E_BUSY);
    assert_non_null(strstr(f->error.message, "--jobs: "));
    assert_non_null(strstr(f->error.message, pid));
    assert_int_equal(umbj_place_take(f->other, f->table, &second, &f->error), UMB_E_BUSY);
    assert_non_null(strstr(f->error.message, "--jobs-db: "));
    assert_non_null(strstr(f->error.message, pid));
    /* A refused open must release everything that it took. */
    assert_int_equal(umbj_place_take(f->other, NULL, &second, &f->error), UMB_OK);
    umbj_place_release(&second);
    assert_int_equal(umbj_place_beat(&first, &f->error), UMB_OK);
    umbj_place_release(&first);
    assert_int_equal(umbj_place_take(f->other, f->table, &second, &f->error), UMB_OK);
    umbj_place_release(&second);
}

static void table_that_would_be_left_behind_is_told_of(void **state)
{
    struct fixture *f = *state;
    struct umbj_place place;
    char old[140];
    snprintf(old, sizeof old, "%s/jobs.db", f->jobs);
    assert_true(close(open(old, O_CREAT | O_WRONLY, 0600)) == 0);
    assert_int_equal(umbj_place_take(f->jobs, f->table, &place, &f->error), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "move jobs.db"));
    assert_int_equal(rename(old, f->table), 0);
    assert_int_equal(umbj_place_take(f->jobs, f->table, &place, &f->error), UMB_OK);
    umbj_place_release(&place);
}

static void table_in_a_folder_of_others_is_refused(void **state)
{
    struct fixture *f = *state;
    struct umbj_place place;
    char table[140];
    snprintf(table, sizeof table, "%s/state.db", f->other);
    assert_int_equal(chmod(f->other, 0770), 0);
    assert_int_equal(umbj_place_take(f->jobs, table, &place, &f->error), UMB_E_PERMISSION);
    assert_non_null(strstr(f->error.message, "0770"));
    assert_int_equal(chmod(f->other, 0700), 0);
    assert_int_equal(umbj_place_take(f->jobs, table, &place, &f->error), UMB_OK);
    umbj_place_release(&place);
    snprintf(table, sizeof table, "%s/nowhere/state.db", f->other);
    assert_int_equal(umbj_place_take(f->jobs, table, &place, &f->error), UMB_E_NO_INPUT);
}

static void database_that_cannot_have_its_journal_is_refused(void **state)
{
    struct fixture *f = *state;
    struct umbj_sql sql;
    /* A table in memory has no write-ahead log; one on a network file system may have none,
     * either. */
    assert_int_equal(umbj_sql_open(":memory:", &sql, &f->error), UMB_E_UNSUPPORTED);
    assert_non_null(strstr(f->error.message, "'memory', not 'wal'"));
    assert_non_null(strstr(f->error.message, "--jobs-db"));
    assert_int_equal(umbj_sql_open(f->table, &sql, &f->error), UMB_OK);
    umbj_sql_close(&sql);
}

int main(void)
{
#define PLACE_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        PLACE_TEST(table_is_in_the_folder_or_where_the_option_says),
        PLACE_TEST(second_daemon_on_the_folder_or_the_table_is_refused_by_name),
        PLACE_TEST(table_that_would_be_left_behind_is_told_of),
        PLACE_TEST(table_in_a_folder_of_others_is_refused),
        PLACE_TEST(database_that_cannot_have_its_journal_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
