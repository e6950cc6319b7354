/* SPDX-License-Identifier: Apache-2.0 */
/* Fitting and projecting triangles. Both cut triangles to the pyramid before any division. */
#include "bake/analysis/perspective_frame.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "base/vec.h"
#include "bake/analysis/eye_clip.h"
#include "bake/depth/cut_out.h"

/* Extents of u / W, v / W and W over the casters that the face sees. */
static void measure(const struct umbb_fit *fit, const struct umbb_eye *eye, double tangent,
                    struct umbb_extent extents[3])
{
    const struct umbb_pyramid pyramid = {.low = {-tangent, -tangent},
                                         .high = {tangent, tangent},
                                         .near = eye->reach * UMBB_NEAR_SHARE};
    for (int axis = 0; axis < 3; axis++) {
        extents[axis] = (struct umbb_extent){INFINITY, -INFINITY};
    }
    for (size_t i = 0; i < fit->count; i++) {
        double triangle[3][3], at[3];
        struct umbb_polygon polygon;
        for (int k = 0; k < 3; k++) {
            umb__subtract(fit->corners[i][k], eye->position, at);
            for (int axis = 0; axis < 3; axis++) {
                triangle[k][axis] = umb__dot(eye->axes[axis], at);
            }
        }
        umbb_eye_clip(&pyramid, (const double(*)[3])triangle, &polygon);
        for (size_t k = 0; k < polygon.count; k++) {
            const double *p = polygon.corners[k];
            umbb_extent_add(&extents[0], p[0] / p[2]);
            umbb_extent_add(&extents[1], p[1] / p[2]);
            umbb_extent_add(&extents[2], p[2]);
        }
    }
}

int umbb_perspective_fit(const struct umbb_fit *fit, const struct umbb_eye *eye,
                         struct umb_frustum_info *frustum)
{
    const double size = (double)((uint32_t)1 << fit->log2_size);
    const double tangent = umbb_guarded_tangent(eye->tangent, fit->log2_size);
    struct umbb_extent extents[3];
    double eye_at[3];
    measure(fit, eye, tangent, extents);
    const int seen = extents[2].low <= extents[2].high;
    if (!seen) {
        extents[0] = extents[1] = (struct umbb_extent){-tangent, tangent};
        extents[2] = (struct umbb_extent){eye->reach * UMBB_NEAR_SHARE, eye->reach};
    }
    const double far = extents[2].high;
    const double wide = fmax(extents[0].high - extents[0].low, extents[1].high - extents[1].low);
    const double most = fmax(wide * far, far - extents[2].low);
    const double least[3] = {most / far * UMBB_EXTENT_SHARE_MIN, most / far * UMBB_EXTENT_SHARE_MIN,
                             fmax(most * UMBB_EXTENT_SHARE_MIN, eye->voxel_min * (size - 2.0))};
    const double *w = eye->axes[2];
    double(*m)[4] = frustum->world_to_voxel;
    umb__subtract(eye->position, fit->origin, eye_at);
    memset(frustum, 0, sizeof *frustum);
    frustum->log2_size = fit->log2_size;
    for (int axis = 0; axis < 3; axis++) {
        const double *along = eye->axes[axis];
        double offset;
        const double scale = umbb_extent_scale(&extents[axis], least[axis], size, &offset);
        for (int k = 0; k < 3; k++) {
            m[axis][k] = along[k] * scale + (axis < 2 ? w[k] * offset : 0.0);
            frustum->voxel_step[axis][k] = along[k] / scale;
        }
        m[axis][3] = (axis < 2 ? 0.0 : offset) - umb__dot(m[axis], eye_at);
    }
    memcpy(m[3], w, 3 * sizeof *w);
    m[3][3] = -umb__dot(w, eye_at);
    return seen;
}

void umbb_eye_corners(const struct umb_frustum_info *frustum, const double origin[3],
                      const double triangle[3][3], double corners[3][3])
{
    static const int rows[3] = {0, 1, 3};
    for (int k = 0; k < 3; k++) {
        double at[3];
        umb__subtract(triangle[k], origin, at);
        for (int r = 0; r < 3; r++) {
            const double *row = frustum->world_to_voxel[rows[r]];
            corners[k][r] = umb__dot(row, at) + row[3];
        }
    }
}

/* Input of a projection, and the limit of its triangles. */
struct source {
    const struct umbb_casters *world;
    double near;
    size_t max_bytes;
    int has_cuts;
};

