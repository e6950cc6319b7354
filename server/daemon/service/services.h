/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_SERVICES_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_SERVICES_H
/* Functions of the services for the table of methods (methods.c). base/method.h says when each is
 * called. */
#include "daemon/base/method.h"

/* The daemon's methods. */
extern const struct umbd_method umbd_methods[];

void umbd_query_serve(struct umbd_call *call);
void umbd_query_close(struct umbd_call *call);
void umbd_describe_serve(struct umbd_call *call);
void umbd_list_serve(struct umbd_call *call);
void umbd_limits_serve(struct umbd_call *call);
void umbd_segments_serve(struct umbd_call *call);
void umbd_columns_serve(struct umbd_call *call);
void umbd_boxes_serve(struct umbd_call *call);
void umbd_regions_serve(struct umbd_call *call);
void umbd_derive_serve(struct umbd_call *call);
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

#endif
