/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Damaged job tables: every column with every kind of wrong value, and files with wrong bytes. No
 * wrong value may be run, shown as valid, or read beyond its end (ASan).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <cmocka.h>

#include "job_table_fixture.h"
#include "make_asset.h"
#include "jobs/bundle.h"
#include "jobs/worker_process.h"

#define FLIPS 300

/* SQLite's syncs: thousands of tables are made, and no power is cut. */
__attribute__((visibility("default"))) int fdatasync(int fd)
{
    (void)fd;
    return 0;
}

static const char *const job_columns[] = {
    "id",         "owner",    "key",           "state",          "failure",
    "priority",   "epoch",    "tries",         "hard_tries",     "submitted_ms",
    "started_ms", "ended_ms", "not_before_ms", "lease_until_ms", "bundle_bytes",
    "asset",      "cause",    "scene",         "settings"};

/* As SQL has them. */
static const char *const values[] = {"-1",
                                     "0",
                                     "1",
                                     "2",
                                     "4",
                                     "5",
                                     "99",
                                     "9223372036854775807",
                                     "-9223372036854775808",
                                     "1.5",
                                     "1e300",
                                     "''",
                                     "'x'",
                                     "'../../../etc/passwd'",
                                     "'-o.obj'",
                                     "'/etc/a.obj'",
                                     "'a/../b.obj'",
                                     "'--resolution=64'",
                                     "'--resolution=64' || char(10) || '--output=/x' || char(10)",
                                     "'--resolution' || char(10)",
                                     "'resolution=64' || char(10)",
                                     "char(10)",
                                     "'--resolution=64' || char(10) || char(0) || 'x'",
                                     "'a.obj' || char(0)",
                                     "x''",
                                     "x'00'",
                                     "zeroblob(31)",
                                     "zeroblob(32)",
                                     "zeroblob(33)",
                                     "zeroblob(20000)",
                                     "CAST(x'ff41' AS TEXT)",
                                     "CAST(zeroblob(9000) AS TEXT)",
                                     "replace(hex(zeroblob(5000)), '0', 'a')",
                                     "'0123456789ABCDEF0123456789ABCDEF'",
                                     "'0123456789abcdef0123456789abcdef'",
                                     "char(27) || '[2J'"};

/* Runs one SQL statement with the program's own checks switched off. */
static int tamper(struct fixture *f, const char *text)
{
    sqlite3 *database = NULL;
    assert_int_equal(sqlite3_open(f->path, &database), SQLITE_OK);
    (void)sqlite3_busy_timeout(database, 5000);
    const int code = sqlite3_exec(database, text, NULL, NULL, NULL);
    assert_int_equal(sqlite3_close(database), SQLITE_OK);
    return code;
}

/* A queued, a running and a done job, in this order. */
static void fill(struct fixture *f)
{
    struct umbj_job job, done;
    int is_new;
    assert_int_equal(submit_as(f, "ann", 1, 0, 1000, &done, &is_new), UMB_OK);
    assert_int_equal(umbj_table_claim(f->table, 1000, 1000, &done, &f->error), UMB_OK);
    finish(f, &done, 7);
    assert_int_equal(submit_as(f, "ann", 2, 0, 1000, &job, &is_new), UMB_OK);
    assert_int_equal(umbj_table_claim(f->table, 1001, 1001, &job, &f->error), UMB_OK);
    assert_int_equal(submit_as(f, "bob", 3, 0, 1000, &job, &is_new), UMB_OK);
}

