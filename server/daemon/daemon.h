/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_DAEMON_H
#define UMBRAGE_SERVER_DAEMON_DAEMON_H
/*
 * The daemon: what its loops share and what its calls are answered from. No globals: a process
 * could run two. daemon_run.c builds it before the first loop and takes it down after the last.
 */
#include "daemon/call/call.h"
#include "daemon/transport/server.h"
#include "daemon/work/store_watch.h"

struct umbd_admin;

struct umbd_daemon {
    struct umbd_server server; /* First field: its events find the daemon by it */
    struct umbd_backend backend;
    const char *folders[UMBS_STORE_FOLDERS_MAX]; /* Folders of the store, NULL after the last */
    char cache[4096];      /* Folder of mapped files that systemd names, or "" */
    char job_assets[4096]; /* Folder of jobs' assets: the last of the store */
    struct umbd_store_watch *watch;
    struct umbd_admin *admin; /* Admin port; NULL: none */
    uint64_t watchdog_ms;     /* Interval of signs of life, 0 = none wanted */
    uint64_t watchdog_at_ms;  /* Time of the next one */
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

/* Opens the store, scans it, starts workers and the store's thread. methods: the table of the
 * calls. Fails: any; daemon is then in the state after umbd_daemon_finish. */
UMB_CHECKED enum umb_status umbd_daemon_init(struct umbd_daemon *daemon,
                                             const struct umbd_options *options,
                                             const struct umbd_method *methods,
                                             struct umb_error *error);

/* Ends the job service; the loops get its last job requests. Call it between umbd_loops_run and
 * umbd_loops_finish. */
void umbd_daemon_end_jobs(struct umbd_daemon *daemon);

/* Takes everything down; returns 1, or 0 if the store's thread is still busy and keeps using the
 * daemon: the process must then end by _exit (store_watch.h). */
int umbd_daemon_finish(struct umbd_daemon *daemon);

/*
 * Reads command line, config file and the files of secrets again (SIGHUP). Log level and scrub
 * interval take effect. For every other changed setting the log tells that it needs a restart. An
 * unreadable file changes nothing. Blocks for small files.
 */
void umbd_daemon_reload(struct umbd_daemon *daemon);

/* Events for umbd_server.daemon of a daemon: admin port, signs of life, reload. */
extern const struct umbd_daemon_events umbd_daemon_events;

/* umbraged: parses the command line and serves the methods until a drain. Returns the exit code. */
int umbd_run(int argc, char **argv, const struct umbd_method *methods);

#endif
