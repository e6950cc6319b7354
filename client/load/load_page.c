/* SPDX-License-Identifier: Apache-2.0 */
/* The result of a load test as a page, see load_print.h. */
#include <inttypes.h>
#include <math.h>
#include <string.h>
#include "tool/base.h"
#include "load/load_plot.h"
#include "load/load_print.h"

#define CURVE_POINTS 121
#define CURVE_NINES  4.3 /* 99.995 % */

static const char HEAD[] =
    "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
    "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
    "<title>umbrage load</title>\n<style>\n"
    ":root { --bg: #ffffff; --ink: #1b1f24; --soft: #5b6570; --line: #d8dde3; --card: #f6f8fa;\n"
    "  --c0: #0b62b8; --c1: #c2410c; --c2: #15803d; }\n"
    "@media (prefers-color-scheme: dark) {\n"
    "  :root { --bg: #111418; --ink: #e6e9ec; --soft: #9aa5b1; --line: #303842; --card: #1a1f25;\n"
    "    --c0: #6cb2ff; --c1: #ff9a5c; --c2: #5fd38d; } }\n"
    "* { box-sizing: border-box; }\n"
    "body { margin: 0 auto; max-width: 1000px; padding: 16px; background: var(--bg);\n"
    "  color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }\n"
    "h1 { font-size: 1.5rem; margin: 0 0 4px; } h2 { font-size: 1.15rem; margin: 28px 0 8px; }\n"
    ".soft { color: var(--soft); overflow-wrap: anywhere; }\n"
    ".doubt { background: var(--card); border-left: 4px solid var(--c1); padding: 10px 14px; }\n"
    ".figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(140px, 1fr));\n"
    "  gap: 10px; margin: 14px 0; }\n"
    ".figures div { background: var(--card); padding: 8px 12px; border-radius: 4px; }\n"
    ".figures b { display: block; font-size: 1.3rem; font-variant-numeric: tabular-nums; }\n"
    ".charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 400px), "
    "1fr));\n"
    "  gap: 18px; }\n"
    "figure { margin: 0; } figcaption { font-size: .85rem; color: var(--soft); }\n"
    "svg { width: 100%; height: auto; display: block; }\n"
    "svg text { fill: var(--soft); font-size: 12px; } svg .grid { stroke: var(--line); }\n"
    "svg .line { fill: none; stroke-width: 1.8; stroke-linejoin: round; }\n"
    "svg .k0 { stroke: var(--c0); } svg .k1 { stroke: var(--c1); } svg .k2 { stroke: var(--c2); }\n"
    "svg .rule { stroke: var(--soft); stroke-dasharray: 5 4; }\n"
    "svg .dot { fill: var(--c0); stroke: var(--bg); } svg .dot.missed { fill: var(--bg);\n"
    "  stroke: var(--c1); stroke-width: 2; }\n"
    ".c0 { color: var(--c0); } .c1 { color: var(--c1); } .c2 { color: var(--c2); }\n"
    ".scroll { overflow-x: auto; }\n"
    "table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }\n"
    "th, td { padding: 3px 12px 3px 0; text-align: right; border-bottom: 1px solid var(--line);\n"
    "  white-space: nowrap; } th { color: var(--soft); font-weight: 600; }\n"
    "th:first-child, td:first-child { text-align: left; }\n"
    "</style></head><body>\n";

/* Text from outside, harmless in HTML. */
static void put_text(FILE *file, const char *text)
{
    char clean[400];
    (void)umb__utf8_printable((const uint8_t *)text, strlen(text), clean, sizeof clean);
    for (const char *at = clean; *at != '\0'; at++) {
        switch (*at) {
        case '<':
            (void)fputs("&lt;", file);
            break;
        case '&':
            (void)fputs("&amp;", file);
            break;
        case '"':
            (void)fputs("&quot;", file);
            break;
        default:
            (void)fputc(*at, file);
        }
    }
}

