/* SPDX-License-Identifier: Apache-2.0 */
/* The job service's thread: it must make progress while a caller keeps it busy. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "common/sha256.h"
#include "jobs/folder.h"
#include "jobs/service_internal.h"
#include "jobs/staging.h"

#define CONTENT "v 0 0 0\n"
#define STEP_MS 10
#define STEPS   1000 /* ten seconds */

struct fixture {
    char folder[64], jobs[80];
    struct umbj_service *service;
    struct umb_error error;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-service-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->jobs, sizeof f->jobs, "%s/jobs", f->folder);
    const struct umbj_service_options options = {
        .folder = f->jobs,
        .tries.program = "/bin/false",
        .tries.workers = 1,
        .tries.threads = 1,
        .tries.timeout_ms = 10000,
        .tries.max_output_bytes = 1000,
        .max_bundle_bytes = 1000,
        .keep_ms = 1000000,
        .limits = {.owner_jobs = 8, .owner_bytes = 1000, .total_bytes = 4000, .lease_ms = 100000},
    };
    assert_int_equal(umbj_service_create(&options, &f->service, &f->error), UMB_OK);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbj_service_destroy(f->service);
    umbj_folder_remove(-1, f->folder); /* an absolute path: no folder to start from is needed */
    free(f);
    return 0;
}

/* A request that is posted again as soon as it is done, and takes some time, as a write does. */
struct flood {
    struct umbj_request request;
    struct umbj_service *service;
    atomic_int stop, stopped;
};

static void run_flood(struct umbj_request *request, struct umbj_service *service)
{
    (void)request;
    (void)service;
    (void)poll(NULL, 0, 1);
}

static void flood_again(struct umbj_request *request)
{
    struct flood *flood = (struct flood *)request;
    if (request->skipped || atomic_load(&flood->stop)) {
        atomic_store(&flood->stopped, 1);
    } else {
        umbj_service_post(flood->service, request);
    }
}

struct submission {
    struct umbj_request request;
    enum umb_status status;
    struct umbj_job job;
    atomic_int done;
};

static void run_submission(struct umbj_request *request, struct umbj_service *service)
{
    struct submission *submission = (struct submission *)request;
    struct umbj_bundle_file file = {.path = "a.obj", .size = sizeof CONTENT - 1};
    const struct umbj_manifest manifest = {.scene = "a.obj", .files = &file, .file_count = 1};
    struct umbj_upload *upload = NULL;
    struct umb_error error;
    struct umbj_prepared prepared;
    umbs_sha256_bytes(CONTENT, sizeof CONTENT - 1, file.sha256);
    submission->status = umbj_manifest_prepare(&manifest, 1000, &prepared, &error);
    if (submission->status == UMB_OK) {
        submission->status = umbj_service_submit(service, "ann", &manifest, &prepared,
                                                 &submission->job, &upload, &error);
    }
    if (submission->status == UMB_OK) {
        submission->status = umbj_upload_write(upload, CONTENT, sizeof CONTENT - 1, &error);
    }
    if (submission->status == UMB_OK) {
        submission->status = umbj_upload_accept(upload, &error);
    }
    if (submission->status == UMB_OK) {
        submission->status = umbj_service_accept(service, "ann", &manifest, &prepared, upload,
                                                 &submission->job, &error);
    }
    umbj_service_drop_upload(service, upload);
}

static void submission_done(struct umbj_request *request)
{
    atomic_store(&((struct submission *)request)->done, 1);
}

static void look_at_state(void *user, const struct umbj_standing *standing)
{
    *(enum umbj_state *)user = standing->job.state;
}

static void requests_without_a_break_keep_no_job_from_running(void **state)
{
    struct fixture *f = *state;
    static struct flood flood; /* the service's until it stopped */
    static struct submission submission;
    flood =
        (struct flood){.request = {.run = run_flood, .done = flood_again}, .service = f->service};
    submission = (struct submission){.request = {.run = run_submission, .done = submission_done}};
    umbj_service_post(f->service, &flood.request);
    umbj_service_post(f->service, &submission.request);
    enum umbj_state found = UMBJ_QUEUED;
    for (int i = 0; i < STEPS && found != UMBJ_FAILED; i++) {
        (void)poll(NULL, 0, STEP_MS);
        if (atomic_load(&submission.done)) {
            assert_int_equal(submission.status, UMB_OK);
            (void)umbj_snapshot_look(umbj_service_snapshot(f->service), submission.job.id, "ann",
                                     look_at_state, &found);
        }
    }
    atomic_store(&flood.stop, 1);
    while (!atomic_load(&flood.stopped)) {
        (void)poll(NULL, 0, STEP_MS);
    }
    assert_int_equal(found, UMBJ_FAILED);
}

