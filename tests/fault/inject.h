/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_INJECT_H
#define UMBRAGE_TESTS_INJECT_H
/*
 * What the files of inject.so share: the decision about one call (inject.c), asked by the stand-ins
 * for file functions (inject_files.c), streams and processes (inject_process.c) and memory
 * (inject_memory.c). All of it is async-signal-safe and sets errno only for a call that fails.
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
    FUNCTION_COUNT,
};

/* What to do instead of the call; above 0 it is an errno. */
enum { GO_ON = 0, SHORTEN = -1, KILL = -2, TEAR = -3 };

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

/* Weighs a call on an open file, or on a path below the folder `at` (AT_FDCWD: where we are). */
void fault_weigh_fd(struct call *call, enum function function, int fd);
void fault_weigh_path(struct call *call, enum function function, int at, const char *path);

/* 1 if the call is to fail: errno is set. A torn call of a function that writes nothing dies. */
int fault_fails(const struct call *call);

/* Notes the call and hands back its result, -1 being a failure. */
long fault_done(const struct call *call, long result);

/* Ends the process as kill -9 does. */
_Noreturn void fault_die(void);

/* From here on calls count: the beginning of main. */
void fault_begin(void);

/* 1 if anything was asked for at all. */
int fault_wanted(void);

#endif
