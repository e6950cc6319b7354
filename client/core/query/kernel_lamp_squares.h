/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_LAMP_SQUARES_H
#define UMBRAGE_CORE_QUERY_KERNEL_LAMP_SQUARES_H
/*
 * Places the samples of footprints under spot and point lights: a step of kernel_squares_body.h.
 *
 * The samples of a receiver share its normal, and nearly always its face. The face of the receiver
 * is assumed, all samples are moved and mapped in lanes as umb__perspective_map does, with the same
 * bits, and each lane proves that no other face would have been chosen. Samples without the proof
 * go through umb__perspective_map. Every loop is over all lanes without branches, so that compilers
 * vectorise it.
 */
#include "query/kernel_square_steps.h"
#include "query/lamp_bias.h"
#include "query/perspective.h"

#define UMB__EACH_SAMPLE(k) (uint32_t k = 0; k < UMB__SAMPLES; k++)

/* Values of a sample in place of its face. */
#define UMB__FACE_LIT  0xfeU /* Outside the frusta */
#define UMB__FACE_DARK 0xffU /* The surface faces away */

/* One number for each sample. */
typedef double umb__sample_doubles[UMB__SAMPLES];

/* The samples of a receiver. */
struct umb__lamp_samples {
    const struct umb__query *query;
    const struct umb__receivers *receivers;
    uint32_t lane, face;                       /* The receiver, and the face assumed */
    double normal[3];                          /* Unit normal of the receiver; 0 without one */
    _Alignas(64) umb__sample_doubles place[3]; /* Metres, relative to the asset's origin */
    umb__sample_doubles from[3];               /* From the light to the place */
    umb__sample_doubles along;                 /* The same along the normal */
    umb__sample_doubles distance;              /* Length of `from`; without normals only */
    umb__sample_doubles w;                     /* W of the face at the place */
    umb__sample_doubles bias;                  /* Length of the move, metres */
    umb__sample_doubles moved[3];              /* Place after the move ... */
    umb__sample_doubles moved_w;               /* ... and W of the face there */
    uint64_t dark[UMB__SAMPLES];               /* 1: faces away from the light */
    uint64_t sure[UMB__SAMPLES];               /* 1: proven to be in the face */
};

/* Places the samples of both squares. In: a, b: unit vectors along the surface. */
UMB__INLINE void umb__lamp_places(struct umb__lamp_samples *s, const double a[3], const double b[3])
{
    const struct umb__receivers *r = s->receivers;
    const uint32_t i = s->lane;
    for (uint32_t wide = 0; wide < 2; wide++) {
        const double side = r->level_m[i] * (wide ? 2 : 1);
        const double lift =
            s->query->bias_mode == UMB_BIAS_AUTO ? 0.5 * fmin(side, r->reach[i]) : 0;
        for (unsigned axis = 0; axis < 3; axis++) {
            const double p = r->p[axis][i], along = a[axis], across = b[axis];
            const double up = lift * r->light[axis][i];
            double *to = s->place[axis] + (size_t)UMB__SQUARE_SAMPLES * wide;
            for (uint32_t k = 0; k < UMB__SQUARE_SAMPLES; k++) {
                to[k] =
                    p + umb__lattice[0][k] * side * along + umb__lattice[1][k] * side * across - up;
            }
        }
    }
}

/* Finds the samples that face away. */
UMB__INLINE void umb__lamp_sides(struct umb__lamp_samples *s)
{
    const struct umb__query *q = s->query;
    const double *n = s->normal, *d = q->direction;
    const uint64_t has_normal = s->receivers->has_normal[s->lane];
    for
        UMB__EACH_SAMPLE(k)
        {
            const double x = s->place[0][k] - q->position[0];
            const double y = s->place[1][k] - q->position[1];
            const double z = s->place[2][k] - q->position[2];
            const double along = n[0] * x + n[1] * y + n[2] * z;
            s->from[0][k] = x;
            s->from[1][k] = y;
            s->from[2][k] = z;
            s->along[k] = along;
            s->dark[k] = has_normal & (along >= 0 ? 1 : 0);
        }
    for (uint32_t k = 0; k < UMB__SAMPLES && umb__is_one_sided(q); k++) {
        const double ahead = s->from[0][k] * d[0] + s->from[1][k] * d[1] + s->from[2][k] * d[2];
        s->dark[k] |= ahead > 0 ? 0 : 1;
    }
}

