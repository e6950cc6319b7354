/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Records a run's operations on files, for power_cut.py to replay. All processes of the run append
 * to one mapped file, so that nothing here needs a descriptor or a folder that a sandbox has
 * closed.
 *
 *     UMBRAGE_FAULT_RECORD  the log; it must be there, with as many bytes as it may take (sparse).
 *                           Operations below UMBRAGE_FAULT_UNDER are recorded, and writes by inode
 *
 * Invariants: an operation and its entry are made under one lock of all processes, so the order of
 * entries is that in which operations took effect; an entry is written before `used` counts it; a
 * full log is marked, since half a recording proves nothing. Bytes for sockets are recorded before
 * they are sent, so no client knows them before their entry.
 *
 * The layout is that of struct entry below; power_cut.py reads it.
 */
#define _GNU_SOURCE /* O_TMPFILE */
#include "inject.h"

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define SENT_MOST 2048 /* bytes noted of one write to a socket */

struct log {
    _Atomic uint64_t used; /* bytes of entries */
    _Atomic uint32_t lock; /* 1: taken */
    _Atomic uint32_t full; /* 1: an entry is missing */
    uint8_t entries[];
};

/* One operation that succeeded. path, other path and data follow, then zeros up to 8 bytes. */
struct entry {
    uint32_t bytes; /* of the whole entry */
    uint32_t kind;  /* enum record */
    uint64_t inode; /* of the file; 0: a socket, or none */
    uint64_t offset;
    uint32_t path_bytes, other_bytes, data_bytes;
    int32_t process;
};

static struct log *record;
static size_t capacity; /* of entries */

__attribute__((constructor)) static void open_log(void)
{
    struct stat facts;
    const char *path = getenv("UMBRAGE_FAULT_RECORD");
    if (path == NULL) {
        return;
    }
    long fd = syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CLOEXEC, 0);
    if (fd < 0 && errno == EACCES) {
        return; /* started in a sandbox; were it to write, the replay would miss that and fail */
    }
    if (fd < 0 || fstat((int)fd, &facts) != 0 || facts.st_size < 1 << 16) {
        fault_refuse("UMBRAGE_FAULT_RECORD");
    }
    long at = syscall(SYS_mmap, NULL, (size_t)facts.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, fd,
                      (off_t)0);
    if (at == -1) {
        fault_refuse("UMBRAGE_FAULT_RECORD");
    }
    (void)syscall(SYS_close, fd);
    record = (struct log *)at; /* NOLINT: the system call's result is an address */
    capacity = (size_t)facts.st_size - sizeof *record;
}

int record_wanted(void)
{
    return record != NULL;
}

static void lock(void)
{
    uint32_t open = 0;
    while (!atomic_compare_exchange_weak(&record->lock, &open, 1)) {
        open = 0;
        (void)syscall(SYS_sched_yield);
    }
}

static void unlock(void)
{
    atomic_store(&record->lock, 0);
}

static uint8_t *put(uint8_t *to, const void *from, size_t bytes)
{
    if (bytes > 0) {
        memcpy(to, from, bytes);
    }
    return to + bytes;
}

/* Appends an entry; the lock is held. */
static void append(enum record kind, uint64_t inode, uint64_t offset, const char *path,
                   const char *other, const void *data, size_t bytes)
{
    const size_t path_bytes = path != NULL ? strlen(path) : 0;
    const size_t other_bytes = other != NULL ? strlen(other) : 0;
    const size_t whole = (sizeof(struct entry) + path_bytes + other_bytes + bytes + 7) / 8 * 8;
    const uint64_t used = atomic_load(&record->used);
    if (whole > capacity - used || whole > UINT32_MAX) {
        atomic_store(&record->full, 1);
        return;
    }
    const struct entry entry = {
        .bytes = (uint32_t)whole,
        .kind = kind,
        .inode = inode,
        .offset = offset,
        .path_bytes = (uint32_t)path_bytes,
        .other_bytes = (uint32_t)other_bytes,
        .data_bytes = (uint32_t)bytes,
        .process = (int32_t)syscall(SYS_getpid),
    };
    uint8_t *at = put(record->entries + used, &entry, sizeof entry);
    at = put(at, path, path_bytes);
    at = put(at, other, other_bytes);
    (void)put(at, data, bytes);
    atomic_store(&record->used, used + whole);
}

