/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_BAKES_H
#define UMBRAGE_WIRE_BAKES_H
/*
 * The messages of umbrage.v1.Bakes; the rules of messages.h apply. The numbers of job states and
 * failures are those that the job service uses.
 */
#include "umbrage/jobs.h"
#include "wire/messages.h"

#define UMBW_PATH_BAKES_SUBMIT "/umbrage.v1.Bakes/Submit"
#define UMBW_PATH_BAKES_WATCH  "/umbrage.v1.Bakes/Watch"
#define UMBW_PATH_BAKES_CANCEL "/umbrage.v1.Bakes/Cancel"
#define UMBW_PATH_BAKES_LIST   "/umbrage.v1.Bakes/List"
#define UMBW_PATH_BAKES_FETCH  "/umbrage.v1.Bakes/Fetch"
#define UMBW_PATH_BAKES_DELETE "/umbrage.v1.Bakes/Delete"

#define UMBW_JOB_MAX      (UMB_JOB_ID_SIZE - 1) /* bytes of a job's id */
#define UMBW_MANIFEST_MAX 65536                 /* Most files, and most settings, in one message */
#define UMBW_JOBS_MAX     1000                  /* Most jobs of one list */

struct umbw_bundle_file {
    const char *path;
    uint64_t size;
    uint8_t sha256[UMB_ID_BYTES];
};

struct umbw_manifest {
    const char *scene; /* Decoder: begins the memory that holds files, settings and texts */
    struct umbw_bundle_file *files;
    size_t file_count;
    struct umb_job_setting *settings;
    size_t setting_count;
    int priority;
};

/* One message of Submit: a manifest, or data. */
struct umbw_submit_request {
    int has_manifest;
    struct umbw_manifest manifest;
    const uint8_t *data; /* Decoder: points into the message */
    size_t data_size;
};

struct umbw_job_list {
    struct umb_job_status *jobs; /* [count]; decoder: free() them, and their texts with them */
    size_t count;
};

struct umbw_fetch_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    uint64_t offset;
};

struct umbw_fetch_reply {
    uint64_t size, offset;
    const uint8_t *data; /* Decoder: points into the message */
    size_t data_size;
};

/* Frees the memory of a decoded manifest, and zeroes it. */
void umbw_manifest_finish(struct umbw_manifest *manifest);

UMBW_MESSAGE(submit_request, struct umbw_submit_request);
UMBW_MESSAGE(submit_reply, struct umb_job_submitted);
UMBW_MESSAGE(job_request, char); /* WatchRequest and CancelRequest: char[UMBW_JOB_MAX + 1] */
UMBW_MESSAGE(job_status, struct umb_job_status); /* decoder: free() plan, notices with it */
UMBW_MESSAGE(list_jobs_request, uint32_t);       /* the most jobs; 0 = 100 */
UMBW_MESSAGE(job_list, struct umbw_job_list);
UMBW_MESSAGE(fetch_request, struct umbw_fetch_request);
UMBW_MESSAGE(fetch_reply, struct umbw_fetch_reply);
UMBW_MESSAGE(delete_request, char); /* char[UMBW_ASSET_NAME_MAX + 1], the asset */

#endif
