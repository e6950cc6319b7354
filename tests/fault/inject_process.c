/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The rest of what inject.so stands in for: the beginning of main, programs started by execve, and
 * streams on files that fdopen and mkstemp make, whose writes glibc would hide inside itself.
 *
 * Invariants: originals are looked up once, before main; a stream made here writes all bytes or
 * reports how many it wrote, as a stream of glibc does; a table that is full falls back to the
 * original.
 */
#define _GNU_SOURCE /* RTLD_NEXT, fopencookie, mkstemp64 */
#include "inject.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define STREAMS         16 /* of ours, open at once */
#define ENVIRONMENT_MAX 64 /* variables of a program started */

typedef int main_function(int, char **, char **);
typedef int start_function(main_function *, int, char **, void (*)(void), void (*)(void),
                           void (*)(void), void *);

/* glibc's entry, which no header declares. */
start_function __libc_start_main;

static main_function *program_main;
static start_function *real_start;
static FILE *(*real_fdopen)(int, const char *);
static int (*real_fileno)(FILE *);
static int (*real_mkstemp)(char *);

/* Converts a data pointer to a function pointer in the way that POSIX gives for dlsym. */
static void look_up(void *function, const char *name)
{
    void *found = dlsym(RTLD_NEXT, name);
    memcpy(function, &found, sizeof found);
}

__attribute__((constructor)) static void look_up_originals(void)
{
    look_up(&real_start, "__libc_start_main");
    look_up(&real_fdopen, "fdopen");
    look_up(&real_fileno, "fileno");
    look_up(&real_mkstemp, "mkstemp");
}

/* ---- main ---- */

static int run_main(int count, char **words, char **environment)
{
    fault_begin();
    return program_main(count, words, environment);
}

EXPORT int __libc_start_main(main_function *main, int count, char **words, void (*init)(void),
                             void (*fini)(void), void (*loader_fini)(void), void *stack_end)
{
    program_main = main;
    if (real_start == NULL) {
        look_up(&real_start, "__libc_start_main");
    }
    return real_start(run_main, count, words, init, fini, loader_fini, stack_end);
}

/* ---- execve: the environment of ours goes along ---- */

static int is_ours(const char *entry)
{
    return strncmp(entry, "UMBRAGE_FAULT_", 14) == 0 || strncmp(entry, "LD_PRELOAD=", 11) == 0;
}

EXPORT int execve(const char *path, char *const words[], char *const environment[])
{
    char *together[ENVIRONMENT_MAX + 1];
    size_t count = 0;
    for (size_t i = 0; environment[i] != NULL && count < ENVIRONMENT_MAX; i++) {
        if (!is_ours(environment[i])) {
            together[count++] = environment[i];
        }
    }
    for (size_t i = 0; environ[i] != NULL && count < ENVIRONMENT_MAX; i++) {
        if (is_ours(environ[i])) {
            together[count++] = environ[i];
        }
    }
    together[count] = NULL;
    return (int)syscall(SYS_execve, path, words, together);
}

/* ---- streams ---- */

/* One stream on a descriptor; taken while stream is not NULL. */
struct file_stream {
    _Atomic(FILE *) stream;
    int fd;
};

static struct file_stream streams[STREAMS];
static char taking; /* stands in for a stream that is being made */

static ssize_t stream_write(void *cookie, const char *bytes, size_t count)
{
    const struct file_stream *file = cookie;
    size_t written = 0;
    while (written < count) {
        ssize_t part = write(file->fd, bytes + written, count - written);
        if (part < 0) {
            break; /* as glibc's own: an interrupted write is an error of the stream */
        }
        written += (size_t)part;
    }
    return (ssize_t)written;
}

static int stream_close(void *cookie)
{
    struct file_stream *file = cookie;
    int fd = file->fd;
    atomic_store(&file->stream, NULL);
    return close(fd);
}

static struct file_stream *take_stream(int fd)
{
    for (size_t i = 0; i < STREAMS; i++) {
        FILE *none = NULL;
        if (atomic_compare_exchange_strong(&streams[i].stream, &none, (FILE *)(void *)&taking)) {
            streams[i].fd = fd;
            return &streams[i];
        }
    }
    return NULL;
}

EXPORT FILE *fdopen(int fd, const char *mode)
{
    struct stat facts;
    struct file_stream *file = NULL;
    const int wanted = fault_wanted() || record_wanted();
    if (wanted && mode[0] == 'w' && fstat(fd, &facts) == 0 && S_ISREG(facts.st_mode)) {
        file = take_stream(fd);
    }
    if (file == NULL) {
        return real_fdopen(fd, mode);
    }
    const cookie_io_functions_t functions = {.write = stream_write, .close = stream_close};
    FILE *stream = fopencookie(file, mode, functions);
    atomic_store(&file->stream, stream);
    return stream;
}

EXPORT int fileno(FILE *stream)
{
    for (size_t i = 0; i < STREAMS; i++) {
        if (atomic_load(&streams[i].stream) == stream) {
            return streams[i].fd;
        }
    }
    return real_fileno(stream);
}

static int mkstemp_counted(char *name)
{
    struct call call;
    fault_weigh_path(&call, OPEN, AT_FDCWD, name);
    if (fault_fails(&call)) {
        return -1;
    }
    char full[PATH_MAX];
    const int entered = record_enter_path(AT_FDCWD, name, full);
    const int fd = real_mkstemp(name); /* it opens inside the C library: not recorded there */
    if (entered) {
        fault_path_below(AT_FDCWD, name, full);
    }
    record_opened(entered, full, O_CREAT | O_EXCL, fd);
    return (int)fault_done(&call, fd);
}

EXPORT int mkstemp(char *name)
{
    return mkstemp_counted(name);
}

EXPORT int mkstemp64(char *name)
{
    return mkstemp_counted(name);
}
