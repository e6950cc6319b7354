/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_QUERY_VOLUME_H
#define UMBRAGE_CLI_CLI_QUERY_VOLUME_H
/*
 * `umbrage query FILE|ASSET --segments | --columns | --boxes`: a line of text or an object of JSON
 * for each record, in order.
 */
#include "cli_query_options.h"

/* Answers the options' records from a file or a daemon. Returns the exit code. */
int umbc_query_volume(const struct umbc_query_options *options);

#endif