/* The settings and files that a worker gets must be valid in a manifest. */
static void check_spec(struct fixture *f, const struct umbj_job *job)
{
    char scene[UMBJ_SCENE_SIZE], *settings = malloc(UMBJ_SETTINGS_SIZE);
    struct umbj_words words = {0};
    assert_non_null(settings);
    assert_int_equal(strspn(job->id, "0123456789abcdef"), UMBJ_ID_SIZE - 1);
    const enum umb_status status = umbj_table_spec(f->table, job->id, scene, settings, &f->error);
    if (status == UMB_OK) {
        assert_int_equal(umbj_scene_check(scene, &f->error), UMB_OK);
        assert_int_equal(umbj_settings_check(settings, &f->error), UMB_OK);
        umbj_words_add_settings(&words, settings, 2048);
        for (size_t i = 0; i < words.count; i++) {
            assert_memory_equal(words.list[i], "--", 2);
            assert_null(strstr(words.list[i], "--output"));
        }
        umbj_words_finish(&words);
    } else {
        assert_int_equal(status, UMB_E_CORRUPT);
        assert_non_null(strstr(f->error.message, "damaged"));
    }
    free(settings);
}

static void check_shown(const struct umbj_job *job)
{
    assert_int_equal(strlen(job->id), UMBJ_ID_SIZE - 1);
    assert_true((unsigned)job->state < UMBJ_STATE_COUNT);
    assert_true((unsigned)job->failure < UMBJ_FAILURE_COUNT);
    assert_true(job->submitted_ms >= 0 && job->ended_ms >= 0 && job->bundle_bytes >= 0);
    assert_true(job->state != UMBJ_DONE || job->has_asset);
    if (job->damage != NULL) {
        assert_int_equal(job->state, UMBJ_FAILED);
        assert_non_null(strstr(job->cause, job->damage));
    }
    for (const char *at = job->cause; *at != '\0'; at++) {
        assert_true((unsigned char)*at >= ' ');
    }
}

static void count_owned(void *user, const uint8_t *asset, const char *owner)
{
    (void)asset;
    assert_true(strlen(owner) < UMBJ_OWNER_SIZE);
    ++*(int *)user;
}

/* Does everything that a service does with a table. Failures are allowed if they are reported. */
static void use(struct fixture *f)
{
    struct umbj_job job, *jobs = NULL;
    size_t count = 0;
    uint8_t key[UMBJ_HASH_BYTES], asset[UMBJ_HASH_BYTES];
    int64_t bake_ms = 0, when = 0;
    int owned = 0;
    for (int i = 0; i < 8 && umbj_table_claim(f->table, 5000 + i, 5000, &job, &f->error) == UMB_OK;
         i++) {
        check_spec(f, &job);
        (void)!umbj_table_renew(f->table, job.id, job.epoch, 6000, &f->error);
        (void)!umbj_table_fail(f->table, &job, UMBJ_TEMPORARY, "it did not work", 7000, &f->error);
    }
    if (umbj_table_list(f->table, NULL, 100, &jobs, &count, &f->error) == UMB_OK) {
        for (size_t i = 0; i < count; i++) {
            check_shown(&jobs[i]);
            if (umbj_table_get(f->table, jobs[i].id, NULL, &job, &f->error) == UMB_OK) {
                check_shown(&job);
            }
        }
        free(jobs);
    }
    for (unsigned i = 1; i < 4; i++) {
        key_of(i, key);
        if (umbj_table_find_same(f->table, "ann", key, &job, &f->error) == UMB_OK) {
            check_shown(&job);
        }
        if (umbj_table_find_bake(f->table, key, asset, &bake_ms, &f->error) == UMB_OK) {
            assert_true(bake_ms >= 0);
            (void)!umbj_table_asset(f->table, asset, "ann", &owned, &f->error);
        }
    }
    for (int i = 0; i < 8 && umbj_table_expired(f->table, INT64_MAX, &job, &f->error) == UMB_OK;
         i++) {
        check_shown(&job);
        (void)!umbj_table_fail(f->table, &job, UMBJ_LOST, "lost", 9000, &f->error);
    }
    owned = 0;
    (void)!umbj_table_owned(f->table, count_owned, &owned, &f->error);
    (void)!umbj_table_next_start(f->table, 1, &when, &f->error);
    for (int i = 0; i < 8 && umbj_table_unowned(f->table, asset, &f->error) == UMB_OK; i++) {
        (void)!umbj_table_forget(f->table, asset, &f->error);
    }
    (void)!umbj_table_trim(f->table, "ann", &f->error);
    (void)!umbj_table_check_quota(f->table, "ann", 1, NULL, &f->error);
}

