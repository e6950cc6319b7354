/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_QUERY_BUDGET_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_QUERY_BUDGET_H
/* Calibrations for queries with a budget: the cost of settings for their points, on this
 * machine. */
#include "daemon/call/call.h"
#include "daemon/work/calibrations.h"

/*
 * Finds the calibration for a request with a budget, or has it made.
 *
 * In:    again: serves the call's message once the calibration is made.
 * Out:   away: 1 if a worker is making it, or if the call has failed (no points left of its rate):
 *        then the caller returns.
 * Fails: as umbd_call_acquire, umbd_pool_submit; E_NO_MEMORY; E_ARGUMENT (targets).
 */
UMB_CHECKED enum umb_status umbd_budget_calibrate(struct umbd_call *call,
                                                  const struct umbw_query_request *request,
                                                  void (*again)(struct umbd_call *call),
                                                  struct umb_calibration *calibration, int *away,
                                                  struct umb_error *error);

#endif
