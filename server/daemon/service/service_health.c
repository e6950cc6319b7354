/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The standard health service: Check and Watch for the server, its service and each asset. An
 * unknown service is NOT_FOUND for Check and SERVICE_UNKNOWN, as a message, for Watch (the gRPC
 * health checking protocol).
 */
#include "daemon/call/call_rights.h"

#include <stdlib.h>
#include <string.h>

enum serving {
    SERVING = 1,
    NOT_SERVING = 2,
    SERVICE_UNKNOWN = 3,
};

#define SERVICE       "umbrage.v1.Shadows"
#define ASSET_LOOK_MS 1000 /* between two checks of a watched asset */

/*
 * State of a service. "" and the service are SERVING until the drain begins;
 * "umbrage.v1.Shadows/ASSET" also depends on the asset: NOT_SERVING while its file is damaged. To
 * callers without rights an asset is unknown.
 */
static int state_of(struct umbd_call *call, const char *service)
{
    struct umbd_daemon *daemon = call->conn->loop->daemon;
    int serving = atomic_load(&daemon->draining) ? NOT_SERVING : SERVING;
    size_t length = strlen(SERVICE);
    if (service[0] == '\0' || strcmp(service, SERVICE) == 0) {
        return serving;
    }
    if (strncmp(service, SERVICE "/", length + 1) != 0) {
        return SERVICE_UNKNOWN;
    }
    if (!umbd_call_may_name_assets(call)) {
        return SERVICE_UNKNOWN; /* whether the asset exists or not */
    }
    struct umbs_entry *entry = NULL;
    enum umb_status status = umbd_call_acquire(call, service + length + 1, &entry, NULL);
    umbs_entry_release(entry);
    return status == UMB_OK ? serving : status == UMB_E_NOT_FOUND ? SERVICE_UNKNOWN : NOT_SERVING;
}

void umbd_service_health_check(struct umbd_call *call)
{
    char service[256];
    struct umbw_buffer head = {0};
    struct umb_error error = {0};
    enum umb_status status =
        umbw_decode_health_request(call->message, call->message_size, service, &error);
    int state = status == UMB_OK ? state_of(call, service) : SERVICE_UNKNOWN;
    if (status == UMB_OK && state == SERVICE_UNKNOWN) {
        status = umb_fail(&error, UMB_E_NOT_FOUND, "service: '%.100s' is not served here", service);
    }
    if (status == UMB_OK) {
        status = umbw_encode_health_reply(state, &head, &error);
    }
    if (status != UMB_OK) {
        umbw_buffer_finish(&head);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    umbd_call_reply(call, &head);
}

void umbd_service_health_update(struct umbd_call *call)
{
    struct umbw_buffer head = {0};
    struct umb_error error = {0};
    uint64_t now_ms = uv_now(&call->conn->loop->uv);
    int draining = atomic_load(&call->conn->loop->daemon->draining);
    if (call->reply_ended || call->watch_service == NULL ||
        (call->watch_last >= 0 && !draining && now_ms - call->watch_ms < ASSET_LOOK_MS)) {
        return;
    }
    int state = state_of(call, call->watch_service);
    call->watch_ms = now_ms;
    if (state == call->watch_last) {
        return;
    }
    enum umb_status status = umbw_encode_health_reply(state, &head, &error);
    if (status != UMB_OK) {
        umbw_buffer_finish(&head);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    call->watch_last = state;
    umbd_call_reply(call, &head);
}

void umbd_service_health_end(struct umbd_call *call)
{
    struct umbd_conn *conn = call->conn;
    if (call->watch_service != NULL) {
        conn->watches--;
        if (!conn->proven) {
            atomic_fetch_sub(&conn->loop->daemon->stranger_watches, 1);
        }
    }
    free(call->watch_service);
    call->watch_service = NULL;
}

/* Counts a Watch. Returns 0 and fails the call if its connection has one, or strangers too many. */
static int take_watch(struct umbd_call *call)
{
    struct umbd_conn *conn = call->conn;
    struct umbd_daemon *daemon = conn->loop->daemon;
    struct umb_error error;
    const unsigned most = daemon->options.max_watches;
    enum umb_status status = UMB_OK;
    if (conn->watches > 0) {
        status = umb_fail(&error, UMB_E_BUSY,
                          "watch: this connection has one already; the limit "
                          "is 1");
    } else if (!conn->proven && atomic_fetch_add(&daemon->stranger_watches, 1) >= most) {
        atomic_fetch_sub(&daemon->stranger_watches, 1);
        status =
            umb_fail(&error, UMB_E_BUSY,
                     "watch: connections without rights have %u together (--max-watches)", most);
    }
    if (status != UMB_OK) {
        umbd_count(&daemon->metrics.shed, 1);
        umbd_call_fail_status(call, status, &error);
        return 0;
    }
    conn->watches++;
    return 1;
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
    char *copy = malloc(strlen(service) + 1);
    if (copy == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    memcpy(copy, service, strlen(service) + 1);
    if (!take_watch(call)) {
        free(copy);
        return;
    }
    call->watch_service = copy;
    umbd_service_health_update(call);
}
