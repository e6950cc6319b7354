/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Atomic replacement of a file: temporary beside it, fsync, rename, fsync of the folder.
 *
 * Invariants: the target is never opened for writing; a temporary is made with O_EXCL, so two
 * writers never share one; after a failed write or fsync nothing is renamed, because the kernel may
 * have dropped the dirty pages and a second fsync would then lie (Rebello et al., "Can Applications
 * Recover from fsync Failures?", ATC 2020).
 */
#include "common/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define NAME_KEPT 180 /* bytes of the target's name in the temporary's; NAME_MAX is 255 */
#define TRIES     64  /* names tried before giving up */

static atomic_uint next_number;

/* Length of the folder part of path, its slash included; 0 if there is none. */
static size_t folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (size_t)(slash - path) + 1;
}

static char *temporary_name(const char *path)
{
    size_t folder = folder_length(path);
    const char *name = path + folder;
    size_t kept = strlen(name);
    if (kept > NAME_KEPT) {
        kept = NAME_KEPT;
    }
    size_t capacity = folder + kept + 80;
    char *text = malloc(capacity);
    if (text == NULL) {
        return NULL;
    }
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    snprintf(text, capacity, "%.*s.tmp.%.*s.%ld.%u.%lx", (int)folder, path, (int)kept, name,
             (long)getpid(), atomic_fetch_add(&next_number, 1U), (unsigned long)now.tv_nsec);
    return text;
}

/* Refuses to put a file where a device, folder or socket is: rename would replace it. */
static enum umb_status check_target(const char *path, struct umb_error *error)
{
    struct stat stat_buffer;
    size_t folder = folder_length(path);
    if (path[folder] == '\0' || strlen(path + folder) > 255) {
        return umb_fail(error, UMB_E_CANNOT_CREATE,
                        "cannot create '%.200s': the file name must have 1 to 255 bytes", path);
    }
    if (stat(path, &stat_buffer) == 0 && !S_ISREG(stat_buffer.st_mode)) {
        return umb_fail(error, UMB_E_CANNOT_CREATE,
                        "cannot create '%.200s': it exists and is not a regular file", path);
    }
    return UMB_OK;
}

enum umb_status umbs_file_check(const char *path, struct umb_error *error)
{
    const enum umb_status status = check_target(path, error);
    if (status != UMB_OK) {
        return status;
    }
    const size_t length = folder_length(path);
    char *folder = length == 0 ? strdup(".") : strndup(path, length);
    if (folder == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the folder of '%.200s'", path);
    }
    const int cause = access(folder, W_OK | X_OK) == 0 ? 0 : errno;
    free(folder);
    return cause == 0
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_CANNOT_CREATE, cause, "cannot create '%.200s'", path);
}

static enum umb_status begin(const char *path, mode_t mode, struct umbs_file *file,
                             struct umb_error *error)
{
    memset(file, 0, sizeof *file);
    file->fd = -1;
    enum umb_status status = check_target(path, error);
    if (status != UMB_OK) {
        return status;
    }
    file->path = strdup(path);
    if (file->path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the name '%.200s'", path);
    }
    for (int i = 0; i < TRIES; i++) {
        file->temporary = temporary_name(path);
        if (file->temporary == NULL) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the name '%.200s'", path);
            break;
        }
        file->fd =
            open(file->temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode);
        if (file->fd >= 0) {
            return UMB_OK;
        }
        int cause = errno;
        status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, cause, "cannot create '%.200s'", path);
        free(file->temporary);
        file->temporary = NULL;
        if (cause != EEXIST && cause != EINTR) {
            break;
        }
    }
    free(file->path);
    file->path = NULL;
    return status;
}

enum umb_status umbs_file_begin(const char *path, struct umbs_file *file, struct umb_error *error)
{
    return begin(path, 0666, file, error);
}

enum umb_status umbs_file_begin_private(const char *path, struct umbs_file *file,
                                        struct umb_error *error)
{
    return begin(path, S_IRUSR | S_IWUSR, file, error);
}

enum umb_status umbs_file_write(struct umbs_file *file, const void *bytes, size_t count,
                                struct umb_error *error)
{
    const char *from = bytes;
    while (count > 0 && file->system_error == 0) {
        size_t part = count < ((size_t)1 << 30) ? count : (size_t)1 << 30;
        ssize_t written = write(file->fd, from, part);
        if (written < 0 && errno == EINTR) {
            continue;
        }
        if (written <= 0) {
            file->system_error = written < 0 ? errno : EIO;
            break;
        }
        from += written;
        count -= (size_t)written;
    }
    if (file->system_error != 0) {
        return umb_fail_errno(error, UMB_E_IO, file->system_error, "cannot write '%.200s'",
                              file->path != NULL ? file->path : "");
    }
    return UMB_OK;
}

/* Opens the folder of path. Called before the rename, so a failure here changes nothing visible. */
static enum umb_status open_folder(const char *path, int *fd, struct umb_error *error)
{
    size_t length = folder_length(path);
    char *folder = length == 0 ? strdup(".") : strndup(path, length);
    if (folder == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the folder of '%.200s'", path);
    }
    *fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int cause = errno;
    free(folder);
    return *fd >= 0
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_IO, cause, "cannot sync the folder of '%.200s'", path);
}

static enum umb_status sync_folder(const char *path, int fd, struct umb_error *error)
{
    /* Some file systems have no fsync for folders and fail with EINVAL: then there is nothing to
     * wait for. */
    if (fsync(fd) != 0 && errno != EINVAL && errno != ENOTSUP) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot sync the folder of '%.200s'", path);
    }
    return UMB_OK;
}

enum umb_status umbs_file_commit(struct umbs_file *file, struct umb_error *error)
{
    if (file->temporary == NULL) {
        return umb_fail(error, UMB_E_STATE, "no file is being replaced");
    }
    enum umb_status status = UMB_OK;
    if (file->system_error != 0) {
        status = umb_fail_errno(error, UMB_E_IO, file->system_error, "cannot write '%.200s'",
                                file->path);
    } else if (!file->unsynced && fsync(file->fd) != 0) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "cannot sync '%.200s'", file->path);
    }
    int closed = close(file->fd);
    file->fd = -1;
    if (status == UMB_OK && closed != 0) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "cannot close '%.200s'", file->path);
    }
    int folder = -1;
    if (status == UMB_OK) {
        status = open_folder(file->path, &folder, error);
    }
    if (status == UMB_OK && rename(file->temporary, file->path) != 0) {
        status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot replace '%.200s'",
                                file->path);
        close(folder);
    }
    if (status != UMB_OK) {
        umbs_file_abandon(file);
        return status;
    }
    free(file->temporary);
    file->temporary = NULL;
    status = file->unsynced ? UMB_OK : sync_folder(file->path, folder, error);
    close(folder);
    free(file->path);
    file->path = NULL;
    return status;
}

void umbs_file_abandon(struct umbs_file *file)
{
    if (file->temporary != NULL) {
        if (file->fd >= 0) {
            close(file->fd);
        }
        unlink(file->temporary);
    }
    free(file->temporary);
    free(file->path);
    memset(file, 0, sizeof *file);
    file->fd = -1;
}

static enum umb_status sink_write(void *user, const void *bytes, size_t count)
{
    return umbs_file_write(user, bytes, count, NULL);
}

struct umb_sink umbs_file_sink(struct umbs_file *file)
{
    return (struct umb_sink){.write = sink_write, .user = file};
}
