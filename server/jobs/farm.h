/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_FARM_H
#define UMBRAGE_SERVER_JOBS_FARM_H
/*
 * A farm runs commands on other machines. Its interface has four calls: submit, status, cancel,
 * reconcile. Slurm is a farm (slurm_farm.c).
 *
 * The farm's answers are not trusted. The tasks of one command are a stage. A task has ended when
 * its end file is in the stage's folder, which all machines share. The task's own script gives that
 * file its name:
 *
 *     done.NUMBER                   output of the command
 *     fail.NUMBER.CODE.SERIAL       the same; CODE: exit code as a shell has it, over 128 a signal
 *
 * The farm's status only tells which tasks will never end (farm_bake.c). A farm may run a task
 * twice, or lose a task that it accepted. A task ends by itself once its stage's folder is gone,
 * even if the daemon was killed.
 *
 * Threads: all calls from any thread at any time.
 */
#include <stdint.h>
#include "umbrage/status.h"

#define UMBJ_TASKS_MAX 100000 /* most tasks of one stage */

/* Tasks of one kind of one try. All pointers are borrowed during calls. */
struct umbj_farm_stage {
    const char *name;          /* JOB.EPOCH.KIND: letters, digits and dots */
    const char *folder;        /* absolute path of the end files' folder; in the try's folder */
    char *const *words;        /* the command, NULL-terminated */
    unsigned threads;          /* threads of the command */
    uint32_t count;            /* number of tasks */
    uint64_t max_output_bytes; /* limit of a file that a task writes */
    int stop; /* Descriptor that becomes readable when calls for the stage must end soon; -1:
                 none */
};

/* A farm's state of a task. */
enum umbj_task_state {
    UMBJ_TASK_UNKNOWN = 0,
    UMBJ_TASK_WAITS,
    UMBJ_TASK_RUNS,
};

struct umbj_farm {
    /* Submits tasks: those with wanted[number] != 0, each as the command with --only=NUMBER
     * appended. wanted: NULL = the command once, unchanged: task 0. Clears wanted[number] of each
     * task that the farm accepted, even on failure. Fails: E_UNAVAILABLE with the farm's message,
     * or because it was stopped. After a failure the farm may have accepted some tasks that are
     * still marked as wanted; status tells. */
    enum umb_status (*submit)(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                              uint8_t *wanted, struct umb_error *error);
    /* Sets known[number] to the state of each task, enum umbj_task_state. Releases tasks that the
     * farm only holds back. Fails: E_UNAVAILABLE: no state is known. */
    enum umb_status (*status)(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                              uint8_t *known, struct umb_error *error);
    /* Cancels all tasks of a try (JOB.EPOCH), if the farm answers within seconds. The daemon calls
     * it while it stops. */
    void (*cancel)(struct umbj_farm *self, const char *name);
    /* Cancels tasks of tries whose folders in `work` are gone: tasks of a killed daemon. stop: as
     * in a stage. Fails: E_UNAVAILABLE: some tasks may still run. */
    enum umb_status (*reconcile)(struct umbj_farm *self, const char *work, int stop,
                                 struct umb_error *error);
    void (*destroy)(struct umbj_farm *self);
};

/* All texts are borrowed: they stay valid until the farm is destroyed. */
struct umbj_slurm_options {
    const char *words;  /* More options of sbatch, with blanks between; NULL = none */
    const char *tag_of; /* Jobs folder; its hash tells our tasks from those of other daemons */
    const char *search; /* PATH of Slurm's programs; NULL = the usual */
    const char *configuration; /* SLURM_CONF; NULL = Slurm's own */
};

/*
 * Makes a farm that uses Slurm's command line: sbatch, squeue, scancel, scontrol (22.05). Slurm's
 * library is not used, because its ABI changes with each release.
 *
 * Measured with Slurm 22.05: jobs accepted less than 5 s before its controller is killed are lost.
 * If a task's agent dies, the task continues while a second one is started. Requeued tasks are held
 * back for 121 s.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbj_slurm_farm_create(const struct umbj_slurm_options *options,
                                                   struct umbj_farm **out, struct umb_error *error);

#endif
