/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The Prometheus text format (version 0.0.4). The metrics named grpc_server_... have the names that
 * dashboards of the gRPC ecosystem use.
 */
#include "daemon/base/daemon_metrics.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tool/clock.h"
#include "grpc/grpc.h"
#include "umbrage/version.h"

static const char *const abuse_names[UMBD_ABUSE_COUNT] = {
    "control", "headers", "reset_sent", "library", "timeout", "queue", "request"};

/* Statuses of replies by HTTP/1.1. The last one also stands for any other. */
static const int http_codes[UMBD_HTTP_CODES] = {200, 204, 206, 304, 400, 401, 403, 404,
                                                405, 412, 413, 414, 416, 417, 421, 429,
                                                431, 499, 501, 503, 505, 500};

/* Upper bounds of the buckets in nanoseconds, and as Prometheus writes them
 * (docs/reference/operations.md). */
static const uint64_t bounds_ns[UMBD_TIME_BUCKETS] = {
    50000,    100000,   250000,    500000,    1000000,   2500000,    5000000,    10000000,
    25000000, 50000000, 100000000, 250000000, 500000000, 1000000000, 5000000000,
};
static const char *const bounds_text[UMBD_TIME_BUCKETS] = {
    "5e-05", "0.0001", "0.00025", "0.0005", "0.001", "0.0025", "0.005", "0.01",
    "0.025", "0.05",   "0.1",     "0.25",   "0.5",   "1",      "5",
};

static unsigned long long get(atomic_uint_fast64_t *counter)
{
    return (unsigned long long)atomic_load_explicit(counter, memory_order_relaxed);
}

void umbd_observe(struct umbd_histogram *histogram, uint64_t duration_ns)
{
    size_t bucket = 0;
    while (bucket < UMBD_TIME_BUCKETS && duration_ns > bounds_ns[bucket]) {
        bucket++;
    }
    umbd_count(&histogram->buckets[bucket], 1);
    umbd_count(&histogram->sum_ns, duration_ns);
}

void umbd_metrics_started(struct umbd_metrics *metrics, const struct umbd_method *method)
{
    umbd_count(&metrics->calls[method - metrics->methods].started, 1);
}

void umbd_metrics_handled(struct umbd_metrics *metrics, const struct umbd_method *method, int code,
                          uint64_t duration_ns)
{
    struct umbd_method_counts *counts = &metrics->calls[method - metrics->methods];
    if (code < 0 || code >= UMBD_GRPC_CODES) {
        code = UMBW_GRPC_UNKNOWN;
    }
    umbd_count(&counts->handled[code], 1);
    umbd_observe(&counts->handling, duration_ns);
}

void umbd_metrics_http(struct umbd_metrics *metrics, int status, uint64_t duration_ns)
{
    size_t i = 0;
    while (i + 1 < UMBD_HTTP_CODES && http_codes[i] != status) {
        i++;
    }
    umbd_count(&metrics->http_requests[i], 1);
    umbd_observe(&metrics->http_handling, duration_ns);
}

void umbd_metrics_scanned(struct umbd_metrics *metrics, const struct umbs_store_report *report)
{
    umbd_count(&metrics->loads, report->loaded + report->failed);
    umbd_count(&metrics->load_ms, report->load_ms);
    umbd_count(&metrics->load_failed_machine, report->failed_machine);
    umbd_count(&metrics->load_failed_damaged, report->failed - report->failed_machine);
}

static void head(FILE *out, const char *name, const char *type, const char *help)
{
    fprintf(out, "# HELP %s %s\n# TYPE %s %s\n", name, help, name, type);
}

static void single(FILE *out, const char *name, const char *type, const char *help,
                   unsigned long long value)
{
    head(out, name, type, help);
    fprintf(out, "%s %llu\n", name, value);
}

/* Calls `write` for each row of the methods' table, including the last row, for unknown paths. */
static void each_method(FILE *out, struct umbd_metrics *metrics,
                        void (*write)(FILE *out, const char *labels, const char *type,
                                      struct umbd_method_counts *counts))
{
    static const char *const types[] = {
        [UMBD_UNARY] = "unary",
        [UMBD_CLIENT_STREAM] = "client_stream",
        [UMBD_SERVER_STREAM] = "server_stream",
        [UMBD_BIDI_STREAM] = "bidi_stream",
    };
    const struct umbd_method *method = metrics->methods;
    for (size_t m = 0, more = method != NULL; more; m++, method++) {
        char labels[200];
        const char *service = method->path != NULL ? method->path + 1 : "unknown/unknown";
        const char *slash = strchr(service, '/');
        (void)snprintf(labels, sizeof labels, "grpc_service=\"%.*s\",grpc_method=\"%s\"",
                       (int)(slash - service), service, slash + 1);
        write(out, labels, types[method->kind], &metrics->calls[m]);
        more = method->path != NULL;
    }
}

