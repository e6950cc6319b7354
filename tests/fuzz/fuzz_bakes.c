/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Messages of the Bakes service, bundle manifests, reflection and compressed messages. The first
 * byte selects the kind. A decoded message, encoded again, must decode to the same.
 */
#include <math.h>
#include <string.h>
#include <zlib.h>

#include "fuzz.h"
#include "jobs/bundle.h"
#include "jobs/worker_process.h"
#include "wire/bakes.h"
#include "grpc/grpc.h"
#include "wire/messages.h"

#define BUNDLE_BYTES ((uint64_t)1 << 30)
#define MAX_MESSAGE  ((size_t)1 << 16)

/* Returns the message behind the prefix, in a buffer that an encoder filled. */
static const uint8_t *message_of(const struct umbw_buffer *buffer, size_t *size)
{
    FUZZ_DEMAND(buffer->size >= UMBW_PREFIX_BYTES);
    *size = buffer->size - UMBW_PREFIX_BYTES;
    return buffer->bytes + UMBW_PREFIX_BYTES;
}

static int same_text(const char *a, const char *b)
{
    return a == NULL || b == NULL ? a == b : strcmp(a, b) == 0;
}

/* Checks that no path of an accepted manifest leads out of its folder or hides a word. */
static void check_path(const char *path)
{
    FUZZ_DEMAND(path[0] != '/' && path[0] != '\0' && strlen(path) <= UMBJ_PATH_MAX);
    for (const char *at = path; at != NULL; at = strchr(at, '/')) {
        at += *at == '/';
        const size_t length = strcspn(at, "/");
        FUZZ_DEMAND(length > 0 && !(length == 1 && at[0] == '.') &&
                    !(length == 2 && at[0] == '.' && at[1] == '.'));
    }
}

static void check_words(const struct umbj_manifest *manifest, const char *text)
{
    struct umbj_words words = {0};
    umbj_words_add_settings(&words, text, 0);
    FUZZ_DEMAND(words.failed || words.count == manifest->setting_count);
    for (size_t i = 0; i < words.count; i++) {
        FUZZ_DEMAND(strncmp(words.list[i], "--", 2) == 0);
        FUZZ_DEMAND(umbj_settings_have(text, words.list[i]));
    }
    FUZZ_DEMAND(umbj_tile_edge(text, 4096) <= 4096);
    umbj_words_finish(&words);
}

/* Passes the message on as umbd_service_bakes passes it to the job service. */
static void check_manifest(const struct umbw_manifest *wire)
{
    struct umbj_manifest manifest = {.scene = wire->scene,
                                     .file_count = wire->file_count,
                                     .setting_count = wire->setting_count,
                                     .priority = wire->priority};
    struct umbj_bundle_file *files = calloc(wire->file_count + 1, sizeof *files);
    struct umbj_setting *settings = calloc(wire->setting_count + 1, sizeof *settings);
    uint64_t bytes = 0, again = 0;
    FUZZ_DEMAND(files != NULL && settings != NULL);
    for (size_t i = 0; i < wire->file_count; i++) {
        files[i].path = wire->files[i].path;
        files[i].size = wire->files[i].size;
        memcpy(files[i].sha256, wire->files[i].sha256, sizeof files[i].sha256);
    }
    for (size_t i = 0; i < wire->setting_count; i++) {
        settings[i] = (struct umbj_setting){wire->settings[i].name, wire->settings[i].value};
    }
    manifest.files = files;
    manifest.settings = settings;
    struct umb_error error;
    if (umbj_manifest_check(&manifest, BUNDLE_BYTES, &bytes, &error) == UMB_OK) {
        uint8_t key[UMBJ_HASH_BYTES];
        char text[UMBJ_SETTINGS_SIZE];
        FUZZ_DEMAND(bytes <= BUNDLE_BYTES);
        for (size_t i = 0; i < wire->file_count; i++) {
            check_path(files[i].path);
        }
        FUZZ_DEMAND(umbj_manifest_key(&manifest, key, &error) == UMB_OK);
        if (umbj_settings_text(&manifest, text, &error) == UMB_OK) {
            check_words(&manifest, text);
        }
        FUZZ_DEMAND(umbj_manifest_check(&manifest, bytes, &again, &error) == UMB_OK);
        FUZZ_DEMAND(again == bytes);
        FUZZ_DEMAND(bytes == 0 ||
                    umbj_manifest_check(&manifest, bytes - 1, &again, &error) != UMB_OK);
    }
    free(files);
    free(settings);
}

