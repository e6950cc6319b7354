/* SPDX-License-Identifier: Apache-2.0 */
/* The simplest source of a region: a local file. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "umbrage/region.h"

static enum umb_status read_file(void *user, uint64_t offset, void *bytes, size_t size, size_t *got,
                                 struct umb_error *error)
{
    ssize_t count;
    do {
        count = pread(*(const int *)user, bytes, size, (off_t)offset);
    } while (count < 0 && errno == EINTR);
    if (count < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "region: reading the file");
    }
    *got = (size_t)count;
    return UMB_OK;
}

enum umb_status umb_region_file_open(const char *path, struct umb_region_source *source,
                                     struct umb_error *error)
{
    *source = (struct umb_region_source){0};
    int *file = malloc(sizeof *file);
    if (!file) {
        return umb_fail(error, UMB_E_NO_MEMORY, "region: out of memory");
    }
    /* O_NONBLOCK makes the open of a pipe without a writer fail instead of waiting. */
    *file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (*file < 0) {
        const int reason = errno;
        free(file);
        return umb_fail_errno(error, reason == EACCES ? UMB_E_PERMISSION : UMB_E_NO_INPUT, reason,
                              "cannot open '%.200s'", path);
    }
    struct stat info;
    if (fstat(*file, &info) != 0 || !S_ISREG(info.st_mode)) {
        (void)close(*file);
        free(file);
        return umb_fail(error, UMB_E_NO_INPUT, "'%.200s' is not a regular file", path);
    }
    *source = (struct umb_region_source){.read_at = read_file, .user = file};
    return UMB_OK;
}

void umb_region_file_close(struct umb_region_source *source)
{
    int *file = source->user;
    if (file) {
        (void)close(*file);
        free(file);
        source->user = NULL;
    }
}
