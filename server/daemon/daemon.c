/* SPDX-License-Identifier: Apache-2.0 */
/* Setting up and taking down the state that the loops share. */
#include "daemon/daemon.h"

#include "daemon/calibrations.h"
#include "daemon/loop_group.h"
#include "jobs/service.h"
#include "daemon/service_manager.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* One part in this of --max-buffer is reserved for callers with rights. */
#define KEPT_SHARE 4
/* Of a connection without rights, if all of them fit into a quarter. */
#define STRANGER_BYTES     65536
#define STRANGER_BYTES_LOW 16384 /* but a Watch and the call that shows a right must fit */

/* Bytes that a connection may hold before it has shown a right. */
static size_t stranger_bytes(const struct umbd_options *options)
{
    const uint64_t share = options->max_buffer / KEPT_SHARE / options->max_connections;
    return share > STRANGER_BYTES       ? STRANGER_BYTES
           : share < STRANGER_BYTES_LOW ? STRANGER_BYTES_LOW
                                        : (size_t)share;
}

/* Callbacks of the job service into the daemon, on its thread. */
static void jobs_changed_store(void *user)
{
    struct umbd_daemon *daemon = user;
    umbd_store_watch_kick(daemon->watch);
}

static void jobs_replacing(void *user, const uint8_t *asset, int yes)
{
    struct umbd_daemon *daemon = user;
    umbs_store_replacing(daemon->store, asset, daemon->store_count, yes);
}

static int jobs_is_served(void *user, const uint8_t *asset)
{
    struct umbd_daemon *daemon = user;
    struct umbs_entry *entry = NULL;
    struct umb_error error;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(asset, id);
    enum umb_status status = umbs_store_acquire(daemon->store, id, &entry, &error);
    if (status == UMB_OK && umbs_entry_is_replaced(entry)) {
        status = UMB_E_NOT_FOUND; /* the version before it */
    }
    umbs_entry_release(entry);
    return status == UMB_OK ? 1 : status == UMB_E_NOT_FOUND ? 0 : -1;
}

static enum umb_status start_jobs(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->options;
    const struct umbj_service_options service = {
        .folder = options->jobs,
        .table = options->jobs_db,
        .tries.program = options->bake_program,
        .tries.sandbox = options->job_sandbox,
        .slurm = strcmp(options->executor, "slurm") == 0,
        .tries.interval_ms = options->executor_interval_ms,
        .slurm_words = options->slurm_options,
        .tries.workers = options->bake_workers,
        .tries.threads = options->bake_threads,
        .tries.memory_bytes = options->bake_memory,
        .tries.tile = options->bake_tile,
        .tries.cache_bytes = options->tile_cache,
        .tries.timeout_ms = options->job_time_ms,
        .tries.max_output_bytes = options->max_asset,
        .max_bundle_bytes = options->max_bundle,
        .keep_ms = options->job_keep_ms,
        .limits = {.owner_jobs = options->owner_jobs,
                   .owner_bytes = (int64_t)options->owner_bytes,
                   .total_bytes = (int64_t)options->job_bytes,
                   .lease_ms = (int64_t)options->job_lease_ms,
                   .owner_assets = (int64_t)options->owner_assets,
                   .owner_history = options->owner_history},
        .log = &daemon->log,
        .store_changed = jobs_changed_store,
        .replacing = jobs_replacing,
        .is_served = jobs_is_served,
        .user = daemon,
    };
    return umbj_service_create(&service, &daemon->jobs, error);
}

