/* SPDX-License-Identifier: Apache-2.0 */
/* Regions.Watch; see umbrage/region.h. */
#include "umbrage/region.h"

#include "rpc_client.h"
#include "wire/regions.h"
#include "wire/versions.h"

#define FOR_EVER_MS UINT32_MAX /* 49 days */

struct versions {
    struct umb__watch watch;
    umb_version_fn on_version;
    void *user;
};

static bool take_version(void *user, const uint8_t *message, size_t size)
{
    struct versions *versions = user;
    struct umbw_region_reply reply;
    if (umbw_decode_region_reply(message, size, &reply, &versions->watch.error) != UMB_OK) {
        return false;
    }
    versions->watch.stopped =
        !versions->on_version(versions->user, reply.asset_id, reply.file_bytes);
    return !versions->watch.stopped;
}

enum umb_status umb_client_watch_asset(struct umb_client *client, const char *asset,
                                       uint32_t timeout_ms, umb_version_fn on_version, void *user,
                                       struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_version_request request;
    struct umbw_buffer body = {NULL, 0, 0};
    struct versions versions = {.on_version = on_version, .user = user};
    const struct umb__ending ending = {&versions, sizeof versions, umb__decode_nothing,
                                       umb__watch_finish};
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
