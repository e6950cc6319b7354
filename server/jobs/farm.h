/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_FARM_H
#define UMBRAGE_SERVER_JOBS_FARM_H
/*
 * A farm that runs commands elsewhere, behind five calls: submit an array of tasks, submit one (the
 * merge), status, cancel, reconcile. Slurm is one (slurm_farm.h).
 *
 * It is believed in nothing but what helps: a task has ended when its end lies in the folder of its
 * stage, which all machines share, as a file that the task's own script gave its name:
 *
 *     done.NUMBER                   what the command said
 *     fail.NUMBER.CODE.SERIAL       the same; CODE: exit code as a shell has it, over 128 a signal
 *
 * What the farm says of tasks tells only which of them will not come any more (farm_bake.c). Tasks
 * may run twice or be lost after they were accepted; they end by themselves once their stage's
 * folder is gone, whoever was killed.
 *
 * Threads: all calls from any thread at any time.
 */
#include <stdint.h>
#include "umbrage/status.h"

#define UMBJ_TASKS_MAX 100000 /* of one stage */

/* Tasks of one kind of one try. All borrowed during calls. */
struct umbj_farm_stage {
    const char *name;          /* JOB.EPOCH.KIND: letters, digits and dots */
    const char *folder;        /* absolute, for the ends; in the try's folder */
    char *const *words;        /* the command, NULL-terminated */
    unsigned threads;          /* that it has */
    uint32_t count;            /* of tasks */
    uint64_t max_output_bytes; /* of a file that a task writes */
    int stop; /* descriptor that becomes readable when calls for the stage shall end soon; -1: none
               */
};

/* What a farm says of a task. */
enum umbj_task_state {
    UMBJ_TASK_UNKNOWN = 0,
    UMBJ_TASK_WAITS,
    UMBJ_TASK_RUNS,
};

struct umbj_farm {
    /* Has tasks run: those with wanted[number] != 0, each as the command with --only=NUMBER behind
     * it; clears wanted[number] of those that the farm took, also on failure. Fails: E_UNAVAILABLE
     * with what the farm said, or that it was stopped: some that are still wanted may have been
     * submitted all the same; status tells. */
    enum umb_status (*submit_array)(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                                    uint8_t *wanted, struct umb_error *error);
    /* Has the command run once, as it is: task 0. Fails: as submit_array. */
    enum umb_status (*submit_merge)(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                                    struct umb_error *error);
    /* Sets known[number] to the state of each task, enum umbj_task_state; lets start at once what
     * is only held back. Fails: E_UNAVAILABLE: nothing is known. */
    enum umb_status (*status)(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                              uint8_t *known, struct umb_error *error);
    /* Ends all tasks of a try (JOB.EPOCH), if the farm can be reached within seconds: it is called
     * when everything shall end. */
    void (*cancel)(struct umbj_farm *self, const char *name);
    /* Ends tasks of tries whose folders in `work` are gone: those of a daemon that was killed.
     * stop: as a stage's. Fails: E_UNAVAILABLE: some may be left. */
    enum umb_status (*reconcile)(struct umbj_farm *self, const char *work, int stop,
                                 struct umb_error *error);
    void (*destroy)(struct umbj_farm *self);
};

#endif