static void write_started(FILE *out, const char *labels, const char *type,
                          struct umbd_method_counts *counts)
{
    fprintf(out, "grpc_server_started_total{%s,grpc_type=\"%s\"} %llu\n", labels, type,
            get(&counts->started));
}

static void write_handled(FILE *out, const char *labels, const char *type,
                          struct umbd_method_counts *counts)
{
    for (int code = 0; code < UMBD_GRPC_CODES; code++) {
        unsigned long long value = get(&counts->handled[code]);
        if (value > 0 || code == UMBW_GRPC_OK) {
            fprintf(out, "grpc_server_handled_total{%s,grpc_type=\"%s\",grpc_code=\"%s\"} %llu\n",
                    labels, type, umbw_grpc_name(code), value);
        }
    }
}

/* The lines of one histogram. labels: "" or `name="value",...`. */
static void write_histogram(FILE *out, const char *name, const char *labels,
                            struct umbd_histogram *histogram)
{
    unsigned long long total = 0;
    const char *comma = labels[0] != '\0' ? "," : "";
    for (size_t b = 0; b <= UMBD_TIME_BUCKETS; b++) {
        total += get(&histogram->buckets[b]);
        fprintf(out, "%s_bucket{%s%sle=\"%s\"} %llu\n", name, labels, comma,
                b < UMBD_TIME_BUCKETS ? bounds_text[b] : "+Inf", total);
    }
    const char *open = labels[0] != '\0' ? "{" : "";
    const char *close = labels[0] != '\0' ? "}" : "";
    fprintf(out, "%s_sum%s%s%s %.9f\n%s_count%s%s%s %llu\n", name, open, labels, close,
            (double)get(&histogram->sum_ns) * 1e-9, name, open, labels, close, total);
}

static void write_handling(FILE *out, const char *labels, const char *type,
                           struct umbd_method_counts *counts)
{
    (void)type;
    write_histogram(out, "grpc_server_handling_seconds", labels, &counts->handling);
}

static void write_calls(FILE *out, struct umbd_metrics *metrics)
{
    head(out, "grpc_server_started_total", "counter", "Calls begun.");
    each_method(out, metrics, write_started);
    head(out, "grpc_server_handled_total", "counter", "Calls finished, by status code.");
    each_method(out, metrics, write_handled);
    head(out, "grpc_server_handling_seconds", "histogram", "Time from headers to the last byte.");
    each_method(out, metrics, write_handling);
    head(out, "umbrage_http_requests_total", "counter", "Requests by HTTP/1.1, by status.");
    for (size_t i = 0; i < UMBD_HTTP_CODES; i++) {
        const unsigned long long value = get(&metrics->http_requests[i]);
        if (value > 0 || http_codes[i] == 200) {
            fprintf(out, "umbrage_http_requests_total{code=\"%d\"} %llu\n", http_codes[i], value);
        }
    }
    head(out, "umbrage_http_seconds", "histogram", "Time from a head to the reply's last byte.");
    write_histogram(out, "umbrage_http_seconds", "", &metrics->http_handling);
    head(out, "umbrage_queue_seconds", "histogram", "Time that batches wait for a worker.");
    write_histogram(out, "umbrage_queue_seconds", "", &metrics->queued);
}

/* Number of calls that have begun and not ended. */
static long long inflight(struct umbd_metrics *metrics)
{
    long long open = 0;
    for (size_t m = 0; m < UMBD_METHODS_MAX; m++) {
        open += (long long)get(&metrics->calls[m].started);
        for (size_t code = 0; code < UMBD_GRPC_CODES; code++) {
            open -= (long long)get(&metrics->calls[m].handled[code]);
        }
    }
    return open;
}

/* One line of a family whose series differ in one label. */
static void labelled(FILE *out, const char *name, const char *label, const char *value,
                     unsigned long long count)
{
    fprintf(out, "%s{%s=\"%s\"} %llu\n", name, label, value, count);
}

