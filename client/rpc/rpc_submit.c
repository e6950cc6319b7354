/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bakes.Submit: hashes the files, then reads them again while they are sent. HTTP/2 flow control
 * takes one message at a time. The client's thread blocks while it reads the next piece of a file.
 */
#include "net/openssl_sha256.h"
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "rpc_client.h"
#include "base/reserved.h"
#include "umbrage/jobs.h"
#include "wire/bakes.h"

#define PIECE_BYTES ((size_t)256 << 10)

struct upload {
    const struct umb_job_submission *submission;
    struct umb_job_submitted *submitted;
    struct umbw_manifest manifest;
    uint8_t *piece; /* [PIECE_BYTES] */
    int fd;         /* Descriptor of the file being sent, -1 = none */
    size_t next;    /* Index of the next file to send */
    /* Bytes of the file still to be sent. Exactly as many bytes are sent as were hashed */
    uint64_t left;
    uint64_t sent, total;
    struct umb_error error;
};

static enum umb_status read_piece(int fd, const char *path, uint8_t *piece, size_t most,
                                  size_t *count, struct umb_error *error)
{
    ssize_t got;
    do {
        got = read(fd, piece, most);
    } while (got < 0 && errno == EINTR);
    *count = got > 0 ? (size_t)got : 0;
    return got >= 0 ? UMB_OK : umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", path);
}

/* Opens a regular file. Out: size: its length in bytes; may be NULL. */
static enum umb_status open_file(const char *path, int *fd, uint64_t *size, struct umb_error *error)
{
    struct stat info;
    /* O_NONBLOCK makes the open of a pipe without a writer fail instead of waiting. */
    *fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (*fd < 0) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "cannot open '%.200s'", path);
    }
    if (fstat(*fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        close(*fd);
        *fd = -1;
        return umb_fail(error, UMB_E_NO_INPUT, "'%.200s' is not a regular file", path);
    }
    if (size != NULL) {
        *size = (uint64_t)info.st_size;
    }
    return UMB_OK;
}

static enum umb_status hash_file(struct upload *upload, size_t index, struct umb_error *error)
{
    const char *source = upload->submission->files[index].source;
    struct umbw_bundle_file *file = &upload->manifest.files[index];
    SHA256_CTX hash;
    size_t count = 1;
    uint64_t most = 0;
    int fd;
    enum umb_status status = open_file(source, &fd, &most, error);
    if (status != UMB_OK) {
        return status;
    }
    (void)SHA256_Init(&hash);
    while (status == UMB_OK && count > 0) {
        status = read_piece(fd, source, upload->piece, PIECE_BYTES, &count, error);
        (void)SHA256_Update(&hash, upload->piece, count);
        file->size += count;
        if (status == UMB_OK && file->size > most) { /* A growing file may have no end */
            status = umb_fail(error, UMB_E_IO, "'%.200s' grew while it was read", source);
        }
    }
    (void)SHA256_Final(file->sha256, &hash);
    close(fd);
    file->path = upload->submission->files[index].path;
    upload->total += file->size;
    return status;
}

static enum umb_status make_manifest(struct upload *upload, struct umb_error *error)
{
    const struct umb_job_submission *submission = upload->submission;
    struct umbw_manifest *manifest = &upload->manifest;
    manifest->scene = submission->scene;
    manifest->priority = submission->priority;
    manifest->files = calloc(submission->file_count + 1, sizeof *manifest->files);
    upload->piece = malloc(PIECE_BYTES);
    if (manifest->files == NULL || upload->piece == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a submission");
    }
    manifest->file_count = submission->file_count;
    manifest->settings = (struct umb_job_setting *)(uintptr_t)submission->settings; /* read only */
    manifest->setting_count = submission->setting_count;
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < submission->file_count; i++) {
        status = hash_file(upload, i, error);
    }
    return status;
}

/* Opens the next file that is not empty; fd stays -1 at the end. */
static enum umb_status next_file(struct upload *upload)
{
    enum umb_status status = UMB_OK;
    if (upload->fd >= 0 && upload->left == 0) {
        close(upload->fd);
        upload->fd = -1;
    }
    while (status == UMB_OK && upload->fd < 0 && upload->next < upload->manifest.file_count) {
        const size_t index = upload->next++;
        upload->left = upload->manifest.files[index].size;
        if (upload->left > 0) {
            status = open_file(upload->submission->files[index].source, &upload->fd, NULL,
                               &upload->error);
        }
    }
    return status;
}

/* Appends the next message; appends nothing at the end. */
static enum umb_status feed(void *user, struct umbw_buffer *body)
{
    struct upload *upload = user;
    size_t count = 0;
    enum umb_status status = next_file(upload);
    if (status != UMB_OK || upload->fd < 0) {
        return status;
    }
    const char *source = upload->submission->files[upload->next - 1].source;
    const size_t most = upload->left < PIECE_BYTES ? (size_t)upload->left : PIECE_BYTES;
    status = read_piece(upload->fd, source, upload->piece, most, &count, &upload->error);
    if (status == UMB_OK && count == 0) {
        status = umb_fail(&upload->error, UMB_E_IO, "'%.200s' was cut while it was sent", source);
    }
    if (status == UMB_OK) {
        const struct umbw_submit_request request = {.data = upload->piece, .data_size = count};
        status = umbw_encode_submit_request(&request, body, &upload->error);
    }
    upload->left -= count;
    upload->sent += count;
    if (status == UMB_OK && upload->submission->sent != NULL) {
        upload->submission->sent(upload->submission->user, upload->sent, upload->total);
    }
    return status;
}

static enum umb_status decode(void *out, const uint8_t *message, size_t size,
                              struct umb_error *error)
{
    const struct upload *upload = out;
    return umbw_decode_submit_reply(message, size, upload->submitted, error);
}

static enum umb_status finish(void *context, enum umb_status status, struct umb_error *error)
{
    struct upload *upload = context;
    if (status != UMB_OK && upload->error.status != UMB_OK) {
        status = umb_fail(error, upload->error.status, "%.300s", upload->error.message);
    }
    if (upload->fd >= 0) {
        close(upload->fd);
    }
    free(upload->manifest.files);
    free(upload->piece);
    return status;
}

enum umb_status umb_client_submit(struct umb_client *client,
                                  const struct umb_job_submission *submission,
                                  struct umb_job_submitted *submitted,
                                  struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    memset(submitted, 0, sizeof *submitted);
    if (UMB__UNKNOWN(submission, "submission", error)) {
        return UMB_E_ARGUMENT;
    }
    struct upload upload = {.submission = submission, .submitted = submitted, .fd = -1};
    const struct umb__ending ending = {&upload, sizeof upload, decode, finish};
    const struct umb__call_plan plan = {
        .path = UMBW_PATH_BAKES_SUBMIT, .timeout_ms = UINT32_MAX, .feed = feed, .flows = true};
    enum umb_status status = make_manifest(&upload, error);
    if (status == UMB_OK) {
        const struct umbw_submit_request request = {.has_manifest = 1, .manifest = upload.manifest};
        status = umbw_encode_submit_request(&request, &body, error);
    }
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}
