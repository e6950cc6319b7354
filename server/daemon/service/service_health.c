/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The standard health service: Check and Watch for the server, the service umbrage.v1.Shadows and
 * each asset. For an unknown service Check fails with NOT_FOUND, and Watch sends the message
 * SERVICE_UNKNOWN (the gRPC health checking protocol).
 */
#include "daemon/call/call.h"
#include "daemon/service/services.h"

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
 * Returns the state of a service. "" and "umbrage.v1.Shadows" are SERVING until a drain begins.
 * "umbrage.v1.Shadows/ASSET" is also NOT_SERVING while the asset's file is damaged. To callers
 * without rights every asset is unknown.
 */
static int state_of(struct umbd_call *call, const char *service)
{
    int serving = atomic_load(&call->server->draining) ? NOT_SERVING : SERVING;
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

void umbd_health_check_serve(struct umbd_call *call)
{
    char service[256];
    if (!UMBD_CALL_READ(call, health_request, service)) {
        return;
    }
    const int state = state_of(call, service);
    if (state != SERVICE_UNKNOWN) {
        UMBD_CALL_SEND(call, health_reply, &state);
    } else {
        (void)umbd_call_ok(call, umb_fail(umbd_call_error(call), UMB_E_NOT_FOUND,
                                          "service: '%.100s' is not served here", service));
    }
}

/* State of a Watch. */
struct watch {
    int last;       /* Serving status sent last, -1 = none */
    uint64_t at_ms; /* uv_now of the last check */
    char service[];
};

/* Sends the state to a Watch if it changed. The state of an asset is checked once a second. */
void umbd_health_watch_tick(struct umbd_call *call)
{
    struct watch *watch = call->state;
    struct umbw_buffer head = {0};
    uint64_t now_ms = umbd_call_now_ms(call);
    int draining = atomic_load(&call->server->draining);
    if (call->reply_ended || watch == NULL ||
        (watch->last >= 0 && !draining && now_ms - watch->at_ms < ASSET_LOOK_MS)) {
        return;
    }
    int state = state_of(call, watch->service);
    watch->at_ms = now_ms;
    if (state == watch->last) {
        return;
    }
    if (umbd_call_ok(call, umbw_encode_health_reply(&state, &head, umbd_call_error(call)))) {
        watch->last = state;
        umbd_call_reply(call, &head);
    }
}

void umbd_health_watch_close(struct umbd_call *call)
{
    struct umbd_conn *conn = call->conn;
    if (call->state != NULL) {
        conn->watches--;
        if (!conn->proven) {
            atomic_fetch_sub(&call->server->stranger_watches, 1);
        }
    }
    free(call->state);
}

/* Counts a Watch. Fails: E_BUSY (its connection has a Watch already, or connections without rights
 * have too many). */
static enum umb_status take_watch(struct umbd_call *call, struct umb_error *error)
{
    struct umbd_conn *conn = call->conn;
    const unsigned most = call->server->options.max_watches;
    if (conn->watches > 0) {
        return umb_fail(error, UMB_E_BUSY,
                        "watch: this connection has one already; the limit is 1");
    }
    if (!conn->proven && atomic_fetch_add(&call->server->stranger_watches, 1) >= most) {
        atomic_fetch_sub(&call->server->stranger_watches, 1);
        return umb_fail(error, UMB_E_BUSY,
                        "watch: connections without rights have %u together (--max-watches)", most);
    }
    conn->watches++;
    return UMB_OK;
}

void umbd_health_watch_serve(struct umbd_call *call)
{
    char service[256];
    if (!UMBD_CALL_READ(call, health_request, service)) {
        return;
    }
    struct watch *watch = malloc(sizeof *watch + strlen(service) + 1);
    if (watch == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    watch->last = -1;
    watch->at_ms = 0;
    memcpy(watch->service, service, strlen(service) + 1);
    if (!umbd_call_ok(call, take_watch(call, umbd_call_error(call)))) {
        free(watch);
        umbd_count(&call->server->metrics.shed, 1);
        return;
    }
    call->state = watch;
    umbd_health_watch_tick(call);
}
