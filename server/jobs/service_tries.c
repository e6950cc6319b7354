/* SPDX-License-Identifier: Apache-2.0 */
/* Tries and their jobs: start, reports, publishing, failure; and recovery at a start. */
#include "jobs/service_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/try.h"
#include "common/sha256.h"
#include "jobs/folder.h"
#include "jobs/staging.h"

#define PATH_SIZE     4200
#define SERVE_MOST_MS 600000 /* then the job is reported as done anyway, with a warning */
#define LEASE_PARTS   4      /* a lease is renewed after this part of it */

int64_t umbj__unix_ms(const struct umbj_service *service)
{
    return service->clocks.unix_ms(service->clocks.user);
}

int64_t umbj__steady_ms(const struct umbj_service *service)
{
    return service->clocks.steady_ms(service->clocks.user);
}

void umbj__log_error(const struct umbj_service *service, const char *event,
                     const struct umb_error *error)
{
    char quoted[UMBS_LOG_QUOTE_SIZE];
    umbs_log_event(service->options.log, UMB_LOG_ERROR, event, "reason=%s",
                   umbs_log_quote(error->message, quoted));
}

void umbj__recount(struct umbj_service *service)
{
    int64_t counts[UMBJ_STATE_COUNT];
    struct umb_error error;
    if (umbj_table_count(service->table, counts, &error) == UMB_OK) {
        for (int i = 0; i < UMBJ_STATE_COUNT; i++) {
            atomic_store(&service->counters.states[i], counts[i]);
        }
    }
    struct umbj_kept kept;
    if (umbj_table_kept(service->table, NULL, &kept, &error) == UMB_OK) {
        atomic_store(&service->counters.owned_bytes, kept.asset_bytes);
    }
    umbj__note_refusals(service);
    atomic_store(&service->counters.damaged_rows,
                 (uint_fast64_t)umbj_table_damaged(service->table));
}

void umbj__note_refusals(struct umbj_service *service)
{
    for (int i = 0; i < UMBJ_QUOTA_COUNT; i++) {
        atomic_store(&service->counters.refused[i],
                     (uint_fast64_t)umbj_table_refused(service->table, (enum umbj_quota)i));
    }
}

/* Removes an owner's oldest finished jobs beyond its quota. */
static void trim(struct umbj_service *service, const char *owner)
{
    struct umb_error error;
    if (!service->lost && umbj_table_trim(service->table, owner, &error) != UMB_OK) {
        umbj__log_error(service, "job_trim", &error);
    }
}

void umbj__changed(struct umbj_service *service, const struct umbj_job *job, int loading)
{
    char owner[UMBS_LOG_QUOTE_SIZE], cause[UMBS_LOG_QUOTE_SIZE], asset[UMB_ID_TEXT_SIZE] = "-";
    umbj_snapshot_set(service->snapshot, job, loading);
    if (umbj_is_over(job->state)) {
        trim(service, job->owner);
    }
    umbj__recount(service);
    if (job->has_asset) {
        umb_id_to_text(job->asset, asset);
    }
    umbs_log_event(service->options.log, UMB_LOG_INFO, "job",
                   "job=%s owner=%s state=%s epoch=%lld tries=%lld failure=%s cause=%s asset=%s",
                   job->id, umbs_log_quote(job->owner, owner), umbj_state_name(job->state),
                   (long long)job->epoch, (long long)job->tries, umbj_failure_name(job->failure),
                   umbs_log_quote(job->cause, cause), asset);
}

/* Removal of a folder on a thread for files. */
struct removal {
    struct umbj_request request;
    int folder; /* own descriptor of the jobs folder */
    const atomic_int *stop;
    char gone[UMBJ_GONE_SIZE];
};

static void run_removal(struct umbj_request *request)
{
    const struct removal *removal = (const struct removal *)request;
    umbj_folder_remove_until(removal->folder, removal->gone, removal->stop);
}

static void end_removal(struct umbj_request *request)
{
    struct removal *removal = (struct removal *)request;
    close(removal->folder);
    free(removal);
}

/* Removes a renamed folder on a thread for files. If memory is short or the service ends, the next
 * start removes it. */
