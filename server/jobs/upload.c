/* SPDX-License-Identifier: Apache-2.0 */
/* Bundles on their way in, see upload.h. */
#define _GNU_SOURCE /* syncfs */
#include "jobs/upload.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/file_system.h"
#include "common/sha256.h"
#include "jobs/folder.h"
#include "tool/output.h"
#include "umbrage/asset.h"

#define NAME_SIZE     40
#define SYNC_EACH_MAX 8 /* files and folders that are synced one by one; more: syncfs */

struct umbj_upload {
    const char *path;           /* path of the jobs folder */
    const atomic_int *stop;     /* may be NULL */
    int jobs, incoming, folder; /* descriptors */
    char name[NAME_SIZE];       /* in incoming */
    char key[UMB_ID_TEXT_SIZE];
    struct umbj_bundle_file *files; /* with own copies of the paths */
    size_t file_count, current;
    int fd; /* descriptor of the current file, -1 = not open */
    uint64_t written;
    uint8_t head[UMBJ_HEAD_BYTES]; /* first bytes of the current file */
    struct umbs_sha256_run hash;
    size_t folders; /* Number of folders made below the bundle's */
    int accepted, left;
    atomic_int holders; /* number of holders: the call, and the service's promise */
};

static int is_stopped(const struct umbj_upload *upload)
{
    return upload->left || (upload->stop != NULL && atomic_load(upload->stop));
}

static enum umb_status fail_io(struct umb_error *error, const char *what, const char *path)
{
    const int cause = errno;
    const enum umb_status status = cause == ENOSPC || cause == EDQUOT ? UMB_E_LIMIT : UMB_E_IO;
    return umb_fail_errno(error, status, cause, "bundle: cannot %s '%.100s'", what, path);
}

static enum umb_status copy_manifest(struct umbj_upload *upload,
                                     const struct umbj_manifest *manifest, struct umb_error *error)
{
    upload->files = calloc(manifest->file_count, sizeof *upload->files);
    for (size_t i = 0; upload->files != NULL && i < manifest->file_count; i++) {
        struct umbj_bundle_file *file = &upload->files[i];
        *file = manifest->files[i];
        file->path = strdup(file->path);
        if (file->path == NULL) {
            break;
        }
        upload->file_count++;
    }
    return upload->file_count == manifest->file_count
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the manifest");
}