static void put_title(FILE *file, const struct umbc_load_story *story)
{
    const struct umbc_load_options *options = story->options;
    const struct umbc_load_settings *settings = &options->settings;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(story->about->asset.id, id);
    (void)fputs("<h1>Load on ", file);
    put_text(file, settings->asset);
    (void)fputs("</h1>\n<p class=\"soft\">", file);
    put_text(file, settings->address);
    (void)fprintf(file,
                  " · %u connection%s · %s"
                  " · batches of %zu points, ",
                  settings->connections, settings->connections == 1 ? "" : "s",
                  settings->stream ? "one stream each" : "a call each", options->source.batch);
    put_text(file, umbc_load_kind_name(&options->source));
    (void)fprintf(file, " · %u x %u taps · asset %.16s</p>\n", (unsigned)settings->query.taps,
                  (unsigned)settings->query.taps, id);
    if (umbc_load_doubt(story) != NULL) {
        (void)fprintf(file, "<p class=\"doubt\">%s</p>\n", umbc_load_doubt(story));
    }
}

static void put_figure(FILE *file, const char *name, const char *format, double value)
{
    (void)fputs("<div><b>", file);
    (void)fprintf(file, format, value);
    (void)fprintf(file, "</b>%s</div>\n", name);
}

static void put_figures(FILE *file, const struct umbc_load_story *story)
{
    const struct umbc_load_result *result = story->result;
    (void)fputs("<div class=\"figures\">\n", file);
    if (story->sweep != NULL) {
        put_figure(file, "knee, calls a second", "%.5g", story->sweep->knee);
    }
    if (result->rate > 0) {
        put_figure(file, "asked, calls a second", "%.5g", result->rate);
    }
    put_figure(file, "answered, calls a second", "%.5g", (double)result->calls / result->seconds);
    put_figure(file, "million points a second", "%.4g",
               1e-6 * (double)result->points / result->seconds);
    put_figure(file, "median, ms", "%.3g", umbc_load_ms(result, 0));
    put_figure(file, "99th percentile, ms", "%.3g", umbc_load_ms(result, 3));
    put_figure(file, "calls that failed", "%.0f", (double)result->error_count);
    if (result->has_server && result->server_points > 0) {
        put_figure(file, "daemon, ns a point", "%.4g",
                   1e9 * result->server_cpu_s / result->server_points);
        put_figure(file, "daemon, cores", "%.2f", result->server_cpu_s / result->server_s);
    }
    put_figure(file, "generator, cores", "%.2f", result->generator_cores);
    (void)fputs("</div>\n", file);
}

static void plot_percentiles(FILE *file, const struct umbc_load_result *result)
{
    double x[CURVE_POINTS];
    double y[CURVE_POINTS];
    struct umbc_plot plot = {.file = file,
                             .title = "Latency by percentile",
                             .x_name = "percentile",
                             .y_name = "ms",
                             .x_high = CURVE_NINES,
                             .y_log = true,
                             .x_nines = true};
    for (size_t i = 0; i < CURVE_POINTS; i++) {
        x[i] = CURVE_NINES * (double)i / (CURVE_POINTS - 1);
        y[i] = 1e-6 * (double)umbc_histogram_percentile(&result->latency, 1 - pow(10, -x[i]));
        umbc_plot_hold_y(&plot, y[i]);
    }
    umbc_plot_begin(&plot);
    umbc_plot_line(&plot, "k0", x, y, CURVE_POINTS);
    umbc_plot_end(&plot,
                  result->rate > 0
                      ? "Counted from when a call was due; what was due and never sent is in "
                        "it."
                      : "Closed loop: counted from when a call was sent.");
}

/* One quantity of the run's course. */
typedef double (*moment_fn)(const struct umbc_load_moment *moment);

static double calls_of(const struct umbc_load_moment *moment)
{
    return moment->calls_s;
}

static double errors_of(const struct umbc_load_moment *moment)
{
    return moment->errors_s;
}

