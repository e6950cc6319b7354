/* SPDX-License-Identifier: Apache-2.0 */
/* Seams between cascades, at the points of a view that lie on them; see technique_seams.h. */
#include "study/technique_seams.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "maps/map_receiver.h"

#define BAND_SHARE 0.05 /* of a slice's length: points this near to a split are on its seam */
#define POINTS_MIN 16U  /* a seam of fewer points is not matched */

/* Points of one seam: those at even places find the contrast, those at odd places judge it. */
struct seam_points {
    double (*positions)[3];
    float (*normals)[3];
    size_t count[2];
    float *answers; /* [receivers] scratch of two maps */
};

/* 1 if a point lies on a map, a texel or more from its border. */
static int is_on_map(const struct umb_map_frustum *frustum, const double position[3])
{
    struct umb__map_point at;
    return umb__frustum_map(frustum, position, &at) && at.at[0] >= 1.0 && at.at[1] >= 1.0 &&
           at.at[0] <= (double)frustum->width - 1.0 && at.at[1] <= (double)frustum->height - 1.0;
}

static void points_take(const struct umbt_technique_view *view, const struct umb_cascade_plan *plan,
                        uint32_t split, struct seam_points *points)
{
    const double at_m = plan->splits[split];
    const double band_m =
        BAND_SHARE * fmin(at_m - plan->splits[split - 1], plan->splits[split + 1] - at_m);
    const size_t half = view->buffer.receiver_count / 2 + 1;
    size_t found = 0;
    points->count[0] = points->count[1] = 0;
    for (size_t i = 0; i < view->buffer.receiver_count; i++) {
        const double *position = view->buffer.positions[i];
        double normal[3];
        umbt_widen(view->buffer.normals[i], normal);
        if (fabs(umbt_camera_depth(&view->setup.camera, position) - at_m) <= band_m &&
            umb__dot(normal, view->setup.to_light) > 0.0 &&
            is_on_map(&plan->frusta[split - 1], position) &&
            is_on_map(&plan->frusta[split], position)) {
            const size_t place = found % 2 * half + points->count[found % 2]++;
            memcpy(points->positions[place], position, sizeof points->positions[place]);
            memcpy(points->normals[place], view->buffer.normals[i], sizeof points->normals[place]);
            found++;
        }
    }
}

/* Computes the root mean square of the jump between two layers at the judging points. */
static enum umb_status jump(const struct umb_cascade_seam *seam, const struct umb_points *points,
                            double fine_contrast, double contrast, float *answers, double *rms,
                            struct umb_error *error)
{
    struct umb_map_filter fine = seam->fine_filter, coarse = seam->coarse_filter;
    struct umb_map_query queries[2];
    double sum = 0.0;
    fine.contrast = fine_contrast;
    coarse.contrast = contrast;
    UMB__TRY(umb_map_prepare(seam->fine, &fine, &queries[0], error));
    UMB__TRY(umb_map_prepare(seam->coarse, &coarse, &queries[1], error));
    umb_map_run(&queries[0], points, 0, points->count, answers);
    umb_map_run(&queries[1], points, 0, points->count, answers + points->count);
    for (size_t i = 0; i < points->count; i++) {
        const double d = (double)answers[points->count + i] - (double)answers[i];
        sum += d * d;
    }
    *rms = points->count > 0 ? sqrt(sum / (double)points->count) : 0.0;
    return UMB_OK;
}

static enum umb_status seam_run(struct umb_cascade_seam *seam, const struct seam_points *points,
                                size_t half, int match, struct umbt_seam *result,
                                struct umb_error *error)
{
    const struct umb_points finding =
        umbt_points_at(points->positions[0], points->normals[0], points->count[0]);
    const struct umb_points judging =
        umbt_points_at(points->positions[half], points->normals[half], points->count[1]);
    const double before = seam->fine_filter.contrast;
    result->points = points->count[0] + points->count[1];
    result->contrast = before;
    if (match && points->count[0] >= POINTS_MIN) {
        UMB__TRY(umb_cascades_match(seam, &finding, points->answers, error));
        result->contrast = seam->contrast;
    }
    UMB__TRY(jump(seam, &judging, 1.0, 1.0, points->answers, &result->before, error));
    return jump(seam, &judging, before, result->contrast, points->answers, &result->after, error);
}

enum umb_status umbt_seams_run(const struct umbt_technique_view *view,
                               const struct umb_cascade_plan *plan, struct umb_map *const maps[],
                               const struct umb_map_filter *filter, int match,
                               struct umbt_seam seams[UMB_CASCADES_MAX], struct umb_error *error)
{
    const size_t count = view->buffer.receiver_count + 2,
                 half = view->buffer.receiver_count / 2 + 1;
    struct seam_points points = {.positions = calloc(count, sizeof *points.positions),
                                 .normals = calloc(count, sizeof *points.normals),
                                 .answers = calloc(count, sizeof *points.answers)};
    enum umb_status status = UMB_OK;
    if (points.positions == NULL || points.normals == NULL || points.answers == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", count);
    }
    double contrast = 1.0;
    for (uint32_t i = 1; i < plan->count && status == UMB_OK; i++) {
        struct umb_cascade_seam seam = {.fine = maps[i - 1],
                                        .coarse = maps[i],
                                        .fine_filter = *filter,
                                        .coarse_filter = *filter};
        seam.fine_filter.contrast = contrast;
        seams[i - 1] = (struct umbt_seam){.distance_m = plan->splits[i]};
        points_take(view, plan, i, &points);
        status = seam_run(&seam, &points, half, match, &seams[i - 1], error);
        contrast = seams[i - 1].contrast;
    }
    free(points.positions);
    free(points.normals);
    free(points.answers);
    return status;
}
