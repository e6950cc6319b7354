/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RECEIVERS_H
#define UMBRAGE_CORE_QUERY_KERNEL_RECEIVERS_H
/* Steps of kernel_squares_body.h over the receivers of a block (receivers.h). Each is a loop over
 * all lanes without branches; lanes without a point hold the values of the last point. */
#include "query/perspective.h"
#include "query/receivers.h"

/* Least cosine between a normal and the direction to the eye. At smaller cosines a pixel's patch of
 * surface keeps its length. */
#define UMB__GRAZING 0.0625

#define UMB__EACH_LANE(i) (uint32_t i = 0; i < UMB__RECEIVERS; i++)

/* A field of vectors, one a lane. */
typedef double umb__vectors[3][UMB__RECEIVERS];

/* The dot product of lane i of two fields; the same order as umb__dot. */
UMB__INLINE double umb__dot_lane(const umb__vectors a, const umb__vectors b, uint32_t i)
{
    return a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i];
}

UMB__INLINE double umb__dot_with(const umb__vectors a, const double b[3], uint32_t i)
{
    return a[0][i] * b[0] + a[1][i] * b[1] + a[2][i] * b[2];
}

static inline void umb__receivers_read(const struct umb__query *q, const struct umb_points *points,
                                       size_t first, uint32_t count, struct umb__receivers *r)
{
    r->count = count;
    for
        UMB__EACH_LANE(i)
        {
            const size_t at = first + (i < count ? i : count - 1);
            double p[3], n[3];
            umb__position(q, points, at, p);
            (void)umb__normal(points, at, n);
            for (unsigned axis = 0; axis < 3; axis++) {
                r->p[axis][i] = p[axis];
                r->given[axis][i] = n[axis];
            }
        }
}

/* Finds the light of each receiver, and the texels there. */
static inline void umb__receivers_light(const struct umb__query *q, struct umb__receivers *r)
{
    if (q->face_count == 0) {
        for
            UMB__EACH_LANE(i)
            {
                r->light[0][i] = q->direction[0];
                r->light[1][i] = q->direction[1];
                r->light[2][i] = q->direction[2];
                r->reach[i] = INFINITY;
                r->texel_m[i] = q->texel_m;
            }
        return;
    }
    for
        UMB__EACH_LANE(i)
        {
            for (unsigned axis = 0; axis < 3; axis++) {
                r->light[axis][i] = r->p[axis][i] - q->position[axis];
            }
            const double reach = sqrt(umb__dot_lane(r->light, r->light, i));
            const double over = reach > 0 ? reach : 1;
            for (unsigned axis = 0; axis < 3; axis++) {
                r->light[axis][i] /= over;
            }
            r->reach[i] = reach;
            const double p[3] = {r->p[0][i], r->p[1][i], r->p[2][i]};
            r->texel_m[i] = umb__perspective_texel_m(q, p);
        }
}

static inline void umb__receivers_normal(struct umb__receivers *r)
{
    for
        UMB__EACH_LANE(i)
        {
            const double length2 = umb__dot_lane(r->given, r->given, i), length = sqrt(length2);
            const bool has = length2 > 0 && length2 <= UMB__LENGTH2_MAX;
            const double over = has ? length : 1;
            for (unsigned axis = 0; axis < 3; axis++) {
                r->normal[axis][i] = has ? r->given[axis][i] / over : -r->light[axis][i];
            }
            r->has_normal[i] = has;
        }
}

/* Finds the side of the square with the area of the surface that a pixel covers. */
static inline void umb__receivers_pixel(const struct umb__query *q, struct umb__receivers *r)
{
    umb__vectors view;
    for
        UMB__EACH_LANE(i)
        {
            for (unsigned axis = 0; axis < 3; axis++) {
                view[axis][i] = r->p[axis][i] - q->eye[axis];
            }
            const double distance = sqrt(umb__dot_lane(view, view, i));
            const double over = distance > 0 ? distance : 1;
            const double facing = fabs(umb__dot_lane(r->normal, view, i)) / over;
            const double cosine = distance > 0 ? facing : 1;
            const double held = cosine > UMB__GRAZING ? cosine : UMB__GRAZING;
            r->side[i] = q->pixel_rad * distance / (r->has_normal[i] ? sqrt(held) : 1);
        }
}