/* Uploads that wait for their bytes, and the service's reply to the last one. */
struct waiting {
    struct umbj_request request;
    enum umb_status first, second, others, again;
    atomic_int done;
};

static enum umb_status begin(struct umbj_service *service, const char *owner, uint64_t size,
                             struct umbj_upload **upload)
{
    const struct umbj_bundle_file file = {.path = "a.obj", .size = size};
    const struct umbj_manifest manifest = {.scene = "a.obj", .files = &file, .file_count = 1};
    struct umbj_job job;
    struct umbj_prepared prepared;
    struct umb_error error;
    assert_int_equal(umbj_manifest_prepare(&manifest, 1000, &prepared, &error), UMB_OK);
    return umbj_service_submit(service, owner, &manifest, &prepared, &job, upload, &error);
}

static void run_waiting(struct umbj_request *request, struct umbj_service *service)
{
    struct waiting *waiting = (struct waiting *)request;
    struct umbj_upload *uploads[4] = {NULL, NULL, NULL, NULL};
    waiting->first = begin(service, "ann", 600, &uploads[0]);
    waiting->second = begin(service, "ann", 601, &uploads[1]);
    waiting->others = begin(service, "bob", 601, &uploads[2]);
    umbj_service_drop_upload(service, uploads[0]);
    waiting->again = begin(service, "ann", 601, &uploads[3]);
    for (int i = 1; i < 4; i++) {
        umbj_service_drop_upload(service, uploads[i]);
    }
}

static void waiting_done(struct umbj_request *request)
{
    atomic_store(&((struct waiting *)request)->done, 1);
}

static void uploads_on_their_way_count_for_the_quotas(void **state)
{
    struct fixture *f = *state;
    static struct waiting waiting;
    waiting = (struct waiting){.request = {.run = run_waiting, .done = waiting_done}};
    umbj_service_post(f->service, &waiting.request);
    while (!atomic_load(&waiting.done)) {
        (void)poll(NULL, 0, STEP_MS);
    }
    assert_int_equal(waiting.first, UMB_OK);
    assert_int_equal(waiting.second, UMB_E_BUSY);
    assert_int_equal(waiting.others, UMB_OK);
    assert_int_equal(waiting.again, UMB_OK);
}

static void put_in(const struct fixture *f, const char *name, size_t size)
{
    char path[256], bytes[100] = {0};
    snprintf(path, sizeof path, "%s/%s", f->jobs, name);
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, bytes, size), size);
    close(fd);
}

static size_t names_in(const struct fixture *f, const char *name)
{
    struct umbj_names names;
    char path[256];
    snprintf(path, sizeof path, "%s/%s", f->jobs, name);
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    assert_int_equal(umbj_names_read(fd, &names), 0);
    const size_t count = names.count;
    umbj_names_finish(&names);
    close(fd);
    return count;
}

static struct umbj_service_options options_again(const struct fixture *f)
{
    struct umbj_service_options options = *umbj_service_options_of(f->service);
    options.folder = f->jobs;
    options.tries.program = "/bin/false";
    return options;
}

/* An asset in the table of an older program, which recorded no sizes. */
static void note_asset(const struct fixture *f, const uint8_t *asset, const char *owner)
{
    char path[256];
    struct umbj_table *table = NULL;
    struct umbj_job job;
    struct umb_error error;
    int is_new;
    const struct umbj_limits limits = {8, 1000, 4000, 1000, 0, 0};
    const struct umbj_submission submission = {
        .owner = owner, .key = asset, .scene = "a.obj", .settings = "", .bundle_bytes = 1};
    snprintf(path, sizeof path, "%s/jobs.db", f->jobs);
    assert_int_equal(umbj_table_open(path, &limits, &table, &error), UMB_OK);
    assert_int_equal(umbj_table_submit(table, &submission, 1, &job, &is_new, &error), UMB_OK);
    assert_int_equal(umbj_table_claim(table, 2, 2, &job, &error), UMB_OK);
    assert_int_equal(umbj_table_finish(table, &job, asset, 1, 3, &error), UMB_OK);
    umbj_table_close(table);
}

