/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_DAEMON_METRICS_H
#define UMBRAGE_SERVER_DAEMON_BASE_DAEMON_METRICS_H
/*
 * Counters of the daemon and their Prometheus text. Every counter is a separate atomic that only
 * grows. A scrape may see a call counted as started and not yet as handled, but never a torn
 * number. Labels come from fixed lists, so no peer can create new series.
 */
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include "daemon/base/method.h"
#include "jobs/service.h"
#include "store/store.h"
#include "umbrage/status.h"
#include "wire/volume_queries.h"

enum umbd_abuse {
    UMBD_ABUSE_CONTROL = 0, /* Cheap frames */
    UMBD_ABUSE_HEADERS,     /* Header lists over the limit */
    UMBD_ABUSE_RESET_SENT,  /* Streams that had to be reset for their peer's faults */
    UMBD_ABUSE_LIBRARY,     /* Connections that nghttp2 ended */
    UMBD_ABUSE_TIMEOUT,     /* Calls and connections that a timer ended */
    UMBD_ABUSE_QUEUE,       /* Answers that a peer caused and did not read */
    UMBD_ABUSE_REQUEST,     /* Heads of HTTP/1.1 that were refused */
    UMBD_ABUSE_COUNT,
};

#define UMBD_GRPC_CODES   17
#define UMBD_HTTP_CODES   22 /* statuses of replies by HTTP/1.1: http_codes */
#define UMBD_TIME_BUCKETS 15 /* upper bounds from 50 us to 5 s: bounds_ns */

/* Histogram of durations: the number in each bucket, and their sum. */
struct umbd_histogram {
    atomic_uint_fast64_t buckets[UMBD_TIME_BUCKETS + 1];
    atomic_uint_fast64_t sum_ns;
};

/* Counters of one method. */
struct umbd_method_counts {
    atomic_uint_fast64_t started;
    atomic_uint_fast64_t handled[UMBD_GRPC_CODES];
    struct umbd_histogram handling;
};

/* Counters without labels: field, name, help. */
#define UMBD_COUNTERS(X)                                                                           \
    X(points, "umbrage_queries_total", "Points answered.")                                         \
    X(batches_started, "umbrage_batches_started_total", "Batches whose work was begun.")           \
    X(shed, "umbrage_shed_total", "Calls refused for lack of room.")                               \
    X(handshakes_refused, "umbrage_handshakes_refused_total",                                      \
      "Connections refused for their address's rate of TLS handshakes.")                           \
    X(connections_opened, "umbrage_connections_opened_total", "Connections accepted.")             \
    X(connections_refused, "umbrage_connections_refused_total",                                    \
      "Connections refused: too many, or no descriptor left.")                                     \
    X(connections_evicted, "umbrage_connections_evicted_total",                                    \
      "Idle connections closed to make room for new ones.")                                        \
    X(connections_retired, "umbrage_connections_retired_total",                                    \
      "Connections asked to go, idle or too old.")                                                 \
    X(tls_failures, "umbrage_tls_failures_total", "TLS handshakes and sessions that failed.")      \
    X(unauthorized, "umbrage_unauthorized_total", "Calls refused for their token.")                \
    X(rate_limited, "umbrage_rate_limited_total", "Calls refused for their rate.")                 \
    X(http_bytes, "umbrage_http_bytes_total", "Bytes of bodies sent by HTTP/1.1.")

struct umbd_metrics {
    const struct umbd_method *methods; /* Rows that `calls` counts, in order; NULL: none */
    struct umbd_method_counts calls[UMBD_METHODS_MAX];
    struct umbd_histogram queued; /* From a task's submission to its first slice */
    atomic_uint_fast64_t http_requests[UMBD_HTTP_CODES];
    struct umbd_histogram http_handling; /* From the head to the last byte */
#define UMBD_COUNTER(field, name, help) atomic_uint_fast64_t field;
    UMBD_COUNTERS(UMBD_COUNTER)
#undef UMBD_COUNTER
    atomic_uint_fast64_t volume_queries[UMBW_VOLUME_QUERY_COUNT]; /* Records answered */
    atomic_uint_fast64_t abuse[UMBD_ABUSE_COUNT];
    atomic_uint_fast64_t loads, load_ms; /* Loads of assets, failed ones too */
    atomic_uint_fast64_t load_failed_damaged, load_failed_machine;
    atomic_int_fast64_t connections; /* Connections open now */
    atomic_int_fast64_t strangers;   /* Number of those without rights */
};

/* Values that are read at the moment of a scrape. */
struct umbd_gauges {
    struct umbs_store_counts assets;
    size_t queue_depth;
    uint64_t buffered_bytes;
    int ready;
    struct umbj_counters *jobs; /* NULL without --jobs */
    struct umbj_tiles tiles;    /* Tiles of the running jobs */
};

static inline void umbd_count(atomic_uint_fast64_t *counter, uint64_t n)
{
    atomic_fetch_add_explicit(counter, n, memory_order_relaxed);
}

/* Counts the start of a call. method: a row of metrics->methods. umbd_metrics_handled counts the
 * call's end; code: 0..16. */
void umbd_metrics_started(struct umbd_metrics *metrics, const struct umbd_method *method);
void umbd_metrics_handled(struct umbd_metrics *metrics, const struct umbd_method *method, int code,
                          uint64_t duration_ns);

/* Counts a request of HTTP/1.1 that ended. status: one that the daemon sends; 499: the client left
 * before the end. */
void umbd_metrics_http(struct umbd_metrics *metrics, int status, uint64_t duration_ns);

/* Counts what a scan of the store loaded. */
void umbd_metrics_scanned(struct umbd_metrics *metrics, const struct umbs_store_report *report);

/* Counts a duration. */
void umbd_observe(struct umbd_histogram *histogram, uint64_t duration_ns);

/* Renders everything; free() the text. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_metrics_text(struct umbd_metrics *metrics,
                                              const struct umbd_gauges *gauges, char **text,
                                              size_t *size);

#endif
