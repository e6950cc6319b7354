/* SPDX-License-Identifier: Apache-2.0 */
/* Requests of owners to the job service. */
#include "jobs/service_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/file_system.h"
#include "jobs/staging.h"

/* Removes the rows of an asset whose file was removed from outside. Otherwise the asset could never
 * be made again. */
static void disown_missing(struct umbj_service *service, const struct umbj_job *job)
{
    char path[4200];
    struct umb_error error;
    umbj_asset_path(service->assets_path, job->asset, path, sizeof path);
    if (job->state == UMBJ_DONE && access(path, F_OK) != 0 && errno == ENOENT &&
        umbj_table_disown(service->table, job->asset, NULL, &error) == UMB_OK) {
        umbj__collect_assets(service);
    }
}

static struct umbj_pending pending_of(const struct umbj_service *service, const char *owner)
{
    struct umbj_pending pending = {0, 0, 0};
    for (const struct umbj_promise *at = service->promises; at != NULL; at = at->next) {
        const int own = strcmp(at->owner, owner) == 0;
        pending.own_jobs += own;
        pending.own_bytes += own ? at->bytes : 0;
        pending.all_bytes += at->bytes;
    }
    return pending;
}

/* Begins an upload; from now on its bytes count for the quotas. */
static enum umb_status begin_upload(struct umbj_service *service, const char *owner,
                                    const struct umbj_manifest *manifest,
                                    const struct umbj_prepared *prepared,
                                    struct umbj_upload **upload, struct umb_error *error)
{
    const int64_t bytes = (int64_t)prepared->bytes;
    const struct umbj_pending pending = pending_of(service, owner);
    enum umb_status status = umbj_table_check_quota(service->table, owner, bytes, &pending, error);
    if (status != UMB_OK) {
        umbj__note_refusals(service);
        return status;
    }
    struct umbj_promise *promise = calloc(1, sizeof *promise);
    if (promise == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for an upload");
    }
    status = umbj_upload_begin(service->options.folder, manifest, prepared->key,
                               umbj_file_threads_stop(service->file_threads), upload, error);
    if (status != UMB_OK) {
        free(promise);
        return status;
    }
    memcpy(promise->owner, owner, strlen(owner) + 1); /* checked where owners are read */
    memcpy(promise->key, prepared->key, sizeof promise->key);
    promise->upload = *upload;
    umbj_upload_hold(*upload); /* if the service ends, a skipped call releases only its own hold */
    promise->bytes = bytes;
    promise->next = service->promises;
    service->promises = promise;
    return UMB_OK;
}

static void drop_promise(struct umbj_service *service, const struct umbj_upload *upload)
{
    uint8_t key[UMBJ_HASH_BYTES];
    struct umbj_promise **at = &service->promises;
    while (*at != NULL && (*at)->upload != upload) {
        at = &(*at)->next;
    }
    struct umbj_promise *promise = *at;
    if (promise != NULL) {
        *at = promise->next;
        memcpy(key, promise->key, sizeof key);
        umbj_upload_let_go(promise->upload);
        free(promise);
        umbj__drop_bundle(service, key); /* bundle that the upload kept, and perhaps made */
    }
}

void umbj_service_drop_upload(struct umbj_service *service, struct umbj_upload *upload)
{
    drop_promise(service, upload);
    umbj_upload_destroy(upload);
}

/* Fails if another daemon took over: this daemon then accepts, cancels and removes nothing. */
static enum umb_status check_ours(const struct umbj_service *service, struct umb_error *error)
{
    return !service->lost
               ? UMB_OK
               : umb_fail(error, UMB_E_UNAVAILABLE, "jobs: another daemon has taken over '%.150s'",
                          service->options.folder);
}

enum umb_status umbj_service_submit(struct umbj_service *service, const char *owner,
                                    const struct umbj_manifest *manifest,
                                    const struct umbj_prepared *prepared, struct umbj_job *job,
                                    struct umbj_upload **upload, struct umb_error *error)
{
    const uint8_t *key = prepared->key;
    *upload = NULL;
    memset(job, 0, sizeof *job);
    UMB__TRY(check_ours(service, error));
    enum umb_status status = umbj_table_find_same(service->table, owner, key, job, error);
    if (status == UMB_OK) {
        disown_missing(service, job);
        status = umbj_table_find_same(service->table, owner, key, job, error);
    }
    if (status == UMB_OK) {
        return umbj_service_show(service, job->id, owner, error);
    }
    if (status == UMB_E_NOT_FOUND) {
        memset(job, 0, sizeof *job);
        status = begin_upload(service, owner, manifest, prepared, upload, error);
    }
    return status;
}

