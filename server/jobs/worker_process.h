/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_WORKER_PROCESS_H
#define UMBRAGE_SERVER_JOBS_WORKER_PROCESS_H
/*
 * A bake's process as the daemon sees it: a process group of its own with limits. It dies with the
 * thread that started it, is killed as a group, and is always reaped. Its lines on two pipes are
 * passed to callbacks. Linux only.
 */
#include "jobs/executor.h"

#define UMBJ_WORKER_FD_PROGRESS 3 /* in the child: see umbrage-bake --progress-fd */

struct umbj_process {
    const char *program;
    char *const *arguments;    /* NULL-terminated, program first */
    const char *folder;        /* to run in */
    uint64_t max_output_bytes; /* limit of each file that it writes */
    uint64_t timeout_ms;       /* wall clock */
    int stop; /* descriptor that becomes readable when it shall end: SIGTERM, soon SIGKILL */
    /* Lines, without their end, cut at UMBJ_CAUSE_SIZE - 1 bytes. */
    void (*said)(void *user, const char *line);     /* on stderr */
    void (*progress)(void *user, const char *line); /* on UMBJ_WORKER_FD_PROGRESS */
    void *user;
};

struct umbj_process_end {
    int exit_code; /* or -1 */
    int signal;    /* or 0 */
    int timed_out, stopped;
};

/* Runs the process to its end. Fails: E_LIMIT (no process, no pipe). */
UMB_CHECKED enum umb_status umbj_process_run(const struct umbj_process *process,
                                             struct umbj_process_end *end, struct umb_error *error);

/* Classifies an end. */
enum umbj_failure umbj_process_judge(const struct umbj_process_end *end);

#endif