/* Makes room for one more triangle. */
static enum umb_status reserve(struct umbb_projected *projected, const struct source *source,
                               struct umb_error *error)
{
    const int has_cuts = source->has_cuts;
    const size_t max_bytes = source->max_bytes;
    const size_t bytes = sizeof *projected->corners + sizeof *projected->kinds +
                         (has_cuts ? sizeof *projected->cuts : 0);
    if (projected->count < projected->capacity) {
        return UMB_OK;
    }
    if (projected->count >= max_bytes / bytes) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: the triangles that a light sees take more than %zu MiB",
                        max_bytes >> 20);
    }
    size_t capacity = projected->capacity == 0 ? 1024 : projected->capacity * 3 / 2;
    capacity = capacity < max_bytes / bytes ? capacity : max_bytes / bytes;
    double(*corners)[3][3] = realloc(projected->corners, capacity * sizeof *corners);
    if (corners != NULL) {
        projected->corners = corners;
    }
    uint8_t *kinds = realloc(projected->kinds, capacity);
    if (kinds != NULL) {
        projected->kinds = kinds;
    }
    uint32_t *cuts = has_cuts ? realloc(projected->cuts, capacity * sizeof *cuts) : NULL;
    if (cuts != NULL) {
        projected->cuts = cuts;
    }
    if (corners == NULL || kinds == NULL || (has_cuts && cuts == NULL)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "lights: memory for %zu triangles refused",
                        capacity);
    }
    projected->capacity = capacity;
    return UMB_OK;
}

/* Adds a polygon, the rest of a world triangle after cutting, as a fan of triangles. */
static enum umb_status add_polygon(struct umbb_projected *projected,
                                   const struct umbb_polygon *polygon, const struct source *source,
                                   size_t number, struct umb_error *error)
{
    double at[UMBB_CLIP_CORNERS_MAX][3];
    for (size_t i = 0; i < polygon->count; i++) {
        const double *p = polygon->corners[i];
        at[i][0] = p[0] / p[2];
        at[i][1] = p[1] / p[2];
        at[i][2] = source->near / p[2];
    }
    for (size_t i = 2; i < polygon->count; i++) {
        UMB__TRY(reserve(projected, source, error));
        double(*to)[3] = projected->corners[projected->count];
        memcpy(to[0], at[0], sizeof at[0]);
        memcpy(to[1], at[i - 1], sizeof at[0]);
        memcpy(to[2], at[i], sizeof at[0]);
        if (source->has_cuts) {
            projected->cuts[projected->count] = source->world->cuts->of[number];
        }
        projected->kinds[projected->count++] = source->world->kinds[number];
    }
    return UMB_OK;
}

enum umb_status umbb_perspective_project(const struct umbb_casters *world,
                                         const struct umbb_eye_view *view,
                                         struct umbb_projected *projected, struct umb_error *error)
{
    const double(*m)[4] = view->frustum->world_to_voxel;
    const double size = (double)((uint32_t)1 << view->frustum->log2_size);
    const double near = view->reach * UMBB_NEAR_SHARE;
    const struct umbb_pyramid pyramid = {
        .low = {-1.0, -1.0}, .high = {size + 1.0, size + 1.0}, .near = near};
    const struct source source = {.world = world,
                                  .near = near,
                                  .max_bytes = view->max_bytes,
                                  .has_cuts = world->cuts != NULL && world->cuts->of != NULL};
    const double rate = umb__dot(m[2], m[3]) / umb__dot(m[3], m[3]); /* Z = rate W + offset */
    memset(projected, 0, sizeof *projected);
    projected->depth_scale = rate * near;
    projected->depth_offset = m[2][3] - rate * m[3][3];
    for (size_t i = 0; i < world->count; i++) {
        double triangle[3][3];
        struct umbb_polygon polygon;
        umbb_eye_corners(view->frustum, view->origin, world->corners[i], triangle);
        umbb_eye_clip(&pyramid, (const double(*)[3])triangle, &polygon);
        UMB__TRY(add_polygon(projected, &polygon, &source, i, error));
    }
    return UMB_OK;
}

void umbb_projected_finish(struct umbb_projected *projected)
{
    free(projected->corners);
    free(projected->kinds);
    free(projected->cuts);
    memset(projected, 0, sizeof *projected);
}
