/* SPDX-License-Identifier: Apache-2.0 */
/* See lamp_penumbra.h. */
#include "query/lamp_penumbra.h"

#include "query/first_occluder.h"
#include "query/perspective.h"
#include "query/slice_count.h"
#include "query/volume_parts.h"

#define STEP 144U /* Generator of the lattice: the Fibonacci number before UMB__LAMP_SAMPLES */

/* Cosine and sine of 2 pi STEP / UMB__LAMP_SAMPLES. */
#define TURN_COS (-0.7374038396918788)
#define TURN_SIN (-0.6754521279910767)

/* Least distance of a blocker, in voxels of depth at the receiver; above 0, because sums divide by
 * it. */
#define GAP_MIN 0x1p-20

/* Least ratio of the light's two extents as the receiver sees them: it is small if the light is
 * seen edge-on, or is long and narrow. */
#define THIN 0x1p-10

/* Least value of 1 - q W.d (lamp_penumbra.h). Smaller values occur only if the receiver is as near
 * to the light as the light is large. */
#define NEAR_MIN 0.125

/* Farthest look-up on the way to a point of the light, as a share of that way. */
#define BEFORE_LIGHT 0.998

/* A lattice of points on the light: point i is L + a[i] * first + b[i] * second, where L is the
 * light's position, and first and second are its half axes. */
struct lattice {
    double a[UMB__LAMP_SAMPLES], b[UMB__LAMP_SAMPLES];
};

/* A face and its linear relation of depth and W: W = scale z + offset. */
struct face {
    const struct umb_frustum_info *info;
    double scale, offset, first_w, size;
    struct umb__occluders occluders;
};

/* A light, prepared for a batch. */
struct lamp {
    const struct umb__query *q;
    bool is_sphere;
    double radius;     /* Sphere: metres */
    double half[2][3]; /* Half axes of an area light, metres */
    struct lattice lattice;
    struct face faces[UMB__FACES_MAX];
    double near_w; /* W before which no face has a voxel */
};

/* A receiver in the space of texels and q of its face. */
struct receiver {
    struct lamp *lamp;
    const struct face *face;
    uint32_t number;      /* Number of the face */
    double x, y, q;       /* Place */
    double direction[3];  /* Vector from the light towards the receiver, of W = 1 */
    double slope[2][2];   /* Slopes of the half axes: texels of x and y for each unit of q */
    double shift[2];      /* q W.d of the half axes */
    double inverse[2][2]; /* Inverse of `slope`: half axes for each texel, times q */
    double wide[2];       /* Half axes that half a texel covers, times q */
    double plane[2];      /* Change of q of the receiver's plane over a texel */
    double front[3];      /* Height of `direction` above the light's plane, and the change of that
                             height over a texel of x and of y */
    double above[3];      /* Height above the receiver's horizon of the light's middle, and the
                             change of that height over each half axis */
    bool has_normal;
    double normal[3];  /* Unit normal; 0 without one */
    double bias_m;     /* Length by which the receiver was moved */
    double own_texels; /* Texels around the receiver that surely belong to its face */
};

static struct lattice lattice_of(bool is_round)
{
    struct lattice lattice;
    double c = 1, s = 0;
    for (uint32_t i = 0; i < UMB__LAMP_SAMPLES; i++) {
        const double u = ((double)i + 0.5) / UMB__LAMP_SAMPLES;
        const double v = ((double)(i * STEP % UMB__LAMP_SAMPLES) + 0.5) / UMB__LAMP_SAMPLES;
        const double radius = sqrt(u), turned = c * TURN_COS - s * TURN_SIN;
        lattice.a[i] = is_round ? radius * c : 2 * u - 1;
        lattice.b[i] = is_round ? radius * s : 2 * v - 1;
        s = c * TURN_SIN + s * TURN_COS;
        c = turned;
    }
    return lattice;
}

static struct face face_of(const struct umb__query *q, uint32_t number)
{
    struct face face = {.info = &q->faces[number]};
    struct umb__query own;
    umb__perspective_face(q, number, &own);
    umb__face_depth(face.info, &face.scale, &face.offset);
    face.first_w = umb__face_first_w(face.info);
    face.size = (double)((uint32_t)1 << face.info->log2_size);
    face.occluders = (struct umb__occluders){
        .tree = umb__tree_of(&own), .occluder_depth = q->occluder_depth, .last = UINT32_MAX};
    if (q->occluder_depth != NULL) {
        face.occluders.occluder_depth_root = q->occluder_depth[q->first_face + number];
    }
    return face;
}

