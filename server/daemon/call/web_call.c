/* SPDX-License-Identifier: Apache-2.0 */
/* Calls of HTTP/1.1: from a parsed head to the service. */
#include <stdlib.h>
#include <string.h>

#include "daemon/call/call.h"

/*
 * Finds out whether the page that sent the request may read the reply, and on which fields replies
 * depend. The values are static or the options', so the reply holds nothing of the request.
 */
static void check_origin(struct umbd_call *call, const struct umbn_http1_request *request)
{
    const char *const *origins = call->server->options.http_origins;
    struct umbd_web *web = call->web;
    const int is_list = origins[0] != NULL && strcmp(origins[0], "*") != 0;
    const int needs_token = call->backend->tokens != NULL;
    web->vary = is_list && needs_token ? "Vary: Authorization, Origin\r\n"
                : is_list              ? "Vary: Origin\r\n"
                : needs_token          ? "Vary: Authorization\r\n"
                                       : "";
    if (origins[0] != NULL && !is_list) {
        web->origin = "*";
    }
    for (size_t i = 0; is_list && request->origin.bytes != NULL && origins[i] != NULL; i++) {
        if (umbn_http1_is(request->origin, origins[i])) {
            web->origin = origins[i];
        }
    }
}

static void keep_path(struct umbd_call *call, struct umbn_http1_text path)
{
    const size_t size =
        path.size < sizeof call->path ? path.size : sizeof call->path - 1; /* for the log */
    if (size > 0) {
        memcpy(call->path, path.bytes, size);
    }
    call->path[size] = '\0';
}

struct umbd_call *umbd_web_request(struct umbd_conn *conn, int32_t number,
                                   const struct umbn_http1_request *request)
{
    struct umbd_call *call = umbd_call_create(conn, number, 0);
    if (call == NULL) {
        return NULL;
    }
    call->web = calloc(1, sizeof *call->web);
    if (call->web == NULL) {
        umbd_call_destroy(call);
        return NULL;
    }
    call->headers_whole = call->request_ended = 1;
    call->method = call->backend->web;
    call->web->request = request;
    call->web->is_head = request->method == UMBN_HTTP1_HEAD;
    keep_path(call, request->path);
    check_origin(call, request);
    if (request->authorization.bytes != NULL) {
        umbd_call_authorization(call, (const uint8_t *)request->authorization.bytes,
                                request->authorization.size);
    }
    const uint64_t from = umbd_conn_began(conn);
    call->method->serve(call);
    umbd_conn_spent(conn, from);
    call->web->request = NULL;
    return call;
}

int umbd_web_is_over(const struct umbd_call *call)
{
    return call->responded && call->reply_ended && umbd_call_unsent(call) == 0;
}
