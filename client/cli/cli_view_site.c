/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_view_site.h. */
#include "cli_view_site.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tool/tool_try.h"
#include "umbrage/partial.h"

#define FRONT_BYTES_MAX ((uint64_t)256 << 20)

/* Reads bytes of the asset. A source answers one thread at a time. */
static enum umb_status read_asset(struct umbc_view_site *site, uint64_t offset, uint8_t *bytes,
                                  size_t size, struct umb_error *error)
{
    size_t got = 0;
    pthread_mutex_lock(&site->lock);
    const enum umb_status status =
        umb_region_source_read(&site->asset, offset, bytes, size, &got, error);
    pthread_mutex_unlock(&site->lock);
    return status == UMB_OK && got < size
               ? umb_fail(error, UMB_E_TRUNCATED, "asset: ends %zu bytes into a part of %zu", got,
                          size)
               : status;
}

/* Reads the head of the asset, and its record of the scene. */
static enum umb_status read_record(struct umbc_view_site *site, struct umb_error *error)
{
    const struct umb_partial_options options = {.sha256 = umb_sha256_openssl()};
    struct umb_partial *partial = NULL;
    struct umb_asset_info info;
    if (site->head.open_bytes > FRONT_BYTES_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "asset: its head has %llu bytes, at most %llu",
                        (unsigned long long)site->head.open_bytes,
                        (unsigned long long)FRONT_BYTES_MAX);
    }
    const size_t size = (size_t)site->head.open_bytes;
    uint8_t *front = malloc(size);
    if (front == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "asset: no memory for its head, %zu bytes", size);
    }
    enum umb_status status = read_asset(site, 0, front, size, error);
    status = status == UMB_OK ? umb_partial_open(front, size, &options, &partial, error) : status;
    free(front);
    status = status == UMB_OK ? umb_partial_build(partial, error) : status;
    if (status == UMB_OK) {
        umb_asset_get_info(umb_partial_lower(partial), &info);
        memcpy(site->scene_hash, info.scene_hash, sizeof site->scene_hash);
        site->z_up = strstr(info.settings, "\nup=z\n") != NULL;
    }
    umb_partial_close(partial);
    return status;
}

enum umb_status umbc_view_site_begin(struct umbc_view_site *site,
                                     const struct umb_region_source *asset, struct umb_error *error)
{
    uint8_t bytes[UMB_FILE_HEAD_BYTES];
    *site = (struct umbc_view_site){.asset = *asset};
    if (pthread_mutex_init(&site->lock, NULL) != 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "view: out of memory");
    }
    UMB__TRY(read_asset(site, 0, bytes, sizeof bytes, error));
    UMB__TRY(umb_file_read_head(bytes, sizeof bytes, &site->head, error));
    return site->head.encoding == UMB_ENCODING_PACKED
               ? read_record(site, error)
               : umb_fail(error, UMB_E_UNSUPPORTED,
                          "asset: is a mapped file; browsers read packed ones (umbrage pack)");
}

enum umb_status umbc_view_site_add(struct umbc_view_site *site, const char *path,
                                   const char *source, char *bytes, size_t size,
                                   struct umb_error *error)
{
    struct umbc_view_file file = {.path = strdup(path),
                                  .bytes = bytes,
                                  .size = size,
                                  .source = source ? strdup(source) : NULL};
    struct umbc_view_file *files = site->count < UMBC_VIEW_FILES_MAX
                                       ? realloc(site->files, (site->count + 1) * sizeof *files)
                                       : NULL;
    if (files != NULL) {
        site->files = files;
    }
    if (files == NULL || file.path == NULL || (source != NULL && file.source == NULL)) {
        free(file.path);
        free(file.source);
        free(bytes);
        return site->count < UMBC_VIEW_FILES_MAX
                   ? umb_fail(error, UMB_E_NO_MEMORY, "view: out of memory")
                   : umb_fail(error, UMB_E_LIMIT, "view: more than %d files", UMBC_VIEW_FILES_MAX);
    }
    files[site->count++] = file;
    return UMB_OK;
}

void umbc_view_site_finish(struct umbc_view_site *site)
{
    for (size_t i = 0; i < site->count; i++) {
        free(site->files[i].path);
        free(site->files[i].source);
        free(site->files[i].bytes);
    }
    free(site->files);
    (void)pthread_mutex_destroy(&site->lock);
    site->files = NULL;
    site->count = 0;
}

const struct umbc_view_file *umbc_view_site_find(const struct umbc_view_site *site,
                                                 const char *path)
{
    for (size_t i = 0; i < site->count; i++) {
        if (strcmp(site->files[i].path, path) == 0) {
            return &site->files[i];
        }
    }
    return NULL;
}

const char *umbc_view_type(const struct umbc_view_file *file)
{
    static const struct {
        const char *ending, *type;
    } types[] = {
        {".html", "text/html; charset=utf-8"},
        {".js", "text/javascript; charset=utf-8"},
        {".css", "text/css; charset=utf-8"},
        {".json", "application/json"},
        {".wasm", "application/wasm"},
        {".png", "image/png"},
        {".jpg", "image/jpeg"},
        {".jpeg", "image/jpeg"},
        {".webp", "image/webp"},
    };
    const size_t length = strlen(file->path);
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        const size_t tail = strlen(types[i].ending);
        if (length > tail && strcasecmp(file->path + length - tail, types[i].ending) == 0) {
            return types[i].type;
        }
    }
    return "application/octet-stream";
}

enum umb_status umbc_view_body_open(struct umbc_view_site *site, const struct umbc_view_file *file,
                                    struct umbc_view_body *body, struct umb_error *error)
{
    struct stat info;
    *body = (struct umbc_view_body){.site = site, .file = file, .fd = -1, .size = file->size};
    if (file->source == NULL) {
        body->size = file->bytes != NULL ? file->size : site->head.file_bytes;
        return UMB_OK;
    }
    /* O_NONBLOCK makes the open of a pipe without a writer fail instead of waiting. */
    body->fd = open(file->source, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (body->fd < 0 || fstat(body->fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        umbc_view_body_close(body);
        return umb_fail(error, UMB_E_NO_INPUT, "'%.200s' is not a regular file that can be read",
                        file->source);
    }
    body->size = (uint64_t)info.st_size;
    return UMB_OK;
}

enum umb_status umbc_view_body_read(struct umbc_view_body *body, uint64_t offset, uint8_t *bytes,
                                    size_t size, struct umb_error *error)
{
    const struct umbc_view_file *file = body->file;
    if (file->bytes != NULL) {
        memcpy(bytes, file->bytes + offset, size);
        return UMB_OK;
    }
    if (file->source == NULL) {
        return read_asset(body->site, offset, bytes, size, error);
    }
    size_t at = 0;
    while (at < size) {
        const ssize_t got = pread(body->fd, bytes + at, size - at, (off_t)(offset + at));
        if (got < 0 && errno == EINTR) {
            continue;
        }
        if (got <= 0) {
            return umb_fail_errno(error, UMB_E_IO, got < 0 ? errno : EIO, "cannot read '%.200s'",
                                  file->source);
        }
        at += (size_t)got;
    }
    return UMB_OK;
}

void umbc_view_body_close(struct umbc_view_body *body)
{
    if (body->fd >= 0) {
        (void)close(body->fd);
        body->fd = -1;
    }
}
