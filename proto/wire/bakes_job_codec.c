/* SPDX-License-Identifier: Apache-2.0 */
/* JobStatus, alone and in lists, and the requests that name a job or an asset. */
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "umbrage/v1/bakes.pb-c.h"
#include "wire/bakes.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "wire/wire_buffer.h"

/* A message whose field 1 is a text; its other fields are ignored. */
static enum umb_status decode_word(const uint8_t *message, size_t size, const char *name,
                                   size_t most, char *out, struct umb_error *error)
{
    const struct umbw_field field = {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, name};
    struct umbw_field_found found;
    out[0] = '\0';
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, NULL, error);
    return status == UMB_OK ? umbw_text_copy(name, found.bytes, found.size, most, out, error)
                            : status;
}

enum umb_status umbw_decode_job_request(const uint8_t *message, size_t size,
                                        char job[UMBW_JOB_MAX + 1], struct umb_error *error)
{
    return decode_word(message, size, "job", UMBW_JOB_MAX, job, error);
}

enum umb_status umbw_decode_delete_request(const uint8_t *message, size_t size,
                                           char asset[UMBW_ASSET_NAME_MAX + 1],
                                           struct umb_error *error)
{
    return decode_word(message, size, "asset", UMBW_ASSET_NAME_MAX, asset, error);
}

