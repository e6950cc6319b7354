/* SPDX-License-Identifier: Apache-2.0 */
/* See bakes.h. */
#include "wire/bakes.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "umbrage/v1/bakes.pb-c.h"
#include "wire/codec.h"

UMBW_TABLE(BUNDLE_FILE, umbrage__v1__bundle_file, "files.", sizeof(struct umbw_bundle_file),
           {1, UMBW_AT(umbw_bundle_file, path), .flags = UMBW_FILLED},
           {2, UMBW_AT(umbw_bundle_file, size)},
           {3, UMBW_AT(umbw_bundle_file, sha256), .flags = UMBW_REQUIRED});

UMBW_TABLE(SETTING, umbrage__v1__bake_setting, "settings.", sizeof(struct umb_job_setting),
           {1, UMBW_AT(umb_job_setting, name), .flags = UMBW_FILLED},
           {2, UMBW_AT(umb_job_setting, value), .flags = UMBW_FILLED});

UMBW_TABLE(MANIFEST, umbrage__v1__manifest, "", sizeof(struct umbw_manifest),
           {1, UMBW_AT(umbw_manifest, scene), .flags = UMBW_FILLED},
           {2, UMBW_AT(umbw_manifest, files), UMBW_COUNT(umbw_manifest, file_count),
            .table = &BUNDLE_FILE, .most = UMBW_MANIFEST_MAX},
           {3, UMBW_AT(umbw_manifest, settings), UMBW_COUNT(umbw_manifest, setting_count),
            .table = &SETTING, .most = UMBW_MANIFEST_MAX},
           {4, UMBW_AT(umbw_manifest, priority)});

UMBW_TABLE(SUBMIT, umbrage__v1__submit_request, "", sizeof(struct umbw_submit_request),
           {1, UMBW_AT(umbw_submit_request, manifest),
            UMBW_COUNT(umbw_submit_request, has_manifest), .table = &MANIFEST},
           {2, UMBW_AT(umbw_submit_request, data), UMBW_COUNT(umbw_submit_request, data_size)});
UMBW_ENCODER(submit_request, struct umbw_submit_request, SUBMIT)

void umbw_manifest_finish(struct umbw_manifest *manifest)
{
    free((void *)(uintptr_t)manifest->scene); /* begins the block */
    memset(manifest, 0, sizeof *manifest);
}

enum umb_status umbw_decode_submit_request(const uint8_t *message, size_t size,
                                           struct umbw_submit_request *out, struct umb_error *error)
{
    UMB__TRY(umbw_decode(&SUBMIT, message, size, out, error));
    if (!out->has_manifest || out->data == NULL) {
        return UMB_OK;
    }
    umbw_manifest_finish(&out->manifest);
    return umb_fail(error, UMB_E_ARGUMENT, "data: must not be beside a manifest");
}

UMBW_TABLE(SUBMITTED, umbrage__v1__submit_reply, "", sizeof(struct umb_job_submitted),
           {1, UMBW_AT(umb_job_submitted, job)}, {2, UMBW_AT(umb_job_submitted, existing)});
UMBW_CODEC(submit_reply, struct umb_job_submitted, SUBMITTED)

UMBW_TABLE(JOB, umbrage__v1__watch_request, "", UMBW_JOB_MAX + 1, {1, .size = UMBW_JOB_MAX + 1});
UMBW_CODEC(job_request, char, JOB)

#define STATUS(member) UMBW_AT(umb_job_status, member)

UMBW_TABLE(JOB_STATUS, umbrage__v1__job_status, "", sizeof(struct umb_job_status), {1, STATUS(job)},
           {2, STATUS(state)}, {3, STATUS(failure)}, {4, STATUS(cause)},
           {5, STATUS(asset), UMBW_COUNT(umb_job_status, has_asset)}, {6, STATUS(owner)},
           {7, STATUS(priority)}, {8, STATUS(epoch)}, {9, STATUS(submitted_ms)},
           {10, STATUS(started_ms)}, {11, STATUS(ended_ms)}, {12, STATUS(not_before_ms)},
           {13, STATUS(bundle_bytes)}, {14, STATUS(phase)}, {15, STATUS(done)}, {16, STATUS(total)},
           {17, STATUS(unit)}, {18, STATUS(rate)}, {19, STATUS(left_ms)},
           {20, STATUS(plan), .flags = UMBW_FILLED}, {21, STATUS(notices), .flags = UMBW_FILLED},
           {22, STATUS(tiles_done)}, {23, STATUS(tiles_total)}, {24, STATUS(tiles_found)});
UMBW_CODEC(job_status, struct umb_job_status, JOB_STATUS)

UMBW_TABLE(JOBS, umbrage__v1__list_jobs_reply, "", sizeof(struct umbw_job_list),
           {1, UMBW_AT(umbw_job_list, jobs), UMBW_COUNT(umbw_job_list, count), .flags = UMBW_FILLED,
            .table = &JOB_STATUS, .most = UMBW_JOBS_MAX});
UMBW_CODEC(job_list, struct umbw_job_list, JOBS)

UMBW_TABLE(LIST, umbrage__v1__list_jobs_request, "", sizeof(uint32_t),
           {1, .size = sizeof(uint32_t), .most = UMBW_JOBS_MAX});
UMBW_CODEC(list_jobs_request, uint32_t, LIST)

UMBW_TABLE(FETCH, umbrage__v1__fetch_request, "", sizeof(struct umbw_fetch_request),
           {1, UMBW_AT(umbw_fetch_request, asset), .flags = UMBW_REQUIRED},
           {2, UMBW_AT(umbw_fetch_request, offset)});
UMBW_CODEC(fetch_request, struct umbw_fetch_request, FETCH)

UMBW_TABLE(PIECE, umbrage__v1__fetch_reply, "", sizeof(struct umbw_fetch_reply),
           {1, UMBW_AT(umbw_fetch_reply, size)}, {2, UMBW_AT(umbw_fetch_reply, offset)},
           {3, UMBW_AT(umbw_fetch_reply, data), UMBW_COUNT(umbw_fetch_reply, data_size)});
UMBW_CODEC(fetch_reply, struct umbw_fetch_reply, PIECE)

UMBW_TABLE(DELETE, umbrage__v1__delete_request, "", UMBW_ASSET_NAME_MAX + 1,
           {1, .size = UMBW_ASSET_NAME_MAX + 1});
UMBW_CODEC(delete_request, char, DELETE)
