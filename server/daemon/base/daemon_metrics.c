/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The Prometheus text format (version 0.0.4). The grpc_server_ names are those that existing
 * dashboards of the gRPC ecosystem read.
 */
#include "daemon/base/daemon_metrics.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "tool/clock.h"
#include "wire/grpc.h"
#include "umbrage/version.h"

struct method_name {
    const char *service, *method, *type;
};

static const struct method_name method_names[UMBD_METHOD_COUNT] = {
    {"umbrage.v1.Shadows", "Query", "unary"},
    {"umbrage.v1.Shadows", "QueryStream", "bidi_stream"},
    {"umbrage.v1.Shadows", "Describe", "unary"},
    {"umbrage.v1.Shadows", "List", "unary"},
    {"umbrage.v1.Shadows", "Limits", "unary"},
    {"umbrage.v1.Bakes", "Submit", "client_stream"},
    {"umbrage.v1.Bakes", "Watch", "server_stream"},
    {"umbrage.v1.Bakes", "Cancel", "unary"},
    {"umbrage.v1.Bakes", "List", "unary"},
    {"umbrage.v1.Bakes", "Fetch", "server_stream"},
    {"umbrage.v1.Bakes", "Delete", "unary"},
    {"umbrage.v1.Regions", "Stream", "server_stream"},
    {"umbrage.v1.Regions", "Follow", "bidi_stream"},
    {"umbrage.v1.Regions", "DeriveMap", "server_stream"},
    {"umbrage.v1.Questions", "Segments", "unary"},
    {"umbrage.v1.Questions", "Columns", "unary"},
    {"umbrage.v1.Questions", "Boxes", "unary"},
    {"grpc.health.v1.Health", "Check", "unary"},
    {"grpc.health.v1.Health", "Watch", "server_stream"},
    {"grpc.reflection.v1.ServerReflection", "ServerReflectionInfo", "bidi_stream"},
    {"grpc.reflection.v1alpha.ServerReflection", "ServerReflectionInfo", "bidi_stream"},
#ifdef UMBRAGE_TEST_SERVICE
    {"grpc.testing.TestService", "EmptyCall", "unary"},
    {"grpc.testing.TestService", "UnaryCall", "unary"},
    {"grpc.testing.TestService", "StreamingInputCall", "client_stream"},
    {"grpc.testing.TestService", "StreamingOutputCall", "server_stream"},
    {"grpc.testing.TestService", "FullDuplexCall", "bidi_stream"},
#endif
    {"unknown", "unknown", "unary"},
};

static const char *const abuse_names[UMBD_ABUSE_COUNT] = {"control", "headers", "reset_sent",
                                                          "library", "timeout", "queue"};

/* Upper bounds in nanoseconds, and as Prometheus writes them (docs/reference/operations.md). */
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

