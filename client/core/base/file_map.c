/* SPDX-License-Identifier: Apache-2.0 */
/* Maps files for reading; see umbrage/file.h. */
#include <errno.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/open_status.h"
#include "umbrage/file.h"

enum umb_status umb_file_open(const char *path, struct umb_file *file, struct umb_error *error)
{
    *file = (struct umb_file){NULL, 0};
    /* O_NONBLOCK makes the open of a pipe without a writer fail instead of waiting. */
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (fd < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "%.200s", path);
    }
    struct stat facts;
    enum umb_status status = UMB_OK;
    if (fstat(fd, &facts) != 0) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "%.200s", path);
    } else if (!S_ISREG(facts.st_mode)) {
        status = umb_fail(error, UMB_E_NO_INPUT, "%.200s: not a regular file", path);
    } else if (facts.st_size == 0) {
        status = umb_fail(error, UMB_E_TRUNCATED, "%.200s: empty file", path);
    } else if ((uint64_t)facts.st_size > SIZE_MAX) {
        status = umb_fail(error, UMB_E_TOO_LARGE, "%.200s: larger than the address space", path);
    } else {
        void *at = mmap(NULL, (size_t)facts.st_size, PROT_READ, MAP_SHARED, fd, 0);
        if (at == MAP_FAILED) {
            status = umb_fail_errno(error, UMB_E_IO, errno, "%.200s: cannot be mapped", path);
        } else {
            *file = (struct umb_file){at, (size_t)facts.st_size};
        }
    }
    (void)close(fd);
    return status;
}

void umb_file_close(struct umb_file *file)
{
    if (file->bytes) {
        (void)munmap((void *)(uintptr_t)file->bytes, file->size);
    }
    *file = (struct umb_file){NULL, 0};
}
