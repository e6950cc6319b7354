/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing points to compare, in voxel space.
 *
 * Shadow boundaries come in two kinds. A ray from the light finds surfaces, whatever the asset
 * says. Other boundaries, above all the walls of shadow volumes, are found in the asset: visibility
 * is looked up at jittered stations along a random row of its voxels, and one change is picked and
 * halved down to two neighbouring voxels. (Along the light, most changes of an asset baked under
 * the closed rule lie deep inside solids, where nothing can be compared: hence the ray.)
 */
#include "rays/verify_block.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

#define BIAS_SLACK (65.0 / 64.0) /* slack of automatic biases, as in client/core/query */
#define GRAZING    1e-6          /* cosine below which a surface is seen edge on */

enum {
    STATIONS = 32, /* look-ups along a row before halving */
    POINTS_A_BOUNDARY = 8,
    NEAR_VOXELS = 4,
    TRIES_A_POINT = 24, /* draws near boundaries for each wanted point */
    /* Most uniform draws for each wanted point: points inside closed solids are left out. */
    DRAWS_A_POINT = 4,
    WALKS_A_BOUNDARY = 4, /* rows walked before another kind of boundary is tried */
};

_Static_assert(STATIONS <= UMBR_SAMPLES_MAX && POINTS_A_BOUNDARY <= UMBR_SAMPLES_MAX,
               "batches fit");

/* Returns 1 if the block's frustum answers at a point, and no other face of its light does. */
static int is_own(const struct umbr_verify_block *block, const double local[3])
{
    const double w = umbr_light_frame_w(block->light_frame, local);
    for (uint32_t i = 0; i < block->job->light.frustum_count; i++) {
        const struct umbr_light_frame *other = &block->job->frames[i];
        if (other != block->light_frame && umbr_light_frame_w(other, local) >= w) {
            return 0;
        }
    }
    return 1;
}

int umbr_verify_place(const struct umbr_verify_block *block, struct umbr_sample *sample)
{
    const double size = block->light_frame->size;
    double centre[3];
    for (int i = 0; i < 3; i++) {
        if (!(sample->voxel[i] >= 0 && sample->voxel[i] < size)) {
            return 0;
        }
        centre[i] = floor(sample->voxel[i]) + 0.5;
    }
    return umbr_light_frame_local(block->light_frame, sample->voxel, sample->local) &&
           umbr_light_frame_local(block->light_frame, centre, sample->centre) &&
           is_own(block, sample->local);
}

/* Draws and compares points until `wanted` were compared, or `tries` were drawn. draw: fills in a
 * sample and returns 1, or returns 0 if this draw found none. */
static void compare_drawn(struct umbr_verify_block *block,
                          int (*draw)(struct umbr_verify_block *block, struct umbr_sample *sample),
                          uint64_t wanted, uint64_t tries)
{
    while (wanted > 0 && tries > 0) {
        struct umbr_sample samples[UMBR_SAMPLES_MAX];
        const uint64_t aim = wanted < UMBR_SAMPLES_MAX ? wanted : UMBR_SAMPLES_MAX;
        size_t count = 0;
        for (; count < aim && tries > 0; tries--) {
            count += (size_t)draw(block, &samples[count]);
        }
        wanted -= umbr_verify_judge(block, samples, count);
    }
}

/* 1 if a frustum of the light answers for a place. */
static int is_covered(const struct umbr_verify_job *job, const double local[3])
{
    const struct umbr_light_frame *found = NULL;
    double voxel[3], most = 0;
    for (uint32_t i = 0; i < job->light.frustum_count; i++) {
        const double w = umbr_light_frame_w(&job->frames[i], local);
        if (w > most) {
            most = w;
            found = &job->frames[i];
        }
    }
    return found != NULL && umbr_light_frame_voxel(found, local, voxel) && voxel[0] >= 0 &&
           voxel[0] < found->size && voxel[1] >= 0 && voxel[1] < found->size;
}

/*
 * Draws places in the casters' box, and judges those that a lamp should cover and does not. A point
 * light covers all places, an area light and a spot light with several faces those in front of it.
 * This finds a face that is missing or turned; all other points are drawn in the existing faces.
 */
static void judge_uncovered(struct umbr_verify_block *block, uint64_t draws)
{
    const struct umbr_verify_job *job = block->job;
    const struct umb_light_info *light = &job->light;
    if (light->kind == UMB_LIGHT_DIRECTIONAL ||
        (light->kind == UMB_LIGHT_SPOT && light->frustum_count == 1)) {
        return;
    }
    for (uint64_t i = 0; i < draws; i++) {
        double local[3], way[3];
        for (int k = 0; k < 3; k++) {
            local[k] = job->bounds.min[k] - job->origin[k] +
                       umbr_next_unit(block) * (job->bounds.max[k] - job->bounds.min[k]);
        }
        umb__subtract(local, light->position, way);
        if ((light->kind == UMB_LIGHT_POINT || umb__dot(way, light->direction) > 0) &&
            !is_covered(job, local)) {
            umbr_verify_judge_outside(block, local);
        }
    }
}

