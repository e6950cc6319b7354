/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Starts, limits, watches and reaps the importer (scene_process.h).
 *
 * Between fork and exec only async-signal-safe calls are made, because the caller may have many
 * threads; everything they need is prepared before. The wait ends for certain: the loop's only
 * condition is the process's own end, and at the deadline the whole process group is killed.
 * Sources: fork(2), prctl(2), memfd_create(2), signal-safety(7).
 */
#define _GNU_SOURCE /* close_range, memfd_create, pipe2, O_PATH, F_ADD_SEALS */
#include "common/scene_process.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "common/scene_broker.h"
#include "common/scene_contract.h"
#include "common/scene_text.h"

#define CHILD_FDS_MAX   32U /* input, output, one sibling at a time, sanitizer's own */
#define CHILD_FD_SPARE  10  /* descriptors are parked from here up while 0..5 are laid out */
#define POLL_STEP_MS    50  /* how late the end of a child is noticed whose pipe somebody holds */
#define ENVIRONMENT_MAX 8

/* What connects it with its parent; each [0] is the parent's end. */
struct lines {
    int talk[2];  /* a pipe: its one sentence */
    int files[2]; /* scene_broker.h */
};

static int64_t now_ms(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

static int limit(int resource, uint64_t soft, uint64_t hard)
{
    struct rlimit value;
    if (getrlimit((__rlimit_resource_t)resource, &value) != 0) {
        return -1;
    }
    /* Never above what we have ourselves: raising a hard limit would fail. */
    if (value.rlim_max != RLIM_INFINITY && hard > value.rlim_max) {
        hard = value.rlim_max;
    }
    value.rlim_cur = soft < hard ? soft : hard;
    value.rlim_max = hard;
    return setrlimit((__rlimit_resource_t)resource, &value);
}

/* In the child: signals as a fresh program expects them. */
static int reset_signals(void)
{
    struct sigaction action = {.sa_handler = SIG_DFL};
    sigset_t none;
    sigemptyset(&action.sa_mask);
    sigemptyset(&none);
    for (int number = 1; number < 32; number++) {
        if (number != SIGKILL && number != SIGSTOP) {
            (void)sigaction(number, &action, NULL);
        }
    }
    return sigprocmask(SIG_SETMASK, &none, NULL);
}

/* In the child: descriptors 0..5 as agreed, all others closed. The sources are parked out of the
 * way first: a parent without standard streams has them among 0..5. */
static int lay_out_descriptors(const struct umbs_process *process, const struct lines *lines)
{
    int sources[6] = {-1, -1, lines->talk[1], process->input, lines->files[1], process->output};
    static const int targets[6] = {
        0, 1, 2, UMBS_CHILD_FD_INPUT, UMBS_CHILD_FD_FILES, UMBS_CHILD_FD_OUTPUT};
    sources[0] = sources[1] = open("/dev/null", O_RDWR | O_CLOEXEC);
    for (int i = 0; i < 6; i++) {
        sources[i] = fcntl(sources[i], F_DUPFD, CHILD_FD_SPARE);
        if (sources[i] < 0) {
            return -1;
        }
    }
    for (int i = 0; i < 6; i++) {
        if (dup2(sources[i], targets[i]) < 0) {
            return -1;
        }
    }
    return close_range(UMBS_CHILD_FD_OUTPUT + 1, ~0U, 0);
}

/* In the child: never returns. */
static void become_program(const struct umbs_process *process, char *const *environment,
                           const struct lines *lines, pid_t parent)
{
    uint64_t seconds = process->timeout_s;
    if (setpgid(0, 0) != 0 || prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0) != 0 ||
        getppid() != parent || /* the parent died before the line above */
        prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || lay_out_descriptors(process, lines) != 0 ||
        limit(RLIMIT_CORE, 0, 0) != 0 || limit(RLIMIT_CPU, seconds, seconds + 1) != 0 ||
        limit(RLIMIT_FSIZE, process->max_output_bytes, process->max_output_bytes) != 0 ||
        limit(RLIMIT_NOFILE, CHILD_FDS_MAX, CHILD_FDS_MAX) != 0 || reset_signals() != 0) {
        _exit(UMBS_PROCESS_EXIT_NOT_STARTED);
    }
    execve(process->program, process->arguments, environment);
    _exit(UMBS_PROCESS_EXIT_NOT_STARTED);
}

/* The few variables that the importer may see: where libraries are, how a sanitizer behaves. */
static void choose_environment(char *chosen[ENVIRONMENT_MAX])
{
    static const char *const allowed[] = {
        "LD_LIBRARY_PATH=", "ASAN_OPTIONS=", "UBSAN_OPTIONS=", "LSAN_OPTIONS=", "TSAN_OPTIONS="};
    static char locale[] = "LC_ALL=C";
    size_t count = 0;
    chosen[count++] = locale;
    for (char **entry = environ; entry != NULL && *entry != NULL; entry++) {
        for (size_t i = 0; i < sizeof(allowed) / sizeof(allowed[0]); i++) {
            if (count < ENVIRONMENT_MAX - 1 &&
                strncmp(*entry, allowed[i], strlen(allowed[i])) == 0) {
                chosen[count++] = *entry;
            }
        }
    }
    chosen[count] = NULL;
}

/* Reads what there is; keeps the first bytes, drops the rest. Returns 0 at the end of the pipe. */
static int drain(int pipe_end, char *talk, size_t size, size_t *used)
{
    char chunk[1024];
    for (;;) {
        ssize_t got = read(pipe_end, chunk, sizeof(chunk));
        if (got < 0 && errno == EINTR) {
            continue;
        }
        if (got < 0) {
            return errno == EAGAIN;
        }
        if (got == 0) {
            return 0;
        }
        size_t room = size - *used;
        size_t count = (size_t)got < room ? (size_t)got : room;
        memcpy(talk + *used, chunk, count);
        *used += count;
    }
}

