/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_EXECUTOR_H
#define UMBRAGE_SERVER_JOBS_EXECUTOR_H
/*
 * Where bakes are run, behind one small interface (try_executor.h): on this machine, or on a farm
 * (farm.h).
 *
 * An executor is given a try of a job (an epoch) and reports on it until it ended, once. It decides
 * nothing: what a failure means, and whether the try still counts, is the job service's.
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
    const char *folder;   /* of this try, made by the executor and removed at its end */
    const char *scene;    /* path in the bundle */
    const char *settings; /* lines of --name=value */
    const char *cache;    /* folder of the owner's tiles, NULL = none */
    /* An earlier bake of the same key whose asset the owner has: nothing is run, but it takes as
     * long as that did. */
    int is_known;
    uint8_t known_asset[UMBJ_HASH_BYTES];
    int64_t known_ms;
};

enum umbj_report_kind {
    UMBJ_REPORT_PHASE = 0, /* text: a word */
    UMBJ_REPORT_PROGRESS,  /* done of total, text: the unit */
    UMBJ_REPORT_TILES,     /* done of total tiles, `found` of them from earlier bakes */
    UMBJ_REPORT_TASK,      /* of a farm, number `done` of `total`: failure, text is the cause */
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
    enum umbj_failure failure; /* ended: UMBJ_NO_FAILURE: there is an asset; else text is why */
    /* ended */
    uint8_t asset[UMBJ_HASH_BYTES];
    int64_t bake_ms;
    struct umbu_output staged; /* proven and ready to be committed into the store; the receiver's.
                              * Not begun (temporary NULL) if the asset is there already */
};

/* Takes a report; copies it. */
typedef void (*umbj_report_fn)(void *user, const struct umbj_report *report);

struct umbj_executor {
    /* Begins a try. Fails: E_BUSY (no slot is free), E_NO_MEMORY, E_LIMIT: nothing was begun. */
    enum umb_status (*start)(struct umbj_executor *self, const struct umbj_work *work,
                             struct umb_error *error);
    /* Asks for the end of a try, soon; it still reports. */
    void (*cancel)(struct umbj_executor *self, const char *job, int64_t epoch);
    /* How many more tries may be begun. */
    int (*free_slots)(struct umbj_executor *self);
    /* Ends all tries and waits for them; they do not report any more. */
    void (*destroy)(struct umbj_executor *self);
};

#endif