UMB__INLINE void umb__lamp_distances(struct umb__lamp_samples *s)
{
    for
        UMB__EACH_SAMPLE(k)
        {
            const double x = s->from[0][k], y = s->from[1][k], z = s->from[2][k];
            s->distance[k] = sqrt(x * x + y * y + z * z);
        }
}

/* Finds the lengths of the moves. */
UMB__INLINE void umb__lamp_biases(struct umb__lamp_samples *s)
{
    struct umb__lamp_bias b;
    const double *m = s->query->faces[s->face].world_to_voxel[3];
    umb__lamp_bias_make(s->query, &s->query->faces[s->face],
                        s->receivers->has_normal[s->lane] ? s->normal : NULL, &b);
    for
        UMB__EACH_SAMPLE(k)
        {
            s->w[k] = m[0] * s->place[0][k] + m[1] * s->place[1][k] + m[2] * s->place[2][k] + m[3];
        }
    switch (b.move) {
    case UMB__MOVE_NORMAL:
        for
            UMB__EACH_SAMPLE(k)
            {
                s->bias[k] = umb__bias_undivided(&b, s->along[k], s->w[k]);
            }
        for (uint32_t k = 0; k < UMB__SAMPLES && b.rest != 1; k++) { /* Divisions by 1 are dear */
            s->bias[k] /= b.rest;
        }
        break;
    case UMB__MOVE_TO_LIGHT:
        for
            UMB__EACH_SAMPLE(k)
            {
                s->bias[k] = umb__bias_to_light(&b, s->distance[k], s->w[k]);
            }
        break;
    case UMB__MOVE_EDGES:
        for
            UMB__EACH_SAMPLE(k)
            {
                s->bias[k] = umb__bias_of_edges(&b, s->w[k]);
            }
        break;
    case UMB__MOVE_METRES:
        for
            UMB__EACH_SAMPLE(k)
            {
                s->bias[k] = b.metres;
            }
        break;
    }
}

/* Moves the samples along the normal, or towards the light without one. */
UMB__INLINE void umb__lamp_move(struct umb__lamp_samples *s)
{
    const bool has_normal = s->receivers->has_normal[s->lane] != 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        const double n = s->normal[axis];
        for (uint32_t k = 0; k < UMB__SAMPLES && has_normal; k++) {
            const double p = s->place[axis][k], bias = s->bias[k] > 0 ? s->bias[k] : 0;
            const double moved = p + n * bias;
            s->moved[axis][k] = bias > 0 ? moved : p;
        }
        for (uint32_t k = 0; k < UMB__SAMPLES && !has_normal; k++) {
            const double p = s->place[axis][k], bias = s->bias[k] > 0 ? s->bias[k] : 0;
            const double away = -s->from[axis][k] / s->distance[k];
            const double moved = p + (s->distance[k] > 0 ? away : 0) * bias;
            s->moved[axis][k] = bias > 0 ? moved : p;
        }
    }
}

/* Finds W of the face after the move. Out: `sure`: W is above 0 before and after it. */
UMB__INLINE void umb__lamp_moved_w(struct umb__lamp_samples *s)
{
    double m[4]; /* A copy: compilers know that the loop does not change it */
    memcpy(m, s->query->faces[s->face].world_to_voxel[3], sizeof m);
    for
        UMB__EACH_SAMPLE(k)
        {
            const double w =
                m[0] * s->moved[0][k] + m[1] * s->moved[1][k] + m[2] * s->moved[2][k] + m[3];
            s->moved_w[k] = w;
            s->sure[k] = (s->w[k] > 0 ? 1 : 0) & (w > 0 ? 1 : 0);
        }
}

/* Returns whether the other face is surely farther from all samples than theirs, by the distance of
 * the receiver and the extent of its squares. In: p: the receiver. extent: metres. */
static inline bool umb__is_far_face(const struct umb__lamp_samples *s, uint32_t other,
                                    const double p[3], double extent)
{
    const double *m = s->query->faces[s->face].world_to_voxel[3];
    const double *o = s->query->faces[other].world_to_voxel[3];
    const double apart = umb__affine(m, p) - umb__affine(o, p);
    double change = 0, size = fabs(m[3]) + fabs(o[3]);
    for (unsigned axis = 0; axis < 3; axis++) {
        change += fabs(m[axis] - o[axis]);
        size += fabs(p[axis]) + extent;
    }
    return apart > change * extent + 1e-9 * size; /* Rounding is below 1e-14 of the size */
}