static inline void umb__receivers_side(const struct umb__query *q, const struct umb_points *points,
                                       size_t first, struct umb__receivers *r)
{
    if (points->footprints != NULL) {
        for
            UMB__EACH_LANE(i)
            {
                const size_t at = first + (i < r->count ? i : r->count - 1);
                r->side[i] = umb__scalar_at(points->footprints, UMB_POINT_F32, at);
            }
    } else if (q->pixel_rad > 0) {
        umb__receivers_pixel(q, r);
    } else {
        for
            UMB__EACH_LANE(i)
            {
                r->side[i] = q->footprint_m;
            }
    }
    for
        UMB__EACH_LANE(i)
        { /* NaN: 0 */
            const double side = r->side[i],
                         most = side < UMB_FOOTPRINT_MAX ? side : UMB_FOOTPRINT_MAX;
            r->side[i] = side > 0 ? most : 0;
        }
}

/* Returns the bits of a double. */
UMB__INLINE uint64_t umb__bits_of(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

#define UMB__MANTISSA ((UINT64_C(1) << 52) - 1)

/* Finds the level below each footprint. The widths of levels are the window's width times powers of
 * two; this level is the widest one that is at most as wide as the footprint. Powers of two are
 * added to the bits of the exponent. */
static inline void umb__receivers_level(const struct umb__query *q, struct umb__receivers *r)
{
    /* Area lights shine to one side; points behind them are answered by windows. */
    const bool one_sided = q->face_count > 0 && umb__is_one_sided(q);
    for
        UMB__EACH_LANE(i)
        {
            const double least = (double)q->taps * r->texel_m[i], side = r->side[i];
            const double facing = umb__dot_lane(r->normal, r->light, i);
            const double ahead = r->light[0][i] * q->direction[0] +
                                 r->light[1][i] * q->direction[1] +
                                 r->light[2][i] * q->direction[2];
            const bool away = (r->has_normal[i] != 0 && facing >= 0) || (one_sided && !(ahead > 0));
            const bool wider = side > least && least > 0 && !away;
            const uint64_t from = umb__bits_of(wider ? least : 1),
                           to = umb__bits_of(wider ? side : 1);
            const uint64_t less = (to & UMB__MANTISSA) < (from & UMB__MANTISSA) ? 1 : 0;
            const uint64_t steps = (to >> 52) - (from >> 52) - less;
            const uint64_t level =
                steps < UMB_FOOTPRINT_LEVEL_MAX - 1 ? steps : UMB_FOOTPRINT_LEVEL_MAX - 1;
            const uint64_t scaled = from + (level << 52);
            double level_m, weight;
            memcpy(&level_m, &scaled, sizeof level_m);
            weight = (side - level_m) / level_m;
            weight = weight < 1 ? weight : 1;
            r->level_m[i] = level_m;
            r->weight[i] = wider ? weight : 0;
            r->window[i] = !wider;
            r->both[i] = level > 0;
        }
}

/* Finds two unit vectors along each surface. */
static inline void umb__receivers_span(const struct umb__receivers *r, umb__vectors a,
                                       umb__vectors b)
{
    for
        UMB__EACH_LANE(i)
        {
            const double n[3] = {r->normal[0][i], r->normal[1][i], r->normal[2][i]};
            const bool second = fabs(n[1]) < fabs(n[0]);
            const double less = second ? n[1] : n[0];
            const bool third = fabs(n[2]) < fabs(less);
            const double least = third ? n[2] : less;
            const double x = (third || second ? 0.0 : 1.0) - least * n[0];
            const double y = (!third && second ? 1.0 : 0.0) - least * n[1];
            const double z = (third ? 1.0 : 0.0) - least * n[2];
            const double length = sqrt(x * x + y * y + z * z);
            a[0][i] = x / length;
            a[1][i] = y / length;
            a[2][i] = z / length;
            b[0][i] = n[1] * a[2][i] - n[2] * a[1][i];
            b[1][i] = n[2] * a[0][i] - n[0] * a[2][i];
            b[2][i] = n[0] * a[1][i] - n[1] * a[0][i];
        }
}

/* Sets the automatic bias of one tap of parallel light, as umb__lift_auto does. Out: scale: moves
 * along the normals, in their units. depth: lifts towards the light in voxels; one tap has no
 * slopes. */
static inline void umb__receivers_lift(const struct umb__query *q, const struct umb__receivers *r,
                                       double scale[UMB__RECEIVERS], double depth[UMB__RECEIVERS])
{
    const double most = umb__longest_lift(q), half = 0.5 * UMB__BIAS_SLACK;
    for
        UMB__EACH_LANE(i)
        {
            const double length2 = umb__dot_lane(r->given, r->given, i);
            const double x = fabs(umb__dot_with(r->given, q->voxel_step[0], i));
            const double y = fabs(umb__dot_with(r->given, q->voxel_step[1], i));
            const double z = fabs(umb__dot_with(r->given, q->voxel_step[2], i));
            const double need = half * (1.0 * (x + y) + z), rest = need - most * z;
            const bool has = r->has_normal[i] != 0, longest = rest > 0;
            const double exact = need / (z > 0 ? z : 1);
            const double along = longest ? rest / (has ? length2 : 1) : 0;
            const double lift = longest ? most : exact;
            scale[i] = has ? along : 0;
            depth[i] = has ? lift : 0;
        }
}

/* Finds the moves along the normals for a given bias. Out: scale, depth: as for the automatic bias
 * above. */
static inline void umb__receivers_push(const struct umb__query *q, const struct umb__receivers *r,
                                       double scale[UMB__RECEIVERS], double depth[UMB__RECEIVERS])
{
    for
        UMB__EACH_LANE(i)
        {
            const double length2 = umb__dot_lane(r->given, r->given, i);
            scale[i] = r->has_normal[i] ? q->bias_m / sqrt(r->has_normal[i] ? length2 : 1) : 0;
            depth[i] = 0;
        }
}

/* Moves receivers off their surface for one tap of parallel light, as umb__move does. Out: depth:
 * lifts of their look-ups towards the light, in voxels. */
static inline void umb__receivers_move(const struct umb__query *q, const struct umb__receivers *r,
                                       umb__vectors moved, double depth[UMB__RECEIVERS])
{
    double scale[UMB__RECEIVERS];
    if (q->bias_mode == UMB_BIAS_AUTO) {
        umb__receivers_lift(q, r, scale, depth);
    } else {
        umb__receivers_push(q, r, scale, depth);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const double push = q->direction[axis] * q->sample_no_normal_m;
        for
            UMB__EACH_LANE(i)
            {
                const double p = r->p[axis][i];
                moved[axis][i] = r->has_normal[i] ? p + r->given[axis][i] * scale[i] : p - push;
            }
    }
}

/* Places the squares of receivers of parallel light in voxel space. In: cube: width in voxels of
 * the cubes by which samples are first divided into groups. */
static inline void umb__receivers_place(const struct umb__query *q, double cube,
                                        struct umb__receivers *r)
{
    umb__vectors a, b, moved;
    double depth[UMB__RECEIVERS];
    const double lift = q->bias_mode == UMB_BIAS_AUTO ? 0.5 : 0;
    umb__receivers_span(r, a, b);
    umb__receivers_move(q, r, moved, depth);
    for
        UMB__EACH_LANE(i)
        {
            r->compact[i] = r->tame[i] = 1;
        }
    for (unsigned axis = 0; axis < 3; axis++) {
        double m[4]; /* A copy: compilers know that the loop does not change it */
        memcpy(m, q->world_to_voxel[axis], sizeof m);
        const double light = umb__dot(m, q->direction), lifted = axis == 2 ? 1 : 0;
        for
            UMB__EACH_LANE(i)
            {
                const double below = r->level_m[i], above = 2 * below;
                const double v = umb__dot_with(moved, m, i) + m[3] - lifted * depth[i];
                const double near = v - lift * below * light, far = v - lift * above * light;
                const double u = umb__dot_with(a, m, i) * above, w = umb__dot_with(b, m, i) * above;
                const uint64_t fits = fabs(u) + fabs(w) + fabs(far - near) < 3 * cube ? 1 : 0;
                r->voxel[axis][i] = v;
                r->centre[0][axis][i] = near;
                r->centre[1][axis][i] = far;
                r->edge[0][axis][i] = u;
                r->edge[1][axis][i] = w;
                r->compact[i] &= fits;
                r->tame[i] &= fabs(near) + fabs(far) + fabs(u) + fabs(w) < 0x1p30 ? 1 : 0;
            }
    }
}

#endif