void umbd_metrics_handled(struct umbd_metrics *metrics, enum umbd_method method, int code,
                          uint64_t duration_ns)
{
    if (code < 0 || code >= UMBD_GRPC_CODES) {
        code = UMBW_GRPC_UNKNOWN;
    }
    umbd_count(&metrics->handled[method][code], 1);
    umbd_observe(&metrics->handling[method], duration_ns);
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

static void write_calls(FILE *out, struct umbd_metrics *metrics)
{
    head(out, "grpc_server_started_total", "counter", "Calls begun.");
    for (size_t m = 0; m < UMBD_METHOD_COUNT; m++) {
        fprintf(
            out,
            "grpc_server_started_total{grpc_service=\"%s\",grpc_method=\"%s\",grpc_type=\"%s\"} "
            "%llu\n",
            method_names[m].service, method_names[m].method, method_names[m].type,
            get(&metrics->started[m]));
    }
    head(out, "grpc_server_handled_total", "counter", "Calls finished, by status code.");
    for (size_t m = 0; m < UMBD_METHOD_COUNT; m++) {
        for (int code = 0; code < UMBD_GRPC_CODES; code++) {
            unsigned long long value = get(&metrics->handled[m][code]);
            if (value > 0 || code == UMBW_GRPC_OK) {
                fprintf(out,
                        "grpc_server_handled_total{grpc_service=\"%s\",grpc_method=\"%s\","
                        "grpc_type=\"%s\",grpc_code=\"%s\"} %llu\n",
                        method_names[m].service, method_names[m].method, method_names[m].type,
                        umbw_grpc_name(code), value);
            }
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

static void write_times(FILE *out, struct umbd_metrics *metrics)
{
    head(out, "grpc_server_handling_seconds", "histogram", "Time from headers to the last byte.");
    for (size_t m = 0; m < UMBD_METHOD_COUNT; m++) {
        const struct method_name *name = &method_names[m];
        char labels[160];
        (void)snprintf(labels, sizeof labels, "grpc_service=\"%s\",grpc_method=\"%s\"",
                       name->service, name->method);
        write_histogram(out, "grpc_server_handling_seconds", labels, &metrics->handling[m]);
    }
    head(out, "umbrage_queue_seconds", "histogram", "Time that batches wait for a worker.");
    write_histogram(out, "umbrage_queue_seconds", "", &metrics->queued);
}

/* Number of calls that have begun and not ended. */
static unsigned long long inflight(struct umbd_metrics *metrics)
{
    long long open = 0;
    for (size_t m = 0; m < UMBD_METHOD_COUNT; m++) {
        open += (long long)get(&metrics->started[m]);
        for (size_t code = 0; code < UMBD_GRPC_CODES; code++) {
            open -= (long long)get(&metrics->handled[m][code]);
        }
    }
    return open > 0 ? (unsigned long long)open : 0; /* the counters are not read at one moment */
}

/* Failed loads, by cause: the file's fault or the machine's. */
static void write_asset_errors(FILE *out, struct umbd_metrics *metrics)
{
    unsigned long long machine = get(&metrics->load_failed_machine);
    head(out, "umbrage_asset_errors_total", "counter",
         "Loads that failed: the file is damaged, or the machine lacked something.");
    fprintf(out,
            "umbrage_asset_errors_total{reason=\"damaged\"} %llu\n"
            "umbrage_asset_errors_total{reason=\"machine\"} %llu\n",
            get(&metrics->load_failed_damaged), machine);
}

static void write_own(FILE *out, struct umbd_metrics *metrics, const struct umbd_gauges *gauges)
{
    single(out, "umbrage_queries_total", "counter", "Points answered.", get(&metrics->points));
    head(out, "umbrage_volume_queries_total", "counter", "Segments, columns and boxes answered.");
    for (size_t q = 0; q < UMBW_VOLUME_QUERY_COUNT; q++) {
        static const char *const names[] = {"segments", "columns", "boxes"};
        fprintf(out, "umbrage_volume_queries_total{kind=\"%s\"} %llu\n", names[q],
                get(&metrics->volume_queries[q]));
    }
    single(out, "umbrage_batches_started_total", "counter", "Batches whose work was begun.",
           get(&metrics->batches_started));
    single(out, "umbrage_inflight", "gauge", "Calls begun and not finished.", inflight(metrics));
    single(out, "umbrage_queue_depth", "gauge", "Batches waiting for a worker.",
           gauges->queue_depth);
    single(out, "umbrage_shed_total", "counter", "Calls refused for lack of room.",
           get(&metrics->shed));
    long long open = (long long)atomic_load(&metrics->connections);
    single(out, "umbrage_connections", "gauge", "Connections open.",
           open > 0 ? (unsigned long long)open : 0);
    long long strangers = (long long)atomic_load(&metrics->strangers);
    single(out, "umbrage_connections_without_rights", "gauge",
           "Connections open of which no call had rights.",
           strangers > 0 ? (unsigned long long)strangers : 0);
    single(out, "umbrage_handshakes_refused_total", "counter",
           "Connections refused for their address's rate of TLS handshakes.",
           get(&metrics->handshakes_refused));
    single(out, "umbrage_connections_opened_total", "counter", "Connections accepted.",
           get(&metrics->connections_opened));
    single(out, "umbrage_connections_refused_total", "counter",
           "Connections refused: too many, or no descriptor left.",
           get(&metrics->connections_refused));
    single(out, "umbrage_connections_evicted_total", "counter",
           "Idle connections closed to make room for new ones.",
           get(&metrics->connections_evicted));
    single(out, "umbrage_connections_retired_total", "counter",
           "Connections asked to go, idle or too old.", get(&metrics->connections_retired));
    single(out, "umbrage_tls_failures_total", "counter", "TLS handshakes and sessions that failed.",
           get(&metrics->tls_failures));
    single(out, "umbrage_unauthorized_total", "counter", "Calls refused for their token.",
           get(&metrics->unauthorized));
    single(out, "umbrage_rate_limited_total", "counter", "Calls refused for their rate.",
           get(&metrics->rate_limited));
    single(out, "umbrage_buffered_bytes", "gauge", "Bytes of requests and replies held.",
           gauges->buffered_bytes);
    head(out, "umbrage_h2_abuse_total", "counter", "Connections or streams cut, by cause.");
    for (size_t k = 0; k < UMBD_ABUSE_COUNT; k++) {
        fprintf(out, "umbrage_h2_abuse_total{kind=\"%s\"} %llu\n", abuse_names[k],
                get(&metrics->abuse[k]));
    }
    single(out, "umbrage_asset_loaded", "gauge", "Assets that answer.", gauges->assets.healthy);
    single(out, "umbrage_asset_damaged", "gauge", "Files of the store that cannot answer.",
           gauges->assets.damaged);
    single(out, "umbrage_asset_bytes", "gauge", "Bytes that queries of all healthy assets read.",
           gauges->assets.memory_bytes);
    single(out, "umbrage_sigbus_total", "counter",
           "Assets set aside because their mapped file was cut or changed in use.",
           gauges->assets.faults);
    write_asset_errors(out, metrics);
    head(out, "umbrage_asset_load_seconds", "summary", "Time to open or expand an asset.");
    fprintf(out, "umbrage_asset_load_seconds_sum %.3f\numbrage_asset_load_seconds_count %llu\n",
            (double)get(&metrics->load_ms) * 1e-3, get(&metrics->loads));
    single(out, "umbrage_scrubs_total", "counter", "Checks again that found an asset whole.",
           gauges->assets.scrubbed);
    single(out, "umbrage_scrub_last_success_timestamp_seconds", "gauge",
           "Unix time of the last such check, 0 before the first.",
           (unsigned long long)gauges->assets.scrubbed_at);
    single(out, "umbrage_ready", "gauge", "1 while serving, 0 while draining.",
           gauges->ready ? 1 : 0);
    head(out, "umbrage_build_info", "gauge", "Version of this program.");
    fprintf(out, "umbrage_build_info{version=\"%s\"} 1\n", UMB_VERSION_TEXT);
}

static void write_jobs(FILE *out, struct umbj_counters *jobs, const struct umbj_tiles *tiles)
{
    head(out, "umbrage_jobs", "gauge", "Bake jobs that the table knows, by state.");
    for (int i = 0; i < UMBJ_STATE_COUNT; i++) {
        fprintf(out, "umbrage_jobs{state=\"%s\"} %lld\n", umbj_state_name((enum umbj_state)i),
                (long long)atomic_load(&jobs->states[i]));
    }
    head(out, "umbrage_job_failures_total", "counter", "Tries of jobs that failed, by class.");
    for (int i = UMBJ_REJECTED; i < UMBJ_FAILURE_COUNT; i++) {
        fprintf(out, "umbrage_job_failures_total{class=\"%s\"} %llu\n",
                umbj_failure_name((enum umbj_failure)i), get(&jobs->failures[i]));
    }
    head(out, "umbrage_job_task_failures_total", "counter",
         "Tasks that a farm had to be given again, or that ended a try, by class.");
    for (int i = UMBJ_REJECTED; i < UMBJ_FAILURE_COUNT; i++) {
        fprintf(out, "umbrage_job_task_failures_total{class=\"%s\"} %llu\n",
                umbj_failure_name((enum umbj_failure)i), get(&jobs->task_failures[i]));
    }
    head(out, "umbrage_jobs_refused_total", "counter",
         "Submissions, and assets at publishing, that a quota refused.");
    for (int i = 0; i < UMBJ_QUOTA_COUNT; i++) {
        fprintf(out, "umbrage_jobs_refused_total{quota=\"%s\"} %llu\n",
                umbj_quota_name((enum umbj_quota)i), get(&jobs->refused[i]));
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
    fprintf(out,
            "umbrage_job_tiles{state=\"waiting\"} %llu\numbrage_job_tiles{state=\"done\"} %llu\n",
            (unsigned long long)(tiles->total - tiles->done), (unsigned long long)tiles->done);
    head(out, "umbrage_job_tiles_total", "counter",
         "Tiles of jobs that were baked, or found kept.");
    fprintf(out,
            "umbrage_job_tiles_total{how=\"baked\"} %llu\n"
            "umbrage_job_tiles_total{how=\"found\"} %llu\n",
            get(&jobs->tiles_baked), get(&jobs->tiles_found));
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
    write_times(out, metrics);
    write_own(out, metrics, gauges);
    if (gauges->jobs != NULL) {
        write_jobs(out, gauges->jobs, &gauges->tiles);
    }
    write_process(out);
    int bad = ferror(out);
    /* glibc's fclose succeeds even if its last realloc failed; there is no text then. */
    if (fclose(out) != 0 || bad || *text == NULL) {
        free(*text);
        *text = NULL;
        return UMB_E_NO_MEMORY;
    }
    return UMB_OK;
}
