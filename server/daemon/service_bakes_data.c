/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bakes.Submit and Fetch: the calls that carry files. Each message of a Submit is one errand, so
 * that at most one is written at a time and flow control holds the client; a Fetch reads the next
 * piece when the client took most of what was sent.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/call_rights.h"
#include "daemon/errand.h"

#define BYTES_A_POINT 12 /* of an upload: what the coordinates of a point take */

/* --- Submit --- */

static void reply_job(struct umbd_call *call, const struct umbj_job *job, int existing)
{
    struct umbw_submit_reply reply = {.existing = existing};
    struct umbw_buffer head = {0};
    struct umb_error error = {0};
    memcpy(reply.job, job->id, sizeof reply.job);
    enum umb_status status = umbw_encode_submit_reply(&reply, &head, &error);
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    umbd_call_reply(call, &head);
}

/* The same manifest as the job service has it. */
static enum umb_status translate(struct umbd_errand *errand, struct umb_error *error)
{
    const struct umbw_manifest *from = &errand->wire;
    errand->list = calloc(from->file_count + 1, sizeof *errand->list);
    errand->settings = calloc(from->setting_count + 1, sizeof *errand->settings);
    errand->prepared = calloc(1, sizeof *errand->prepared);
    if (errand->list == NULL || errand->settings == NULL || errand->prepared == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the manifest");
    }
    for (size_t i = 0; i < from->file_count; i++) {
        errand->list[i].path = from->files[i].path;
        errand->list[i].size = from->files[i].size;
        memcpy(errand->list[i].sha256, from->files[i].sha256, UMBJ_HASH_BYTES);
    }
    for (size_t i = 0; i < from->setting_count; i++) {
        errand->settings[i].name = from->settings[i].name;
        errand->settings[i].value = from->settings[i].value;
    }
    errand->manifest = (struct umbj_manifest){.scene = from->scene,
                                              .files = errand->list,
                                              .file_count = from->file_count,
                                              .settings = errand->settings,
                                              .setting_count = from->setting_count,
                                              .priority = from->priority};
    return UMB_OK;
}

static void prepare(struct umbd_errand *errand)
{
    errand->status = umbj_manifest_prepare(&errand->manifest, errand->max_bundle_bytes,
                                           errand->prepared, &errand->error);
}

static void begin_upload(struct umbd_errand *errand, struct umbj_service *service)
{
    errand->status =
        umbj_service_submit(service, errand->owner, &errand->manifest, errand->prepared,
                            &errand->job, &errand->upload, &errand->error);
}

static void upload_begun(struct umbd_errand *errand, struct umbd_call *call)
{
    if (errand->upload == NULL) {
        reply_job(call, &errand->job, 1);
    }
}

static void write_data(struct umbd_errand *errand)
{
    errand->status =
        umbj_upload_write(errand->upload, errand->data, errand->data_size, &errand->error);
}

static void data_written(struct umbd_errand *errand, struct umbd_call *call)
{
    (void)errand;
    (void)call;
}

/*
 * Price of a submission, with its files. It is charged at the manifest, because an upload that is
 * refused midway must start again and would never end at a low rate. A bundle over --max-bundle
 * costs the call alone: a claimed size costs nothing to write, and the address may be shared.
 */
static uint64_t price_of(const struct umbw_submit_request *request, uint64_t max_bundle)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < request->manifest.file_count; i++) {
        const uint64_t size = request->manifest.files[i].size;
        bytes = size < UINT64_MAX - bytes ? bytes + size : UINT64_MAX;
    }
    return UMBD_CALL_POINTS + (bytes <= max_bundle ? bytes / BYTES_A_POINT : 0);
}

static void take_manifest(struct umbd_call *call, struct umbw_submit_request *request)
{
    struct umb_error error = {0};
    struct umbd_errand *errand = umbd_errand_create(call);
    if (errand == NULL) {
        umbw_manifest_finish(&request->manifest);
        return;
    }
    errand->wire = request->manifest;
    enum umb_status status = translate(errand, &error);
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    call->batch_bytes = call->message_size;
    errand->max_bundle_bytes =
        umbj_service_options_of(call->conn->loop->daemon->jobs)->max_bundle_bytes;
    umbd_errand_send(call, prepare, begin_upload, upload_begun);
}

