/* SPDX-License-Identifier: Apache-2.0 */
/* See private_folder.h. */
#define _XOPEN_SOURCE 700 /* realpath, S_ISVTX */
#include "common/private_folder.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/open_status.h"

static int is_ours(const struct stat *facts)
{
    return facts->st_uid == geteuid() || facts->st_uid == 0;
}

static int others_may_write(const struct stat *facts)
{
    return (facts->st_mode & (S_IWGRP | S_IWOTH)) != 0;
}

int umbs_private_file(const struct stat *facts)
{
    return S_ISREG(facts->st_mode) && is_ours(facts) && !others_may_write(facts) &&
           facts->st_nlink == 1;
}

/* Checks one folder on the way; the last one must not be writable by others, even if it is
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
    if (!is_ours(&facts)) {
        return umb_fail(error, UMB_E_PERMISSION,
                        "other users can change '%.100s': '%.150s' belongs to uid %ld; it must "
                        "belong to uid %ld or root",
                        path, folder, (long)facts.st_uid, (long)geteuid());
    }
    if (others_may_write(&facts) && (is_last || (facts.st_mode & S_ISVTX) == 0)) {
        return umb_fail(error, UMB_E_PERMISSION,
                        "other users can change '%.100s': '%.150s' has mode %04o; take write "
                        "permission from group and others (chmod go-w)",
                        path, folder, (unsigned)(facts.st_mode & 07777));
    }
    return UMB_OK;
}

/* Checks the folder of an absolute path without links, and all folders above it. */
static enum umb_status check_all(const char *path, char *resolved, struct umb_error *error)
{
    const size_t length = strlen(resolved);
    enum umb_status status = check_one(path, "/", length == 1, error);
    for (size_t i = 1; status == UMB_OK && i < length; i++) {
        const size_t step = strcspn(resolved + i, "/");
        const char end = resolved[i + step];
        resolved[i + step] = '\0';
        status = check_one(path, resolved, end == '\0', error);
        resolved[i + step] = end;
        i += step;
    }
    return status;
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
