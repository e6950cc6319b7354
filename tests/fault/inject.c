/* SPDX-License-Identifier: Apache-2.0 */
/*
 * inject.so: makes the n-th call of chosen C library functions fail. Preloaded, never linked.
 *
 *     LD_PRELOAD=inject.so UMBRAGE_FAULT_CALLS=write,fsync UMBRAGE_FAULT_AT=3 \
 *         UMBRAGE_FAULT_ACTION=ENOSPC UMBRAGE_FAULT_UNDER=/tmp/out umbrage-bake ...
 *
 *     UMBRAGE_FAULT_CALLS   which functions count: names of FUNCTIONS below, "files" (all that
 *                           take files), "memory" (all that allocate), "system" (sockets, threads)
 *     UMBRAGE_FAULT_ACTION  an errno of ERRORS below; short (half of a write is written, the rest
 *                           of the functions work); kill (SIGKILL before the call); tear (half of
 *                           a write is written, then SIGKILL; other functions: as kill)
 *     UMBRAGE_FAULT_AT      the call that fails, from 1; 0 or nothing: only count
 *     UMBRAGE_FAULT_KEEP    1: all calls from then on fail
 *     UMBRAGE_FAULT_UNDER   absolute folder without links: only files below it count
 *     UMBRAGE_FAULT_BOARD   file of struct board, shared by the processes of a run. Counts are read
 *                           from it, and `first` and `last` may be changed while the program runs
 *     UMBRAGE_FAULT_RECORD  log of what is done to files below UMBRAGE_FAULT_UNDER: inject_record.c
 *     UMBRAGE_FAULT_TRACE   file that gets one line a counted file call:
 *                           "PID NUMBER FUNCTION ok|failed PATH"
 *
 * Counting begins where main begins: before that the loader and the C++ library allocate, and they
 * can only give up. A program started by execve inherits all this even if it is given another
 * environment, as the importer is; numbering goes on over both when there is a board.
 *
 * Nothing here allocates, locks or uses stdio, so that every function works wherever the original
 * does: in signal handlers, between fork and exec, with any lock held. File calls are made as bare
 * system calls and memory calls by glibc's own second names, so that no look-up at run time can
 * allocate. Limits: glibc on Linux; calls that the C library makes inside itself are not seen, but
 * for malloc and for streams made by fdopen (tool/output.c), which become streams whose writes are.
 * Sources: ld.so(8), proc(5), fopencookie(3), glibc manual "Replacing malloc".
 */
#define _GNU_SOURCE /* O_CLOEXEC and AT_FDCWD on old headers, O_TMPFILE */
#include "inject.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

static const char *const FUNCTIONS[FUNCTION_COUNT] = {
    "write",      "pwrite", "fsync",     "fdatasync",     "rename",         "renameat",
    "open",       "openat", "mmap",      "ftruncate",     "close",          "mkdir",
    "unlink",     "malloc", "calloc",    "realloc",       "aligned_alloc",  "posix_memalign",
    "socket",     "bind",   "listen",    "accept4",       "getsockname",    "getsockopt",
    "setsockopt", "chmod",  "getrlimit", "epoll_create1", "pthread_create", "pread",
};

static const struct {
    const char *name;
    int value;
} ERRORS[] = {
    {"EIO", EIO},       {"ENOSPC", ENOSPC}, {"EINTR", EINTR},   {"ENOMEM", ENOMEM},
    {"EACCES", EACCES}, {"EMFILE", EMFILE}, {"EDQUOT", EDQUOT}, {"EROFS", EROFS},
};

#define BOARD_BYTES 4096 /* of the file; at least one page */

/* One set of counters for all processes of a run. Every field is set with one atomic operation. */
struct board {
    _Atomic uint64_t first, last; /* numbers of the calls that fail; first 0 = none */
    _Atomic uint64_t calls;       /* chosen calls made so far */
    _Atomic uint64_t faults;      /* calls that failed for it */
    _Atomic uint64_t of[FUNCTION_COUNT];
};

static struct board own_board;
static struct board *board = &own_board;
static uint32_t chosen; /* bit i: function i counts */
static int action = EIO;
static char under[PATH_MAX];
static size_t under_length;
static char trace_path[PATH_MAX];
static atomic_int running; /* 1 from main on */

_Noreturn void fault_refuse(const char *what)
{
    static const char name[] = "inject: cannot use ";
    (void)!syscall(SYS_write, 2, name, sizeof name - 1);
    (void)!syscall(SYS_write, 2, what, strlen(what));
    (void)!syscall(SYS_write, 2, "\n", (size_t)1);
    _exit(125);
}

/* ---- the environment ---- */

