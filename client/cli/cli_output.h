/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_OUTPUT_H
#define UMBRAGE_CLI_CLI_OUTPUT_H
/*
 * Output files that appear whole or not at all: a temporary `.tmp.*` beside the target (the store
 * of a daemon sweeps old ones), fsync, rename, fsync of the folder. "-" is stdout, which is only
 * flushed. SIGINT, SIGTERM and SIGHUP take the temporary with them.
 * A device, pipe or other special file is written to directly: renaming would replace it.
 */
#include <stdbool.h>
#include <stdio.h>
#include "umbrage/file.h"

struct umbc_output {
    FILE *file;
    const char *path; /* borrowed */
    char *temporary;  /* NULL for stdout and special files */
    int system_error; /* errno of the sink's first failed write, else 0 */
};

/* Starts an output. Fails: E_CANNOT_CREATE, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbc_output_begin(const char *path, struct umbc_output *output,
                                              struct umb_error *error);

/* Makes it durable and visible; abandons it on failure. Fails: E_IO, E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbc_output_commit(struct umbc_output *output, struct umb_error *error);

/* Removes the temporary. Harmless after commit and on a zeroed struct. */
void umbc_output_abandon(struct umbc_output *output);

/* Renames a synced file within its folder, and syncs the folder. Fails: E_IO,
 * E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbc_output_rename(const char *from, const char *to,
                                               struct umb_error *error);

/* A core sink that appends to the output; the output must stay where it is. */
struct umb_sink umbc_output_sink(struct umbc_output *output);

#endif
