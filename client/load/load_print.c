/* SPDX-License-Identifier: Apache-2.0 */
/* The result of a load test as text, as JSON and as a page, see load_print.h. */
#include "load/load_print.h"

#include <inttypes.h>
#include <math.h>
#include "tool/report.h"

#define CURVE_POINTS 121
#define CURVE_NINES  4.3 /* last share of the curve: 1 - 10^-4.3, 99.995 % */

extern const unsigned char umbu_page_load_page[];
extern const size_t umbu_page_load_page_size;

/* Percentiles of the report. */
#define SHARES 7

static const double SHARE[SHARES] = {0.5, 0.75, 0.9, 0.99, 0.999, 0.9999, 1};
static const char *const SHARE_NAME[SHARES] = {"p50",   "p75",    "p90", "p99",
                                               "p99.9", "p99.99", "max"};

static double percentile_ms(const struct umbc_load_result *result, size_t share)
{
    return 1e-6 * (double)umbc_histogram_percentile(&result->latency, SHARE[share]);
}

/* "camera", "random", "boundary" or the name of the trace. */
static const char *kind_name(const struct umbc_load_source *source)
{
    static const char *const names[] = {"camera", "random", "boundary"};
    return source->kind == UMBC_LOAD_TRACE ? source->trace : names[source->kind];
}

/* Returns the reason for which a result is doubtful, or NULL. */
static const char *doubt_of(const struct umbc_load_test *test)
{
    if (test->result.seconds > 0 && !test->result.counts) {
        return "This run does not count: the generator used more than 70 % of a core, and may have "
               "measured itself.";
    }
    return NULL;
}

static void print_errors(FILE *file, const struct umbc_load_result *result)
{
    (void)fprintf(file, "errors     %" PRIu64, result->error_count);
    for (size_t i = 0; i < UMBC_LOAD_STATUSES; i++) {
        if (result->errors[i] > 0) {
            (void)fprintf(file, "  %s %" PRIu64, umb_status_name((enum umb_status) - (int)i),
                          result->errors[i]);
        }
    }
    if (result->rate > 0) {
        (void)fprintf(file, "  (%" PRIu64 " calls were due and never sent)", result->unsent);
    }
    (void)fputc('\n', file);
}

static void print_result(FILE *file, const struct umbc_load_test *test)
{
    const struct umbc_load_result *result = &test->result;
    double seconds = result->seconds;
    if (result->rate > 0) {
        (void)fprintf(file, "asked      %.6g calls/s, constant (open loop)\n", result->rate);
    } else {
        (void)fprintf(file, "asked      %u connections x %u calls under way (closed loop)\n",
                      test->options.settings.connections, test->options.settings.in_flight);
    }
    (void)fprintf(file, "answered   %.6g calls/s, %.4g Mpoints/s, in %.2f s\n",
                  (double)result->calls / seconds, 1e-6 * (double)result->points / seconds,
                  seconds);
    (void)fputs("latency   ", file);
    for (size_t i = 0; i < SHARES; i++) {
        (void)fprintf(file, " %s %.3g ", SHARE_NAME[i], percentile_ms(result, i));
    }
    (void)fputs(" ms\n", file);
    print_errors(file, result);
    if (result->has_server) {
        (void)fprintf(
            file, "daemon     %.3g us a call, %.4g ns a point, %.2f cores, at most %.0f MiB\n",
            1e6 * result->server_cpu_s / (result->calls > 0 ? (double)result->calls : 1),
            1e9 * result->server_cpu_s / (result->server_points > 0 ? result->server_points : 1),
            result->server_cpu_s / result->server_s, result->server_rss_max / 1048576);
    } else if (test->options.settings.admin != NULL) {
        (void)fputs("daemon     sent no figures at the end\n", file);
    }
    (void)fprintf(file, "generator  %.2f cores\n", result->generator_cores);
}

void umbc_load_print_text(FILE *file, const struct umbc_load_test *test)
{
    if (test->options.sweep && test->sweep.knee <= 0) {
        (void)fprintf(file, "no knee: %.6g calls/s do not keep p99 within %.3g ms\n",
                      test->sweep.steps[0].rate, test->sweep.bound_ms);
        return;
    }
    if (test->options.sweep) {
        (void)fprintf(file, "knee       %.6g calls/s keep p99 within %.3g ms\n", test->sweep.knee,
                      test->sweep.bound_ms);
    }
    print_result(file, test);
    if (doubt_of(test) != NULL) {
        (void)fprintf(file, "%s\n", doubt_of(test));
    }
}

static void json_settings(struct umbu_json *json, const struct umbc_load_test *test)
{
    const struct umbc_load_options *options = &test->options;
    const struct umbc_load_settings *settings = &options->settings;
    umbu_json_text(json, "asset", settings->asset);
    umbc_json_id(json, "asset_id", test->about->asset.id);
    umbu_json_text(json, "address", settings->address);
    umbu_json_text(json, "loop", settings->rate > 0 || options->sweep ? "open" : "closed");
    UMBU_JSON_COUNTS(json, {"connections", settings->connections},
                     {"in_flight", settings->in_flight}, {"batch", options->source.batch},
                     {"taps", settings->query.taps});
    umbu_json_bool(json, "stream", settings->stream);
    umbu_json_text(json, "points", kind_name(&options->source));
}

