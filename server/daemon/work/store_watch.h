/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_STORE_WATCH_H
#define UMBRAGE_SERVER_DAEMON_WORK_STORE_WATCH_H
/*
 * The thread that rescans the store, checks assets again and frees retired ones, so that no loop
 * ever blocks on the disk. It scans when a folder of the store changes (inotify), when kicked
 * (SIGHUP, an asset taken out of use), and every 30 s in any case. It scans again soon while a new
 * file seems half copied. Between scans it checks the mapped files again, one by one.
 */
#include "store/store.h"
#include "daemon/base/daemon_metrics.h"

#define UMBD_RESCAN_S        30 /* longest time between scans: events can be lost */
#define UMBD_WATCH_END_MS    1000
#define UMBD_RESCAN_PAUSE_MS 50 /* pause before a scan: a burst of events becomes one scan */
/* Packed size from which a file does not delay a scan. */
#define UMBD_LANE_BYTES     (UINT64_C(64) << 20)
#define UMBD_SCRUB_PAUSE_MS 1000 /* time between searches for an asset to check */
/* Rate of checking: leaves most of the disk's bandwidth to the calls. */
#define UMBD_SCRUB_BYTES_PER_MS 262144

struct umbd_store_watch; /* opaque */

/* Creates the object. Afterwards the store can be opened with the callbacks below, before the
 * thread starts. */
UMB_CHECKED enum umb_status umbd_store_watch_create(struct umbd_metrics *metrics,
                                                    const struct umbs_log *log,
                                                    struct umbd_store_watch **out,
                                                    struct umb_error *error);

/*
 * Starts the thread on a store.
 *
 * In:    folders: the store's folders, at most UMBS_STORE_FOLDERS_MAX, with NULL after the last;
 *        borrowed. scrub_interval_ms: longest time between two checks of an asset; 0 = no checks.
 * Fails: E_LIMIT.
 */
UMB_CHECKED enum umb_status umbd_store_watch_start(struct umbd_store_watch *watch,
                                                   struct umbs_store *store,
                                                   const char *const *folders,
                                                   uint64_t scrub_interval_ms,
                                                   struct umb_error *error);

/* Changes the interval of checks; any thread. */
void umbd_store_watch_set_scrub(struct umbd_store_watch *watch, uint64_t interval_ms);

/* Asks for a scan soon. Any thread, at once. */
void umbd_store_watch_kick(struct umbd_store_watch *watch);

/* Callbacks `retired` and `faulted` of the store; user is the watch. */
void umbd_store_watch_retired(void *user);
void umbd_store_watch_faulted(void *user);

/*
 * Stops and joins the thread, frees the object and returns 1. NULL is allowed. Returns 0 if the
 * thread is busy with files for longer than UMBD_WATCH_END_MS. The thread then still runs and
 * nothing is freed: loading a large asset takes minutes, too long for the end of a daemon. The
 * process must then end by _exit; the thread leaves a temporary file that the next daemon removes.
 */
int umbd_store_watch_destroy(struct umbd_store_watch *watch);

#endif
