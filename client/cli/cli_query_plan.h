/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_QUERY_PLAN_H
#define UMBRAGE_CLI_CLI_QUERY_PLAN_H
/*
 * How `umbrage query` asks: the number of records in a call, and the settings that follow from
 * --max-error or --budget.
 */
#include "cli_answers.h"
#include "cli_query_options.h"

/*
 * Chooses the number of records in a call: --batch, or less where the server takes less.
 *
 * In:    limits: the server's limits. 0 in max_points or max_message_bytes means no known limit; 0
 *        in max_segments, max_columns or max_boxes means that the server takes no such records.
 * Out:   count: at least 1; 0 after a failure.
 * Fails: E_UNSUPPORTED (the server takes no records of this kind).
 */
UMB_CHECKED enum umb_status umbc_call_size(const struct umbc_query_options *options,
                                           const struct umb_client_limits *limits, size_t *count,
                                           struct umb_error *error);

/*
 * Chooses the settings of a light of a file. A budget is calibrated on a sample of the points to
 * query, or on points all over the scene if the input cannot be read twice.
 *
 * Out:   settings: copied from the options; level and taps are chosen if the options ask for a
 *        choice. calibration: empty without a budget.
 * Fails: as umb_calibrate, umb_dial_choose; E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_dial_settings(const struct umb_asset *asset, uint32_t light,
                                               const struct umbc_query_options *options,
                                               struct umb_query_settings *settings,
                                               struct umb_calibration *calibration,
                                               struct umb_error *error);

/*
 * Lets a daemon choose level and taps for a budget, by a sample of the points to query. All points
 * are then answered with the same settings.
 *
 * In:    batch: most points of the sample, which is sent in one call.
 * Out:   settings: level and taps. expected_ns: time of a point.
 * Fails: as umb_client_query; E_UNSUPPORTED (a server without budgets); E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_dial_ask(struct umb_client *client,
                                          const struct umbc_query_options *options, size_t batch,
                                          struct umb_query_settings *settings, double *expected_ns,
                                          struct umb_error *error);

/* Stores the error bound, the curve's row and the expected time of the settings in the totals. */
void umbc_dial_state(const struct umb_asset *asset, const struct umb_query_settings *settings,
                     const struct umb_calibration *calibration, struct umbc_query_total *total);

#endif
