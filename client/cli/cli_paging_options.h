/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PAGING_OPTIONS_H
#define UMBRAGE_CLI_CLI_PAGING_OPTIONS_H
/* The command line of `umbrage stream`, read and checked. */
#include <stdbool.h>
#include "cli_common.h"
#include "cli_paging_points.h"
#include "cli_paging_view.h"

struct umbc_paging_options {
    const char *target;             /* As given, or NULL */
    const char *file, *url, *asset; /* one of them; an asset is a daemon's */
    struct umbu_session session;
    const char *camera, *path, *points_file; /* As given, or NULL */
    const char *resume, *output, *frames;
    enum umbc_points_format format; /* Of points_file */
    bool with_normals;
    bool only_points, json, quiet;
    struct umb_region_options region;
    uint8_t id[UMB_ID_BYTES];
    struct umb_partial_view base; /* what all views share */
    struct umbc_views views;      /* at least one */
    struct umb_query_settings settings;
    uint32_t size[2];      /* width and height of pictures in pixels */
    unsigned up;           /* 0 y, 1 z */
    uint64_t limit, round; /* bytes, 0 = none */
    uint32_t timeout_s;    /* Limit of the whole command in seconds; 0 = none */
    struct umbc_paging_points points;
};

/* Returns -1 to go on, else the exit code; complaints are on stderr. Finish it either way. */
int umbc_paging_options_parse(struct umbc_paging_options *options, int argc, char **argv);
void umbc_paging_options_finish(struct umbc_paging_options *options);

#endif
