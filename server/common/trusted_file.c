/* SPDX-License-Identifier: Apache-2.0 */
/* Checks of ownership, see trusted_file.h. The folder is opened first and the file relative to it,
 * so no rename between the checks can pair a good folder with another user's file. */
#define _GNU_SOURCE /* O_PATH */
#include "common/trusted_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/open_status.h"

#define OTHERS_WRITE (S_IWGRP | S_IWOTH)

/* The fault of owner or mode, in words; NULL: none. */
static const char *find_fault(const struct stat *facts)
{
    if (facts->st_uid != geteuid() && facts->st_uid != 0) {
        return "it belongs to another user; keep it in a folder of the user that bakes";
    }
    return (facts->st_mode & OTHERS_WRITE) != 0
               ? "group or others can write to it; take that permission away (chmod go-w)"
               : NULL;
}

static enum umb_status prove(const char *what, const char *kind, const char *path, int fd,
                             struct umb_error *error)
{
    struct stat facts;
    if (fstat(fd, &facts) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "%s: cannot look at '%.200s'", what, path);
    }
    const char *fault = find_fault(&facts);
    return fault == NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_PERMISSION,
                          "%s: %s '%.200s' has owner %lu and mode %04o: %s", what, kind, path,
                          (unsigned long)facts.st_uid, (unsigned)(facts.st_mode & 07777), fault);
}

static enum umb_status prove_file(const char *what, const char *path, int fd,
                                  struct umb_error *error)
{
    struct stat facts;
    if (fstat(fd, &facts) == 0 && !S_ISREG(facts.st_mode)) {
        return umb_fail(error, UMB_E_NO_INPUT, "%s: '%.200s' is not a regular file", what, path);
    }
    return prove(what, "file", path, fd, error);
}

static enum umb_status open_in(const char *what, int folder, const char *path, const char *name,
                               int *fd, struct umb_error *error)
{
    /* O_NONBLOCK: opening a pipe must not wait. The flag has no effect on files. */
    *fd = openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (*fd < 0 && errno == ELOOP) {
        return umb_fail(error, UMB_E_NO_INPUT,
                        "%s: '%.200s' is a symbolic link; name the file that it leads to", what,
                        path);
    }
    if (*fd < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "%s: cannot open '%.200s'",
                              what, path);
    }
    const enum umb_status status = prove_file(what, path, *fd, error);
    if (status != UMB_OK) {
        (void)close(*fd);
        *fd = -1;
    }
    return status;
}

enum umb_status umbs_trusted_open(const char *what, const char *path, int *fd,
                                  struct umb_error *error)
{
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    char *above = slash != NULL ? strndup(path, (size_t)(slash - path) + 1) : strdup(".");
    *fd = -1;
    if (above == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the folder of '%.200s'", path);
    }
    const int folder = open(above, O_PATH | O_DIRECTORY | O_CLOEXEC);
    enum umb_status status =
        folder >= 0 ? prove(what, "folder", above, folder, error)
                    : umb_fail_errno(error, umb__open_status(errno), errno,
                                     "%s: cannot open the folder '%.200s'", what, above);
    if (status == UMB_OK) {
        status = open_in(what, folder, path, name, fd, error);
    }
    if (folder >= 0) {
        (void)close(folder);
    }
    free(above);
    return status;
}