static void write_counters(FILE *out, struct umbd_metrics *metrics)
{
    static const char *const kinds[] = {"segments", "columns", "boxes"};
#define COUNTER(field, name, help) single(out, name, "counter", help, get(&metrics->field));
    UMBD_COUNTERS(COUNTER)
#undef COUNTER
    head(out, "umbrage_volume_queries_total", "counter", "Segments, columns and boxes answered.");
    for (size_t q = 0; q < UMBW_VOLUME_QUERY_COUNT; q++) {
        labelled(out, "umbrage_volume_queries_total", "kind", kinds[q],
                 get(&metrics->volume_queries[q]));
    }
    head(out, "umbrage_h2_abuse_total", "counter", "Connections or streams cut, by cause.");
    for (size_t k = 0; k < UMBD_ABUSE_COUNT; k++) {
        labelled(out, "umbrage_h2_abuse_total", "kind", abuse_names[k], get(&metrics->abuse[k]));
    }
    head(out, "umbrage_asset_errors_total", "counter",
         "Loads that failed: the file is damaged, or the machine lacked something.");
    labelled(out, "umbrage_asset_errors_total", "reason", "damaged",
             get(&metrics->load_failed_damaged));
    labelled(out, "umbrage_asset_errors_total", "reason", "machine",
             get(&metrics->load_failed_machine));
    head(out, "umbrage_asset_load_seconds", "summary", "Time to open or expand an asset.");
    fprintf(out, "umbrage_asset_load_seconds_sum %.3f\numbrage_asset_load_seconds_count %llu\n",
            (double)get(&metrics->load_ms) * 1e-3, get(&metrics->loads));
}

static void write_gauges(FILE *out, struct umbd_metrics *metrics, const struct umbd_gauges *gauges)
{
    const struct umbs_store_counts *assets = &gauges->assets;
    const struct {
        const char *name, *type, *help;
        long long value;
    } rows[] = {
        {"umbrage_inflight", "gauge", "Calls begun and not finished.", inflight(metrics)},
        {"umbrage_queue_depth", "gauge", "Batches waiting for a worker.",
         (long long)gauges->queue_depth},
        {"umbrage_connections", "gauge", "Connections open.",
         (long long)atomic_load(&metrics->connections)},
        {"umbrage_connections_without_rights", "gauge",
         "Connections open of which no call had rights.",
         (long long)atomic_load(&metrics->strangers)},
        {"umbrage_buffered_bytes", "gauge", "Bytes of requests and replies held.",
         (long long)gauges->buffered_bytes},
        {"umbrage_asset_loaded", "gauge", "Assets that answer.", (long long)assets->healthy},
        {"umbrage_asset_damaged", "gauge", "Files of the store that cannot answer.",
         (long long)assets->damaged},
        {"umbrage_asset_bytes", "gauge", "Bytes that queries of all healthy assets read.",
         (long long)assets->memory_bytes},
        {"umbrage_sigbus_total", "counter",
         "Assets set aside because their mapped file was cut or changed in use.",
         (long long)assets->faults},
        {"umbrage_scrubs_total", "counter", "Checks again that found an asset whole.",
         (long long)assets->scrubbed},
        {"umbrage_scrub_last_success_timestamp_seconds", "gauge",
         "Unix time of the last such check, 0 before the first.", (long long)assets->scrubbed_at},
        {"umbrage_ready", "gauge", "1 while serving, 0 while draining.", gauges->ready != 0},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) { /* counters are not read at once */
        single(out, rows[i].name, rows[i].type, rows[i].help,
               rows[i].value > 0 ? (unsigned long long)rows[i].value : 0);
    }
    head(out, "umbrage_build_info", "gauge", "Version of this program.");
    fprintf(out, "umbrage_build_info{version=\"%s\"} 1\n", UMB_VERSION_TEXT);
}

