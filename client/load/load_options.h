/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_OPTIONS_H
#define UMBRAGE_LOAD_LOAD_OPTIONS_H
/* The options of `umbrage load`, read and checked. */
#include "cli/cli_common.h"
#include "load/load_run.h"

struct umbc_load_options {
    struct umbu_session session;
    struct umbc_load_settings settings; /* address and client: not yet */
    struct umbc_load_source source;
    bool sweep, closed;
    double bound_ms;    /* of the 99th percentile, for --sweep */
    const char *report; /* file, or NULL */
    bool json, quiet;
};

/* Reads arguments. Returns -1 to go on, else the exit code. */
int umbc_load_options_parse(int argc, char **argv, struct umbc_load_options *options);

#endif