static void hang_up(int *fd)
{
    if (*fd >= 0) {
        (void)close(*fd);
    }
    *fd = -1;
}

/* Leaves it a zombie, so that its number, which is its group's too, cannot be another's yet. */
static int has_ended(pid_t child)
{
    siginfo_t facts = {0};
    int code = waitid(P_PID, (id_t)child, &facts, WEXITED | WNOHANG | WNOWAIT);
    return code == 0 ? facts.si_pid == child : errno != EINTR;
}

/* Waits a moment for words or requests, and takes them. */
static void attend(struct lines *lines, int folder, struct umbs_process_end *end, size_t *used,
                   int64_t left_ms)
{
    struct pollfd wanted[2] = {{.fd = lines->talk[0], .events = POLLIN},
                               {.fd = lines->files[0], .events = POLLIN}};
    /* Both closed: it is about to end. poll passes over -1. */
    int step_ms = lines->talk[0] < 0 && lines->files[0] < 0 ? 1 : POLL_STEP_MS;
    (void)poll(wanted, 2, left_ms < step_ms ? (int)left_ms : step_ms);
    if (wanted[0].revents != 0 && !drain(lines->talk[0], end->talk, sizeof(end->talk), used)) {
        hang_up(&lines->talk[0]);
    }
    if (wanted[1].revents != 0 && !umbs_broker_serve(lines->files[0], folder)) {
        hang_up(&lines->files[0]);
    }
}

/* Waits for the end of the child; kills it at the deadline. Returns 1 if its status was taken. */
static int watch(pid_t child, struct lines *lines, const struct umbs_process *process,
                 struct umbs_process_end *end, int *wait_status)
{
    char talk[UMBS_PROCESS_TALK_BYTES];
    int64_t deadline_ms = now_ms() + (int64_t)process->timeout_s * 1000;
    size_t used = 0;
    pid_t ended;
    while (!has_ended(child)) {
        int64_t left_ms = deadline_ms - now_ms();
        if (left_ms <= 0) {
            end->timed_out = 1;
            (void)kill(child, SIGKILL); /* it may have no group yet */
            break;
        }
        attend(lines, process->folder, end, &used, left_ms);
    }
    (void)kill(-child, SIGKILL); /* it, and whatever it may have started */
    do {
        ended = waitpid(child, wait_status, 0);
    } while (ended < 0 && errno == EINTR);
    if (lines->talk[0] >= 0) {
        (void)drain(lines->talk[0], end->talk, sizeof(end->talk), &used);
    }
    const char *newline = memchr(end->talk, '\n', used);
    size_t length = newline != NULL ? (size_t)(newline - end->talk) : used;
    memcpy(talk, end->talk, length);
    umbs_text_clean(end->talk, sizeof(end->talk), talk, length);
    return ended == child;
}

static enum umb_status open_lines(struct lines *lines, struct umb_error *error)
{
    *lines = (struct lines){{-1, -1}, {-1, -1}};
    if (pipe2(lines->talk, O_CLOEXEC) != 0 || umbs_broker_pair(lines->files) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot make a pipe for the importer");
    }
    (void)fcntl(lines->talk[0], F_SETFL, O_NONBLOCK);
    return UMB_OK;
}

static void close_lines(struct lines *lines)
{
    for (int i = 0; i < 2; i++) {
        hang_up(&lines->talk[i]);
        hang_up(&lines->files[i]);
    }
}

static enum umb_status run(const struct umbs_process *process, struct lines *lines,
                           struct umbs_process_end *end, struct umb_error *error)
{
    char *environment[ENVIRONMENT_MAX];
    choose_environment(environment);
    pid_t parent = getpid();
    pid_t child = fork();
    if (child == 0) {
        become_program(process, environment, lines, parent);
    }
    if (child < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot start a process for the importer");
    }
    hang_up(&lines->talk[1]);
    hang_up(&lines->files[1]);
    int wait_status = 0;
    if (!watch(child, lines, process, end, &wait_status)) {
        return umb_fail(error, UMB_E_INTERNAL,
                        "the importer's exit status is lost (SIGCHLD is ignored here?)");
    }
    end->exit_code = WIFEXITED(wait_status) ? WEXITSTATUS(wait_status) : -1;
    end->signal = WIFSIGNALED(wait_status) ? WTERMSIG(wait_status) : 0;
    return UMB_OK;
}

enum umb_status umbs_process_run(const struct umbs_process *process, struct umbs_process_end *end,
                                 struct umb_error *error)
{
    struct lines lines;
    memset(end, 0, sizeof(*end));
    if (access(process->program, X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "importer program '%s'",
                              process->program);
    }
    enum umb_status status = open_lines(&lines, error);
    if (status == UMB_OK) {
        status = run(process, &lines, end, error);
    }
    close_lines(&lines);
    return status;
}

enum umb_status umbs_memfd_create(int *fd, struct umb_error *error)
{
    *fd = memfd_create("umbrage-scene", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (*fd < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot make a memory file for the scene");
    }
    return UMB_OK;
}

enum umb_status umbs_memfd_seal(int fd, struct umb_error *error)
{
    if (fcntl(fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot seal the scene buffer");
    }
    return UMB_OK;
}

enum umb_status umbs_folder_open(const char *path, int *fd, struct umb_error *error)
{
    *fd = open(path, O_PATH | O_DIRECTORY | O_CLOEXEC);
    if (*fd < 0) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "folder '%s'", path);
    }
    return UMB_OK;
}
