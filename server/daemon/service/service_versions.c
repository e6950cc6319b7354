/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Regions.Watch: tells a client the version of an asset, at once and after each change. The asset
 * is looked up again each second, as a query would find it: rights, owners and damaged files count
 * as they stand then. A look-up reads no file.
 */
#include "daemon/call/call.h"
#include "daemon/service/services.h"

#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "wire/regions.h"
#include "wire/versions.h"

#define LOOK_MS 1000 /* between two look-ups */

struct version_watch {
    struct umbw_version_request request;
    int told;                 /* 1 once `id` was sent */
    uint8_t id[UMB_ID_BYTES]; /* Version sent last */
    uint64_t at_ms;           /* uv_now of the last look-up */
};

/* Finds the asset's version. Out: reply: of that version. */
static enum umb_status find(struct umbd_call *call, struct umbw_region_reply *reply,
                            struct umb_error *error)
{
    const struct version_watch *watch = call->state;
    struct umbs_entry *entry;
    UMB__TRY(umbd_call_acquire(call, watch->request.asset, &entry, error));
    const struct umbs_store_item *item = umbs_entry_item(entry);
    *reply = (struct umbw_region_reply){.file_bytes = item->packed_bytes};
    memcpy(reply->asset_id, item->id, UMB_ID_BYTES);
    umbs_entry_release(entry);
    return UMB_OK;
}

void umbd_version_watch_tick(struct umbd_call *call)
{
    struct version_watch *watch = call->state;
    struct umbw_region_reply reply;
    struct umbw_buffer message = {0};
    const uint64_t now_ms = umbd_call_now_ms(call);
    /* A client that does not read gets no second reply before the first. */
    if (watch == NULL || call->reply_ended || umbd_call_unsent(call) > 0 ||
        (watch->told && now_ms - watch->at_ms < LOOK_MS) || !umbd_call_is_allowed(call)) {
        return;
    }
    watch->at_ms = now_ms;
    if (!umbd_call_ok(call, find(call, &reply, umbd_call_error(call))) ||
        (watch->told && memcmp(watch->id, reply.asset_id, UMB_ID_BYTES) == 0)) {
        return;
    }
    watch->told = 1;
    memcpy(watch->id, reply.asset_id, UMB_ID_BYTES);
    umbd_call_reply_or_fail(call, umbw_encode_region_reply(&reply, &message, umbd_call_error(call)),
                            &message);
}

void umbd_version_watch_serve(struct umbd_call *call)
{
    struct version_watch *watch = calloc(1, sizeof *watch);
    if (watch == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    if (!UMBD_CALL_READ(call, version_request, &watch->request)) {
        free(watch);
        return;
    }
    call->state = watch;
    umbd_version_watch_tick(call);
}

void umbd_version_watch_close(struct umbd_call *call)
{
    free(call->state);
}
