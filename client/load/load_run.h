/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_RUN_H
#define UMBRAGE_LOAD_LOAD_RUN_H
/*
 * One run of a load test: warm-up, then a window that is measured.
 *
 * Closed loop (rate 0): each connection keeps `in_flight` calls under way; the next starts when one
 * ends. A slow server then slows its own load down, and the latencies look better than those of
 * independent clients. Open loop: calls are due at a constant rate, whatever the server does.
 * A latency counts from the moment the call was due, not from when it could be sent:
 * waiting for a slot is part of it (no coordinated omission). Calls that were due and not even sent
 * at the end count with the time they had waited, and as `unsent`.
 *
 * Latencies are those of calls due within the window, whenever they end; throughput is what ended
 * well within the window. Nothing is sent twice.
 *
 * Threads: a connection is an umb_client of its own, so a thread; its lane (figures, free slots) is
 * under the lane's lock. One thread paces, the caller's looks on.
 */
#include <stdbool.h>
#include "load/load_histogram.h"
#include "load/load_metrics.h"
#include "load/load_points.h"

#define UMBC_LOAD_STATUSES   96  /* errors are counted by -status */
#define UMBC_LOAD_MOMENTS    600 /* of the course of a run */
#define UMBC_LOAD_CONNS_MAX  256
#define UMBC_LOAD_FLIGHT_MAX 4096
#define UMBC_LOAD_BUSY       0.7 /* more of a core, and the generator may be what is measured */

struct umbc_load_settings {
    const char *address;
    struct umb_client_options client; /* TLS, token; the rest is set here */
    const char *asset;
    struct umb_query_settings query;
    unsigned connections, in_flight; /* in_flight: of each connection */
    double rate;                     /* calls a second of all connections; 0 = closed loop */
    double warm_up_s, duration_s;
    uint32_t timeout_ms;
    bool stream;
    const char *admin;   /* or NULL */
    bool admin_may_fail; /* a run whose daemon tells no figures is measured without them */
};

/* The run in pieces of time, for plots and the live line. */
struct umbc_load_moment {
    double at_s;              /* end of the piece, since the window began; negative: warm-up */
    double calls_s, errors_s; /* a second, within the piece */
    double p50_ms, p99_ms;    /* of calls that ended in it */
    double server_rss;        /* bytes; 0 = not known */
    double server_cores;      /* used in the piece */
};

struct umbc_load_result {
    double rate;     /* as asked */
    double seconds;  /* of the window */
    uint64_t calls;  /* ended well in the window */
    uint64_t points; /* of those */
    uint64_t errors[UMBC_LOAD_STATUSES];
    uint64_t error_count, unsent;
    struct umbc_histogram latency; /* of calls that ended well, or were never sent */
    double generator_cores;        /* processor time of this process by time, in the window */
    bool counts;                   /* generator_cores <= UMBC_LOAD_BUSY */
    bool has_server;
    double server_s; /* between the two times that its figures were asked for */
    double server_cpu_s, server_points, server_rss_max, server_shed;
    size_t moment_count;
    struct umbc_load_moment moments[UMBC_LOAD_MOMENTS];
};

/* Told about each moment as it ends; may be NULL. */
typedef void (*umbc_load_watch_fn)(void *user, const struct umbc_load_moment *moment,
                                   const struct umbc_load_result *so_far);

/*
 * Runs and waits.
 *
 * In:    pool: asked from its beginning on, round and round, one connection after the other.
 * Out:   result: zeroed and filled.
 * Fails: E_NO_MEMORY; E_UNAVAILABLE and the like if no call at all was answered: what the last one
 *        said; of --admin what load_metrics.h says.
 */
UMB_CHECKED enum umb_status umbc_load_run(const struct umbc_load_settings *settings,
                                          const struct umbc_load_pool *pool,
                                          umbc_load_watch_fn watch, void *user,
                                          struct umbc_load_result *result, struct umb_error *error);

#endif