void umbd_daemon_end_jobs(struct umbd_daemon *daemon)
{
    struct umbj_service *jobs = daemon->jobs;
    daemon->jobs = NULL; /* no loop runs any more */
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

/* Folder of mapped files: that of the options, else that of systemd; NULL: one in each store.
 * Several names in CACHE_DIRECTORY are separated by colons. */
static const char *cache_folder(struct umbd_daemon *daemon)
{
    const char *made = getenv("CACHE_DIRECTORY");
    if (daemon->options.cache != NULL || made == NULL || made[0] == '\0') {
        return daemon->options.cache;
    }
    const size_t length = strcspn(made, ":");
    (void)snprintf(daemon->cache, sizeof daemon->cache, "%.*s", (int)length, made);
    return daemon->cache;
}

/* Lists the store's folders: the operator's, then that of jobs' assets. */
static enum umb_status list_folders(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->options;
    memcpy(daemon->folders, options->stores, sizeof daemon->folders);
    while (daemon->folders[daemon->store_count] != NULL) {
        daemon->store_count++;
    }
    if (options->jobs == NULL) {
        return UMB_OK;
    }
    daemon->folders[daemon->store_count] = daemon->job_assets;
    enum umb_status status = umbd_daemon_check_apart(options, options->jobs, error);
    if (status == UMB_OK) {
        status = umbj_service_prepare(options->jobs, daemon->job_assets, sizeof daemon->job_assets,
                                      error);
    }
    return status == UMB_OK ? umbd_daemon_check_apart(options, daemon->job_assets, error) : status;
}

enum umb_status umbd_daemon_init(struct umbd_daemon *daemon, const struct umbd_options *options,
                                 struct umb_error *error)
{
    memset(daemon, 0, sizeof *daemon);
    daemon->options = *options;
    daemon->max_connections = options->max_connections;
    daemon->stranger_bytes = stranger_bytes(options);
    atomic_store(&daemon->next_serial, 1);
    umbs_log_init(&daemon->log, STDERR_FILENO, options->log_level);
    daemon->log.format = options->log_format;
    daemon->watchdog_ms = umbd_watchdog_ms();
    enum umb_status status =
        umbd_store_watch_create(&daemon->metrics, &daemon->log, &daemon->watch, error);
    if (status == UMB_OK) {
        status = list_folders(daemon, error);
    }
    if (status == UMB_OK) {
        struct umbs_store_options store = {.copy = options->copy,
                                           .warm = options->warm_up,
                                           .cache = cache_folder(daemon),
                                           .max_memory_bytes = options->load_memory,
                                           .log = &daemon->log,
                                           .retired = umbd_store_watch_retired,
                                           .faulted = umbd_store_watch_faulted,
                                           .owner = daemon->watch};
        memcpy(store.folders, daemon->folders, sizeof store.folders);
        status = umbs_store_open(&store, &daemon->store, error);
    }
    if (status == UMB_OK) {
        struct umbs_store_report report;
        status = umbs_store_rescan(daemon->store, &report, error);
        umbd_metrics_scanned(&daemon->metrics, &report);
        if (report.unsettled) {
            umbd_store_watch_kick(daemon->watch);
        }
    }
    if (status == UMB_OK && options->token_file != NULL) {
        status = umbd_tokens_create(options->token_file, &daemon->tokens, error);
    }
    if (status == UMB_OK) {
        daemon->peers = umbd_peers_create();
        status = daemon->peers != NULL
                     ? UMB_OK
                     : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the peers");
    }
    if (status == UMB_OK) {
        daemon->calibrations = umbd_calibrations_create();
        status = daemon->calibrations != NULL
                     ? UMB_OK
                     : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for calibrations");
    }
    if (status == UMB_OK && options->tls_cert != NULL && options->tls_key != NULL) {
        struct umbd_tls_files files = {options->tls_cert, options->tls_key, options->tls_client_ca,
                                       options->tls_crl};
        status = umbd_tls_create(&files, &daemon->tls, error);
    }
    /* Until here a signal ends the process in the default way: the first scan may take minutes, and
     * there is nothing to drain yet. The threads started from here on inherit the mask. */
    umbd_signals_block();
    if (status == UMB_OK) {
        status = umbd_pool_create(options->workers, options->queue, &daemon->metrics, &daemon->pool,
                                  error);
    }
    if (status == UMB_OK) {
        status = umbd_store_watch_start(daemon->watch, daemon->store, daemon->folders,
                                        options->scrub_interval_ms, error);
    }
    if (status == UMB_OK && options->jobs != NULL) {
        status = start_jobs(daemon, error);
    }
    if (status != UMB_OK) {
        (void)umbd_daemon_finish(daemon); /* its thread is not running yet */
    }
    return status;
}

int umbd_daemon_finish(struct umbd_daemon *daemon)
{
    umbd_daemon_end_jobs(daemon);
    umbd_pool_destroy(daemon->pool);
    daemon->pool = NULL;
    umbd_peers_destroy(daemon->peers);
    umbd_tokens_destroy(daemon->tokens);
    umbd_tls_destroy(daemon->tls);
    umbd_calibrations_destroy(daemon->calibrations);
    daemon->calibrations = NULL;
    daemon->peers = NULL;
    daemon->tokens = NULL;
    daemon->tls = NULL;
    /* No entry is held any more, so the watch gets no further callbacks. */
    if (!umbd_store_watch_destroy(daemon->watch)) {
        return 0;
    }
    umbs_store_close(daemon->store);
    daemon->watch = NULL;
    daemon->store = NULL;
    return 1;
}

int umbd_daemon_charge(struct umbd_daemon *daemon, size_t bytes)
{
    uint64_t before = atomic_fetch_add(&daemon->buffered, bytes);
    if (before + bytes > daemon->options.max_buffer) {
        atomic_fetch_sub(&daemon->buffered, bytes);
        return 0;
    }
    return 1;
}

void umbd_daemon_uncharge(struct umbd_daemon *daemon, size_t bytes)
{
    atomic_fetch_sub(&daemon->buffered, bytes);
}

void umbd_daemon_gauges(struct umbd_daemon *daemon, struct umbd_gauges *gauges)
{
    umbs_store_count(daemon->store, &gauges->assets);
    gauges->queue_depth = umbd_pool_depth(daemon->pool);
    gauges->buffered_bytes = atomic_load(&daemon->buffered);
    if (daemon->jobs != NULL) {
        gauges->jobs = umbj_service_counters(daemon->jobs);
        gauges->tiles = umbj_snapshot_tiles(umbj_service_snapshot(daemon->jobs));
    } else {
        gauges->jobs = NULL;
    }
    gauges->ready = !atomic_load(&daemon->draining);
}

void umbd_daemon_alive(struct umbd_daemon *daemon, uint64_t now_ms)
{
    if (daemon->watchdog_ms > 0 && now_ms >= daemon->watchdog_at_ms &&
        umbd_loops_tick_age_ms(daemon) < daemon->watchdog_ms) {
        daemon->watchdog_at_ms = now_ms + daemon->watchdog_ms;
        umbd_notify("WATCHDOG=1");
    }
}
