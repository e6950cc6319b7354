/* SPDX-License-Identifier: Apache-2.0 */
/* Contrasts of derived cascades, found at their seams; see derive_parts.h. */
#include <math.h>
#include <string.h>
#include "base/memory.h"
#include "base/vec.h"
#include "maps/derive_parts.h"

#define SEAM_SIDE 64 /* Rows of points over the view at a split, and points in each */
_Static_assert(SEAM_SIDE *SEAM_SIDE == UMB__SEAM_POINTS, "a seam is a square of points");

/* Points of a seam, and room for the two maps' answers. */
struct seam_room {
    double positions[UMB__SEAM_POINTS][3];
    float answers[2 * UMB__SEAM_POINTS];
};

size_t umb__derive_seam_bytes(const struct umb_derive_settings *settings)
{
    return settings->match_contrast ? sizeof(struct seam_room) : 0;
}

/* Computes the range of coordinates along one axis of a view in which the view's cross-section can
 * meet a box. The section reaches from -half to half, and the box reaches as far as its corners. */
static void section_clip(const struct umb__map_view *view, const double axis[3], double half,
                         const struct umb_box *box, double range[2])
{
    double low = INFINITY, high = -INFINITY;
    for (int corner = 0; corner < 8; corner++) {
        double p[3];
        for (int k = 0; k < 3; k++) {
            p[k] = ((corner >> k & 1) != 0 ? box->max[k] : box->min[k]) - view->eye[k];
        }
        const double at = umb__dot(axis, p);
        low = fmin(low, at);
        high = fmax(high, at);
    }
    range[0] = fmax(low, -half);
    range[1] = fmin(high, half);
}

/*
 * Spreads points over the view at a distance, and keeps those in the box. Any of them may be a
 * receiver, since an asset knows the light everywhere but not the surfaces. Rows are shifted by the
 * golden section of a step, so that no wall along the grid falls between them.
 */
static size_t seam_points(const struct umb__map_view *view, double distance,
                          const struct umb_box *box, double (*out)[3])
{
    double x[2], y[2];
    size_t count = 0;
    section_clip(view, view->right, distance * view->tan_x, box, x);
    section_clip(view, view->up, distance * view->tan_y, box, y);
    for (int row = 0; row < SEAM_SIDE && x[0] < x[1] && y[0] < y[1]; row++) {
        const double shift = fmod(0.61803398874989484820 * row, 1.0);
        const double v = y[0] + (y[1] - y[0]) * (row + 0.5) / SEAM_SIDE;
        for (int i = 0; i < SEAM_SIDE; i++) {
            const double u = x[0] + (x[1] - x[0]) * (i + shift) / SEAM_SIDE;
            int inside = 1;
            for (int k = 0; k < 3; k++) {
                const double p = view->eye[k] + distance * view->forward[k] + u * view->right[k] +
                                 v * view->up[k];
                inside = inside && p >= box->min[k] && p <= box->max[k];
                out[count][k] = p;
            }
            count += (size_t)inside;
        }
    }
    return count;
}

enum umb_status umb__derive_contrasts(struct umb__derived *whole, const struct umb__map_view *view,
                                      const struct umb_box *box, struct umb_error *error)
{
    const struct umb_derived *derived = &whole->shown;
    const double first = derived->settings.contrast > 0.0 ? derived->settings.contrast : 1.0;
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < derived->count; i++) {
        whole->contrast[i] = first;
    }
    if (!derived->settings.match_contrast) {
        return UMB_OK;
    }
    struct seam_room *room = umb__alloc(whole->alloc, 1, sizeof *room);
    if (room == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "points of a seam do not fit in memory");
    }
    for (uint32_t i = 1; i < derived->count && status == UMB_OK; i++) {
        struct umb_cascade_seam seam = {.fine = derived->maps[i - 1], .coarse = derived->maps[i]};
        const struct umb_points points = {
            .positions = room->positions,
            .format = UMB_POINT_F64,
            .count = seam_points(view, derived->splits[i], box, room->positions)};
        whole->contrast[i] = whole->contrast[i - 1];
        if (points.count > 0) {
            seam.fine_filter.contrast = whole->contrast[i - 1];
            status = umb_cascades_match(&seam, &points, room->answers, error);
            whole->contrast[i] = seam.contrast;
        }
    }
    umb__free(whole->alloc, room);
    return status;
}
