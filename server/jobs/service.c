/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The job service's thread: requests, reports, leases, claims.
 *
 * Invariants: only this thread uses the table and the executor. A job that is running in the table
 * has a try in the executor. Assets' files are named and removed on this thread only.
 */
#define _XOPEN_SOURCE 700 /* realpath, beside what -D_POSIX_C_SOURCE gives */
#include "jobs/service_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/try.h"
#include "tool/clock.h"
#include "common/file_system.h"
#include "common/private_folder.h"
#include "jobs/folder.h"
#include "jobs/staging.h"

#define LOOK_MS      1000    /* longest sleep: leases and pauses are checked at least this often */
#define SERVE_MS     20      /* between checks whether the daemon serves a published asset */
#define PRUNE_MS     3600000 /* between removals of old jobs */
#define FILE_THREADS 4       /* threads for bundles; one owner has at most one fewer */
#define REQUESTS_MS  100     /* longest run of requests before jobs get their turn */

static int64_t system_unix_ms(void *user)
{
    (void)user;
    return umbu_unix_ms();
}

static int64_t system_steady_ms(void *user)
{
    (void)user;
    return umbu_clock_ms();
}

/* Queues a request whose `files` was called. */
static void files_done(struct umbj_service *service, struct umbj_request *request)
{
    if (request->run == NULL) {
        request->done(request);
        return;
    }
    pthread_mutex_lock(&service->mutex);
    request->skipped = 0;
    STAILQ_INSERT_TAIL(&service->queue, request, next);
    pthread_cond_signal(&service->wake);
    pthread_mutex_unlock(&service->mutex);
}

void umbj_service_post(struct umbj_service *service, struct umbj_request *request)
{
    if (request->files != NULL) {
        umbj_file_threads_post(request->reads ? service->reader : service->file_threads, request);
    } else {
        files_done(service, request);
    }
}

/* A report that is queued for the service's thread. */
struct report_request {
    struct umbj_request request;
    struct umbj_report report;
};

static void run_report(struct umbj_request *request, struct umbj_service *service)
{
    struct report_request *message = (struct report_request *)request;
    umbj__take_report(service, &message->report);
}

static void end_report(struct umbj_request *request)
{
    struct report_request *message = (struct report_request *)request;
    if (request->skipped) {
        umbu_output_abandon(&message->report.staged);
    }
    free(message);
}

/* Takes a report, on one of the executor's threads. If memory is short the report is dropped. A
 * dropped end is noticed when the job's lease expires. */
static void on_report(void *user, const struct umbj_report *report)
{
    struct report_request *message = malloc(sizeof *message);
    if (message == NULL) {
        struct umbu_output staged = report->staged;
        umbu_output_abandon(&staged);
        return;
    }
    message->request = (struct umbj_request){.run = run_report, .done = end_report};
    message->report = *report;
    umbj_service_post(user, &message->request);
}

/* Ends the tries of expired leases; their jobs are lost. */
static void expire(struct umbj_service *service)
{
    struct umbj_job job;
    struct umb_error error;
    while (umbj_table_expired(service->table, umbj__steady_ms(service), &job, &error) == UMB_OK) {
        service->executor->cancel(service->executor, job.id, job.epoch);
        if (umbj__fail_try(service, &job, UMBJ_LOST, "it gave no sign of life for the whole lease",
                           &error) != UMB_OK) {
            umbj__log_error(service, "job_expire", &error);
            return;
        }
    }
}

static void claim(struct umbj_service *service)
{
    struct umbj_job job;
    struct umb_error error = {0};
    enum umb_status status = UMB_OK;
    while (status == UMB_OK && service->executor->free_slots(service->executor) > 0) {
        status = umbj_table_claim(service->table, umbj__unix_ms(service), umbj__steady_ms(service),
                                  &job, &error);
        if (status == UMB_OK) {
            umbj__begin_try(service, &job);
        }
    }
    if (status != UMB_OK && status != UMB_E_NOT_FOUND) {
        umbj__log_error(service, "job_claim", &error);
    }
}

