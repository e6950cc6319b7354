/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Starts, limits, watches and reaps the importer (scene_process.h).
 *
 * Between fork and exec only async-signal-safe calls are made, because the caller may have many
 * threads; everything they need is prepared before. The wait ends for certain: the loop's only
 * condition is the process's own end, and at the deadline the whole process group is killed.
 * Sources: fork(2), prctl(2), signal-safety(7).
 */
#define _GNU_SOURCE /* pipe2 */
#include "scene/scene_process.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "common/child_process.h"
#include "tool/clock.h"
#include "scene/scene_broker.h"
#include "scene/scene_contract.h"
#include "common/clean_text.h"

/* Limit of the importer's descriptors: input, output, one file of the scene at a time, and some
 * that sanitizers open. */
#define CHILD_FDS_MAX 32U
/* Longest delay in milliseconds until the end of a child is noticed, if another process still holds
 * its pipe. */
#define POLL_STEP_MS 50

/* Pipes and sockets between the importer and its parent; [0] is the parent's end. */
struct lines {
    int talk[2];  /* pipe for the importer's one message */
    int files[2]; /* socket of scene_broker.h */
};

_Static_assert(UMBS_CHILD_FD_INPUT == 3 && UMBS_CHILD_FD_FILES == 4 && UMBS_CHILD_FD_OUTPUT == 5,
               "as become_program lays them out");

/* In the child: never returns. */
static void become_program(const struct umbs_process *process, char *const *environment,
                           const struct lines *lines, pid_t parent)
{
    const uint64_t seconds = process->timeout_s, bytes = process->max_output_bytes;
    int sources[] = {-1, -1, lines->talk[1], process->input, lines->files[1], process->output};
    if (umbs_child_own_group(parent) != 0 || prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        umbs_child_lay_out(sources, sizeof sources / sizeof sources[0]) != 0 ||
        umbs_child_limit(RLIMIT_CORE, 0, 0) != 0 ||
        umbs_child_limit(RLIMIT_CPU, seconds, seconds + 1) != 0 ||
        umbs_child_limit(RLIMIT_FSIZE, bytes, bytes) != 0 ||
        umbs_child_limit(RLIMIT_NOFILE, CHILD_FDS_MAX, CHILD_FDS_MAX) != 0 ||
        umbs_child_reset_signals() != 0) {
        _exit(UMBS_PROCESS_EXIT_NOT_STARTED);
    }
    execve(process->program, process->arguments, environment);
    _exit(UMBS_PROCESS_EXIT_NOT_STARTED);
}

/* Reads all available bytes; keeps the first and drops the rest. Returns 0 at the end of the
 * pipe. */
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

/* A child being watched. */
struct watched {
    const struct umbs_process *process;
    struct lines *lines;
    struct umbs_process_end *end;
    size_t talked;       /* number of bytes in end->talk */
    uint32_t files_left; /* number of files that the child may still ask for */
};

/* Waits a moment for messages or requests, and handles them. */
static void attend(struct watched *watched, int64_t left_ms)
{
    struct lines *lines = watched->lines;
    struct umbs_process_end *end = watched->end;
    struct pollfd wanted[2] = {{.fd = lines->talk[0], .events = POLLIN},
                               {.fd = lines->files[0], .events = POLLIN}};
    /* Both ends are closed: the importer is about to end. poll ignores -1. */
    int step_ms = lines->talk[0] < 0 && lines->files[0] < 0 ? 1 : POLL_STEP_MS;
    (void)poll(wanted, 2, left_ms < step_ms ? (int)left_ms : step_ms);
    if (wanted[0].revents != 0 &&
        !drain(lines->talk[0], end->talk, sizeof(end->talk), &watched->talked)) {
        umbs_hang_up(&lines->talk[0]);
    }
    int served = 1;
    if (wanted[1].revents != 0) {
        served = umbs_broker_serve(lines->files[0], watched->process->folder, &watched->files_left);
    }
    if (served <= 0) {
        umbs_hang_up(&lines->files[0]);
    }
    end->asked_too_often |= served < 0;
}

/* Waits for the end of the child; kills it at a limit. Returns 1 if the child's status was read. */
static int watch(pid_t child, struct lines *lines, const struct umbs_process *process,
                 struct umbs_process_end *end)
{
    char talk[UMBS_PROCESS_TALK_BYTES];
    int64_t deadline_ms = umbu_clock_ms() + (int64_t)process->timeout_s * 1000;
    struct watched watched = {process, lines, end, 0, process->max_files};
    while (!umbs_child_has_ended(child)) {
        int64_t left_ms = deadline_ms - umbu_clock_ms();
        end->timed_out = left_ms <= 0;
        if (end->timed_out || end->asked_too_often) {
            (void)kill(child, SIGKILL); /* it may have no group yet */
            break;
        }
        attend(&watched, left_ms);
    }
    const int known = umbs_child_reap(child, &end->exit_code, &end->signal);
    if (lines->talk[0] >= 0) {
        (void)drain(lines->talk[0], end->talk, sizeof(end->talk), &watched.talked);
    }
    const char *newline = memchr(end->talk, '\n', watched.talked);
    size_t length = newline != NULL ? (size_t)(newline - end->talk) : watched.talked;
    memcpy(talk, end->talk, length);
    umbs_text_clean(end->talk, sizeof(end->talk), talk, length);
    return known;
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
        umbs_hang_up(&lines->talk[i]);
        umbs_hang_up(&lines->files[i]);
    }
}

static enum umb_status run(const struct umbs_process *process, struct lines *lines,
                           struct umbs_process_end *end, struct umb_error *error)
{
    char *environment[UMBS_CHILD_ENVIRONMENT_MAX];
    umbs_child_environment(environment);
    pid_t parent = getpid();
    pid_t child = fork();
    if (child == 0) {
        become_program(process, environment, lines, parent);
    }
    if (child < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot start a process for the importer");
    }
    umbs_hang_up(&lines->talk[1]);
    umbs_hang_up(&lines->files[1]);
    const struct umbs_importer importer = {.process = child, .files = lines->files[0]};
    const enum umb_status status =
        process->shut_in != NULL ? process->shut_in(process->user, &importer, error) : UMB_OK;
    if (status != UMB_OK) {
        (void)kill(child, SIGKILL); /* it may have no group yet */
        (void)umbs_child_reap(child, &end->exit_code, &end->signal);
        return status;
    }
    if (!watch(child, lines, process, end)) {
        return umb_fail(error, UMB_E_INTERNAL,
                        "the importer's exit status is lost (SIGCHLD is ignored here?)");
    }
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
