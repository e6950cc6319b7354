/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Footprints: the share of the light that reaches the patch of a surface that a pixel covers. All
 * arithmetic is in doubles, one point at a time, the same on all machines.
 *
 * Level 0 of a point is its window of `taps` texels, as without a footprint. Level k > 0 is the
 * mean of one-tap look-ups spread over a square of its surface, 2^k windows wide: the plane through
 * the point across its normal, lifted towards the light by half the square's side where the bias is
 * automatic. The answer of a footprint between the widths of two levels is interpolated linearly,
 * so that answers are continuous: for footprints f1 < f2 they differ by at most 2 (f2 - f1) / f1.
 *
 * Why a plane: a wider window, coarser voxels (MRAA) and occupancies of nodes (VOAA), as in Sintorn
 * et al. 2014, section 5, all lie at one depth. They need a bias as long as their width, and most
 * of their error comes from that bias (figures: docs/results/techniques.md). The lift replaces that
 * bias. It goes along the light, so no edge is displaced, and clears the surface's relief within a
 * pixel.
 */
#include "query/perspective.h"
#include "query/slice_count.h"
#include "query/stages.h"

#define CHUNK 512U /* Points whose windows are answered at a time; whole bytes of bit answers */

#define SAMPLES 32U /* Look-ups of a level: a rank-1 lattice over the square ... */
#define STRIDE  25U /* ... whose generator meets edges of all directions best */

/* Least cosine between a normal and the direction to the eye. At smaller cosines a pixel's patch of
 * surface keeps its length. */
#define GRAZING 0.0625

/* A point, its surface and its light. */
struct receiver {
    double p[3];      /* Position in metres, relative to the asset's origin */
    float given[3];   /* Normal as given; 0 without one */
    double normal[3]; /* Unit normal; towards the light without one */
    double light[3];  /* Unit vector in which the light travels here */
    double reach;     /* Distance in metres to the light; infinite for parallel light */
    bool has_normal, facing_away;
};

static void read_receiver(const struct umb__query *q, const struct umb_points *points, size_t i,
                          struct receiver *r)
{
    umb__position(q, points, i, r->p);
    memcpy(r->light, q->direction, sizeof r->light);
    r->reach = INFINITY;
    if (q->face_count > 0) {
        umb__subtract(r->p, q->position, r->light);
        r->reach = umb__length(r->light);
        for (unsigned axis = 0; axis < 3 && r->reach > 0; axis++) {
            r->light[axis] /= r->reach;
        }
    }
    const double length2 = umb__normal(points, i, r->normal), length = sqrt(length2);
    r->has_normal = umb__is_normal(length2);
    for (unsigned axis = 0; axis < 3; axis++) {
        r->given[axis] = (float)r->normal[axis];
        r->normal[axis] = r->has_normal ? r->normal[axis] / length : -r->light[axis];
    }
    r->facing_away = (r->has_normal && umb__dot(r->normal, r->light) >= 0) ||
                     (q->face_count > 0 && umb__is_behind_light(q, r->light));
}

/* Returns the side of the square with the area of the surface that a pixel covers. */
static double pixel_patch(const struct umb__query *q, const struct receiver *r)
{
    double view[3];
    umb__subtract(r->p, q->eye, view);
    const double distance = umb__length(view);
    if (!r->has_normal) {
        return q->pixel_rad * distance;
    }
    const double cosine = distance > 0 ? fabs(umb__dot(r->normal, view)) / distance : 1.0;
    return q->pixel_rad * distance / sqrt(fmax(cosine, GRAZING));
}

static double patch_of(const struct umb__query *q, const struct umb_points *points, size_t i,
                       const struct receiver *r)
{
    double side = q->footprint_m;
    if (points->footprints) {
        side = umb__scalar_at(points->footprints, UMB_POINT_F32, i);
    } else if (q->pixel_rad > 0) {
        side = pixel_patch(q, r);
    }
    return side > 0 ? fmin(side, UMB_FOOTPRINT_MAX) : 0; /* NaN: 0 */
}

double umb__footprint_of(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    struct receiver r;
    read_receiver(q, points, i, &r);
    return patch_of(q, points, i, &r);
}

/* Finds two unit vectors along the surface. */
static void span(const double n[3], double a[3], double b[3])
{
    unsigned least = fabs(n[1]) < fabs(n[0]) ? 1 : 0;
    least = fabs(n[2]) < fabs(n[least]) ? 2 : least;
    for (unsigned axis = 0; axis < 3; axis++) {
        a[axis] = (axis == least ? 1.0 : 0.0) - n[least] * n[axis];
    }
    const double length = umb__length(a);
    for (unsigned axis = 0; axis < 3; axis++) {
        a[axis] /= length;
    }
    umb__cross(n, a, b);
}

/* Places the samples of one level: a square of `side` metres around the receiver. */
static void place_level(const struct umb__query *q, const struct receiver *r, double side,
                        double places[SAMPLES][3])
{
    double a[3], b[3];
    span(r->normal, a, b);
    const double lift = q->bias_mode == UMB_BIAS_AUTO ? 0.5 * fmin(side, r->reach) : 0;
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const uint32_t j = i * STRIDE % SAMPLES;
        const double u = (((double)i + 0.5) / SAMPLES - 0.5) * side;
        const double v = (((double)j + 0.5) / SAMPLES - 0.5) * side;
        for (unsigned axis = 0; axis < 3; axis++) {
            places[i][axis] = r->p[axis] + u * a[axis] + v * b[axis] - lift * r->light[axis];
        }
    }
}