static void a_start_sweeps_what_an_earlier_daemon_left(void **state)
{
    struct fixture *f = *state;
    const struct umbj_service_options options = options_again(f);
    uint8_t asset[UMBJ_HASH_BYTES] = {1}, gone[UMBJ_HASH_BYTES] = {2};
    char name[128], id[UMB_ID_TEXT_SIZE];
    umbj_service_destroy(f->service);
    put_in(f, "incoming/half", 1);
    put_in(f, "work/try", 1);
    put_in(f, "bundles/no-key", 1);
    umb_id_to_text(gone, id);
    snprintf(name, sizeof name, "bundles/%s", id);
    put_in(f, name, 1);
    put_in(f, "assets/.tmp.x", 1);
    put_in(f, "assets/other.umb", 1);
    note_asset(f, asset, "ann");
    note_asset(f, gone, "ann");
    umb_id_to_text(asset, id);
    snprintf(name, sizeof name, "assets/%s.umb", id);
    put_in(f, name, 77);
    assert_int_equal(umbj_service_create(&options, &f->service, &f->error), UMB_OK);
    assert_int_equal(names_in(f, "work") + names_in(f, "bundles"), 0);
    assert_int_equal(names_in(f, "assets"), 2);
    assert_int_equal(atomic_load(&umbj_service_counters(f->service)->owned_bytes), 77);
    assert_true(umbj_snapshot_owns(umbj_service_snapshot(f->service), asset, "ann"));
    assert_false(umbj_snapshot_owns(umbj_service_snapshot(f->service), asset, "bob"));
}

static void a_service_that_cannot_start_says_why(void **state)
{
    struct fixture *f = *state;
    struct umbj_service *other = NULL;
    char assets[100], long_path[5000];
    struct umbj_service_options options = options_again(f);
    assert_int_equal(umbj_service_create(&options, &other, &f->error), UMB_E_BUSY);
    assert_non_null(strstr(f->error.message, "another daemon"));
    options.tries.program = "/nonexistent";
    assert_int_equal(umbj_service_create(&options, &other, &f->error), UMB_E_UNAVAILABLE);
    options.tries.program = f->jobs; /* a folder, which may be entered but not run */
    options.folder = "/dev/null/jobs";
    assert_int_not_equal(umbj_service_create(&options, &other, &f->error), UMB_OK);
    options.tries.program = NULL; /* beside this test there is none */
    assert_int_equal(umbj_service_create(&options, &other, &f->error), UMB_E_UNAVAILABLE);
    memset(long_path, 'x', sizeof long_path - 1);
    long_path[sizeof long_path - 1] = '\0';
    assert_int_equal(umbj_service_prepare(long_path, assets, sizeof assets, &f->error),
                     UMB_E_LIMIT);
    assert_null(other);
    umbj_service_destroy(NULL);
}

/* What a call posts when its client is gone. */
struct giving_up {
    struct umbj_request request;
    struct umbj_upload *upload;
    int ran, skipped;
};

static void run_giving_up(struct umbj_request *request, struct umbj_service *service)
{
    struct giving_up *giving_up = (struct giving_up *)request;
    giving_up->ran = 1;
    umbj_service_drop_upload(service, giving_up->upload);
    giving_up->upload = NULL;
}

static void end_giving_up(struct umbj_request *request)
{
    struct giving_up *giving_up = (struct giving_up *)request;
    giving_up->skipped = request->skipped;
    umbj_upload_destroy(giving_up->upload);
}

static void an_upload_given_up_at_the_end_is_freed_once(void **state)
{
    struct fixture *f = *state;
    const struct umbj_service_options options = options_again(f);
    struct giving_up giving_up = {.request = {.run = run_giving_up, .done = end_giving_up}};
    umbj_service_destroy(f->service);
    assert_int_equal(umbj__service_open(&options, &f->service, &f->error), UMB_OK); /* no thread */
    assert_int_equal(begin(f->service, "ann", 600, &giving_up.upload), UMB_OK);
    umbj_service_post(f->service, &giving_up.request);
    umbj_service_destroy(f->service);
    f->service = NULL;
    assert_true(giving_up.skipped && !giving_up.ran);
}

