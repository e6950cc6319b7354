/* SPDX-License-Identifier: Apache-2.0 */
/* Sources of shadows; see shadow_source.h. */
#include "study/shadow_source.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/try.h"
#include "study/study_scene.h"

/* Bytes of a request: of a point with its normal, and of everything else. */
#define POINT_BYTES (3 * sizeof(double) + 3 * sizeof(float))
#define HEAD_BYTES  512

static int ends_with(const char *text, const char *end)
{
    const size_t length = strlen(text), end_length = strlen(end);
    return length >= end_length && strcmp(text + length - end_length, end) == 0;
}

int umbt_shadow_source_is_file(const char *argument)
{
    struct stat facts;
    return strchr(argument, '/') != NULL || ends_with(argument, ".umb") ||
           ends_with(argument, ".umbm") || stat(argument, &facts) == 0;
}

/* Prepares the light of the settings in a file's asset. */
static enum umb_status file_light(struct umbt_shadow_source *source, struct umb_error *error)
{
    UMB__TRY(umb_query_prepare(source->asset, &source->settings, &source->query, error));
    UMB__TRY(umb_asset_get_light(source->asset, source->settings.light, &source->light));
    const uint32_t count = source->light.frustum_count;
    source->frusta = calloc((size_t)count + 1, sizeof *source->frusta);
    if (source->frusta == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory for %u frusta", count);
    }
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(umb_asset_get_frustum(source->asset, source->light.first_frustum + i,
                                       &source->frusta[i]));
    }
    source->frustum = source->frusta[0];
    return UMB_OK;
}

static enum umb_status file_open(struct umbt_shadow_source *source, struct umb_error *error)
{
    UMB__TRY(umb_asset_open_file(source->name, NULL, &source->asset, error));
    umb_asset_get_info(source->asset, &source->info);
    source->light_count = source->info.light_count;
    source->scene_flags = umbt_scene_flags_of(source->info.plan);
    return file_light(source, error);
}

/* Returns the greatest number of points in a call; a server without a limit takes any number. */
static size_t call_max(const struct umb_client_limits *limits)
{
    const uint64_t bytes = limits->max_message_bytes;
    uint64_t most = limits->max_points > 0 ? limits->max_points : UINT64_MAX;
    if (bytes >= HEAD_BYTES + POINT_BYTES && (bytes - HEAD_BYTES) / POINT_BYTES < most) {
        most = (bytes - HEAD_BYTES) / POINT_BYTES;
    }
    return most < SIZE_MAX ? (size_t)most : SIZE_MAX;
}

/* Describes the light of the settings in a daemon's asset. */
static enum umb_status daemon_light(struct umbt_shadow_source *source, struct umb_error *error)
{
    struct umb_client_description *description = NULL;
    enum umb_status status = UMB_OK;
    UMB__TRY(umb_client_describe(source->client, source->name, &description, NULL, error));
    if (source->settings.light >= description->light_count) {
        status = umb_fail(error, UMB_E_NOT_FOUND, "--light: %u, the lights of %s are 0 to %u",
                          source->settings.light, source->name,
                          description->light_count - (description->light_count > 0));
    } else {
        memcpy(source->info.id, description->asset.id, sizeof source->info.id);
        memcpy(source->info.scene_hash, description->scene_hash, sizeof source->info.scene_hash);
        source->light = description->lights[source->settings.light].info;
        source->light_count = description->light_count;
        source->scene_flags = umbt_scene_flags_of(description->plan);
    }
    umb_free(description);
    return status;
}

static enum umb_status daemon_open(struct umbt_shadow_source *source,
                                   const struct umbu_session *daemon, struct umb_error *error)
{
    struct umb_client_limits limits;
    UMB__TRY(umbu_connect(daemon, &source->client, error));
    UMB__TRY(umb_client_get_limits(source->client, &limits, error));
    source->call_max = call_max(&limits);
    return daemon_light(source, error);
}

enum umb_status umbt_shadow_source_open(struct umbt_shadow_source *source, const char *argument,
                                        const struct umbu_session *daemon,
                                        const struct umb_query_settings *settings,
                                        struct umb_error *error)
{
    memset(source, 0, sizeof *source);
    source->name = argument;
    source->settings = *settings;
    enum umb_status status = umbt_shadow_source_is_file(argument)
                                 ? file_open(source, error)
                                 : daemon_open(source, daemon, error);
    if (status != UMB_OK) {
        umbt_shadow_source_close(source);
    }
    return status;
}

enum umb_status umbt_shadow_source_of_light(struct umbt_shadow_source *source,
                                            const struct umbt_shadow_source *first, uint32_t light,
                                            struct umb_error *error)
{
    *source = *first;
    source->frusta = NULL;
    source->is_borrowed = 1;
    source->settings.light = light;
    const enum umb_status status =
        source->client != NULL ? daemon_light(source, error) : file_light(source, error);
    if (status != UMB_OK) {
        umbt_shadow_source_close(source);
    }
    return status;
}

void umbt_shadow_source_close(struct umbt_shadow_source *source)
{
    free(source->frusta);
    if (!source->is_borrowed) {
        umb_asset_close(source->asset);
    }
    if (source->client != NULL && !source->is_borrowed) {
        umb_client_close(source->client);
    }
    memset(source, 0, sizeof *source);
}

enum umb_status umbt_shadow_source_look(struct umbt_shadow_source *source, const double eye[3],
                                        double pixel_rad, struct umb_error *error)
{
    memcpy(source->settings.eye, eye, sizeof source->settings.eye);
    source->settings.pixel_rad = pixel_rad;
    return source->client != NULL
               ? UMB_OK
               : umb_query_prepare(source->asset, &source->settings, &source->query, error);
}

static enum umb_status ask(const struct umbt_shadow_source *source, const struct umb_points *points,
                           float *values, struct umb_query_stats *stats, struct umb_error *error)
{
    struct umb_client_query_request request = {
        .asset = source->name,
        .settings = source->settings,
        .points = *points,
        .want_stats = 1,
    };
    for (size_t i = 0; i < points->count; i += request.points.count) {
        struct umb_client_query_reply reply;
        const size_t left = points->count - i;
        request.points.positions = (const double *)points->positions + 3 * i;
        request.points.normals = (const float *)points->normals + 3 * i;
        request.points.count = left < source->call_max ? left : source->call_max;
        UMB__TRY(umb_client_query(source->client, &request, values + i, &reply, error));
        umb_query_stats_add(stats, &reply.stats);
    }
    return UMB_OK;
}

enum umb_status umbt_shadow_source_answer(const struct umbt_shadow_source *source,
                                          const struct umb_points *points, float *values,
                                          struct umb_query_stats *stats, struct umb_error *error)
{
    if (source->client != NULL) {
        return ask(source, points, values, stats, error);
    }
    struct umb_answers answers = {.values = values, .stats = *stats};
    UMB__TRY(umb_points_check(points, error));
    umb_query_run(&source->query, points, 0, points->count, &answers);
    *stats = answers.stats;
    return UMB_OK;
}
