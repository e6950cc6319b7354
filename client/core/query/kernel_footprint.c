/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Footprints: the share of the light that reaches the patch of a surface that a pixel covers. All
 * arithmetic is in doubles, the same on all machines. Kernels find the footprints of 64 points at a
 * time (kernel_receivers.h) and answer their squares under parallel light (kernel_squares_body.h).
 * If a stage of lamps or of translucent casters is inside this stage (stages.h), the samples of
 * each point go through that stage.
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
#include "query/slice_count.h"
#include "query/stages.h"

#define CHUNK   512U /* Points whose windows are answered at a time; a multiple of 8, for bits */
#define SAMPLES UMB__SQUARE_SAMPLES

/* Some points while they are answered: answer = near + weight * (far - near). */
struct chunk {
    struct umb__query window; /* The least window ... */
    struct umb__query one;    /* ... and one tap: what levels are made of */
    bool alone; /* True: samples go through the stages inside, point by point; false: the kernel of
                   squares answers them */
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

/* Answers the squares of receiver i through the stages inside this one. */
static void look_up_alone(const struct chunk *chunk, struct umb__receivers *r, uint32_t i,
                          struct umb_query_stats *stats)
{
    const struct umb__query *one = &chunk->one;
    double places[2 * SAMPLES][3], sums[2] = {0, 0};
    float normals[2 * SAMPLES][3], values[2 * SAMPLES];
    const size_t first = r->both[i] ? 0 : SAMPLES;
    place_level(one, r, i, r->level_m[i], places);
    place_level(one, r, i, 2 * r->level_m[i], places + SAMPLES);
    for (size_t k = 0; k < 2 * SAMPLES; k++) {
        for (unsigned axis = 0; axis < 3; axis++) {
            normals[k][axis] = (float)r->given[axis][i];
        }
    }
    struct umb_points points = {.positions = places,
                                .format = UMB_POINT_F64,
                                .normals = r->has_normal[i] ? normals : NULL,
                                .count = 2 * SAMPLES};
    memcpy(points.origin, one->origin, sizeof points.origin);
    struct umb_answers answers = {.values = values};
    one->run(one, &points, first, 2 * SAMPLES - first, &answers);
    stats->nodes += answers.stats.nodes;
    stats->bricks += answers.stats.bricks;
    for (size_t k = first; k < 2 * SAMPLES; k++) {
        sums[k / SAMPLES] += (double)values[k];
    }
    r->mean[0][i] = sums[0] / SAMPLES;
    r->mean[1][i] = sums[1] / SAMPLES;
}

/* Answers the squares of a block of receivers. In: at: place of the block's first point in the
 * chunk. */
static void answer_squares(struct chunk *chunk, uint32_t at, struct umb_query_stats *stats)
{
    struct umb__receivers *r = &chunk->receivers;
    for (uint32_t i = 0; i < r->count && chunk->alone; i++) {
        if (!r->window[i]) {
            look_up_alone(chunk, r, i, stats);
        }
    }
    if (!chunk->alone) {
        chunk->one.kernels->squares(&chunk->one, r, stats);
    }
    for (uint32_t i = 0; i < r->count; i++) {
        const bool window = r->window[i] != 0;
        chunk->near[at + i] = window ? 0 : r->mean[0][i];
        chunk->far[at + i] = window ? 0 : r->mean[1][i];
        chunk->weight[at + i] = r->weight[i];
        chunk->both[at + i] = r->both[i] && !window;
    }
}

/* Lists the points of a block that need their window answered, and counts the other points in the
 * statistics. In: at: place of the block's first point in the chunk. */
static void list_windows(struct chunk *chunk, uint32_t at, struct umb_query_stats *stats)
{
    const struct umb__receivers *r = &chunk->receivers;
    for (uint32_t i = 0; i < r->count; i++) {
        if (!chunk->both[at + i] || chunk->alone) {
            chunk->windows[chunk->window_count++] = (uint16_t)(at + i);
        } else {
            const double voxel[3] = {r->voxel[0][i], r->voxel[1][i], r->voxel[2][i]};
            (void)umb__window_at(&chunk->one, voxel, stats);
            stats->points++;
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
    chunk.alone = q->footprint_inner != q->kernel;
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
    .slice = 512, /* points of up to 4 us each, where they go one by one */
    .work = 64,   /* two levels of 32 look-ups */
};
