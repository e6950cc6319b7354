/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_DERIVE_OPTIONS_H
#define UMBRAGE_CLI_CLI_DERIVE_OPTIONS_H
/* The command line of `umbrage derive`, read and checked. */
#include <stdbool.h>
#include "cli_common.h"
#include "umbrage/derive.h"

struct umbc_derive_options {
    const char *target; /* a file, or a daemon's asset */
    struct umbu_session session;
    const char *output;
    char named[4096]; /* where `output` is if none was given; a longer path is cut and fails to open
                       */
    struct umb_derive_settings settings; /* camera: NULL; cascades.count > 0: `camera` */
    struct umb_camera camera;
    const char *view; /* --camera, or NULL */
    double aspect;    /* Width by height of its picture */
    unsigned up;      /* 0 y, 1 z */
    bool json, quiet;
};

/* Returns -1 to go on, else the exit code; complaints are on stderr. */
int umbc_derive_options_parse(struct umbc_derive_options *options, int argc, char **argv);

#endif