/* Makes the bundle's folder, with the first bytes. */
static enum umb_status open_folders(struct umbj_upload *upload, struct umb_error *error)
{
    uint64_t number = 0;
    if (upload->folder >= 0) {
        return UMB_OK;
    }
    if (upload->jobs >= 0) { /* an earlier attempt failed */
        return umb_fail(error, UMB_E_IO, "bundle: its folder could not be made");
    }
    if (getrandom(&number, sizeof number, 0) != (ssize_t)sizeof number) {
        return umb_fail(error, UMB_E_INTERNAL, "no random bytes to be had for a folder's name");
    }
    snprintf(upload->name, sizeof upload->name, "%016llx", (unsigned long long)number);
    upload->jobs = open(upload->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (upload->jobs < 0) {
        return fail_io(error, "open", upload->path);
    }
    upload->incoming = openat(upload->jobs, "incoming", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (upload->incoming < 0 || mkdirat(upload->incoming, upload->name, 0700) != 0) {
        upload->name[0] = '\0';
        return fail_io(error, "create a folder in", "incoming");
    }
    upload->folder = openat(upload->incoming, upload->name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return upload->folder >= 0 ? UMB_OK : fail_io(error, "open", "incoming");
}

enum umb_status umbj_upload_begin(const char *folder, const struct umbj_manifest *manifest,
                                  const uint8_t key[UMBJ_HASH_BYTES], const atomic_int *stop,
                                  struct umbj_upload **out, struct umb_error *error)
{
    *out = NULL;
    struct umbj_upload *upload = calloc(1, sizeof *upload);
    if (upload == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for an upload");
    }
    upload->jobs = upload->incoming = upload->folder = upload->fd = -1;
    upload->path = folder;
    upload->stop = stop;
    atomic_init(&upload->holders, 1);
    umb_id_to_text(key, upload->key);
    enum umb_status status = copy_manifest(upload, manifest, error);
    if (status != UMB_OK) {
        umbj_upload_destroy(upload);
        return status;
    }
    *out = upload;
    return UMB_OK;
}

/* Creates the folders of a path inside the bundle's folder, and opens the last one. */
static int open_parent(struct umbj_upload *upload, const char *path, const char **name)
{
    int folder = fcntl(upload->folder, F_DUPFD_CLOEXEC, 0);
    char component[UMBJ_PATH_MAX + 1];
    const char *slash = strchr(path, '/');
    while (folder >= 0 && slash != NULL) {
        memcpy(component, path, (size_t)(slash - path));
        component[slash - path] = '\0';
        int made = mkdirat(folder, component, 0700);
        upload->folders += made == 0;
        int next = made == 0 || errno == EEXIST
                       ? openat(folder, component, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)
                       : -1;
        umbs_hang_up(&folder);
        folder = next;
        path = slash + 1;
        slash = strchr(path, '/');
    }
    *name = path;
    return folder;
}

static enum umb_status open_current(struct umbj_upload *upload, struct umb_error *error)
{
    const char *path = upload->files[upload->current].path, *name = NULL;
    int parent = open_parent(upload, path, &name);
    if (parent >= 0) {
        upload->fd =
            openat(parent, name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
        umbs_hang_up(&parent);
    }
    if (upload->fd < 0 && (errno == EEXIST || errno == ENOTDIR || errno == EISDIR ||
                           errno == ENAMETOOLONG || errno == EILSEQ)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "files[%zu].path: '%.80s' cannot be a file beside the others",
                        upload->current, path);
    }
    if (upload->fd < 0) {
        return fail_io(error, "create", path);
    }
    upload->written = 0;
    umbs_sha256_begin(&upload->hash);
    return UMB_OK;
}

static enum umb_status close_current(struct umbj_upload *upload, struct umb_error *error)
{
    const struct umbj_bundle_file *file = &upload->files[upload->current];
    uint8_t hash[UMBJ_HASH_BYTES];
    umbs_sha256_end(&upload->hash, hash);
    const int synced = upload->file_count <= SYNC_EACH_MAX ? fsync(upload->fd) : 0;
    const int closed = close(upload->fd);
    upload->fd = -1;
    if (synced != 0 || closed != 0) {
        return fail_io(error, "write", file->path);
    }
    if (memcmp(hash, file->sha256, sizeof hash) != 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "files[%zu].sha256: is not that of the bytes that came for '%.80s'",
                        upload->current, file->path);
    }
    upload->current++;
    return UMB_OK;
}

/* Closes files that are complete, including empty ones, and opens the next file to be written. */
static enum umb_status advance(struct umbj_upload *upload, struct umb_error *error)
{
    UMB__TRY(open_folders(upload, error));
    while (upload->current < upload->file_count) {
        if (is_stopped(upload)) {
            return umb_fail(error, UMB_E_UNAVAILABLE, "server: shutting down");
        }
        if (upload->fd < 0) {
            UMB__TRY(open_current(upload, error));
        } else if (upload->written == upload->files[upload->current].size) {
            UMB__TRY(close_current(upload, error));
        } else {
            break;
        }
    }
    return UMB_OK;
}

/* Checks a file's first bytes once they have arrived. */
static enum umb_status look_at_head(struct umbj_upload *upload, const char *bytes, size_t count,
                                    struct umb_error *error)
{
    if (upload->written >= UMBJ_HEAD_BYTES) {
        return UMB_OK;
    }
    const size_t left = UMBJ_HEAD_BYTES - (size_t)upload->written;
    memcpy(upload->head + upload->written, bytes, count < left ? count : left);
    return count < left
               ? UMB_OK
               : umbj_bundle_check_head(upload->current, upload->files[upload->current].path,
                                        upload->head, error);
}

enum umb_status umbj_upload_write(struct umbj_upload *upload, const void *bytes, size_t count,
                                  struct umb_error *error)
{
    const char *from = bytes;
    UMB__TRY(advance(upload, error));
    while (count > 0) {
        if (upload->current == upload->file_count) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "data: %zu bytes more than the files of the manifest have", count);
        }
        const struct umbj_bundle_file *file = &upload->files[upload->current];
        const uint64_t left = file->size - upload->written;
        const size_t part = count < left ? count : (size_t)left;
        UMB__TRY(look_at_head(upload, from, part, error));
        errno = umbu_write_all(upload->fd, from, part);
        if (errno != 0) {
            return fail_io(error, "write", file->path);
        }
        umbs_sha256_add(&upload->hash, from, part);
        upload->written += part;
        from += part;
        count -= part;
        UMB__TRY(advance(upload, error));
    }
    return UMB_OK;
}

static int sync_folders(int folder);