/* Proves that the samples are in the face, before and after their move. In: most: longest move. */
UMB__INLINE void umb__lamp_prove(struct umb__lamp_samples *s, double most)
{
    const struct umb__query *q = s->query;
    const struct umb__receivers *r = s->receivers;
    const double p[3] = {r->p[0][s->lane], r->p[1][s->lane], r->p[2][s->lane]};
    /* The wide square is 2 level_m wide, and lifted by half of that. */
    const double extent = 2.5 * r->level_m[s->lane] + most;
    for (uint32_t face = 0; face < q->face_count; face++) {
        if (face == s->face || umb__is_far_face(s, face, p, extent)) {
            continue;
        }
        double o[4]; /* A copy, as above */
        memcpy(o, q->faces[face].world_to_voxel[3], sizeof o);
        for
            UMB__EACH_SAMPLE(k)
            {
                const double at =
                    o[0] * s->place[0][k] + o[1] * s->place[1][k] + o[2] * s->place[2][k] + o[3];
                const double then =
                    o[0] * s->moved[0][k] + o[1] * s->moved[1][k] + o[2] * s->moved[2][k] + o[3];
                s->sure[k] &= (at < s->w[k] ? 1 : 0) & (then < s->moved_w[k] ? 1 : 0);
            }
    }
}

/* Stores the voxels of the samples, as if all were in the face. Samples outside the frustum get a
 * voxel on its edge. */
UMB__INLINE void umb__lamp_voxels(const struct umb__lamp_samples *s, struct umb__samples *samples,
                                  struct umb__child_bytes *faces)
{
    const struct umb_frustum_info *face = &s->query->faces[s->face];
    const double size = (double)((uint32_t)1 << face->log2_size), last = size - 1;
    double m[3][4];
    uint64_t inside[UMB__SAMPLES];
    memcpy(m, face->world_to_voxel, sizeof m);
    for (unsigned axis = 0; axis < 3; axis++) {
        int32_t *to = axis == 0 ? samples->x : axis == 1 ? samples->y : samples->z;
        const uint64_t behind = axis < 2 ? 0 : 1; /* Counts as in the last voxel */
        for
            UMB__EACH_SAMPLE(k)
            {
                const double x = m[axis][0] * s->moved[0][k] + m[axis][1] * s->moved[1][k] +
                                 m[axis][2] * s->moved[2][k] + m[axis][3];
                const double v = axis < 2 ? x / s->moved_w[k] : x;
                const double held = v < last ? v : last, voxel = v >= 0 ? held : 0;
                const uint64_t in = (v >= 0 ? 1 : 0) & ((v < size ? 1 : 0) | behind);
                inside[k] = axis == 0 ? in : inside[k] & in;
                to[k] = (int32_t)voxel;
                samples->low[axis][k] = (uint16_t)(int32_t)voxel;
            }
    }
    for
        UMB__EACH_SAMPLE(k)
        {
            const uint64_t found = inside[k] ? s->face : UMB__FACE_LIT;
            faces->of[k] = (uint8_t)(s->dark[k] ? UMB__FACE_DARK : found);
        }
}

/* Places sample k, which may be in any face. */
static inline void umb__lamp_place_alone(const struct umb__lamp_samples *s, uint32_t k,
                                         struct umb__samples *samples,
                                         struct umb__child_bytes *faces)
{
    const struct umb__query *q = s->query;
    const struct umb__receivers *r = s->receivers;
    const double place[3] = {s->place[0][k], s->place[1][k], s->place[2][k]};
    const float normal[3] = {(float)r->given[0][s->lane], (float)r->given[1][s->lane],
                             (float)r->given[2][s->lane]};
    struct umb_points one = {.positions = place,
                             .format = UMB_POINT_F64,
                             .normals = r->has_normal[s->lane] ? normal : NULL,
                             .count = 1};
    struct umb__sighting seen;
    memcpy(one.origin, q->origin, sizeof one.origin);
    umb__perspective_map(q, &one, 0, &seen);
    const double size = (double)((uint32_t)1 << q->faces[seen.face].log2_size), *v = seen.voxel;
    const bool in = v[0] >= 0 && v[0] < size && v[1] >= 0 && v[1] < size && v[2] >= 0;
    samples->x[k] = in ? (int32_t)v[0] : 0;
    samples->y[k] = in ? (int32_t)v[1] : 0;
    samples->z[k] = in ? (int32_t)(v[2] < size - 1 ? v[2] : size - 1) : 0;
    samples->low[0][k] = (uint16_t)samples->x[k];
    samples->low[1][k] = (uint16_t)samples->y[k];
    samples->low[2][k] = (uint16_t)samples->z[k];
    faces->of[k] = (uint8_t)(seen.facing_away ? UMB__FACE_DARK : in ? seen.face : UMB__FACE_LIT);
}

