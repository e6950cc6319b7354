/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_WORKER_PROCESS_H
#define UMBRAGE_SERVER_JOBS_WORKER_PROCESS_H
/*
 * Programs that the daemon runs: their command lines, and their processes.
 *
 *     struct umbj_words words = {0};
 *     umbj_words_add(&words, "%s", program);
 *     umbj_words_add_settings(&words, settings, tile);
 *     umbj_process_run(&process, &words, &end, &error);
 *
 * A command line is built word by word; no shell ever splits it. Each process has limits and a
 * process group. It dies with the thread that started it, is killed with its group, and is always
 * reaped. The lines that it writes to two pipes are passed to callbacks. Linux only.
 */
#include "jobs/executor.h"

#define UMBJ_WORKER_FD_PROGRESS 3 /* descriptor in the child: umbrage-bake --progress-fd */

struct umbj_words {
    char **list; /* [count], then NULL; heap */
    size_t count;
    int failed; /* 1 = out of memory: words are missing */
};

/* Adds one word, formatted as by printf. */
void umbj_words_add(struct umbj_words *words, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Adds words as they are; NULL ends the list. */
void umbj_words_add_all(struct umbj_words *words, ...) __attribute__((sentinel));

/* Adds --sandbox=MODE; every umbrage-bake of a job needs it. mode: NULL = required. */
void umbj_words_add_sandbox(struct umbj_words *words, const char *mode);

/* Adds a job's settings, lines of --name=value, and after them --tile=N. N is the given number of
 * texels, or the map's resolution if that is smaller. tile: 0 = add no --tile. */
void umbj_words_add_settings(struct umbj_words *words, const char *settings, uint32_t tile);

/* Returns the texels along the side of a tile, as umbj_words_add_settings chooses them; with
 * --max-error an upper bound. */
unsigned long umbj_tile_edge(const char *settings, uint32_t tile);

void umbj_words_finish(struct umbj_words *words);

/* 1 if one of the lines equals `wanted`. */
int umbj_settings_have(const char *settings, const char *wanted);

struct umbj_process {
    const char *folder;        /* Working folder */
    uint64_t max_output_bytes; /* Limit of each file that it writes */
    uint64_t timeout_ms;       /* Limit of its wall-clock time */
    int stop; /* Descriptor that becomes readable when the process must end: it then gets SIGTERM,
                 and soon SIGKILL */
    /* Callbacks for the process's lines, without line ends, cut at UMBJ_CAUSE_SIZE - 1 bytes. */
    void (*said)(void *user, const char *line);     /* on stderr */
    void (*progress)(void *user, const char *line); /* on UMBJ_WORKER_FD_PROGRESS */
    void *user;
};

struct umbj_process_end {
    int exit_code; /* Exit code, or -1 */
    int signal;    /* Number of the signal that ended it, or 0 */
    int timed_out, stopped;
};

/* Runs a command to its end: the program's absolute path, then its arguments. Finishes words.
 * Fails: E_LIMIT (no process, no pipe), E_NO_MEMORY (words are missing). */
UMB_CHECKED enum umb_status umbj_process_run(const struct umbj_process *process,
                                             struct umbj_words *words, struct umbj_process_end *end,
                                             struct umb_error *error);

/* Classifies an end. */
enum umbj_failure umbj_process_judge(const struct umbj_process_end *end);

#endif
