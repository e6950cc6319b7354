/* SPDX-License-Identifier: Apache-2.0 */
/* Every method of the daemon: base/method.h says what the columns mean. */
#include "daemon/service/services.h"

#include "daemon/base/method.h"
#include "daemon/service/web_body.h"
#include "wire/bakes.h"
#include "wire/messages.h"
#include "wire/regions.h"
#include "wire/versions.h"
#include "wire/volume_queries.h"

#define OPEN  1024 /* Most bytes of a call without rights: room for a service name of 255 bytes */
#define SMALL 4096 /* request limit of calls with a name or an id and a few numbers */

#define UNARY    UMBD_UNARY
#define UPLOADS  UMBD_CLIENT_STREAM
#define REPLIES  UMBD_SERVER_STREAM
#define BOTH     UMBD_BIDI_STREAM
#define ANYONE   UMBD_SCOPE_NONE
#define QUERY    UMBD_SCOPE_QUERY
#define SUBMIT   UMBD_SCOPE_SUBMIT
#define BY_CALL  UMBD_PRICE_CALL
#define BY_POINT UMBD_PRICE_REQUEST

/* clang-format off */
const struct umbd_method umbd_methods[] = {
    {UMBW_PATH_QUERY, UNARY, QUERY, BY_POINT, 0, 0, .serve = umbd_query_serve,
     .close = umbd_query_close},
    {UMBW_PATH_STREAM, BOTH, QUERY, BY_POINT, 0, 0, .serve = umbd_query_serve,
     .close = umbd_query_close},
    {UMBW_PATH_DESCRIBE, UNARY, QUERY, BY_CALL, SMALL, 0, .serve = umbd_describe_serve},
    {UMBW_PATH_LIST, UNARY, QUERY, BY_CALL, SMALL, 0, .serve = umbd_list_serve},
    {UMBW_PATH_LIMITS, UNARY, QUERY, BY_CALL, SMALL, 0, .serve = umbd_limits_serve},
    {UMBW_PATH_SAMPLE, UNARY, QUERY, BY_POINT, SMALL, 0, .serve = umbd_sample_serve},
    {UMBW_PATH_BAKES_SUBMIT, UPLOADS, SUBMIT, BY_POINT, 0, UMBD_UPLOAD, .serve = umbd_submit_serve,
     .end = umbd_submit_end, .close = umbd_job_close},
    {UMBW_PATH_BAKES_WATCH, REPLIES, SUBMIT, BY_CALL, SMALL, UMBD_ENDLESS,
     .serve = umbd_job_watch_serve, .tick = umbd_job_watch_tick, .close = umbd_job_close},
    {UMBW_PATH_BAKES_CANCEL, UNARY, SUBMIT, BY_CALL, SMALL, 0, .serve = umbd_job_cancel_serve,
     .close = umbd_job_close},
    {UMBW_PATH_BAKES_LIST, UNARY, SUBMIT, BY_CALL, SMALL, 0, .serve = umbd_job_list_serve,
     .close = umbd_job_close},
    {UMBW_PATH_BAKES_FETCH, REPLIES, SUBMIT, BY_CALL, SMALL, 0, .serve = umbd_fetch_serve,
     .more = umbd_fetch_more, .close = umbd_job_close},
    {UMBW_PATH_BAKES_DELETE, UNARY, SUBMIT, BY_CALL, SMALL, 0, .serve = umbd_job_delete_serve,
     .close = umbd_job_close},
    {UMBW_PATH_REGIONS_STREAM, REPLIES, QUERY, BY_POINT, 0, 0, .serve = umbd_regions_serve},
    {UMBW_PATH_REGIONS_FOLLOW, BOTH, QUERY, BY_POINT, 0, 0, .serve = umbd_regions_serve},
    {UMBW_PATH_REGIONS_WATCH, REPLIES, QUERY, BY_CALL, SMALL, UMBD_ENDLESS,
     .serve = umbd_version_watch_serve, .tick = umbd_version_watch_tick,
     .close = umbd_version_watch_close},
    {UMBW_PATH_REGIONS_DERIVE, REPLIES, QUERY, BY_POINT, 0, 0, .serve = umbd_derive_serve},
    {UMBW_PATH_SEGMENTS, UNARY, QUERY, BY_POINT, 0, 0, .serve = umbd_volume_query_serve,
     .variant = UMBW_SEGMENTS},
    {UMBW_PATH_COLUMNS, UNARY, QUERY, BY_POINT, 0, 0, .serve = umbd_volume_query_serve,
     .variant = UMBW_COLUMNS},
    {UMBW_PATH_BOXES, UNARY, QUERY, BY_POINT, 0, 0, .serve = umbd_volume_query_serve,
     .variant = UMBW_BOXES},
    {UMBW_PATH_CHECK, UNARY, ANYONE, BY_CALL, OPEN, 0, .serve = umbd_health_check_serve},
    {UMBW_PATH_WATCH, REPLIES, ANYONE, BY_CALL, OPEN, 0, .serve = umbd_health_watch_serve,
     .tick = umbd_health_watch_tick, .close = umbd_health_watch_close},
    {UMBW_PATH_REFLECTION, BOTH, QUERY, BY_POINT, SMALL, 0, .serve = umbd_reflection_serve},
    {UMBW_PATH_REFLECTION_ALPHA, BOTH, QUERY, BY_POINT, SMALL, 0, .serve = umbd_reflection_serve},
    {.path = NULL}, /* every other path */
};
/* clang-format on */

const struct umbd_method umbd_web_method = {.path = "/assets/",
                                            .kind = UNARY,
                                            .scope = QUERY,
                                            .price = BY_CALL,
                                            .serve = umbd_web_serve,
                                            .more = umbd_web_body_more,
                                            .tick = umbd_web_body_more,
                                            .close = umbd_web_body_close};

_Static_assert(sizeof umbd_methods / sizeof umbd_methods[0] <= UMBD_METHODS_MAX, "counters");
