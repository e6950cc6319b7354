/* SPDX-License-Identifier: Apache-2.0 */
/*
 * State of the disk when a job is acknowledged. Syncs, renames and commits of the process are
 * intercepted by name and recorded in their order. A power cut keeps synced bytes.
 */
#define _GNU_SOURCE /* RENAME_NOREPLACE, syscall */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <cmocka.h>

#include "common/sha256.h"
#include "jobs/folder.h"
#include "jobs/service_internal.h"

#define FILES_MOST 40
#define CALLS_MOST 400

enum kind {
    SYNC,
    SYNC_ALL,
    WRITE,
    RENAME
};

struct call {
    enum kind kind;
    char path[200];
};

static struct call calls[CALLS_MOST];
static size_t call_count, fail_at; /* fail_at: the sync that fails, from 1; 0 = none */
static size_t syncs;
static pthread_mutex_t calls_mutex = PTHREAD_MUTEX_INITIALIZER;

static void note(enum kind kind, const char *path)
{
    pthread_mutex_lock(&calls_mutex);
    if (call_count < CALLS_MOST) {
        calls[call_count].kind = kind;
        snprintf(calls[call_count].path, sizeof calls[0].path, "%s", path);
        call_count++;
    }
    pthread_mutex_unlock(&calls_mutex);
}

static int note_fd(enum kind kind, int fd)
{
    char name[40], path[200];
    snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(name, path, sizeof path - 1);
    path[length > 0 ? length : 0] = '\0';
    note(kind, path);
    if (kind != WRITE && ++syncs == fail_at) {
        errno = EIO;
        return -1;
    }
    return 0;
}

#define CAUGHT __attribute__((visibility("default")))

CAUGHT int fsync(int fd)
{
    return note_fd(SYNC, fd);
}

CAUGHT int fdatasync(int fd)
{
    return note_fd(SYNC, fd);
}

CAUGHT int syncfs(int fd)
{
    return note_fd(SYNC_ALL, fd);
}

CAUGHT int renameat(int from, const char *source, int to, const char *target)
{
    note(RENAME, target);
    return (int)syscall(SYS_renameat2, from, source, to, target, 0);
}

static const char *unopened; /* a folder that no descriptor is left for */

CAUGHT int openat(int folder, const char *name, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const int mode = (flags & O_CREAT) != 0 ? va_arg(arguments, int) : 0;
    va_end(arguments);
    if (unopened != NULL && strcmp(name, unopened) == 0) {
        errno = EMFILE;
        return -1;
    }
    return (int)syscall(SYS_openat, folder, name, flags, mode);
}

CAUGHT ssize_t write(int fd, const void *bytes, size_t count)
{
    (void)note_fd(WRITE, fd);
    return (ssize_t)syscall(SYS_write, fd, bytes, count);
}

struct fixture {
    char folder[64], paths[FILES_MOST][40];
    struct umbj_service *service;
    struct umb_error error;
    struct umbj_bundle_file files[FILES_MOST];
    struct umbj_manifest manifest;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-durable-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    const struct umbj_service_options options = {
        .folder = f->folder,
        .tries.program = "/bin/false",
        .tries.workers = 1,
        .tries.threads = 1,
        .tries.timeout_ms = 10000,
        .tries.max_output_bytes = 1000,
        .max_bundle_bytes = 1000,
        .keep_ms = 1000000,
        .limits = {.owner_jobs = 8, .owner_bytes = 1000, .total_bytes = 4000, .lease_ms = 100000},
    };
    fail_at = 0;
    assert_int_equal(umbj__service_open(&options, &f->service, &f->error), UMB_OK);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    fail_at = 0;
    umbj_service_destroy(f->service);
    umbj_folder_remove(-1, f->folder);
    free(f);
    return 0;
}

/* Makes a bundle of so many files, each in a folder of its own if `deep`. */
static void make_manifest(struct fixture *f, size_t count, int deep)
{
    for (size_t i = 0; i < count; i++) {
        snprintf(f->paths[i], sizeof f->paths[i], deep ? "d%zu/f.obj" : "f%zu.obj", i);
        f->files[i] = (struct umbj_bundle_file){.path = f->paths[i], .size = 1};
        umbs_sha256_bytes("x", 1, f->files[i].sha256);
    }
    f->manifest =
        (struct umbj_manifest){.scene = f->paths[0], .files = f->files, .file_count = count};
}

