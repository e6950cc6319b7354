/* SPDX-License-Identifier: Apache-2.0 */
/* The small calls: Shadows.List, Shadows.Describe, Shadows.Limits and the health check. */
#include "base/try.h"
#include "rpc_client.h"

#include <stdlib.h>
#include <string.h>

#define HEALTH_SERVING 1 /* grpc.health.v1.HealthCheckResponse.ServingStatus */

static enum umb_status decode_list(void *out, const uint8_t *message, size_t size,
                                   struct umb_error *error)
{
    return umbw_decode_list_reply(message, size, out, error);
}

enum umb_status umb_client_list_assets(struct umb_client *client, struct umb_client_asset **assets,
                                       size_t *count, struct umb_error *error)
{
    const struct umb__call_plan plan = {.path = UMBW_PATH_LIST, .safe = true};
    struct umbw_buffer body = {NULL, 0, 0};
    struct umbw_list_reply reply = {0, NULL};
    *assets = NULL;
    *count = 0;
    UMB__TRY(umbw_encode_empty(&body, error));
    UMB__TRY(umb__call_wait(client, &plan, &body, decode_list, &reply, error));
    *assets = reply.assets;
    *count = reply.count;
    return UMB_OK;
}

static enum umb_status decode_description(void *context, const uint8_t *message, size_t size,
                                          struct umb_error *error)
{
    struct umb_client_description **const *out = context;
    return umbw_decode_describe_reply(message, size, *out, error);
}

enum umb_status umb_client_describe(struct umb_client *client, const char *asset,
                                    struct umb_client_description **description,
                                    struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_describe_request request = {.want_curves = 1};
    struct umbw_buffer body = {NULL, 0, 0};
    *description = NULL;
    UMB__TRY(umb__asset_take(asset, request.asset, error));
    const struct umb__ending ending = {&description, sizeof description, decode_description, NULL};
    const struct umb__call_plan plan = {.path = UMBW_PATH_DESCRIBE, .asset = asset, .safe = true};
    enum umb_status status = umbw_encode_describe_request(&request, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

static enum umb_status decode_limits(void *out, const uint8_t *message, size_t size,
                                     struct umb_error *error)
{
    return umbw_decode_limits_reply(message, size, out, error);
}

enum umb_status umb_client_get_limits(struct umb_client *client, struct umb_client_limits *limits,
                                      struct umb_error *error)
{
    const struct umb__call_plan plan = {.path = UMBW_PATH_LIMITS, .safe = true};
    struct umbw_buffer body = {NULL, 0, 0};
    struct umbw_limits reply;
    memset(limits, 0, sizeof *limits);
    UMB__TRY(umbw_encode_empty(&body, error));
    UMB__TRY(umb__call_wait(client, &plan, &body, decode_limits, &reply, error));
    *limits = reply.client;
    return UMB_OK;
}

static enum umb_status decode_health(void *out, const uint8_t *message, size_t size,
                                     struct umb_error *error)
{
    return umbw_decode_health_reply(message, size, out, error);
}

enum umb_status umb_client_health(struct umb_client *client, const char *service, int *serving,
                                  struct umb_error *error)
{
    const struct umb__call_plan plan = {.path = UMBW_PATH_CHECK, .safe = true};
    struct umbw_buffer body = {NULL, 0, 0};
    int answer = 0;
    *serving = 0;
    UMB__TRY(umbw_encode_health_request(service == NULL ? "" : service, &body, error));
    UMB__TRY(umb__call_wait(client, &plan, &body, decode_health, &answer, error));
    *serving = answer == HEALTH_SERVING;
    return UMB_OK;
}
