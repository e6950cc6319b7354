/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing points to compare, in voxel space.
 *
 * Shadow boundaries come in two kinds. Surfaces: a ray from the light finds them, whatever the
 * asset says. Everything else, the walls of shadow volumes above all: visibility is looked up at
 * jittered stations along a random row of the asset's voxels, one change is picked and halved down
 * to two neighbouring voxels. (Along the light, most changes of an asset baked under the closed
 * rule lie deep inside solids, where nothing can be compared: hence the ray.)
 */
#include "rays/verify_block.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

#define BIAS_SLACK (65.0 / 64.0) /* as automatic biases have (client/core/query) */
#define GRAZING    1e-6          /* cosine below which a surface is seen edge on */

enum {
    STATIONS = 32, /* look-ups along a row before halving */
    POINTS_A_BOUNDARY = 8,
    NEAR_VOXELS = 4,
    TRIES_A_POINT = 24,   /* draws near boundaries for each point wanted, before giving up */
    DRAWS_A_POINT = 4,    /* uniform ones: one inside a closed solid costs the most rays */
    WALKS_A_BOUNDARY = 4, /* rows tried before another kind of boundary gets its turn */
};

_Static_assert(STATIONS <= UMBR_SAMPLES_MAX && POINTS_A_BOUNDARY <= UMBR_SAMPLES_MAX,
               "batches fit");

/* 1 if a point is answered by the block's frustum and no other face of its light. */
static int is_own(const struct umbr_verify_block *block, const double world[3])
{
    const double w = umbr_frame_w(block->frame, world);
    for (uint32_t i = 0; i < block->job->light.frustum_count; i++) {
        const struct umbr_frame *other = &block->job->frames[i];
        if (other != block->frame && umbr_frame_w(other, world) >= w) {
            return 0;
        }
    }
    return 1;
}

int umbr_verify_place(const struct umbr_verify_block *block, struct umbr_sample *sample)
{
    const double size = block->frame->size;
    double centre[3];
    for (int i = 0; i < 3; i++) {
        if (!(sample->voxel[i] >= 0 && sample->voxel[i] < size)) {
            return 0;
        }
        centre[i] = floor(sample->voxel[i]) + 0.5;
    }
    return umbr_frame_world(block->frame, sample->voxel, sample->world) &&
           umbr_frame_world(block->frame, centre, sample->centre) && is_own(block, sample->world);
}

/* Draws and compares points until so many count, or so many were drawn. In: draw: fills in a sample
 * and returns 1, or 0 if there is none this time. */
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

static void draw_anywhere(struct umbr_verify_block *block, double voxel[3])
{
    for (int k = 0; k < 3; k++) {
        voxel[k] = umbr_next_unit(block) * block->frame->size;
    }
}

static int find_anywhere(struct umbr_verify_block *block, struct umbr_sample *sample)
{
    draw_anywhere(block, sample->voxel);
    return umbr_verify_place(block, sample);
}

void umbr_verify_uniform(struct umbr_verify_block *block, uint64_t wanted)
{
    compare_drawn(block, find_anywhere, wanted, wanted * DRAWS_A_POINT);
}

/* The first surface that light meets in a random column; 0 if there is none. */
static int find_surface(struct umbr_verify_block *block, double boundary[3])
{
    const double size = block->frame->size;
    double from[3], to[3], direction[3], length = 0;
    for (int k = 0; k < 2; k++) {
        boundary[k] = floor(umbr_next_unit(block) * size) + 0.5;
    }
    boundary[2] = size;
    if (!umbr_frame_world(block->frame, boundary, to)) {
        return 0;
    }
    boundary[2] = 0;
    if (!umbr_frame_world(block->frame, boundary, from)) {
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        direction[k] = to[k] - from[k];
        length += direction[k] * direction[k];
    }
    length = sqrt(length);
    for (int k = 0; k < 3; k++) {
        direction[k] /= length;
    }
    struct umbr_hit hit;
    umbr_nearest(block->job->rays, from, direction, 0, length, &hit);
    boundary[2] = size * hit.distance / length; /* depth is linear along a column */
    return hit.distance >= 0;
}