static void a_daemon_that_was_taken_over_removes_nothing(void **state)
{
    struct fixture *f = *state;
    const struct umbj_service_options options = options_again(f);
    uint8_t key[UMBJ_HASH_BYTES] = {3};
    char name[128], id[UMB_ID_TEXT_SIZE];
    umbj_service_destroy(f->service);
    note_asset(f, key, "ann");
    assert_int_equal(umbj__service_open(&options, &f->service, &f->error), UMB_OK);
    umb_id_to_text(key, id);
    snprintf(name, sizeof name, "bundles/%s", id);
    put_in(f, name, 1);
    f->service->lost = 1; /* both may be another daemon's by now */
    assert_int_equal(umbj_service_delete(f->service, key, "ann", &f->error), UMB_E_UNAVAILABLE);
    umbj__drop_bundle(f->service, key);
    assert_int_equal(names_in(f, "bundles"), 1);
    f->service->lost = 0;
    umbj__drop_bundle(f->service, key);
    assert_int_equal(names_in(f, "bundles"), 0);
    assert_int_equal(umbj_service_delete(f->service, key, "ann", &f->error), UMB_OK);
}

/* Collects what the service reports about files that get their names. */
struct naming {
    int begun, failed;
};

static void note_naming(void *user, const uint8_t *asset, int yes)
{
    struct naming *naming = user;
    assert_int_equal(asset[0], 5);
    naming->begun += yes;
    naming->failed += !yes;
}

/* Makes a job of the key that runs. */
static void run_job(struct fixture *f, uint8_t key, struct umbj_job *job)
{
    const uint8_t keys[UMBJ_HASH_BYTES] = {key};
    const struct umbj_submission submission = {
        .owner = "ann", .key = keys, .scene = "a.obj", .settings = "", .bundle_bytes = 1};
    int is_new;
    assert_int_equal(umbj_table_submit(f->service->table, &submission, 1, job, &is_new, &f->error),
                     UMB_OK);
    assert_int_equal(umbj_table_claim(f->service->table, 2, 2, job, &f->error), UMB_OK);
}

/* Ends a running job with a staged file, whose commit fails with system_error; 0: the commit
 * works. */
static void publish(struct fixture *f, uint8_t key, int system_error)
{
    struct umbj_report report = {.kind = UMBJ_REPORT_ENDED, .asset = {5}};
    struct umbj_job job;
    char path[4200];
    run_job(f, key, &job);
    memcpy(report.job, job.id, sizeof report.job);
    report.epoch = job.epoch;
    umbj_asset_path(f->service->assets_path, report.asset, path, sizeof path);
    assert_int_equal(umbu_output_begin(path, 0, &report.staged, &f->error), UMB_OK);
    report.staged.system_error = system_error;
    umbj__take_report(f->service, &report);
}

static void a_file_that_gets_no_name_replaces_nothing(void **state)
{
    struct fixture *f = *state;
    struct umbj_service_options options = options_again(f);
    struct naming naming = {0, 0};
    options.replacing = note_naming;
    options.user = &naming;
    umbj_service_destroy(f->service);
    assert_int_equal(umbj__service_open(&options, &f->service, &f->error), UMB_OK); /* no thread */
    publish(f, 1, ENOSPC);
    assert_true(naming.begun == 1 && naming.failed == 1);
    publish(f, 2, 0);
    assert_true(naming.begun == 2 && naming.failed == 1);
    assert_int_equal(names_in(f, "assets"), 1);
}

/* An executor that only counts. */
struct counting {
    struct umbj_executor base;
    int cancelled;
};

static enum umb_status count_start(struct umbj_executor *self, const struct umbj_work *work,
                                   struct umb_error *error)
{
    (void)self;
    (void)work;
    return umb_fail(error, UMB_E_BUSY, "it runs nothing");
}

