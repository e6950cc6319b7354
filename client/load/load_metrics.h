/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_METRICS_H
#define UMBRAGE_LOAD_LOAD_METRICS_H
/* Figures of the daemon from its admin port: processor time, points, memory. */
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
 * In:    admin: HOST:PORT of `umbraged --admin`.
 * Fails: E_ARGUMENT (no HOST:PORT), E_UNAVAILABLE (no listener, or no answer in two seconds),
 *        E_PROTOCOL (the figures are missing).
 * Cost:  blocks for at most two seconds.
 */
UMB_CHECKED enum umb_status umbc_server_figures_get(const char *admin,
                                                    struct umbc_server_figures *figures,
                                                    struct umb_error *error);

#endif
