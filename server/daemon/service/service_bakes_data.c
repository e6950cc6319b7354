/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bakes.Submit and Fetch: the calls that carry files. Each message of a Submit is one job request,
 * so only one message is written at a time and flow control slows the client down. A Fetch reads
 * the next piece of the file when the client has read most of the sent bytes.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/service/job_request.h"

/* Bytes of an upload that cost as much as a point: 12, the size of a point's coordinates. */
#define BYTES_A_POINT 12

/* --- Submit --- */

static void reply_job(struct umbd_call *call, const struct umbj_job *job, int existing)
{
    struct umb_job_submitted reply = {.existing = existing};
    struct umbw_buffer head = {0};
    memcpy(reply.job, job->id, sizeof reply.job);
    if (umbd_call_ok(call, umbw_encode_submit_reply(&reply, &head, umbd_call_error(call)))) {
        umbd_call_reply(call, &head);
    }
}

/* Converts a manifest from the wire to the job service's form. */
static enum umb_status translate(struct umbd_job_request *job_request, struct umb_error *error)
{
    const struct umbw_manifest *from = &job_request->wire;
    job_request->list = calloc(from->file_count + 1, sizeof *job_request->list);
    job_request->settings = calloc(from->setting_count + 1, sizeof *job_request->settings);
    job_request->prepared = calloc(1, sizeof *job_request->prepared);
    if (job_request->list == NULL || job_request->settings == NULL ||
        job_request->prepared == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the manifest");
    }
    for (size_t i = 0; i < from->file_count; i++) {
        job_request->list[i].path = from->files[i].path;
        job_request->list[i].size = from->files[i].size;
        memcpy(job_request->list[i].sha256, from->files[i].sha256, UMBJ_HASH_BYTES);
    }
    for (size_t i = 0; i < from->setting_count; i++) {
        job_request->settings[i].name = from->settings[i].name;
        job_request->settings[i].value = from->settings[i].value;
    }
    job_request->manifest = (struct umbj_manifest){.scene = from->scene,
                                                   .files = job_request->list,
                                                   .file_count = from->file_count,
                                                   .settings = job_request->settings,
                                                   .setting_count = from->setting_count,
                                                   .priority = from->priority};
    return UMB_OK;
}

static void prepare(struct umbd_job_request *job_request)
{
    job_request->status =
        umbj_manifest_prepare(&job_request->manifest, job_request->max_bundle_bytes,
                              job_request->prepared, &job_request->error);
}

static void begin_upload(struct umbd_job_request *job_request, struct umbj_service *service)
{
    job_request->status = umbj_service_submit(service, job_request->owner, &job_request->manifest,
                                              job_request->prepared, &job_request->job,
                                              &job_request->upload, &job_request->error);
}

/*
 * Charges all files of an upload before their first byte. If an upload were refused midway, it
 * would have to start again, and at a low rate it would never end. A submission that is refused, or
 * whose job exists, sends no files and costs only the call.
 */
static void upload_begun(struct umbd_job_request *job_request, struct umbd_call *call)
{
    if (job_request->upload == NULL) {
        reply_job(call, &job_request->job, 1);
    } else {
        umbd_call_owe_points(call, job_request->prepared->bytes / BYTES_A_POINT);
    }
}

static void write_data(struct umbd_job_request *job_request)
{
    job_request->status = umbj_upload_write(job_request->upload, job_request->data,
                                            job_request->data_size, &job_request->error);
}

static void take_manifest(struct umbd_call *call, struct umbw_submit_request *request)
{
    struct umbd_job_request *job_request = umbd_job_request_create(call);
    if (job_request == NULL) {
        umbw_manifest_finish(&request->manifest);
        return;
    }
    job_request->wire = request->manifest;
    if (!umbd_call_ok(call, translate(job_request, umbd_call_error(call)))) {
        return;
    }
    call->task_bytes = call->message_size;
    job_request->max_bundle_bytes = umbj_service_options_of(call->backend->jobs)->max_bundle_bytes;
    umbd_job_request_send(call, (struct umbd_job_step){prepare, begin_upload, upload_begun, 0});
}