static int same_word(const char *word, size_t length, const char *name)
{
    return strlen(name) == length && memcmp(word, name, length) == 0;
}

static uint32_t functions_of(const char *list)
{
    const uint32_t files = (1U << FILE_FUNCTIONS) - 1;
    uint32_t mask = 0;
    while (*list != '\0') {
        size_t length = strcspn(list, ",");
        uint32_t before = mask;
        if (same_word(list, length, "files")) {
            mask |= files;
        } else if (same_word(list, length, "memory")) {
            mask |= ((1U << MEMORY_FUNCTIONS) - 1) & ~files;
        } else if (same_word(list, length, "system")) {
            mask |= ((1U << PREAD) - 1) & ~((1U << MEMORY_FUNCTIONS) - 1);
        }
        for (unsigned i = 0; i < FUNCTION_COUNT; i++) {
            mask |= same_word(list, length, FUNCTIONS[i]) ? 1U << i : 0;
        }
        if (mask == before) {
            fault_refuse("UMBRAGE_FAULT_CALLS");
        }
        list += length;
        list += *list == ',';
    }
    return mask;
}

static int action_of(const char *name)
{
    for (size_t i = 0; i < sizeof ERRORS / sizeof ERRORS[0]; i++) {
        if (strcmp(name, ERRORS[i].name) == 0) {
            return ERRORS[i].value;
        }
    }
    if (strcmp(name, "short") == 0) {
        return SHORTEN;
    }
    if (strcmp(name, "kill") == 0) {
        return KILL;
    }
    if (strcmp(name, "tear") != 0) {
        fault_refuse("UMBRAGE_FAULT_ACTION");
    }
    return TEAR;
}

static void copy_path(char to[PATH_MAX], const char *variable)
{
    const char *value = getenv(variable);
    size_t length = value != NULL ? strlen(value) : 0;
    if (length >= PATH_MAX || (length > 0 && value[0] != '/')) {
        fault_refuse(variable);
    }
    if (length > 0) {
        memcpy(to, value, length);
    }
    to[length] = '\0';
}

static void open_board(const char *path)
{
    long fd = syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd < 0 || syscall(SYS_ftruncate, fd, (off_t)BOARD_BYTES) != 0) {
        fault_refuse("UMBRAGE_FAULT_BOARD");
    }
    long at = syscall(SYS_mmap, NULL, (size_t)BOARD_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, fd,
                      (off_t)0);
    if (at == -1) {
        fault_refuse("UMBRAGE_FAULT_BOARD");
    }
    board = (struct board *)at; /* NOLINT: the system call's result is an address */
    (void)syscall(SYS_close, fd);
}

__attribute__((constructor)) static void read_environment(void)
{
    _Static_assert(sizeof(struct board) <= BOARD_BYTES, "the board fits its file");
    const char *calls = getenv("UMBRAGE_FAULT_CALLS");
    const char *what = getenv("UMBRAGE_FAULT_ACTION");
    const char *at = getenv("UMBRAGE_FAULT_AT");
    const char *keep = getenv("UMBRAGE_FAULT_KEEP");
    const char *path = getenv("UMBRAGE_FAULT_BOARD");
    copy_path(under, "UMBRAGE_FAULT_UNDER");
    under_length = strlen(under);
    if (calls == NULL) {
        return;
    }
    if (path != NULL) {
        open_board(path);
    }
    copy_path(trace_path, "UMBRAGE_FAULT_TRACE");
    action = what != NULL ? action_of(what) : EIO;
    if (at != NULL && atomic_load(&board->first) == 0) {
        uint64_t first = strtoull(at, NULL, 10);
        atomic_store(&board->last, keep != NULL && keep[0] == '1' ? UINT64_MAX : first);
        atomic_store(&board->first, first);
    }
    chosen = functions_of(calls);
}

/* ---- the decision ---- */

_Noreturn void fault_die(void)
{
    (void)syscall(SYS_kill, syscall(SYS_getpid), SIGKILL);
    for (;;) { /* SIGKILL of oneself is delivered before the call returns; never go on */
        (void)syscall(SYS_getpid);
    }
}

/* Counts one call. Returns GO_ON, SHORTEN, TEAR or an errno. Ends the process for KILL. */
static int decide(enum function function, uint64_t *number)
{
    uint64_t n = atomic_fetch_add(&board->calls, 1) + 1;
    uint64_t first = atomic_load(&board->first);
    *number = n;
    atomic_fetch_add(&board->of[function], 1);
    if (first == 0 || n < first || n > atomic_load(&board->last)) {
        return GO_ON;
    }
    atomic_fetch_add(&board->faults, 1);
    if (action == KILL) {
        fault_die();
    }
    return action;
}

