/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_DAEMON_METRICS_H
#define UMBRAGE_SERVER_DAEMON_BASE_DAEMON_METRICS_H
/*
 * Counters of the daemon and their Prometheus text. Every counter is a separate atomic that only
 * grows; a scrape may see one call counted as started and not yet as handled, never a torn number.
 * Labels come from fixed lists, so no peer can create new series.
 */
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include "store/store.h"
#include "jobs/service.h"
#include "umbrage/status.h"
#include "wire/volume_queries.h"

enum umbd_method {
    UMBD_METHOD_QUERY = 0,
    UMBD_METHOD_QUERY_STREAM,
    UMBD_METHOD_DESCRIBE,
    UMBD_METHOD_LIST,
    UMBD_METHOD_LIMITS,
    UMBD_METHOD_BAKES_SUBMIT,
    UMBD_METHOD_BAKES_WATCH,
    UMBD_METHOD_BAKES_CANCEL,
    UMBD_METHOD_BAKES_LIST,
    UMBD_METHOD_BAKES_FETCH,
    UMBD_METHOD_BAKES_DELETE,
    UMBD_METHOD_REGIONS_STREAM,
    UMBD_METHOD_REGIONS_FOLLOW,
    UMBD_METHOD_REGIONS_DERIVE,
    UMBD_METHOD_SEGMENTS,
    UMBD_METHOD_COLUMNS,
    UMBD_METHOD_BOXES,
    UMBD_METHOD_CHECK,
    UMBD_METHOD_WATCH,
    UMBD_METHOD_REFLECTION,
    UMBD_METHOD_REFLECTION_ALPHA,
#ifdef UMBRAGE_TEST_SERVICE
    UMBD_METHOD_TEST_EMPTY,
    UMBD_METHOD_TEST_UNARY,
    UMBD_METHOD_TEST_INPUT,
    UMBD_METHOD_TEST_OUTPUT,
    UMBD_METHOD_TEST_DUPLEX,
#endif
    UMBD_METHOD_UNKNOWN, /* any other path */
    UMBD_METHOD_COUNT,
};

enum umbd_abuse {
    UMBD_ABUSE_CONTROL = 0, /* cheap frames */
    UMBD_ABUSE_HEADERS,     /* header lists over the limit */
    UMBD_ABUSE_RESET_SENT,  /* streams that the peer made us reset */
    UMBD_ABUSE_LIBRARY,     /* nghttp2 ended the connection */
    UMBD_ABUSE_TIMEOUT,     /* a timer ended it */
    UMBD_ABUSE_QUEUE,       /* frames that the peer caused and did not read */
    UMBD_ABUSE_COUNT,
};

#define UMBD_GRPC_CODES   17
#define UMBD_TIME_BUCKETS 15 /* upper bounds 50 us .. 5 s, see daemon_metrics.c */

/* Histogram of durations: the number in each bucket, and their sum. */
struct umbd_histogram {
    atomic_uint_fast64_t buckets[UMBD_TIME_BUCKETS + 1];
    atomic_uint_fast64_t sum_ns;
};

struct umbd_metrics {
    atomic_uint_fast64_t started[UMBD_METHOD_COUNT];
    atomic_uint_fast64_t handled[UMBD_METHOD_COUNT][UMBD_GRPC_CODES];
    struct umbd_histogram handling[UMBD_METHOD_COUNT];
    struct umbd_histogram queued; /* from a batch's submission to a worker's first slice of it */
    atomic_uint_fast64_t points;  /* points answered */
    atomic_uint_fast64_t volume_queries[UMBW_VOLUME_QUERY_COUNT]; /* records answered */
    atomic_uint_fast64_t batches_started; /* batches whose first point was looked up */
    atomic_uint_fast64_t shed;
    atomic_uint_fast64_t abuse[UMBD_ABUSE_COUNT];
    atomic_uint_fast64_t tls_failures;
    atomic_uint_fast64_t unauthorized;
    atomic_uint_fast64_t rate_limited;
    atomic_uint_fast64_t loads, load_ms; /* loads of assets, failed ones too */
    atomic_uint_fast64_t load_failed_damaged, load_failed_machine;
    atomic_uint_fast64_t connections_opened;
    atomic_uint_fast64_t connections_refused;
    atomic_uint_fast64_t connections_evicted;
    atomic_uint_fast64_t connections_retired;
    atomic_uint_fast64_t handshakes_refused;
    atomic_int_fast64_t connections; /* open now */
    atomic_int_fast64_t strangers;   /* Number of those without rights */
};

/* Values that are read at the moment of a scrape. */
struct umbd_gauges {
    struct umbs_store_counts assets;
    size_t queue_depth;
    uint64_t buffered_bytes;
    int ready;
    struct umbj_counters *jobs; /* NULL without --jobs */
    struct umbj_tiles tiles;    /* tiles of the running jobs */
};

static inline void umbd_count(atomic_uint_fast64_t *counter, uint64_t n)
{
    atomic_fetch_add_explicit(counter, n, memory_order_relaxed);
}

/* Counts a finished call. code: 0..16. */
void umbd_metrics_handled(struct umbd_metrics *metrics, enum umbd_method method, int code,
                          uint64_t duration_ns);

/* Counts what a scan of the store loaded. */
void umbd_metrics_scanned(struct umbd_metrics *metrics, const struct umbs_store_report *report);

/* Counts a duration. */
void umbd_observe(struct umbd_histogram *histogram, uint64_t duration_ns);

/* Renders everything; free() the text. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_metrics_text(struct umbd_metrics *metrics,
                                              const struct umbd_gauges *gauges, char **text,
                                              size_t *size);

#endif
