/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Judging points: the asset's answers against the rays' answers.
 *
 * A voxel's answer belongs to its centre, so the test for "inside a closed solid" covers the
 * voxel's centre as well as the point. Nearly all points agree and cost one ray; the expensive
 * tests are for the others.
 */
#include "rays/verify_block.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* Least ratio of a frustum's near distance to its far one at which float rays may be used; below it
 * all its rays are in doubles. Float rays leave out casters nearer to a lamp than 2^-16 of a
 * point's distance, which is at most twice the far distance (W of the last voxels). */
#define FLOATS_REACH 0x1p-12

enum {
    BAND_STEPS = 5, /* samples along each axis of the band's grid */
    BAND_SAMPLES = BAND_STEPS * BAND_STEPS * BAND_STEPS,
    BAND_STRIDE = 62, /* coprime to their number: opposite corners come one after another */
    VOTES = 6,
    VOTES_NEEDED = 5,
};

int umbr_verify_needs_exact(const struct umbr_light_frame *light_frame,
                            const struct umbr_rays *rays)
{
    return light_frame->least_edge < umbr_rays_error_m(rays) ||
           (!light_frame->parallel && light_frame->w_first < light_frame->w_last * FLOATS_REACH);
}

void umbr_verify_ask(const struct umbr_verify_job *job, const double (*local)[3], size_t count,
                     uint8_t *lit)
{
    const struct umb_points points = {.positions = local,
                                      .format = UMB_POINT_F64,
                                      .origin = {job->origin[0], job->origin[1], job->origin[2]},
                                      .count = count};
    struct umb_answers out = {.values = lit};
    umb_query_run(&job->query, &points, 0, count, &out);
    for (size_t i = 0; i < count; i++) {
        lit[i] = lit[i] >= 128;
    }
}

/* Makes a ray from a place. direction: the ray's direction; NULL: towards the light, up to where
 * casters may be. */
static struct umbr_exact_ray ray_from(const struct umbr_verify_block *block, const double local[3],
                                      const double direction[3])
{
    const struct umbr_verify_job *job = block->job;
    struct umbr_exact_ray ray = {.origin = job->origin, .far_m = INFINITY};
    memcpy(ray.from, local, sizeof ray.from);
    if (direction != NULL) {
        memcpy(ray.direction, direction, sizeof ray.direction);
        return ray;
    }
    umbr_towards_light(&job->light, local, ray.direction, &ray.far_m);
    if (block->exact != NULL && job->light.kind != UMB_LIGHT_DIRECTIONAL) {
        double way[3];
        umb__subtract(job->light.position, local, way);
        ray.far_m = umb__length(way) - job->free_m;
    }
    return ray;
}

/* Start of a ray in world space, for rays in floats. */
static void world_of(const struct umbr_exact_ray *ray, double world[3])
{
    for (int k = 0; k < 3; k++) {
        world[k] = ray->origin[k] + ray->from[k];
    }
}

/* The traced truth: 1 if nothing lies between the point and the light. */
static int traced_lit(const struct umbr_verify_block *block, const double local[3])
{
    const struct umbr_exact_ray ray = ray_from(block, local, NULL);
    double world[3];
    if (block->exact != NULL) {
        return !umbr_exact_occluded(block->exact, &ray);
    }
    world_of(&ray, world);
    return !umbr_occluded(block->job->rays, world, ray.direction, 0, ray.far_m);
}

void umbr_verify_nearest(const struct umbr_verify_block *block, const struct umbr_exact_ray *ray,
                         struct umbr_exact_hit *hit)
{
    struct umbr_hit met;
    double world[3];
    if (block->exact != NULL) {
        umbr_exact_nearest(block->exact, ray, hit);
        return;
    }
    world_of(ray, world);
    umbr_nearest(block->job->rays, world, ray->direction, 0, ray->far_m, &met);
    *hit = (struct umbr_exact_hit){.distance = met.distance,
                                   .triangle = met.triangle,
                                   .leaving = met.distance >= 0 &&
                                              umb__dot(met.normal, ray->direction) > 0};
}

/*
 * Returns 1 if, along a direction, a ray leaves more closed solids than it enters. A ray that first
 * meets an inner side starts inside. If the ray first enters a solid, all crossings must be
 * counted, which costs more than twice as much.
 */
static int is_inside_along(const struct umbr_verify_block *block, const struct umbr_exact_ray *ray)
{
    const uint8_t *closed = block->job->options->closed;
    int winding, crossings;
    struct umbr_exact_hit hit;
    double world[3];
    umbr_verify_nearest(block, ray, &hit);
    if (hit.distance < 0) {
        return 0;
    }
    if (closed[hit.triangle] && hit.leaving) {
        return 1;
    }
    if (block->exact != NULL) {
        return umbr_exact_winding(block->exact, ray, closed) > 0;
    }
    world_of(ray, world);
    umbr_crossings(block->job->rays, world, ray->direction, closed, &winding, &crossings);
    return winding > 0;
}

