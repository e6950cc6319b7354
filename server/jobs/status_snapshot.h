/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_STATUS_SNAPSHOT_H
#define UMBRAGE_SERVER_JOBS_STATUS_SNAPSHOT_H
/*
 * The snapshot of the jobs and of the assets' owners, for reads that must not wait for the disk. It
 * is a copy of the table in memory; the table decides. It also has the state that matters only
 * while a job runs: phase, progress, plan, notices.
 *
 * Threads: all functions from any thread; one mutex, held for a look-up or a copy.
 */
#include "jobs/executor.h"

#define UMBJ_PLAN_MAX     16384 /* bytes of a plan, and bytes of the notices */
#define UMBJ_SNAPSHOT_MAX 8192  /* finished jobs in the snapshot */

struct umbj_snapshot; /* opaque */

/* Tile counts of one bake or of several; total 0 = not known. */
struct umbj_tiles {
    uint64_t done, total, found; /* found: part of done that earlier bakes had made */
};

/* The standing of a job: state and progress. */
struct umbj_standing {
    struct umbj_job job;
    char phase[UMBJ_PHASE_SIZE];
    char unit[UMBJ_PHASE_SIZE];
    uint64_t done, total;    /* progress of the phase; total 0 = not known */
    int64_t left_ms;         /* time left of the phase; -1 = not known */
    double rate;             /* units a second */
    struct umbj_tiles tiles; /* tiles of the try; kept when the job is done */
    char *plan, *notices;    /* lines, for reading only; NULL = none */
    int loading;             /* done, and not served yet: watchers see it as running */
    uint64_t version;        /* number that grows with each change of any job */
};

UMB_CHECKED enum umb_status umbj_snapshot_create(struct umbj_snapshot **out,
                                                 struct umb_error *error);
void umbj_snapshot_destroy(struct umbj_snapshot *snapshot); /* NULL is allowed */

/* Sets a job's state, and creates the job's entry if there is none. If memory is short, the job is
 * missing in the snapshot for its watchers. loading: as in struct umbj_standing. */
void umbj_snapshot_set(struct umbj_snapshot *snapshot, const struct umbj_job *job, int loading);

/* Adds a report of a running job. In: now_ms: time on a monotonic clock. Returns the number of
 * tiles that the report adds, with total 0. */
struct umbj_tiles umbj_snapshot_report(struct umbj_snapshot *snapshot,
                                       const struct umbj_report *report, int64_t now_ms);

/* Calls look(user, standing) under the lock. Returns 0 if the snapshot has no such job of the
 * owner. owner: NULL = any owner. */
int umbj_snapshot_look(struct umbj_snapshot *snapshot, const char *id, const char *owner,
                       void (*look)(void *user, const struct umbj_standing *standing), void *user);

/* Sum of the tiles of all running jobs. */
struct umbj_tiles umbj_snapshot_tiles(struct umbj_snapshot *snapshot);

/* The job's version, 0 = not in the snapshot. */
uint64_t umbj_snapshot_version(struct umbj_snapshot *snapshot, const char *id);

/* Owners of jobs' assets. umbj_snapshot_own adds an owner, umbj_snapshot_disown removes one (NULL:
 * all), umbj_snapshot_owns returns 1 if the owner has the asset. If memory is too short for an
 * owner, the asset lacks that owner until a restart. */
void umbj_snapshot_own(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner);
void umbj_snapshot_disown(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner);
int umbj_snapshot_owns(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner);

#endif