/* Finds two vectors of length `radius` across a unit vector. */
static void span(const double n[3], double radius, double half[2][3])
{
    umb__across(n, half[0], half[1]);
    for (unsigned k = 0; k < 2; k++) {
        umb__scale(radius, half[k]);
    }
}

static void lamp_begin(const struct umb__query *q, struct lamp *lamp)
{
    const struct umb_light_info *light = q->lamp;
    *lamp = (struct lamp){.q = q, .radius = light->extent / 2, .near_w = INFINITY};
    lamp->is_sphere = light->kind == UMB_LIGHT_POINT || light->kind == UMB_LIGHT_SPOT;
    if (light->kind == UMB_LIGHT_DISC) {
        span(light->direction, lamp->radius, lamp->half);
    } else if (light->kind == UMB_LIGHT_RECTANGLE) {
        memcpy(lamp->half[0], light->side, sizeof lamp->half[0]);
        umb__scale(0.5, lamp->half[0]);
        umb__cross(light->direction, light->side, lamp->half[1]);
        umb__scale(lamp->radius / umb__length(lamp->half[1]), lamp->half[1]);
    }
    lamp->lattice = lattice_of(light->kind != UMB_LIGHT_RECTANGLE);
    for (uint32_t i = 0; i < q->face_count; i++) {
        lamp->faces[i] = face_of(q, i);
        lamp->near_w = fmin(lamp->near_w, lamp->faces[i].first_w);
    }
    if (q->face_count > 1) {
        lamp->near_w /= 2; /* W of one face is at most sqrt(3) times that of another */
    }
}

/* --- places in the faces ---------------------------------------------------------------------- */

/* A place in the map of a face. */
struct place {
    uint32_t number;     /* Number of the face */
    double x, y;         /* Texel coordinates */
    double ratio;        /* W in this face for each W in the receiver's face */
    double direction[3]; /* From the light, where W = 1 in the receiver's face */
};

/* Finds the face that answers at (x, y) of the receiver's map, by the rule for points
 * (perspective.h). */
static struct place place_of(const struct receiver *r, double x, double y)
{
    const struct lamp *lamp = r->lamp;
    struct place place = {r->number, x, y, 1, {0}};
    const double dx = x - r->x, dy = y - r->y;
    if (fmax(fabs(dx), fabs(dy)) < r->own_texels) {
        return place;
    }
    const double(*step)[3] = r->face->info->voxel_step;
    for (unsigned k = 0; k < 3; k++) {
        place.direction[k] = r->direction[k] + dx * step[0][k] + dy * step[1][k];
    }
    for (uint32_t i = 0; i < lamp->q->face_count; i++) {
        const double w = umb__dot(lamp->q->faces[i].world_to_voxel[3], place.direction);
        if (i != r->number && w > place.ratio) {
            place.number = i;
            place.ratio = w;
        }
    }
    if (place.number != r->number) {
        const struct umb_frustum_info *info = lamp->faces[place.number].info;
        place.x = umb__dot(info->world_to_voxel[0], place.direction) / place.ratio;
        place.y = umb__dot(info->world_to_voxel[1], place.direction) / place.ratio;
    }
    return place;
}

/* Returns whether a texel coordinate lies inside a face's frustum; false for NaN. */
static bool is_inside(double at, double size)
{
    return at >= 0 && at < size;
}

/* --- the blocker search ----------------------------------------------------------------------- */

struct search {
    const struct receiver *r;
    int64_t x, y;       /* Column of the receiver */
    double gaps, cover; /* Sums of s^2 / g and of s^2 / g^2 over the samples that block */
};

/*
 * Returns the least difference of q at which an occluder in column (x, y) hides a point of the
 * light; INFINITY if none does, because the column lies behind the light.
 *
 * Let g be the difference of q, and (a, b) the point of the light that the column would hide if g
 * were 1 and all rays were parallel. An occluder at g hides the light's point (a, b) / (g + a h0 +
 * b h1), where h is `shift`.
 */