static int is_chosen(enum function function)
{
    return (chosen >> function & 1U) != 0 && atomic_load(&running) != 0;
}

/* ---- which file ---- */

static size_t append(char *line, size_t used, size_t size, const char *text)
{
    while (*text != '\0' && used + 1 < size) {
        line[used++] = *text++;
    }
    line[used] = '\0';
    return used;
}

static size_t append_number(char *line, size_t used, size_t size, uint64_t value)
{
    char digits[24];
    size_t at = sizeof digits - 1;
    digits[at] = '\0';
    do {
        digits[--at] = (char)('0' + value % 10);
        value /= 10;
    } while (value > 0);
    return append(line, used, size, digits + at);
}

static void path_of_fd(int fd, char path[PATH_MAX])
{
    char name[48];
    path[0] = '\0';
    if (fd < 0) {
        return;
    }
    size_t used = append(name, 0, sizeof name, "/proc/self/fd/");
    append_number(name, used, sizeof name, (uint64_t)fd);
    long length = syscall(SYS_readlinkat, AT_FDCWD, name, path, (size_t)PATH_MAX - 1);
    path[length > 0 ? length : 0] = '\0';
}

void fault_path_below(int at, const char *path, char out[PATH_MAX])
{
    size_t used = 0;
    out[0] = '\0';
    if (path[0] != '/') {
        if (at == AT_FDCWD) {
            long length = syscall(SYS_getcwd, out, (size_t)PATH_MAX);
            out[length > 0 ? length - 1 : 0] = '\0';
        } else {
            path_of_fd(at, out);
        }
        used = append(out, strlen(out), PATH_MAX, "/");
    }
    append(out, used, PATH_MAX, path);
}

int fault_is_under(const char *path)
{
    return strncmp(path, under, under_length) == 0 &&
           (under_length == 0 || path[under_length] == '/' || path[under_length] == '\0');
}

static void weigh(struct call *call, enum function function)
{
    call->function = function;
    call->verdict = GO_ON;
    call->counted = fault_is_under(call->path);
    if (call->counted) {
        call->verdict = decide(function, &call->number);
    }
}

void fault_weigh_fd(struct call *call, enum function function, int fd)
{
    call->counted = 0;
    call->verdict = GO_ON;
    if (is_chosen(function)) {
        path_of_fd(fd, call->path);
        weigh(call, function);
    }
}

void fault_weigh_path(struct call *call, enum function function, int at, const char *path)
{
    call->counted = 0;
    call->verdict = GO_ON;
    if (is_chosen(function)) {
        fault_path_below(at, path, call->path);
        weigh(call, function);
    }
}

static void trace(const struct call *call, int failed)
{
    char line[PATH_MAX + 96];
    if (!call->counted || trace_path[0] == '\0') {
        return;
    }
    size_t used = append_number(line, 0, sizeof line, (uint64_t)syscall(SYS_getpid));
    used = append(line, used, sizeof line, " ");
    used = append_number(line, used, sizeof line, call->number);
    used = append(line, used, sizeof line, " ");
    used = append(line, used, sizeof line, FUNCTIONS[call->function]);
    used = append(line, used, sizeof line, failed ? " failed " : " ok ");
    used = append(line, used, sizeof line - 1, call->path);
    used = append(line, used, sizeof line, "\n");
    int saved = errno;
    long fd =
        syscall(SYS_openat, AT_FDCWD, trace_path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    if (fd >= 0) {
        (void)!syscall(SYS_write, fd, line, used);
        (void)syscall(SYS_close, fd);
    }
    errno = saved;
}

/* Fails the call if that was decided: returns 1 and sets errno. A torn call that writes nothing is
 * a kill. */
int fault_fails(const struct call *call)
{
    if (call->verdict == TEAR) {
        fault_die();
    }
    if (call->verdict <= GO_ON) {
        return 0;
    }
    trace(call, 1);
    errno = call->verdict;
    return 1;
}

long fault_done(const struct call *call, long result)
{
    trace(call, result == -1);
    return result;
}

int fault_memory(enum function function)
{
    uint64_t number;
    if (!is_chosen(function) || decide(function, &number) == GO_ON) {
        return 0;
    }
    errno = ENOMEM;
    return 1;
}

int fault_system(enum function function)
{
    uint64_t number;
    const int verdict = is_chosen(function) ? decide(function, &number) : GO_ON;
    if (verdict <= GO_ON) {
        return 0;
    }
    errno = verdict;
    return 1;
}

void fault_begin(void)
{
    atomic_store(&running, 1);
}

int fault_wanted(void)
{
    return chosen != 0;
}
