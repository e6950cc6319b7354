/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_EXECUTOR_H
#define UMBRAGE_SERVER_JOBS_EXECUTOR_H
/*
 * The executor runs bakes behind a small interface, which tests replace.
 *
 * An executor starts a try of a job (an epoch), reports on it, and reports its end exactly once. It
 * makes no decisions: the job service decides what a failure means, and whether the try still
 * counts.
 *
 * Each try is a thread. The thread has the asset baked, on this machine (bake_try.h) or by a farm
 * (farm.h), passes the reports on, and stages the result. No process outlives the daemon
 * (worker_process.h). A farm's tasks end when they find that the try's folder is gone.
 *
 * Threads: start, cancel and destroy are called by the service's thread; reports may come from any
 * thread, but never during these calls.
 */
#include "tool/output.h"
#include "jobs/farm.h"
#include "jobs/job.h"

#define UMBJ_PHASE_SIZE  32
#define UMBJ_WORKERS_MAX 256

/* One try. Texts are borrowed during start and copied. */
struct umbj_work {
    char job[UMBJ_ID_SIZE];
    int64_t epoch;
    const char *bundle;   /* Folder with the scene's files */
    const char *folder;   /* Folder of this try, made by the executor and removed at its end */
    const char *scene;    /* Path of the scene in the bundle */
    const char *settings; /* Lines of --name=value */
    const char *cache;    /* Folder of the owner's tiles; NULL = none */
    /* 1 if the owner has an asset of an earlier bake of the same key. Then nothing is baked, but
     * the try takes as long as the earlier bake. */
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
    /* Failure of the try or of a farm's task, with its cause in `text`. UMBJ_NO_FAILURE in the last
     * report means that there is an asset and the next fields are set. */
    enum umbj_failure failure;
    uint8_t asset[UMBJ_HASH_BYTES];
    int64_t bake_ms;
    /* Verified file, ready to be committed into the store; the receiver owns it. Its temporary is
     * NULL if the asset exists already. */
    struct umbu_output staged;
};

/* Takes a report; copies it. */
typedef void (*umbj_report_fn)(void *user, const struct umbj_report *report);

struct umbj_executor {
    /* Begins a try. Fails: E_BUSY (no slot is free), E_NO_MEMORY, E_LIMIT; then nothing was
     * begun. */
    enum umb_status (*start)(struct umbj_executor *self, const struct umbj_work *work,
                             struct umb_error *error);
    /* Asks a try to end soon; it still reports. */
    void (*cancel)(struct umbj_executor *self, const char *job, int64_t epoch);
    /* Number of tries that may be started now. */
    int (*free_slots)(struct umbj_executor *self);
    /* Ends all tries and waits for them; they do not report any more. */
    void (*destroy)(struct umbj_executor *self);
};

struct umbj_try_options {
    const char *program;    /* umbrage-bake, absolute; borrowed, as all texts */
    const char *assets;     /* folder for the finished assets */
    const char *work;       /* folder of the tries' folders */
    struct umbj_farm *farm; /* NULL = this machine; owned by the executor, also if create fails */
    const char *sandbox;    /* mode of umbrage-bake --sandbox; NULL = required */
    unsigned workers;       /* tries at once, 1..UMBJ_WORKERS_MAX */
    unsigned threads;       /* threads of one bake, or of one task of it */
    uint32_t tile;          /* texels along a tile's side; 0 = umbrage-bake's choice */
    uint64_t memory_bytes;  /* limit of one bake, or of one task of it */
    uint64_t interval_ms;   /* milliseconds between status calls to the farm */
    uint64_t cache_bytes;   /* limit of one owner's tiles; 0 = none are kept */
    uint64_t timeout_ms;    /* wall-clock limit of one try */
    uint64_t max_output_bytes; /* limit of an asset */
    umbj_report_fn report;
    void *user;
};

/* Makes an executor, which its own `destroy` frees. Fails: E_UNAVAILABLE (no such program),
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_try_executor_create(const struct umbj_try_options *options,
                                                     struct umbj_executor **out,
                                                     struct umb_error *error);

#endif
