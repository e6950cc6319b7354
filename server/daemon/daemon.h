/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_DAEMON_H
#define UMBRAGE_SERVER_DAEMON_DAEMON_H
/*
 * The daemon: state shared by its loops, and the objects that answer calls. It has no globals, so a
 * process could run two daemons. daemon_run.c creates it before the first loop and destroys it
 * after the last.
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
 * Tests the options for --check: opens everything they name, as a start does, and closes it again.
 * Slurm's programs are checked too. Fails: as umbd_daemon_init, for folders, tokens, certificates
 * and programs.
 */
UMB_CHECKED enum umb_status umbd_daemon_check(const struct umbd_options *options,
                                              struct umb_error *error);

/* Opens and scans the store, and starts the workers and the store's thread. methods: the table of
 * the calls. Fails: any status; the daemon is then in the state after umbd_daemon_finish. */
UMB_CHECKED enum umb_status umbd_daemon_init(struct umbd_daemon *daemon,
                                             const struct umbd_options *options,
                                             const struct umbd_method *methods,
                                             struct umb_error *error);

/* Ends the job service; the loops get its last job requests. Call it between umbd_loops_run and
 * umbd_loops_finish. */
void umbd_daemon_end_jobs(struct umbd_daemon *daemon);

/* Destroys everything. Returns 1; or 0 if the store's thread is still busy and keeps using the
 * daemon. The process must then end by _exit (store_watch.h). */
int umbd_daemon_finish(struct umbd_daemon *daemon);

/*
 * Reads the command line, the config file, tokens and certificates again (SIGHUP). A new log level
 * and scrub interval take effect. For every other changed setting the log says that it needs a
 * restart. An unreadable file changes nothing. Cost: blocks for small files.
 */
void umbd_daemon_reload(struct umbd_daemon *daemon);

/*
 * The admin port (admin.c): HTTP/1.1 on loopback for scrapers and probes. It answers GET and HEAD
 * of /metrics, /livez and /readyz. Limits: one request for each connection, 4 KiB a request, 5
 * seconds, 32 connections.
 */

/* Opens the admin port on the first loop, if the options name one. Only a failure at the start ends
 * the daemon. */
UMB_CHECKED enum umb_status umbd_admin_open(struct umbd_daemon *daemon, struct umb_error *error);

/* "http:HOST:PORT" of the open port, or NULL. */
const char *umbd_admin_text(const struct umbd_daemon *daemon);

void umbd_admin_tick(struct umbd_daemon *daemon, uint64_t now_ms);

/* Closes port and connections. */
void umbd_admin_close(struct umbd_daemon *daemon);

/* Handlers for umbd_server.daemon: admin port, signs of life, reload. */
extern const struct umbd_daemon_events umbd_daemon_events;

/* Runs umbraged: parses the command line and serves the methods until a drain. Returns the exit
 * code. */
int umbd_run(int argc, char **argv, const struct umbd_method *methods);

#endif