static void count_cancel(struct umbj_executor *self, const char *job, int64_t epoch)
{
    assert_true(job[0] != '\0' && epoch > 0);
    ((struct counting *)self)->cancelled++;
}

static int count_slots(struct umbj_executor *self)
{
    (void)self;
    return 0;
}

static void count_destroy(struct umbj_executor *self)
{
    (void)self;
}

/* Long after the lease of a job that was claimed at 2. */
static int64_t late_ms(void *user)
{
    (void)user;
    return 1000000000;
}

static void a_daemon_that_was_taken_over_ends_its_tries_and_publishes_nothing(void **state)
{
    struct fixture *f = *state;
    static struct counting counting; /* the service's until the teardown */
    static const struct umbj_clocks clocks = {late_ms, late_ms, NULL};
    struct umbj_service_options options = options_again(f);
    struct umbj_job job;
    counting = (struct counting){{count_start, count_cancel, count_slots, count_destroy}, 0};
    options.executor = &counting.base;
    options.clocks = &clocks;
    umbj_service_destroy(f->service);
    assert_int_equal(umbj__service_open(&options, &f->service, &f->error), UMB_OK); /* no thread */
    f->service->lost = 1;
    publish(f, 1, 0);
    assert_int_equal(names_in(f, "assets"), 0);
    run_job(f, 2, &job);
    struct umbj_report report = {.kind = UMBJ_REPORT_PROGRESS, .epoch = job.epoch};
    memcpy(report.job, job.id, sizeof report.job);
    umbj__take_report(f->service, &report);
    assert_int_equal(counting.cancelled, 1);
    umbj__service_turn(f->service, 0); /* the lease is another daemon's */
    assert_int_equal(umbj_service_cancel(f->service, job.id, NULL, &job, &f->error),
                     UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "another daemon has taken over"));
    assert_int_equal(counting.cancelled, 1);
    assert_int_equal(umbj_table_get(f->service->table, job.id, NULL, &job, &f->error), UMB_OK);
    assert_int_equal(job.state, UMBJ_RUNNING);
}

/* Makes a service without a thread, on the fixture's folder, with an executor that only counts. */
static void open_quiet(struct fixture *f, struct umbj_service_options *options)
{
    static struct counting counting; /* the service's until the teardown */
    counting = (struct counting){{count_start, count_cancel, count_slots, count_destroy}, 0};
    options->executor = &counting.base;
    umbj_service_destroy(f->service);
    assert_int_equal(umbj__service_open(options, &f->service, &f->error), UMB_OK);
}

static void a_beat_finds_that_another_daemon_took_over(void **state)
{
    struct fixture *f = *state;
    struct umbj_service_options options = options_again(f);
    struct umbj_job job;
    uint8_t asset[UMBJ_HASH_BYTES] = {5};
    struct umbj_upload *upload = NULL;
    open_quiet(f, &options);
    run_job(f, 1, &job);
    struct umbs_owner_lock *lock = &f->service->place.folder;
    lock->beats = 1; /* as on a file system where locks are not enough */
    umbj__service_turn(f->service, 0);
    assert_false(f->service->lost);
    assert_int_equal(pwrite(lock->fd, "other boot 1 word 7\n", 20, 0), 20);
    f->service->place.beat_at_ms = 0;
    umbj__service_turn(f->service, 0);
    assert_true(f->service->lost);
    assert_int_equal(umbj_table_renew(f->service->table, job.id, job.epoch, 9, &f->error),
                     UMB_E_IO); /* its table takes no write any more */
    assert_int_equal(begin(f->service, "ann", 1, &upload), UMB_E_UNAVAILABLE);
    assert_null(upload);
    assert_int_equal(umbj_service_delete(f->service, asset, "ann", &f->error), UMB_E_UNAVAILABLE);
    f->service->place.beat_at_ms = 0;
    umbj__service_turn(f->service, 0); /* the loss is noted once */
    /* A lock that cannot be written is tried again: nothing is lost. */
    f->service->lost = 0;
    close(lock->fd);
    lock->fd = open(lock->path, O_RDONLY | O_CLOEXEC);
    assert_true(lock->fd >= 0);
    snprintf(lock->owner, sizeof lock->owner, "other boot 1 word");
    f->service->place.beat_at_ms = 0;
    umbj__service_turn(f->service, 0);
    assert_false(f->service->lost);
}

