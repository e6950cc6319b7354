/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_JOB_SIMULATION_H
#define UMBRAGE_TESTS_JOB_SIMULATION_H
/*
 * The world of a simulated bake service: clocks, random numbers, and the gate through which calls
 * on files go. Included once, by the program.
 *
 * The gate: calls by this program, and by SQLite in it, are intercepted by name. Each is counted,
 * may fail, and may be the last of this process. Syncs do nothing else: a process that dies loses
 * nothing of the page cache.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "jobs/service_internal.h"

#define SIM_JOBS 1024
#define SIM_DIED 99 /* exit code of a life that was ended at a call */

/* A job as the world saw it last. */
struct sim_job {
    char id[UMBJ_ID_SIZE];
    unsigned owner, content;
    enum umbj_state state;
    int64_t epoch, tries;
};

/* Shared by all lives of the daemon. */
struct sim_world {
    uint64_t random;
    int64_t steady_ms, unix_ms;
    struct sim_job jobs[SIM_JOBS];
    unsigned job_count;
    unsigned done, lost, deaths, faults, late, cancelled, refused, stepped; /* what happened */
    int64_t calls_to_death, calls_to_fault; /* below 0: none is to come */
    int fault;                              /* errno */
    int tampered;                           /* a file was removed by hand */
};

static struct sim_world *gate_world;       /* whose calls are counted; NULL: none */
static _Thread_local int gate_is_watching; /* 1 on the world's own thread */

/* SplitMix64 (Steele et al., OOPSLA 2014). */
static unsigned draw(struct sim_world *world, unsigned below)
{
    uint64_t z = world->random += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (unsigned)((z ^ (z >> 31)) % below);
}

extern void __gcov_dump(void) __attribute__((weak));

/* Ends the process as a kill would, but writes the coverage data first. */
static _Noreturn void sim_exit(int code)
{
    gate_world = NULL;
    if (__gcov_dump != NULL) {
        __gcov_dump();
    }
    _exit(code);
}

/* Ends the process with a message if a condition does not hold. */
#define CHECK(holds)                                                                               \
    do {                                                                                           \
        if (!(holds)) {                                                                            \
            fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #holds);             \
            sim_exit(1);                                                                           \
        }                                                                                          \
    } while (0)

/* Decides about a call: returns 0, or -1 with errno; or ends the process. */
static int gate(void)
{
    struct sim_world *world = gate_world;
    if (world == NULL || !gate_is_watching) {
        return 0;
    }
    if (world->calls_to_death >= 0 && world->calls_to_death-- == 0) {
        world->deaths++;
        sim_exit(SIM_DIED);
    }
    if (world->calls_to_fault >= 0 && world->calls_to_fault-- == 0) {
        world->faults++;
        errno = world->fault;
        return -1;
    }
    return 0;
}

#define CAUGHT __attribute__((visibility("default")))

CAUGHT int fsync(int fd)
{
    (void)fd;
    return gate();
}

CAUGHT int fdatasync(int fd)
{
    (void)fd;
    return gate();
}

CAUGHT int syncfs(int fd);
CAUGHT int syncfs(int fd)
{
    (void)fd;
    return gate();
}

CAUGHT int renameat(int from, const char *source, int to, const char *target)
{
    return gate() != 0 ? -1 : (int)syscall(SYS_renameat2, from, source, to, target, 0);
}

CAUGHT int rename(const char *source, const char *target)
{
    return gate() != 0 ? -1 : (int)syscall(SYS_renameat2, AT_FDCWD, source, AT_FDCWD, target, 0);
}

CAUGHT int unlinkat(int folder, const char *name, int flags)
{
    return gate() != 0 ? -1 : (int)syscall(SYS_unlinkat, folder, name, flags);
}

CAUGHT int unlink(const char *path)
{
    return gate() != 0 ? -1 : (int)syscall(SYS_unlinkat, AT_FDCWD, path, 0);
}

CAUGHT int mkdirat(int folder, const char *name, mode_t mode)
{
    return gate() != 0 ? -1 : (int)syscall(SYS_mkdirat, folder, name, mode);
}

static mode_t mode_of(int flags, va_list arguments)
{
    return (flags & O_CREAT) != 0 ? (mode_t)va_arg(arguments, int) : 0;
}

CAUGHT int open(const char *path, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return gate() != 0 ? -1 : (int)syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

CAUGHT int openat(int folder, const char *path, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return gate() != 0 ? -1 : (int)syscall(SYS_openat, folder, path, flags, mode);
}

CAUGHT ssize_t write(int fd, const void *bytes, size_t count)
{
    return gate() != 0 ? -1 : (ssize_t)syscall(SYS_write, fd, bytes, count);
}

CAUGHT ssize_t pwrite64(int fd, const void *bytes, size_t count, off_t offset);
CAUGHT ssize_t pwrite64(int fd, const void *bytes, size_t count, off_t offset)
{
    return gate() != 0 ? -1 : (ssize_t)syscall(SYS_pwrite64, fd, bytes, count, offset);
}

#endif
