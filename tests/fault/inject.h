/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_INJECT_H
#define UMBRAGE_TESTS_INJECT_H
/*
 * What the files of inject.so share: the decision about one call (inject.c), asked by the stand-ins
 * for file functions (inject_files.c), streams and processes (inject_process.c), memory
 * (inject_memory.c), sockets and threads (inject_system.c); and the log of what was done to files
 * (inject_record.c), which the stand-ins of inject_files.c and inject_more.c write. All of it is
 * async-signal-safe, but for a signal handler that writes to a regular file while a log is kept,
 * and sets errno only for a call that fails.
 */
#include <limits.h>
#include <stddef.h>
#include <stdint.h>

#define EXPORT __attribute__((visibility("default")))

enum function {
    WRITE,
    PWRITE,
    FSYNC,
    FDATASYNC,
    RENAME,
    RENAMEAT,
    OPEN,
    OPENAT,
    MMAP,
    FTRUNCATE,
    CLOSE,
    MKDIR,
    UNLINK,
    FILE_FUNCTIONS,
    MALLOC = FILE_FUNCTIONS,
    CALLOC,
    REALLOC,
    ALIGNED_ALLOC,
    POSIX_MEMALIGN,
    MEMORY_FUNCTIONS,
    SOCKET = MEMORY_FUNCTIONS,
    BIND,
    LISTEN,
    ACCEPT,
    GETSOCKNAME,
    GETSOCKOPT,
    SETSOCKOPT,
    CHMOD,
    GETRLIMIT,
    EPOLL,
    PTHREAD_CREATE,
    PREAD,
    FUNCTION_COUNT,
};

/* What to do instead of the call; above 0 it is an errno. */
enum {
    GO_ON = 0,
    SHORTEN = -1,
    KILL = -2,
    TEAR = -3
};

/* A file call: what it is about and what became of it. */
struct call {
    enum function function;
    int counted;
    int verdict; /* of decide */
    uint64_t number;
    char path[PATH_MAX];
};

/* Counts a call of a memory function; 1 if it is to return NULL. */
int fault_memory(enum function function);

/* Counts a call of inject_system.c; 1 if it is to fail: errno is set. */
int fault_system(enum function function);

/* Decides about a call on an open file, or on a path below the folder `at` (AT_FDCWD: the current
 * folder). */
void fault_weigh_fd(struct call *call, enum function function, int fd);
void fault_weigh_path(struct call *call, enum function function, int at, const char *path);

/* Returns 1 if the call must fail; errno is then set. A torn call of a function that writes nothing
 * ends the process. */
int fault_fails(const struct call *call);

/* Records a call's result and returns it; -1 is a failure. */
long fault_done(const struct call *call, long result);

/* Ends the process as kill -9 does. */
_Noreturn void fault_die(void);

/* Called at the beginning of main: calls count from here on. */
void fault_begin(void);

/* 1 if anything was asked for at all. */
int fault_wanted(void);

/* Ends the process with a message: a test must not run without its fault. */
_Noreturn void fault_refuse(const char *what);

/* path as the kernel would find it: absolute, or below the folder of `at`. */
void fault_path_below(int at, const char *path, char out[PATH_MAX]);

/* 1 if a path lies below UMBRAGE_FAULT_UNDER. */
int fault_is_under(const char *path);

/* ---- the log of operations (inject_record.c); power_cut.py has these numbers, too ---- */

enum record {
    RECORD_OPEN = 1, /* that may create; offset 1: it also truncates */
    RECORD_WRITE,
    RECORD_TRUNCATE, /* offset: the size */
    RECORD_SYNC,     /* fsync and fdatasync: of a file, or of a folder */
    RECORD_SYNC_ALL, /* syncfs */
    RECORD_RENAME,
    RECORD_MKDIR,
    RECORD_UNLINK, /* of a file or an empty folder */
    RECORD_MAP,    /* writes through a map are not seen */
    RECORD_SEND,   /* to a socket, noted before it is sent */
    RECORD_MARK,   /* a word of the test's own */
};

/* 1 if a log is kept. */
int record_wanted(void);

/* Enclose an operation on an open file or folder: one lock for all processes is held from enter to
 * leave. enter returns 0 if nothing is to be recorded. In: offset: -1 stands for the file's
 * position. */
int record_enter(int fd);
void record_leave(int entered);
void record_written(int entered, int fd, const void *bytes, long count, int64_t offset);
void record_file(int entered, enum record kind, int fd, long result, uint64_t offset);
void record_mapped(int fd, int protection, int flags, long result);
void record_sent(int fd, const void *bytes, size_t count);

/* Enclose an operation on a name; end with _opened or _name. */
int record_enter_path(int at, const char *path, char full[PATH_MAX]);
void record_opened(int entered, const char *full, int flags, long fd);
void record_name(int entered, enum record kind, const char *full, const char *other, long result);

/* From a test in Python, by ctypes. */
void record_mark(const char *text);

#endif
