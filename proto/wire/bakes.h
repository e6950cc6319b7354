/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_BAKES_H
#define UMBRAGE_WIRE_BAKES_H
/*
 * The messages of umbrage.v1.Bakes as plain structs, and their codecs; the rules of messages.h hold
 * here too. Values are those of proto/umbrage/v1/bakes.proto. States and failures are numbers that
 * the job service and the protocol share.
 */
#include "wire/messages.h"

#define UMBW_PATH_BAKES_SUBMIT "/umbrage.v1.Bakes/Submit"
#define UMBW_PATH_BAKES_WATCH  "/umbrage.v1.Bakes/Watch"
#define UMBW_PATH_BAKES_CANCEL "/umbrage.v1.Bakes/Cancel"
#define UMBW_PATH_BAKES_LIST   "/umbrage.v1.Bakes/List"
#define UMBW_PATH_BAKES_FETCH  "/umbrage.v1.Bakes/Fetch"
#define UMBW_PATH_BAKES_DELETE "/umbrage.v1.Bakes/Delete"

#define UMBW_JOB_MAX 32 /* bytes of a job's id */
#define UMBW_MANIFEST_MAX                                                                          \
    65536                  /* Most bytes of files and settings in one message: longer ones are
                                   refused unread */
#define UMBW_JOBS_MAX 1000 /* of one list */

struct umbw_bundle_file {
    const char *path;
    uint64_t size;
    uint8_t sha256[UMB_ID_BYTES];
};

struct umbw_bake_setting {
    const char *name, *value;
};

struct umbw_manifest {
    const char *scene;
    struct umbw_bundle_file *files;
    size_t file_count;
    struct umbw_bake_setting *settings;
    size_t setting_count;
    int priority;
    void *owned; /* Decoder: memory that holds the texts */
};

/* Frees the memory of a decoded manifest. */
void umbw_manifest_finish(struct umbw_manifest *manifest);

/* One message of Submit: a manifest, or data. */
struct umbw_submit_request {
    int has_manifest;
    struct umbw_manifest manifest; /* Finish it, if there is one */
    const uint8_t *data;           /* into the message */
    size_t data_size;
};

struct umbw_submit_reply {
    char job[UMBW_JOB_MAX + 1];
    int existing;
};

struct umbw_job_status {
    char job[UMBW_JOB_MAX + 1];
    char owner[64];
    char cause[512];
    char phase[32], unit[32];
    int state, failure, priority;
    int has_asset;
    uint8_t asset[UMB_ID_BYTES];
    uint64_t epoch, bundle_bytes, done, total;
    int64_t submitted_ms, started_ms, ended_ms, not_before_ms, left_ms;
    double rate;
    uint64_t tiles_done, tiles_total, tiles_found;
    const char *plan, *notices; /* NULL or lines; decoder: malloc */
};

/* Frees plan and notices of a decoded status. */
void umbw_job_status_finish(struct umbw_job_status *status);

struct umbw_job_list {
    struct umbw_job_status *jobs; /* decoder: malloc */
    size_t count;
};
void umbw_job_list_finish(struct umbw_job_list *list);

struct umbw_fetch_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    uint64_t offset;
};

struct umbw_fetch_reply {
    uint64_t size, offset;
    const uint8_t *data; /* Decoder: points into the message */
    size_t data_size;
};

/* Decoders. Fails: E_ARGUMENT naming the field, E_TOO_LARGE, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbw_decode_submit_request(const uint8_t *message, size_t size,
                                                       struct umbw_submit_request *request,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_submit_reply(const uint8_t *message, size_t size,
                                                     struct umbw_submit_reply *reply,
                                                     struct umb_error *error);
/* WatchRequest and CancelRequest. */
UMB_CHECKED enum umb_status umbw_decode_job_request(const uint8_t *message, size_t size,
                                                    char job[UMBW_JOB_MAX + 1],
                                                    struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_job_status(const uint8_t *message, size_t size,
                                                   struct umbw_job_status *status,
                                                   struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_list_jobs_request(const uint8_t *message, size_t size,
                                                          uint32_t *limit, struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_job_list(const uint8_t *message, size_t size,
                                                 struct umbw_job_list *list,
                                                 struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_fetch_request(const uint8_t *message, size_t size,
                                                      struct umbw_fetch_request *request,
                                                      struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_fetch_reply(const uint8_t *message, size_t size,
                                                    struct umbw_fetch_reply *reply,
                                                    struct umb_error *error);
/* DeleteRequest; DeleteReply is empty. */
UMB_CHECKED enum umb_status umbw_decode_delete_request(const uint8_t *message, size_t size,
                                                       char asset[UMBW_ASSET_NAME_MAX + 1],
                                                       struct umb_error *error);

/* Encoders: append prefix and message. Fails: E_NO_MEMORY, E_TOO_LARGE. */
UMB_CHECKED enum umb_status umbw_encode_manifest(const struct umbw_manifest *manifest,
                                                 struct umbw_buffer *buffer,
                                                 struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_submit_data(const uint8_t *data, size_t size,
                                                    struct umbw_buffer *buffer,
                                                    struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_submit_reply(const struct umbw_submit_reply *reply,
                                                     struct umbw_buffer *buffer,
                                                     struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_job_request(const char *job, struct umbw_buffer *buffer,
                                                    struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_job_status(const struct umbw_job_status *status,
                                                   struct umbw_buffer *buffer,
                                                   struct umb_error *error);
UMB_CHECKED enum umb_status
umbw_encode_list_jobs_request(uint32_t limit, struct umbw_buffer *buffer, struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_job_list(const struct umbw_job_list *list,
                                                 struct umbw_buffer *buffer,
                                                 struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_fetch_request(const struct umbw_fetch_request *request,
                                                      struct umbw_buffer *buffer,
                                                      struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_fetch_reply(const struct umbw_fetch_reply *reply,
                                                    struct umbw_buffer *buffer,
                                                    struct umb_error *error);
UMB_CHECKED enum umb_status
umbw_encode_delete_request(const char *asset, struct umbw_buffer *buffer, struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_delete_reply(struct umbw_buffer *buffer,
                                                     struct umb_error *error);

#endif
