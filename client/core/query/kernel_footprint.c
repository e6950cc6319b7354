/* SPDX-License-Identifier: Apache-2.0 */
/* See footprint.h. All arithmetic is in doubles, one point at a time, the same on all machines. */
#include "query/footprint.h"

#include "base/vec.h"
#include "query/perspective.h"
#include "query/slice_count.h"

#define CHUNK 512U /* points whose windows are answered at a time; whole bytes of bit answers */

/* A point, its surface and its light. */
struct receiver {
    double p[3];         /* metres, relative to the asset's origin */
    float raw_normal[3]; /* as given; 0 without one */
    double normal[3];    /* unit; towards the light without one */
    double light[3];     /* Unit vector in which the light travels here */
    double reach;        /* metres to the light; infinite for parallel light */
    bool has_normal, facing_away;
};

/* Reads the normal of point i; leaves it 0 if it counts as none (query.h). */
static void read_normal(const struct umb_points *points, size_t i, struct receiver *r)
{
    if (points->normals) {
        memcpy(r->raw_normal, (const uint8_t *)points->normals + 12 * i, sizeof r->raw_normal);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        r->normal[axis] = (double)r->raw_normal[axis];
    }
    const double length2 = umb__dot(r->normal, r->normal);
    r->has_normal = length2 > 0 && length2 <= UMB__LENGTH2_MAX;
    const double length = sqrt(length2);
    for (unsigned axis = 0; axis < 3; axis++) {
        r->normal[axis] = r->has_normal ? r->normal[axis] / length : -r->light[axis];
    }
}

static void read_receiver(const struct umb__query *q, const struct umb_points *points, size_t i,
                          struct receiver *r)
{
    memset(r, 0, sizeof *r);
    r->reach = INFINITY;
    for (unsigned axis = 0; axis < 3; axis++) {
        r->p[axis] = points->origin[axis] - q->origin[axis] + umb__coordinate(points, i, axis);
        r->light[axis] = q->face_count > 0 ? r->p[axis] - q->position[axis] : q->direction[axis];
    }
    if (q->face_count > 0) {
        r->reach = sqrt(umb__dot(r->light, r->light));
        for (unsigned axis = 0; axis < 3 && r->reach > 0; axis++) {
            r->light[axis] /= r->reach;
        }
    }
    read_normal(points, i, r);
    r->facing_away = r->has_normal && umb__dot(r->normal, r->light) >= 0;
}

/* Returns the side of the square with the area of the surface that a pixel covers. */
static double pixel_patch(const struct umb__query *q, const struct receiver *r)
{
    double view[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        view[axis] = r->p[axis] - q->eye[axis];
    }
    const double distance = sqrt(umb__dot(view, view));
    if (!r->has_normal) {
        return q->pixel_rad * distance;
    }
    const double cosine = distance > 0 ? fabs(umb__dot(r->normal, view)) / distance : 1.0;
    return q->pixel_rad * distance / sqrt(fmax(cosine, UMB__FOOTPRINT_GRAZING));
}

static double patch_of(const struct umb__query *q, const struct umb_points *points, size_t i,
                       const struct receiver *r)
{
    double side = q->footprint_m;
    if (points->footprints) {
        float own;
        memcpy(&own, (const uint8_t *)points->footprints + 4 * i, sizeof own);
        side = (double)own;
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
    const double length = sqrt(umb__dot(a, a));
    for (unsigned axis = 0; axis < 3; axis++) {
        a[axis] /= length;
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const unsigned next = (axis + 1) % 3, last = (axis + 2) % 3;
        b[axis] = n[next] * a[last] - n[last] * a[next];
    }
}

/* Places the samples of one level: a square of `side` metres around the receiver. */
static void place_level(const struct umb__query *q, const struct receiver *r, double side,
                        double places[UMB__FOOTPRINT_SAMPLES][3])
{
    double a[3], b[3];
    span(r->normal, a, b);
    const double lift = q->bias_mode == UMB_BIAS_AUTO ? 0.5 * fmin(side, r->reach) : 0;
    for (uint32_t i = 0; i < UMB__FOOTPRINT_SAMPLES; i++) {
        const uint32_t j = i * UMB__FOOTPRINT_STRIDE % UMB__FOOTPRINT_SAMPLES;
        const double u = (((double)i + 0.5) / UMB__FOOTPRINT_SAMPLES - 0.5) * side;
        const double v = (((double)j + 0.5) / UMB__FOOTPRINT_SAMPLES - 0.5) * side;
        for (unsigned axis = 0; axis < 3; axis++) {
            places[i][axis] = r->p[axis] + u * a[axis] + v * b[axis] - lift * r->light[axis];
        }
    }
}

/* Answers the samples of one or two levels, by their means. */
static void look_up(const struct umb__query *one, const struct receiver *r, double places[][3],
                    unsigned levels, double means[2], struct umb_query_stats *stats)
{
    float normals[2 * UMB__FOOTPRINT_SAMPLES][3], values[2 * UMB__FOOTPRINT_SAMPLES];
    const size_t count = levels * UMB__FOOTPRINT_SAMPLES;
    for (size_t i = 0; i < count; i++) {
        memcpy(normals[i], r->raw_normal, sizeof normals[i]);
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
        for (uint32_t i = 0; i < UMB__FOOTPRINT_SAMPLES; i++) {
            lit += (double)values[level * UMB__FOOTPRINT_SAMPLES + i];
        }
        means[level] = lit / UMB__FOOTPRINT_SAMPLES;
    }
}

/* Returns the answer of a receiver whose window has the answer `window`. */
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
    double places[2 * UMB__FOOTPRINT_SAMPLES][3], means[2];
    unsigned count = 0;
    if (level > 0) {
        place_level(q, r, level_m, places);
        count++;
    }
    place_level(q, r, 2 * level_m, places + count * UMB__FOOTPRINT_SAMPLES);
    count++;
    look_up(one, r, places, count, means, stats);
    const double near = level > 0 ? means[0] : window, far = means[count - 1];
    return near + fmin((side - level_m) / level_m, 1) * (far - near);
}

/* The two queries of which levels are made: the window, and one tap. */
static void split(const struct umb__query *q, struct umb__query *window, struct umb__query *one)
{
    *window = *q;
    window->run = q->window_run;
    window->format = UMB_ANSWER_F32;
    *one = *window;
    one->taps = 1;
    one->no_normal_m = q->sample_no_normal_m;
}

void umb__footprint_run(const struct umb__query *q, const struct umb_points *points, size_t first,
                        size_t count, struct umb_answers *answers)
{
    struct umb__query window, one;
    float values[CHUNK];
    split(q, &window, &one);
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