/* Returns 1 if a point lies inside a closed solid, by all crossings of a ray along the light. */
static int is_inside(const struct umbr_verify_block *block, const double local[3])
{
    if (!umbr_has_undefined(block)) {
        return 0;
    }
    struct umbr_exact_ray ray = ray_from(block, local, NULL);
    ray.far_m = INFINITY;
    return is_inside_along(block, &ray);
}

int umbr_verify_trace(const struct umbr_verify_block *block, const double local[3], int *buried)
{
    struct umbr_exact_hit hit;
    *buried = 0;
    if (!umbr_has_undefined(block)) { /* any hit will do, which is found sooner */
        return traced_lit(block, local);
    }
    const struct umbr_exact_ray ray = ray_from(block, local, NULL);
    umbr_verify_nearest(block, &ray, &hit);
    if (hit.distance >= 0 && block->job->options->closed[hit.triangle]) {
        *buried = hit.leaving;
    }
    return hit.distance < 0;
}

/*
 * Returns 1 if a point lies inside a closed solid, by a vote of six rays: three directions unusual
 * in models, and their opposites. A ray that grazes an edge may err. A surface on one side only
 * cannot give five votes to a point outside of a solid.
 */
static int is_inside_by_vote(const struct umbr_verify_block *block, const double local[3])
{
    static const double directions[3][3] = {
        {0.5345224838248488, 0.2672612419124244, 0.8017837257372732},
        {-0.6396021490668313, 0.4264014327112209, 0.6396021490668313},
        {0.2182178902359924, -0.8728715609439696, -0.4364357804719848}};
    int votes = 0;
    if (!umbr_has_undefined(block)) {
        return 0;
    }
    for (int i = 0; i < VOTES && votes < VOTES_NEEDED && votes + VOTES - i >= VOTES_NEEDED; i++) {
        const double *d = directions[i / 2], sign = i % 2 == 0 ? 1 : -1;
        const double direction[3] = {sign * d[0], sign * d[1], sign * d[2]};
        const struct umbr_exact_ray ray = ray_from(block, local, direction);
        votes += is_inside_along(block, &ray);
    }
    return votes >= VOTES_NEEDED;
}

/* Returns 1 if the truth changes next to the centre of the point's voxel: a rod may be thinner than
 * the grid of the band, and its edge may run exactly through the centre. */
static int has_edge_at_centre(const struct umbr_verify_block *block,
                              const struct umbr_sample *sample, int truth)
{
    for (int i = 0; i < UMBR_RING_PLACES; i++) {
        double offset[2], local[3];
        umbr_ring_offset(i, offset);
        const double at[3] = {floor(sample->voxel[0]) + 0.5 + offset[0],
                              floor(sample->voxel[1]) + 0.5 + offset[1],
                              floor(sample->voxel[2]) + 0.5};
        if (umbr_light_frame_local(block->light_frame, at, local) &&
            traced_lit(block, local) != truth) {
            return 1;
        }
    }
    return 0;
}

/*
 * Returns 1 if the truth changes within one voxel of the point: somewhere on a 5x5x5 grid of
 * half-voxel offsets, or at or next to the centre of the point's own voxel.
 */
static int in_band(const struct umbr_verify_block *block, const struct umbr_sample *sample,
                   int truth)
{
    if (traced_lit(block, sample->centre) != truth) {
        return 1;
    }
    for (int n = 0; n < BAND_SAMPLES; n++) {
        const int i = n * BAND_STRIDE % BAND_SAMPLES;
        const int step[3] = {i % BAND_STEPS, i / BAND_STEPS % BAND_STEPS,
                             i / (BAND_STEPS * BAND_STEPS)};
        double voxel[3], local[3];
        for (int k = 0; k < 3; k++) {
            voxel[k] = sample->voxel[k] + 0.5 * (step[k] - BAND_STEPS / 2);
        }
        if (umbr_light_frame_local(block->light_frame, voxel, local) &&
            traced_lit(block, local) != truth) {
            return 1;
        }
    }
    return has_edge_at_centre(block, sample, truth);
}

int umbr_verify_look_again(struct umbr_verify_block *block)
{
    if (block->exact != NULL) {
        return 0;
    }
    const enum umb_status status = umbr_rays_exact(block->job->rays, &block->exact, NULL);
    block->status = status != UMB_OK ? status : block->status;
    return status == UMB_OK;
}

