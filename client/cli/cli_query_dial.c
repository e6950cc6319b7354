/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_query_dial.h. */
#define _POSIX_C_SOURCE 200809L /* CLOCK_THREAD_CPUTIME_ID */
#include "cli_query_dial.h"

#include <stdlib.h>
#include <string.h>

#include "cli_points.h"
#include "tool/clock.h"

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
    enum umb_status status = UMB_OK;
    memset(calibration, 0, sizeof *calibration);
    *settings = options->settings;
    settings->light = light;
    if (options->dial.budget_ns > 0) {
        status = calibrate(asset, light, options, calibration, error);
    }
    return status == UMB_OK && options->has_dial
               ? umb_dial_choose(asset, &options->dial, calibration, settings, NULL, error)
               : status;
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
        status = umb_fail(error, UMB_E_UNSUPPORTED, "budget: the server knows none; it is older");
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