/* Time to sleep: until a job may start, or something must be checked. */
static int64_t sleep_ms(struct umbj_service *service)
{
    struct umb_error error;
    const int64_t now = umbj__unix_ms(service);
    int64_t when = INT64_MAX;
    if (service->loading_count > 0) {
        return SERVE_MS;
    }
    if (service->lost || service->executor->free_slots(service->executor) == 0 ||
        umbj_table_next_start(service->table, now, &when, &error) != UMB_OK ||
        when > now + LOOK_MS) {
        return LOOK_MS;
    }
    return when > now ? when - now : 1;
}

/* Increments the number in the lock file. A failure shows that another daemon has taken over. */
static void beat(struct umbj_service *service)
{
    struct umb_error error;
    const enum umb_status status = umbj_place_beat(&service->place, &error);
    if (status == UMB_E_STATE && !service->lost) {
        service->lost = 1;
        umbj__log_error(service, "jobs_lost", &error);
        if (umbj_table_freeze(service->table, &error) != UMB_OK) {
            umbj__log_error(service, "jobs_lost", &error);
        }
    } else if (status != UMB_OK && status != UMB_E_STATE) {
        umbj__log_error(service, "jobs_beat", &error); /* the next beat tries again */
    }
}

static void housekeeping(struct umbj_service *service)
{
    struct umb_error error;
    beat(service);
    const int64_t now = umbj__steady_ms(service);
    umbj__look_at_loading(service);
    if (service->lost) {
        return; /* another daemon has the table's jobs, and its clock may differ */
    }
    if (now >= service->look_at_ms) {
        service->look_at_ms = now + LOOK_MS;
        expire(service);
    }
    claim(service);
    if (now >= service->prune_at_ms) {
        service->prune_at_ms = now + PRUNE_MS;
        const int64_t before = umbj__unix_ms(service) - (int64_t)service->options.keep_ms;
        if (umbj_table_prune(service->table, before, &error) != UMB_OK) {
            umbj__log_error(service, "job_prune", &error);
        }
        umbj__recount(service);
    }
}

/* Takes the next request; sleeps while there is none. Returns NULL if woken for another reason, or
 * if the service ends. */
static struct umbj_request *next_request(struct umbj_service *service, int64_t wait_ms)
{
    const struct timespec until = umbu_clock_deadline(wait_ms);
    pthread_mutex_lock(&service->mutex);
    if (STAILQ_EMPTY(&service->queue) && !service->closing && wait_ms > 0) {
        pthread_cond_timedwait(&service->wake, &service->mutex, &until);
    }
    struct umbj_request *request = STAILQ_FIRST(&service->queue);
    if (request != NULL) {
        STAILQ_REMOVE_HEAD(&service->queue, next);
    }
    pthread_mutex_unlock(&service->mutex);
    return request;
}

static int is_closing(struct umbj_service *service)
{
    pthread_mutex_lock(&service->mutex);
    const int closing = service->closing;
    pthread_mutex_unlock(&service->mutex);
    return closing;
}

void umbj__service_turn(struct umbj_service *service, int64_t wait_ms)
{
    struct umbj_request *request = next_request(service, wait_ms);
    const int64_t until_ms = umbu_clock_ms() + REQUESTS_MS;
    while (request != NULL && !is_closing(service)) {
        request->run(request, service);
        request->done(request);
        request = umbu_clock_ms() < until_ms ? next_request(service, 0) : NULL;
    }
    if (request != NULL) {
        umbj_request_skip(request);
    } else {
        housekeeping(service);
    }
}

static void *run_service(void *user)
{
    struct umbj_service *service = user;
    while (!is_closing(service)) {
        umbj__service_turn(service, sleep_ms(service));
    }
    return NULL;
}

enum umb_status umbj_service_prepare(const char *folder, char *assets, size_t size,
                                     struct umb_error *error)
{
    const int length = snprintf(assets, size, "%s/assets", folder);
    if (length < 0 || (size_t)length >= size) {
        return umb_fail(error, UMB_E_LIMIT, "--jobs: a path of %zu bytes is too long",
                        strlen(folder));
    }
    UMB__TRY(umbj_folder_make(AT_FDCWD, folder, error));
    return umbj_folder_make(AT_FDCWD, assets, error);
}

