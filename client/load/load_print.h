/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_PRINT_H
#define UMBRAGE_LOAD_LOAD_PRINT_H
/* Options of `umbrage load`, and output of its result as text, as JSON and as an HTML page. */
#include <stdio.h>
#include "cli/shared/cli_common.h"
#include "load/load_run.h"
#include "load/load_sweep.h"
#include "tool/output.h"

struct umbc_load_options {
    struct umbu_session session;
    struct umbc_load_settings settings; /* Without address and client */
    struct umbc_load_source source;
    bool sweep, closed;
    double bound_ms;    /* Bound of the 99th percentile in milliseconds, for --sweep */
    const char *report; /* Name of the page, or NULL */
    bool json, quiet;
};

/* Reads arguments. Returns -1 to go on, else the exit code. */
int umbc_load_options_parse(int argc, char **argv, struct umbc_load_options *options);

/* One load test; too large for the stack. */
struct umbc_load_test {
    struct umbc_load_options options;
    struct umb_client_description *about;
    struct umbc_load_pool pool;
    struct umbc_load_sweep sweep;   /* with --sweep */
    struct umbc_load_result result; /* result of the run, or at the knee of a sweep */
    struct umbu_output report;
    bool live; /* true: stderr is a terminal and shows a line of figures */
};

void umbc_load_print_text(FILE *file, const struct umbc_load_test *test);
void umbc_load_print_json(FILE *file, const struct umbc_load_test *test);

/* Prints an HTML page (tool/report.h). */
void umbc_load_print_page(FILE *file, const struct umbc_load_test *test);

#endif
