/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The standard health service: Check and Watch for "" and umbrage.v1.Shadows, which are SERVING
 * until the drain begins. An unknown service is NOT_FOUND for Check and SERVICE_UNKNOWN, as a
 * message, for Watch (the gRPC health checking protocol).
 */
#include "daemon/call.h"

#include <string.h>

enum serving {
    SERVING = 1,
    NOT_SERVING = 2,
    SERVICE_UNKNOWN = 3,
};

static int is_known(const char *service)
{
    return service[0] == '\0' || strcmp(service, "umbrage.v1.Shadows") == 0;
}

static int state_of(const struct umbd_call *call)
{
    return atomic_load(&call->conn->loop->daemon->draining) ? NOT_SERVING : SERVING;
}

void umbd_service_health_check(struct umbd_call *call)
{
    char service[256];
    struct umbw_buffer head = {0};
    struct umb_error error = {0};
    enum umb_status status =
        umbw_decode_health_request(call->message, call->message_size, service, &error);
    if (status == UMB_OK && !is_known(service)) {
        status = umb_fail(&error, UMB_E_NOT_FOUND, "service: '%.100s' is not served here", service);
    }
    if (status == UMB_OK) {
        status = umbw_encode_health_reply(state_of(call), &head, &error);
    }
    if (status != UMB_OK) {
        umbw_buffer_finish(&head);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    umbd_call_reply(call, &head, NULL, 0);
}

void umbd_service_health_update(struct umbd_call *call)
{
    struct umbw_buffer head = {0};
    struct umb_error error = {0};
    int state = call->watch_service ? state_of(call) : SERVICE_UNKNOWN;
    if (call->reply_ended || state == call->watch_last) {
        return;
    }
    enum umb_status status = umbw_encode_health_reply(state, &head, &error);
    if (status != UMB_OK) {
        umbw_buffer_finish(&head);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    call->watch_last = state;
    umbd_call_push(call, &head);
}

void umbd_service_health_watch(struct umbd_call *call)
{
    char service[256];
    struct umb_error error = {0};
    enum umb_status status =
        umbw_decode_health_request(call->message, call->message_size, service, &error);
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    call->watch_service = is_known(service);
    umbd_service_health_update(call);
}
