/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_METRICS_H
#define UMBRAGE_LOAD_LOAD_METRICS_H
/* What a load test asks the daemon's metrics port: processor time, points, memory. */
#include <stddef.h>
#include "umbrage/status.h"

struct umbc_server_figures {
    double cpu_s;    /* process_cpu_seconds_total */
    double points;   /* umbrage_queries_total */
    double rss;      /* process_resident_memory_bytes */
    double shed;     /* umbrage_shed_total */
    double buffered; /* umbrage_buffered_bytes */
};

/*
 * Fetches http://ADMIN/metrics.
 *
 * In:    admin: HOST:PORT, as of `umbraged --admin`.
 * Fails: E_ARGUMENT (no HOST:PORT), E_UNAVAILABLE (no listener, or no answer in two seconds),
 *        E_PROTOCOL (no such figures).
 * Cost:  blocks for at most two seconds.
 */
UMB_CHECKED enum umb_status umbc_server_figures_get(const char *admin,
                                                    struct umbc_server_figures *figures,
                                                    struct umb_error *error);

/* Reads figures out of Prometheus' text form; E_PROTOCOL if cpu_s or points are not there. */
UMB_CHECKED enum umb_status umbc_server_figures_parse(const char *text,
                                                      struct umbc_server_figures *figures,
                                                      struct umb_error *error);

#endif
