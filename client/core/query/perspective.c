/* SPDX-License-Identifier: Apache-2.0 */
/* See perspective.h. All arithmetic is in doubles, one point at a time, the same on all machines.
 */
#include "query/perspective.h"

#include <math.h>
#include <string.h>

#include "query/slice_count.h"
#include "query/stages.h"

#define CHUNK      64U /* Points that are sorted by face at a time */
#define FAR_VOXELS 1e9 /* A place beyond every frustum, and far from the limits of int32_t */

/* Returns row i of the face's transform at p: X, Y, Z or W. */
static double row(const struct umb_frustum_info *face, unsigned i, const double p[3])
{
    return umb__affine(face->world_to_voxel[i], p);
}

/* Returns the face along whose axis p is farthest; 0 if p lies behind the light for all faces. */
static uint32_t face_of(const struct umb__query *q, const double p[3], double *w)
{
    uint32_t best = 0;
    *w = row(&q->faces[0], 3, p);
    for (uint32_t i = 1; i < q->face_count; i++) {
        double other = row(&q->faces[i], 3, p);
        if (other > *w) {
            *w = other;
            best = i;
        }
    }
    return best;
}

/*
 * Returns the length in metres of a move along the unit normal n after which the plane of the
 * surface is behind the whole window.
 *
 * In the moved point's slice of depth, which is a plane across the axis, a voxel is exactly W times
 * step[0] or step[1] wide. Along the ray it is (p - position) / W times the slice's thickness, and
 * over all texels of the window the ray leans by half the window's width. The move by s changes W
 * by s times the part of n along the axis: hence the division.
 */
static double bias_auto(const struct umb__query *q, const struct umb_frustum_info *face,
                        const double from_light[3], const double n[3], double w)
{
    const double *axis = face->world_to_voxel[3];
    /* A coarse look-up needs two cells, as under parallel light (query.c). */
    const double steps = q->level > 0 ? umb__coarse_steps(q) : 1;
    double taps = (double)q->taps * steps;
    double across = fabs(umb__dot(n, face->voxel_step[0])) + fabs(umb__dot(n, face->voxel_step[1]));
    double thickness = umb__dot(axis, face->voxel_step[2]) * steps; /* Of a slice or cell, in W */
    double along = (fabs(umb__dot(n, from_light)) / w + 0.5 * taps * across) * thickness;
    double growth = 0.5 * taps * across * umb__dot(n, axis);
    double rest = growth > 0 ? 1.0 - growth : 1.0;
    return 0.5 * UMB__BIAS_SLACK * (taps * across * w + along) / (rest > 0.25 ? rest : 0.25);
}

/* Returns the sum of the edges of a face's texels where W = 1. */
static double texel_edges(const struct umb_frustum_info *face)
{
    return umb__length(face->voxel_step[0]) + umb__length(face->voxel_step[1]);
}

static double mean_edge(const struct umb_frustum_info *face, double w)
{
    return (w * texel_edges(face) + umb__length(face->voxel_step[2])) / 3.0;
}

double umb__perspective_edge_m(const struct umb__query *q, uint32_t face, const double p[3])
{
    return mean_edge(&q->faces[face], fabs(row(&q->faces[face], 3, p)));
}

double umb__perspective_texel_m(const struct umb__query *q, const double p[3])
{
    double w;
    const struct umb_frustum_info *face = &q->faces[face_of(q, p, &w)];
    return w * texel_edges(face) / 2.0;
}

double umb__perspective_bias(const struct umb__query *q, uint32_t face, const double from_light[3],
                             const double n[3], double w)
{
    switch (q->bias_mode) {
    case UMB_BIAS_AUTO:
        return bias_auto(q, &q->faces[face], from_light, n, w);
    case UMB_BIAS_VOXELS:
        return q->bias_m * mean_edge(&q->faces[face], w);
    case UMB_BIAS_METRES:
        return q->bias_m;
    case UMB_BIAS_NONE:
        break;
    }
    return 0.0;
}

/* Returns the bias towards the light, for points without a normal. */
static double bias_to_light(const struct umb__query *q, uint32_t face, double distance, double w)
{
    static const double no_normal[3] = {0, 0, 0};
    if (q->bias_mode != UMB_BIAS_AUTO) {
        return umb__perspective_bias(q, face, no_normal, no_normal, w);
    }
    /* (2 taps + 1) / (2 sqrt(3)) voxels of depth, as for parallel light. */
    const struct umb_frustum_info *f = &q->faces[face];
    const double steps = q->level > 0 ? umb__coarse_steps(q) : 1;
    double thickness = umb__dot(f->world_to_voxel[3], f->voxel_step[2]) * steps;
    return UMB__BIAS_SLACK * (2.0 * q->taps + 1.0) / (2.0 * sqrt(3.0)) * thickness * distance / w;
}

/* Reads the unit normal of point i; false if it has none. */
static bool unit_normal_of(const struct umb_points *points, size_t i, double n[3])
{
    const double length2 = umb__normal(points, i, n);
    if (!umb__is_normal(length2)) {
        return false;
    }
    const double length = sqrt(length2);
    for (unsigned axis = 0; axis < 3; axis++) {
        n[axis] /= length;
    }
    return true;
}

