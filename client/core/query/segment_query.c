/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lit intervals of segments. Under a directional light a segment is one line through the frustum
 * (segment_walk.h).
 *
 * Under a spot or point light a segment is cut where it passes from one face to another, by the
 * rule for points (perspective.h), and at the near plane of a face's frustum. Each piece is a line
 * of its own. For each face, the distance W along its axis is linear along the segment. At each
 * parameter the face with the largest W answers. The largest W is the upper envelope of lines, so
 * each face has at most one piece, later faces have greater slopes, and the cutting ends.
 */
#include "base/reserved.h"
#include "query/segment_walk.h"

/* A segment in one face: X, Y and W at parameter 0, and their changes up to parameter 1. */
struct sight {
    double at[3], gain[3];
};

static struct sight sight_of(const struct umb_frustum_info *face, const double p[2][3])
{
    static const unsigned rows[3] = {0, 1, 3};
    struct sight sight;
    for (unsigned i = 0; i < 3; i++) {
        sight.at[i] = umb__affine(face->world_to_voxel[rows[i]], p[0]);
        sight.gain[i] = umb__affine(face->world_to_voxel[rows[i]], p[1]) - sight.at[i];
    }
    return sight;
}

static double value_at(const struct sight *sight, unsigned i, double t)
{
    return sight->at[i] + t * sight->gain[i];
}

static bool are_finite(const struct umb__axis axes[3])
{
    for (unsigned k = 0; k < 3; k++) {
        if (!isfinite(axes[k].start) || !isfinite(axes[k].slope)) {
            return false;
        }
    }
    return true;
}

/* Walks the part of the piece beyond the face's near plane. */
static void walk_behind(const struct umb__volume *volume, uint32_t face, const struct sight *sight,
                        const struct umb__line *line, struct umb__intervals *out)
{
    const struct umb__tree tree = umb__volume_tree(volume, face);
    struct umb__axis axes[3];
    for (unsigned k = 0; k < 2; k++) {
        const double start = value_at(sight, k, line->from) / line->near_w;
        const double end = value_at(sight, k, line->to) / line->far_w;
        axes[k] = umb__axis_make(start, end - start, tree.log2_size, false);
    }
    axes[2] =
        umb__axis_make(-1 / line->near_w, 1 / line->near_w - 1 / line->far_w, tree.log2_size, true);
    umb__face_depth(&volume->faces[face], &axes[2].scale, &axes[2].offset);
    if (are_finite(axes)) {
        umb__walk_line(&tree, axes, line, out);
    } else {
        umb__intervals_put(out, true, line->from);
    }
}

/* Walks the piece from t = from to t = to, which belongs to one face. */
static void walk_piece(const struct umb__volume *volume, uint32_t face, const struct sight *sight,
                       double from, double to, struct umb__intervals *out)
{
    const double first_w = umb__face_first_w(&volume->faces[face]);
    struct umb__line line = {from, to, value_at(sight, 2, from), value_at(sight, 2, to)};
    const bool begins = line.near_w >= first_w, ends = line.far_w >= first_w;
    if (!(to > from)) {
        return;
    }
    if (!begins) {
        umb__intervals_put(out, true, from);
    }
    if (!begins && !ends) {
        return;
    }
    if (begins != ends) { /* so that W changes */
        const double cut = fmin(fmax((first_w - sight->at[2]) / sight->gain[2], from), to);
        *(begins ? &line.to : &line.from) = cut;
        *(begins ? &line.far_w : &line.near_w) = first_w;
    }
    if (line.to > line.from) {
        walk_behind(volume, face, sight, &line, out);
    }
    if (!ends) {
        umb__intervals_put(out, true, line.to);
    }
}

/* Walks a segment under a spot or point light. In: p: the segment's two ends, minus the asset's
 * origin. */
static void walk_faces(const struct umb__volume *volume, const double p[2][3],
                       struct umb__intervals *out)
{
    struct sight sights[UMB__FACES_MAX];
    uint32_t face = 0;
    for (uint32_t i = 0; i < volume->face_count; i++) {
        sights[i] = sight_of(&volume->faces[i], p);
        face = sights[i].at[2] > sights[face].at[2] ? i : face;
    }
    double t = 0;
    for (uint32_t turn = 0; turn < volume->face_count; turn++) {
        const struct sight *own = &sights[face];
        uint32_t next = face;
        double until = 1;
        for (uint32_t i = 0; i < volume->face_count; i++) {
            const double steeper = sights[i].gain[2] - own->gain[2];
            if (!(steeper > 0)) {
                continue;
            }
            const double meets = (own->at[2] - sights[i].at[2]) / steeper;
            if (meets < until ||
                (meets == until && next != face && sights[i].gain[2] > sights[next].gain[2])) {
                until = meets;
                next = i;
            }
        }
        until = fmax(until, t);
        walk_piece(volume, face, own, t, until, out);
        if (next == face) {
            return;
        }
        t = until;
        face = next;
    }
}

/* Computes the ends of segment i minus the asset's origin; returns its length in metres. */
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

/* A segment whose coordinates overflow cannot be walked and counts as lit. */
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
        walk_faces(volume, p, out);
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

/* Checks pairs of points. In: name: what error messages call them. */
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
