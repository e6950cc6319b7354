/* SPDX-License-Identifier: Apache-2.0 */
/* Running the maps of moments of translucent casters; see moment_rows.h. */
#include "study/moment_rows.h"

#include <math.h>

#include "base/try.h"
#include "tool/clock.h"

#define REPEATS 3

#define LIGHT(count) .settings.technique = UMB_MAP_MOMENTS, .settings.terms = (count)
#define LOGS(count)  .settings.technique = UMB_MAP_ABSORBANCE, .settings.terms = (count)

const struct umbt_moment_row umbt_moment_rows[] = {
    {"moments-4", LIGHT(4)},
    {"moments-6", LIGHT(6)},
    {"moments-8", LIGHT(8)},
    {"moments-8-u16", LIGHT(8), .settings.format = UMB_MAP_U16},
    {"moments-4-over", LIGHT(4), .settings.overestimate = 0.25},
    {"moments-8-over", LIGHT(8), .settings.overestimate = 0.25},
    {"absorbance-4", LOGS(4)},
    {"absorbance-6", LOGS(6)},
    {"absorbance-8", LOGS(8)},
    {"absorbance-8-u16", LOGS(8), .settings.format = UMB_MAP_U16},
    {"absorbance-4-over", LOGS(4), .settings.overestimate = 0.25},
    {"absorbance-8-over", LOGS(8), .settings.overestimate = 0.25},
};

const size_t umbt_moment_row_count = sizeof umbt_moment_rows / sizeof umbt_moment_rows[0];

static void compare(const double *truth, const float *values, size_t count,
                    struct umbt_moment_result *result)
{
    for (size_t i = 0; i < count; i++) {
        const double difference = (double)values[i] - truth[i];
        result->lighter += fmax(difference, 0.0) / (double)count;
        result->darker += fmax(-difference, 0.0) / (double)count;
        result->most = fmax(result->most, fabs(difference));
    }
    result->mean = result->lighter + result->darker;
}

enum umb_status umbt_moment_row_run(const struct umbt_moment_row *row,
                                    const struct umbt_moment_question *question, float *values,
                                    struct umbt_moment_result *result, struct umb_error *error)
{
    const size_t count = question->points->count;
    const struct umb_map_filter filter = {.bias_m = question->bias_m};
    struct umb_map_settings settings = row->settings;
    struct umb_map *map;
    struct umb_map_query query;
    settings.blur = question->taps;
    *result = (struct umbt_moment_result){.query_ns = INFINITY};
    const double start = umbu_thread_cpu_s();
    UMB__TRY(umb_map_build_translucent(question->frustum, question->fragments, &settings, NULL,
                                       &map, error));
    result->build_s = umbu_thread_cpu_s() - start;
    enum umb_status status = umb_map_prepare(map, &filter, &query, error);
    for (int i = 0; i < REPEATS && status == UMB_OK; i++) {
        const double asked = umbu_thread_cpu_s();
        umb_map_run(&query, question->points, 0, count, values);
        result->query_ns =
            fmin(result->query_ns, 1e9 * (umbu_thread_cpu_s() - asked) / (double)count);
    }
    umb_map_get_info(map, &result->info);
    umb_map_destroy(map);
    if (status == UMB_OK) {
        compare(question->truth, values, count, result);
    }
    return status;
}