static double gap_of(const struct receiver *r, int64_t x, int64_t y)
{
    const double dx = (double)x + 0.5 - r->x, dy = (double)y + 0.5 - r->y;
    const double a = r->inverse[0][0] * dx + r->inverse[0][1] * dy;
    const double b = r->inverse[1][0] * dx + r->inverse[1][1] * dy;
    const double near = fmax(fabs(a) - r->wide[0], fabs(b) - r->wide[1]);
    const bool is_front = r->front[0] + r->front[1] * dx + r->front[2] * dy > 0;
    return is_front ? fmax(near - a * r->shift[0] - b * r->shift[1], 0) : INFINITY;
}

/* Returns the last voxel of a column in a face whose centre is at W or nearer to the light; below
 * 0: none. */
static double limit_of(const struct face *face, double w)
{
    return fmax(fmin(floor((w - face->offset) / face->scale - 0.5), face->size - 1), -1);
}

/* Samples one column, which stands for stride * stride columns. */
static void add_sample(struct search *s, int64_t x, int64_t y, double stride)
{
    const struct receiver *r = s->r;
    const double nearest = 1 / (r->q + gap_of(r, x, y));
    if (!(nearest > r->lamp->near_w)) {
        return; /* The light's rays pass the column where no face has a voxel */
    }
    const struct place at = place_of(r, (double)x + 0.5, (double)y + 0.5);
    struct face *face = &r->lamp->faces[at.number];
    const double limit = limit_of(face, at.ratio * nearest);
    uint32_t depth;
    if (!is_inside(at.x, face->size) || !is_inside(at.y, face->size) || !(limit >= 0) ||
        !umb__first_occluder(&face->occluders, (uint32_t)at.x, (uint32_t)at.y, (uint32_t)limit,
                             &depth)) {
        return;
    }
    const double w = fmax(face->scale * ((double)depth + 0.5) + face->offset, face->first_w);
    const double gap = fmax(at.ratio / w - r->q, GAP_MIN * r->face->scale * r->q * r->q);
    s->gaps += stride * stride / gap;
    s->cover += stride * stride / gap / gap;
}

/* Samples columns at distances above `inner` strides, up to `outer`. */
static void add_ring(struct search *s, int64_t inner, int64_t outer, int64_t stride)
{
    for (int64_t j = -outer; j <= outer; j++) {
        const bool across = j < -inner || j > inner;
        for (int64_t i = -outer; i <= outer; i++) {
            if (!across && i == -inner) {
                i = inner + 1; /* Skips the columns of the inner rings */
            }
            add_sample(s, s->x + i * stride, s->y + j * stride, (double)stride);
        }
    }
}

/* Returns whether no column up to `outer` texels away has a blocker at W or nearer to the light.
 * Where columns stay shadowed behind their first occluder and the texels belong to one face, one
 * slice proves that. */
static bool is_clear(const struct search *s, double w, int64_t outer, struct umb_query_stats *stats)
{
    const struct face *face = s->r->face;
    const struct umb__slice slice = {&face->occluders.tree, stats, (int64_t)limit_of(face, w)};
    const struct umb__texels texels = {s->x - outer, s->x + outer, s->y - outer, s->y + outer};
    return face->occluders.occluder_depth == NULL && (double)outer + 1 < s->r->own_texels &&
           !umb__slice_has(&slice, texels, false);
}

/* Searches the rays from the light's points to a receiver for first occluders, as penumbra.c does,
 * out to the frustum's size. Returns the difference of q between blockers and receiver; 0 if
 * nothing blocks. */
static double blocker_gap(const struct receiver *r, struct umb_query_stats *stats)
{
    struct search s = {.r = r, .x = (int64_t)floor(r->x), .y = (int64_t)floor(r->y)};
    const double reach = fmax(fabs(r->slope[0][0]) + fabs(r->slope[1][0]),
                              fabs(r->slope[0][1]) + fabs(r->slope[1][1]));
    const double least = fmax(1 - fabs(r->shift[0]) - fabs(r->shift[1]), 0) / reach;
    add_sample(&s, s.x, s.y, 1);
    for (int64_t outer = 1; outer <= 2 * (int64_t)r->face->size; outer *= 2) {
        const int64_t inner = outer / 2, stride = outer > 16  ? outer / 2
                                                  : outer > 4 ? outer / 4
                                                              : 1;
        /* All texels of the ring are at least `inner` away from the receiver's own texel. */
        const double w = 1 / (r->q + (double)inner * least);
        if (!(w > r->lamp->near_w)) {
            break; /* The rays are closer together there */
        }
        if (!is_clear(&s, w, outer, stats)) {
            add_ring(&s, inner / stride, outer / stride, stride);
        }
    }
    return s.cover > 0 ? s.gaps / s.cover : 0;
}

