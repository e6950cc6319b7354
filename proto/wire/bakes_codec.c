/* SPDX-License-Identifier: Apache-2.0 */
/* See bakes.h. */
#include "wire/bakes.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "umbrage/v1/bakes.pb-c.h"
#include "wire/codec.h"

static const struct umbw_row FILE_ROWS[] = {
    {1, UMBW_AT(umbw_bundle_file, path), .flags = UMBW_FILLED},
    {2, UMBW_AT(umbw_bundle_file, size)},
    {3, UMBW_AT(umbw_bundle_file, sha256), .flags = UMBW_REQUIRED},
    {4, UMBW_AT(umbw_bundle_file, kept)},
};
UMBW_TABLE(BUNDLE_FILE, umbrage__v1__bundle_file, FILE_ROWS, "files.",
           sizeof(struct umbw_bundle_file));

static const struct umbw_row SETTING_ROWS[] = {
    {1, UMBW_AT(umb_job_setting, name), .flags = UMBW_FILLED},
    {2, UMBW_AT(umb_job_setting, value), .flags = UMBW_FILLED},
};
UMBW_TABLE(SETTING, umbrage__v1__bake_setting, SETTING_ROWS, "settings.",
           sizeof(struct umb_job_setting));

static const struct umbw_row MANIFEST_ROWS[] = {
    {1, UMBW_AT(umbw_manifest, scene), .flags = UMBW_FILLED},
    {2, UMBW_AT(umbw_manifest, files), UMBW_COUNT(umbw_manifest, file_count), .table = &BUNDLE_FILE,
     .most = UMBW_MANIFEST_MAX},
    {3, UMBW_AT(umbw_manifest, settings), UMBW_COUNT(umbw_manifest, setting_count),
     .table = &SETTING, .most = UMBW_MANIFEST_MAX},
    {4, UMBW_AT(umbw_manifest, priority)},
    {5, UMBW_AT(umbw_manifest, replaces), .flags = UMBW_FILLED},
    {6, UMBW_AT(umbw_manifest, ask)},
};
UMBW_TABLE(MANIFEST, umbrage__v1__manifest, MANIFEST_ROWS, "", sizeof(struct umbw_manifest));

static const struct umbw_row SUBMIT_ROWS[] = {
    {1, UMBW_AT(umbw_submit_request, manifest), UMBW_COUNT(umbw_submit_request, has_manifest),
     .table = &MANIFEST},
    {2, UMBW_AT(umbw_submit_request, data), UMBW_COUNT(umbw_submit_request, data_size)},
};
UMBW_TABLE(SUBMIT, umbrage__v1__submit_request, SUBMIT_ROWS, "", sizeof(struct umbw_submit_request),
           UMBW_BLOCK(umbw_submit_request, manifest.owned));

void umbw_manifest_finish(struct umbw_manifest *manifest)
{
    free(manifest->owned);
    memset(manifest, 0, sizeof *manifest);
}

enum umb_status umbw_decode_submit_request(const uint8_t *message, size_t size,
                                           struct umbw_submit_request *out, struct umb_error *error)
{
    UMB__TRY(umbw_decode(&SUBMIT, message, size, out, error));
    const bool both = out->has_manifest && out->data != NULL;
    if (both || !out->has_manifest) {
        umbw_manifest_finish(&out->manifest);
    }
    return both ? umb_fail(error, UMB_E_ARGUMENT, "data: must not be beside a manifest") : UMB_OK;
}

enum umb_status umbw_encode_submit_request(const struct umbw_submit_request *in,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    return umbw_encode(&SUBMIT, in, buffer, error);
}

static const struct umbw_row SUBMITTED_ROWS[] = {
    {1, UMBW_AT(umbw_submit_reply, submitted.job)},
    {2, UMBW_AT(umbw_submit_reply, submitted.existing)},
    {3, UMBW_AT(umbw_submit_reply, missing), UMBW_COUNT(umbw_submit_reply, missing_count)},
};
UMBW_CODEC(submit_reply, struct umbw_submit_reply, SUBMITTED, umbrage__v1__submit_reply,
           SUBMITTED_ROWS, sizeof(struct umbw_submit_reply))