/* Ends a running job with an asset that is in the folder already. */
static enum umbj_state end_known(struct fixture *f, uint8_t key, const uint8_t *asset)
{
    struct umbj_report report = {.kind = UMBJ_REPORT_ENDED, .bake_ms = 7, .staged = {.fd = -1}};
    struct umbj_job job;
    run_job(f, key, &job);
    memcpy(report.job, job.id, sizeof report.job);
    memcpy(report.asset, asset, sizeof report.asset);
    report.epoch = job.epoch;
    umbj__take_report(f->service, &report);
    assert_int_equal(umbj_table_get(f->service->table, job.id, NULL, &job, &f->error), UMB_OK);
    return job.state;
}

static void a_known_asset_is_published_unless_its_file_is_gone(void **state)
{
    struct fixture *f = *state;
    struct umbj_service_options options = options_again(f);
    const uint8_t known[UMBJ_HASH_BYTES] = {5}, gone[UMBJ_HASH_BYTES] = {6};
    int owned = 0;
    open_quiet(f, &options);
    publish(f, 1, 0);
    assert_int_equal(end_known(f, 2, known), UMBJ_DONE);
    assert_int_equal(end_known(f, 3, gone), UMBJ_QUEUED); /* io: it is tried again */
    assert_int_equal(umbj_table_asset(f->service->table, gone, NULL, &owned, &f->error), UMB_OK);
    assert_false(owned);
    assert_int_equal(names_in(f, "assets"), 1);
}

/* Collects what the daemon reports about its assets. */
static int is_served(void *user, const uint8_t *asset)
{
    (void)asset;
    return *(int *)user;
}

static int64_t clock_ms(void *user)
{
    return *(int64_t *)user;
}

static void look_at_loading(void *user, const struct umbj_standing *standing)
{
    *(int *)user = standing->loading;
}

static void watchers_wait_for_an_asset_but_not_without_end(void **state)
{
    static int64_t now_ms;
    static int served;
    const struct umbj_clocks clocks = {clock_ms, clock_ms, &now_ms};
    struct fixture *f = *state;
    struct umbj_service_options options = options_again(f);
    struct umbj_job *jobs = NULL;
    size_t count = 0;
    int loading = -1;
    options.clocks = &clocks;
    options.is_served = is_served;
    options.user = &served;
    for (int way = 0; way < 3; way++) { /* served, refused, and silent for too long */
        now_ms = 1000;
        served = 0;
        open_quiet(f, &options);
        publish(f, (uint8_t)(way + 1), 0);
        assert_int_equal(umbj_table_list(f->service->table, "ann", 1, &jobs, &count, &f->error),
                         UMB_OK);
        assert_int_equal(count, 1);
        for (int turn = 0; turn < 3; turn++) {
            umbj__service_turn(f->service, 0);
            assert_true(umbj_snapshot_look(f->service->snapshot, jobs->id, "ann", look_at_loading,
                                           &loading));
            assert_int_equal(loading, turn < 2);
            now_ms += turn == 0 ? 600000 : way == 2 ? 1 : 0;
            served = turn < 1 || way == 2 ? 0 : way == 0 ? 1 : -1;
        }
        assert_int_equal(f->service->loading_count, 0);
        free(jobs);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(
            a_daemon_that_was_taken_over_ends_its_tries_and_publishes_nothing, setup, teardown),
        cmocka_unit_test_setup_teardown(a_file_that_gets_no_name_replaces_nothing, setup, teardown),
        cmocka_unit_test_setup_teardown(a_beat_finds_that_another_daemon_took_over, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(a_known_asset_is_published_unless_its_file_is_gone, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(watchers_wait_for_an_asset_but_not_without_end, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(requests_without_a_break_keep_no_job_from_running, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(uploads_on_their_way_count_for_the_quotas, setup, teardown),
        cmocka_unit_test_setup_teardown(a_start_sweeps_what_an_earlier_daemon_left, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(a_service_that_cannot_start_says_why, setup, teardown),
        cmocka_unit_test_setup_teardown(a_daemon_that_was_taken_over_removes_nothing, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(an_upload_given_up_at_the_end_is_freed_once, setup,
                                        teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
