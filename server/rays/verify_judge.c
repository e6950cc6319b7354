/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Judging points: what the asset says against what rays say.
 *
 * What a voxel says belongs to its centre, so "inside a closed solid" is asked of the voxel's
 * centre as well as of the point. Nearly all points agree and cost one ray; the expensive questions
 * are asked of the others.
 */
#include "rays/verify_block.h"

#include <math.h>
#include <string.h>

enum {
    BAND_STEPS = 5, /* samples along each axis of the band's grid */
    BAND_SAMPLES = BAND_STEPS * BAND_STEPS * BAND_STEPS,
    BAND_STRIDE = 62, /* prime to their number: corners that lie opposite come one after another */
    VOTES = 6,
    VOTES_NEEDED = 5,
};

void umbr_verify_ask(const struct umbr_verify_job *job, const double (*world)[3], size_t count,
                     uint8_t *lit)
{
    const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = count};
    struct umb_answers out = {.values = lit};
    umb_query_run(&job->query, &points, 0, count, &out);
    for (size_t i = 0; i < count; i++) {
        lit[i] = lit[i] >= 128;
    }
}

/* The traced truth: 1 if nothing lies between the point and the light. */
static int traced_lit(const struct umbr_verify_job *job, const double world[3])
{
    double towards[3], distance;
    umbr_towards_light(&job->light, world, towards, &distance);
    return !umbr_occluded(job->rays, world, towards, 0, distance);
}

/* 1 if closed solids have undefined voxels in this block's frustum. */
static int has_undefined(const struct umbr_verify_block *block)
{
    return block->job->options->closed != NULL && block->frame->closed;
}

/* 1 if a ray meets the inner side of a surface. */
static int is_leaving(const struct umbr_hit *hit, const double direction[3])
{
    return hit->normal[0] * direction[0] + hit->normal[1] * direction[1] +
               hit->normal[2] * direction[2] >
           0;
}

/*
 * 1 if, seen along a direction, more closed solids are left than entered. Who meets the inner side
 * of one first is in it; only who enters another first needs all crossings counted, which costs
 * more than twice as much.
 */
static int is_inside_along(const struct umbr_verify_job *job, const double world[3],
                           const double direction[3])
{
    int winding, crossings;
    struct umbr_hit hit;
    umbr_nearest(job->rays, world, direction, 0, INFINITY, &hit);
    if (hit.distance < 0) {
        return 0;
    }
    if (job->options->closed[hit.triangle] && is_leaving(&hit, direction)) {
        return 1;
    }
    umbr_crossings(job->rays, world, direction, job->options->closed, &winding, &crossings);
    return winding > 0;
}

/* 1 if a point lies inside a closed solid, by all crossings of a ray along the light. */
static int is_inside(const struct umbr_verify_block *block, const double world[3])
{
    double towards[3], distance;
    if (!has_undefined(block)) {
        return 0;
    }
    umbr_towards_light(&block->job->light, world, towards, &distance);
    return is_inside_along(block->job, world, towards);
}

int umbr_verify_trace(const struct umbr_verify_block *block, const double world[3], int *buried)
{
    double towards[3], distance;
    struct umbr_hit hit;
    *buried = 0;
    if (!has_undefined(block)) { /* any hit will do, which is found sooner */
        return traced_lit(block->job, world);
    }
    umbr_towards_light(&block->job->light, world, towards, &distance);
    umbr_nearest(block->job->rays, world, towards, 0, distance, &hit);
    if (hit.distance >= 0 && block->job->options->closed[hit.triangle]) {
        *buried = is_leaving(&hit, towards);
    }
    return hit.distance < 0;
}

/*
 * The same by three directions that no modeller would have chosen and their opposites. A ray that
 * grazes an edge may err; from a point that is not in a solid, no surface on one side only can get
 * five votes.
 */
static int is_inside_by_vote(const struct umbr_verify_block *block, const double world[3])
{
    static const double directions[3][3] = {
        {0.5345224838248488, 0.2672612419124244, 0.8017837257372732},
        {-0.6396021490668313, 0.4264014327112209, 0.6396021490668313},
        {0.2182178902359924, -0.8728715609439696, -0.4364357804719848}};
    int votes = 0;
    if (!has_undefined(block)) {
        return 0;
    }
    for (int i = 0; i < VOTES && votes < VOTES_NEEDED && votes + VOTES - i >= VOTES_NEEDED; i++) {
        const double *d = directions[i / 2], sign = i % 2 == 0 ? 1 : -1;
        const double direction[3] = {sign * d[0], sign * d[1], sign * d[2]};
        votes += is_inside_along(block->job, world, direction);
    }
    return votes >= VOTES_NEEDED;
}

/* 1 if the truth is not the same at all of eight places around a point, so far off across the
 * light. In: voxel: the point. */