/* Restores the same file for the next case: it is written once, then copied. */
static void begin_anew(struct fixture *f)
{
    static const char *const ends[] = {"", "-wal", "-shm"};
    static char whole[1 << 18];
    static ssize_t size;
    char path[128];
    umbj_table_close(f->table);
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s%s", f->path, ends[i]);
        unlink(path);
    }
    if (size == 0) {
        assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_OK);
        fill(f);
        umbj_table_close(f->table);
        int fd = open(f->path, O_RDONLY);
        size = read(fd, whole, sizeof whole);
        assert_true(size > 0 && size < (ssize_t)sizeof whole);
        close(fd);
    }
    int fd = open(f->path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    assert_int_equal(write(fd, whole, (size_t)size), size);
    close(fd);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_OK);
}

static void count_jobs(struct fixture *f, int64_t counts[UMBJ_STATE_COUNT])
{
    assert_int_equal(umbj_table_count(f->table, counts, &f->error), UMB_OK);
}

static void no_value_in_a_job_row_is_believed(void **state)
{
    struct fixture *f = *state;
    char text[400];
    int64_t lost = 0, retired = 0;
    const size_t step = (size_t)short_count(1, 4); /* the short form: each column and each value */
    for (size_t c = 0; c < sizeof job_columns / sizeof job_columns[0]; c++) {
        for (size_t v = c % step; v < sizeof values / sizeof values[0]; v += step) {
            for (int at_start = 0; at_start < 2; at_start++) { /* or while it runs */
                begin_anew(f);
                snprintf(text, sizeof text, "UPDATE job SET %s = %s WHERE seq = %zu",
                         job_columns[c], values[v], 1 + (v + c) % 3);
                (void)tamper(f, text); /* what SQLite itself refuses is no case */
                if (at_start) {
                    reopen(f);
                    assert_int_equal(umbj_table_recover(f->table, 4000, &lost, &f->error), UMB_OK);
                }
                use(f);
                retired += umbj_table_damaged(f->table);
            }
        }
    }
    assert_true(retired > (int64_t)(300 / step));
}

static void no_value_beside_the_jobs_is_believed(void **state)
{
    static const char *const places[] = {
        "asset SET id",    "asset SET bytes", "asset SET owners",      "owned SET asset",
        "owned SET owner", "bake SET key",    "bake SET asset",        "bake SET bake_ms",
        "turn SET owner",  "turn SET number", "state_count SET count", "tally SET owner",
        "tally SET jobs",  "tally SET bytes"};
    struct fixture *f = *state;
    char text[400];
    int64_t lost = 0, counts[UMBJ_STATE_COUNT];
    const size_t step = (size_t)short_count(1, 4);
    for (size_t p = 0; p < sizeof places / sizeof places[0]; p++) {
        for (size_t v = p % step; v < sizeof values / sizeof values[0]; v += step) {
            begin_anew(f);
            snprintf(text, sizeof text, "UPDATE %s = %s", places[p], values[v]);
            (void)tamper(f, text);
            use(f);
            begin_anew(f);
            (void)tamper(f, text);
            reopen(f);
            assert_int_equal(umbj_table_recover(f->table, 4000, &lost, &f->error), UMB_OK);
            count_jobs(f, counts);
            assert_int_equal(counts[UMBJ_DONE], 1); /* the counts are the rows' again */
            assert_int_equal(counts[UMBJ_QUEUED], 2);
            use(f);
        }
    }
}

