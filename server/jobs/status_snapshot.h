/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_STATUS_SNAPSHOT_H
#define UMBRAGE_SERVER_JOBS_STATUS_SNAPSHOT_H
/*
 * What everybody may look at without waiting for the disk: where the jobs stand, and whose the
 * assets are that jobs made. The table is the truth; the snapshot is its copy in memory, and holds
 * besides what only matters while a job runs: phase, progress, plan, notices.
 *
 * Threads: all functions from any thread; one mutex, held for a look-up or a copy.
 */
#include "jobs/executor.h"

#define UMBJ_PLAN_MAX     16384 /* bytes of a plan, and of the notices */
#define UMBJ_SNAPSHOT_MAX 8192  /* jobs that are over and still in the snapshot */

struct umbj_snapshot; /* opaque */

/* Tiles of one bake or of several; total 0 = not known. */
struct umbj_tiles {
    uint64_t done, total, found; /* found: of done, those kept from earlier bakes */
};

/* Where a job stands. */
struct umbj_standing {
    struct umbj_job job;
    char phase[UMBJ_PHASE_SIZE];
    char unit[UMBJ_PHASE_SIZE];
    uint64_t done, total;    /* of the phase; total 0 = not known */
    int64_t left_ms;         /* of the phase; -1 = not known */
    double rate;             /* units a second */
    struct umbj_tiles tiles; /* of the try; stays when the job is done */
    const char *plan, *notices;
    int loading;      /* done, and not served yet: watchers are told that it runs */
    uint64_t version; /* grows with each change of any job */
};

UMB_CHECKED enum umb_status umbj_snapshot_create(struct umbj_snapshot **out,
                                                 struct umb_error *error);
void umbj_snapshot_destroy(struct umbj_snapshot *snapshot); /* NULL is allowed */

/* Takes a job's state over; makes its entry if there is none. Without memory it is not on the
 * snapshot: watchers then find it missing. loading: see above. */
void umbj_snapshot_set(struct umbj_snapshot *snapshot, const struct umbj_job *job, int loading);

/* Takes a report of a running job; now_ms: of a clock that only goes forward. Returns the tiles
 * that it tells of beyond what was known (total: 0). */
struct umbj_tiles umbj_snapshot_report(struct umbj_snapshot *snapshot,
                                       const struct umbj_report *report, int64_t now_ms);

/* Calls look(user, standing) under the lock; returns 0 if the job is not in the snapshot. owner:
 * NULL = anybody's. */
int umbj_snapshot_look(struct umbj_snapshot *snapshot, const char *id, const char *owner,
                       void (*look)(void *user, const struct umbj_standing *standing), void *user);

/* Adds up the tiles of the jobs that run. */
struct umbj_tiles umbj_snapshot_tiles(struct umbj_snapshot *snapshot);

/* The job's version, 0 = not in the snapshot. */
uint64_t umbj_snapshot_version(struct umbj_snapshot *snapshot, const char *id);

/* Assets that jobs made: _own, _disown (owner NULL: all); _owns: 1 if it is the owner's. One that
 * could not be noted for lack of memory is nobody's until a restart. */
void umbj_snapshot_own(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner);
void umbj_snapshot_disown(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner);
int umbj_snapshot_owns(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner);

#endif