static void remove_later(struct umbj_service *service, const char *gone)
{
    struct removal *removal = calloc(1, sizeof *removal);
    if (removal == NULL) {
        return;
    }
    removal->stop = umbj_file_threads_stop(service->file_threads);
    removal->folder = fcntl(service->folder, F_DUPFD_CLOEXEC, 0);
    if (removal->folder < 0) {
        free(removal);
        return;
    }
    snprintf(removal->gone, sizeof removal->gone, "%s", gone);
    removal->request =
        (struct umbj_request){.files = run_removal, .done = end_removal, .owner = "/"};
    umbj_file_threads_post(service->file_threads, &removal->request);
}

/* 1 if an upload of the key is in progress. */
static int is_promised(const struct umbj_service *service, const uint8_t *key)
{
    const struct umbj_promise *at = service->promises;
    while (at != NULL && memcmp(at->key, key, sizeof at->key) != 0) {
        at = at->next;
    }
    return at != NULL;
}

void umbj__drop_bundle(struct umbj_service *service, const uint8_t *key)
{
    int64_t users = 1;
    char gone[UMBJ_GONE_SIZE];
    struct umb_error error;
    if (service->lost || is_promised(service, key) ||
        umbj_table_bundle_users(service->table, key, &users, &error) != UMB_OK || users != 0) {
        return;
    }
    if (umbj_bundle_take_away(service->folder, key, gone) != 0) {
        (void)umb_fail_errno(&error, UMB_E_IO, errno, "cannot remove a bundle without jobs");
        umbj__log_error(service, "bundle_remove", &error);
    } else if (gone[0] != '\0') {
        remove_later(service, gone);
    }
}

void umbj__collect_assets(struct umbj_service *service)
{
    uint8_t asset[UMBJ_HASH_BYTES];
    char path[PATH_SIZE], id[UMB_ID_TEXT_SIZE];
    struct umb_error error;
    int removed = 0;
    if (service->lost) {
        return; /* the folder's files are another daemon's */
    }
    while (umbj_table_unowned(service->table, asset, &error) == UMB_OK) {
        umbj_asset_path(service->assets_path, asset, path, sizeof path);
        if (unlink(path) != 0 && errno != ENOENT) {
            (void)umb_fail_errno(&error, UMB_E_IO, errno, "cannot remove '%.200s'", path);
            umbj__log_error(service, "asset_remove", &error);
            break;
        }
        /* If the file comes back with a crash, its row does too. */
        (void)umbu_folder_sync_at(AT_FDCWD, service->assets_path);
        if (umbj_table_forget(service->table, asset, &error) != UMB_OK) {
            umbj__log_error(service, "asset_forget", &error);
            break;
        }
        umbj_snapshot_disown(service->snapshot, asset, NULL);
        umb_id_to_text(asset, id);
        umbs_log_event(service->options.log, UMB_LOG_INFO, "asset_removed", "asset=%s", id);
        removed = 1;
    }
    if (removed && service->options.store_changed != NULL) {
        service->options.store_changed(service->options.user);
    }
}

enum umb_status umbj__fail_try(struct umbj_service *service, struct umbj_job *job,
                               enum umbj_failure failure, const char *cause,
                               struct umb_error *error)
{
    UMB__TRY(umbj_table_fail(service->table, job, failure, cause, umbj__unix_ms(service), error));
    atomic_fetch_add(&service->counters.failures[failure], 1);
    umbj__changed(service, job, 0);
    if (umbj_is_over(job->state)) {
        umbj__drop_bundle(service, job->key);
    }
    return UMB_OK;
}

/* Returns 1 if an earlier bake of the key gave an asset that the owner already has. An asset of
 * another owner is baked again. Otherwise Watch would show no steps of a bake, and so reveal that
 * the asset exists. */
static int find_known(struct umbj_service *service, const struct umbj_job *job,
                      struct umbj_work *work)
{
    char path[PATH_SIZE];
    struct umb_error error;
    int owned = 0;
    if (umbj_table_find_bake(service->table, job->key, work->known_asset, &work->known_ms,
                             &error) != UMB_OK ||
        umbj_table_asset(service->table, work->known_asset, job->owner, &owned, &error) != UMB_OK ||
        !owned) {
        return 0;
    }
    umbj_asset_path(service->assets_path, work->known_asset, path, sizeof path);
    return access(path, R_OK) == 0;
}

/* Returns the path of the owner's folder of tiles, created if needed; NULL: the bake runs without
 * one. Owners share no tiles, because a tile found in the folder would reveal by its speed that
 * another owner baked it. */
