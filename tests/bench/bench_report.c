/* SPDX-License-Identifier: Apache-2.0 */
/* Clocks, samples, rows; see bench_report.h. */
#include "bench_report.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define ROWS_MAX       256
#define LINE_MAX_BYTES 512

struct row {
    const char *name, *figure, *better;
    double value, spread;
    int seen; /* in the table of bars */
};

/* A program prints the rows of one bench. They are kept here until the table is printed. */
static struct row rows[ROWS_MAX];
static size_t row_count;
static double start_s;

static double clock_s(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double bench_cpu_s(void)
{
    return clock_s(CLOCK_THREAD_CPUTIME_ID);
}

double bench_wall_s(void)
{
    return clock_s(CLOCK_MONOTONIC);
}

void bench_add(struct bench_samples *samples, double value)
{
    if (samples->count < BENCH_RUNS_MAX) {
        samples->values[samples->count++] = value;
    }
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Returns the value below which a share of the samples lies, interpolated between neighbouring
 * samples. */
static double quantile(const struct bench_samples *samples, double share)
{
    double sorted[BENCH_RUNS_MAX];
    if (samples->count == 0) {
        return NAN;
    }
    memcpy(sorted, samples->values, sizeof sorted);
    qsort(sorted, (size_t)samples->count, sizeof sorted[0], compare_doubles);
    const double at = share * (double)(samples->count - 1);
    const int low = (int)at;
    const int high = low + 1 < samples->count ? low + 1 : low;
    return sorted[low] + (at - (double)low) * (sorted[high] - sorted[low]);
}

double bench_median(const struct bench_samples *samples)
{
    return quantile(samples, 0.5);
}

double bench_spread(const struct bench_samples *samples)
{
    const double middle = quantile(samples, 0.5);
    return middle > 0.0 ? (quantile(samples, 0.75) - quantile(samples, 0.25)) / middle : 0.0;
}

static void row_print(const char *bench, const struct row *row, int runs)
{
    printf("{\"bench\":\"%s\",\"case\":\"%s\",\"figure\":\"%s\",\"value\":%.5g,\"better\":\"%s\","
           "\"runs\":%d,\"spread\":%.3f}\n",
           bench, row->name, row->figure, row->value, row->better, runs, row->spread);
    (void)fflush(stdout);
    if (row_count < ROWS_MAX) {
        rows[row_count++] = *row;
    }
}

void bench_row(const char *bench, const char *name, const char *figure, const char *better,
               const struct bench_samples *samples)
{
    const struct row row = {.name = name,
                            .figure = figure,
                            .better = better,
                            .value = bench_median(samples),
                            .spread = bench_spread(samples)};
    row_print(bench, &row, samples->count);
}

void bench_row_counted(const char *bench, const char *name, const char *figure, const char *better,
                       double value)
{
    const struct row row = {.name = name, .figure = figure, .better = better, .value = value};
    row_print(bench, &row, 1);
}

/* Splits a line at its tabs; returns the number of fields, at most `max`. */
static size_t fields_cut(char *line, char **fields, size_t max)
{
    size_t count = 0;
    line[strcspn(line, "\r\n")] = '\0';
    for (char *at = line; at != NULL && count < max;) {
        fields[count++] = at;
        at = strchr(at, '\t');
        if (at != NULL) {
            *at++ = '\0';
        }
    }
    return count;
}

static struct row *row_find(const char *name, const char *figure)
{
    for (size_t i = 0; i < row_count; i++) {
        if (strcmp(rows[i].name, name) == 0 && strcmp(rows[i].figure, figure) == 0) {
            return &rows[i];
        }
    }
    return NULL;
}

static const char *verdict(double value, int lower, double bar, double aim)
{
    if (lower ? value <= aim : value >= aim) {
        return "aim";
    }
    return (lower ? value <= bar : value >= bar) ? "bar" : "BELOW";
}

/* Reads one line of the table of bars; ignores it if it belongs to another bench or size. */
static void bar_show(char *line, const char *bench, const char *size)
{
    char *f[7];
    if (fields_cut(line, f, 7) < 7 || strcmp(f[0], bench) != 0 || strcmp(f[1], size) != 0) {
        return;
    }
    const int lower = strcmp(f[4], "lower") == 0;
    struct row *row = row_find(f[2], f[3]);
    if (row == NULL) {
        fprintf(stderr, "%-30s %-26s %10s %10s %10s\n", f[2], f[3], "absent", f[5], f[6]);
        return;
    }
    row->seen = 1;
    fprintf(stderr, "%-30s %-26s %10.4g %10s %10s  %s%s\n", row->name, row->figure, row->value,
            f[5], f[6], verdict(row->value, lower, strtod(f[5], NULL), strtod(f[6], NULL)),
            row->spread > BENCH_SPREAD ? "  (spread: run again)" : "");
}

void bench_table(const char *bench, const char *size)
{
    const char *path = getenv("UMBRAGE_BENCH_BARS");
    FILE *file = path != NULL ? fopen(path, "r") : NULL;
    char line[LINE_MAX_BYTES];
    if (path != NULL && file == NULL) {
        fprintf(stderr, "UMBRAGE_BENCH_BARS: cannot open '%s'\n", path);
    }
    fprintf(stderr, "\n%-30s %-26s %10s %10s %10s\n", "case", "figure", "value", "at least", "aim");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        bar_show(line, bench, size);
    }
    for (size_t i = 0; i < row_count; i++) {
        if (!rows[i].seen) {
            fprintf(stderr, "%-30s %-26s %10.4g\n", rows[i].name, rows[i].figure, rows[i].value);
        }
    }
    if (file != NULL) {
        (void)fclose(file);
    }
}

void bench_must(enum umb_status status, const struct umb_error *error, const char *what)
{
    if (status != UMB_OK) {
        bench_fail("%s: %s", what, error->message);
    }
}

void bench_fail(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    (void)fputs("bench: ", stderr);
    (void)vfprintf(stderr, format, arguments);
    (void)fputc('\n', stderr);
    va_end(arguments);
    exit(70);
}

void bench_say(const char *format, ...)
{
    va_list arguments;
    if (start_s == 0.0) {
        start_s = bench_wall_s();
    }
    va_start(arguments, format);
    fprintf(stderr, "%7.1f s  ", bench_wall_s() - start_s);
    (void)vfprintf(stderr, format, arguments);
    (void)fputc('\n', stderr);
    va_end(arguments);
}

const char *bench_text(const char *format, ...)
{
    char text[160];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    char *kept = strdup(text);
    if (kept == NULL) {
        bench_fail("out of memory");
    }
    return kept;
}