/* --- the mean over the light ------------------------------------------------------------------ */

/* The uniform cube or brick of the last look-up, which often answers the next one. */
struct cache {
    struct umb__place place;
    uint32_t number, x, y, z; /* Number of the face, and the first voxel of the cube */
    bool is_known;
};

/* Returns whether a voxel is lit. Voxels outside the frustum are lit. In: w: W in the place's
 * face. */
static bool is_lit(struct lamp *lamp, const struct place *at, double w, struct cache *cache)
{
    struct face *face = &lamp->faces[at->number];
    const double z = floor((w - face->offset) / face->scale);
    if (!is_inside(at->x, face->size) || !is_inside(at->y, face->size) || !(z >= 0)) {
        return true;
    }
    const uint32_t x = (uint32_t)at->x, y = (uint32_t)at->y;
    const uint32_t depth = (uint32_t)fmin(z, face->size - 1), level = cache->place.level;
    if (!cache->is_known || cache->number != at->number || x >> level != cache->x >> level ||
        y >> level != cache->y >> level || depth >> level != cache->z >> level) {
        struct umb__occluders *o = &face->occluders;
        *cache = (struct cache){
            umb__tree_locate(&o->tree, x, y, depth, &o->read), at->number, x, y, depth, true};
    }
    return cache->place.brick ? umb__brick_voxel(cache->place.brick, x, y, depth)
                              : cache->place.lit;
}

/* Moves a place in another face away from the receiver's plane, as far as the bias for that face's
 * voxels requires. */
static double leave_plane(const struct receiver *r, double w, struct place *at)
{
    const struct umb_frustum_info *info = r->lamp->faces[at->number].info;
    const double(*m)[4] = info->world_to_voxel;
    double from[3];
    for (unsigned k = 0; k < 3; k++) {
        from[k] = at->direction[k] * (w / at->ratio);
    }
    const double bias = umb__perspective_bias(r->lamp->q, at->number, from, r->normal, w);
    for (unsigned k = 0; k < 3; k++) {
        from[k] += r->normal[k] * fmax(bias - r->bias_m, 0);
    }
    const double moved = umb__dot(m[3], from);
    if (moved > 0) {
        at->x = umb__dot(m[0], from) / moved;
        at->y = umb__dot(m[1], from) / moved;
        return moved;
    }
    return w;
}

/* Returns whether the receiver sees one point of the light: the point whose ray passes the
 * blockers' distance (dx, dy) texels from the receiver. */
static bool is_seen(const struct receiver *r, double dx, double dy, double gap, struct cache *cache)
{
    const double rise = r->has_normal ? dx * r->plane[0] + dy * r->plane[1]
                                      : fabs(dx) * r->plane[0] + fabs(dy) * r->plane[1];
    struct place at = place_of(r, r->x + dx, r->y + dy);
    double w = at.ratio / (r->q + fmin(fmax(rise, 0), gap / 2));
    if (at.number != r->number && r->has_normal) {
        w = leave_plane(r, w, &at);
    }
    return is_lit(r->lamp, &at, w, cache);
}

/* Returns the share of the light's points that the receiver sees, if `gap` is the difference of q
 * between the blockers and the receiver. */
static double share_of(const struct receiver *r, double gap, const double width[2])
{
    const struct lattice *lattice = &r->lamp->lattice;
    const double taps = (double)r->lamp->q->taps;
    struct cache cache = {.is_known = false};
    double stretch[2];
    uint32_t lit = 0;
    for (unsigned k = 0; k < 2; k++) {
        stretch[k] = width[k] >= taps ? 1 : width[k] > THIN ? taps / width[k] : 0;
    }
    for (uint32_t i = 0; i < UMB__LAMP_SAMPLES; i++) {
        const double a = lattice->a[i], b = lattice->b[i];
        const double ahead = a * r->shift[0] + b * r->shift[1]; /* q W.d */
        const double rest = fmax(1 - ahead, NEAR_MIN);
        /* The ray ends at the light's point, where q is 1 / W.d. */
        const double way = ahead > 0 ? fmin(gap, BEFORE_LIGHT * r->q * rest / ahead) : gap;
        const double dx = (a * r->slope[0][0] + b * r->slope[1][0]) * way / rest * stretch[0];
        const double dy = (a * r->slope[0][1] + b * r->slope[1][1]) * way / rest * stretch[1];
        lit +=
            r->above[0] + a * r->above[1] + b * r->above[2] > 0 && is_seen(r, dx, dy, way, &cache);
    }
    return (double)lit / UMB__LAMP_SAMPLES;
}