static void same_manifest(const struct umbw_manifest *a, const struct umbw_manifest *b)
{
    FUZZ_DEMAND(a->file_count == b->file_count && a->setting_count == b->setting_count);
    FUZZ_DEMAND(same_text(a->scene, b->scene) && a->priority == b->priority);
    for (size_t i = 0; i < a->file_count; i++) {
        FUZZ_DEMAND(same_text(a->files[i].path, b->files[i].path));
        FUZZ_DEMAND(a->files[i].size == b->files[i].size);
        FUZZ_DEMAND(memcmp(a->files[i].sha256, b->files[i].sha256, UMB_ID_BYTES) == 0);
    }
    for (size_t i = 0; i < a->setting_count; i++) {
        FUZZ_DEMAND(same_text(a->settings[i].name, b->settings[i].name));
        FUZZ_DEMAND(same_text(a->settings[i].value, b->settings[i].value));
    }
}

static void submit_request(const uint8_t *message, size_t size)
{
    struct umbw_submit_request request, again;
    struct umbw_buffer buffer = {0};
    if (umbw_decode_submit_request(message, size, &request, NULL) != UMB_OK) {
        return;
    }
    if (request.has_manifest) {
        check_manifest(&request.manifest);
    } else {
        FUZZ_DEMAND(request.data_size == 0 ||
                    (request.data >= message && request.data_size <= size));
    }
    FUZZ_DEMAND(umbw_encode_submit_request(&request, &buffer, NULL) == UMB_OK);
    size_t length;
    const uint8_t *bytes = message_of(&buffer, &length);
    FUZZ_DEMAND(umbw_decode_submit_request(bytes, length, &again, NULL) == UMB_OK);
    FUZZ_DEMAND(again.has_manifest == request.has_manifest);
    if (request.has_manifest) {
        same_manifest(&request.manifest, &again.manifest);
        umbw_manifest_finish(&again.manifest);
        umbw_manifest_finish(&request.manifest);
    } else {
        FUZZ_DEMAND(again.data_size == request.data_size);
    }
    umbw_buffer_finish(&buffer);
}

static void same_status(const struct umb_job_status *a, const struct umb_job_status *b)
{
    FUZZ_DEMAND(strcmp(a->job, b->job) == 0 && strcmp(a->owner, b->owner) == 0);
    FUZZ_DEMAND(a->state == b->state && a->failure == b->failure && a->epoch == b->epoch);
    FUZZ_DEMAND(a->has_asset == b->has_asset && a->done == b->done && a->total == b->total);
    FUZZ_DEMAND(a->submitted_ms == b->submitted_ms && a->priority == b->priority);
    /* By value: proto3 leaves a zero out, and protobuf-c does so with -0.0 too. */
    FUZZ_DEMAND(a->rate == b->rate || (isnan(a->rate) && isnan(b->rate)));
}

static void job_status(const uint8_t *message, size_t size)
{
    struct umb_job_status status, again;
    struct umbw_buffer buffer = {0};
    size_t length;
    if (umbw_decode_job_status(message, size, &status, NULL) != UMB_OK) {
        return;
    }
    FUZZ_DEMAND(umbw_encode_job_status(&status, &buffer, NULL) == UMB_OK);
    const uint8_t *bytes = message_of(&buffer, &length);
    FUZZ_DEMAND(umbw_decode_job_status(bytes, length, &again, NULL) == UMB_OK);
    same_status(&status, &again);
    free((void *)(uintptr_t)again.plan);
    free((void *)(uintptr_t)status.plan);
    umbw_buffer_finish(&buffer);
}

static void job_list(const uint8_t *message, size_t size)
{
    struct umbw_job_list list, again;
    struct umbw_buffer buffer = {0};
    size_t length;
    if (umbw_decode_job_list(message, size, &list, NULL) != UMB_OK) {
        return;
    }
    FUZZ_DEMAND(list.count <= UMBW_JOBS_MAX);
    FUZZ_DEMAND(umbw_encode_job_list(&list, &buffer, NULL) == UMB_OK);
    const uint8_t *bytes = message_of(&buffer, &length);
    FUZZ_DEMAND(umbw_decode_job_list(bytes, length, &again, NULL) == UMB_OK);
    FUZZ_DEMAND(again.count == list.count);
    for (size_t i = 0; i < list.count; i++) {
        same_status(&list.jobs[i], &again.jobs[i]);
    }
    free(again.jobs);
    free(list.jobs);
    umbw_buffer_finish(&buffer);
}

