/* SPDX-License-Identifier: Apache-2.0 */
/* Regions.Watch; see umbrage/region.h. */
#include "umbrage/region.h"

#include "rpc_client.h"
#include "wire/regions.h"
#include "wire/versions.h"

#define FOR_EVER_MS UINT32_MAX /* 49 days */

struct versions {
    umb_version_fn on_version;
    void *user;
    struct umb_error error; /* Error of a malformed message; its status is UMB_OK otherwise */
    bool stopped;
};

static bool take_version(void *user, const uint8_t *message, size_t size)
{
    struct versions *versions = user;
    struct umbw_region_reply reply;
    if (umbw_decode_region_reply(message, size, &reply, &versions->error) != UMB_OK) {
        return false;
    }
    versions->stopped = !versions->on_version(versions->user, reply.asset_id, reply.file_bytes);
    return !versions->stopped;
}

static enum umb_status finish(void *context, enum umb_status status, struct umb_error *error)
{
    struct versions *versions = context;
    if (versions->stopped) {
        return umb_fail(error, UMB_E_CANCELLED, "stopped watching");
    }
    return status != UMB_OK && versions->error.status != UMB_OK
               ? umb__reply_fault(versions->error.status, &versions->error, error)
               : status;
}

enum umb_status umb_client_watch_asset(struct umb_client *client, const char *asset,
                                       uint32_t timeout_ms, umb_version_fn on_version, void *user,
                                       struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_version_request request;
    struct umbw_buffer body = {NULL, 0, 0};
    struct versions versions = {.on_version = on_version, .user = user};
    const struct umb__ending ending = {&versions, sizeof versions, umb__decode_nothing, finish};
    const struct umb__call_plan plan = {.asset = asset,
                                        .path = UMBW_PATH_REGIONS_WATCH,
                                        .timeout_ms = timeout_ms ? timeout_ms : FOR_EVER_MS,
                                        .take = take_version};
    enum umb_status status = umb__asset_take(asset, request.asset, error);
    if (status == UMB_OK) {
        status = umbw_encode_version_request(&request, &body, error);
    }
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}