enum umb_status umbw_encode_job_request(const char *job, struct umbw_buffer *buffer,
                                        struct umb_error *error)
{
    Umbrage__V1__WatchRequest message = UMBRAGE__V1__WATCH_REQUEST__INIT; /* Cancel's is equal */
    message.job = (char *)(uintptr_t)job;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_encode_delete_request(const char *asset, struct umbw_buffer *buffer,
                                           struct umb_error *error)
{
    Umbrage__V1__DeleteRequest message = UMBRAGE__V1__DELETE_REQUEST__INIT;
    message.asset = (char *)(uintptr_t)asset;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_encode_delete_reply(struct umbw_buffer *buffer, struct umb_error *error)
{
    return umbw_buffer_begin_message(buffer, 0, 0, error);
}

enum umb_status umbw_encode_list_jobs_request(uint32_t limit, struct umbw_buffer *buffer,
                                              struct umb_error *error)
{
    Umbrage__V1__ListJobsRequest message = UMBRAGE__V1__LIST_JOBS_REQUEST__INIT;
    message.limit = limit;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_decode_list_jobs_request(const uint8_t *message, size_t size, uint32_t *limit,
                                              struct umb_error *error)
{
    static const struct umbw_field field = {1, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "limit"};
    struct umbw_field_found found;
    *limit = 0;
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, NULL, error);
    if (status == UMB_OK && found.count > 0 && found.number > UMBW_JOBS_MAX) {
        status = umb_fail(error, UMB_E_ARGUMENT, "limit: %llu is over %d",
                          (unsigned long long)found.number, UMBW_JOBS_MAX);
    }
    if (status == UMB_OK && found.count > 0) {
        *limit = (uint32_t)found.number;
    }
    return status;
}

/* Fills a message that borrows the status's texts. */
static void put_status(const struct umbw_job_status *status, Umbrage__V1__JobStatus *message)
{
    umbrage__v1__job_status__init(message);
    message->job = (char *)(uintptr_t)status->job; /* texts are read only by the encoder */
    message->owner = (char *)(uintptr_t)status->owner;
    message->cause = (char *)(uintptr_t)status->cause;
    message->phase = (char *)(uintptr_t)status->phase;
    message->unit = (char *)(uintptr_t)status->unit;
    message->state = (Umbrage__V1__JobState)status->state;
    message->failure = (Umbrage__V1__JobFailure)status->failure;
    message->priority = status->priority;
    if (status->has_asset) {
        message->asset.data = (uint8_t *)(uintptr_t)status->asset;
        message->asset.len = UMB_ID_BYTES;
    }
    message->epoch = status->epoch;
    message->bundle_bytes = status->bundle_bytes;
    message->done = status->done;
    message->total = status->total;
    message->submitted_ms = status->submitted_ms;
    message->started_ms = status->started_ms;
    message->ended_ms = status->ended_ms;
    message->not_before_ms = status->not_before_ms;
    message->left_ms = status->left_ms;
    message->rate = status->rate;
    message->tiles_done = status->tiles_done;
    message->tiles_total = status->tiles_total;
    message->tiles_found = status->tiles_found;
    if (status->plan != NULL) {
        message->plan = (char *)(uintptr_t)status->plan;
    }
    if (status->notices != NULL) {
        message->notices = (char *)(uintptr_t)status->notices;
    }
}

enum umb_status umbw_encode_job_status(const struct umbw_job_status *status,
                                       struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__JobStatus message;
    put_status(status, &message);
    return umbw_message_append(&message.base, buffer, error);
}

static enum umb_status take_text(const char *name, const char *text, size_t size, char *out,
                                 struct umb_error *error)
{
    return umbw_text_copy(name, (const uint8_t *)text, strlen(text), size - 1, out, error);
}

static enum umb_status take_status(const Umbrage__V1__JobStatus *message,
                                   struct umbw_job_status *out, struct umb_error *error)
{
    enum umb_status status = take_text("job", message->job, sizeof out->job, out->job, error);
    if (status == UMB_OK) {
        status = take_text("owner", message->owner, sizeof out->owner, out->owner, error);
    }
    if (status == UMB_OK) {
        status = take_text("cause", message->cause, sizeof out->cause, out->cause, error);
    }
    if (status == UMB_OK) {
        status = take_text("phase", message->phase, sizeof out->phase, out->phase, error);
    }
    if (status == UMB_OK) {
        status = take_text("unit", message->unit, sizeof out->unit, out->unit, error);
    }
    out->has_asset = message->asset.len > 0;
    if (status == UMB_OK && out->has_asset) {
        status = umbw_id_copy("asset", message->asset.data, message->asset.len, out->asset, error);
    }
    out->state = (int)message->state;
    out->failure = (int)message->failure;
    out->priority = message->priority;
    out->epoch = message->epoch;
    out->bundle_bytes = message->bundle_bytes;
    out->done = message->done;
    out->total = message->total;
    out->submitted_ms = message->submitted_ms;
    out->started_ms = message->started_ms;
    out->ended_ms = message->ended_ms;
    out->not_before_ms = message->not_before_ms;
    out->left_ms = message->left_ms;
    out->rate = message->rate;
    out->tiles_done = message->tiles_done;
    out->tiles_total = message->tiles_total;
    out->tiles_found = message->tiles_found;
    return status;
}

void umbw_job_status_finish(struct umbw_job_status *status)
{
    free((void *)(uintptr_t)status->plan);
    free((void *)(uintptr_t)status->notices);
    memset(status, 0, sizeof *status);
}

enum umb_status umbw_decode_job_status(const uint8_t *message, size_t size,
                                       struct umbw_job_status *out, struct umb_error *error)
{
    ProtobufCMessage *base = NULL;
    memset(out, 0, sizeof *out);
    UMB__TRY(
        umbw_message_unpack(&umbrage__v1__job_status__descriptor, message, size, &base, error));
    const Umbrage__V1__JobStatus *found = (const Umbrage__V1__JobStatus *)base;
    enum umb_status status = take_status(found, out, error);
    if (status == UMB_OK) {
        out->plan = strdup(found->plan);
        out->notices = strdup(found->notices);
        if (out->plan == NULL || out->notices == NULL) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a job's plan");
        }
    }
    umbw_message_free(base);
    if (status != UMB_OK) {
        umbw_job_status_finish(out);
    }
    return status;
}

void umbw_job_list_finish(struct umbw_job_list *list)
{
    free(list->jobs);
    memset(list, 0, sizeof *list);
}

enum umb_status umbw_encode_job_list(const struct umbw_job_list *list, struct umbw_buffer *buffer,
                                     struct umb_error *error)
{
    Umbrage__V1__ListJobsReply message = UMBRAGE__V1__LIST_JOBS_REPLY__INIT;
    Umbrage__V1__JobStatus *jobs = calloc(list->count + 1, sizeof *jobs);
    Umbrage__V1__JobStatus **pointers = calloc(list->count + 1, sizeof *pointers);
    enum umb_status status;
    if (jobs == NULL || pointers == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu jobs", list->count);
    } else {
        for (size_t i = 0; i < list->count; i++) {
            put_status(&list->jobs[i], &jobs[i]);
            pointers[i] = &jobs[i];
        }
        message.jobs = pointers;
        message.n_jobs = list->count;
        status = umbw_message_append(&message.base, buffer, error);
    }
    free(pointers);
    free(jobs);
    return status;
}

enum umb_status umbw_decode_job_list(const uint8_t *message, size_t size,
                                     struct umbw_job_list *list, struct umb_error *error)
{
    static const struct umbw_field field = {1, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "jobs"};
    struct umbw_field_found found;
    ProtobufCMessage *base = NULL;
    memset(list, 0, sizeof *list);
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, NULL, error);
    if (status == UMB_OK && found.count > UMBW_JOBS_MAX) {
        status = umb_fail(error, UMB_E_TOO_LARGE, "jobs: %zu is over the limit of %d", found.count,
                          UMBW_JOBS_MAX);
    }
    if (status == UMB_OK) {
        status = umbw_message_unpack(&umbrage__v1__list_jobs_reply__descriptor, message, size,
                                     &base, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    const Umbrage__V1__ListJobsReply *reply = (const Umbrage__V1__ListJobsReply *)base;
    list->jobs = calloc(reply->n_jobs + 1, sizeof *list->jobs);
    if (list->jobs == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu jobs", reply->n_jobs);
    }
    for (size_t i = 0; status == UMB_OK && i < reply->n_jobs; i++) {
        status = take_status(reply->jobs[i], &list->jobs[i], error);
        list->count++;
    }
    umbw_message_free(base);
    if (status != UMB_OK) {
        umbw_job_list_finish(list);
    }
    return status;
}