static const char *cache_of(struct umbj_service *service, const char *owner, char path[PATH_SIZE])
{
    uint8_t hash[UMBJ_HASH_BYTES];
    char id[UMB_ID_TEXT_SIZE], name[48];
    struct umb_error error;
    if (service->options.tries.cache_bytes == 0) {
        return NULL;
    }
    umbs_sha256_bytes(owner, strlen(owner), hash);
    umb_id_to_text(hash, id);
    snprintf(name, sizeof name, "tiles/%.32s", id);
    if (umbj_folder_make(service->folder, name, &error) != UMB_OK) {
        umbj__log_error(service, "tile_cache", &error);
        return NULL;
    }
    snprintf(path, PATH_SIZE, "%s/%s", service->options.folder, name);
    return path;
}

void umbj__begin_try(struct umbj_service *service, const struct umbj_job *job)
{
    char key[UMB_ID_TEXT_SIZE], bundle[PATH_SIZE], folder[PATH_SIZE], cache[PATH_SIZE];
    char scene[UMBJ_SCENE_SIZE], settings[UMBJ_SETTINGS_SIZE];
    struct umbj_job failed = *job;
    struct umb_error error = {0};
    umb_id_to_text(job->key, key);
    snprintf(bundle, sizeof bundle, "%s/bundles/%s", service->options.folder, key);
    snprintf(folder, sizeof folder, "%s/work/%s.%lld", service->options.folder, job->id,
             (long long)job->epoch);
    struct umbj_work work = {.epoch = job->epoch,
                             .bundle = bundle,
                             .folder = folder,
                             .scene = scene,
                             .settings = settings,
                             .cache = cache_of(service, job->owner, cache)};
    memcpy(work.job, job->id, sizeof work.job);
    work.is_known = find_known(service, job, &work);
    umbj__changed(service, job, 0);
    enum umb_status status = umbj_table_spec(service->table, job->id, scene, settings, &error);
    if (status == UMB_OK) {
        status = service->executor->start(service->executor, &work, &error);
    }
    if (status != UMB_OK) {
        const struct umb_error cause = error;
        /* A damaged row stays damaged. */
        const enum umbj_failure failure = status == UMB_E_CORRUPT ? UMBJ_INTERNAL : UMBJ_TEMPORARY;
        if (umbj__fail_try(service, &failed, failure, cause.message, &error) != UMB_OK) {
            umbj__log_error(service, "job_start", &error); /* the lease will end the job */
        }
    }
}

/* Shows the asset to the job's owner, unless the owner has deleted it, and notifies the
 * watchers. */
static void tell_served(struct umbj_service *service, const struct umbj_job *job)
{
    struct umb_error error;
    int owned = 0;
    if (umbj_table_asset(service->table, job->asset, job->owner, &owned, &error) == UMB_OK &&
        owned) {
        umbj_snapshot_own(service->snapshot, job->asset, job->owner);
    }
    umbj__changed(service, job, 0);
}

static void wait_until_served(struct umbj_service *service, const struct umbj_job *job)
{
    if (!umb__grow(NULL, &service->loading, &service->loading_capacity, service->loading_count + 1,
                   sizeof *service->loading)) {
        tell_served(service, job); /* a little early, for lack of memory */
        return;
    }
    service->loading[service->loading_count++] =
        (struct umbj_loading){.job = *job, .since_ms = umbj__steady_ms(service)};
    umbj_snapshot_set(service->snapshot, job, 1);
}

void umbj__look_at_loading(struct umbj_service *service)
{
    const struct umbj_service_options *options = &service->options;
    for (size_t i = 0; i < service->loading_count;) {
        struct umbj_loading *loading = &service->loading[i];
        int served =
            options->is_served != NULL ? options->is_served(options->user, loading->job.asset) : 1;
        if (served == 0 && umbj__steady_ms(service) - loading->since_ms > SERVE_MOST_MS) {
            served = -1;
        }
        if (served != 0) {
            if (served < 0) {
                umbs_log_event(options->log, UMB_LOG_WARN, "job_not_served", "job=%s",
                               loading->job.id);
            }
            tell_served(service, &loading->job);
            *loading = service->loading[--service->loading_count];
        } else {
            i++;
        }
    }
}

/* Returns the size of the file to be published: the staged file, or one published by an earlier
 * try. */
