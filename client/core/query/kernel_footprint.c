/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Footprints: the share of the light that reaches the patch of a surface that a pixel covers. All
 * arithmetic is in doubles, the same on all machines. Kernels find the footprints of 64 points at a
 * time (kernel_receivers.h) and answer their squares for opaque casters (kernel_squares_body.h).
 * Lit samples are then weighed with the light that translucent casters leave, if there are any.
 *
 * Level 0 of a point is its window of `taps` texels, as without a footprint. Level k > 0 is the
 * mean of one-tap look-ups spread over a square of its surface, 2^k windows wide: the plane through
 * the point across its normal, lifted towards the light by half the square's side where the bias is
 * automatic. The answer of a footprint between the widths of two levels is interpolated linearly,
 * so that answers are continuous: for footprints f1 < f2 they differ by at most 2 (f2 - f1) / f1.
 *
 * Why a plane: a wider window, coarser voxels (MRAA) and occupancies of nodes (VOAA), as in Sintorn
 * et al. 2014, section 5, all lie at one depth. On slopes they need a lift as long as their width,
 * and find the slope itself (figures: docs/results/techniques.md). A square of the surface follows
 * the slope. Its lift, along the light, only clears the surface's relief within a pixel.
 */
#include "query/kernels.h"
#include "query/perspective.h"
#include "query/slice_count.h"
#include "query/stages.h"

#define CHUNK   512U /* Points whose windows are answered at a time; a multiple of 8, for bits */
#define SAMPLES UMB__SQUARE_SAMPLES

/* Some points while they are answered: answer = near + weight * (far - near). */
struct chunk {
    struct umb__query window; /* The least window ... */
    struct umb__query one;    /* ... and one tap: what levels are made of */
    struct umb__query boxes;  /* One that moves samples as the boxes of translucent casters need it;
                                 set if there are any */
    struct umb_points points; /* Points of the chunk */
    double near[CHUNK], far[CHUNK], weight[CHUNK];
    uint32_t window_count;
    uint16_t windows[CHUNK];         /* Points that need their window */
    bool both[CHUNK];                /* True: `near` is a square; false: the window */
    struct umb__receivers receivers; /* Those of a block of the points */
};

double umb__footprint_of(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    struct umb__receivers r;
    q->kernels->receivers(q, points, i, 1, &r);
    return r.side[0];
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

/* Places the samples of one level: a square of `side` metres around receiver i. */
static void place_level(const struct umb__query *q, const struct umb__receivers *r, uint32_t i,
                        double side, double places[SAMPLES][3])
{
    const double n[3] = {r->normal[0][i], r->normal[1][i], r->normal[2][i]};
    const double lift = q->bias_mode == UMB_BIAS_AUTO ? 0.5 * fmin(side, r->reach[i]) : 0;
    double a[3], b[3];
    span(n, a, b);
    for (uint32_t k = 0; k < SAMPLES; k++) {
        const double u = umb__square_place(k, 0) * side, v = umb__square_place(k, 1) * side;
        for (unsigned axis = 0; axis < 3; axis++) {
            places[k][axis] = r->p[axis][i] + u * a[axis] + v * b[axis] - lift * r->light[axis][i];
        }
    }
}

/* Returns the point of receiver i, or a sample of its squares. In: place: its position. normal: the
 * receiver's. */
static struct umb_points point_of(const struct chunk *chunk, uint32_t i, const double place[3],
                                  const float normal[3])
{
    struct umb_points point = {.positions = place,
                               .format = UMB_POINT_F64,
                               .normals = chunk->receivers.has_normal[i] ? normal : NULL,
                               .count = 1};
    memcpy(point.origin, chunk->one.origin, sizeof point.origin);
    return point;
}

/* Adds up the light that translucent casters leave at the lit samples of receiver i. In: sums:
 * numbers of lit samples of the level below and of the level above. */
static void weigh_samples(const struct chunk *chunk, uint32_t i, double sums[2])
{
    const struct umb__query *one = &chunk->one;
    const struct umb__receivers *r = &chunk->receivers;
    double places[2 * SAMPLES][3];
    const double p[3] = {r->p[0][i], r->p[1][i], r->p[2][i]};
    const float normal[3] = {(float)r->given[0][i], (float)r->given[1][i], (float)r->given[2][i]};
    if (one->face_count == 0) {
        const struct umb_points point = point_of(chunk, i, p, normal);
        const double reach[2] = {(fabs(r->edge[0][0][i]) + fabs(r->edge[1][0][i])) / 2,
                                 (fabs(r->edge[0][1][i]) + fabs(r->edge[1][1][i])) / 2};
        if (umb__transmittance_is_clear_at(&chunk->boxes, &point, 0, reach)) {
            return;
        }
    }
    place_level(one, r, i, r->level_m[i], places);
    place_level(one, r, i, 2 * r->level_m[i], places + SAMPLES);
    sums[0] = sums[1] = 0;
    for (uint64_t rest = r->lit[i]; rest; rest &= rest - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(rest);
        const struct umb_points point = point_of(chunk, i, places[k], normal);
        sums[k / SAMPLES] += (double)(float)umb__transmittance_left(&chunk->boxes, &point, 0);
    }
}

/* Answers the squares of a block of receivers. In: at: place of the block's first point in the
 * chunk. */
static void answer_squares(struct chunk *chunk, uint32_t at, struct umb_query_stats *stats)
{
    struct umb__receivers *r = &chunk->receivers;
    chunk->one.kernels->squares(&chunk->one, r, stats);
    for (uint32_t i = 0; i < r->count; i++) {
        const bool window = r->window[i] != 0;
        double sums[2] = {r->lit_count[0][i], r->lit_count[1][i]};
        if (chunk->one.trans != NULL && !window) {
            weigh_samples(chunk, i, sums);
        }
        chunk->near[at + i] = window ? 0 : sums[0] / SAMPLES;
        chunk->far[at + i] = window ? 0 : sums[1] / SAMPLES;
        chunk->weight[at + i] = r->weight[i];
        chunk->both[at + i] = r->both[i] && !window;
    }
}

/* Counts where the look-up of one tap of point `at` lies, which has no window. In: i: its
 * receiver. */
static void count_place(const struct chunk *chunk, uint32_t at, uint32_t i,
                        struct umb_query_stats *stats)
{
    const struct umb__receivers *r = &chunk->receivers;
    const struct umb__query *one = &chunk->one;
    stats->points++;
    if (one->face_count == 0) {
        const double voxel[3] = {r->voxel[0][i], r->voxel[1][i], r->voxel[2][i]};
        umb__count_place(voxel, one->log2_size, stats);
        return;
    }
    struct umb__sighting seen;
    umb__perspective_map(one, &chunk->points, at, &seen);
    if (seen.facing_away) {
        stats->facing_away++;
    } else {
        umb__count_place(seen.voxel, one->faces[seen.face].log2_size, stats);
    }
}

/* Lists the points of a block that need their window answered, and counts the other points in the
 * statistics. In: at: place of the block's first point in the chunk. */
static void list_windows(struct chunk *chunk, uint32_t at, struct umb_query_stats *stats)
{
    for (uint32_t i = 0; i < chunk->receivers.count; i++) {
        if (!chunk->both[at + i]) {
            chunk->windows[chunk->window_count++] = (uint16_t)(at + i);
        } else {
            count_place(chunk, at + i, i, stats);
        }
    }
}

/* Copies the points that need their window. */
static void gather_windows(const struct chunk *chunk, double places[CHUNK][3],
                           float normals[CHUNK][3], struct umb_points *windows)
{
    const struct umb_points *all = &chunk->points;
    const size_t bytes = 3 * (all->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double));
    *windows = *all;
    windows->count = chunk->window_count;
    windows->positions = places;
    windows->normals = all->normals != NULL ? normals : NULL;
    for (uint32_t k = 0; k < chunk->window_count; k++) {
        const size_t i = chunk->windows[k];
        memcpy((uint8_t *)places + bytes * k, (const uint8_t *)all->positions + bytes * i, bytes);
        if (all->normals != NULL) {
            memcpy(normals[k], (const uint8_t *)all->normals + 12 * i, sizeof normals[k]);
        }
    }
}

