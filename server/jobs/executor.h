/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_EXECUTOR_H
#define UMBRAGE_SERVER_JOBS_EXECUTOR_H
/*
 * Executors run bakes behind one small interface (try_executor.h): on this machine, or on a farm
 * (farm.h).
 *
 * An executor starts a try of a job (an epoch), reports on it until it ends, and reports the end
 * once. It makes no decisions: the job service decides what a failure means and whether the try
 * still counts.
 *
 * Threads: start, cancel and destroy are called by the service's thread; reports may come from any
 * thread, never from inside these calls.
 */
#include "tool/output.h"
#include "jobs/job.h"

#define UMBJ_PHASE_SIZE 32

/* One try. Texts are borrowed during start and copied. */
struct umbj_work {
    char job[UMBJ_ID_SIZE];
    int64_t epoch;
    const char *bundle;   /* folder with the scene's files */
    const char *folder;   /* folder of this try, made by the executor and removed at its end */
    const char *scene;    /* path of the scene in the bundle */
    const char *settings; /* lines of --name=value */
    const char *cache;    /* folder of the owner's tiles, NULL = none */
    /* 1 if the owner has an asset of an earlier bake of the same key. Then nothing runs, but the
     * try takes as long as that bake did. */
    int is_known;
    uint8_t known_asset[UMBJ_HASH_BYTES];
    int64_t known_ms;
};

enum umbj_report_kind {
    UMBJ_REPORT_PHASE = 0, /* text: a word */
    UMBJ_REPORT_PROGRESS,  /* done of total, text: the unit */
    UMBJ_REPORT_TILES,     /* done of total tiles, `found` of them from earlier bakes */
    UMBJ_REPORT_TASK,      /* a farm's task `done` of `total`: failure, text is the cause */
    UMBJ_REPORT_PLAN,      /* text: one line */
    UMBJ_REPORT_NOTICE,    /* text: one line */
    UMBJ_REPORT_ENDED,     /* the last one */
};

struct umbj_report {
    enum umbj_report_kind kind;
    char job[UMBJ_ID_SIZE];
    int64_t epoch;
    uint64_t done, total, found;
    char text[UMBJ_CAUSE_SIZE];
    /* Ended: UMBJ_NO_FAILURE: there is an asset; else text is the cause. */
    enum umbj_failure failure;
    /* ended */
    uint8_t asset[UMBJ_HASH_BYTES];
    int64_t bake_ms;
    /* File ready to be committed into the store, proven; the receiver's. Not begun (temporary NULL)
     * if the asset is there already. */
    struct umbu_output staged;
};

/* Takes a report; copies it. */
typedef void (*umbj_report_fn)(void *user, const struct umbj_report *report);

struct umbj_executor {
    /* Begins a try. Fails: E_BUSY (no slot is free), E_NO_MEMORY, E_LIMIT: nothing was begun. */
    enum umb_status (*start)(struct umbj_executor *self, const struct umbj_work *work,
                             struct umb_error *error);
    /* Asks a try to end soon; it still reports. */
    void (*cancel)(struct umbj_executor *self, const char *job, int64_t epoch);
    /* Number of tries that may be started now. */
    int (*free_slots)(struct umbj_executor *self);
    /* Ends all tries and waits for them; they do not report any more. */
    void (*destroy)(struct umbj_executor *self);
};

#endif