/* Returns the longest move: the greatest of eight maxima, which vectors find side by side. */
UMB__INLINE double umb__longest_bias(const struct umb__lamp_samples *s)
{
    double most[8] = {0}, longest = 0;
    for (uint32_t k = 0; k < UMB__SAMPLES; k += 8) {
        for (uint32_t j = 0; j < 8; j++) {
            most[j] = s->bias[k + j] > most[j] ? s->bias[k + j] : most[j];
        }
    }
    for (uint32_t j = 0; j < 8; j++) {
        longest = most[j] > longest ? most[j] : longest;
    }
    return longest;
}

/* Maps all samples as if they were in the face. Returns whether all that count are proven to be. */
UMB__INLINE bool umb__lamp_map(struct umb__lamp_samples *s, struct umb__samples *samples,
                               struct umb__child_bytes *faces)
{
    uint64_t unsure = 0;
    umb__lamp_biases(s);
    umb__lamp_move(s);
    umb__lamp_moved_w(s);
    umb__lamp_prove(s, umb__longest_bias(s));
    umb__lamp_voxels(s, samples, faces);
    for
        UMB__EACH_SAMPLE(k)
        {
            unsure |= (s->sure[k] | s->dark[k]) ^ 1;
        }
    return unsure == 0;
}

/* Maps the samples that are not proven to be in the face: in the face of the first of them, and
 * alone those that are not in that one either. */
static inline void umb__lamp_map_rest(struct umb__lamp_samples *s, struct umb__samples *samples,
                                      struct umb__child_bytes *faces)
{
    struct umb__samples other;
    struct umb__child_bytes found;
    uint64_t before[UMB__SAMPLES];
    uint32_t first = 0;
    double w;
    memcpy(before, s->sure, sizeof before);
    while (before[first] | s->dark[first]) {
        first++;
    }
    const double p[3] = {s->place[0][first], s->place[1][first], s->place[2][first]};
    s->face = umb__face_of(s->query, p, &w);
    (void)umb__lamp_map(s, &other, &found);
    for
        UMB__EACH_SAMPLE(k)
        {
            if (before[k] | s->dark[k]) {
                continue;
            }
            if (!s->sure[k]) {
                umb__lamp_place_alone(s, k, samples, faces);
                continue;
            }
            samples->x[k] = other.x[k];
            samples->y[k] = other.y[k];
            samples->z[k] = other.z[k];
            faces->of[k] = found.of[k];
            for (unsigned axis = 0; axis < 3; axis++) {
                samples->low[axis][k] = other.low[axis][k];
            }
        }
}

/* Places the samples of receiver `lane`. In: a, b: unit vectors along its surface. Out: faces: the
 * face of each sample. Returns the face that all samples are in which are in any; UMB__FACE_LIT if
 * there may be several. */
static inline uint32_t umb__place_under_lamp(const struct umb__query *q,
                                             const struct umb__receivers *r, uint32_t lane,
                                             const double a[3], const double b[3],
                                             struct umb__samples *samples,
                                             struct umb__child_bytes *faces)
{
    struct umb__lamp_samples s;
    const double p[3] = {r->p[0][lane], r->p[1][lane], r->p[2][lane]};
    double w;
    s.query = q;
    s.receivers = r;
    s.lane = lane;
    s.face = umb__face_of(q, p, &w);
    for (unsigned axis = 0; axis < 3; axis++) {
        s.normal[axis] = r->has_normal[lane] ? r->normal[axis][lane] : 0;
    }
    umb__lamp_places(&s, a, b);
    umb__lamp_sides(&s);
    if (!r->has_normal[lane]) {
        umb__lamp_distances(&s);
    }
    if (umb__lamp_map(&s, samples, faces)) {
        return s.face;
    }
    umb__lamp_map_rest(&s, samples, faces);
    return UMB__FACE_LIT;
}

/* Returns whether all samples are within four cubes of `level` on each axis. */
static inline bool umb__is_compact(const struct umb__samples *samples, uint32_t level)
{
    const int32_t *axes[3] = {samples->x, samples->y, samples->z};
    bool compact = true;
    for (unsigned axis = 0; axis < 3; axis++) {
        int32_t least = INT32_MAX, most = 0;
        for
            UMB__EACH_SAMPLE(k)
            {
                const int32_t v = axes[axis][k];
                least = v < least ? v : least;
                most = v > most ? v : most;
            }
        compact &= (most >> level) - (least >> level) < 4;
    }
    return compact;
}

#endif