static double within(double v, double limit)
{
    return v > -limit ? (v < limit ? v : limit) : -limit; /* NaN becomes -limit */
}

/* Computes the voxel coordinates of the moved point. */
static void to_voxel(const struct umb__query *q, double w, struct umb__sighting *s)
{
    const struct umb_frustum_info *face = &q->faces[s->face];
    if (!(w > 0)) {
        s->voxel[0] = s->voxel[1] = s->voxel[2] = -FAR_VOXELS;
        return;
    }
    s->voxel[0] = within(row(face, 0, s->moved) / w, FAR_VOXELS);
    s->voxel[1] = within(row(face, 1, s->moved) / w, FAR_VOXELS);
    s->voxel[2] = within(row(face, 2, s->moved), FAR_VOXELS);
}

void umb__perspective_map(const struct umb__query *q, const struct umb_points *points, size_t i,
                          struct umb__sighting *s)
{
    double p[3], from_light[3], n[3], direction[3], w;
    memset(s, 0, sizeof *s);
    umb__position(q, points, i, p);
    umb__subtract(p, q->position, from_light);
    const bool has_normal = unit_normal_of(points, i, n);
    double distance = umb__length(from_light);
    s->has_normal = has_normal;
    if (has_normal) {
        s->facing_away = umb__dot(n, from_light) >= 0;
        s->cosine = distance > 0 ? -umb__dot(n, from_light) / distance : 0;
    }
    s->facing_away |= umb__is_behind_light(q, from_light);
    if (s->facing_away) {
        return;
    }
    s->face = face_of(q, p, &w);
    for (unsigned axis = 0; axis < 3; axis++) {
        direction[axis] = has_normal ? n[axis] : distance > 0 ? -from_light[axis] / distance : 0;
    }
    /* If the move leads into another face, the bias must suffice for that face's voxels, too. */
    for (int pass = 0; pass < 2 && w > 0; pass++) {
        double bias = has_normal ? umb__perspective_bias(q, s->face, from_light, n, w)
                                 : bias_to_light(q, s->face, distance, w);
        s->bias_m = bias > s->bias_m ? bias : s->bias_m;
        for (unsigned axis = 0; axis < 3; axis++) {
            s->moved[axis] = p[axis] + direction[axis] * s->bias_m;
        }
        uint32_t face = face_of(q, s->moved, &w);
        if (face == s->face) {
            break;
        }
        s->face = face;
        if (pass == 0) {
            w = row(&q->faces[face], 3, p);
        }
    }
    if (s->bias_m == 0) { /* Not moved, or not seen by any face */
        memcpy(s->moved, p, sizeof p);
    }
    to_voxel(q, row(&q->faces[s->face], 3, s->moved), s);
}

bool umb__look_up_at(const struct umb__query *q, const struct umb_points *points, size_t i,
                     double voxel[3], uint32_t *frustum)
{
    if (q->face_count == 0) {
        *frustum = q->frustum;
        return umb__voxel_at(q, points, i, voxel);
    }
    struct umb__sighting s;
    umb__perspective_map(q, points, i, &s);
    memcpy(voxel, s.voxel, sizeof s.voxel);
    *frustum = q->first_face + s.face;
    return !s.facing_away;
}

void umb__perspective_face(const struct umb__query *q, uint32_t face, struct umb__query *face_query)
{
    *face_query = *q;
    face_query->grid = q->grid + q->tops[face].first_cell;
    face_query->columns = q->columns + q->tops[face].first_column;
    face_query->pieces = q->pieces + q->tops[face].first_piece;
    face_query->log2_size = q->faces[face].log2_size;
    face_query->grid_log2 = q->tops[face].grid_log2;
    face_query->column_level = q->tops[face].column_level;
    face_query->frustum = q->first_face + face;
    face_query->format = UMB_ANSWER_F32;
    face_query->bias_mode = UMB_BIAS_NONE;
    face_query->bias_m = 0;
    face_query->no_normal_m = 0;
    face_query->faces = NULL;
    face_query->tops = NULL;
    face_query->face_count = 0;
    face_query->trans = NULL;
    for (unsigned i = 0; i < 3; i++) {
        face_query->origin[i] = 0;
        face_query->direction[i] = i == 2;
        for (unsigned k = 0; k < 3; k++) {
            face_query->world_to_voxel[i][k] = i == k;
            face_query->voxel_step[i][k] = i == k;
        }
        face_query->world_to_voxel[i][3] = 0;
    }
}

/* Some points, answered by one face after another. */
struct chunk {
    struct umb__sighting seen[CHUNK];
    uint32_t lit[CHUNK];
};

/* Returns the count that stands for a wholly lit answer: the sum of the window's weights. A coarse
 * look-up answers 0, 1/2 or 1, so it counts halves. */
static uint32_t counted_in(const struct umb__query *q)
{
    return q->level > 0 ? 2 : q->total;
}