/* --- receivers -------------------------------------------------------------------------------- */

/* Computes the inverse of `slope`. If the light looks narrower than THIN times its length, it is
 * widened to that first, so that the inverse exists. */
static void set_inverse(struct receiver *r)
{
    double(*s)[2] = r->slope;
    const double a = s[0][0] * s[0][0] + s[0][1] * s[0][1];
    const double b = s[1][0] * s[1][0] + s[1][1] * s[1][1];
    double determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    if (!(fabs(determinant) >= THIN * fmax(a, b))) {
        const unsigned longer = a >= b ? 0 : 1;
        s[1 - longer][0] = -THIN * s[longer][1];
        s[1 - longer][1] = THIN * s[longer][0];
        determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    }
    r->inverse[0][0] = s[1][1] / determinant;
    r->inverse[0][1] = -s[1][0] / determinant;
    r->inverse[1][0] = -s[0][1] / determinant;
    r->inverse[1][1] = s[0][0] / determinant;
    for (unsigned k = 0; k < 2; k++) {
        r->wide[k] = 0.5 * (fabs(r->inverse[k][0]) + fabs(r->inverse[k][1]));
    }
}

/* Sets up the light as the receiver sees it. In: from: from the light to the moved point. */
static void set_light(struct receiver *r, const double from[3])
{
    const double(*m)[4] = r->face->info->world_to_voxel;
    const double(*step)[3] = r->face->info->voxel_step;
    double half[2][3], n[3];
    memcpy(half, r->lamp->half, sizeof half);
    memcpy(n, r->lamp->q->direction, sizeof n);
    if (r->lamp->is_sphere) {
        memcpy(n, from, sizeof n);
        (void)umb__unit(n);
        span(n, r->lamp->radius, half);
    }
    r->front[0] = umb__dot(n, r->direction);
    r->front[1] = umb__dot(n, step[0]);
    r->front[2] = umb__dot(n, step[1]);
    r->above[0] = r->has_normal ? r->bias_m - umb__dot(r->normal, from) : 1;
    for (unsigned k = 0; k < 2; k++) {
        const double w = umb__dot(m[3], half[k]);
        r->slope[k][0] = umb__dot(m[0], half[k]) - r->x * w;
        r->slope[k][1] = umb__dot(m[1], half[k]) - r->y * w;
        r->shift[k] = w * r->q;
        r->above[1 + k] = r->has_normal ? umb__dot(r->normal, half[k]) : 0;
    }
    set_inverse(r);
}

/* Sets up the plane of the receiver: q is linear in texels on a plane. Without a normal, and with
 * automatic bias, it rises by a voxel for each texel on both axes. */
static void set_plane(struct receiver *r, const double from[3])
{
    const double along = umb__dot(r->normal, from);
    for (unsigned k = 0; k < 2 && r->lamp->q->bias_mode == UMB_BIAS_AUTO; k++) {
        if (!r->has_normal) {
            r->plane[k] = r->face->scale * r->q * r->q;
        } else if (along < 0) {
            r->plane[k] = umb__dot(r->normal, r->face->info->voxel_step[k]) / along;
        }
    }
}

/* Computes the distance, in texels, from the receiver to the texels of other faces. */
static void set_territory(struct receiver *r)
{
    const struct umb__query *q = r->lamp->q;
    const double(*step)[3] = r->face->info->voxel_step;
    r->own_texels = INFINITY;
    for (uint32_t i = 0; i < q->face_count; i++) {
        const double *w = q->faces[i].world_to_voxel[3];
        const double growth = fabs(umb__dot(w, step[0])) + fabs(umb__dot(w, step[1]));
        const double rest = 1 - umb__dot(w, r->direction);
        if (i != r->number && growth > 0) {
            r->own_texels = fmin(r->own_texels, fmax(rest, 0) / growth);
        }
    }
}

