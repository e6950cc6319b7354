/* SPDX-License-Identifier: Apache-2.0 */
/* Setting up and taking down the state that the loops share. */
#include "daemon/daemon.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "daemon/base/service_manager.h"
#include "daemon/service/services.h"
#include "daemon/transport/loop.h"
#include "daemon/work/calibrations.h"
#include "daemon/work/pool.h"
#include "jobs/service.h"

/* Callbacks of the job service into the daemon, on its thread. */
static void jobs_changed_store(void *user)
{
    struct umbd_daemon *daemon = user;
    umbd_store_watch_kick(daemon->watch);
}

static void jobs_replacing(void *user, const uint8_t *asset, int yes)
{
    struct umbd_daemon *daemon = user;
    umbs_store_replacing(daemon->backend.store, asset, daemon->backend.store_count, yes);
}

static int jobs_is_served(void *user, const uint8_t *asset)
{
    struct umbd_daemon *daemon = user;
    struct umbs_entry *entry = NULL;
    struct umb_error error;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(asset, id);
    enum umb_status status = umbs_store_acquire(daemon->backend.store, id, &entry, &error);
    if (status == UMB_OK && umbs_entry_is_replaced(entry)) {
        status = UMB_E_NOT_FOUND; /* this is the version that is being replaced */
    }
    umbs_entry_release(entry);
    return status == UMB_OK ? 1 : status == UMB_E_NOT_FOUND ? 0 : -1;
}

static enum umb_status start_jobs(struct umbd_daemon *daemon, struct umb_error *error)
{
    struct umbj_service_options service = daemon->server.options.bakes;
    service.log = &daemon->server.log;
    service.store_changed = jobs_changed_store;
    service.replacing = jobs_replacing;
    service.is_served = jobs_is_served;
    service.user = daemon;
    return umbj_service_create(&service, &daemon->backend.jobs, error);
}

void umbd_daemon_end_jobs(struct umbd_daemon *daemon)
{
    struct umbj_service *jobs = daemon->backend.jobs;
    daemon->backend.jobs = NULL; /* no loop runs any more */
    umbj_service_destroy(jobs);
}

/* The operator's store that is the same folder; NULL if none is. */
static const char *store_at(const struct umbd_options *options, const char *folder)
{
    struct stat store, other;
    for (size_t i = 0; i < UMBS_STORE_FOLDERS_MAX && options->stores[i] != NULL; i++) {
        if (stat(options->stores[i], &store) == 0 && stat(folder, &other) == 0 &&
            store.st_dev == other.st_dev && store.st_ino == other.st_ino) {
            return options->stores[i];
        }
    }
    return NULL;
}

enum umb_status umbd_daemon_check_apart(const struct umbd_options *options, const char *folder,
                                        struct umb_error *error)
{
    const char *store = store_at(options, folder);
    return store == NULL ? UMB_OK
                         : umb_fail(error, UMB_E_ARGUMENT,
                                    "--jobs: '%.200s' is a --store too: everybody would see every "
                                    "asset",
                                    store);
}

/* Returns the folder of mapped files: the option's, else systemd's; NULL means one in each store.
 * CACHE_DIRECTORY may have several names with colons between them. */
static const char *cache_folder(struct umbd_daemon *daemon)
{
    const char *made = getenv("CACHE_DIRECTORY");
    if (daemon->server.options.cache != NULL || made == NULL || made[0] == '\0') {
        return daemon->server.options.cache;
    }
    const size_t length = strcspn(made, ":");
    (void)snprintf(daemon->cache, sizeof daemon->cache, "%.*s", (int)length, made);
    return daemon->cache;
}

/* Lists the store's folders: the operator's, then that of jobs' assets. */
static enum umb_status list_folders(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->server.options;
    memcpy(daemon->folders, options->stores, sizeof daemon->folders);
    while (daemon->folders[daemon->backend.store_count] != NULL) {
        daemon->backend.store_count++;
    }
    if (options->bakes.folder == NULL) {
        return UMB_OK;
    }
    daemon->folders[daemon->backend.store_count] = daemon->job_assets;
    UMB__TRY(umbd_daemon_check_apart(options, options->bakes.folder, error));
    UMB__TRY(umbj_service_prepare(options->bakes.folder, daemon->job_assets,
                                  sizeof daemon->job_assets, error));
    return umbd_daemon_check_apart(options, daemon->job_assets, error);
}