static void a_damaged_row_is_failed_with_its_cause_and_the_others_run(void **state)
{
    struct fixture *f = *state;
    struct umbj_job job, *jobs = NULL;
    size_t count = 0;
    int64_t lost = 0;
    fill(f);
    assert_int_equal(tamper(f, "UPDATE job SET priority = 1000 WHERE seq = 3"), SQLITE_OK);
    assert_int_equal(umbj_table_list(f->table, "bob", 10, &jobs, &count, &f->error), UMB_OK);
    assert_int_equal(count, 1);
    assert_int_equal(jobs[0].state, UMBJ_FAILED);
    assert_non_null(strstr(jobs[0].cause, "priority"));
    free(jobs);
    assert_int_equal(umbj_table_claim(f->table, 5000, 5000, &job, &f->error), UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_damaged(f->table), 1);
    int is_new = 0;
    assert_int_equal(submit_as(f, "bob", 3, 0, 6000, &job, &is_new), UMB_OK);
    assert_true(is_new);
    assert_int_equal(umbj_table_claim(f->table, 6000, 6000, &job, &f->error), UMB_OK);
    assert_int_equal(tamper(f, "UPDATE job SET owner = char(10) WHERE seq = 3"), SQLITE_OK);
    reopen(f);
    assert_int_equal(umbj_table_recover(f->table, 7000, &lost, &f->error), UMB_OK);
    assert_int_equal(lost, 2);
    assert_int_equal(umbj_table_list(f->table, NULL, 10, &jobs, &count, &f->error), UMB_OK);
    assert_int_equal(count, 3); /* the one without an owner is gone */
    free(jobs);
}

static void many_damaged_rows_are_all_found_at_a_start(void **state)
{
    struct fixture *f = *state;
    struct umbj_job job;
    int is_new;
    int64_t lost = 0, counts[UMBJ_STATE_COUNT];
    char owner[16];
    for (unsigned i = 0; i < 150; i++) {
        snprintf(owner, sizeof owner, "o%u", i);
        assert_int_equal(submit_as(f, owner, i % 30, 0, 1000, &job, &is_new), UMB_OK);
    }
    assert_int_equal(tamper(f, "UPDATE job SET tries = 1000 WHERE seq <> 70"), SQLITE_OK);
    reopen(f);
    assert_int_equal(umbj_table_recover(f->table, 7000, &lost, &f->error), UMB_OK);
    count_jobs(f, counts);
    assert_int_equal(counts[UMBJ_FAILED], 149);
    assert_int_equal(counts[UMBJ_QUEUED], 1);
    assert_int_equal(umbj_table_damaged(f->table), 149);
}

static void flip(const char *path, uint64_t *random, unsigned count)
{
    int fd = open(path, O_RDWR);
    assert_true(fd >= 0);
    const off_t size = lseek(fd, 0, SEEK_END);
    for (unsigned i = 0; i < count; i++) {
        *random = *random * UINT64_C(6364136223846793005) + 1;
        const uint8_t byte = (uint8_t)(*random >> 56);
        assert_int_equal(pwrite(fd, &byte, 1, (off_t)((*random >> 20) % (uint64_t)size)), 1);
    }
    close(fd);
}

static void wrong_bytes_in_the_file_are_an_error_or_are_mended(void **state)
{
    struct fixture *f = *state;
    uint64_t random = 1;
    unsigned refused = 0;
    int64_t lost = 0;
    for (unsigned i = 0; i < FLIPS; i++) {
        begin_anew(f);
        umbj_table_close(f->table);
        f->table = NULL;
        flip(f->path, &random, 1 + i % 12);
        const enum umb_status status = umbj_table_open(f->path, &limits, &f->table, &f->error);
        refused += status != UMB_OK;
        if (status == UMB_E_CORRUPT) {
            assert_true(strlen(f->error.message) > 20);
        }
        if (status == UMB_OK && umbj_table_recover(f->table, 4000, &lost, &f->error) == UMB_OK) {
            use(f);
        }
        umbj_table_close(f->table);
        f->table = NULL;
        unlink(f->path);
    }
    assert_true(refused > FLIPS / 20 && refused < FLIPS);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_OK);
}

