/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_RUN_H
#define UMBRAGE_LOAD_LOAD_RUN_H
/*
 * One run of a load test: warm-up, then a window that is measured.
 *
 * Closed loop (rate 0): each connection keeps `in_flight` calls under way; a call starts when
 * another one ends. A slow server then slows its own load down, and the latencies look better than
 * those of independent clients.
 *
 * Open loop: calls are due at a constant rate, whatever the server does. A latency counts from the
 * time at which the call was due, not from the time at which it was sent: waiting for a slot is
 * part of it (no coordinated omission). A call that was due and never sent counts as `unsent`, with
 * the time until the end of the run.
 *
 * Latencies are those of calls that were due within the window; throughput counts the successful
 * calls that ended within the window. No call is sent twice.
 *
 * Threads: each connection is an umb_client with a thread of its own; the lock of its lane guards
 * its figures and free slots. One more thread starts calls when they are due; the caller's thread
 * collects the figures.
 */
#include <stdbool.h>
#include "load/load_histogram.h"
#include "load/load_metrics.h"
#include "load/load_points.h"

#define UMBC_LOAD_STATUSES   96  /* counters of errors, by -status */
#define UMBC_LOAD_MOMENTS    600 /* most pieces of a run */
#define UMBC_LOAD_CONNS_MAX  256
#define UMBC_LOAD_FLIGHT_MAX 4096
/* Share of a core above which the load generator may limit the result */
#define UMBC_LOAD_BUSY 0.7

struct umbc_load_settings {
    const char *address;
    struct umb_client_options client; /* TLS and token; the run sets the rest */
    const char *asset;
    struct umb_query_settings query;
    unsigned connections, in_flight; /* number of connections; calls under way on each */
    double rate;                     /* calls a second on all connections; 0 = closed loop */
    double warm_up_s, duration_s;
    uint32_t timeout_ms;
    bool stream;
    const char *admin;   /* HOST:PORT of the daemon's admin port, or NULL */
    bool admin_may_fail; /* true: a run without the daemon's figures still counts */
};

/* One piece of the run, for plots and the live line. */
struct umbc_load_moment {
    double at_s;              /* end of the piece after the begin of the window; below 0: warm-up */
    double calls_s, errors_s; /* calls and errors a second */
    double p50_ms, p99_ms;    /* percentiles of the calls that ended in the piece */
    double server_rss;        /* memory of the daemon in bytes; 0 = not known */
    double server_cores;      /* processors that the daemon used */
};

struct umbc_load_result {
    double rate;     /* rate of the settings */
    double seconds;  /* length of the window */
    uint64_t calls;  /* number of calls that ended well in the window */
    uint64_t points; /* points of these calls */
    uint64_t errors[UMBC_LOAD_STATUSES];
    uint64_t error_count, unsent;
    struct umbc_histogram latency; /* latencies of calls that ended well or were never sent */
    double generator_cores;        /* processors that this process used in the window */
    bool counts;                   /* generator_cores <= UMBC_LOAD_BUSY */
    bool has_server;
    double server_s; /* seconds between the two requests for the daemon's figures */
    double server_cpu_s, server_points, server_rss_max, server_shed;
    size_t moment_count;
    struct umbc_load_moment moments[UMBC_LOAD_MOMENTS];
};

/* Called at the end of each piece; may be NULL. */
typedef void (*umbc_load_watch_fn)(void *user, const struct umbc_load_moment *moment,
                                   const struct umbc_load_result *so_far);

/*
 * Runs a load test and waits for its end.
 *
 * In:    pool: batches; the connections take them in turn, again and again.
 * Out:   result: zeroed and filled.
 * Fails: E_NO_MEMORY; as the last call if no call was answered; as umbc_server_figures_get.
 */
UMB_CHECKED enum umb_status umbc_load_run(const struct umbc_load_settings *settings,
                                          const struct umbc_load_pool *pool,
                                          umbc_load_watch_fn watch, void *user,
                                          struct umbc_load_result *result, struct umb_error *error);

#endif
