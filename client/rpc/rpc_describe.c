/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows.List, Shadows.Describe, Shadows.Limits and the health check: small blocking calls. */
#include "rpc_client.h"

#include <stdlib.h>
#include <string.h>

#define HEALTH_SERVING 1 /* grpc.health.v1.HealthCheckResponse.ServingStatus */

_Static_assert(sizeof((struct umb_client_limits *)0)->version ==
                   sizeof((struct umbw_limits *)0)->version,
               "names are copied whole");
_Static_assert(sizeof((struct umb_client_asset *)0)->name ==
                   sizeof((struct umbw_asset_summary *)0)->name,
               "names are copied whole");

static void copy_summary(const struct umbw_asset_summary *summary, struct umb_client_asset *asset)
{
    memcpy(asset->name, summary->name, sizeof asset->name);
    memcpy(asset->id, summary->id, sizeof asset->id);
    asset->packed_bytes = summary->packed_bytes;
    asset->memory_bytes = summary->memory_bytes;
    asset->light_count = summary->light_count;
}

static enum umb_status decode_list(void *out, const uint8_t *message, size_t size,
                                   struct umb_error *error)
{
    return umbw_decode_list_reply(message, size, out, error);
}

enum umb_status umb_client_list_assets(struct umb_client *client, struct umb_client_asset **assets,
                                       size_t *count, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    struct umbw_list_reply reply = {0, NULL};
    *assets = NULL;
    *count = 0;
    enum umb_status status = umbw_encode_list_request(&body, error);
    if (status == UMB_OK) {
        status =
            umb__call_wait(client, &(struct umb__call_plan){.path = UMBW_PATH_LIST, .safe = true},
                           &body, decode_list, &reply, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    struct umb_client_asset *list = calloc(reply.count + 1, sizeof *list);
    if (list == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu assets", reply.count);
    } else {
        for (size_t i = 0; i < reply.count; i++) {
            copy_summary(&reply.assets[i], &list[i]);
        }
        *assets = list;
        *count = reply.count;
    }
    umbw_list_reply_finish(&reply);
    return status;
}

/* A description under way. */
struct describing {
    struct umbw_describe_reply reply;
    struct umb_client_description **out;
};

static enum umb_status decode_description(void *out, const uint8_t *message, size_t size,
                                          struct umb_error *error)
{
    struct describing *describing = out;
    return umbw_decode_describe_reply(message, size, &describing->reply, error);
}

static void copy_curve(const struct umbw_curve *curve, struct umb_client_light *light)
{
    light->curve_count = curve->count;
    memcpy(light->curve, curve->rows, sizeof light->curve);
    memcpy(light->scattered_ns, curve->scattered_ns, sizeof light->scattered_ns);
    memcpy(light->coherent_ns, curve->coherent_ns, sizeof light->coherent_ns);
}

/* Copies a reply into one block, lights and texts behind the description. NULL if memory is short.
 * */
static struct umb_client_description *make_description(const struct umbw_describe_reply *reply)
{
    const size_t plan = strlen(reply->plan) + 1, settings = strlen(reply->settings) + 1;
    struct umb_client_description *out;
    struct umb_client_light *lights;
    out = calloc(1, sizeof *out + reply->light_count * sizeof *lights + plan + settings);
    if (out == NULL) {
        return NULL;
    }
    lights = (struct umb_client_light *)(void *)(out + 1);
    for (uint32_t i = 0; i < reply->light_count; i++) {
        lights[i].info = reply->lights[i].info;
        lights[i].resolution = reply->lights[i].resolution;
        memcpy(lights[i].voxel_m, reply->lights[i].voxel_m, sizeof lights[i].voxel_m);
        lights[i].closed = reply->lights[i].closed;
        copy_curve(&reply->lights[i].curve, &lights[i]);
    }
    copy_summary(&reply->summary, &out->asset);
    out->light_count = reply->light_count;
    out->lights = lights;
    memcpy(out->origin, reply->origin, sizeof out->origin);
    out->bounds = reply->bounds;
    memcpy(out->scene_hash, reply->scene_hash, sizeof out->scene_hash);
    out->plan = memcpy(lights + reply->light_count, reply->plan, plan);
    out->settings = memcpy(out->plan + plan, reply->settings, settings);
    return out;
}

static enum umb_status finish_description(void *context, enum umb_status status,
                                          struct umb_error *error)
{
    struct describing *describing = context;
    if (status == UMB_OK) {
        *describing->out = make_description(&describing->reply);
        if (*describing->out == NULL) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a description");
        }
    }
    umbw_describe_reply_finish(&describing->reply);
    return status;
}

enum umb_status umb_client_describe(struct umb_client *client, const char *asset,
                                    struct umb_client_description **description,
                                    struct umb_client_async *async, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    struct describing *describing = calloc(1, sizeof *describing);
    *description = NULL;
    if (describing == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a call");
    }
    describing->out = description;
    const struct umb__ending ending = {describing, decode_description, finish_description};
    const struct umb__call_plan plan = {.path = UMBW_PATH_DESCRIBE, .asset = asset, .safe = true};
    enum umb_status status = umbw_encode_describe_request(asset, 1, &body, error);
    return status == UMB_OK ? umb__call_run(client, &plan, &body, &ending, async, error)
                            : umb__call_drop(&body, &ending, status, error);
}

static enum umb_status decode_limits(void *out, const uint8_t *message, size_t size,
                                     struct umb_error *error)
{
    return umbw_decode_limits_reply(message, size, out, error);
}

enum umb_status umb_client_get_limits(struct umb_client *client, struct umb_client_limits *limits,
                                      struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    struct umbw_limits told;
    memset(limits, 0, sizeof *limits);
    enum umb_status status = umbw_encode_list_request(&body, error); /* as empty as LimitsRequest */
    if (status == UMB_OK) {
        status =
            umb__call_wait(client, &(struct umb__call_plan){.path = UMBW_PATH_LIMITS, .safe = true},
                           &body, decode_limits, &told, error);
    }
    if (status == UMB_OK) {
        *limits = (struct umb_client_limits){.max_points = told.max_points,
                                             .max_message_bytes = told.max_message_bytes,
                                             .max_segments = told.max_segments,
                                             .max_columns = told.max_columns,
                                             .max_boxes = told.max_boxes,
                                             .max_box_steps = told.max_box_steps,
                                             .max_targets = told.max_targets,
                                             .max_taps = told.max_taps};
        memcpy(limits->version, told.version, sizeof limits->version);
    }
    return status;
}

static enum umb_status decode_health(void *out, const uint8_t *message, size_t size,
                                     struct umb_error *error)
{
    return umbw_decode_health_reply(message, size, out, error);
}

enum umb_status umb_client_health(struct umb_client *client, const char *service, int *serving,
                                  struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    int answer = 0;
    *serving = 0;
    enum umb_status status =
        umbw_encode_health_request(service == NULL ? "" : service, &body, error);
    if (status == UMB_OK) {
        status =
            umb__call_wait(client, &(struct umb__call_plan){.path = UMBW_PATH_CHECK, .safe = true},
                           &body, decode_health, &answer, error);
    }
    *serving = status == UMB_OK && answer == HEALTH_SERVING;
    return status;
}
