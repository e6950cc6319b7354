/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_PLACE_H
#define UMBRAGE_SERVER_JOBS_JOB_PLACE_H
/*
 * Places of the job service's files, and the locks that exclude other daemons.
 *
 *     DIR/lock         the folder of bundles, work, tiles and assets: may be shared by machines
 *     DIR/jobs.db      the table; or a file elsewhere, with FILE.lock beside it
 *
 * The table is an SQLite database with a write-ahead log, whose index is in memory that only the
 * processes of one machine share (SQLite, "Write-Ahead Logging", "Disadvantages"). The table is
 * therefore refused on a network file system. DIR may be on one; owner_lock.h detects a daemon on
 * another machine.
 */
#include "common/owner_lock.h"

struct umbj_place {
    struct umbs_owner_lock folder, table; /* Locks; table: not held if the table is in the folder */
    char table_path[4200];
    int64_t beat_at_ms; /* on umbu_clock_ms's clock */
};

/*
 * Checks whether the table can be at the place that the options give. Changes nothing.
 *
 * In:    table: its file, NULL = DIR/jobs.db.
 * Out:   place: its table_path is set; no lock is held.
 * Fails: E_ARGUMENT (a network file system; DIR has a table that would be left behind),
 *        E_PERMISSION (other users can change the folder of `table`), E_NO_INPUT (that folder is
 *        missing), E_LIMIT.
 */
UMB_CHECKED enum umb_status umbj_place_check(const char *folder, const char *table,
                                             struct umbj_place *place, struct umb_error *error);

/* Does umbj_place_check, then takes both locks. Fails: also E_BUSY (names the other daemon),
 * E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbj_place_take(const char *folder, const char *table,
                                            struct umbj_place *place, struct umb_error *error);

/* Shows through both locks that this daemon is alive, if it is time. Fails: E_STATE (another daemon
 * took over), E_IO. */
UMB_CHECKED enum umb_status umbj_place_beat(struct umbj_place *place, struct umb_error *error);

/* Releases the locks. Allowed after umbj_place_check or umbj_place_init alone, when no lock is
 * held. */
void umbj_place_release(struct umbj_place *place);
void umbj_place_init(struct umbj_place *place);

#endif
