/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_SERVICE_H
#define UMBRAGE_SERVER_JOBS_SERVICE_H
/*
 * The job service: one thread that owns the table and the executor, threads for the files of calls
 * (file_threads.h), and the requests to both.
 *
 *     umbj_service_create(&options, &service, &error);      recovers an earlier daemon's jobs
 *     umbj_service_post(service, &request);                 request.files, then request.run
 *     umbj_service_destroy(service);                        workers are ended; their jobs go on
 *                                                           with the next daemon
 *
 * Publishing an asset: the worker's file is staged (staging.h). Then, on this thread, the asset is
 * announced in the table, the file gets its name, and job, asset and owner are recorded in one
 * transaction that the epoch fences. A crash between any two steps leaves at most an announced file
 * without an owner, which the next start removes; the job is tried again and gives the same bytes.
 * Watchers see a job as done when the daemon serves the asset, and only then may its owner see it.
 * Each step is the same, and takes as long, whether or not other owners have the asset: the file is
 * copied, synced, read again, renamed and loaded anew.
 *
 * Assets of jobs lie in a folder of their own inside the jobs folder. A file that an operator put
 * into a store never becomes a job's, whatever its name: it is neither taken over nor removed.
 *
 * One daemon a jobs folder and table: job_place.h. A daemon that finds another one has taken over
 * starts no job, takes no submission, publishes nothing and removes no file. It cancels its tries
 * at their next report; the epoch fences reports from before that.
 */
#include <stdatomic.h>
#include "common/log.h"
#include "jobs/file_threads.h"
#include "jobs/status_snapshot.h"
#include "jobs/bundle.h"
#include "jobs/job_table.h"
#include "jobs/upload.h"

/* Clocks, in milliseconds. Leases use `steady`, a monotonic clock that stands still while the
 * machine sleeps, as bakes do. `unix_ms` is for times that are shown or outlive the process:
 * submission, start, end, pauses between tries. */
struct umbj_clocks {
    int64_t (*unix_ms)(void *user);
    int64_t (*steady_ms)(void *user);
    void *user;
};

struct umbj_service_options {
    const char *folder;      /* Path of the jobs folder; made if it does not exist */
    const char *table;       /* File of the job table; NULL = FOLDER/jobs.db */
    int slurm;               /* 1 = tiles are baked by Slurm, 0 = on this machine */
    const char *slurm_words; /* More options of sbatch, with blanks between; NULL = none */
    /* Options of each bake. tries.program: umbrage-bake; NULL = beside the running program. The
     * service sets assets, work, farm, report and user. */
    struct umbj_try_options tries;
    uint64_t max_bundle_bytes; /* Limit of one submission */
    uint64_t keep_ms;          /* Milliseconds for which finished jobs are kept */
    struct umbj_limits limits;
    const struct umbs_log *log;
    /* Callback, on the service's thread, after a file of the store was added or removed. */
    void (*store_changed)(void *user);
    /* Callback before an asset's file gets its name (yes = 1), and again if the renaming failed
     * (yes = 0). The store then loads the file anew, so that an owner cannot tell by the time
     * whether others have the asset. NULL: nothing to do. */
    void (*replacing)(void *user, const uint8_t *asset, int yes);
    /* Callback: 1 if the asset is served, 0 if not yet, -1 if it never will be. NULL: always 1. */
    int (*is_served)(void *user, const uint8_t *asset);
    void *user;
    /* For tests; NULL: the system's clocks, and an executor made from the options above. */
    const struct umbj_clocks *clocks;
    struct umbj_executor *executor; /* the service's, also if create fails */
};

/* Counters for the metrics; all but the states only grow. */
struct umbj_counters {
    atomic_int_fast64_t states[UMBJ_STATE_COUNT]; /* number of jobs now, by state */
    atomic_uint_fast64_t failures[UMBJ_FAILURE_COUNT];
    atomic_uint_fast64_t task_failures[UMBJ_FAILURE_COUNT]; /* failed tasks of a farm, by failure */
    atomic_int_fast64_t owned_bytes; /* Bytes of assets; an asset of two owners counts twice */
    atomic_uint_fast64_t refused[UMBJ_QUOTA_COUNT]; /* refused submissions and assets, by quota */
    atomic_uint_fast64_t damaged_rows;              /* damaged rows of the table */
    atomic_uint_fast64_t submitted, finished;
    atomic_uint_fast64_t bake_ms;                  /* milliseconds of all finished bakes */
    atomic_uint_fast64_t tiles_baked, tiles_found; /* found: kept from earlier bakes */
};

