/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Stand-ins for the functions that take files (inject.c says when they fail). Each exists under its
 * two names, with and without 64: on a 64-bit machine they are the same function.
 */
#define _GNU_SOURCE /* open64 and the like, O_TMPFILE */
#include "inject.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Returns how many of `count` bytes to write; 0 with a count above 0 means that the call fails. */
static size_t bytes_let_through(const struct call *call, size_t count)
{
    if (call->verdict > GO_ON) {
        return 0;
    }
    return call->verdict == GO_ON || count < 2 ? count : count / 2;
}

EXPORT ssize_t write(int fd, const void *bytes, size_t count)
{
    struct call call;
    fault_weigh_fd(&call, WRITE, fd);
    size_t through = bytes_let_through(&call, count);
    if (through == 0 && fault_fails(&call)) {
        return -1;
    }
    record_sent(fd, bytes, through);
    const int entered = record_enter(fd);
    long result = syscall(SYS_write, fd, bytes, through);
    record_written(entered, fd, bytes, result, -1);
    record_leave(entered);
    if (call.verdict == TEAR) {
        fault_die();
    }
    return fault_done(&call, result);
}

static ssize_t pwrite_counted(int fd, const void *bytes, size_t count, off64_t offset)
{
    struct call call;
    fault_weigh_fd(&call, PWRITE, fd);
    size_t through = bytes_let_through(&call, count);
    if (through == 0 && fault_fails(&call)) {
        return -1;
    }
    const int entered = record_enter(fd);
    long result = syscall(SYS_pwrite64, fd, bytes, through, offset);
    record_written(entered, fd, bytes, result, offset);
    record_leave(entered);
    if (call.verdict == TEAR) {
        fault_die();
    }
    return fault_done(&call, result);
}

EXPORT ssize_t pwrite(int fd, const void *bytes, size_t count, off_t offset)
{
    return pwrite_counted(fd, bytes, count, offset);
}

EXPORT ssize_t pwrite64(int fd, const void *bytes, size_t count, off64_t offset)
{
    return pwrite_counted(fd, bytes, count, offset);
}

static int sync_counted(enum function function, long number, int fd)
{
    struct call call;
    fault_weigh_fd(&call, function, fd);
    if (fault_fails(&call)) {
        return -1;
    }
    const int entered = record_enter(fd);
    const long result = syscall(number, fd);
    record_file(entered, RECORD_SYNC, fd, result, 0);
    record_leave(entered);
    return (int)fault_done(&call, result);
}

EXPORT int fsync(int fd)
{
    return sync_counted(FSYNC, SYS_fsync, fd);
}

EXPORT int fdatasync(int fd)
{
    return sync_counted(FDATASYNC, SYS_fdatasync, fd);
}

/* A close that fails still closes, as Linux does. */
EXPORT int close(int fd)
{
    struct call call;
    fault_weigh_fd(&call, CLOSE, fd);
    if (fault_fails(&call)) {
        (void)syscall(SYS_close, fd);
        errno = call.verdict;
        return -1;
    }
    return (int)fault_done(&call, syscall(SYS_close, fd));
}

static int rename_counted(enum function function, int from_at, const char *from, int to_at,
                          const char *to)
{
    struct call call;
    char full[PATH_MAX], other[PATH_MAX];
    fault_weigh_path(&call, function, from_at, from);
    if (fault_fails(&call)) {
        return -1;
    }
    const int entered = record_enter_path(from_at, from, full);
    if (entered) {
        fault_path_below(to_at, to, other);
    }
    const long result = syscall(SYS_renameat2, from_at, from, to_at, to, 0);
    record_name(entered, RECORD_RENAME, full, other, result);
    return (int)fault_done(&call, result);
}

EXPORT int rename(const char *from, const char *to)
{
    return rename_counted(RENAME, AT_FDCWD, from, AT_FDCWD, to);
}

EXPORT int renameat(int from_at, const char *from, int to_at, const char *to)
{
    return rename_counted(RENAMEAT, from_at, from, to_at, to);
}

EXPORT int mkdir(const char *path, mode_t mode)
{
    struct call call;
    fault_weigh_path(&call, MKDIR, AT_FDCWD, path);
    return fault_fails(&call) ? -1 : (int)fault_done(&call, mkdirat(AT_FDCWD, path, mode));
}

