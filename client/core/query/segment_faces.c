/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Segments before spot and point lights: cut where another face looks at them, as points are
 * given to faces (perspective.h), and where a face's frustum begins; each piece is a line of its
 * own (segment_walk.h).
 *
 * The distances W along the faces' axes are linear along the segment. The largest of them is the
 * upper envelope of lines: each face looks at one piece at most, and those that follow have greater
 * slopes, so that the cutting ends.
 */
#include "query/segment_walk.h"

/* A segment seen by one face: X, Y and W at 0, and what they gain to 1. */
struct sight {
    double at[3], gain[3];
};

static double row_at(const double row[4], const double p[3])
{
    return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
}

static struct sight sight_of(const struct umb_frustum_info *face, const double p[2][3])
{
    static const unsigned rows[3] = {0, 1, 3};
    struct sight sight;
    for (unsigned i = 0; i < 3; i++) {
        sight.at[i] = row_at(face->world_to_voxel[rows[i]], p[0]);
        sight.gain[i] = row_at(face->world_to_voxel[rows[i]], p[1]) - sight.at[i];
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

/* Walks what of a piece lies behind the beginning of a face's frustum. */
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

/* Walks the piece from t = from to t = to, which a face looks at. */
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

void umb__walk_faces(const struct umb__volume *volume, const double p[2][3],
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