void umbd_service_bakes_submit(struct umbd_call *call)
{
    struct umbw_submit_request request;
    struct umb_error error = {0};
    enum umb_status status =
        umbw_decode_submit_request(call->message, call->message_size, &request, &error);
    const int begins = call->errand == NULL;
    const uint64_t most = call->conn->loop->daemon->options.max_bundle;
    if (begins ? !umbd_call_take_points(call, price_of(&request, most))
               : !umbd_errand_is_allowed(call)) {
        umbw_manifest_finish(&request.manifest);
        return;
    }
    if (status == UMB_OK && request.has_manifest != begins) {
        status = umb_fail(&error, UMB_E_ARGUMENT,
                          request.has_manifest ? "manifest: there was one already"
                                               : "manifest: must be in the first message");
        umbw_manifest_finish(&request.manifest);
    }
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    if (request.has_manifest) {
        take_manifest(call, &request);
        return;
    }
    struct umbd_errand *errand = call->errand;
    const size_t at = request.data != NULL ? (size_t)(request.data - call->message) : 0;
    call->batch_bytes = call->message_size;
    errand->message = umbd_call_take_message(call);
    if (errand->message == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    errand->data = errand->message + at;
    errand->data_size = request.data_size;
    call->data_bytes += request.data_size;
    umbd_errand_send(call, write_data, NULL, data_written);
}

static void keep_bundle(struct umbd_errand *errand)
{
    errand->status = umbj_upload_accept(errand->upload, &errand->error);
}

static void accept_upload(struct umbd_errand *errand, struct umbj_service *service)
{
    errand->status =
        umbj_service_accept(service, errand->owner, &errand->manifest, errand->prepared,
                            errand->upload, &errand->job, &errand->error);
}

static void accepted(struct umbd_errand *errand, struct umbd_call *call)
{
    reply_job(call, &errand->job, 0);
}

void umbd_service_bakes_submit_end(struct umbd_call *call)
{
    if (call->errand == NULL) {
        umbd_call_fail(call, UMBW_GRPC_INVALID_ARGUMENT, "manifest: the request ended without one");
    } else if (umbd_errand_is_allowed(call)) {
        call->batch_bytes = 0;
        umbd_errand_send(call, keep_bundle, accept_upload, accepted);
    }
}

/* --- Fetch --- */

static void open_file(struct umbd_errand *errand, struct umbj_service *service)
{
    errand->status = umbj_service_open_asset(service, errand->asset, umbd_errand_owner(errand),
                                             &errand->fd, &errand->size, &errand->error);
    if (errand->status == UMB_OK && errand->offset > errand->size) {
        errand->status =
            umb_fail(&errand->error, UMB_E_ARGUMENT, "offset: %llu is behind the file's %llu bytes",
                     (unsigned long long)errand->offset, (unsigned long long)errand->size);
    }
}

/* Reads the next piece; a file is never changed in place, so that a short read is damage. */
static void read_piece(struct umbd_errand *errand)
{
    const uint64_t left = errand->size - errand->offset;
    errand->chunk_size = left < UMBD_CHUNK_BYTES ? (size_t)left : UMBD_CHUNK_BYTES;
    for (size_t have = 0; have < errand->chunk_size;) {
        ssize_t count = pread(errand->fd, errand->chunk + have, errand->chunk_size - have,
                              (off_t)(errand->offset + have));
        if (count < 0 && errno == EINTR) {
            continue;
        }
        if (count <= 0) {
            errand->status = umb_fail_errno(&errand->error, UMB_E_IO, count < 0 ? errno : EIO,
                                            "asset: its file cannot be read");
            return;
        }
        have += (size_t)count;
    }
}

static void piece_read(struct umbd_errand *errand, struct umbd_call *call);

void umbd_service_bakes_more(struct umbd_call *call)
{
    struct umbd_errand *errand = call->errand;
    if (errand != NULL && errand->fetching && !errand->away && !call->reply_ended &&
        call->conn->loop->daemon->jobs != NULL && umbd_call_unsent(call) < UMBD_BACKLOG_BYTES) {
        umbd_errand_send(call, read_piece, NULL, piece_read);
    }
}

static void piece_read(struct umbd_errand *errand, struct umbd_call *call)
{
    const struct umbw_fetch_reply reply = {.size = errand->size,
                                           .offset = errand->offset,
                                           .data = errand->chunk,
                                           .data_size = errand->chunk_size};
    struct umbw_buffer message = {0};
    struct umb_error error = {0};
    if (!umbd_errand_is_allowed(call)) {
        return;
    }
    enum umb_status status = umbw_encode_fetch_reply(&reply, &message, &error);
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    errand->offset += errand->chunk_size;
    umbd_call_reply(call, &message);
    if (errand->offset == errand->size) {
        errand->fetching = 0;
        umbd_call_finish(call);
    } else {
        umbd_service_bakes_more(call);
    }
}

static void file_opened(struct umbd_errand *errand, struct umbd_call *call)
{
    errand->chunk = malloc(UMBD_CHUNK_BYTES);
    if (errand->chunk == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
    } else if (umbd_call_charge(call, 2 * UMBD_BACKLOG_BYTES)) { /* all that is ever unsent */
        errand->fetching = 1;
        umbd_service_bakes_more(call);
    }
}

void umbd_service_bakes_fetch(struct umbd_call *call)
{
    struct umbw_fetch_request request;
    struct umb_error error = {0};
    struct umbd_errand *errand = umbd_errand_create(call);
    if (errand == NULL) {
        return;
    }
    enum umb_status status =
        umbw_decode_fetch_request(call->message, call->message_size, &request, &error);
    if (status == UMB_OK && umb_id_from_text(request.asset, errand->asset) != UMB_OK) {
        status = umb_fail(&error, UMB_E_ARGUMENT,
                          "asset: '%.80s' is not an id of 64 hexadecimal digits", request.asset);
    }
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    errand->offset = request.offset;
    umbd_errand_send(call, NULL, open_file, file_opened);
}
