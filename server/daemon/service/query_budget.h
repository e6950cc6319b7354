/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_QUERY_BUDGET_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_QUERY_BUDGET_H
/* Calibrations for queries with a budget: the cost of each setting for the query's kind of points,
 * on this machine. */
#include "daemon/call/call.h"
#include "daemon/work/calibrations.h"

/*
 * Finds the calibration for a request with a budget, or has a worker make it.
 *
 * In:    again: function that serves the call's message after the calibration.
 * Out:   away: 1 if a worker is making the calibration, or if the call has failed because its rate
 *        is used up; the caller then returns.
 * Fails: as umbd_call_acquire, umbd_pool_submit; E_NO_MEMORY; E_ARGUMENT (targets).
 */
UMB_CHECKED enum umb_status umbd_budget_calibrate(struct umbd_call *call,
                                                  const struct umbw_query_request *request,
                                                  void (*again)(struct umbd_call *call),
                                                  struct umb_calibration *calibration, int *away,
                                                  struct umb_error *error);

#endif