static enum umb_status open_store(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->server.options;
    struct umbs_store_report report;
    UMB__TRY(umbd_store_watch_create(&daemon->server.metrics, &daemon->server.log, &daemon->watch,
                                     error));
    UMB__TRY(list_folders(daemon, error));
    struct umbs_store_options store = {.copy = options->copy,
                                       .warm = options->warm_up,
                                       .cache = cache_folder(daemon),
                                       .max_memory_bytes = options->load_memory,
                                       .log = &daemon->server.log,
                                       .retired = umbd_store_watch_retired,
                                       .faulted = umbd_store_watch_faulted,
                                       .owner = daemon->watch};
    memcpy(store.folders, daemon->folders, sizeof store.folders);
    UMB__TRY(umbs_store_open(&store, &daemon->backend.store, error));
    enum umb_status status = umbs_store_rescan(daemon->backend.store, &report, error);
    umbd_metrics_scanned(&daemon->server.metrics, &report);
    if (report.unsettled) {
        umbd_store_watch_kick(daemon->watch);
    }
    return status;
}

/* Opens everything before the first thread that serves. */
static enum umb_status open_parts(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->server.options;
    UMB__TRY(open_store(daemon, error));
    if (options->token_file != NULL) {
        UMB__TRY(umbd_tokens_create(options->token_file, &daemon->backend.tokens, error));
        daemon->server.has_tokens = 1;
    }
    daemon->server.peers = umbd_peers_create();
    if (daemon->server.peers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the peers");
    }
    daemon->backend.calibrations = umbd_calibrations_create();
    if (daemon->backend.calibrations == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for calibrations");
    }
    if (options->tls_cert != NULL && options->tls_key != NULL) {
        struct umbd_tls_files files = {options->tls_cert, options->tls_key, options->tls_client_ca,
                                       options->tls_crl};
        return umbd_tls_create(&files, &daemon->server.tls, error);
    }
    return UMB_OK;
}

static enum umb_status start_threads(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->server.options;
    UMB__TRY(umbd_pool_create(options->workers, options->queue, &daemon->server.metrics,
                              &daemon->backend.pool, error));
    UMB__TRY(umbd_store_watch_start(daemon->watch, daemon->backend.store, daemon->folders,
                                    options->scrub_interval_ms, error));
    return options->bakes.folder != NULL ? start_jobs(daemon, error) : UMB_OK;
}

enum umb_status umbd_daemon_init(struct umbd_daemon *daemon, const struct umbd_options *options,
                                 const struct umbd_method *methods, struct umb_error *error)
{
    memset(daemon, 0, sizeof *daemon);
    umbd_server_init(&daemon->server, options);
    umbs_log_init(&daemon->server.log, STDERR_FILENO, options->log_level);
    daemon->server.log.format = options->log_format;
    daemon->server.metrics.methods = methods;
    daemon->server.calls = &umbd_call_events;
    daemon->server.backend = &daemon->backend;
    daemon->backend.methods = methods;
    daemon->backend.web = &umbd_web_method;
    daemon->watchdog_ms = umbd_watchdog_ms();
    enum umb_status status = open_parts(daemon, error);
    /* Blocks the signals only now. Before, a signal ended the process in the default way, because
     * the first scan may take minutes and there was nothing to drain. Threads started later inherit
     * the mask. */
    umbd_signals_block();
    if (status == UMB_OK) {
        status = start_threads(daemon, error);
    }
    if (status != UMB_OK) {
        (void)umbd_daemon_finish(daemon); /* its thread is not running yet */
    }
    return status;
}

int umbd_daemon_finish(struct umbd_daemon *daemon)
{
    umbd_daemon_end_jobs(daemon);
    umbd_pool_destroy(daemon->backend.pool);
    umbd_peers_destroy(daemon->server.peers);
    umbd_tokens_destroy(daemon->backend.tokens);
    umbd_tls_destroy(daemon->server.tls);
    umbd_calibrations_destroy(daemon->backend.calibrations);
    daemon->server.peers = NULL;
    daemon->server.tls = NULL;
    /* No entry is held any more, so the watch gets no further callbacks. */
    if (!umbd_store_watch_destroy(daemon->watch)) {
        return 0;
    }
    umbs_store_close(daemon->backend.store);
    memset(&daemon->backend, 0, sizeof daemon->backend);
    daemon->watch = NULL;
    return 1;
}
