/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_QUERY_DIAL_H
#define UMBRAGE_CLI_CLI_QUERY_DIAL_H
/* The dial of `umbrage query` on a file: settings from an error or a budget, and what they give. */
#include "cli_answers.h"
#include "cli_query_options.h"

/*
 * Chooses the settings of a light if the options ask for that. A budget is calibrated on a sample
 * of the very points that will be asked, or, where they cannot be read twice, on points spread over
 * the scene.
 *
 * Out:   settings: the options', with level and taps chosen. calibration: empty without a budget.
 * Fails: as umb_calibrate, umb_dial_choose; E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_dial_settings(const struct umb_asset *asset, uint32_t light,
                                               const struct umbc_query_options *options,
                                               struct umb_query_settings *settings,
                                               struct umb_calibration *calibration,
                                               struct umb_error *error);

/*
 * Has a daemon choose level and taps for a budget, on a sample of the points that will be asked; so
 * that all of them are answered alike.
 *
 * In:    batch: points of the sample at most, one call.
 * Out:   settings: level and taps. expected_ns: a point.
 * Fails: as umb_client_query; E_UNSUPPORTED (a server without budgets); E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_dial_ask(struct umb_client *client,
                                          const struct umbc_query_options *options, size_t batch,
                                          struct umb_query_settings *settings, double *expected_ns,
                                          struct umb_error *error);

/* Says what settings give: bound, row of the curve, expected cost. */
void umbc_dial_state(const struct umb_asset *asset, const struct umb_query_settings *settings,
                     const struct umb_calibration *calibration, struct umbc_query_total *total);

#endif