/* Answers the windows that the chunk needs. */
static void answer_windows(struct chunk *chunk, struct umb_query_stats *stats)
{
    double places[CHUNK][3];
    float normals[CHUNK][3], values[CHUNK];
    struct umb_points windows = chunk->points;
    struct umb_answers answers = {.values = values, .stats = *stats};
    if (chunk->window_count < chunk->points.count) {
        gather_windows(chunk, places, normals, &windows);
    }
    chunk->window.run(&chunk->window, &windows, 0, windows.count, &answers);
    *stats = answers.stats;
    for (uint32_t k = 0; k < chunk->window_count; k++) {
        const uint32_t i = chunk->windows[k];
        chunk->near[i] = chunk->both[i] ? chunk->near[i] : (double)values[k];
    }
}

static void footprint_run(const struct umb__query *q, const struct umb_points *points, size_t first,
                          size_t count, struct umb_answers *answers)
{
    struct chunk chunk;
    chunk.window = *q;
    chunk.window.run = q->footprint_inner;
    chunk.window.format = UMB_ANSWER_F32;
    chunk.one = chunk.window;
    chunk.one.taps = 1;
    chunk.one.no_normal_m = q->sample_no_normal_m;
    if (q->trans != NULL) {
        umb__transmittance_widen(&chunk.one, &chunk.boxes);
    }
    for (size_t done = 0; done < count; done += CHUNK) {
        const size_t at = first + done, n = count - done < CHUNK ? count - done : CHUNK;
        chunk.points = umb__some_points(points, at, n);
        chunk.window_count = 0;
        for (uint32_t i = 0; i < n; i += UMB__RECEIVERS) {
            const uint32_t left = (uint32_t)n - i;
            q->kernels->receivers(q, &chunk.points, i,
                                  left < UMB__RECEIVERS ? left : UMB__RECEIVERS, &chunk.receivers);
            answer_squares(&chunk, i, &answers->stats);
            list_windows(&chunk, i, &answers->stats);
        }
        answer_windows(&chunk, &answers->stats);
        for (uint32_t i = 0; i < n; i++) {
            const double near = chunk.near[i], far = chunk.far[i];
            umb__store_share(answers->values, q->format, at + i,
                             near + chunk.weight[i] * (far - near));
        }
    }
}

/* Checks that footprints have at most one source, and that its value is in range. */
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
    q->kernels = umb__kernels_here();
    q->footprint_inner = q->run;
    q->run = footprint_run;
}

const struct umb__filter umb__filter_footprint = {
    .info = {.name = "footprint", .has_footprints = 1},
    .any_light = true,
    .partial = "filter: footprint: a partial asset tells of windows only; ask the whole",
    .check = check,
    .set = set,
    .slice = 512, /* points of up to 4 us each, behind translucent casters */
    .work = 64,   /* two levels of 32 look-ups */
};
