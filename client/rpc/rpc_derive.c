/* SPDX-License-Identifier: Apache-2.0 */
/* Regions.DeriveMap: receives the pieces of a file and joins them. */
#include "rpc_client.h"

#include <stdlib.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "wire/regions.h"

struct gathered {
    uint8_t **out; /* where the bytes go */
    size_t *out_size;
    uint8_t *out_id;
    struct umb_error error; /* Error of a malformed message */
    enum umb_status status; /* of the messages */
    uint64_t most;          /* bytes that are taken */
    uint8_t *bytes;         /* [total], allocated with the first piece */
    uint64_t total, at;
    uint8_t asset_id[UMB_ID_BYTES];
};

static enum umb_status begin(struct gathered *g, const struct umbw_region_reply *reply)
{
    if (reply->file_bytes == 0 || reply->file_bytes > g->most) {
        return umb_fail(&g->error, UMB_E_TOO_LARGE, "file_bytes: %llu, must be 1 to %llu",
                        (unsigned long long)reply->file_bytes, (unsigned long long)g->most);
    }
    g->bytes = malloc((size_t)reply->file_bytes);
    g->total = reply->file_bytes;
    memcpy(g->asset_id, reply->asset_id, UMB_ID_BYTES);
    return g->bytes != NULL ? UMB_OK
                            : umb_fail(&g->error, UMB_E_NO_MEMORY, "out of memory for %llu bytes",
                                       (unsigned long long)g->total);
}

static enum umb_status add_piece(struct gathered *g, const uint8_t *message, size_t size)
{
    struct umbw_region_reply reply;
    UMB__TRY(umbw_decode_region_reply(message, size, &reply, &g->error));
    if (g->bytes == NULL) {
        UMB__TRY(begin(g, &reply));
    }
    if (reply.file_bytes != g->total || reply.data_size > g->total - g->at) {
        return umb_fail(&g->error, UMB_E_PROTOCOL, "data: %zu bytes at %llu of %llu",
                        reply.data_size, (unsigned long long)g->at, (unsigned long long)g->total);
    }
    if (reply.data_size > 0) {
        memcpy(g->bytes + g->at, reply.data, reply.data_size);
    }
    g->at += reply.data_size;
    return UMB_OK;
}

static bool take_piece(void *user, const uint8_t *message, size_t size)
{
    struct gathered *g = user;
    g->status = add_piece(g, message, size);
    return g->status == UMB_OK;
}

static enum umb_status encode(const char *asset, const struct umb_derive_settings *settings,
                              struct umbw_buffer *body, struct umb_error *error)
{
    struct umbw_derive_request request = {.settings = *settings};
    if (UMB__UNKNOWN(settings, "settings", error) ||
        UMB__UNKNOWN(&settings->map, "settings.map", error) ||
        UMB__UNKNOWN(&settings->cascades, "settings.cascades", error)) {
        return UMB_E_ARGUMENT;
    }
    UMB__TRY(umb__asset_take(asset, request.asset, error));
    if (settings->cascades.count > 0 && settings->camera == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "camera: NULL, %u cascades need one",
                        settings->cascades.count);
    }
    if (settings->cascades.count > 0) {
        UMB__TRY(umb__map_view_make(settings->camera, &request.view, error));
    }
    if (settings->map.access != UMB_MAP_MIPS) { /* the only one that the message tells */
        request.settings.map.access = UMB_MAP_BASE;
    }
    return umbw_encode_derive_request(&request, body, error);
}

static enum umb_status finish(void *context, enum umb_status status, struct umb_error *error)
{
    struct gathered *g = context;
    if (g->status != UMB_OK) {
        status = umb__reply_fault(g->status, &g->error, error);
    } else if (status == UMB_OK && (g->at != g->total || g->bytes == NULL)) {
        status = umb_fail(error, UMB_E_PROTOCOL, "data: ended at byte %llu of %llu",
                          (unsigned long long)g->at, (unsigned long long)g->total);
    }
    if (status != UMB_OK) {
        free(g->bytes);
        return status;
    }
    *g->out = g->bytes;
    *g->out_size = (size_t)g->total;
    memcpy(g->out_id, g->asset_id, UMB_ID_BYTES);
    return UMB_OK;
}

enum umb_status umb_client_derive(struct umb_client *client, const char *asset,
                                  const struct umb_derive_settings *settings, uint8_t **bytes,
                                  size_t *size, uint8_t asset_id[UMB_ID_BYTES],
                                  struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    struct gathered g = {.out = bytes,
                         .out_size = size,
                         .out_id = asset_id,
                         .most = client->options.max_reply_bytes};
    const struct umb__ending ending = {&g, sizeof g, umb__decode_nothing, finish};
    *bytes = NULL;
    *size = 0;
    const struct umb__call_plan plan = {
        .asset = asset, .path = UMBW_PATH_REGIONS_DERIVE, .take = take_piece};
    enum umb_status status = encode(asset, settings, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}
