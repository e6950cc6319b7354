/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_BAKE_TRY_H
#define UMBRAGE_SERVER_JOBS_BAKE_TRY_H
/*
 * One try of a job, on its own thread. It makes FOLDER/out.umb from the bundle, or fails with a
 * cause.
 *
 *     struct umbj_try try = {.options = &options, .work = &work, .stop = fd};
 *     failure = umbj_bake_here(&try);       or umbj_bake_on_farm(&try)
 */
#include "jobs/worker_process.h"

struct umbj_try {
    const struct umbj_try_options *options;
    const struct umbj_work *work; /* the executor's work; its folder exists */
    int stop;                     /* descriptor that becomes readable when the try shall end */
    uint64_t tiles;               /* number of tiles that a process reported last */
    char said[UMBJ_CAUSE_SIZE];   /* last line that a process wrote to stderr */
    char cause[UMBJ_CAUSE_SIZE];  /* cause of the failure that was returned */
};

/* An empty report of the try, to be filled and sent. */
struct umbj_report umbj_try_report(const struct umbj_try *try, enum umbj_report_kind kind);
void umbj_try_tell(const struct umbj_try *try, const struct umbj_report *report);
void umbj_try_tell_phase(const struct umbj_try *try, const char *phase);

/* Cleans a text from a process that read a foreign scene. */
void umbj_try_text(char out[UMBJ_CAUSE_SIZE], const char *text);

/* Stores the cause; returns the failure. */
enum umbj_failure umbj_try_fail(struct umbj_try *try, enum umbj_failure failure, const char *format,
                                ...) __attribute__((format(printf, 3, 4)));

/* Stores the message of a failure of the daemon's own. */
enum umbj_failure umbj_try_fail_status(struct umbj_try *try, enum umb_status status,
                                       const struct umb_error *error);

/* Runs umbrage-bake in a folder to its end, and passes its reports on. words: its arguments, which
 * this function frees. */
enum umbj_failure umbj_try_run(struct umbj_try *try, struct umbj_words *words, const char *folder);

/* Classifies the end of a process of the try, and stores its cause. */
enum umbj_failure umbj_try_judge(struct umbj_try *try, const struct umbj_process_end *end);

/* Returns 1 if the tiles of the bake can be kept for later bakes. Otherwise (Embree, or the static
 * effect) it is unknown which triangles reach a tile. */
int umbj_try_keeps_tiles(const struct umbj_try *try);

/* Bakes on this machine, in one process. The cache of the bake is the owner's folder of tiles. */
enum umbj_failure umbj_bake_here(struct umbj_try *try);

/* Bakes on options->farm (farm_bake.c). */
enum umbj_failure umbj_bake_on_farm(struct umbj_try *try);

#endif