static void small_messages(const uint8_t *message, size_t size)
{
    struct umb_job_submitted reply;
    struct umbw_fetch_request fetch;
    struct umbw_fetch_reply piece;
    char job[UMBW_JOB_MAX + 1], asset[UMBW_ASSET_NAME_MAX + 1];
    uint32_t limit;
    if (umbw_decode_submit_reply(message, size, &reply, NULL) == UMB_OK) {
        FUZZ_DEMAND(strlen(reply.job) <= UMBW_JOB_MAX);
    }
    if (umbw_decode_job_request(message, size, job, NULL) == UMB_OK) {
        FUZZ_DEMAND(strlen(job) <= UMBW_JOB_MAX);
    }
    if (umbw_decode_list_jobs_request(message, size, &limit, NULL) == UMB_OK) {
        FUZZ_DEMAND(limit <= UMBW_JOBS_MAX);
    }
    if (umbw_decode_fetch_request(message, size, &fetch, NULL) == UMB_OK) {
        FUZZ_DEMAND(strlen(fetch.asset) <= UMBW_ASSET_NAME_MAX);
    }
    if (umbw_decode_delete_request(message, size, asset, NULL) == UMB_OK) {
        FUZZ_DEMAND(strlen(asset) <= UMBW_ASSET_NAME_MAX);
    }
    if (umbw_decode_fetch_reply(message, size, &piece, NULL) == UMB_OK && piece.data_size > 0) {
        FUZZ_DEMAND(piece.data >= message && piece.data + piece.data_size <= message + size);
    }
}

static void reflection(const uint8_t *message, size_t size)
{
    struct umbw_buffer buffer = {0};
    if (umbw_reflection_answer(message, size, &buffer, NULL) == UMB_OK) {
        size_t length;
        (void)message_of(&buffer, &length);
        /* The reply holds the request, and a descriptor with everything that the descriptor
         * needs. */
        FUZZ_DEMAND(length <= 4 * size + MAX_MESSAGE);
    }
    umbw_buffer_finish(&buffer);
}

/* Unpacking must give the bytes that were packed, and never more than the limit. */
static void compressed(const uint8_t *bytes, size_t size)
{
    uint8_t *out = NULL;
    size_t out_size = 0;
    const size_t most = size > 1 ? (size_t)bytes[0] << 8 | bytes[1] : 0;
    if (umbw_gunzip(bytes, size, MAX_MESSAGE, &out, &out_size, NULL) == UMB_OK) {
        FUZZ_DEMAND(out_size <= MAX_MESSAGE);
    } else {
        FUZZ_DEMAND(out == NULL);
    }
    free(out);
    z_stream stream = {0};
    uint8_t packed[1 << 14];
    FUZZ_DEMAND(deflateInit2(&stream, 1, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) == Z_OK);
    stream.next_in = (uint8_t *)(uintptr_t)bytes;
    stream.avail_in = size < 4096 ? (unsigned)size : 4096;
    const size_t plain = stream.avail_in;
    stream.next_out = packed;
    stream.avail_out = sizeof packed;
    FUZZ_DEMAND(deflate(&stream, Z_FINISH) == Z_STREAM_END);
    const size_t length = sizeof packed - stream.avail_out;
    (void)deflateEnd(&stream);
    const enum umb_status status = umbw_gunzip(packed, length, most, &out, &out_size, NULL);
    FUZZ_DEMAND((status == UMB_OK) == (plain <= most));
    FUZZ_DEMAND(status != UMB_OK || (out_size == plain && memcmp(out, bytes, plain) == 0));
    free(out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static void (*const kinds[])(const uint8_t *, size_t) = {
        submit_request, job_status, job_list, small_messages, reflection, compressed};
    if (size == 0 || size > MAX_MESSAGE) {
        return 0;
    }
    uint8_t *exact = malloc(size > 1 ? size - 1 : 1); /* a read behind the end is a read outside */
    if (exact != NULL) {
        memcpy(exact, data + 1, size - 1);
        kinds[data[0] % (sizeof kinds / sizeof kinds[0])](exact, size - 1);
    }
    free(exact);
    return 0;
}
