/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_QUERY_BUDGET_H
#define UMBRAGE_SERVER_DAEMON_QUERY_BUDGET_H
/* What a budget of a query needs to know: the cost of settings for its points, on this machine. */
#include "daemon/call_rights.h"
#include "daemon/calibrations.h"

/*
 * Finds the calibration for a request with a budget, or has it made.
 *
 * Out:   away: 1 if a worker is making it, or the call has failed (no points left of its rate):
 *        then there is nothing more to do now.
 * Fails: as umbd_call_acquire, umbd_pool_submit; E_NO_MEMORY; E_ARGUMENT (targets).
 */
UMB_CHECKED enum umb_status umbd_budget_calibrate(struct umbd_call *call,
                                                  const struct umbw_query_request *request,
                                                  struct umb_calibration *calibration, int *away,
                                                  struct umb_error *error);

/* Keeps a calibration that came home and gives the call its message back, to be served again.
 * Fails: as the worker did; batch->error says why. */
UMB_CHECKED enum umb_status umbd_budget_take(struct umbd_call *call, struct umbd_batch *batch);

#endif