/* Answers the chunk's points that belong to a face. */
static void run_face(const struct umb__query *q, uint32_t face, struct chunk *chunk, size_t count,
                     struct umb_query_stats *stats)
{
    double voxels[CHUNK][3];
    uint32_t places[CHUNK];
    float values[CHUNK];
    size_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (!chunk->seen[i].facing_away && chunk->seen[i].face == face) {
            memcpy(voxels[found], chunk->seen[i].voxel, sizeof voxels[found]);
            places[found++] = i;
        }
    }
    if (found == 0) {
        return;
    }
    struct umb__query face_query;
    umb__perspective_face(q, face, &face_query);
    const struct umb_points points = {.positions = voxels, .format = UMB_POINT_F64, .count = found};
    struct umb_answers answers = {.values = values, .stats = *stats};
    face_query.kernel(&face_query, &points, 0, found, &answers);
    answers.stats.points = stats->points;
    *stats = answers.stats;
    for (size_t i = 0; i < found; i++) {
        /* The float is the one nearest to lit / total. The total is below 2^13 or a power of two up
         * to 2^22, so the product rounds to lit exactly. */
        chunk->lit[places[i]] = (uint32_t)((double)values[i] * (double)counted_in(q) + 0.5);
    }
}

static void perspective_run(const struct umb__query *q, const struct umb_points *points,
                            size_t first, size_t count, struct umb_answers *answers)
{
    const uint32_t total = counted_in(q);
    for (size_t at = first; at < first + count; at += CHUNK) {
        struct chunk chunk;
        size_t n = first + count - at < CHUNK ? first + count - at : CHUNK;
        for (size_t i = 0; i < n; i++) {
            umb__perspective_map(q, points, at + i, &chunk.seen[i]);
            chunk.lit[i] = 0;
            answers->stats.facing_away += (uint64_t)chunk.seen[i].facing_away;
        }
        for (uint32_t face = 0; face < q->face_count; face++) {
            run_face(q, face, &chunk, n, &answers->stats);
        }
        for (size_t i = 0; i < n; i++) {
            umb__store_answer(answers->values, q->format, at + i, chunk.lit[i], total);
        }
    }
    answers->stats.points += count;
}

/* Returns the odd number of texels nearest to the wanted width in metres at point i. */
static int32_t taps_at(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    double p[3];
    umb__position(q, points, i, p);
    const double texel_m = umb__perspective_texel_m(q, p);
    const double half = texel_m > 0 ? floor(q->footprint_m / texel_m / 2) : 0;
    return half < UMB_TAPS_MAX / 2 ? 2 * (int32_t)half + 1 : UMB_TAPS_MAX;
}

/* Answers windows with a width in metres. Points whose windows have the same width in texels form a
 * batch of their own. */
static void width_run(const struct umb__query *q, const struct umb_points *points, size_t first,
                      size_t count, struct umb_answers *answers)
{
    for (size_t at = first; at < first + count; at += CHUNK) {
        const size_t n = first + count - at < CHUNK ? first + count - at : CHUNK;
        int32_t taps[CHUNK];
        float values[CHUNK];
        for (size_t i = 0; i < n; i++) {
            taps[i] = taps_at(q, points, at + i);
        }
        for (int32_t width = 1; width <= UMB_TAPS_MAX; width += 2) {
            struct umb__query one = *q;
            one.taps = width;
            one.total = q->total_of != NULL ? q->total_of(width) : (uint32_t)(width * width);
            one.format = UMB_ANSWER_F32;
            for (size_t i = 0, end; i < n; i = end) {
                for (end = i; end < n && (taps[end] == width) == (taps[i] == width); end++) {
                }
                if (taps[i] == width) {
                    const struct umb_points some = umb__some_points(points, at + i, end - i);
                    struct umb_answers part = {.values = values + i, .stats = answers->stats};
                    perspective_run(&one, &some, 0, end - i, &part);
                    answers->stats = part.stats;
                }
            }
        }
        for (size_t i = 0; i < n; i++) {
            umb__store_share(answers->values, q->format, at + i, (double)values[i]);
        }
    }
}

static bool applies(const struct umb__plan *plan)
{
    return plan->light->kind != UMB_LIGHT_DIRECTIONAL;
}

/* Sets up the values that do not depend on the point. */
static void set(const struct umb__plan *plan, struct umb__query *q)
{
    const uint32_t first = plan->light->first_frustum;
    q->grid = plan->asset->view.grid;
    q->columns = plan->asset->view.columns;
    q->pieces = plan->asset->view.pieces;
    q->faces = plan->frustum;
    q->tops = &plan->asset->view.tops[first];
    q->face_count = plan->light->frustum_count;
    q->first_face = first;
    q->bias_m = plan->settings->bias;
    q->lamp = plan->light;
    umb__subtract(plan->light->position, plan->content->origin, q->position);
    q->run = perspective_run;
    if (plan->filter->lamp_run != NULL) {
        q->run = plan->filter->lamp_run;
    } else if (plan->filter->info.is_window && plan->settings->footprint_m > 0) {
        q->footprint_m = plan->settings->footprint_m;
        q->run = width_run;
    }
}

const struct umb__stage umb__faces_stage = {applies, set};
