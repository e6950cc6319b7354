/* SPDX-License-Identifier: Apache-2.0 */
/* Stand-ins for calls that are only recorded, never made to fail (inject_record.c). */
#define _GNU_SOURCE /* syncfs, pwritev */
#include "inject.h"

#include <fcntl.h>
#include <stddef.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

EXPORT int mkdirat(int at, const char *path, mode_t mode)
{
    char full[PATH_MAX];
    const int entered = record_enter_path(at, path, full);
    const long result = syscall(SYS_mkdirat, at, path, mode);
    record_name(entered, RECORD_MKDIR, full, NULL, result);
    return (int)result;
}

EXPORT int unlinkat(int at, const char *path, int flags)
{
    char full[PATH_MAX];
    const int entered = record_enter_path(at, path, full);
    const long result = syscall(SYS_unlinkat, at, path, flags);
    record_name(entered, RECORD_UNLINK, full, NULL, result);
    return (int)result;
}

EXPORT int rmdir(const char *path)
{
    return unlinkat(AT_FDCWD, path, AT_REMOVEDIR);
}

EXPORT int syncfs(int fd)
{
    const int entered = record_enter(fd);
    const long result = syscall(SYS_syncfs, fd);
    record_file(entered, RECORD_SYNC_ALL, fd, result, 0);
    record_leave(entered);
    return (int)result;
}

/* A write that covers several parts of a file is recorded as several writes: a power cut may fall
 * between them. */
static void note_parts(int entered, int fd, const struct iovec *parts, int count, long written,
                       off64_t offset)
{
    for (int i = 0; i < count && written > 0; i++) {
        const long part = written < (long)parts[i].iov_len ? written : (long)parts[i].iov_len;
        record_written(entered, fd, parts[i].iov_base, part, offset);
        offset += part;
        written -= part;
    }
}

static void note_sent(int fd, const struct iovec *parts, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        record_sent(fd, parts[i].iov_base, parts[i].iov_len);
    }
}

EXPORT ssize_t writev(int fd, const struct iovec *parts, int count)
{
    note_sent(fd, parts, (size_t)count);
    const int entered = record_enter(fd);
    const long result = syscall(SYS_writev, fd, parts, count);
    if (entered && result > 0) {
        note_parts(entered, fd, parts, count, result, lseek(fd, 0, SEEK_CUR) - result);
    }
    record_leave(entered);
    return result;
}

static ssize_t pwritev_noted(int fd, const struct iovec *parts, int count, off64_t offset)
{
    const int entered = record_enter(fd);
    const long result = syscall(SYS_pwritev, fd, parts, count, offset, offset >> 32);
    note_parts(entered, fd, parts, count, result, offset);
    record_leave(entered);
    return result;
}

EXPORT ssize_t pwritev(int fd, const struct iovec *parts, int count, off_t offset)
{
    return pwritev_noted(fd, parts, count, offset);
}

EXPORT ssize_t pwritev64(int fd, const struct iovec *parts, int count, off64_t offset)
{
    return pwritev_noted(fd, parts, count, offset);
}

EXPORT ssize_t sendmsg(int fd, const struct msghdr *message, int flags)
{
    note_sent(fd, message->msg_iov, message->msg_iovlen);
    return syscall(SYS_sendmsg, fd, message, flags);
}

EXPORT ssize_t sendto(int fd, const void *bytes, size_t count, int flags,
                      const struct sockaddr *address, socklen_t size)
{
    record_sent(fd, bytes, count);
    return syscall(SYS_sendto, fd, bytes, count, flags, address, size);
}

EXPORT ssize_t send(int fd, const void *bytes, size_t count, int flags)
{
    return sendto(fd, bytes, count, flags, NULL, 0);
}
