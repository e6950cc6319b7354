/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_DAEMON_H
#define UMBRAGE_SERVER_DAEMON_DAEMON_H
/*
 * State that all loops of one daemon share: options, store, workers, counters. No globals: a
 * process could run two. main builds it before the first loop and takes it down after the last.
 */
#include <stdatomic.h>
#include "common/log.h"
#include "store/store.h"
#include "daemon/base/daemon_metrics.h"
#include "daemon/base/daemon_options.h"
#include "daemon/work/pool.h"
#include "daemon/base/rate_limit.h"
#include "daemon/work/store_watch.h"
#include "daemon/transport/tls_context.h"
#include "daemon/base/tokens.h"

struct umbd_calibrations;
struct umbd_loop;
struct umbj_service;

struct umbd_daemon {
    struct umbd_options options;
    struct umbs_log log;
    struct umbd_metrics metrics;
    struct umbs_store *store;
    const char *folders[UMBS_STORE_FOLDERS_MAX]; /* folders of the store, NULL at the end: */
    size_t store_count;                          /* number of the operator's folders, then comes */
    char cache[4096];      /* Folder of mapped files that systemd names, or "" */
    char job_assets[4096]; /* the folder of jobs' assets */
    struct umbd_store_watch *watch;
    struct umbd_pool *pool;
    struct umbd_calibrations *calibrations; /* measured for budgets */
    struct umbd_peer_table *peers;
    struct umbd_tokens *tokens;             /* NULL = every caller may query */
    struct umbj_service *jobs;              /* NULL without --jobs, and after the loops have run */
    struct umbd_tls *tls;                   /* NULL unless something listens on tls: */
    atomic_uint_fast64_t buffered;          /* bytes of requests and replies held */
    size_t stranger_bytes;                  /* Bytes that a connection without rights may hold */
    atomic_uint_fast64_t stranger_buffered; /* bytes that all of these connections hold */
    atomic_uint stranger_watches;           /* Number of their health Watches */
    atomic_uint_fast64_t next_serial;       /* serial of the next connection; never reused */
    struct umbd_loop *loops;                /* [loop_count], see loop_group.h */
    uint32_t loop_count;
    /* Limit of all loops: the option's, or by the number of descriptors. */
    uint32_t max_connections;
    atomic_uint loops_running;
    atomic_int draining;     /* health says NOT_SERVING */
    uint64_t watchdog_ms;    /* interval of signs of life, 0 = none wanted */
    uint64_t watchdog_at_ms; /* time of the next one; the first loop's */
};

/* Fails with E_ARGUMENT if a folder of --jobs is one of the operator's stores. */
UMB_CHECKED enum umb_status umbd_daemon_check_apart(const struct umbd_options *options,
                                                    const char *folder, struct umb_error *error);

/*
 * --check: opens all that the options name, as a start does, and releases it. Fails: as
 * umbd_daemon_init, for folders, tokens, certificates and programs; Slurm's programs are checked
 * too.
 */
UMB_CHECKED enum umb_status umbd_daemon_check(const struct umbd_options *options,
                                              struct umb_error *error);

/* Opens the store, scans it, starts workers and the store's thread. Fails: any; daemon is then in
 * the state after umbd_daemon_finish. */
UMB_CHECKED enum umb_status umbd_daemon_init(struct umbd_daemon *daemon,
                                             const struct umbd_options *options,
                                             struct umb_error *error);

/* Ends the job service; the loops get its last job requests. Call it between umbd_loops_run and
 * umbd_loops_finish. */
void umbd_daemon_end_jobs(struct umbd_daemon *daemon);

/* Takes everything down; returns 1, or 0 if the store's thread is still busy and keeps using the
 * daemon: the process must then end by _exit (store_watch.h). */
int umbd_daemon_finish(struct umbd_daemon *daemon);

/* Counts bytes held; returns 1, or 0 (nothing counted) if --max-buffer would be passed. */
int umbd_daemon_charge(struct umbd_daemon *daemon, size_t bytes);
void umbd_daemon_uncharge(struct umbd_daemon *daemon, size_t bytes);

/* Gives the service manager its sign of life when due, unless any loop has not ticked for that
 * long: so a loop that hangs is noticed. The first loop's tick calls it. */
void umbd_daemon_alive(struct umbd_daemon *daemon, uint64_t now_ms);

/*
 * Reads command line and config file again (SIGHUP). Log level and scrub interval take effect. For
 * every other changed setting the log tells that it needs a restart. An unreadable file changes
 * nothing. Blocks for a small file.
 */
void umbd_daemon_reload(struct umbd_daemon *daemon);

/* Reads the values of a scrape that are not counters. */
void umbd_daemon_gauges(struct umbd_daemon *daemon, struct umbd_gauges *gauges);

#endif