static enum umb_status size_of(struct umbj_service *service, const struct umbj_report *report,
                               int64_t *bytes, struct umb_error *error)
{
    char path[PATH_SIZE];
    struct stat info;
    umbj_asset_path(service->assets_path, report->asset, path, sizeof path);
    const int failed =
        report->staged.temporary != NULL ? fstat(report->staged.fd, &info) : stat(path, &info);
    *bytes = failed ? 0 : (int64_t)info.st_size;
    return failed ? umb_fail_errno(error, UMB_E_IO, errno, "the asset's file is gone") : UMB_OK;
}

/* Gives the staged file its name. Without a staged file, an earlier try has already done so. */
static enum umb_status give_name(struct umbj_service *service, struct umbj_report *report,
                                 struct umb_error *error)
{
    const struct umbj_service_options *options = &service->options;
    if (report->staged.temporary == NULL) {
        return UMB_OK; /* size_of found it, and only this thread removes files */
    }
    if (options->replacing != NULL) {
        options->replacing(options->user, report->asset, 1);
    }
    const enum umb_status status = umbu_output_commit(&report->staged, error);
    if (status != UMB_OK && options->replacing != NULL) {
        options->replacing(options->user, report->asset, 0);
    }
    return status;
}

/* The steps of publishing, in the order that service.h explains. */
static enum umb_status publish(struct umbj_service *service, struct umbj_job *job,
                               struct umbj_report *report, struct umb_error *error)
{
    int64_t bytes = 0;
    UMB__TRY(size_of(service, report, &bytes, error));
    UMB__TRY(umbj_table_check_asset(service->table, job->owner, report->asset, bytes, error));
    UMB__TRY(umbj_table_announce(service->table, report->asset, bytes, error));
    UMB__TRY(give_name(service, report, error));
    UMB__TRY(umbj_table_finish(service->table, job, report->asset, report->bake_ms,
                               umbj__unix_ms(service), error));
    return umbj_table_get(service->table, job->id, NULL, job, error);
}

static void take_end(struct umbj_service *service, struct umbj_job *job, struct umbj_report *report)
{
    struct umb_error error = {0};
    enum umb_status status;
    if (report->failure == UMBJ_NO_FAILURE) {
        status = publish(service, job, report, &error);
        if (status == UMB_OK) {
            atomic_fetch_add(&service->counters.finished, 1);
            atomic_fetch_add(&service->counters.bake_ms, (uint64_t)report->bake_ms);
            wait_until_served(service, job);
            if (service->options.store_changed != NULL) {
                service->options.store_changed(service->options.user);
            }
            umbj__drop_bundle(service, job->key);
        } else if (status != UMB_E_STATE) {
            const struct umb_error cause = error;
            /* A quota: another try changes nothing. */
            const enum umbj_failure failure = status == UMB_E_BUSY ? UMBJ_REJECTED : UMBJ_IO;
            status = umbj__fail_try(service, job, failure, cause.message, &error);
        }
        umbj__collect_assets(service); /* files of a late or failed publish */
    } else {
        status = umbj__fail_try(service, job, report->failure, report->text, &error);
    }
    if (status != UMB_OK && status != UMB_E_STATE) {
        umbj__log_error(service, "job_end", &error); /* the lease will end the job */
    }
}

/* Logs a farm's task that failed or was lost. */
static void log_task(const struct umbj_service *service, const struct umbj_report *report)
{
    char cause[UMBS_LOG_QUOTE_SIZE];
    umbs_log_event(service->options.log, UMB_LOG_WARN, "job_task",
                   "job=%s epoch=%lld task=%llu of=%llu failure=%s cause=%s", report->job,
                   (long long)report->epoch, (unsigned long long)report->done,
                   (unsigned long long)report->total, umbj_failure_name(report->failure),
                   umbs_log_quote(report->text, cause));
}