/* Logs a warning if other users can change the folder, as is common on a cluster's shared
 * storage. */
static void warn_if_shared(const struct umbj_service *service)
{
    char *resolved = NULL;
    struct umb_error cause;
    char quoted[UMBS_LOG_QUOTE_SIZE];
    if (umbs_private_folder(service->options.folder, &resolved, &cause) == UMB_E_PERMISSION) {
        umbs_log_event(service->options.log, UMB_LOG_WARN, "jobs_not_private", "reason=%s",
                       umbs_log_quote(cause.message, quoted));
    }
    free(resolved);
}

static enum umb_status open_folder(struct umbj_service *service, struct umb_error *error)
{
    static const char *const names[] = {"incoming", "bundles", "work", "tiles"};
    const char *path = service->options.folder;
    UMB__TRY(umbj_service_prepare(path, service->assets_path, sizeof service->assets_path, error));
    service->folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (service->folder < 0) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "--jobs: cannot use '%.150s'",
                              path);
    }
    warn_if_shared(service);
    UMB__TRY(umbj_place_take(path, service->options.table, &service->place, error));
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        UMB__TRY(umbj_folder_make(service->folder, names[i], error));
    }
    return UMB_OK;
}

/* Makes a path absolute and without links. */
static enum umb_status make_absolute(const char *path, char absolute[4096], struct umb_error *error)
{
    const int found = realpath(path, absolute) != NULL;
    return found && strlen(absolute) <= 3800
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_NO_INPUT, found ? ENAMETOOLONG : errno, "'%.200s'",
                                path);
}

/* Finds umbrage-bake. Fails: E_UNAVAILABLE. */
static enum umb_status find_program(struct umbj_service *service, struct umb_error *error)
{
    struct umb_error cause;
    char beside[4096 + 16] = "";
    const char *path = service->options.tries.program;
    if (path == NULL) {
        const ssize_t length = readlink("/proc/self/exe", beside, 4095);
        char *slash = length > 0 ? strrchr(beside, '/') : NULL;
        if (slash == NULL) {
            return umb_fail(error, UMB_E_UNAVAILABLE,
                            "--bake-program: cannot tell where umbrage-bake lies");
        }
        (void)snprintf(slash, 16, "/umbrage-bake");
        path = beside;
    }
    if (make_absolute(path, service->program, &cause) != UMB_OK) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "--bake-program: %s", cause.message);
    }
    if (access(service->program, X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "--bake-program: '%.200s'", path);
    }
    service->options.tries.program = service->program;
    return UMB_OK;
}

static enum umb_status open_table(const struct umbj_service *service, struct umbj_table **out,
                                  struct umb_error *error)
{
    return umbj_table_open(service->place.table_path, &service->options.limits, out, error);
}

/* Makes an executor from the options, unless a test gave one. */
static enum umb_status make_executor(struct umbj_service *service, struct umb_error *error)
{
    const struct umbj_slurm_options slurm = {.words = service->options.slurm_words,
                                             .tag_of = service->folder_path,
                                             .search = getenv("PATH"),
                                             .configuration = getenv("SLURM_CONF")};
    struct umbj_try_options *tries = &service->options.tries;
    if (service->executor != NULL) {
        return UMB_OK;
    }
    tries->farm = NULL;
    if (service->options.slurm) {
        UMB__TRY(umbj_slurm_farm_create(&slurm, &tries->farm, error));
    }
    snprintf(service->work_path, sizeof service->work_path, "%s/work", service->folder_path);
    tries->assets = service->assets_path;
    tries->work = service->work_path;
    tries->report = on_report;
    tries->user = service;
    return umbj_try_executor_create(tries, &service->executor, error);
}

