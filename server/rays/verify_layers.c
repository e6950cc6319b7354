/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Judging the light that translucent casters leave (verify.h): answers against the products over
 * the surfaces that a ray to the light meets.
 *
 * An answer of one tap is a mean over texels of a transmittance map around the point, each asked at
 * the point's depth. So it is right if it equals the product at the point's voxel. It is also right
 * between the least and the greatest product at the middles of those texels and within a voxel of
 * the point.
 */
#include "rays/verify_block.h"

#include <math.h>

#include "query/stages.h"

enum {
    STEPS = 5, /* samples along each axis within a voxel of the point */
};

/* Greatest difference of equal products: lists end where less than 0.001 is left, and a map rounds
 * each of its values. */
#define SLACK 0.0015

enum umb_status umbr_verify_light_prepare(struct umbr_verify_job *job, uint32_t light,
                                          struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = light, .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_F32};
    job->texel = job->options->layers != NULL && job->options->kind == UMBR_VERIFY_POINTS
                     ? umb__transmittance_texel(job->asset, &job->light)
                     : 0;
    return job->texel > 0 ? umb_query_prepare(job->asset, &settings, &job->light_query, error)
                          : UMB_OK;
}

/* Asks for the light that opaque and translucent casters leave. */
static float ask(const struct umbr_verify_job *job, const double local[3])
{
    const struct umb_points points = {.positions = local,
                                      .format = UMB_POINT_F64,
                                      .origin = {job->origin[0], job->origin[1], job->origin[2]},
                                      .count = 1};
    float value = 0.0F;
    struct umb_answers out = {.values = &value};
    umb_query_run(&job->light_query, &points, 0, 1, &out);
    return value;
}

/* The product at a place of voxel space; -1 where there is none. */
static double product_at(const struct umbr_verify_block *block, const double voxel[3])
{
    const struct umbr_verify_job *job = block->job;
    double local[3], world[3], direction[3], far_m;
    if (!umbr_light_frame_local(block->light_frame, voxel, local)) {
        return -1;
    }
    umbr_towards_light(&job->light, local, direction, &far_m);
    for (int k = 0; k < 3; k++) {
        world[k] = job->origin[k] + local[k];
    }
    return umbr_layers_pass(job->options->layers, world, direction, far_m);
}

/* Range of products. */
struct range {
    double low, high;
};

static void widen(const struct umbr_verify_block *block, const double voxel[3], struct range *range)
{
    const double product = product_at(block, voxel);
    if (product >= 0) {
        range->low = fmin(range->low, product);
        range->high = fmax(range->high, product);
    }
}

/* Widens a range by the middles of the texels that an answer may read. */
static void widen_by_texels(const struct umbr_verify_block *block, const double voxel[3],
                            struct range *range)
{
    const double texel = (double)block->job->texel;
    for (int i = 0; i < 27; i++) {
        const double at[3] = {(floor(voxel[0] / texel) + i % 3 - 0.5) * texel,
                              (floor(voxel[1] / texel) + i / 3 % 3 - 0.5) * texel,
                              floor(voxel[2]) + i / 9 - 0.5};
        widen(block, at, range);
    }
}

/* Widens a range of light by the light at places within a voxel of the point, or within the error
 * of rays. */
static void widen_by_voxel(const struct umbr_verify_block *block, const double voxel[3],
                           struct range *range)
{
    const double edge = block->light_frame->least_edge;
    const double error = edge > 0 ? 2 * umbr_rays_error_m(block->job->rays) / edge : 0;
    const double reach = fmax(1, error);
    for (int i = 0; i < STEPS * STEPS * STEPS; i++) {
        const int step[3] = {i % STEPS, i / STEPS % STEPS, i / (STEPS * STEPS)};
        double at[3];
        for (int k = 0; k < 3; k++) {
            at[k] = voxel[k] + reach * (2.0 * step[k] / (STEPS - 1) - 1);
        }
        widen(block, at, range);
    }
}

enum umbr_verdict umbr_verify_judge_light(struct umbr_verify_block *block,
                                          const struct umbr_sample *sample)
{
    const double answer = (double)ask(block->job, sample->local);
    const double centre[3] = {floor(sample->voxel[0]) + 0.5, floor(sample->voxel[1]) + 0.5,
                              floor(sample->voxel[2]) + 0.5};
    struct range range = {INFINITY, -INFINITY};
    widen(block, centre, &range);
    block->result.translucent += range.low < 1;
    if (answer >= range.low - SLACK && answer <= range.high + SLACK) {
        return UMBR_AGREES;
    }
    widen_by_texels(block, sample->voxel, &range);
    widen_by_voxel(block, sample->voxel, &range);
    return answer >= range.low - SLACK && answer <= range.high + SLACK ? UMBR_IN_BAND : UMBR_WRONG;
}