EXPORT int unlink(const char *path)
{
    struct call call;
    fault_weigh_path(&call, UNLINK, AT_FDCWD, path);
    return fault_fails(&call) ? -1 : (int)fault_done(&call, unlinkat(AT_FDCWD, path, 0));
}

static int open_counted(enum function function, int at, const char *path, int flags, mode_t mode)
{
    struct call call;
    char full[PATH_MAX];
    fault_weigh_path(&call, function, at, path);
    if (fault_fails(&call)) {
        return -1;
    }
    const int entered = (flags & (O_CREAT | O_TRUNC)) != 0 ? record_enter_path(at, path, full) : 0;
    const long fd = syscall(SYS_openat, at, path, flags, mode);
    record_opened(entered, full, flags, fd);
    return (int)fault_done(&call, fd);
}

/* Reads the mode argument of an open. Only an open that may create has one. */
#define READ_MODE(flags, mode)                                                                     \
    do {                                                                                           \
        if (((flags)&O_CREAT) != 0 || ((flags)&O_TMPFILE) == O_TMPFILE) {                          \
            va_list more;                                                                          \
            va_start(more, flags);                                                                 \
            (mode) = va_arg(more, mode_t);                                                         \
            va_end(more);                                                                          \
        }                                                                                          \
    } while (0)

EXPORT int open(const char *path, int flags, ...)
{
    mode_t mode = 0;
    READ_MODE(flags, mode);
    return open_counted(OPEN, AT_FDCWD, path, flags, mode);
}

EXPORT int open64(const char *path, int flags, ...)
{
    mode_t mode = 0;
    READ_MODE(flags, mode);
    return open_counted(OPEN, AT_FDCWD, path, flags, mode);
}

EXPORT int openat(int at, const char *path, int flags, ...)
{
    mode_t mode = 0;
    READ_MODE(flags, mode);
    return open_counted(OPENAT, at, path, flags, mode);
}

EXPORT int openat64(int at, const char *path, int flags, ...)
{
    mode_t mode = 0;
    READ_MODE(flags, mode);
    return open_counted(OPENAT, at, path, flags, mode);
}

/* FORTIFY calls these functions for an open whose flags the compiler does not know; the flags have
 * no O_CREAT. */
int __open_2(const char *path, int flags);
int __open64_2(const char *path, int flags);
int __openat_2(int at, const char *path, int flags);
int __openat64_2(int at, const char *path, int flags);

EXPORT int __open_2(const char *path, int flags)
{
    return open_counted(OPEN, AT_FDCWD, path, flags, 0);
}

EXPORT int __open64_2(const char *path, int flags)
{
    return open_counted(OPEN, AT_FDCWD, path, flags, 0);
}

EXPORT int __openat_2(int at, const char *path, int flags)
{
    return open_counted(OPENAT, at, path, flags, 0);
}

EXPORT int __openat64_2(int at, const char *path, int flags)
{
    return open_counted(OPENAT, at, path, flags, 0);
}

static void *mmap_counted(void *where, size_t size, int how, int flags, int fd, off64_t offset)
{
    struct call call;
    fault_weigh_fd(&call, MMAP, fd);
    if (fault_fails(&call)) {
        return MAP_FAILED;
    }
    const long at = syscall(SYS_mmap, where, size, how, flags, fd, offset);
    record_mapped(fd, how, flags, at);
    return (void *)fault_done(&call, at);
}

EXPORT void *mmap(void *where, size_t size, int how, int flags, int fd, off_t offset)
{
    return mmap_counted(where, size, how, flags, fd, offset);
}

EXPORT void *mmap64(void *where, size_t size, int how, int flags, int fd, off64_t offset)
{
    return mmap_counted(where, size, how, flags, fd, offset);
}

static int ftruncate_counted(int fd, off64_t size)
{
    struct call call;
    fault_weigh_fd(&call, FTRUNCATE, fd);
    if (fault_fails(&call)) {
        return -1;
    }
    const int entered = record_enter(fd);
    const long result = syscall(SYS_ftruncate, fd, size);
    record_file(entered, RECORD_TRUNCATE, fd, result, (uint64_t)size);
    record_leave(entered);
    return (int)fault_done(&call, result);
}

EXPORT int ftruncate(int fd, off_t size)
{
    return ftruncate_counted(fd, size);
}

EXPORT int ftruncate64(int fd, off64_t size)
{
    return ftruncate_counted(fd, size);
}