/* A random row of voxels: all but coordinate `axis` are fixed. */
struct row {
    double voxel[3]; /* of a voxel's centre */
    int axis;
};

/* Looks up `count` voxels of a row, at whole positions at[i]. */
static void ask_row(const struct umbr_verify_block *block, const struct row *row, const double *at,
                    size_t count, uint8_t *lit)
{
    double world[STATIONS][3];
    for (size_t i = 0; i < count; i++) {
        double voxel[3] = {row->voxel[0], row->voxel[1], row->voxel[2]};
        voxel[row->axis] = at[i] + 0.5;
        if (!umbr_frame_world(block->frame, voxel, world[i])) {
            memset(world[i], 0, sizeof world[i]); /* cannot be: the row is inside the frustum */
        }
    }
    umbr_verify_ask(block->job, (const double(*)[3])world, count, lit);
}

/* 1 if both voxels beside a change are inside closed solids, where answers mean nothing. */
static int is_buried(const struct umbr_verify_block *block, const struct row *row, double change)
{
    int buried = 1;
    for (int i = 0; i < 2 && buried; i++) {
        double voxel[3] = {row->voxel[0], row->voxel[1], row->voxel[2]}, world[3];
        voxel[row->axis] = change + (i == 0 ? -0.5 : 0.5);
        if (umbr_frame_world(block->frame, voxel, world)) {
            (void)umbr_verify_trace(block, world, &buried);
        }
    }
    return buried;
}

/* Walks a random row; returns 1 and the boundary between two neighbouring voxels that differ, or 0
 * if no two stations differ or the change is buried. */
static int find_change(struct umbr_verify_block *block, int axis, double boundary[3])
{
    struct row row = {.axis = axis};
    const double size = block->frame->size;
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

/* Half surfaces, the rest changes along the three axes, those along the light the fewest. */
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

uint64_t umbr_verify_near(struct umbr_verify_block *block, uint64_t wanted)
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

/* Voxel space of a world point of parallel light. */
static void to_voxel(const struct umbr_frame *frame, const double world[3], double voxel[3])
{
    for (int i = 0; i < 3; i++) {
        const double *m = frame->world_to_voxel[i];
        voxel[i] = m[3];
        for (int k = 0; k < 3; k++) {
            voxel[i] += m[k] * (world[k] - frame->origin[k]);
        }
    }
}

/* Moves a surface's point along its normal, turned to the light, as a query of one tap does.
 * Returns 0 if the light grazes it. */
static int lift(const struct umbr_verify_block *block, const double normal[3], double world[3])
{
    const double facing = umb__dot(normal, block->job->light.direction);
    double length = 0;
    for (int i = 0; i < 3; i++) {
        length += 0.5 * fabs(umb__dot(normal, block->frame->step[i]));
    }
    for (int k = 0; k < 3; k++) {
        world[k] += (facing < 0 ? 1 : -1) * BIAS_SLACK * length * normal[k];
    }
    return fabs(facing) > GRAZING;
}

/* A point just off a surface that a ray along the light finds from somewhere in the box; 0 if it
 * finds none. */
static int find_receiver(struct umbr_verify_block *block, struct umbr_sample *sample)
{
    const double *light = block->job->light.direction;
    double from[3], world[3];
    draw_anywhere(block, sample->voxel);
    struct umbr_hit hit;
    if (!umbr_frame_world(block->frame, sample->voxel, from)) {
        return 0;
    }
    umbr_nearest(block->job->rays, from, light, 0, INFINITY, &hit);
    for (int k = 0; k < 3; k++) {
        world[k] = from[k] + hit.distance * light[k];
    }
    if (hit.distance < 0 || !lift(block, hit.normal, world)) {
        return 0;
    }
    to_voxel(block->frame, world, sample->voxel);
    return umbr_verify_place(block, sample);
}

void umbr_verify_surfaces(struct umbr_verify_block *block, uint64_t wanted)
{
    compare_drawn(block, find_receiver, wanted, wanted * TRIES_A_POINT);
}