/* Makes the jobs folder and its folder of assets if they do not exist, so that a store can be
 * opened on it before the service is created. Out: assets: its path. Fails: E_CANNOT_CREATE,
 * E_LIMIT (path too long). */
UMB_CHECKED enum umb_status umbj_service_prepare(const char *folder, char *assets, size_t size,
                                                 struct umb_error *error);

/* Opens the table, recovers earlier jobs, and starts the thread. Fails: E_CANNOT_CREATE, E_BUSY
 * (another daemon has the folder), E_UNAVAILABLE (no umbrage-bake), as umbj_table_open. */
UMB_CHECKED enum umb_status umbj_service_create(const struct umbj_service_options *options,
                                                struct umbj_service **out, struct umb_error *error);

/* Ends the workers, answers waiting requests, joins the thread. NULL is allowed. */
void umbj_service_destroy(struct umbj_service *service);

/* Queues a request. Any thread, at once. */
void umbj_service_post(struct umbj_service *service, struct umbj_request *request);

/* The service's snapshot. Any thread. */
struct umbj_snapshot *umbj_service_snapshot(struct umbj_service *service);
struct umbj_counters *umbj_service_counters(struct umbj_service *service);
const struct umbj_service_options *umbj_service_options_of(const struct umbj_service *service);

/* --- on the service's thread, in umbj_request.run --- */

/*
 * Begins a submission: finds an equal job, or makes an upload to be filled.
 *
 * In:    prepared: of the manifest (umbj_manifest_prepare), made on a thread for files.
 * Out:   job: the existing job, or an empty id and *upload, for umbj_service_drop_upload: its bytes
 *        count for the quotas until it is accepted or dropped, and a bundle of its key stays.
 * Fails: as umbj_table_check_quota, umbj_upload_begin.
 */
UMB_CHECKED enum umb_status umbj_service_submit(struct umbj_service *service, const char *owner,
                                                const struct umbj_manifest *manifest,
                                                const struct umbj_prepared *prepared,
                                                struct umbj_job *job, struct umbj_upload **upload,
                                                struct umb_error *error);

/* Frees an upload of _submit in any state; NULL is allowed. A thread for files has removed its
 * files before (umbj_upload_discard). */
void umbj_service_drop_upload(struct umbj_service *service, struct umbj_upload *upload);

/* Makes the job of an upload whose bundle has its final name (umbj_upload_accept, on a thread for
 * files). Fails: as umbj_table_submit. */
UMB_CHECKED enum umb_status umbj_service_accept(struct umbj_service *service, const char *owner,
                                                const struct umbj_manifest *manifest,
                                                const struct umbj_prepared *prepared,
                                                struct umbj_upload *upload, struct umbj_job *job,
                                                struct umb_error *error);

/* Puts a job in the snapshot if it is not there. Fails: E_NOT_FOUND. owner: NULL = any owner. */
UMB_CHECKED enum umb_status umbj_service_show(struct umbj_service *service, const char *id,
                                              const char *owner, struct umb_error *error);

UMB_CHECKED enum umb_status umbj_service_cancel(struct umbj_service *service, const char *id,
                                                const char *owner, struct umbj_job *job,
                                                struct umb_error *error);

/* Lists jobs; for umbj_request.files of a request that reads. */
UMB_CHECKED enum umb_status umbj_service_list(struct umbj_service *service, const char *owner,
                                              int64_t most, struct umbj_job **jobs, size_t *count,
                                              struct umb_error *error);

/* Opens the packed file of an asset that a job of the owner made. Fails: E_NOT_FOUND, E_IO. */
UMB_CHECKED enum umb_status umbj_service_open_asset(struct umbj_service *service,
                                                    const uint8_t *asset, const char *owner,
                                                    int *fd, uint64_t *bytes,
                                                    struct umb_error *error);

/* Takes an asset from an owner; without owners its file is removed. Fails: E_NOT_FOUND, E_IO. */
UMB_CHECKED enum umb_status umbj_service_delete(struct umbj_service *service, const uint8_t *asset,
                                                const char *owner, struct umb_error *error);

#endif
