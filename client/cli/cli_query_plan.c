/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_query_plan.h. */
#include "cli_query_plan.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "cli/shared/cli_points.h"
#include "tool/clock.h"
#include "tool/tool_try.h"

/* Most bytes of a request beside its records: the asset's name, the origin and the settings. */
#define HEAD_BYTES 512

/* Most bytes of a record in a request. */
static size_t record_bytes(const struct umbc_query_options *options)
{
    const size_t scalar = options->format == UMBC_POINTS_F32 ? sizeof(float) : sizeof(double);
    switch (options->volume_query) {
    case UMBC_ASK_POINTS: /* any line of text may have a normal */
        return 3 * scalar +
               (options->with_normals || options->format == UMBC_POINTS_TEXT ? 3 * sizeof(float)
                                                                             : 0) +
               (options->footprints != NULL ? sizeof(float) : 0);
    case UMBC_ASK_COLUMNS:
        return 3 * scalar;
    default:
        return 6 * scalar;
    }
}

/* Number of records that the server takes in a call, and their name. */
static uint64_t taken(enum umbc_ask_kind volume_query, const struct umb_client_limits *limits,
                      const char **name)
{
    switch (volume_query) {
    case UMBC_ASK_POINTS:
        *name = "points";
        return limits->max_points > 0 ? limits->max_points : UINT64_MAX;
    case UMBC_ASK_SEGMENTS:
        *name = "segments";
        return limits->max_segments;
    case UMBC_ASK_COLUMNS:
        *name = "columns";
        return limits->max_columns;
    default:
        *name = "boxes";
        return limits->max_boxes;
    }
}

enum umb_status umbc_call_size(const struct umbc_query_options *options,
                               const struct umb_client_limits *limits, size_t *count,
                               struct umb_error *error)
{
    const char *name;
    const uint64_t takes = taken(options->volume_query, limits, &name);
    const uint64_t bytes = limits->max_message_bytes;
    const size_t record = record_bytes(options);
    if (takes == 0) {
        *count = 0;
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "the server takes no %s: max_%s is 0 (max_points is %" PRIu64 ")", name,
                        name, limits->max_points);
    }
    size_t most = takes < options->batch ? (size_t)takes : options->batch;
    if (bytes >= HEAD_BYTES + record && (bytes - HEAD_BYTES) / record < most) {
        most = (size_t)((bytes - HEAD_BYTES) / record);
    }
    *count = most;
    return UMB_OK;
}

static enum umb_status calibrate(const struct umb_asset *asset, uint32_t light,
                                 const struct umbc_query_options *options,
                                 struct umb_calibration *calibration, struct umb_error *error)
{
    struct umbc_batch sample = {0};
    enum umb_status status =
        umbc_points_sample(options->points, options->format, options->with_normals,
                           UMBC_SAMPLE_POINTS, &sample, error);
    if (status == UMB_OK) {
        const struct umb_points points = umbc_batch_view(&sample, options->format, options->origin);
        status =
            points.count > 0 && umb_points_check(&points, NULL) == UMB_OK
                ? umb_calibrate_points(asset, light, &points, umbu_thread_cpu_s, calibration, error)
                : umb_calibrate(asset, light, umbu_thread_cpu_s, calibration, error);
    }
    umbc_batch_finish(&sample);
    return status;
}

enum umb_status umbc_dial_settings(const struct umb_asset *asset, uint32_t light,
                                   const struct umbc_query_options *options,
                                   struct umb_query_settings *settings,
                                   struct umb_calibration *calibration, struct umb_error *error)
{
    memset(calibration, 0, sizeof *calibration);
    *settings = options->settings;
    settings->light = light;
    if (options->dial.budget_ns > 0) {
        UMB__TRY(calibrate(asset, light, options, calibration, error));
    }
    return options->has_dial
               ? umb_dial_choose(asset, &options->dial, calibration, settings, NULL, error)
               : UMB_OK;
}

enum umb_status umbc_dial_ask(struct umb_client *client, const struct umbc_query_options *options,
                              size_t batch, struct umb_query_settings *settings,
                              double *expected_ns, struct umb_error *error)
{
    struct umbc_batch sample = {0};
    struct umb_client_query_reply reply;
    enum umb_status status = umbc_points_sample(options->points, options->format,
                                                options->with_normals, batch, &sample, error);
    float *values = calloc(sample.count + 1, sizeof *values);
    if (status == UMB_OK && values == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu answers", sample.count);
    }
    if (status == UMB_OK) {
        const struct umb_client_query_request request = {
            .asset = options->target,
            .settings = options->settings,
            .dial = options->dial,
            .points = umbc_batch_view(&sample, options->format, options->origin),
            .want_stats = 1,
        };
        status = umb_client_query(client, &request, values, &reply, error);
    }
    if (status == UMB_OK && reply.expected_ns <= 0) {
        status = umb_fail(error, UMB_E_UNSUPPORTED, "budget: the server does not know budgets");
    }
    if (status == UMB_OK) {
        settings->taps = reply.taps;
        settings->level = reply.level;
        *expected_ns = reply.expected_ns;
    }
    free(values);
    umbc_batch_finish(&sample);
    return status;
}

void umbc_dial_state(const struct umb_asset *asset, const struct umb_query_settings *settings,
                     const struct umb_calibration *calibration, struct umbc_query_total *total)
{
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count;
    (void)umb_asset_get_curve(asset, settings->light, rows, &count);
    total->level = settings->level;
    total->bound_m = umb_query_bound_m(asset, settings);
    for (size_t i = 0; i < count; i++) {
        if (rows[i].level == settings->level && rows[i].taps == total->taps &&
            umb_filter_get_info(settings->filter)->has_curve) {
            total->row = rows[i];
            total->expected_ns = i < calibration->count ? calibration->ns[i] : 0;
        }
    }
}