void umbd_submit_serve(struct umbd_call *call)
{
    struct umbw_submit_request request;
    const int begins = call->state == NULL;
    if (begins ? !umbd_call_take_points(call, UMBD_CALL_POINTS)
               : !umbd_job_request_is_allowed(call)) {
        return;
    }
    if (!UMBD_CALL_READ(call, submit_request, &request)) {
        return;
    }
    if (request.has_manifest != begins) {
        umbd_call_fail(call, UMBW_GRPC_INVALID_ARGUMENT,
                       request.has_manifest ? "manifest: there was one already"
                                            : "manifest: must be in the first message");
        umbw_manifest_finish(&request.manifest);
        return;
    }
    if (request.has_manifest) {
        take_manifest(call, &request);
        return;
    }
    struct umbd_job_request *job_request = call->state;
    const size_t at = request.data != NULL ? (size_t)(request.data - call->message) : 0;
    call->task_bytes = call->message_size;
    job_request->message = umbd_call_take_message(call);
    if (job_request->message == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    job_request->data = job_request->message + at;
    job_request->data_size = request.data_size;
    call->data_bytes += request.data_size;
    umbd_job_request_send(call, (struct umbd_job_step){write_data, NULL, NULL, 0});
}

static void keep_bundle(struct umbd_job_request *job_request)
{
    job_request->status = umbj_upload_accept(job_request->upload, &job_request->error);
}

static void accept_upload(struct umbd_job_request *job_request, struct umbj_service *service)
{
    job_request->status = umbj_service_accept(service, job_request->owner, &job_request->manifest,
                                              job_request->prepared, job_request->upload,
                                              &job_request->job, &job_request->error);
}

static void accepted(struct umbd_job_request *job_request, struct umbd_call *call)
{
    reply_job(call, &job_request->job, 0);
}

void umbd_submit_end(struct umbd_call *call)
{
    if (call->state == NULL) {
        umbd_call_fail(call, UMBW_GRPC_INVALID_ARGUMENT, "manifest: the request ended without one");
    } else if (umbd_job_request_is_allowed(call)) {
        call->task_bytes = 0;
        umbd_job_request_send(call,
                              (struct umbd_job_step){keep_bundle, accept_upload, accepted, 0});
    }
}

/* --- Fetch --- */

static void open_file(struct umbd_job_request *job_request, struct umbj_service *service)
{
    job_request->status =
        umbj_service_open_asset(service, job_request->asset, umbd_job_request_owner(job_request),
                                &job_request->fd, &job_request->size, &job_request->error);
    if (job_request->status == UMB_OK && job_request->offset > job_request->size) {
        job_request->status = umb_fail(
            &job_request->error, UMB_E_ARGUMENT, "offset: %llu is behind the file's %llu bytes",
            (unsigned long long)job_request->offset, (unsigned long long)job_request->size);
    }
}

/* Reads the next piece of the file. Asset files are never changed in place, so a short read means
 * damage. */
static void read_piece(struct umbd_job_request *job_request)
{
    const uint64_t left = job_request->size - job_request->offset;
    job_request->chunk_size = left < UMBD_CHUNK_BYTES ? (size_t)left : UMBD_CHUNK_BYTES;
    for (size_t have = 0; have < job_request->chunk_size;) {
        ssize_t count = pread(job_request->fd, job_request->chunk + have,
                              job_request->chunk_size - have, (off_t)(job_request->offset + have));
        if (count < 0 && errno == EINTR) {
            continue;
        }
        if (count <= 0) {
            job_request->status =
                umb_fail_errno(&job_request->error, UMB_E_IO, count < 0 ? errno : EIO,
                               "asset: its file cannot be read");
            return;
        }
        have += (size_t)count;
    }
}

static void piece_read(struct umbd_job_request *job_request, struct umbd_call *call);

void umbd_fetch_more(struct umbd_call *call)
{
    struct umbd_job_request *job_request = call->state;
    if (job_request != NULL && job_request->fetching && !job_request->away && !call->reply_ended &&
        call->backend->jobs != NULL && umbd_call_unsent(call) < UMBD_BACKLOG_BYTES) {
        umbd_job_request_send(call, (struct umbd_job_step){read_piece, NULL, piece_read, 0});
    }
}

static void piece_read(struct umbd_job_request *job_request, struct umbd_call *call)
{
    const struct umbw_fetch_reply reply = {.size = job_request->size,
                                           .offset = job_request->offset,
                                           .data = job_request->chunk,
                                           .data_size = job_request->chunk_size};
    struct umbw_buffer message = {0};
    if (!umbd_job_request_is_allowed(call) ||
        !umbd_call_ok(call, umbw_encode_fetch_reply(&reply, &message, umbd_call_error(call)))) {
        return;
    }
    job_request->offset += job_request->chunk_size;
    umbd_call_reply(call, &message);
    if (job_request->offset == job_request->size) {
        job_request->fetching = 0;
        umbd_call_finish(call);
    } else {
        umbd_fetch_more(call);
    }
}

static void file_opened(struct umbd_job_request *job_request, struct umbd_call *call)
{
    job_request->chunk = malloc(UMBD_CHUNK_BYTES);
    if (job_request->chunk == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
    } else if (umbd_call_charge(call, 2 * UMBD_BACKLOG_BYTES)) { /* the most that is ever unsent */
        job_request->fetching = 1;
        umbd_fetch_more(call);
    }
}

void umbd_fetch_serve(struct umbd_call *call)
{
    struct umbw_fetch_request request;
    struct umbd_job_request *job_request = umbd_job_request_create(call);
    if (job_request != NULL && UMBD_CALL_READ(call, fetch_request, &request) &&
        umbd_job_request_set_asset(call, request.asset)) {
        job_request->offset = request.offset;
        umbd_job_request_send(call, (struct umbd_job_step){NULL, open_file, file_opened, 0});
    }
}
