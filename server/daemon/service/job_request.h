/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_JOB_REQUEST_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_JOB_REQUEST_H
/*
 * Request of a Bakes call to the job service, whose threads may block on the disk. A call has one
 * job request, its `state`. It is either at home, with the call, or away, as a task of those
 * threads:
 *
 *     umbd_job_request_create(call)                      for the owner of the call
 *     umbd_job_request_send(call, step)                  files runs on a thread for files, then
 *                                                        work on the jobs' thread, then answer
 *                                                        on the loop
 *     umbd_job_close(call)                               the call ends
 *
 * While the request is away, neither the call nor the loop touches its data.
 */
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "jobs/service.h"
#include "wire/bakes.h"

struct umbd_job_request;

/* Functions that serve a request: files and work run on threads of the job service, answer on the
 * loop. If files fails, work is not called. */
struct umbd_job_step {
    void (*files)(struct umbd_job_request *job_request);                              /* Or NULL */
    void (*work)(struct umbd_job_request *job_request, struct umbj_service *service); /* Or NULL */
    void (*answer)(struct umbd_job_request *job_request, struct umbd_call *call);     /* Or NULL */
    int reads; /* 1: `files` only reads the job table, and waits for no change of it */
};

struct umbd_job_request {
    struct umbj_request request; /* First field: the service knows only this */
    struct umbd_task task;
    int away;
    struct umbd_job_step step;
    struct umbj_service *service; /* Set while it is away */

    char owner[UMBJ_OWNER_SIZE];
    int is_admin;
    enum umb_status status; /* Result of the work */
    struct umb_error error;

    /* Submit */
    uint8_t *message; /* Message with the data, owned while it is written */
    const uint8_t *data;
    size_t data_size;
    struct umbw_manifest wire;
    struct umbj_manifest manifest; /* Manifest in the form of the service; borrows from wire */
    struct umbj_prepared *prepared;
    uint64_t max_bundle_bytes;
    struct umbj_bundle_file *list;
    struct umbj_setting *settings;
    struct umbj_upload *upload;
    /* Submit, Watch, Cancel */
    struct umbj_job job;
    /* Watch */
    int watching;
    uint64_t version, status_ms;
    /* List */
    uint32_t limit;
    struct umbj_job *jobs;
    size_t job_count;
    /* Fetch, Delete */
    uint8_t asset[UMB_ID_BYTES];
    int fd; /* Descriptor of the asset's file, -1 = not open */
    int fetching;
    uint64_t size, offset;
    uint8_t *chunk; /* [UMBD_CHUNK_BYTES], made by the first fetch */
    size_t chunk_size;
};

#define UMBD_CHUNK_BYTES ((size_t)256 << 10) /* bytes of a file in one message of Fetch */

/* Creates the call's job request, or fails the call: UNIMPLEMENTED without --jobs, or out of
 * memory. */
struct umbd_job_request *umbd_job_request_create(struct umbd_call *call);

/* Sends a job request, which is then away. */
void umbd_job_request_send(struct umbd_call *call, struct umbd_job_step step);

/*
 * Checks the call's rights again, because a reload may have changed them during the call. Returns
 * 1; or 0 after failing the call: as umbd_call_is_allowed, or PERMISSION_DENIED if the call's token
 * now has another name and so another owner.
 */
int umbd_job_request_is_allowed(struct umbd_call *call);

/* Sets the asset that a request names by its id. Returns 1; or 0 after failing the call with
 * INVALID_ARGUMENT: the text is no id. */
int umbd_job_request_set_asset(struct umbd_call *call, const char *id);

/* Owner whose jobs the request may see: NULL = any owner's. */
const char *umbd_job_request_owner(const struct umbd_job_request *job_request);

#endif
