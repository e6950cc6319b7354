/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_PLACE_H
#define UMBRAGE_SERVER_JOBS_JOB_PLACE_H
/*
 * Where the job service keeps its files, and that no other daemon uses them.
 *
 *     DIR/lock         the folder of bundles, work, tiles and assets: may be shared by machines
 *     DIR/jobs.db      the table; or a file elsewhere, with FILE.lock beside it
 *
 * The table is an SQLite database with a write-ahead log, which lies in memory that the processes
 * of one machine share (SQLite, "Write-Ahead Logging", "Disadvantages"): on a network file system
 * it is refused. DIR may lie on one; owner_lock.h says how a daemon on another machine is found.
 */
#include "common/owner_lock.h"

struct umbj_place {
    struct umbs_owner_lock folder, table; /* table: not held where it lies in the folder */
    char table_path[4200];
    int64_t beat_at_ms; /* on umbs_now_ms's clock */
};

/*
 * Looks whether a table can be where the options put it; changes nothing.
 *
 * In:    table: its file, NULL = DIR/jobs.db. Out: place: table_path; nothing is held.
 * Fails: E_ARGUMENT (a network file system; a table in DIR that would be left behind), E_PERMISSION
 *        (other users can change the folder of `table`), E_NO_INPUT (it is missing), E_LIMIT.
 */
UMB_CHECKED enum umb_status umbj_place_check(const char *folder, const char *table,
                                             struct umbj_place *place, struct umb_error *error);

/* The same, and takes both locks. Fails: also E_BUSY (names the other daemon), E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbj_place_take(const char *folder, const char *table,
                                            struct umbj_place *place, struct umb_error *error);

/* Shows that this daemon is alive, if it is time. Fails: E_STATE (another daemon took over), E_IO.
 */
UMB_CHECKED enum umb_status umbj_place_beat(struct umbj_place *place, struct umb_error *error);

/* Gives the locks back. A place that was not taken is allowed, after umbj_place_check or _init. */
void umbj_place_release(struct umbj_place *place);
void umbj_place_init(struct umbj_place *place);

#endif