static uint64_t inode_of(int fd)
{
    struct stat facts;
    return fstat(fd, &facts) == 0 ? (uint64_t)facts.st_ino : 0;
}

/* ---- files that are open ---- */

int record_enter(int fd)
{
    struct stat facts;
    const int saved = errno;
    int entered = 0;
    if (record != NULL && fstat(fd, &facts) == 0 &&
        (S_ISREG(facts.st_mode) || S_ISDIR(facts.st_mode))) {
        lock();
        entered = 1;
    }
    errno = saved;
    return entered;
}

void record_leave(int entered)
{
    if (entered) {
        unlock();
    }
}

void record_written(int entered, int fd, const void *bytes, long count, int64_t offset)
{
    const int saved = errno;
    if (entered && count > 0) {
        const int64_t end = offset < 0 ? (int64_t)lseek(fd, 0, SEEK_CUR) : offset + count;
        append(RECORD_WRITE, inode_of(fd), (uint64_t)(end - count), NULL, NULL, bytes,
               (size_t)count);
    }
    errno = saved;
}

void record_file(int entered, enum record kind, int fd, long result, uint64_t offset)
{
    const int saved = errno;
    if (entered && result == 0) {
        append(kind, inode_of(fd), offset, NULL, NULL, NULL, 0);
    }
    errno = saved;
}

void record_mapped(int fd, int protection, int flags, long result)
{
    const int saved = errno;
    if (record != NULL && fd >= 0 && result != -1 && (flags & MAP_SHARED) != 0 &&
        (protection & PROT_WRITE) != 0) {
        lock();
        append(RECORD_MAP, inode_of(fd), 0, NULL, NULL, NULL, 0);
        unlock();
    }
    errno = saved;
}

void record_sent(int fd, const void *bytes, size_t count)
{
    struct stat facts;
    const int saved = errno;
    if (record != NULL && count > 0 && fstat(fd, &facts) == 0 && S_ISSOCK(facts.st_mode)) {
        lock();
        append(RECORD_SEND, 0, 0, NULL, NULL, bytes, count < SENT_MOST ? count : SENT_MOST);
        unlock();
    }
    errno = saved;
}

/* ---- names ---- */

/* Takes the lock for an operation on a path that counts; 0: none is to be recorded. */
int record_enter_path(int at, const char *path, char full[PATH_MAX])
{
    const int saved = errno;
    int entered = 0;
    if (record != NULL) {
        lock();
        fault_path_below(at, path, full);
        entered = fault_is_under(full);
        if (!entered) {
            unlock();
        }
    }
    errno = saved;
    return entered;
}

void record_opened(int entered, const char *full, int flags, long fd)
{
    const int saved = errno;
    if (entered && fd >= 0 && (flags & (O_CREAT | O_TRUNC)) != 0) {
        append(RECORD_OPEN, inode_of((int)fd), (flags & O_TRUNC) != 0, full, NULL, NULL, 0);
    }
    record_leave(entered);
    errno = saved;
}

void record_name(int entered, enum record kind, const char *full, const char *other, long result)
{
    struct stat facts = {0};
    const int saved = errno;
    if (entered && result == 0) {
        if (kind == RECORD_MKDIR) {
            (void)lstat(full, &facts);
        }
        append(kind, (uint64_t)facts.st_ino, 0, full, other, NULL, 0);
    }
    record_leave(entered);
    errno = saved;
}

EXPORT void record_mark(const char *text)
{
    if (record != NULL) {
        lock();
        append(RECORD_MARK, 0, 0, NULL, NULL, text, strlen(text));
        unlock();
    }
}
