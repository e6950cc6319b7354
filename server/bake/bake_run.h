/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BAKE_RUN_H
#define UMBRAGE_SERVER_BAKE_BAKE_RUN_H
/*
 * One run of umbrage-bake after its options are known: import, analysis, plan, bake, write, check,
 * publish, summary.
 */
#include "bake/bake_options.h"
#include "umbrage/status.h"

/* Notices go to stderr, the plan or summary to stdout. On failure nothing new is left on disk. */
UMB_CHECKED enum umb_status umbb_run(const struct umbb_options *options, struct umb_error *error);

#endif