static double p50_of(const struct umbc_load_moment *moment)
{
    return moment->p50_ms;
}

static double p99_of(const struct umbc_load_moment *moment)
{
    return moment->p99_ms;
}

static double memory_of(const struct umbc_load_moment *moment)
{
    return moment->server_rss > 0 ? moment->server_rss / 1048576 : NAN; /* not yet known */
}

static void hold_course(struct umbc_plot *plot, const struct umbc_load_result *result,
                        moment_fn value)
{
    plot->x_low = result->moments[0].at_s;
    plot->x_high = result->moments[result->moment_count - 1].at_s;
    for (size_t i = 0; i < result->moment_count; i++) {
        umbc_plot_hold_y(plot, value(&result->moments[i]));
    }
}

static void draw_course(const struct umbc_plot *plot, const struct umbc_load_result *result,
                        moment_fn value, const char *style)
{
    double x[UMBC_LOAD_MOMENTS];
    double y[UMBC_LOAD_MOMENTS];
    for (size_t i = 0; i < result->moment_count; i++) {
        x[i] = result->moments[i].at_s;
        y[i] = value(&result->moments[i]);
    }
    umbc_plot_line(plot, style, x, y, result->moment_count);
}

static void plot_course(FILE *file, const struct umbc_load_result *result)
{
    struct umbc_plot calls = {
        .file = file, .title = "Throughput", .x_name = "seconds", .y_name = "calls/s"};
    struct umbc_plot latency = {.file = file,
                                .title = "Latency over time",
                                .x_name = "seconds",
                                .y_name = "ms",
                                .y_log = true};
    struct umbc_plot memory = {
        .file = file, .title = "Memory of the daemon", .x_name = "seconds", .y_name = "MiB"};
    hold_course(&calls, result, calls_of);
    hold_course(&calls, result, errors_of);
    umbc_plot_begin(&calls);
    umbc_plot_mark(&calls, "rule", 0);
    draw_course(&calls, result, calls_of, "k0");
    draw_course(&calls, result, errors_of, "k1");
    umbc_plot_end(&calls,
                  "<span class=\"c0\">Answered</span> and <span class=\"c1\">failed</span>; "
                  "the window begins at 0.");
    hold_course(&latency, result, p50_of);
    hold_course(&latency, result, p99_of);
    umbc_plot_begin(&latency);
    umbc_plot_mark(&latency, "rule", 0);
    draw_course(&latency, result, p50_of, "k0");
    draw_course(&latency, result, p99_of, "k1");
    umbc_plot_end(&latency, "<span class=\"c0\">Median</span> and <span class=\"c1\">99th "
                            "percentile</span> of each piece of time.");
    if (result->has_server) {
        hold_course(&memory, result, memory_of);
        umbc_plot_begin(&memory);
        draw_course(&memory, result, memory_of, "k2");
        umbc_plot_end(&memory, "Resident, maps of assets included.");
    }
}

static void plot_sweep(FILE *file, const struct umbc_load_sweep *sweep)
{
    struct umbc_plot plot = {.file = file,
                             .title = "99th percentile against rate",
                             .x_name = "calls/s asked",
                             .y_name = "ms",
                             .x_log = true,
                             .y_log = true};
    plot.x_low = plot.x_high = sweep->steps[0].rate;
    umbc_plot_hold_y(&plot, sweep->bound_ms);
    for (size_t i = 0; i < sweep->step_count; i++) {
        plot.x_high = sweep->steps[i].rate > plot.x_high ? sweep->steps[i].rate : plot.x_high;
        umbc_plot_hold_y(&plot, sweep->steps[i].p99_ms);
    }
    umbc_plot_begin(&plot);
    umbc_plot_level(&plot, "rule", sweep->bound_ms);
    umbc_plot_mark(&plot, "rule", sweep->knee);
    for (size_t i = 0; i < sweep->step_count; i++) {
        const struct umbc_load_step *step = &sweep->steps[i];
        umbc_plot_dot(&plot, step->kept ? "kept" : "missed", step->rate, step->p99_ms);
    }
    umbc_plot_end(&plot,
                  "Hollow: over the bound, or calls failed. Broken lines: the bound, and the "
                  "highest rate that was kept.");
}