/* Submits it; records the calls from the first byte to the acknowledgement. */
static enum umb_status submit(struct fixture *f)
{
    char bytes[FILES_MOST];
    struct umbj_prepared prepared;
    struct umbj_upload *upload = NULL;
    struct umbj_job job;
    memset(bytes, 'x', sizeof bytes);
    assert_int_equal(umbj_manifest_prepare(&f->manifest, 1000, &prepared, &f->error), UMB_OK);
    assert_int_equal(
        umbj_service_submit(f->service, "ann", &f->manifest, &prepared, &job, &upload, &f->error),
        UMB_OK);
    call_count = syncs = 0;
    enum umb_status status = umbj_upload_write(upload, bytes, f->manifest.file_count, &f->error);
    if (status == UMB_OK) {
        status = umbj_upload_accept(upload, &f->error);
    }
    if (status == UMB_OK) {
        status = umbj_service_accept(f->service, "ann", &f->manifest, &prepared, upload, &job,
                                     &f->error);
    }
    umbj_upload_discard(upload);
    umbj_service_drop_upload(f->service, upload);
    return status;
}

static int ends_in(const char *text, const char *ending)
{
    const size_t length = strlen(text), tail = strlen(ending);
    return length >= tail && strcmp(text + length - tail, ending) == 0;
}

/* Number of the first call from `from` on, or CALLS_MOST. */
static size_t find(size_t from, enum kind kind, const char *ending)
{
    for (size_t i = from; i < call_count; i++) {
        if (calls[i].kind == kind && ends_in(calls[i].path, ending)) {
            return i;
        }
    }
    return CALLS_MOST;
}

static size_t rename_into_bundles(void)
{
    for (size_t i = 0; i < call_count; i++) {
        if (calls[i].kind == RENAME && strncmp(calls[i].path, "bundles/", 8) == 0) {
            return i;
        }
    }
    return CALLS_MOST;
}

/* The order must be bytes, names, the bundle's name, its folder, the row: each durable before the
 * next. */
static void check_order(const struct fixture *f)
{
    const size_t renamed = rename_into_bundles();
    assert_true(renamed < CALLS_MOST);
    for (size_t i = 0; i < f->manifest.file_count; i++) {
        const size_t written = find(0, WRITE, f->paths[i]);
        assert_true(written < renamed);
        const size_t own = find(written, SYNC, f->paths[i]), all = find(written, SYNC_ALL, "");
        assert_true(own < renamed || all < renamed);
    }
    const size_t folder = find(renamed, SYNC, "/bundles"), row = find(renamed, SYNC, "jobs.db-wal");
    assert_true(folder < row);
    assert_true(row < CALLS_MOST);
}

static void a_small_bundle_is_synced_before_it_is_acknowledged(void **state)
{
    struct fixture *f = *state;
    make_manifest(f, 3, 1);
    assert_int_equal(submit(f), UMB_OK);
    check_order(f);
    const size_t renamed = rename_into_bundles();
    assert_true(find(0, SYNC_ALL, "") == CALLS_MOST); /* others' data is not waited for */
    assert_true(find(0, SYNC, "/d0") < renamed && find(0, SYNC, "/d2") < renamed);
}

static void a_bundle_of_many_files_is_synced_once(void **state)
{
    struct fixture *f = *state;
    for (int deep = 0; deep < 2; deep++) {
        make_manifest(f, FILES_MOST, deep);
        assert_int_equal(submit(f), UMB_OK);
        check_order(f);
        const size_t all = find(0, SYNC_ALL, "");
        assert_true(all < rename_into_bundles());
        for (size_t i = 0; i < call_count; i++) { /* nothing is written behind the sync */
            assert_false(calls[i].kind == WRITE && i > all && i < rename_into_bundles());
        }
        assert_true(find(all + 1, SYNC_ALL, "") == CALLS_MOST);
        assert_true(syncs <= 6); /* the bundle, its place, the row */
    }
}