void umbj__take_report(struct umbj_service *service, struct umbj_report *report)
{
    struct umbj_job job;
    struct umb_error error = {0};
    if (service->lost) { /* another daemon runs the job: this try ends and publishes nothing */
        if (report->kind != UMBJ_REPORT_ENDED) {
            service->executor->cancel(service->executor, report->job, report->epoch);
        }
        umbu_output_abandon(&report->staged);
        return;
    }
    enum umb_status status = umbj_table_get(service->table, report->job, NULL, &job, &error);
    const int counts = status == UMB_OK && job.state == UMBJ_RUNNING && job.epoch == report->epoch;
    if (counts && report->kind == UMBJ_REPORT_ENDED) {
        take_end(service, &job, report);
    } else if (counts) {
        const int64_t lease = service->options.limits.lease_ms;
        const int64_t steady = umbj__steady_ms(service);
        const struct umbj_tiles more = umbj_snapshot_report(service->snapshot, report, steady);
        if (report->kind == UMBJ_REPORT_TILES && more.done > 0) {
            umbs_log_event(service->options.log, UMB_LOG_DEBUG, "job_tiles",
                           "job=%s epoch=%lld done=%llu found=%llu of=%llu", report->job,
                           (long long)report->epoch, (unsigned long long)report->done,
                           (unsigned long long)report->found, (unsigned long long)report->total);
        }
        if (report->kind == UMBJ_REPORT_TASK) {
            atomic_fetch_add(&service->counters.task_failures[report->failure], 1);
            log_task(service, report);
        }
        atomic_fetch_add(&service->counters.tiles_baked, more.done - more.found);
        atomic_fetch_add(&service->counters.tiles_found, more.found);
        if (job.lease_until_ms - steady < lease - lease / LEASE_PARTS) {
            status = umbj_table_renew(service->table, job.id, job.epoch, steady, &error);
        }
    } else if (report->kind == UMBJ_REPORT_ENDED) {
        umbs_log_event(service->options.log, UMB_LOG_INFO, "job_late", "job=%s epoch=%lld now=%lld",
                       report->job, (long long)report->epoch, (long long)job.epoch);
    }
    umbu_output_abandon(&report->staged); /* no effect if it was committed */
    if (status != UMB_OK && status != UMB_E_NOT_FOUND) {
        umbj__log_error(service, "job_report", &error);
    }
}

static void take_owned(void *user, const uint8_t *asset, const char *owner)
{
    umbj_snapshot_own(user, asset, owner);
}

/* Removes a bundle that no unfinished job needs. */
static void sweep_bundle(void *user, int folder, const char *name)
{
    uint8_t key[UMBJ_HASH_BYTES];
    if (umb_id_from_text(name, key) == UMB_OK) {
        umbj__drop_bundle(user, key);
    } else {
        umbj_folder_remove(folder, name);
    }
}

/* Removes a temporary of an asset that an earlier daemon was staging. */
static void sweep_staged(void *user, int folder, const char *name)
{
    (void)user;
    if (strncmp(name, ".tmp.", 5) == 0) {
        (void)unlinkat(folder, name, 0);
    }
}

/* Adds the sizes of assets that an older version recorded without them. Assets without a file are
 * left out. */
static void fill_sizes(struct umbj_service *service)
{
    uint8_t asset[UMBJ_HASH_BYTES] = {0};
    char path[PATH_SIZE];
    struct umb_error error;
    struct stat info;
    while (umbj_table_next_unsized(service->table, asset, &error) == UMB_OK) {
        umbj_asset_path(service->assets_path, asset, path, sizeof path);
        if (stat(path, &info) == 0 && info.st_size > 0 &&
            umbj_table_announce(service->table, asset, info.st_size, &error) != UMB_OK) {
            return;
        }
    }
}

enum umb_status umbj__recover(struct umbj_service *service, struct umb_error *error)
{
    int64_t lost = 0;
    UMB__TRY(umbj_table_recover(service->table, umbj__unix_ms(service), &lost, error));
    UMB__TRY(umbj_table_owned(service->table, take_owned, service->snapshot, error));
    umbj_folder_empty(service->folder, "incoming");
    umbj_folder_empty(service->folder, "work");
    (void)umbj_folder_each(openat(service->folder, "bundles", O_RDONLY | O_DIRECTORY | O_CLOEXEC),
                           sweep_bundle, service);
    (void)umbj_folder_each(open(service->assets_path, O_RDONLY | O_DIRECTORY | O_CLOEXEC),
                           sweep_staged, NULL);
    fill_sizes(service);
    umbj__collect_assets(service);
    umbj__recount(service);
    atomic_fetch_add(&service->counters.failures[UMBJ_LOST], (uint64_t)lost);
    umbs_log_event(service->options.log, UMB_LOG_INFO, "jobs_open",
                   "lost=%lld queued=%lld damaged_rows=%lld", (long long)lost,
                   (long long)atomic_load(&service->counters.states[UMBJ_QUEUED]),
                   (long long)umbj_table_damaged(service->table));
    return UMB_OK;
}
