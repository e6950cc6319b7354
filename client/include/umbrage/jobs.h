/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_JOBS_H
#define UMBRAGE_JOBS_H
/*
 * libumbrage: bakes on a daemon. A program submits a scene, watches its job, and fetches the asset.
 *
 *     if (umb_client_submit(client, &submission, &submitted, NULL, &error) ||
 *         umb_client_watch(client, submitted.job, told, &id, NULL, &error) ||  // until it is over
 *         umb_client_fetch(client, id, 0, got, &size, NULL, &error)) {
 *         return error.status;
 *     }
 *
 * Ownership: jobs and assets belong to the owner of the client's token.
 * Retries: if the reply to a submission is lost, the client sends the submission again; the daemon
 * recognises it by its content. A watch or a fetch whose connection is lost is begun again, a
 * fetch from the byte that it had reached.
 * Blocking: with async NULL the functions wait, and fail with E_STATE in a callback.
 * Threads: as umbrage/client.h; callbacks run on the client's thread.
 * Fails: as umb_client_list_assets; E_UNSUPPORTED (the daemon takes no jobs); and as each function
 *        says below.
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
    UMB_JOB_POISON = 4, /* Its worker process died too often; it is not tried again */
};

/* Why a try of a job failed. */
enum umb_job_failure {
    UMB_JOB_NO_FAILURE = 0,
    UMB_JOB_REJECTED = 1, /* The scene or its settings cannot be used */
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

/* State and progress of a job. Texts are UTF-8. */
struct umb_job_status {
    char job[UMB_JOB_ID_SIZE];
    char owner[64];
    char cause[512]; /* Reason of the last failure, for people */
    int state;       /* State, enum umb_job_state; newer daemons may send other values */
    int failure;     /* Failure of the last try, enum umb_job_failure */
    int priority;
    uint64_t epoch;                                            /* Number of the try; 0 = none yet */
    uint64_t bundle_bytes;                                     /* Bytes of the scene's files */
    int64_t submitted_ms, started_ms, ended_ms, not_before_ms; /* Unix time; 0 = not yet */
    int has_asset;
    uint8_t asset[UMB_ID_BYTES]; /* Id of the asset, when done */
    /* For a watched job that runs: */
    char phase[32], unit[32]; /* Names of the phase and its unit: "bake", "texel" */
    uint64_t done, total;     /* Units of the phase; total 0 = not known */
    double rate;              /* Units a second */
    int64_t left_ms;          /* Time that the phase still takes; -1 = not known */
    /* Tiles of the last try of a watched job; total 0 = not known. `found` counts tiles taken from
     * earlier bakes */
    uint64_t tiles_done, tiles_total, tiles_found;
    const char *plan, *notices; /* Lines of text, borrowed during the callback; NULL in lists */
    uint64_t reserved[8];       /* Zero: room for later versions (umbrage/version.h) */
};

/* One file of a scene. */
struct umb_job_file {
    const char *path;   /* Name in the scene: relative, '/' between components, no "." and ".." */
    const char *source; /* Path of the local file to read */
};

struct umb_job_setting {
    const char *name;  /* Name of an option of umbrage-bake, without dashes */
    const char *value; /* Value of the option; "" for an option without a value */
};

struct umb_job_submission {
    const char *scene; /* `path` of the file that holds the scene */
    const struct umb_job_file *files;
    size_t file_count;
    const struct umb_job_setting *settings;
    size_t setting_count;
    int priority; /* Order among the owner's jobs, -10..10; higher first */
    /* Called with the number of bytes sent so far and in all, to show progress. May be NULL. Runs
     * on the client's thread. */
    void (*sent)(void *user, uint64_t done, uint64_t total);
    void *user;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_job_submitted {
    char job[UMB_JOB_ID_SIZE];
    int existing;         /* 1: the same submission was made before, and `job` is the job of it */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Submits a scene as a bake job: reads and sends its files.
 *
 * In:    submission: borrowed until the end of the call.
 * Fails: E_NO_INPUT or E_IO (a file that cannot be read, or that changed meanwhile), E_ARGUMENT,
 *        E_TOO_LARGE, E_BUSY (a quota).
 * Threads: hashes the files on the caller's thread before it returns, also with async.
 * Cost:  reads every file twice, to hash and to send it.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_submit(struct umb_client *client,
                                                      const struct umb_job_submission *submission,
                                                      struct umb_job_submitted *submitted,
                                                      struct umb_client_async *async,
                                                      struct umb_error *error);

/* Called with the status of a watched job. The callback returns 0 to stop watching, else
 * nonzero. */
typedef int (*umb_job_status_fn)(void *user, const struct umb_job_status *status);

/*
 * Watches a job until it is over: calls on_status at once, and then for each change.
 *
 * Fails: E_NOT_FOUND, E_CANCELLED (on_status returned 0).
 */
UMB_API UMB_CHECKED enum umb_status umb_client_watch(struct umb_client *client, const char *job,
                                                     umb_job_status_fn on_status, void *user,
                                                     struct umb_client_async *async,
                                                     struct umb_error *error);

/*
 * Cancels a job that is not over.
 *
 * Out:   status: may be NULL; its plan and notices are NULL.
 * Fails: E_NOT_FOUND.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_cancel_job(struct umb_client *client, const char *job, struct umb_job_status *status,
                      struct umb_client_async *async, struct umb_error *error);

/*
 * Lists the caller's jobs, newest first.
 *
 * In:    limit: most jobs to list; 0 = 100, at most 1000.
 * Out:   jobs: [count]; NULL and count 0 on failure.
 * Owns:  the caller frees them with umb_free.
 */
UMB_API UMB_CHECKED enum umb_status
umb_client_list_jobs(struct umb_client *client, uint32_t limit, struct umb_job_status **jobs,
                     size_t *count, struct umb_client_async *async, struct umb_error *error);

/* Called with the next `count` bytes of a file of `size` bytes; they begin at `offset` in the
 * file. The callback returns UMB_OK, or the status with which the fetch ends. */
typedef enum umb_status (*umb_job_bytes_fn)(void *user, uint64_t offset, const void *bytes,
                                            size_t count, uint64_t size);

/*
 * Fetches an asset's packed file, from an offset in bytes on.
 *
 * Fails: E_NOT_FOUND, or as on_bytes returns.
 */
UMB_API UMB_CHECKED enum umb_status umb_client_fetch(struct umb_client *client,
                                                     const uint8_t asset[UMB_ID_BYTES],
                                                     uint64_t offset, umb_job_bytes_fn on_bytes,
                                                     void *user, struct umb_client_async *async,
                                                     struct umb_error *error);

/* Deletes the caller's share in an asset; with the last owner the daemon deletes the file. Fails:
 * E_NOT_FOUND. */
UMB_API UMB_CHECKED enum umb_status umb_client_delete_asset(struct umb_client *client,
                                                            const uint8_t asset[UMB_ID_BYTES],
                                                            struct umb_client_async *async,
                                                            struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
