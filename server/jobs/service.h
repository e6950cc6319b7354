/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_SERVICE_H
#define UMBRAGE_SERVER_JOBS_SERVICE_H
/*
 * The job service: one thread that owns the table and the executor, threads for the files of calls
 * (file_threads.h), and requests to both.
 *
 *     umbj_service_create(&options, &service, &error);      recovers an earlier daemon's jobs
 *     umbj_service_post(service, &request);                 request.files, then request.run
 *     umbj_service_destroy(service);                        workers are ended; their jobs go on
 *                                                           with the next daemon
 *
 * Publishing an asset: the worker's file is staged (staging.h). Then, on the service's thread, the
 * asset is announced in the table and the file gets its name. Last, one transaction, fenced by the
 * epoch, records job, asset and owner. A crash between two steps leaves at most an announced file
 * without an owner, which the next start removes. The job is then tried again and gives the same
 * bytes. Watchers see a job as done when the daemon serves the asset, and only then may its owner
 * see the asset. Each step takes as long whether or not other owners have the asset: the file is
 * copied, synced, read again, renamed and loaded anew.
 *
 * Assets of jobs are in a separate folder inside the jobs folder. A file that an operator put into
 * a store never becomes a job's asset, whatever its name: it is neither taken over nor removed.
 *
 * A jobs folder and a table have one daemon at a time (job_place.h). A daemon that finds that
 * another one has taken over starts no job, accepts no submission, publishes nothing and removes no
 * file. It cancels its tries at their next report; the epoch fences reports from before that.
 */
#include <stdatomic.h>
#include "common/log.h"
#include "jobs/file_threads.h"
#include "jobs/status_snapshot.h"
#include "jobs/bundle.h"
#include "jobs/job_table.h"
#include "jobs/upload.h"

/* Clocks, in milliseconds. `steady` is a monotonic clock for leases; like a bake, it stands still
 * while the machine sleeps. `unix_ms` is for times that are shown or outlive the process:
 * submission, start, end, pauses between tries. */
struct umbj_clocks {
    int64_t (*unix_ms)(void *user);
    int64_t (*steady_ms)(void *user);
    void *user;
};

struct umbj_service_options {
    const char *folder;      /* Path of the jobs folder; made if it does not exist */
    const char *table;       /* File of the job table; NULL = FOLDER/jobs.db */
    unsigned slurm;          /* 1 = tiles are baked by Slurm, 0 = on this machine */
    const char *slurm_words; /* More options of sbatch, with blanks between; NULL = none */
    /* Options of each bake. tries.program: path of umbrage-bake; NULL = in the running program's
     * folder. The service sets assets, work, farm, report and user. */
    struct umbj_try_options tries;
    uint64_t max_bundle_bytes; /* Limit of one submission */
    uint64_t keep_ms;          /* Milliseconds for which finished jobs are kept */
    struct umbj_limits limits;
    const struct umbs_log *log;
    /* Callback on the service's thread, after a file of the store was added or removed. */
    void (*store_changed)(void *user);
    /* Callback before an asset's file gets its name (yes = 1), and again if the renaming failed
     * (yes = 0). The store then loads the file anew. Otherwise the time would tell an owner whether
     * others have the asset. NULL: no callback. */
    void (*replacing)(void *user, const uint8_t *asset, int yes);
    /* Callback that returns 1 if the asset is served, 0 if not yet, -1 if it never will be. NULL:
     * always 1. */
    int (*is_served)(void *user, const uint8_t *asset);
    void *user;
    /* Replacements for tests; NULL: the system's clocks, an executor by the options above. */
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

/* Creates the jobs folder and its folder of assets if they do not exist. A store can then be opened
 * on the assets before the service is created. Out: assets: path of the folder of assets. Fails:
 * E_CANNOT_CREATE, E_LIMIT (path too long). */
UMB_CHECKED enum umb_status umbj_service_prepare(const char *folder, char *assets, size_t size,
                                                 struct umb_error *error);

/* Creates the service: opens the table, recovers earlier jobs, and starts the thread. Fails:
 * E_CANNOT_CREATE, E_BUSY (another daemon has the folder), E_UNAVAILABLE (no umbrage-bake), as
 * umbj_table_open. */
UMB_CHECKED enum umb_status umbj_service_create(const struct umbj_service_options *options,
                                                struct umbj_service **out, struct umb_error *error);

/* Ends the workers, answers waiting requests and joins the thread. NULL is allowed. */
void umbj_service_destroy(struct umbj_service *service);

/* Queues a request. Any thread, at once. */
void umbj_service_post(struct umbj_service *service, struct umbj_request *request);

/* The service's snapshot. Any thread. */
struct umbj_snapshot *umbj_service_snapshot(struct umbj_service *service);
struct umbj_counters *umbj_service_counters(struct umbj_service *service);
const struct umbj_service_options *umbj_service_options_of(const struct umbj_service *service);

/* --- on the service's thread, in umbj_request.run --- */

/*
 * Begins a submission: finds an equal job, or creates an upload to be filled.
 *
 * In:    prepared: of the manifest (umbj_manifest_prepare), made on a thread for files.
 * Out:   job: the existing job; or an empty id, and then *upload is set. The upload's bytes count
 *        for the quotas, and a bundle of its key is kept, until umbj_service_drop_upload or the
 *        job's creation.
 * Fails: as umbj_table_check_quota, umbj_upload_begin.
 */
UMB_CHECKED enum umb_status umbj_service_submit(struct umbj_service *service, const char *owner,
                                                const struct umbj_manifest *manifest,
                                                const struct umbj_prepared *prepared,
                                                struct umbj_job *job, struct umbj_upload **upload,
                                                struct umb_error *error);

/* Frees an upload of umbj_service_submit in any state; NULL is allowed. Before, a thread for files
 * must have removed its files (umbj_upload_discard). */
void umbj_service_drop_upload(struct umbj_service *service, struct umbj_upload *upload);

/* Creates the job of an upload whose bundle has its final name (umbj_upload_accept, on a thread for
 * files). Fails: as umbj_table_submit. */
UMB_CHECKED enum umb_status umbj_service_accept(struct umbj_service *service, const char *owner,
                                                const struct umbj_manifest *manifest,
                                                const struct umbj_prepared *prepared,
                                                struct umbj_upload *upload, struct umbj_job *job,
                                                struct umb_error *error);

/* Adds a job of an owner (NULL = any owner) to the snapshot if it is missing there. Fails:
 * E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_service_show(struct umbj_service *service, const char *id,
                                              const char *owner, struct umb_error *error);

UMB_CHECKED enum umb_status umbj_service_cancel(struct umbj_service *service, const char *id,
                                                const char *owner, struct umbj_job *job,
                                                struct umb_error *error);

/* Lists jobs; for umbj_request.files of a request that reads. */
UMB_CHECKED enum umb_status umbj_service_list(struct umbj_service *service, const char *owner,
                                              int64_t most, struct umbj_job **jobs, size_t *count,
                                              struct umb_error *error);

/* Opens the packed file of an asset that one of the owner's jobs made. Fails: E_NOT_FOUND, E_IO. */
UMB_CHECKED enum umb_status umbj_service_open_asset(struct umbj_service *service,
                                                    const uint8_t *asset, const char *owner,
                                                    int *fd, uint64_t *bytes,
                                                    struct umb_error *error);

/* Takes an asset away from an owner. If it then has no owner, its file is removed. Fails:
 * E_NOT_FOUND, E_IO. */
UMB_CHECKED enum umb_status umbj_service_delete(struct umbj_service *service, const uint8_t *asset,
                                                const char *owner, struct umb_error *error);

#endif
