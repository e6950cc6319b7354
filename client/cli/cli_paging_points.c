/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_paging_points.h. */
#include "cli_paging_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tool/output.h"
#include "cli_paging_view.h"
#include "tool/tool_try.h"

enum {
    BATCH = 65536
};

static bool append(struct umbc_paging_points *p, const struct umbc_batch *batch, bool normals)
{
    const size_t count = p->count + batch->count;
    double *positions = realloc(p->positions, count * 3 * sizeof *positions);
    p->positions = positions ? positions : p->positions;
    if (normals) {
        float *grown = realloc(p->normals, count * 3 * sizeof *grown);
        p->normals = grown ? grown : p->normals;
        if (!grown) {
            return false;
        }
        memcpy(grown + 3 * p->count, batch->normals, batch->count * 3 * sizeof *grown);
    }
    if (!positions) {
        return false;
    }
    for (size_t i = 0; i < 3 * batch->count; i++) {
        positions[3 * p->count + i] = batch->wide ? batch->wide[i] : (double)batch->narrow[i];
    }
    p->count = count;
    return true;
}

static enum umb_status read_all(struct umbc_points *file, struct umbc_batch *batch,
                                struct umbc_paging_points *points, struct umb_error *error)
{
    bool normals = false;
    for (;;) {
        enum umb_status status = umbc_points_read(file, batch, error);
        if (status != UMB_OK || batch->count == 0) {
            return status;
        }
        normals = points->count == 0 ? batch->has_normals : normals;
        if (points->count + batch->count > UMBC_PAGING_POINTS_MAX) {
            return umb_fail(error, UMB_E_TOO_LARGE, "points: more than %u", UMBC_PAGING_POINTS_MAX);
        }
        if (!append(points, batch, normals)) {
            return umb_fail(error, UMB_E_NO_MEMORY, "points: out of memory");
        }
    }
}

enum umb_status umbc_paging_points_load(const char *path, enum umbc_points_format format,
                                        bool normals, struct umbc_paging_points *points,
                                        struct umb_error *error)
{
    struct umbc_points file;
    struct umbc_batch batch;
    memset(points, 0, sizeof *points);
    UMB__TRY(umbc_points_open(path, format, normals, &file, error));
    enum umb_status status = umbc_batch_init(&batch, BATCH, format, error);
    if (status == UMB_OK) {
        status = read_all(&file, &batch, points, error);
        umbc_batch_finish(&batch);
    }
    umbc_points_close(&file);
    points->values = calloc(points->count + 1, sizeof *points->values);
    points->error_m = calloc(points->count + 1, sizeof *points->error_m);
    if (status == UMB_OK && (!points->values || !points->error_m)) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "points: out of memory");
    }
    if (status != UMB_OK) {
        umbc_paging_points_finish(points);
    }
    return status;
}

void umbc_paging_points_finish(struct umbc_paging_points *points)
{
    free(points->positions);
    free(points->normals);
    free(points->values);
    free(points->error_m);
    memset(points, 0, sizeof *points);
}

enum umb_status umbc_paging_points_ask(struct umbc_paging_points *points, struct umb_region *region,
                                       const struct umb_query_settings *settings, bool want,
                                       struct umbc_paging_figures *figures, struct umb_error *error)
{
    const struct umb_points batch = {.positions = points->positions,
                                     .format = UMB_POINT_F64,
                                     .normals = points->normals,
                                     .count = points->count};
    struct umb_partial_answers answers = {.values = points->values, .error_m = points->error_m};
    enum umb_status status = umb_region_query(region, settings, &batch, want, &answers, error);
    memset(figures, 0, sizeof *figures);
    figures->exact = answers.exact;
    figures->worst_m = answers.worst_error_m;
    for (size_t i = 0; i < points->count && status == UMB_OK; i++) {
        figures->within_1m += points->error_m[i] <= 1.0F;
        figures->within_10cm += points->error_m[i] <= 0.1F;
    }
    return status;
}

/* Brightness of a point: a quarter for the sky, the rest for what reaches it of the light. */
static double shade(const struct umbc_paging_points *points, size_t i, const double light[3])
{
    double cosine = 0;
    for (unsigned axis = 0; axis < 3 && points->normals; axis++) {
        cosine -= (double)points->normals[3 * i + axis] * light[axis];
    }
    cosine = points->normals ? fmax(cosine, 0) : 1;
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
    for (size_t i = 0; i < points->count; i++) {
        size_t pixel[2];
        if (umbc_project(view, points->positions + 3 * i, size[0], size[1], pixel)) {
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
        status = umbu_output_commit(&output, error); /* which looks at the stream */
    }
    free(picture);
    return status;
}