static void json_result(struct umbu_json *json, const struct umbc_load_result *result)
{
    double seconds = result->seconds;
    umbu_json_integer(json, "calls", result->calls);
    UMBU_JSON_VALUES(json, 17, {"rate", result->rate}, {"seconds", seconds},
                     {"calls_s", (double)result->calls / seconds},
                     {"points_s", (double)result->points / seconds});
    umbu_json_begin(json, "latency", '{');
    umbu_json_integer(json, "count", result->latency.count);
    UMBU_JSON_VALUES(json, 17, {"mean_ms", 1e-6 * umbc_histogram_mean(&result->latency)},
                     {"min_ms", 1e-6 * (double)result->latency.min_ns});
    for (size_t i = 0; i < SHARES; i++) {
        char key[16];
        (void)snprintf(key, sizeof key, "%s_ms", SHARE_NAME[i]);
        umbu_json_number(json, key, percentile_ms(result, i));
    }
    umbu_json_end(json, '}');
    umbu_json_integer(json, "error_count", result->error_count);
    umbu_json_begin(json, "errors", '{');
    for (size_t i = 0; i < UMBC_LOAD_STATUSES; i++) {
        if (result->errors[i] > 0) {
            umbu_json_integer(json, umb_status_name((enum umb_status) - (int)i), result->errors[i]);
        }
    }
    umbu_json_end(json, '}');
    umbu_json_integer(json, "unsent", result->unsent);
    umbu_json_number(json, "generator_cores", result->generator_cores);
    umbu_json_bool(json, "counts", result->counts);
    if (result->has_server) {
        umbu_json_begin(json, "server", '{');
        const double points = result->server_points > 0 ? result->server_points : 1;
        UMBU_JSON_VALUES(json, 17, {"cpu_s", result->server_cpu_s},
                         {"cores", result->server_cpu_s / result->server_s},
                         {"points", result->server_points},
                         {"cpu_ns_a_point", 1e9 * result->server_cpu_s / points},
                         {"rss_max_bytes", result->server_rss_max}, {"shed", result->server_shed});
        umbu_json_end(json, '}');
    }
}

static void json_moments(struct umbu_json *json, const struct umbc_load_result *result)
{
    umbu_json_begin(json, "moments", '[');
    for (size_t i = 0; i < result->moment_count; i++) {
        const struct umbc_load_moment *moment = &result->moments[i];
        umbu_json_begin(json, NULL, '{');
        UMBU_JSON_VALUES(json, 17, {"at_s", moment->at_s}, {"calls_s", moment->calls_s},
                         {"errors_s", moment->errors_s}, {"p50_ms", moment->p50_ms},
                         {"p99_ms", moment->p99_ms});
        if (moment->server_rss > 0) {
            umbu_json_number(json, "server_rss", moment->server_rss);
        }
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

static void json_sweep(struct umbu_json *json, const struct umbc_load_sweep *sweep)
{
    umbu_json_begin(json, "sweep", '{');
    UMBU_JSON_VALUES(json, 17, {"bound_ms", sweep->bound_ms}, {"knee", sweep->knee});
    umbu_json_begin(json, "steps", '[');
    for (size_t i = 0; i < sweep->step_count; i++) {
        const struct umbc_load_step *step = &sweep->steps[i];
        umbu_json_begin(json, NULL, '{');
        umbu_json_integer(json, "failed", step->failed);
        UMBU_JSON_VALUES(json, 17, {"rate", step->rate}, {"calls_s", step->calls_s},
                         {"p50_ms", step->p50_ms}, {"p99_ms", step->p99_ms},
                         {"generator_cores", step->generator_cores});
        umbu_json_bool(json, "kept", step->kept);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
    umbu_json_end(json, '}');
}

/* Writes the members of the JSON object. */
static void put_members(struct umbu_json *json, const struct umbc_load_test *test)
{
    json_settings(json, test);
    if (test->result.seconds > 0) {
        json_result(json, &test->result);
        json_moments(json, &test->result);
    }
    if (test->options.sweep) {
        json_sweep(json, &test->sweep);
    }
}

void umbc_load_print_json(FILE *file, const struct umbc_load_test *test)
{
    struct umbu_json json = umbu_json_open(file);
    put_members(&json, test);
    umbu_json_close(&json);
}

/* Writes the data of the page: the members of --json, the percentiles as a curve, and a note if the
 * result is doubtful. */
static void put_data(struct umbu_json *json, const void *user)
{
    const struct umbc_load_test *test = user;
    put_members(json, test);
    if (doubt_of(test) != NULL) {
        umbu_json_text(json, "doubt", doubt_of(test));
    }
    umbu_json_begin(json, "curve", '[');
    for (size_t i = 0; i < CURVE_POINTS; i++) {
        const double share = 1 - pow(10, -CURVE_NINES * (double)i / (CURVE_POINTS - 1));
        umbu_json_begin(json, NULL, '[');
        umbu_json_number(json, NULL, share);
        umbu_json_number(json, NULL,
                         1e-6 * (double)umbc_histogram_percentile(&test->result.latency, share));
        umbu_json_end(json, ']');
    }
    umbu_json_end(json, ']');
}

void umbc_load_print_page(FILE *file, const struct umbc_load_test *test)
{
    const struct umbu_report report = {
        .title = "umbrage load",
        .page = umbu_page_load_page,
        .page_size = umbu_page_load_page_size,
        .data = put_data,
        .user = test,
    };
    umbu_report_print(file, &report);
}