static void a_damaged_page_is_told_with_the_files_name(void **state)
{
    struct fixture *f = *state;
    char zeros[1024] = {0};
    for (unsigned i = 0; i < 60; i++) {
        struct umbj_job job;
        int is_new;
        char owner[16];
        snprintf(owner, sizeof owner, "o%u", i);
        assert_int_equal(submit_as(f, owner, i % 30, 0, 1000, &job, &is_new), UMB_OK);
    }
    umbj_table_close(f->table);
    f->table = NULL;
    int fd = open(f->path, O_RDWR);
    const off_t size = lseek(fd, 0, SEEK_END);
    for (off_t at = 4096 * 3; at < size; at += 4096) { /* the beginning of pages behind the first */
        assert_int_equal(pwrite(fd, zeros, sizeof zeros, at), sizeof zeros);
    }
    close(fd);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_E_CORRUPT);
    assert_non_null(strstr(f->error.message, f->path));
    assert_non_null(strstr(f->error.message, "recover"));
    unlink(f->path);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_OK);
}

/* Version 1 of the table had neither sizes nor counts. */
static void a_table_of_the_version_before_is_brought_up_to_date(void **state)
{
    struct fixture *f = *state;
    int64_t counts[UMBJ_STATE_COUNT], lost = 0;
    struct umbj_kept kept;
    uint8_t asset[UMBJ_HASH_BYTES];
    fill(f);
    assert_int_equal(
        tamper(f, "DROP TRIGGER job_added; DROP TRIGGER job_moved; DROP TRIGGER job_removed;"
                  " DROP TRIGGER owned_added; DROP TRIGGER owned_removed; DROP TRIGGER asset_sized;"
                  " DROP TABLE state_count; DROP TABLE tally; DROP INDEX asset_unowned; DROP INDEX"
                  " job_over; ALTER TABLE asset DROP COLUMN bytes; ALTER TABLE asset DROP COLUMN"
                  " owners; PRAGMA user_version = 1"),
        SQLITE_OK);
    reopen(f);
    count_jobs(f, counts);
    assert_int_equal(counts[UMBJ_DONE], 1);
    assert_int_equal(umbj_table_recover(f->table, 4000, &lost, &f->error), UMB_OK);
    key_of(7, asset);
    assert_int_equal(umbj_table_announce(f->table, asset, 500, &f->error), UMB_OK);
    assert_int_equal(umbj_table_kept(f->table, "ann", &kept, &f->error), UMB_OK);
    assert_int_equal(kept.asset_bytes, 500);
    assert_int_equal(kept.jobs, 1);
    assert_int_equal(tamper(f, "PRAGMA user_version = 3"), SQLITE_OK);
    umbj_table_close(f->table);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_E_VERSION);
    unlink(f->path);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_OK);
}

/* Checks settings as the words of a command line, whatever checked them before. */
static void settings_without_a_last_newline_are_read_to_their_end(void **state)
{
    char *settings = strdup("--static\n--resolution=128"); /* ends where its block ends */
    struct umbj_words words = {0};
    (void)state;
    assert_non_null(settings);
    assert_true(umbj_settings_have(settings, "--resolution=128"));
    assert_false(umbj_settings_have(settings, "--resolution"));
    assert_int_equal(umbj_tile_edge(settings, 2048), 128);
    umbj_words_add_settings(&words, settings, 2048);
    assert_int_equal(words.count, 3);
    assert_string_equal(words.list[1], "--resolution=128");
    assert_string_equal(words.list[2], "--tile=128");
    umbj_words_finish(&words);
    free(settings);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        TABLE_TEST(no_value_in_a_job_row_is_believed),
        TABLE_TEST(no_value_beside_the_jobs_is_believed),
        TABLE_TEST(a_damaged_row_is_failed_with_its_cause_and_the_others_run),
        TABLE_TEST(many_damaged_rows_are_all_found_at_a_start),
        TABLE_TEST(wrong_bytes_in_the_file_are_an_error_or_are_mended),
        TABLE_TEST(a_damaged_page_is_told_with_the_files_name),
        TABLE_TEST(a_table_of_the_version_before_is_brought_up_to_date),
        cmocka_unit_test(settings_without_a_last_newline_are_read_to_their_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
