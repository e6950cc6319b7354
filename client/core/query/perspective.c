/* SPDX-License-Identifier: Apache-2.0 */
/* See perspective.h. All arithmetic is in doubles, one point at a time, the same on all machines.
 */
#include "query/perspective.h"

#include <math.h>
#include <string.h>

#include "query/lamp_bias.h"
#include "query/slice_count.h"
#include "query/stages.h"

#define CHUNK 64U /* Points that are sorted by face at a time */

double umb__perspective_edge_m(const struct umb__query *q, uint32_t face, const double p[3])
{
    const struct umb_frustum_info *f = &q->faces[face];
    return (fabs(umb__face_row(f, 3, p)) * umb__texel_edges(f) + umb__length(f->voxel_step[2])) /
           3.0;
}

double umb__perspective_texel_m(const struct umb__query *q, const double p[3])
{
    double w;
    const struct umb_frustum_info *face = &q->faces[umb__face_of(q, p, &w)];
    return w * umb__texel_edges(face) / 2.0;
}

double umb__perspective_bias(const struct umb__query *q, uint32_t face, const double from_light[3],
                             const double n[3], double w)
{
    struct umb__lamp_bias bias;
    umb__lamp_bias_make(q, &q->faces[face], n, &bias);
    return umb__lamp_bias_at(&bias, umb__dot(n, from_light), 0, w);
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

/* Computes the voxel coordinates of the moved point. */
static void to_voxel(const struct umb__query *q, double w, struct umb__sighting *s)
{
    const struct umb_frustum_info *face = &q->faces[s->face];
    if (!(w > 0)) {
        s->voxel[0] = s->voxel[1] = s->voxel[2] = -UMB__FAR_VOXELS;
        return;
    }
    s->voxel[0] = umb__within(umb__face_row(face, 0, s->moved) / w, UMB__FAR_VOXELS);
    s->voxel[1] = umb__within(umb__face_row(face, 1, s->moved) / w, UMB__FAR_VOXELS);
    s->voxel[2] = umb__within(umb__face_row(face, 2, s->moved), UMB__FAR_VOXELS);
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
    s->face = umb__face_of(q, p, &w);
    for (unsigned axis = 0; axis < 3; axis++) {
        direction[axis] = has_normal ? n[axis] : distance > 0 ? -from_light[axis] / distance : 0;
    }
    /* If the move leads into another face, the bias must suffice for that face's voxels, too. */
    for (int pass = 0; pass < 2 && w > 0; pass++) {
        struct umb__lamp_bias lengths;
        umb__lamp_bias_make(q, &q->faces[s->face], has_normal ? n : NULL, &lengths);
        const double bias = umb__lamp_bias_at(&lengths, umb__dot(n, from_light), distance, w);
        s->bias_m = bias > s->bias_m ? bias : s->bias_m;
        for (unsigned axis = 0; axis < 3; axis++) {
            s->moved[axis] = p[axis] + direction[axis] * s->bias_m;
        }
        uint32_t face = umb__face_of(q, s->moved, &w);
        if (face == s->face) {
            break;
        }
        s->face = face;
        if (pass == 0) {
            w = umb__face_row(&q->faces[face], 3, p);
        }
    }
    if (s->bias_m == 0) { /* Not moved, or not seen by any face */
        memcpy(s->moved, p, sizeof p);
    }
    to_voxel(q, umb__face_row(&q->faces[s->face], 3, s->moved), s);
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
