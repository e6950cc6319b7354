/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lit intervals of segments: each is one line through the frustum of a directional light
 * (segment_walk.h), or one for each face of a spot or point light that looks at it
 * (segment_faces.c).
 */
#include "query/segment_walk.h"
#include "base/reserved.h"

/* Ends of segment i minus the asset's origin; returns its length in metres. */
static double ends_of(const struct umb__volume *volume, const struct umb_segments *segments,
                      size_t i, double p[2][3])
{
    double length2 = 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        double offset = segments->origin[axis] - volume->origin[axis];
        for (unsigned k = 0; k < 2; k++) {
            p[k][axis] =
                offset + umb__scalar_at(segments->ends, segments->format, 6 * i + 3 * k + axis);
        }
        double d = p[1][axis] - p[0][axis];
        length2 += d * d;
    }
    return sqrt(length2);
}

/* One that cannot be walked, since its numbers overflow, is lit. */
static void walk_segment(const struct umb__volume *volume, const double p[2][3],
                         struct umb__intervals *out)
{
    static const struct umb__line whole = {0, 1, 1, 1};
    double start[3], end[3];
    bool finite = true;
    umb__volume_to_voxel(volume, p[0], start);
    umb__volume_to_voxel(volume, p[1], end);
    for (unsigned axis = 0; axis < 3; axis++) {
        finite = finite && isfinite(start[axis]) && isfinite(end[axis] - start[axis]);
    }
    if (!finite) {
        umb__intervals_put(out, true, 0);
    } else if (volume->face_count > 0) {
        umb__walk_faces(volume, p, out);
    } else {
        struct umb__axis axes[3];
        for (unsigned k = 0; k < 3; k++) {
            axes[k] = umb__axis_make(start[k], end[k] - start[k], volume->tree.log2_size, k == 2);
        }
        umb__walk_line(&volume->tree, axes, &whole, out);
    }
}

void umb_volume_segments(const struct umb_volume *volume, const struct umb_segments *segments,
                         size_t first, size_t count, struct umb_segment_answers *answers)
{
    const struct umb__volume v = umb__volume_of(volume);
    for (size_t i = first; i < first + count; i++) {
        double ends[2][3];
        double length_m = ends_of(&v, segments, i, ends);
        struct umb__intervals out = {
            .answer = &answers->segments[i],
            .kept = answers->interval_max ? answers->intervals + i * answers->interval_max : NULL,
            .kept_max = answers->interval_max,
            .stats = &answers->stats,
        };
        *out.answer = (struct umb_segment_answer){0};
        walk_segment(&v, (const double(*)[3])ends, &out);
        umb__intervals_end(&out);
        out.answer->lit_m = out.answer->lit * length_m;
    }
}

/* Checks pairs of points; name: what they are. */
static enum umb_status check_pairs(const struct umb_segments *segments, const char *name,
                                   struct umb_error *error)
{
    if (UMB__UNKNOWN(segments, name, error)) {
        return UMB_E_ARGUMENT;
    }
    /* A segment is two points that stand side by side. */
    struct umb_points points = {
        .positions = segments->ends, .format = segments->format, .count = 2 * segments->count};
    memcpy(points.origin, segments->origin, sizeof points.origin);
    struct umb_error bad = {0};
    enum umb_status status = umb_points_check(&points, &bad);
    if (status == UMB_OK) {
        return UMB_OK;
    }
    for (size_t i = 0; i < 6 * segments->count; i++) {
        double value = umb__scalar_at(segments->ends, segments->format, i);
        if (!isfinite(value)) {
            return umb_fail(error, status, "%s[%zu].%c%zu: %g, must be finite", name, i / 6,
                            "xyz"[i % 3], i / 3 % 2, value);
        }
    }
    return umb_fail(error, status, "%s", bad.message);
}

enum umb_status umb_segments_check(const struct umb_segments *segments, struct umb_error *error)
{
    return check_pairs(segments, "segments", error);
}

enum umb_status umb__corners_check(const struct umb_segments *corners, struct umb_error *error)
{
    return check_pairs(corners, "boxes", error);
}