static void a_sync_that_fails_is_no_acknowledgement(void **state)
{
    struct fixture *f = *state;
    for (int many = 0; many < 2; many++) {
        make_manifest(f, many ? FILES_MOST : 3, 1);
        enum umb_status status = UMB_E_IO;
        size_t failed = 0;
        for (size_t at = 1; status != UMB_OK; at++) {
            int64_t counts[UMBJ_STATE_COUNT];
            fail_at = at;
            status = submit(f);
            const int was_met = syncs >= at;
            fail_at = 0;
            assert_int_equal(umbj_table_count(f->service->table, counts, &f->error), UMB_OK);
            assert_int_equal(counts[UMBJ_QUEUED], (status == UMB_OK) + many);
            assert_true(status != UMB_OK || !was_met);
            failed += status != UMB_OK;
        }
        assert_true(failed >= (many ? 3 : 9));
    }
}

static void a_folder_that_cannot_be_opened_is_no_acknowledgement(void **state)
{
    struct fixture *f = *state;
    struct umbj_prepared prepared;
    struct umbj_upload *upload = NULL;
    make_manifest(f, 3, 1);
    assert_int_equal(umbj_manifest_prepare(&f->manifest, 1000, &prepared, &f->error), UMB_OK);
    assert_int_equal(
        umbj_upload_begin(f->folder, &f->manifest, prepared.key, NULL, &upload, &f->error), UMB_OK);
    assert_int_equal(umbj_upload_write(upload, "xxx", 3, &f->error), UMB_OK);
    unopened = "d1"; /* its names would not be synced */
    const enum umb_status status = umbj_upload_accept(upload, &f->error);
    unopened = NULL;
    assert_int_equal(status, UMB_E_IO);
    assert_non_null(strstr(f->error.message, "cannot sync"));
    umbj_upload_destroy(upload);
}

static void a_bundle_that_is_there_already_is_synced_by_name_all_the_same(void **state)
{
    struct fixture *f = *state;
    struct umbj_prepared prepared;
    struct umbj_upload *first = NULL, *second = NULL;
    make_manifest(f, 1, 0);
    assert_int_equal(umbj_manifest_prepare(&f->manifest, 1000, &prepared, &f->error), UMB_OK);
    assert_int_equal(
        umbj_upload_begin(f->folder, &f->manifest, prepared.key, NULL, &first, &f->error), UMB_OK);
    assert_int_equal(
        umbj_upload_begin(f->folder, &f->manifest, prepared.key, NULL, &second, &f->error), UMB_OK);
    assert_int_equal(umbj_upload_write(first, "x", 1, &f->error), UMB_OK);
    assert_int_equal(umbj_upload_write(second, "x", 1, &f->error), UMB_OK);
    assert_int_equal(umbj_upload_accept(first, &f->error), UMB_OK);
    call_count = syncs = 0;
    assert_int_equal(umbj_upload_accept(second, &f->error), UMB_OK);
    assert_true(find(rename_into_bundles(), SYNC, "/bundles") < CALLS_MOST);
    umbj_upload_destroy(first);
    umbj_upload_destroy(second);
}

static void a_new_folder_is_synced_in_the_one_above(void **state)
{
    struct fixture *f = *state;
    char path[100];
    snprintf(path, sizeof path, "%s/new", f->folder);
    call_count = syncs = 0;
    assert_int_equal(umbj_folder_make(AT_FDCWD, path, &f->error), UMB_OK);
    assert_true(find(0, SYNC, f->folder) < CALLS_MOST);
    snprintf(path, sizeof path, "%s/lost", f->folder);
    syncs = 0;
    fail_at = 1;
    assert_int_equal(umbj_folder_make(AT_FDCWD, path, &f->error), UMB_E_CANNOT_CREATE);
}

int main(void)
{
#define DURABILITY_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        DURABILITY_TEST(a_small_bundle_is_synced_before_it_is_acknowledged),
        DURABILITY_TEST(a_bundle_of_many_files_is_synced_once),
        DURABILITY_TEST(a_sync_that_fails_is_no_acknowledgement),
        DURABILITY_TEST(a_folder_that_cannot_be_opened_is_no_acknowledgement),
        DURABILITY_TEST(a_bundle_that_is_there_already_is_synced_by_name_all_the_same),
        DURABILITY_TEST(a_new_folder_is_synced_in_the_one_above),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
