/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BAKE_RUN_H
#define UMBRAGE_SERVER_BAKE_BAKE_RUN_H
/*
 * One run of umbrage-bake after its options are known: import, analysis, plan, bake, write, check,
 * publish, summary.
 */
#include "bake/options/bake_options.h"
#include "umbrage/status.h"

/* Runs the program. Notices go to stderr, the plan or summary to stdout. A failure leaves no new
 * file. */
UMB_CHECKED enum umb_status umbb_run(const struct umbb_options *options, struct umb_error *error);

#endif