static int changes_around(const struct umbr_verify_block *block, const double voxel[3],
                          double voxels, int truth)
{
    for (int i = 0; i < 8; i++) {
        const double turn = 0.78539816339744831 * i;
        const double at[3] = {voxel[0] + voxels * cos(turn), voxel[1] + voxels * sin(turn),
                              voxel[2]};
        double world[3];
        if (umbr_frame_world(block->frame, at, world) && traced_lit(block->job, world) != truth) {
            return 1;
        }
    }
    return 0;
}

/* 1 if the truth changes next to the centre of the point's voxel: a rod may be thinner than the
 * grid of the band, and its edge run through the very centre. */
static int has_edge_at_centre(const struct umbr_verify_block *block,
                              const struct umbr_sample *sample, int truth)
{
    static const double rings[] = {0.001, 0.01, 0.1, 0.25};
    const double centre[3] = {floor(sample->voxel[0]) + 0.5, floor(sample->voxel[1]) + 0.5,
                              floor(sample->voxel[2]) + 0.5};
    for (size_t i = 0; i < sizeof rings / sizeof rings[0]; i++) {
        if (changes_around(block, centre, rings[i], truth)) {
            return 1;
        }
    }
    return 0;
}

/*
 * 1 if the truth changes within one voxel of the point: somewhere on a 5x5x5 grid of half-voxel
 * offsets, or at or next to the centre of the point's own voxel.
 */
static int in_band(const struct umbr_verify_block *block, const struct umbr_sample *sample,
                   int truth)
{
    if (traced_lit(block->job, sample->centre) != truth) {
        return 1;
    }
    for (int n = 0; n < BAND_SAMPLES; n++) {
        const int i = n * BAND_STRIDE % BAND_SAMPLES;
        const int step[3] = {i % BAND_STEPS, i / BAND_STEPS % BAND_STEPS,
                             i / (BAND_STEPS * BAND_STEPS)};
        double voxel[3], world[3];
        for (int k = 0; k < 3; k++) {
            voxel[k] = sample->voxel[k] + 0.5 * (step[k] - BAND_STEPS / 2);
        }
        if (umbr_frame_world(block->frame, voxel, world) &&
            traced_lit(block->job, world) != truth) {
            return 1;
        }
    }
    return has_edge_at_centre(block, sample, truth);
}

void umbr_verify_note(struct umbr_verify_block *block, const double world[3])
{
    struct umbr_verify_result *result = &block->result;
    result->outside_band++;
    if (!result->has_worst) {
        result->has_worst = 1;
        memcpy(result->worst_point, world, sizeof result->worst_point);
    }
}

int umbr_verify_is_unsure(const struct umbr_verify_block *block, const struct umbr_sample *sample,
                          int truth)
{
    return in_band(block, sample, truth) || is_inside_by_vote(block, sample->centre);
}

/* Judges a sample that the asset and the ray disagree about; returns 1 if it counts as compared. */
static int judge_disagreement(struct umbr_verify_block *block, const struct umbr_sample *sample,
                              int truth)
{
    struct umbr_verify_result *result = &block->result;
    if (is_inside(block, sample->centre) && is_inside_by_vote(block, sample->centre)) {
        result->skipped_inside++;
        return 0;
    }
    if (in_band(block, sample, truth)) {
        result->inside_band++;
        return 1;
    }
    if (is_inside_by_vote(block, sample->centre) || is_inside_by_vote(block, sample->world)) {
        result->skipped_inside++;
        return 0;
    }
    umbr_verify_note(block, sample->world);
    return 1;
}

uint64_t umbr_verify_judge_answers(struct umbr_verify_block *block,
                                   const struct umbr_sample *samples, const uint8_t *lit,
                                   size_t count)
{
    uint64_t compared = 0;
    for (size_t i = 0; i < count; i++) {
        int buried;
        const int truth = umbr_verify_trace(block, samples[i].world, &buried);
        if (truth != lit[i]) {
            compared += (uint64_t)judge_disagreement(block, &samples[i], truth);
        } else if (buried) {
            block->result.skipped_inside++; /* shadow where anything would do proves nothing */
        } else {
            compared++;
        }
    }
    block->result.points += compared;
    return compared;
}

uint64_t umbr_verify_judge(struct umbr_verify_block *block, const struct umbr_sample *samples,
                           size_t count)
{
    double world[UMBR_SAMPLES_MAX][3];
    uint8_t lit[UMBR_SAMPLES_MAX];
    for (size_t i = 0; i < count; i++) {
        memcpy(world[i], samples[i].world, sizeof world[i]);
    }
    umbr_verify_ask(block->job, (const double(*)[3])world, count, lit);
    return umbr_verify_judge_answers(block, samples, lit, count);
}
