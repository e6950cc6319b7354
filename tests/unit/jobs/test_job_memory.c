/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Each allocation of the job service fails in turn. The call must fail with a status or work
 * without the memory, and leave nothing half made. The test is skipped under sanitizers, which have
 * allocators of their own.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "base/compat.h"
#include "common/sha256.h"
#include "jobs/worker_process.h"
#include "jobs/folder.h"
#include "jobs/service_internal.h"
#include "jobs/farm.h"
#include "jobs/staging.h"

static _Thread_local long left = -1; /* allocations until one is refused; below 0: none is */
static _Thread_local int refused;

#if !UMB__SANITIZED
#define CAUGHT __attribute__((visibility("default")))
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);

static int refuse(void)
{
    if (left < 0 || left-- > 0) {
        return 0;
    }
    refused = 1;
    errno = ENOMEM;
    return 1;
}

CAUGHT void *malloc(size_t size)
{
    return refuse() ? NULL : __libc_malloc(size);
}

CAUGHT void *calloc(size_t count, size_t size)
{
    return refuse() ? NULL : __libc_calloc(count, size);
}

CAUGHT void *realloc(void *old, size_t size)
{
    return refuse() ? NULL : __libc_realloc(old, size);
}
#endif

/* SQLite's commits: no power is cut here. */
__attribute__((visibility("default"))) int fdatasync(int fd)
{
    (void)fd;
    return 0;
}

struct fixture {
    char folder[64];
    struct umbj_service *service;
    struct umb_error error;
};

static struct umbj_service_options options_of(const struct fixture *f)
{
    return (struct umbj_service_options){
        .folder = f->folder,
        .tries.program = "/bin/false",
        .tries.workers = 1,
        .tries.threads = 1,
        .tries.timeout_ms = 10000,
        .tries.max_output_bytes = 1000,
        .max_bundle_bytes = 1000,
        .keep_ms = (uint64_t)1 << 50,
        .limits = {.owner_jobs = 100000,
                   .owner_bytes = 1000000,
                   .total_bytes = 1000000,
                   .lease_ms = 100000},
    };
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-memory-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    left = -1;
    umbj_service_destroy(f->service);
    umbj_folder_remove(-1, f->folder);
    free(f);
    return 0;
}

/* Fails each allocation of some work once, one at a time; returns their number. */
static long sweep(struct fixture *f, enum umb_status (*work)(struct fixture *f, unsigned number))
{
    long count = 0;
    do {
        refused = 0;
        left = count;
        const enum umb_status status = work(f, (unsigned)count);
        left = -1;
        if (status != UMB_OK && !refused) {
            fail_msg("%s", f->error.message);
        }
        if (status != UMB_OK) {
            assert_true(strlen(f->error.message) > 0);
        }
        count += 1 + count / 50; /* SQLite makes many, and they are alike */
    } while (refused && count < 50000);
    assert_true(count < 50000);
    return count;
}

static enum umb_status open_and_close(struct fixture *f, unsigned number)
{
    const struct umbj_service_options options = options_of(f);
    (void)number;
    const enum umb_status status = umbj_service_create(&options, &f->service, &f->error);
    assert_int_equal(f->service != NULL, status == UMB_OK);
    umbj_service_destroy(f->service);
    f->service = NULL;
    return status;
}

static enum umb_status submit(struct fixture *f, unsigned number)
{
    char path[32];
    struct umbj_bundle_file files[2] = {{.path = path, .size = 1}, {.path = "t/u/b", .size = 1}};
    const struct umbj_setting setting = {"resolution", "64"};
    const struct umbj_manifest manifest = {
        .scene = path, .files = files, .file_count = 2, .settings = &setting, .setting_count = 1};
    struct umbj_prepared prepared;
    struct umbj_upload *upload = NULL;
    struct umbj_job job, *jobs = NULL;
    size_t count = 0;
    snprintf(path, sizeof path, "%u.obj", number);
    umbs_sha256_bytes("x", 1, files[0].sha256);
    umbs_sha256_bytes("x", 1, files[1].sha256);
    enum umb_status status = umbj_manifest_prepare(&manifest, 1000, &prepared, &f->error);
    if (status == UMB_OK) {
        status =
            umbj_service_submit(f->service, "ann", &manifest, &prepared, &job, &upload, &f->error);
    }
    if (status == UMB_OK) {
        status = umbj_upload_write(upload, "xx", 2, &f->error);
    }
    if (status == UMB_OK) {
        status = umbj_upload_accept(upload, &f->error);
    }
    if (status == UMB_OK) {
        status =
            umbj_service_accept(f->service, "ann", &manifest, &prepared, upload, &job, &f->error);
    }
    umbj_upload_discard(upload);
    umbj_service_drop_upload(f->service, upload);
    if (status == UMB_OK) {
        status = umbj_service_list(f->service, "ann", 20, &jobs, &count, &f->error);
        free(jobs);
    }
    return status;
}

static enum umb_status work_and_end(struct fixture *f, unsigned number)
{
    struct umbj_job job;
    struct umb_error error;
    umbj__service_turn(f->service, 0);
    (void)number;
    enum umb_status status = umbj_table_claim(f->service->table, 1000, 1000, &job, &f->error);
    if (status == UMB_E_NOT_FOUND) {
        return UMB_OK;
    }
    if (status == UMB_OK) {
        struct umbj_report report = {
            .kind = UMBJ_REPORT_PLAN, .epoch = job.epoch, .staged = {.fd = -1}, .text = "plan"};
        memcpy(report.job, job.id, sizeof report.job);
        umbj__take_report(f->service, &report);
        report.kind = UMBJ_REPORT_NOTICE;
        umbj__take_report(f->service, &report);
        status = umbj_service_cancel(f->service, job.id, "ann", &job, &f->error);
        uint8_t asset[UMBJ_HASH_BYTES] = {(uint8_t)number};
        umbj_snapshot_own(f->service->snapshot, asset, "ann");
        umbj_snapshot_disown(f->service->snapshot, asset, NULL);
        (void)!umbj_service_delete(f->service, asset, "ann", &error);
    }
    return status;
}

static enum umb_status words_and_farm(struct fixture *f, unsigned number)
{
    struct umbj_words words = {0};
    struct umbj_farm *farm = NULL;
    const struct umbj_slurm_options slurm = {
        .words = "-p bake", .tag_of = f->folder, .search = "/bin", .configuration = "/etc/x"};
    (void)number;
    umbj_words_add(&words, "%s", "program");
    umbj_words_add_settings(&words, "--static\n--resolution=64\n", 64);
    enum umb_status status = words.failed ? umb_fail(&f->error, UMB_E_NO_MEMORY, "words") : UMB_OK;
    umbj_words_finish(&words);
    if (status == UMB_OK) {
        status = umbj_slurm_farm_create(&slurm, &farm, &f->error);
    }
    if (farm != NULL) {
        farm->destroy(farm);
    }
    return status;
}

static void a_refused_allocation_is_a_failure_that_is_told(void **state)
{
    struct fixture *f = *state;
#if UMB__SANITIZED
    (void)f;
    skip();
#endif
    assert_true(sweep(f, words_and_farm) > 8);
    assert_true(sweep(f, open_and_close) > 30);
    const struct umbj_service_options options = options_of(f);
    assert_int_equal(umbj__service_open(&options, &f->service, &f->error), UMB_OK);
    assert_true(sweep(f, submit) > 30);
    (void)sweep(f, work_and_end);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_refused_allocation_is_a_failure_that_is_told, setup,
                                        teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