static void put_percentile_table(FILE *file, const struct umbc_load_result *result)
{
    (void)fputs("<h2>Latency</h2><div class=\"scroll\"><table><tr>", file);
    for (size_t i = 0; i < UMBC_LOAD_SHARES; i++) {
        (void)fprintf(file, "<th>%s</th>", UMBC_LOAD_SHARE_NAME[i]);
    }
    (void)fputs("<th>mean</th><th>calls</th></tr><tr>", file);
    for (size_t i = 0; i < UMBC_LOAD_SHARES; i++) {
        (void)fprintf(file, "<td>%.4g</td>", umbc_load_ms(result, i));
    }
    (void)fprintf(file, "<td>%.4g</td><td>%" PRIu64 "</td></tr></table></div>\n",
                  1e-6 * umbc_histogram_mean(&result->latency), result->latency.count);
    (void)fputs("<p class=\"soft\">Milliseconds; never told too small, at most 0.8 % too "
                "large.</p>\n",
                file);
}

static void put_error_table(FILE *file, const struct umbc_load_result *result)
{
    if (result->error_count == 0 && result->unsent == 0) {
        (void)fputs("<p>No call failed.</p>\n", file);
        return;
    }
    (void)fputs("<h2>Calls without an answer</h2><table><tr><th>status</th><th>calls</th></tr>\n",
                file);
    for (size_t i = 0; i < UMBC_LOAD_STATUSES; i++) {
        if (result->errors[i] > 0) {
            (void)fprintf(file, "<tr><td>%s</td><td>%" PRIu64 "</td></tr>\n",
                          umb_status_name((enum umb_status) - (int)i), result->errors[i]);
        }
    }
    (void)fprintf(file, "<tr><td>due and never sent</td><td>%" PRIu64 "</td></tr></table>\n",
                  result->unsent);
}

static void put_sweep_table(FILE *file, const struct umbc_load_sweep *sweep)
{
    (void)fputs("<h2>Steps</h2><div class=\"scroll\"><table><tr><th>asked</th><th>answered</th>"
                "<th>p50 ms</th><th>p99 ms</th><th>failed</th><th>generator</th><th></th></tr>\n",
                file);
    for (size_t i = 0; i < sweep->step_count; i++) {
        const struct umbc_load_step *step = &sweep->steps[i];
        (void)fprintf(file,
                      "<tr><td>%.6g</td><td>%.6g</td><td>%.3g</td><td>%.3g</td><td>%" PRIu64
                      "</td><td>%.2f</td><td>%s</td></tr>\n",
                      step->rate, step->calls_s, step->p50_ms, step->p99_ms, step->failed,
                      step->generator_cores, step->kept ? "kept" : "");
    }
    (void)fputs("</table></div>\n", file);
}

void umbc_load_print_page(FILE *file, const struct umbc_load_story *story)
{
    bool has_result = story->result->seconds > 0;
    (void)fputs(HEAD, file);
    put_title(file, story);
    if (has_result) {
        put_figures(file, story);
    } else {
        (void)fputs("<p class=\"doubt\">Not even the first rate kept the bound.</p>\n", file);
    }
    (void)fputs("<div class=\"charts\">\n", file);
    if (story->sweep != NULL) {
        plot_sweep(file, story->sweep);
    }
    if (has_result) {
        plot_percentiles(file, story->result);
        plot_course(file, story->result);
    }
    (void)fputs("</div>\n", file);
    if (has_result) {
        put_percentile_table(file, story->result);
        put_error_table(file, story->result);
    }
    if (story->sweep != NULL) {
        put_sweep_table(file, story->sweep);
    }
    (void)fputs("</body></html>\n", file);
}