static void write_jobs(FILE *out, struct umbj_counters *jobs, const struct umbj_tiles *tiles)
{
    head(out, "umbrage_jobs", "gauge", "Bake jobs that the table knows, by state.");
    for (int i = 0; i < UMBJ_STATE_COUNT; i++) {
        const long long count = (long long)atomic_load(&jobs->states[i]);
        labelled(out, "umbrage_jobs", "state", umbj_state_name((enum umbj_state)i),
                 count > 0 ? (unsigned long long)count : 0);
    }
    head(out, "umbrage_job_failures_total", "counter", "Tries of jobs that failed, by class.");
    for (int i = UMBJ_REJECTED; i < UMBJ_FAILURE_COUNT; i++) {
        labelled(out, "umbrage_job_failures_total", "class",
                 umbj_failure_name((enum umbj_failure)i), get(&jobs->failures[i]));
    }
    head(out, "umbrage_job_task_failures_total", "counter",
         "Tasks that a farm had to be given again, or that ended a try, by class.");
    for (int i = UMBJ_REJECTED; i < UMBJ_FAILURE_COUNT; i++) {
        labelled(out, "umbrage_job_task_failures_total", "class",
                 umbj_failure_name((enum umbj_failure)i), get(&jobs->task_failures[i]));
    }
    head(out, "umbrage_jobs_refused_total", "counter",
         "Submissions, and assets at publishing, that a quota refused.");
    for (int i = 0; i < UMBJ_QUOTA_COUNT; i++) {
        labelled(out, "umbrage_jobs_refused_total", "quota", umbj_quota_name((enum umbj_quota)i),
                 get(&jobs->refused[i]));
    }
    head(out, "umbrage_job_owned_bytes", "gauge",
         "Bytes of assets that jobs made, added up over their owners.");
    fprintf(out, "umbrage_job_owned_bytes %lld\n", (long long)atomic_load(&jobs->owned_bytes));
    single(out, "umbrage_job_damaged_rows_total", "counter",
           "Rows of the job table that were not sound.", get(&jobs->damaged_rows));
    single(out, "umbrage_jobs_submitted_total", "counter", "Jobs accepted.", get(&jobs->submitted));
    head(out, "umbrage_job_bake_seconds", "summary", "Time from the start of a bake to its asset.");
    fprintf(out, "umbrage_job_bake_seconds_sum %.3f\numbrage_job_bake_seconds_count %llu\n",
            (double)get(&jobs->bake_ms) * 1e-3, get(&jobs->finished));
    head(out, "umbrage_job_tiles", "gauge", "Tiles of the jobs that run, by state.");
    labelled(out, "umbrage_job_tiles", "state", "waiting", tiles->total - tiles->done);
    labelled(out, "umbrage_job_tiles", "state", "done", tiles->done);
    head(out, "umbrage_job_tiles_total", "counter",
         "Tiles of jobs that were baked, or found kept.");
    labelled(out, "umbrage_job_tiles_total", "how", "baked", get(&jobs->tiles_baked));
    labelled(out, "umbrage_job_tiles_total", "how", "found", get(&jobs->tiles_found));
}

/* Resident pages from /proc; 0 if there is no such file. */
static unsigned long long resident_bytes(void)
{
    unsigned long long total = 0;
    unsigned long long resident = 0;
    FILE *file = fopen("/proc/self/statm", "re");
    if (file != NULL) {
        if (fscanf(file, "%llu %llu", &total, &resident) != 2) {
            resident = 0;
        }
        fclose(file);
    }
    return resident * (unsigned long long)sysconf(_SC_PAGESIZE);
}

static void write_process(FILE *out)
{
    single(out, "process_resident_memory_bytes", "gauge", "Resident memory.", resident_bytes());
    head(out, "process_cpu_seconds_total", "counter", "CPU time, user and system.");
    fprintf(out, "process_cpu_seconds_total %.9f\n", umbu_process_cpu_s());
}

enum umb_status umbd_metrics_text(struct umbd_metrics *metrics, const struct umbd_gauges *gauges,
                                  char **text, size_t *size)
{
    *text = NULL;
    *size = 0;
    FILE *out = open_memstream(text, size);
    if (out == NULL) {
        return UMB_E_NO_MEMORY;
    }
    write_calls(out, metrics);
    write_counters(out, metrics);
    write_gauges(out, metrics, gauges);
    if (gauges->jobs != NULL) {
        write_jobs(out, gauges->jobs, &gauges->tiles);
    }
    write_process(out);
    int bad = ferror(out);
    /* glibc's fclose succeeds even if its last realloc failed; then there is no text. */
    if (fclose(out) != 0 || bad || *text == NULL) {
        free(*text);
        *text = NULL;
        return UMB_E_NO_MEMORY;
    }
    return UMB_OK;
}