enum umb_status umbj_service_accept(struct umbj_service *service, const char *owner,
                                    const struct umbj_manifest *manifest,
                                    const struct umbj_prepared *prepared,
                                    struct umbj_upload *upload, struct umbj_job *job,
                                    struct umb_error *error)
{
    int is_new = 0;
    const struct umbj_submission submission = {
        .owner = owner,
        .key = prepared->key,
        .priority = manifest->priority,
        .scene = manifest->scene,
        .settings = prepared->settings,
        .bundle_bytes = (int64_t)prepared->bytes,
    };
    enum umb_status status = check_ours(service, error);
    if (status == UMB_OK) {
        status = umbj_table_submit(service->table, &submission, umbj__unix_ms(service), job,
                                   &is_new, error);
    }
    drop_promise(service, upload); /* the upload counts as a job now; or its bundle is removed */
    if (status == UMB_OK && is_new) {
        atomic_fetch_add(&service->counters.submitted, 1);
        umbj__changed(service, job, 0);
    }
    return status;
}

enum umb_status umbj_service_show(struct umbj_service *service, const char *id, const char *owner,
                                  struct umb_error *error)
{
    struct umbj_job job;
    UMB__TRY(umbj_table_get(service->table, id, owner, &job, error));
    if (umbj_snapshot_version(service->snapshot, id) == 0) {
        umbj_snapshot_set(service->snapshot, &job, 0);
    }
    return UMB_OK;
}

enum umb_status umbj_service_cancel(struct umbj_service *service, const char *id, const char *owner,
                                    struct umbj_job *job, struct umb_error *error)
{
    struct umbj_job before;
    UMB__TRY(check_ours(service, error));
    UMB__TRY(umbj_table_get(service->table, id, owner, &before, error));
    UMB__TRY(umbj_table_cancel(service->table, id, owner, umbj__unix_ms(service), job, error));
    if (umbj_is_over(before.state)) {
        return UMB_OK;
    }
    if (before.state == UMBJ_RUNNING) {
        service->executor->cancel(service->executor, before.id, before.epoch);
    }
    atomic_fetch_add(&service->counters.failures[UMBJ_CANCELLED], 1);
    umbj__changed(service, job, 0);
    umbj__drop_bundle(service, job->key);
    return UMB_OK;
}

enum umb_status umbj_service_list(struct umbj_service *service, const char *owner, int64_t most,
                                  struct umbj_job **jobs, size_t *count, struct umb_error *error)
{
    return umbj_table_list(service->read_table, owner, most, jobs, count, error);
}

/* Fails as if the asset were not there if it is not the owner's. */
static enum umb_status check_owned(struct umbj_service *service, const uint8_t *asset,
                                   const char *owner, struct umb_error *error)
{
    int owned = 0;
    UMB__TRY(umbj_table_asset(service->table, asset, owner, &owned, error));
    return owned ? UMB_OK : umb_fail(error, UMB_E_NOT_FOUND, "asset: no job of yours made it");
}

enum umb_status umbj_service_open_asset(struct umbj_service *service, const uint8_t *asset,
                                        const char *owner, int *fd, uint64_t *bytes,
                                        struct umb_error *error)
{
    char path[4200];
    struct stat info;
    *fd = -1;
    *bytes = 0;
    UMB__TRY(check_owned(service, asset, owner, error));
    umbj_asset_path(service->assets_path, asset, path, sizeof path);
    *fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (*fd < 0 || fstat(*fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        umbs_hang_up(fd);
        return umb_fail_errno(error, errno == ENOENT ? UMB_E_NOT_FOUND : UMB_E_IO, errno,
                              "asset: its file cannot be read");
    }
    *bytes = (uint64_t)info.st_size;
    return UMB_OK;
}

enum umb_status umbj_service_delete(struct umbj_service *service, const uint8_t *asset,
                                    const char *owner, struct umb_error *error)
{
    char id[UMB_ID_TEXT_SIZE], quoted[UMBS_LOG_QUOTE_SIZE];
    UMB__TRY(check_ours(service, error));
    UMB__TRY(umbj_table_disown(service->table, asset, owner, error));
    umb_id_to_text(asset, id);
    umbs_log_event(service->options.log, UMB_LOG_INFO, "asset_disowned", "asset=%s owner=%s", id,
                   owner != NULL ? umbs_log_quote(owner, quoted) : "all");
    if (owner != NULL) {
        umbj_snapshot_disown(service->snapshot, asset, owner);
    }
    umbj__collect_assets(service);
    return UMB_OK;
}