static int find_anywhere(struct umbr_verify_block *block, struct umbr_sample *sample)
{
    umbr_draw_anywhere(block, sample->voxel);
    return umbr_verify_place(block, sample);
}

int umbr_verify_column(const struct umbr_verify_block *block, double x, double y,
                       struct umbr_exact_ray *ray, double *z_first)
{
    const struct umbr_light_frame *light_frame = block->light_frame;
    const double first = light_frame->parallel ? 0 : fmax(light_frame->w_first, block->job->free_m);
    const double voxel[2][3] = {{x, y, 0.5 * light_frame->size}, {x, y, light_frame->size}};
    double at[2][3];
    if (!umbr_light_frame_local(light_frame, voxel[0], at[0]) ||
        !umbr_light_frame_local(light_frame, voxel[1], at[1])) {
        return 0;
    }
    *z_first = light_frame->parallel ? 0
                                     : light_frame->size * (first - light_frame->w_first) /
                                           (light_frame->w_last - light_frame->w_first);
    const double halves =
        2 - 2 * *z_first / light_frame->size; /* share of the way, from the last voxel back */
    ray->origin = block->job->origin;
    for (int k = 0; k < 3; k++) {
        ray->direction[k] = halves * (at[1][k] - at[0][k]);
        ray->from[k] = at[1][k] - ray->direction[k];
    }
    ray->far_m = umb__length(ray->direction);
    return umb__unit(ray->direction);
}

/* Finds the first surface on the light's path in a random column; returns 0 if there is none. */
static int find_surface(struct umbr_verify_block *block, double boundary[3])
{
    const double size = block->light_frame->size;
    struct umbr_exact_ray ray;
    struct umbr_exact_hit hit;
    double z_first;
    for (int k = 0; k < 2; k++) {
        boundary[k] = floor(umbr_next_unit(block) * size) + 0.5;
    }
    if (!umbr_verify_column(block, boundary[0], boundary[1], &ray, &z_first)) {
        return 0;
    }
    umbr_verify_nearest(block, &ray, &hit);
    /* Depth is linear along a column. */
    boundary[2] = z_first + (size - z_first) * hit.distance / ray.far_m;
    return hit.distance >= 0;
}

/* A random row of voxels: all but coordinate `axis` are fixed. */
struct row {
    double voxel[3]; /* coordinates of a voxel's centre */
    int axis;
};

/* Looks up `count` voxels of a row, at whole positions at[i]. */
static void ask_row(const struct umbr_verify_block *block, const struct row *row, const double *at,
                    size_t count, uint8_t *lit)
{
    double local[STATIONS][3];
    for (size_t i = 0; i < count; i++) {
        double voxel[3] = {row->voxel[0], row->voxel[1], row->voxel[2]};
        voxel[row->axis] = at[i] + 0.5;
        if (!umbr_light_frame_local(block->light_frame, voxel, local[i])) {
            memset(local[i], 0,
                   sizeof local[i]); /* voxels behind a lamp have no place; any answer is right */
        }
    }
    umbr_verify_ask(block->job, (const double(*)[3])local, count, lit);
}

/* Returns 1 if both voxels at a change are in closed solids, where answers are unspecified. */
static int is_buried(const struct umbr_verify_block *block, const struct row *row, double change)
{
    int buried = 1;
    for (int i = 0; i < 2 && buried; i++) {
        double voxel[3] = {row->voxel[0], row->voxel[1], row->voxel[2]}, local[3];
        voxel[row->axis] = change + (i == 0 ? -0.5 : 0.5);
        if (umbr_light_frame_local(block->light_frame, voxel, local)) {
            (void)umbr_verify_trace(block, local, &buried);
        }
    }
    return buried;
}

/* Samples a random row of voxels at STATIONS places. Returns 1 and a boundary between two
 * neighbouring voxels that differ, or 0 if all samples are equal or the boundary is inside a
 * solid. */
