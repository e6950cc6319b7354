/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_SERVICE_INTERNAL_H
#define UMBRAGE_SERVER_JOBS_SERVICE_INTERNAL_H
/* Shared by the files of the job service: service_tries.c applies the results of tries to jobs,
 * service_requests.c handles owners' requests, service.c is the thread that calls both. */
#include <pthread.h>
#include "jobs/executor.h"
#include "jobs/job_place.h"
#include "jobs/service.h"

/* A finished job whose asset the daemon does not serve yet. */
struct umbj_loading {
    struct umbj_job job;
    int64_t since_ms;
};

/* An upload that is not a job yet. Its bytes count for the quotas. A bundle of its key is not
 * removed, because the upload may have put it there. */
struct umbj_promise {
    struct umbj_promise *next;
    struct umbj_upload *upload;
    char owner[UMBJ_OWNER_SIZE];
    uint8_t key[UMBJ_HASH_BYTES];
    int64_t bytes;
};

struct umbj_service {
    struct umbj_service_options options;
    /* Absolute paths, because workers run in other folders. */
    char program[4096], folder_path[4096], assets_path[4200], work_path[4200];
    int folder;              /* Descriptor of the jobs folder */
    struct umbj_place place; /* Folder and table, with their locks */
    int lost;                /* 1 after another daemon took over: this one starts no job */
    struct umbj_table *table;
    struct umbj_snapshot *snapshot;
    struct umbj_executor *executor;
    struct umbj_file_threads *file_threads;
    struct umbj_file_threads *reader; /* One thread, which alone uses read_table */
    struct umbj_table *read_table;    /* Separate connection: lists wait for no commit */
    struct umbj_clocks clocks;
    struct umbj_counters counters;
    struct umbj_loading *loading;
    size_t loading_count, loading_capacity;
    struct umbj_promise *promises;
    int64_t look_at_ms, prune_at_ms;

    pthread_t thread;
    int opened, running; /* 1 if it was opened; if the thread runs */
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    struct umbj_request_queue queue; /* Requests to be run; under mutex */
    int closing;                     /* 1 = the thread shall end; under mutex */
};

/* All of umbj_service_create but the thread; tests then run its turns. */
UMB_CHECKED enum umb_status umbj__service_open(const struct umbj_service_options *options,
                                               struct umbj_service **out, struct umb_error *error);

/* Does one turn of the thread: waits up to wait_ms for a request, runs the waiting requests, then
 * handles reports, leases and jobs that may start. */
void umbj__service_turn(struct umbj_service *service, int64_t wait_ms);

int64_t umbj__unix_ms(const struct umbj_service *service);
int64_t umbj__steady_ms(const struct umbj_service *service);

/* Recovers before the thread starts: queues lost jobs again, and removes bundles without a job, old
 * work folders and assets without owners. */
UMB_CHECKED enum umb_status umbj__recover(struct umbj_service *service, struct umb_error *error);

/* Gives a claimed job to the executor. If that fails, it counts as a failed try. */
void umbj__begin_try(struct umbj_service *service, const struct umbj_job *job);

/* Handles a report, and takes over its staged file. */
void umbj__take_report(struct umbj_service *service, struct umbj_report *report);

/* Records a failed try in the table, the snapshot and the log, and removes an unneeded bundle. Out:
 * *job: the job's new state. */
UMB_CHECKED enum umb_status umbj__fail_try(struct umbj_service *service, struct umbj_job *job,
                                           enum umbj_failure failure, const char *cause,
                                           struct umb_error *error);

/* Notifies the watchers of assets that the daemon now serves. */
void umbj__look_at_loading(struct umbj_service *service);

/* Removes files of assets without owners. */
void umbj__collect_assets(struct umbj_service *service);

/* Removes a key's bundle if no unfinished job needs it. */
void umbj__drop_bundle(struct umbj_service *service, const uint8_t *key);

/* Updates snapshot and counters after a change of a job's state, and writes a line of the log. */
void umbj__changed(struct umbj_service *service, const struct umbj_job *job, int loading);

/* Copies the table's counts of refusals. */
void umbj__note_refusals(struct umbj_service *service);

/* Copies the table's counts. */
void umbj__recount(struct umbj_service *service);

void umbj__log_error(const struct umbj_service *service, const char *event,
                     const struct umb_error *error);

#endif
