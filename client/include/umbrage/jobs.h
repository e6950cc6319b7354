/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_JOBS_H
#define UMBRAGE_JOBS_H
/*
 * libumbrage: having a daemon bake a scene, and fetching what came of it.
 *
 *     if (umb_client_submit(client, &submission, &submitted, NULL, &error) ||
 *         umb_client_watch(client, submitted.job, told, &id, NULL, &error) ||  // until it is over
 *         umb_client_fetch(client, id, 0, got, &size, NULL, &error)) {
 *         return error.status;
 *     }
 *
 * Jobs and assets belong to the owner of the client's token. A submission whose reply was lost is
 * simply sent again: the daemon finds the first one by its content. A watch or a fetch that a lost
 * connection ended is begun again, a fetch from the byte it had come to.
 *
 * Blocking: with async NULL the functions wait, and must not be called from a callback (E_STATE).
 * Callbacks run on the client's thread. Submitting hashes the files first, on the caller's thread,
 * and borrows the submission until its end.
 * Fails: what umb_client_list_assets fails with, E_UNSUPPORTED (a daemon that takes no jobs), and
 *        what is said below.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/client.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_JOB_ID_SIZE 33 /* 32 hexadecimal digits and NUL */

enum umb_job_state {
    UMB_JOB_QUEUED = 0,
    UMB_JOB_RUNNING = 1,
    UMB_JOB_DONE = 2,
    UMB_JOB_FAILED = 3,
    UMB_JOB_POISON = 4, /* it took its worker down too often */
};

enum umb_job_failure {
    UMB_JOB_NO_FAILURE = 0,
    UMB_JOB_REJECTED = 1, /* the scene or its settings cannot be used */
    UMB_JOB_TEMPORARY = 2,
    UMB_JOB_IO = 3,
    UMB_JOB_LOST = 4,
    UMB_JOB_CRASH = 5,
    UMB_JOB_MEMORY = 6,
    UMB_JOB_SANDBOX = 7,
    UMB_JOB_TIMEOUT = 8,
    UMB_JOB_INTERNAL = 9,
    UMB_JOB_CANCELLED = 10,
};

/* Where a job stands. Texts are UTF-8. */
struct umb_job_status {
    char job[UMB_JOB_ID_SIZE];
    char owner[64];
    char cause[512]; /* of the last failure */
    int state;       /* enum umb_job_state; others from newer daemons */
    int failure;     /* enum umb_job_failure, of the last try */
    int priority;
    uint64_t epoch;                                            /* which try, 0 = none yet */
    uint64_t bundle_bytes;                                     /* of its files */
    int64_t submitted_ms, started_ms, ended_ms, not_before_ms; /* Unix time; 0 = not yet */
    int has_asset;
    uint8_t asset[UMB_ID_BYTES]; /* when done */
    /* Of a watched job that runs: */
    char phase[32], unit[32]; /* "bake", "texel" */
    uint64_t done, total;     /* of the phase; total 0 = not known */
    double rate;              /* units a second */
    int64_t left_ms;          /* of the phase, -1 = not known */
    /* Of a watched job's last try; total 0 = not known, found: kept from earlier bakes: */
    uint64_t tiles_done, tiles_total, tiles_found;
    const char *plan, *notices; /* lines; NULL in lists; borrowed during the call-back */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

/* One file of a scene. */
struct umb_job_file {
    const char *path;   /* in the bundle: relative, '/' between components, no "." and ".." */
    const char *source; /* to be read here */
};

struct umb_job_setting {
    const char *name;  /* an option of umbrage-bake, without dashes */
    const char *value; /* "" for one without a value */
};

struct umb_job_submission {
    const char *scene; /* path of one of the files */
    const struct umb_job_file *files;
    size_t file_count;
    const struct umb_job_setting *settings;
    size_t setting_count;
    int priority; /* -10..10: among one's own jobs */
    /* Told what was sent so far, in bytes; NULL: nobody. Runs on the client's thread. */
    void (*sent)(void *user, uint64_t done, uint64_t total);
    void *user;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_job_submitted {
    char job[UMB_JOB_ID_SIZE];
    int existing; /* 1: it had been submitted before */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Reads and sends the files. Fails: E_NO_INPUT or E_IO (a file; it must not change meanwhile),
 * E_ARGUMENT, E_TOO_LARGE, E_BUSY (a quota). Cost: reads every file twice, to hash and to send. */
UMB_API UMB_CHECKED enum umb_status umb_client_submit(struct umb_client *client,
                                                      const struct umb_job_submission *submission,
                                                      struct umb_job_submitted *submitted,
                                                      struct umb_client_async *async,
                                                      struct umb_error *error);

/* Calls told for each change, at once for the first, until the job is over. told returns 0 to stop
 * watching, which is E_CANCELLED. Fails: E_NOT_FOUND. */
typedef int (*umb_job_status_fn)(void *user, const struct umb_job_status *status);
UMB_API UMB_CHECKED enum umb_status umb_client_watch(struct umb_client *client, const char *job,
                                                     umb_job_status_fn on_status, void *user,
                                                     struct umb_client_async *async,
                                                     struct umb_error *error);

/* Ends a job that is not over. Out: status: may be NULL; its plan and notices are NULL. Fails:
 * E_NOT_FOUND. */
UMB_API UMB_CHECKED enum umb_status
umb_client_cancel_job(struct umb_client *client, const char *job, struct umb_job_status *status,
                      struct umb_client_async *async, struct umb_error *error);

/* Lists the caller's jobs, newest first. In: limit: 0 = 100, at most 1000. Owns: the caller frees
 * them with umb_free. */
UMB_API UMB_CHECKED enum umb_status
umb_client_list_jobs(struct umb_client *client, uint32_t limit, struct umb_job_status **jobs,
                     size_t *count, struct umb_client_async *async, struct umb_error *error);

/* Gets an asset's packed file from an offset on. on_bytes: takes the next bytes and returns
 * UMB_OK, or why the fetch ends. size: of the whole file. Fails: E_NOT_FOUND, what
 * on_bytes returns. */
typedef enum umb_status (*umb_job_bytes_fn)(void *user, uint64_t offset, const void *bytes,
                                            size_t count, uint64_t size);
UMB_API UMB_CHECKED enum umb_status umb_client_fetch(struct umb_client *client,
                                                     const uint8_t asset[UMB_ID_BYTES],
                                                     uint64_t offset, umb_job_bytes_fn on_bytes,
                                                     void *user, struct umb_client_async *async,
                                                     struct umb_error *error);

/* Takes an asset from the caller; its file goes with the last owner. Fails: E_NOT_FOUND. */
UMB_API UMB_CHECKED enum umb_status umb_client_delete_asset(struct umb_client *client,
                                                            const uint8_t asset[UMB_ID_BYTES],
                                                            struct umb_client_async *async,
                                                            struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