static const struct umbw_row JOB_ROWS[] = {{1, .size = UMBW_JOB_MAX + 1}};
UMBW_CODEC(job_request, char, JOB, umbrage__v1__watch_request, JOB_ROWS, UMBW_JOB_MAX + 1)

#define STATUS(member) UMBW_AT(umb_job_status, member)

static const struct umbw_row STATUS_ROWS[] = {
    {1, STATUS(job)},
    {2, STATUS(state)},
    {3, STATUS(failure)},
    {4, STATUS(cause)},
    {5, STATUS(asset), UMBW_COUNT(umb_job_status, has_asset)},
    {6, STATUS(owner)},
    {7, STATUS(priority)},
    {8, STATUS(epoch)},
    {9, STATUS(submitted_ms)},
    {10, STATUS(started_ms)},
    {11, STATUS(ended_ms)},
    {12, STATUS(not_before_ms)},
    {13, STATUS(bundle_bytes)},
    {14, STATUS(phase)},
    {15, STATUS(done)},
    {16, STATUS(total)},
    {17, STATUS(unit)},
    {18, STATUS(rate)},
    {19, STATUS(left_ms)},
    {20, STATUS(plan), .flags = UMBW_FILLED},
    {21, STATUS(notices), .flags = UMBW_FILLED},
    {22, STATUS(tiles_done)},
    {23, STATUS(tiles_total)},
    {24, STATUS(tiles_found)},
};

/* The plan begins the block of a status, the jobs that of a list. */
UMBW_CODEC(job_status, struct umb_job_status, JOB_STATUS, umbrage__v1__job_status, STATUS_ROWS,
           sizeof(struct umb_job_status), UMBW_BLOCK(umb_job_status, plan))

static const struct umbw_row JOBS_ROWS[] = {
    {1, UMBW_AT(umbw_job_list, jobs), UMBW_COUNT(umbw_job_list, count), .table = &JOB_STATUS,
     .most = UMBW_JOBS_MAX},
};
UMBW_CODEC(job_list, struct umbw_job_list, JOBS, umbrage__v1__list_jobs_reply, JOBS_ROWS,
           sizeof(struct umbw_job_list), UMBW_BLOCK(umbw_job_list, jobs))

static const struct umbw_row LIST_ROWS[] = {{1, .size = sizeof(uint32_t), .most = UMBW_JOBS_MAX}};
UMBW_CODEC(list_jobs_request, uint32_t, LIST, umbrage__v1__list_jobs_request, LIST_ROWS,
           sizeof(uint32_t))

static const struct umbw_row FETCH_ROWS[] = {
    {1, UMBW_AT(umbw_fetch_request, asset), .flags = UMBW_REQUIRED},
    {2, UMBW_AT(umbw_fetch_request, offset)},
};
UMBW_CODEC(fetch_request, struct umbw_fetch_request, FETCH, umbrage__v1__fetch_request, FETCH_ROWS,
           sizeof(struct umbw_fetch_request))

static const struct umbw_row PIECE_ROWS[] = {
    {1, UMBW_AT(umbw_fetch_reply, size)},
    {2, UMBW_AT(umbw_fetch_reply, offset)},
    {3, UMBW_AT(umbw_fetch_reply, data), UMBW_COUNT(umbw_fetch_reply, data_size)},
};
UMBW_CODEC(fetch_reply, struct umbw_fetch_reply, PIECE, umbrage__v1__fetch_reply, PIECE_ROWS,
           sizeof(struct umbw_fetch_reply))

static const struct umbw_row DELETE_ROWS[] = {{1, .size = UMBW_ASSET_NAME_MAX + 1}};
UMBW_CODEC(delete_request, char, DELETE, umbrage__v1__delete_request, DELETE_ROWS,
           UMBW_ASSET_NAME_MAX + 1)
