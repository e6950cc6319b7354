/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_REPORT_H
#define UMBRAGE_TESTS_BENCH_REPORT_H
/*
 * What all benchmark programs share: clocks, samples, rows of output, the end of the program.
 *
 * A row is one JSON object a line on stdout: bench, case, figure, value, better, runs, spread. The
 * value is the median of one ratio a run, both sides of which were measured in that run, one
 * right after the other. The spread is the distance of the quartiles over the median: above 0.15
 * the machine was too busy and the row should be run again.
 * Messages go to stderr. If the program under test fails, the bench ends with its message.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define BENCH_RUNS     7  /* at least */
#define BENCH_RUNS_MAX 11 /* while a spread is above BENCH_SPREAD */
#define BENCH_SPREAD   0.15

struct bench_samples {
    double values[BENCH_RUNS_MAX];
    int count;
};

/* Returns seconds of CPU time of the calling thread, or of the wall clock. */
double bench_cpu_s(void);
double bench_wall_s(void);

void bench_add(struct bench_samples *samples, double value); /* ignored when full */
double bench_median(const struct bench_samples *samples);    /* NaN if empty */
double bench_spread(const struct bench_samples *samples);

/* Prints a row and keeps it for the table. name, figure: borrowed until the end. */
void bench_row(const char *bench, const char *name, const char *figure, const char *better,
               const struct bench_samples *samples);

/* Prints a row like bench_row, for a figure that is counted, not timed. */
void bench_row_counted(const char *bench, const char *name, const char *figure, const char *better,
                       double value);

/*
 * Prints all rows as a table on stderr; if the environment's UMBRAGE_BENCH_BARS names a table of
 * bars (tab-separated: bench, size, case, figure, better, at_least, aim), the table also shows the
 * bars of `bench` and `size`, and names rows that are missing.
 */
void bench_table(const char *bench, const char *size);

/* Ends the program with the error's message unless status is UMB_OK. */
void bench_must(enum umb_status status, const struct umb_error *error, const char *what);

/* Ends the program with a message. */
void bench_fail(const char *format, ...) UMB_PRINTF(1, 2) __attribute__((noreturn));

/* A line of talk on stderr, with the seconds since the start. */
void bench_say(const char *format, ...) UMB_PRINTF(1, 2);

/* A text made from a format, alive to the end of the program. */
const char *bench_text(const char *format, ...) UMB_PRINTF(1, 2);

#endif
