/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_OPTIONS_H
#define UMBRAGE_LOAD_LOAD_OPTIONS_H
/* The options of `umbrage load`, read and checked. */
#include "cli/cli_session.h"
#include "load/load_run.h"

struct umbc_load_options {
    const char *session[UMBC_SESSION_COUNT];
    struct umbc_load_settings settings; /* address and client: not yet */
    struct umbc_load_source source;
    bool sweep;
    double bound_ms;    /* of the 99th percentile, for --sweep */
    const char *report; /* file, or NULL */
    bool json, quiet;
};

/* Reads arguments. Returns -1 to go on, else the exit code. */
int umbc_load_options_parse(int argc, char **argv, struct umbc_load_options *options);

#endif
