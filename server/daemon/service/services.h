/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_SERVICES_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_SERVICES_H
/* Functions of the services for the table of methods (methods.c), and those that services share.
 * base/method.h says when each is called. */
#include "daemon/base/method.h"
#include "umbrage/curve.h"
#include "wire/messages.h"

/* The daemon's methods. */
extern const struct umbd_method umbd_methods[];

/* Row for requests of HTTP/1.1. No path of gRPC leads to it. */
extern const struct umbd_method umbd_web_method;

void umbd_query_serve(struct umbd_call *call);
void umbd_query_close(struct umbd_call *call);
void umbd_describe_serve(struct umbd_call *call);
void umbd_list_serve(struct umbd_call *call);
void umbd_limits_serve(struct umbd_call *call);
void umbd_sample_serve(struct umbd_call *call);
void umbd_volume_query_serve(struct umbd_call *call);
void umbd_regions_serve(struct umbd_call *call);
void umbd_derive_serve(struct umbd_call *call);
void umbd_version_watch_serve(struct umbd_call *call);
void umbd_version_watch_tick(struct umbd_call *call);
void umbd_version_watch_close(struct umbd_call *call);
void umbd_submit_serve(struct umbd_call *call);
void umbd_submit_end(struct umbd_call *call);
void umbd_job_watch_serve(struct umbd_call *call);
void umbd_job_watch_tick(struct umbd_call *call);
void umbd_job_cancel_serve(struct umbd_call *call);
void umbd_job_list_serve(struct umbd_call *call);
void umbd_job_delete_serve(struct umbd_call *call);
void umbd_fetch_serve(struct umbd_call *call);
void umbd_fetch_more(struct umbd_call *call);
void umbd_job_close(struct umbd_call *call);
void umbd_health_check_serve(struct umbd_call *call);
void umbd_health_watch_serve(struct umbd_call *call);
void umbd_health_watch_tick(struct umbd_call *call);
void umbd_health_watch_close(struct umbd_call *call);
void umbd_reflection_serve(struct umbd_call *call);
void umbd_web_serve(struct umbd_call *call);

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