static void init_service(struct umbj_service *service, const struct umbj_service_options *options)
{
    static const struct umbj_clocks system_clocks = {system_unix_ms, system_steady_ms, NULL};
    pthread_condattr_t monotonic;
    service->options = *options;
    service->clocks = options->clocks != NULL ? *options->clocks : system_clocks;
    service->executor = options->executor;
    service->folder = -1;
    STAILQ_INIT(&service->queue);
    umbj_place_init(&service->place);
    pthread_mutex_init(&service->mutex, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&service->wake, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

/* Opens all parts, in the order of their needs. */
static enum umb_status open_parts(struct umbj_service *service, struct umb_error *error)
{
    UMB__TRY(find_program(service, error));
    UMB__TRY(
        umbj_file_threads_create(FILE_THREADS, files_done, service, &service->file_threads, error));
    UMB__TRY(umbj_snapshot_create(&service->snapshot, error));
    UMB__TRY(open_folder(service, error));
    UMB__TRY(make_absolute(service->options.folder, service->folder_path, error));
    service->options.folder = service->folder_path;
    snprintf(service->assets_path, sizeof service->assets_path, "%s/assets", service->folder_path);
    UMB__TRY(open_table(service, &service->table, error));
    UMB__TRY(umbj__recover(service, error));
    UMB__TRY(open_table(service, &service->read_table, error));
    UMB__TRY(umbj_file_threads_create(1, files_done, service, &service->reader, error));
    return make_executor(service, error);
}

enum umb_status umbj__service_open(const struct umbj_service_options *options,
                                   struct umbj_service **out, struct umb_error *error)
{
    *out = NULL;
    struct umbj_service *service = calloc(1, sizeof *service);
    if (service == NULL) {
        if (options->executor != NULL) {
            options->executor->destroy(options->executor);
        }
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the jobs");
    }
    init_service(service, options);
    const enum umb_status status = open_parts(service, error);
    if (status != UMB_OK) {
        umbj_service_destroy(service);
        return status;
    }
    service->opened = 1;
    *out = service;
    return UMB_OK;
}

enum umb_status umbj_service_create(const struct umbj_service_options *options,
                                    struct umbj_service **out, struct umb_error *error)
{
    UMB__TRY(umbj__service_open(options, out, error));
    struct umbj_service *service = *out;
    const int code = pthread_create(&service->thread, NULL, run_service, service);
    if (code != 0) {
        umbj_service_destroy(service);
        *out = NULL;
        return umb_fail_errno(error, UMB_E_LIMIT, code, "no thread for the jobs");
    }
    service->running = 1;
    return UMB_OK;
}

/* Frees uploads that calls still hold; the next start removes their files. */
static void leave_uploads(struct umbj_service *service)
{
    while (service->promises != NULL) {
        struct umbj_promise *promise = service->promises;
        service->promises = promise->next;
        umbj_upload_leave(promise->upload);
        umbj_upload_let_go(promise->upload);
        free(promise);
    }
}

void umbj_service_destroy(struct umbj_service *service)
{
    struct umb_error error;
    if (service == NULL) {
        return;
    }
    if (service->running) {
        pthread_mutex_lock(&service->mutex);
        service->closing = 1;
        pthread_cond_signal(&service->wake);
        pthread_mutex_unlock(&service->mutex);
        pthread_join(service->thread, NULL);
    }
    if (service->file_threads != NULL) {
        umbj_file_threads_end(service->file_threads);
    }
    umbj_file_threads_destroy(service->reader);
    umbj_table_close(service->read_table);
    if (service->executor != NULL) {
        service->executor->destroy(service->executor);
    }
    struct umbj_request *request;
    while ((request = next_request(service, 0)) != NULL) {
        umbj_request_skip(request);
    }
    if (service->opened && !service->lost && umbj_table_release(service->table, &error) != UMB_OK) {
        umbj__log_error(service, "job_release", &error); /* then the next start finds them lost */
    }
    umbj_table_close(service->table);
    umbj_snapshot_destroy(service->snapshot);
    free(service->loading);
    leave_uploads(service);
    umbj_file_threads_destroy(service->file_threads);
    umbj_place_release(&service->place);
    umbs_hang_up(&service->folder);
    pthread_cond_destroy(&service->wake);
    pthread_mutex_destroy(&service->mutex);
    free(service);
}

struct umbj_snapshot *umbj_service_snapshot(struct umbj_service *service)
{
    return service->snapshot;
}

struct umbj_counters *umbj_service_counters(struct umbj_service *service)
{
    return &service->counters;
}

const struct umbj_service_options *umbj_service_options_of(const struct umbj_service *service)
{
    return &service->options;
}