/* Answers the samples of one or two levels, by their means. */
static void look_up(const struct umb__query *one, const struct receiver *r, double places[][3],
                    unsigned levels, double means[2], struct umb_query_stats *stats)
{
    float normals[2 * SAMPLES][3], values[2 * SAMPLES];
    const size_t count = levels * SAMPLES;
    for (size_t i = 0; i < count; i++) {
        memcpy(normals[i], r->given, sizeof normals[i]);
    }
    struct umb_points points = {.positions = places,
                                .format = UMB_POINT_F64,
                                .normals = r->has_normal ? normals : NULL,
                                .count = count};
    memcpy(points.origin, one->origin, sizeof points.origin);
    struct umb_answers answers = {.values = values};
    one->run(one, &points, 0, count, &answers);
    stats->nodes += answers.stats.nodes;
    stats->bricks += answers.stats.bricks;
    for (unsigned level = 0; level < levels; level++) {
        double lit = 0;
        for (uint32_t i = 0; i < SAMPLES; i++) {
            lit += (double)values[level * SAMPLES + i];
        }
        means[level] = lit / SAMPLES;
    }
}

/* Returns the answer of a receiver. In: window: answer of the receiver's window. */
static double answer(const struct umb__query *q, const struct umb__query *one,
                     const struct receiver *r, double side, double window,
                     struct umb_query_stats *stats)
{
    double texel_m = q->face_count > 0 ? umb__perspective_texel_m(q, r->p) : q->texel_m;
    double level_m = (double)q->taps * texel_m; /* width of the level below the footprint */
    if (!(side > level_m) || !(level_m > 0) || r->facing_away) {
        return window;
    }
    unsigned level = 0;
    for (; 2 * level_m <= side && level < UMB_FOOTPRINT_LEVEL_MAX - 1; level++) {
        level_m *= 2;
    }
    double places[2 * SAMPLES][3], means[2];
    unsigned count = 0;
    if (level > 0) {
        place_level(q, r, level_m, places);
        count++;
    }
    place_level(q, r, 2 * level_m, places + count * SAMPLES);
    count++;
    look_up(one, r, places, count, means, stats);
    const double near = level > 0 ? means[0] : window, far = means[count - 1];
    return near + fmin((side - level_m) / level_m, 1) * (far - near);
}

static void footprint_run(const struct umb__query *q, const struct umb_points *points, size_t first,
                          size_t count, struct umb_answers *answers)
{
    struct umb__query window = *q; /* The least window, and one tap: what levels are made of */
    window.run = q->footprint_inner;
    window.format = UMB_ANSWER_F32;
    struct umb__query one = window;
    one.taps = 1;
    one.no_normal_m = q->sample_no_normal_m;
    float values[CHUNK];
    for (size_t done = 0; done < count; done += CHUNK) {
        const size_t at = first + done, n = count - done < CHUNK ? count - done : CHUNK;
        const struct umb_points chunk = umb__some_points(points, at, n);
        struct umb_answers windows = {.values = values, .stats = answers->stats};
        window.run(&window, &chunk, 0, n, &windows);
        answers->stats = windows.stats;
        for (size_t i = 0; i < n; i++) {
            struct receiver r;
            read_receiver(q, points, at + i, &r);
            const double side = patch_of(q, points, at + i, &r);
            const double share = answer(q, &one, &r, side, (double)values[i], &answers->stats);
            umb__store_share(answers->values, q->format, at + i, share);
        }
    }
}

/* Checks what gives footprints: one source of them, and in range. */
static enum umb_status check(const struct umb__plan *plan, struct umb_error *error)
{
    const double pixel = plan->settings->pixel_rad, side = plan->settings->footprint_m;
    if (!(side >= 0 && side <= UMB_FOOTPRINT_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "footprint_m: %g, must be 0 to %g", side,
                        UMB_FOOTPRINT_MAX);
    }
    if (pixel > 0 && side > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "footprint_m: %g beside pixels of %g rad; give one of both", side, pixel);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const double eye = plan->settings->eye[axis];
        if (!isfinite(eye)) {
            return umb_fail(error, UMB_E_ARGUMENT, "eye.%c: %g, must be finite", "xyz"[axis], eye);
        }
    }
    return UMB_OK;
}

static void set(const struct umb__plan *plan, struct umb__query *q)
{
    q->footprint_m = plan->settings->footprint_m;
    q->pixel_rad = plan->settings->pixel_rad;
    umb__subtract(plan->settings->eye, plan->content->origin, q->eye);
    q->texel_m = (umb__length(q->voxel_step[0]) + umb__length(q->voxel_step[1])) / 2;
    q->sample_no_normal_m = umb__no_normal_m(plan, q, 1);
    q->footprint_inner = q->run;
    q->run = footprint_run;
}

const struct umb__filter umb__filter_footprint = {
    .info = {.name = "footprint", .has_footprints = 1},
    .any_light = true,
    .partial = "filter: footprint: a partial asset tells of windows only; ask the whole",
    .check = check,
    .set = set,
    .slice = 512, /* points of up to 4 us each */
    .work = 64,   /* two levels of 32 look-ups */
};
