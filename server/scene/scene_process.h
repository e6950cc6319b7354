/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_PROCESS_H
#define UMBRAGE_SERVER_SCENE_SCENE_PROCESS_H
/*
 * The importer's process as its parent sees it: started with limits, watched, always reaped. Linux
 * only.
 *
 * The parent sets the limits before the program starts, so that no bug of the importer can skip
 * them: CPU seconds, size of a written file, descriptors, no core, death with the parent's thread,
 * no new privileges, an own process group, only the agreed descriptors, a near-empty environment.
 * One limit is left to the importer, as its first action: the address space. A sanitizer build
 * cannot run under such a limit, and only the importer knows how it was built.
 */
#include <stdint.h>
#include "scene/scene.h"

#define UMBS_PROCESS_TALK_BYTES 1024

struct umbs_process {
    const char *program;
    char *const *arguments;    /* NULL-terminated, program first */
    int input, output;         /* descriptors that become UMBS_CHILD_FD_*; they stay open here */
    int folder;                /* folder of the files that the process may ask for */
    uint32_t max_files;        /* limit of requests for files */
    uint32_t timeout_s;        /* limit of CPU seconds and of wall seconds */
    uint64_t max_output_bytes; /* limit of each file that the process writes */
    /* Hook of struct umbs_import_options; may be NULL. */
    enum umb_status (*shut_in)(void *user, const struct umbs_importer *importer,
                               struct umb_error *error);
    void *user;
};

/* Outcome of a process. */
struct umbs_process_end {
    int timed_out;       /* 1: killed at the wall-clock limit */
    int asked_too_often; /* 1: killed because it asked for more than max_files files */
    int exit_code;       /* 0..255; -1: a signal ended the process */
    int signal;          /* signal that ended the process, or 0 */
    char talk[UMBS_PROCESS_TALK_BYTES]; /* first line of its stderr, as clean text */
};

#define UMBS_PROCESS_EXIT_NOT_STARTED 127

/*
 * Runs the program and waits for its end.
 *
 * Fails: E_UNAVAILABLE (program missing or not executable), E_IO (no process, no pipe), a failure
 *        of shut_in. Every other outcome is in `end`.
 * Cost:  blocks up to the time limit. No process is left behind.
 */
UMB_CHECKED enum umb_status umbs_process_run(const struct umbs_process *process,
                                             struct umbs_process_end *end, struct umb_error *error);

#endif