/* Sets up a receiver. Returns false for one that no voxel can shadow. */
static bool receiver_begin(struct lamp *lamp, const struct umb__query *q,
                           const struct umb_points *points, size_t i, const struct umb__sighting *s,
                           struct receiver *r)
{
    double from[3];
    *r = (struct receiver){.lamp = lamp,
                           .face = &lamp->faces[s->face],
                           .number = s->face,
                           .x = s->voxel[0],
                           .y = s->voxel[1],
                           .has_normal = s->has_normal != 0,
                           .bias_m = s->bias_m};
    umb__subtract(s->moved, q->position, from);
    const double w = umb__dot(r->face->info->world_to_voxel[3], from), size = r->face->size;
    if (!(r->x >= -size && r->x < 2 * size && r->y >= -size && r->y < 2 * size &&
          s->voxel[2] >= 0 && w >= r->face->first_w)) {
        return false;
    }
    r->q = 1 / w;
    for (unsigned k = 0; k < 3; k++) {
        r->direction[k] = from[k] * r->q;
    }
    if (r->has_normal) {
        (void)umb__normal(points, i, r->normal);
        (void)umb__unit(r->normal);
    }
    set_light(r, from);
    set_plane(r, from);
    set_territory(r);
    return true;
}

/* Returns the lit share of the light that a receiver sees. In: z: depth of its voxel. */
static double penumbra(const struct receiver *r, double z, struct umb_query_stats *stats)
{
    const double taps = (double)r->lamp->q->taps;
    const double gap = blocker_gap(r, stats);
    double width[2];
    for (unsigned k = 0; k < 2; k++) {
        width[k] = 2 * gap * (fabs(r->slope[0][k]) + fabs(r->slope[1][k]));
    }
    if (gap > 0 && !(width[0] <= taps && width[1] <= taps)) {
        return share_of(r, gap, width);
    }
    const struct umb__slice slice = {&r->face->occluders.tree, stats,
                                     (int64_t)fmin(z, r->face->size)};
    const struct umb__real_box box = {(int64_t)floor(r->x), (int64_t)floor(r->y), taps, taps};
    return umb__slice_share(&slice, &box);
}

static void count_place(const struct receiver *r, const struct umb__sighting *s,
                        struct umb_query_stats *stats)
{
    const bool outside =
        !is_inside(s->voxel[0], r->face->size) || !is_inside(s->voxel[1], r->face->size);
    stats->outside += outside;
    stats->before += !outside && !(s->voxel[2] >= 0);
    stats->behind += !outside && s->voxel[2] >= r->face->size;
}

void umb__lamp_penumbra(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers)
{
    struct lamp lamp;
    lamp_begin(query, &lamp);
    for (size_t i = first; i < first + count; i++) {
        struct umb__sighting s;
        struct receiver r;
        double share = 0;
        umb__perspective_map(query, points, i, &s);
        if (s.facing_away) {
            answers->stats.facing_away++;
        } else {
            const bool known = receiver_begin(&lamp, query, points, i, &s, &r);
            share = known ? penumbra(&r, s.voxel[2], &answers->stats) : 1;
            count_place(&r, &s, &answers->stats);
        }
        umb__store_share(answers->values, query->format, i, share);
        for (uint32_t k = 0; k < query->face_count; k++) {
            struct umb__occluders *occluders = &lamp.faces[k].occluders;
            answers->stats.nodes += occluders->read.nodes;
            answers->stats.bricks += occluders->read.bricks;
            occluders->read = (struct umb_volume_stats){0};
            /* Counts of nodes and bricks do not depend on the points before */
            occluders->last = UINT32_MAX;
        }
    }
    answers->stats.points += count;
}

enum umb_status umb__lamp_penumbra_check(const struct umb__plan *plan, struct umb_error *error)
{
    const struct umb_light_info *light = plan->light;
    const double size = fmax(light->extent, umb__length(light->side));
    const bool is_flat = light->kind != UMB_LIGHT_RECTANGLE || umb__length(light->side) > 0;
    if (plan->settings->light_extent > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "light_extent: %g rad, and light %u is a lamp, whose size in metres the "
                        "asset has; leave it out",
                        plan->settings->light_extent, plan->settings->light);
    }
    if (!(light->extent > 0 && is_flat && size <= UMB_LAMP_SIZE_MAX)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "filter: penumbra: light %u (%s) is %g m across, must be above 0 and at "
                        "most %g; bake it with --light-size or --area",
                        plan->settings->light, umb_light_kind_name(light->kind),
                        is_flat ? size : 0.0, UMB_LAMP_SIZE_MAX);
    }
    return UMB_OK;
}