/* Syncs a subfolder, unless an earlier sync failed. user: int *, set to 1 after a failure. */
static void sync_below(void *user, int folder, const char *name)
{
    int *failed = user;
    if (!*failed) {
        const int below = openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        /* Files are synced apart. */
        *failed = below >= 0 ? sync_folders(below) != 0 : errno != ENOTDIR;
    }
}

/* Syncs a folder and its subfolders, because their names are part of the bundle. Takes over the
 * descriptor. */
static int sync_folders(int folder)
{
    int failed = umbu_folder_sync(folder) != 0;
    return umbj_folder_each(folder, sync_below, &failed) != 0 || failed ? -1 : 0;
}

/* Syncs the parts of the bundle that are not yet durable. */
static int sync_bundle(const struct umbj_upload *upload)
{
    if (upload->file_count > SYNC_EACH_MAX || upload->folders > SYNC_EACH_MAX) {
        return syncfs(upload->folder); /* reports failed writes since the folder was opened */
    }
    const int copy = fcntl(upload->folder, F_DUPFD_CLOEXEC, 0);
    return copy >= 0 ? sync_folders(copy) : -1;
}

enum umb_status umbj_upload_accept(struct umbj_upload *upload, struct umb_error *error)
{
    char target[sizeof "bundles/" + UMB_ID_TEXT_SIZE], source[sizeof "incoming/" + NAME_SIZE];
    UMB__TRY(advance(upload, error));
    if (upload->current < upload->file_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "data: ended in '%.80s', file %zu of %zu",
                        upload->files[upload->current].path, upload->current + 1,
                        upload->file_count);
    }
    if (sync_bundle(upload) != 0) {
        return fail_io(error, "sync", "the bundle");
    }
    snprintf(target, sizeof target, "bundles/%s", upload->key);
    snprintf(source, sizeof source, "incoming/%s", upload->name);
    if (renameat(upload->jobs, source, upload->jobs, target) == 0) {
        upload->accepted = 1;
    } else if (errno != ENOTEMPTY && errno != EEXIST) {
        return fail_io(error, "keep", "the bundle");
    } /* If the folder exists, an earlier bundle of this key has the same bytes, and this one is not
         needed. */
    /* An existing bundle is synced too: the upload that made it may not have synced its name
     * yet. */
    return umbu_folder_sync_at(upload->jobs, "bundles") == 0 ? UMB_OK
                                                             : fail_io(error, "sync", "bundles");
}

int umbj_bundle_take_away(int jobs, const uint8_t key[UMBJ_HASH_BYTES], char gone[UMBJ_GONE_SIZE])
{
    char id[UMB_ID_TEXT_SIZE], source[sizeof "bundles/" + UMB_ID_TEXT_SIZE];
    umb_id_to_text(key, id);
    snprintf(source, sizeof source, "bundles/%s", id);
    snprintf(gone, UMBJ_GONE_SIZE, "incoming/gone.%s", id);
    int failed = renameat(jobs, source, jobs, gone);
    for (int i = 0; failed && (errno == ENOTEMPTY || errno == EEXIST) && i < 1000; i++) {
        /* Another one is being removed. */
        snprintf(gone, UMBJ_GONE_SIZE, "incoming/gone.%s.%d", id, i);
        failed = renameat(jobs, source, jobs, gone);
    }
    gone[0] = failed ? '\0' : gone[0];
    return failed && errno != ENOENT ? -1 : 0;
}

void umbj_upload_discard(struct umbj_upload *upload)
{
    if (upload == NULL) {
        return;
    }
    if (!upload->accepted && upload->name[0] != '\0' && upload->incoming >= 0 &&
        !is_stopped(upload)) {
        umbj_folder_remove_until(upload->incoming, upload->name, upload->stop);
    }
    umbs_hang_up(&upload->fd);
    umbs_hang_up(&upload->folder);
    umbs_hang_up(&upload->incoming);
    umbs_hang_up(&upload->jobs);
}

void umbj_upload_leave(struct umbj_upload *upload)
{
    upload->stop = NULL;
    upload->left = 1;
}

void umbj_upload_hold(struct umbj_upload *upload)
{
    atomic_fetch_add(&upload->holders, 1);
}

void umbj_upload_let_go(struct umbj_upload *upload)
{
    if (atomic_fetch_sub(&upload->holders, 1) > 1) {
        return;
    }
    for (size_t i = 0; i < upload->file_count; i++) {
        free((void *)upload->files[i].path);
    }
    free(upload->files);
    free(upload);
}

void umbj_upload_destroy(struct umbj_upload *upload)
{
    if (upload != NULL) {
        umbj_upload_discard(upload);
        umbj_upload_let_go(upload);
    }
}
