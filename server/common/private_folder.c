/* SPDX-License-Identifier: Apache-2.0 */
/* See private_folder.h. */
#define _GNU_SOURCE /* realpath, S_ISVTX, O_PATH */
#include "common/private_folder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "common/file_system.h"

static int is_ours(const struct stat *facts)
{
    return facts->st_uid == geteuid() || facts->st_uid == 0;
}

/* 1 if group or others may write. */
static int others_may_write(const struct stat *facts)
{
    return (facts->st_mode & (S_IWGRP | S_IWOTH)) != 0;
}

int umbs_private_file(const struct stat *facts)
{
    return S_ISREG(facts->st_mode) && is_ours(facts) && !others_may_write(facts) &&
           facts->st_nlink == 1;
}

/* Checks owner and mode of `at`, a file or folder on the way to `path`. */
static enum umb_status check_facts(const char *path, const char *at, const struct stat *facts,
                                   struct umb_error *error)
{
    if (!is_ours(facts)) {
        return umb_fail(error, UMB_E_PERMISSION,
                        "other users can change '%.100s': '%.150s' belongs to uid %ld; it must "
                        "belong to uid %ld or root",
                        path, at, (long)facts->st_uid, (long)geteuid());
    }
    if (others_may_write(facts)) {
        return umb_fail(error, UMB_E_PERMISSION,
                        "other users can change '%.100s': '%.150s' has mode %04o; take write "
                        "permission from group and others (chmod go-w)",
                        path, at, (unsigned)(facts->st_mode & 07777));
    }
    return UMB_OK;
}

/* Checks one folder of the path. The last folder must not be writable by others, even if it is
 * sticky. */
static enum umb_status check_one(const char *path, const char *folder, int is_last,
                                 struct umb_error *error)
{
    struct stat facts;
    if (lstat(folder, &facts) != 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "'%.150s'", folder);
    }
    if (!S_ISDIR(facts.st_mode)) {
        return umb_fail_errno(error, umb__open_status(ENOTDIR), ENOTDIR, "'%.150s'", folder);
    }
    if (!is_last && (facts.st_mode & S_ISVTX) != 0) {
        facts.st_mode &= ~(mode_t)(S_IWGRP | S_IWOTH); /* others cannot replace what is ours */
    }
    return check_facts(path, folder, &facts, error);
}

/* Checks the folder at an absolute path without symbolic links, and all folders above it. */
static enum umb_status check_all(const char *path, char *resolved, struct umb_error *error)
{
    const size_t length = strlen(resolved);
    UMB__TRY(check_one(path, "/", length == 1, error));
    for (size_t i = 1; i < length; i++) {
        i += strcspn(resolved + i, "/");
        const char end = resolved[i];
        resolved[i] = '\0';
        UMB__TRY(check_one(path, resolved, end == '\0', error)); /* names the folder */
        resolved[i] = end;
    }
    return UMB_OK;
}

enum umb_status umbs_private_folder(const char *path, char **resolved, struct umb_error *error)
{
    *resolved = NULL;
    char *found = realpath(path, NULL);
    if (found == NULL) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "'%.200s'", path);
    }
    enum umb_status status = check_all(path, found, error);
    if (status != UMB_OK) {
        free(found);
        return status;
    }
    *resolved = found;
    return UMB_OK;
}

/* Checks an open file. */
static enum umb_status check_file(const char *path, int fd, struct umb_error *error)
{
    struct stat facts;
    if (fstat(fd, &facts) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "'%.200s'", path);
    }
    if (!S_ISREG(facts.st_mode)) {
        return umb_fail(error, UMB_E_NO_INPUT, "'%.200s' is not a regular file", path);
    }
    if (facts.st_nlink > 1) {
        return umb_fail(error, UMB_E_PERMISSION,
                        "other users may have '%.200s' under another name: it has %lu hard links; "
                        "give a copy",
                        path, (unsigned long)facts.st_nlink);
    }
    return check_facts(path, path, &facts, error);
}

static enum umb_status open_in(const char *folder, const char *path, const char *name, int *fd,
                               struct umb_error *error)
{
    int at = open(folder, O_PATH | O_DIRECTORY | O_CLOEXEC);
    /* O_NONBLOCK has no effect on regular files, but opening a pipe does not wait. */
    *fd = at < 0 ? -1 : openat(at, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    umbs_hang_up(&at);
    if (*fd < 0 && errno == ELOOP) {
        return umb_fail(error, UMB_E_NO_INPUT,
                        "'%.200s' is a symbolic link; name the file that it leads to", path);
    }
    if (*fd < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "cannot open '%.200s'", path);
    }
    const enum umb_status status = check_file(path, *fd, error);
    if (status != UMB_OK) {
        umbs_hang_up(fd);
    }
    return status;
}

enum umb_status umbs_private_open(const char *path, int *fd, struct umb_error *error)
{
    char *resolved = NULL;
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    char *above = slash != NULL ? strndup(path, (size_t)(slash - path) + 1) : strdup(".");
    *fd = -1;
    if (above == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the folder of '%.200s'", path);
    }
    enum umb_status status = umbs_private_folder(above, &resolved, error);
    if (status == UMB_OK) {
        status = open_in(resolved, path, name, fd, error);
    }
    free(resolved);
    free(above);
    return status;
}
