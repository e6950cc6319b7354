/* SPDX-License-Identifier: Apache-2.0 */
/* The simplest source of a region: a local file. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "umbrage/region.h"

static enum umb_status read_range(int file, const struct umb_range *range, uint8_t **buffer,
                                  size_t *got, struct umb_error *error)
{
    uint8_t *bytes = realloc(*buffer, (size_t)range->length);
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "region: no memory for %llu bytes",
                        (unsigned long long)range->length);
    }
    *buffer = bytes;
    *got = 0;
    while (*got < range->length) {
        const ssize_t count =
            pread(file, bytes + *got, (size_t)range->length - *got, (off_t)(range->offset + *got));
        if (count < 0 && errno == EINTR) {
            continue;
        }
        if (count < 0) {
            return umb_fail_errno(error, UMB_E_IO, errno, "region: reading the file");
        }
        if (count == 0) {
            break;
        }
        *got += (size_t)count;
    }
    return UMB_OK;
}

static enum umb_status read_ranges(void *user, const struct umb_range *ranges, size_t count,
                                   umb_range_fn got, void *got_user, struct umb_error *error)
{
    uint8_t *buffer = NULL;
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        size_t size = 0;
        status = read_range(*(const int *)user, &ranges[i], &buffer, &size, error);
        if (status == UMB_OK) {
            status = got(got_user, i, buffer, size);
        }
    }
    free(buffer);
    return status;
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
    *source = (struct umb_region_source){.read = read_ranges, .user = file};
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
