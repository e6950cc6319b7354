/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_PROCESS_H
#define UMBRAGE_SERVER_SCENE_SCENE_PROCESS_H
/*
 * The importer's process as its parent sees it: started with limits, watched, always reaped. Linux
 * only.
 *
 * The parent sets limits before the program starts, so that no bug of the importer can skip them:
 * CPU seconds, size of a written file, descriptors, no core, death with the parent's thread, no new
 * privileges, its own process group, only the agreed descriptors, a near-empty environment. The
 * importer itself sets the limit of its address space as its first action: only it knows whether it
 * is a sanitizer build, which cannot run under such a limit.
 */
#include <stdint.h>
#include "scene/scene.h"

#define UMBS_PROCESS_TALK_BYTES 1024

struct umbs_process {
    const char *program;
    char *const *arguments;    /* NULL-terminated, program first */
    int input, output;         /* become UMBS_CHILD_FD_*; stay open here */
    int folder;                /* folder of the files that it may ask for (scene_broker.h) */
    uint32_t max_files;        /* Number of times that it may ask for a file */
    uint32_t timeout_s;        /* CPU seconds, and wall seconds */
    uint64_t max_output_bytes; /* limit of each file that it writes */
    /* Hook of struct umbs_import_options; may be NULL. */
    enum umb_status (*shut_in)(void *user, const struct umbs_importer *importer,
                               struct umb_error *error);
    void *user;
};

/* Outcome of a process. */
struct umbs_process_end {
    int timed_out;       /* it was killed at the wall-clock limit */
    int asked_too_often; /* it was killed because it asked more than max_files times */
    int exit_code;       /* 0..255, or -1 if a signal ended it */
    int signal;          /* or 0 */
    char talk[UMBS_PROCESS_TALK_BYTES]; /* first line it wrote to stderr, clean text */
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