static int find_change(struct umbr_verify_block *block, int axis, double boundary[3])
{
    struct row row = {.axis = axis};
    const double size = block->light_frame->size;
    double at[STATIONS];
    uint8_t lit[STATIONS];
    size_t changes = 0, pick = 0;
    for (int k = 0; k < 3; k++) {
        row.voxel[k] = floor(umbr_next_unit(block) * size) + 0.5;
    }
    for (size_t i = 0; i < STATIONS; i++) {
        at[i] = floor(((double)i + umbr_next_unit(block)) * size / STATIONS);
    }
    ask_row(block, &row, at, STATIONS, lit);
    for (size_t i = 1; i < STATIONS; i++) {
        if (lit[i] != lit[i - 1]) {
            changes++;
            pick = umbr_next_random(block) % changes == 0 ? i : pick;
        }
    }
    if (changes == 0) {
        return 0;
    }
    double low = at[pick - 1], high = at[pick];
    while (high - low > 1) {
        const double middle = floor(0.5 * (low + high));
        uint8_t answer;
        ask_row(block, &row, &middle, 1, &answer);
        if (answer == lit[pick - 1]) {
            low = middle;
        } else {
            high = middle;
        }
    }
    memcpy(boundary, row.voxel, sizeof row.voxel);
    boundary[axis] = high;
    return !is_buried(block, &row, high);
}

/* Finds a boundary of a random kind: half are surfaces met by rays, an eighth are changes along the
 * light, the others changes across it. Returns 0 if none was found. */
int umbr_verify_boundary(struct umbr_verify_block *block, uint64_t *walks, double boundary[3])
{
    const uint64_t kind = umbr_next_random(block) % 8;
    for (int i = 0; i<WALKS_A_BOUNDARY && * walks> 0; i++) {
        --*walks;
        if (kind < 4 ? find_surface(block, boundary)
                     : find_change(block, kind == 7 ? 2 : (int)(kind & 1), boundary)) {
            return 1;
        }
    }
    return 0;
}

/* Judges points near boundaries until `wanted` were compared; returns the number that is missing: a
 * scene may have few boundaries. */
static uint64_t judge_near(struct umbr_verify_block *block, uint64_t wanted)
{
    uint64_t walks = wanted * TRIES_A_POINT / POINTS_A_BOUNDARY;
    while (wanted > 0 && walks > 0) {
        struct umbr_sample samples[POINTS_A_BOUNDARY];
        double boundary[3];
        size_t count = 0;
        if (!umbr_verify_boundary(block, &walks, boundary)) {
            continue;
        }
        for (int i = 0; i < POINTS_A_BOUNDARY && count < wanted; i++) {
            for (int k = 0; k < 3; k++) {
                samples[count].voxel[k] =
                    boundary[k] + (2 * umbr_next_unit(block) - 1) * NEAR_VOXELS;
            }
            count += (size_t)umbr_verify_place(block, &samples[count]);
        }
        const uint64_t compared = umbr_verify_judge(block, samples, count);
        block->result.near_boundary += compared;
        wanted -= compared;
    }
    return wanted;
}

/* Moves a point of a surface along the normal that faces the light, out of the voxels that the
 * surface's plane passes. Returns 0 if the light grazes the surface. */
static int lift(const struct umbr_verify_block *block, const double normal[3], double local[3])
{
    const double facing = umb__dot(normal, block->job->light.direction);
    double length = 0;
    for (int i = 0; i < 3; i++) {
        length += 0.5 * fabs(umb__dot(normal, block->light_frame->step[i]));
    }
    for (int k = 0; k < 3; k++) {
        local[k] += (facing < 0 ? 1 : -1) * BIAS_SLACK * length * normal[k];
    }
    return fabs(facing) > GRAZING;
}

/* Finds a point just off a surface, by a ray along the light from a random point of the box.
 * Returns 0 if the ray meets no surface. */
static int find_receiver(struct umbr_verify_block *block, struct umbr_sample *sample)
{
    const double *light = block->job->light.direction, *origin = block->job->origin;
    double from[3], world[3], local[3];
    umbr_draw_anywhere(block, sample->voxel);
    struct umbr_hit hit;
    if (!umbr_light_frame_local(block->light_frame, sample->voxel, from)) {
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        world[k] = origin[k] + from[k];
    }
    umbr_nearest(block->job->rays, world, light, 0, INFINITY, &hit);
    for (int k = 0; k < 3; k++) {
        local[k] = from[k] + hit.distance * light[k];
    }
    return hit.distance >= 0 && lift(block, hit.normal, local) &&
           umbr_light_frame_voxel(block->light_frame, local, sample->voxel) &&
           umbr_verify_place(block, sample);
}

void umbr_verify_points(struct umbr_verify_block *block, uint64_t count)
{
    if (block->job->is_static) {
        compare_drawn(block, find_receiver, count, count * TRIES_A_POINT);
        return;
    }
    judge_uncovered(block, count / 4);
    const uint64_t missing = judge_near(block, count / 2);
    const uint64_t anywhere = count - count / 2 + missing;
    compare_drawn(block, find_anywhere, anywhere, anywhere * DRAWS_A_POINT);
}
