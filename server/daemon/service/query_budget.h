/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_QUERY_BUDGET_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_QUERY_BUDGET_H
/* Calibrations for queries with a budget: the cost of settings for their points, on this
 * machine. */
#include "daemon/call/call_rights.h"
#include "daemon/work/calibrations.h"

/*
 * Finds the calibration for a request with a budget, or has it made.
 *
 * Out:   away: 1 if a worker is making it, or if the call has failed (no points left of its rate):
 *        then the caller returns.
 * Fails: as umbd_call_acquire, umbd_pool_submit; E_NO_MEMORY; E_ARGUMENT (targets).
 */
UMB_CHECKED enum umb_status umbd_budget_calibrate(struct umbd_call *call,
                                                  const struct umbw_query_request *request,
                                                  struct umb_calibration *calibration, int *away,
                                                  struct umb_error *error);

/* Stores a finished calibration and gives the call its message back, to be served again.
 * Fails: as the worker did; batch->error has the reason. */
UMB_CHECKED enum umb_status umbd_budget_take(struct umbd_call *call, struct umbd_batch *batch);

#endif