static void note(struct umbr_verify_block *block, const double local[3])
{
    struct umbr_verify_result *result = &block->result;
    result->outside_band++;
    if (!result->has_worst) {
        result->has_worst = 1;
        for (int k = 0; k < 3; k++) {
            result->worst_point[k] = block->job->origin[k] + local[k];
        }
    }
}

uint64_t umbr_verify_count(struct umbr_verify_block *block, enum umbr_verdict verdict,
                           const double local[3])
{
    const int compared = verdict != UMBR_SAYS_NOTHING;
    block->result.skipped_inside += !compared;
    block->result.points += (uint64_t)compared;
    block->result.inside_band += verdict == UMBR_IN_BAND;
    if (verdict == UMBR_WRONG) {
        note(block, local);
    }
    return (uint64_t)compared;
}

int umbr_verify_is_unsure(const struct umbr_verify_block *block, const struct umbr_sample *sample,
                          int truth)
{
    return in_band(block, sample, truth) || is_inside_by_vote(block, sample->centre);
}

static enum umbr_verdict judge_answer(const struct umbr_verify_block *block,
                                      const struct umbr_sample *sample, int lit)
{
    int buried;
    const int truth = umbr_verify_trace(block, sample->local, &buried);
    if (truth == lit) {
        return buried ? UMBR_SAYS_NOTHING : UMBR_AGREES;
    }
    if (is_inside(block, sample->centre) && is_inside_by_vote(block, sample->centre)) {
        return UMBR_SAYS_NOTHING;
    }
    if (in_band(block, sample, truth)) {
        return UMBR_IN_BAND;
    }
    return is_inside_by_vote(block, sample->centre) || is_inside_by_vote(block, sample->local)
               ? UMBR_SAYS_NOTHING
               : UMBR_WRONG;
}

/* Judges a sample, and judges it again in doubles if float rays judge it wrong. */
static enum umbr_verdict judge_sample(struct umbr_verify_block *block,
                                      const struct umbr_sample *sample, int lit)
{
    enum umbr_verdict verdict = judge_answer(block, sample, lit);
    if (verdict == UMBR_WRONG && umbr_verify_look_again(block)) {
        verdict = judge_answer(block, sample, lit);
        block->exact = NULL;
    }
    return verdict;
}

void umbr_verify_judge_outside(struct umbr_verify_block *block, const double local[3])
{
    int is_wrong = !traced_lit(block, local);
    if (is_wrong && umbr_verify_look_again(block)) {
        is_wrong = !traced_lit(block, local);
        block->exact = NULL;
    }
    if (is_wrong && !is_inside(block, local)) {
        note(block, local);
    }
}

/* Judges and counts a sample, also by its light behind translucent casters. */
static uint64_t judge_both(struct umbr_verify_block *block, const struct umbr_sample *sample,
                           int lit)
{
    enum umbr_verdict verdict = judge_sample(block, sample, lit);
    if (verdict == UMBR_AGREES && lit && block->job->texel > 0) {
        verdict = umbr_verify_judge_light(block, sample);
    }
    return umbr_verify_count(block, verdict, sample->local);
}

uint64_t umbr_verify_judge_answers(struct umbr_verify_block *block,
                                   const struct umbr_sample *samples, const uint8_t *lit,
                                   size_t count)
{
    uint64_t compared = 0;
    for (size_t i = 0; i < count; i++) {
        compared += judge_both(block, &samples[i], lit[i]);
    }
    return compared;
}

/* Returns 1 for a point behind the plane of an area light, which shines to one side. */
static int is_behind_light(const struct umbr_verify_block *block, const double local[3])
{
    const struct umb_light_info *light = &block->job->light;
    double way[3];
    umb__subtract(local, light->position, way);
    return (light->kind == UMB_LIGHT_RECTANGLE || light->kind == UMB_LIGHT_DISC) &&
           !(umb__dot(way, light->direction) > 0);
}

uint64_t umbr_verify_judge(struct umbr_verify_block *block, const struct umbr_sample *samples,
                           size_t count)
{
    double local[UMBR_SAMPLES_MAX][3];
    uint8_t lit[UMBR_SAMPLES_MAX];
    for (size_t i = 0; i < count; i++) {
        memcpy(local[i], samples[i].local, sizeof local[i]);
    }
    umbr_verify_ask(block->job, (const double(*)[3])local, count, lit);
    uint64_t compared = 0;
    for (size_t i = 0; i < count; i++) {
        if (is_behind_light(block, local[i])) { /* A rule, and nothing to trace */
            compared += umbr_verify_count(block, lit[i] ? UMBR_WRONG : UMBR_AGREES, local[i]);
        } else {
            compared += umbr_verify_judge_answers(block, &samples[i], &lit[i], 1);
        }
    }
    return compared;
}
