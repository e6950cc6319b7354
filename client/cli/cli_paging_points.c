/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_paging_points.h. */
#include "cli_paging_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tool/output.h"
#include "cli_paging_view.h"
#include "tool/tool_try.h"

enum umb_status umbc_paging_points_load(const char *path, enum umbc_points_format format,
                                        bool normals, struct umbc_paging_points *points,
                                        struct umb_error *error)
{
    const size_t most = UMBC_PAGING_POINTS_MAX;
    enum umb_status status = UMB_OK;
    memset(points, 0, sizeof *points);
    UMB__TRY(umbc_points_load(path, format, normals, most + 1, &points->list, error));
    points->values = calloc(points->list.count + 1, sizeof *points->values);
    points->error_m = calloc(points->list.count + 1, sizeof *points->error_m);
    if (points->list.count > most) {
        status = umb_fail(error, UMB_E_TOO_LARGE, "points: more than %zu", most);
    } else if (!points->values || !points->error_m) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "points: out of memory");
    }
    if (status != UMB_OK) {
        umbc_paging_points_finish(points);
    }
    return status;
}

void umbc_paging_points_finish(struct umbc_paging_points *points)
{
    umbc_point_list_finish(&points->list);
    free(points->values);
    free(points->error_m);
    memset(points, 0, sizeof *points);
}

enum umb_status umbc_paging_points_ask(struct umbc_paging_points *points, struct umb_region *region,
                                       const struct umb_query_settings *settings, bool want,
                                       struct umbc_paging_figures *figures, struct umb_error *error)
{
    const struct umb_points batch = {.positions = points->list.positions,
                                     .format = UMB_POINT_F64,
                                     .normals = points->list.normals,
                                     .count = points->list.count};
    struct umb_partial_answers answers = {.values = points->values, .error_m = points->error_m};
    UMB__TRY(umb_region_query(region, settings, &batch, want, &answers, error));
    *figures =
        (struct umbc_paging_figures){.exact = answers.exact, .worst_m = answers.worst_error_m};
    for (size_t i = 0; i < points->list.count; i++) {
        figures->within_1m += points->error_m[i] <= 1.0F;
        figures->within_10cm += points->error_m[i] <= 0.1F;
    }
    return UMB_OK;
}

/* Brightness of a point, 0..1: a quarter from the sky, the rest from the light that reaches it. */
static double shade(const struct umbc_paging_points *points, size_t i, const double light[3])
{
    double cosine = 0;
    for (unsigned axis = 0; axis < 3 && points->list.normals; axis++) {
        cosine -= (double)points->list.normals[3 * i + axis] * light[axis];
    }
    cosine = points->list.normals ? fmax(cosine, 0) : 1;
    return 0.25 + 0.75 * cosine * (double)points->values[i];
}

enum umb_status umbc_paging_points_draw(const struct umbc_paging_points *points,
                                        const struct umb_partial_view *view, const double light[3],
                                        const uint32_t size[2], const char *path,
                                        struct umb_error *error)
{
    static const double orange[3] = {1.0, 0.72, 0.35};
    const size_t bytes = (size_t)3 * size[0] * size[1];
    struct umbu_output output;
    uint8_t *picture = malloc(bytes);
    if (!picture) {
        return umb_fail(error, UMB_E_NO_MEMORY, "frames: no memory for %zu bytes", bytes);
    }
    for (size_t i = 0; i < bytes; i++) {
        picture[i] = i % 3 == 2 ? 235 : 205;
    }
    for (size_t i = 0; i < points->list.count; i++) {
        size_t pixel[2];
        if (umbc_project(view, points->list.positions + 3 * i, size[0], size[1], pixel)) {
            uint8_t *at = picture + 3 * (pixel[0] + size[0] * pixel[1]);
            const double light_here = shade(points, i, light);
            for (unsigned c = 0; c < 3; c++) {
                at[c] = (uint8_t)(255 * light_here * (points->error_m[i] > 0 ? orange[c] : 1.0));
            }
        }
    }
    enum umb_status status = umbu_output_begin(path, UMBU_OUTPUT_COMMAND, &output, error);
    if (status == UMB_OK) {
        (void)fprintf(output.file, "P6\n%u %u\n255\n", size[0], size[1]);
        (void)fwrite(picture, 1, bytes, output.file);
        status = umbu_output_commit(&output, error); /* fails if a write failed */
    }
    free(picture);
    return status;
}
