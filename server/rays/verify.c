/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Comparing an asset with traced rays.
 *
 * Work is cut into blocks of points. A block's random numbers follow from the seed and its number
 * alone, and sums do not depend on order, so the result is the same for every number of threads.
 *
 * Points are drawn in voxel space. A boundary is found by walking the asset: visibility is looked
 * up at jittered stations along a random row of voxels (half of the rows along the light, where
 * surfaces lie, half across it, where the walls of shadow volumes lie), one change is picked and
 * halved down to two neighbouring voxels.
 *
 * What a voxel says belongs to its centre, so "inside a closed solid" is asked of the voxel's
 * centre as well as of the point. Both are asked along the light, as the closed rule's definition
 * does; if such a point would count against the asset, three other directions vote, so that a
 * ray that grazes an edge cannot accuse it.
 */
#include "rays/verify.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "base/memory.h"
#include "rays/verify_frame.h"

enum {
    BLOCK_POINTS = 2048,
    DEFAULT_POINTS = 1000000,
    THREADS_MAX = 256,
    STATIONS = 64,            /* look-ups along a row before halving */
    POINTS_A_BOUNDARY = 8,
    NEAR_VOXELS = 4,
    TRIES_A_POINT = 24,       /* draws for each point wanted, before a block gives up on it */
    BAND_STEPS = 5,           /* samples along each axis of the band's grid */
};

struct job {
    const struct umb_asset *asset;
    const struct umbr_rays *rays;
    const struct umbr_verify_options *options;
    struct umb_light_info light;
    struct umbr_frame *frames; /* [light.frustum_count] */
    struct umb_query query;
    uint64_t points, block_count;
    atomic_uint_least64_t next_block;
    pthread_mutex_t lock;      /* guards total and worst_block */
    struct umbr_verify_result total;
    uint64_t worst_block;
};

/* One block at work. */
struct block {
    struct job *job;
    const struct umbr_frame *frame;
    uint64_t random;
    struct umbr_verify_result result;
};

/* A point in its three guises. */
struct sample {
    double voxel[3];  /* voxel space */
    double world[3];  /* metres */
    double centre[3]; /* of its voxel, metres, world */
    int lit;          /* the asset's answer */
};

/* SplitMix64. */
static uint64_t next_random(struct block *block)
{
    uint64_t z = block->random += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

/* Uniform in [0, 1). */
static double next_unit(struct block *block)
{
    return (double)(next_random(block) >> 11) * 0x1p-53;
}

static void ask(const struct job *job, const double (*world)[3], size_t count, uint8_t *answers)
{
    const struct umb_points points = {
        .positions = world, .format = UMB_POINT_F64, .count = count};
    struct umb_answers out = {.values = answers};
    umb_query_run(&job->query, &points, 0, count, &out);
}

/* The traced truth: 1 if nothing lies between the point and the light. */
static int traced_lit(const struct job *job, const double world[3])
{
    double towards[3], distance;
    umbr_towards_light(&job->light, world, towards, &distance);
    return !umbr_occluded(job->rays, world, towards, 0, distance);
}

/* Net number of closed solids around a point, seen along a direction. */
static int is_inside_along(const struct job *job, const double world[3], const double direction[3])
{
    int winding, crossings;
    umbr_crossings(job->rays, world, direction, job->options->closed, &winding, &crossings);
    return winding > 0;
}

static int is_inside(const struct block *block, const double world[3])
{
    double towards[3], distance;
    if (block->job->options->closed == NULL || !block->frame->closed) {
        return 0;
    }
    umbr_towards_light(&block->job->light, world, towards, &distance);
    /* From inside no ray comes out without a hit; one occlusion ray is cheaper than all hits. */
    return umbr_occluded(block->job->rays, world, towards, 0, distance) &&
           is_inside_along(block->job, world, towards);
}

/* The same by three directions that no modeller would have chosen; any two of them decide. */
static int is_inside_by_vote(const struct block *block, const double world[3])
{
    static const double directions[3][3] = {
        {0.5345224838248488, 0.2672612419124244, 0.8017837257372732},
        {-0.6396021490668313, 0.4264014327112209, 0.6396021490668313},
        {0.2182178902359924, -0.8728715609439696, -0.4364357804719848}};
    int votes = 0;
    if (block->job->options->closed == NULL || !block->frame->closed) {
        return 0;
    }
    for (int i = 0; i < 3; i++) {
        votes += is_inside_along(block->job, world, directions[i]);
    }
    return votes >= 2;
}

/* Fills world and centre from voxel; 0 if the point is outside the frustum. */
static int place_sample(const struct block *block, struct sample *sample)
{
    double size = block->frame->size, centre[3];
    for (int i = 0; i < 3; i++) {
        if (!(sample->voxel[i] >= 0 && sample->voxel[i] < size)) {
            return 0;
        }
        centre[i] = floor(sample->voxel[i]) + 0.5;
    }
    return umbr_frame_world(block->frame, sample->voxel, sample->world) &&
           umbr_frame_world(block->frame, centre, sample->centre);
}

/*
 * 1 if the truth changes within one voxel of the point: somewhere on a 5x5x5 grid of half-voxel
 * offsets, or at the centre of the point's own voxel.
 */
static int in_band(const struct block *block, const struct sample *sample, int truth)
{
    if (traced_lit(block->job, sample->centre) != truth) {
        return 1;
    }
    for (int i = 0; i < BAND_STEPS * BAND_STEPS * BAND_STEPS; i++) {
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
    return 0;
}

/* Compares one placed and answered sample; returns 1 if it was compared, 0 if left out. */
static int judge(struct block *block, const struct sample *sample)
{
    struct umbr_verify_result *result = &block->result;
    int truth = traced_lit(block->job, sample->world);
    if (is_inside(block, sample->centre) || (!truth && is_inside(block, sample->world))) {
        result->skipped_inside++;
        return 0;
    }
    result->points++;
    if (truth == sample->lit) {
        return 1;
    }
    if (in_band(block, sample, truth)) {
        result->inside_band++;
        return 1;
    }
    if (is_inside_by_vote(block, sample->centre) || is_inside_by_vote(block, sample->world)) {
        result->points--;
        result->skipped_inside++;
        return 0;
    }
    result->outside_band++;
    if (!result->has_worst) {
        result->has_worst = 1;
        memcpy(result->worst_point, sample->world, sizeof result->worst_point);
    }
    return 1;
}

/* Looks up and judges placed samples; returns how many were compared. */
static uint64_t judge_all(struct block *block, struct sample *samples, size_t count)
{
    double world[STATIONS][3];
    uint8_t answers[STATIONS];
    uint64_t compared = 0;
    for (size_t i = 0; i < count; i++) {
        memcpy(world[i], samples[i].world, sizeof world[i]);
    }
    ask(block->job, (const double(*)[3])world, count, answers);
    for (size_t i = 0; i < count; i++) {
        samples[i].lit = answers[i] >= 128;
        compared += (uint64_t)judge(block, &samples[i]);
    }
    return compared;
}

/* Draws uniform points until `wanted` were compared, or too many draws were in vain. */
static void compare_uniform(struct block *block, uint64_t wanted)
{
    uint64_t tries = wanted * TRIES_A_POINT;
    while (wanted > 0 && tries > 0) {
        struct sample samples[STATIONS];
        size_t count = 0;
        uint64_t aim = wanted < STATIONS ? wanted : STATIONS;
        while (count < aim && tries > 0) {
            for (int k = 0; k < 3; k++) {
                samples[count].voxel[k] = next_unit(block) * block->frame->size;
            }
            count += (size_t)place_sample(block, &samples[count]);
            tries--;
        }
        wanted -= judge_all(block, samples, count);
    }
}

/* A random row of voxels: all but coordinate `axis` are fixed. */
struct row {
    double voxel[3]; /* of a voxel's centre */
    int axis;
};

/* Looks up `count` voxels of a row, at whole positions at[i]. */
static void ask_row(const struct block *block, const struct row *row, const double *at,
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
    ask(block->job, (const double(*)[3])world, count, lit);
    for (size_t i = 0; i < count; i++) {
        lit[i] = lit[i] >= 128;
    }
}

/*
 * Walks a random row; returns 1 and the boundary between two neighbouring voxels that differ, or 0
 * if no two stations differ or the change lies inside a closed solid, where answers mean nothing.
 */
static int find_boundary(struct block *block, double boundary[3])
{
    struct row row;
    double at[STATIONS], size = block->frame->size;
    uint8_t lit[STATIONS];
    size_t changes = 0, pick = 0;
    uint64_t kind = next_random(block) % 4;
    row.axis = kind < 2 ? 2 : (int)kind - 2;
    for (int k = 0; k < 3; k++) {
        row.voxel[k] = floor(next_unit(block) * size) + 0.5;
    }
    for (size_t i = 0; i < STATIONS; i++) {
        at[i] = floor(((double)i + next_unit(block)) * size / STATIONS);
    }
    ask_row(block, &row, at, STATIONS, lit);
    for (size_t i = 1; i < STATIONS; i++) {
        if (lit[i] != lit[i - 1]) {
            changes++;
            pick = next_random(block) % changes == 0 ? i : pick;
        }
    }
    if (changes == 0) {
        return 0;
    }
    double low = at[pick - 1], high = at[pick];
    while (high - low > 1) {
        double middle = floor(0.5 * (low + high));
        uint8_t answer;
        ask_row(block, &row, &middle, 1, &answer);
        if (answer == lit[pick - 1]) {
            low = middle;
        } else {
            high = middle;
        }
    }
    memcpy(boundary, row.voxel, sizeof row.voxel);
    boundary[row.axis] = high;
    double sides[2][3];
    for (int i = 0; i < 2; i++) {
        double voxel[3] = {boundary[0], boundary[1], boundary[2]};
        voxel[row.axis] += i == 0 ? -0.5 : 0.5;
        if (!umbr_frame_world(block->frame, voxel, sides[i])) {
            return 0;
        }
    }
    return !(is_inside(block, sides[0]) && is_inside(block, sides[1]));
}

/* Draws points near boundaries until `wanted` were compared; returns how many are missing. */
static uint64_t compare_near(struct block *block, uint64_t wanted)
{
    uint64_t walks = wanted * TRIES_A_POINT / POINTS_A_BOUNDARY;
    while (wanted > 0 && walks-- > 0) {
        struct sample samples[POINTS_A_BOUNDARY];
        double boundary[3];
        size_t count = 0;
        if (!find_boundary(block, boundary)) {
            continue;
        }
        for (int i = 0; i < POINTS_A_BOUNDARY && count < wanted; i++) {
            for (int k = 0; k < 3; k++) {
                samples[count].voxel[k] =
                    boundary[k] + (2 * next_unit(block) - 1) * NEAR_VOXELS;
            }
            count += (size_t)place_sample(block, &samples[count]);
        }
        uint64_t compared = judge_all(block, samples, count);
        block->result.near_boundary += compared;
        wanted -= compared;
    }
    return wanted;
}

static void add_result(struct job *job, uint64_t number, const struct umbr_verify_result *result)
{
    (void)pthread_mutex_lock(&job->lock);
    struct umbr_verify_result *total = &job->total;
    total->points += result->points;
    total->near_boundary += result->near_boundary;
    total->skipped_inside += result->skipped_inside;
    total->inside_band += result->inside_band;
    total->outside_band += result->outside_band;
    if (result->has_worst && (!total->has_worst || number < job->worst_block)) {
        total->has_worst = 1;
        memcpy(total->worst_point, result->worst_point, sizeof total->worst_point);
        job->worst_block = number;
    }
    (void)pthread_mutex_unlock(&job->lock);
}

static void *work(void *user)
{
    struct job *job = user;
    for (;;) {
        uint64_t number = atomic_fetch_add(&job->next_block, 1);
        if (number >= job->block_count) {
            return NULL;
        }
        uint64_t first = number * BLOCK_POINTS;
        uint64_t count = job->points - first < BLOCK_POINTS ? job->points - first : BLOCK_POINTS;
        struct block block = {
            .job = job,
            .frame = &job->frames[number % job->light.frustum_count],
            .random = job->options->seed,
        };
        /* Two steps of the generator keep neighbouring seeds and blocks apart. */
        block.random = next_random(&block) + number * UINT64_C(0xd1342543de82ef95);
        block.random = next_random(&block);
        uint64_t missing = compare_near(&block, count / 2);
        compare_uniform(&block, count - count / 2 + missing);
        add_result(job, number, &block.result);
    }
}

static unsigned thread_count(const struct job *job)
{
    uint64_t wanted = job->options->threads;
    if (wanted == 0) {
        long online = sysconf(_SC_NPROCESSORS_ONLN);
        wanted = online > 0 ? (uint64_t)online : 1;
    }
    wanted = wanted > THREADS_MAX ? THREADS_MAX : wanted;
    return (unsigned)(wanted > job->block_count ? job->block_count : wanted);
}

/* Runs all blocks. The caller's thread works too, so a thread that cannot start costs time only. */
static void run(struct job *job)
{
    pthread_t threads[THREADS_MAX];
    unsigned wanted = thread_count(job), started = 0;
    while (started + 1 < wanted &&
           pthread_create(&threads[started], NULL, work, job) == 0) {
        started++;
    }
    (void)work(job);
    for (unsigned i = 0; i < started; i++) {
        (void)pthread_join(threads[i], NULL);
    }
}

static enum umb_status prepare(struct job *job, uint32_t light, struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = light, .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    enum umb_status status = umb_asset_get_light(job->asset, light, &job->light);
    if (status != UMB_OK) {
        return umb_fail(error, UMB_E_ARGUMENT, "light %u is not in the asset", light);
    }
    status = umb_query_prepare(job->asset, &settings, &job->query, error);
    if (status != UMB_OK) {
        return status;
    }
    if (job->light.frustum_count == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "light %u has no frustum", light);
    }
    job->frames = umb__alloc_zeroed(NULL, job->light.frustum_count, sizeof *job->frames);
    if (job->frames == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory for %u frusta",
                        job->light.frustum_count);
    }
    for (uint32_t i = 0; status == UMB_OK && i < job->light.frustum_count; i++) {
        status = umbr_frame_init(&job->frames[i], job->asset, job->light.first_frustum + i, error);
    }
    return status;
}

enum umb_status umbr_verify(const struct umb_asset *asset, uint32_t light,
                            const struct umbr_rays *rays,
                            const struct umbr_verify_options *options,
                            struct umbr_verify_result *result, struct umb_error *error)
{
    static const struct umbr_verify_options defaults = {0};
    struct job job = {.asset = asset, .rays = rays};
    *result = (struct umbr_verify_result){0};
    job.options = options != NULL ? options : &defaults;
    job.points = job.options->points > 0 ? job.options->points : DEFAULT_POINTS;
    job.block_count = job.points / BLOCK_POINTS + (job.points % BLOCK_POINTS != 0);
    atomic_init(&job.next_block, 0);
    enum umb_status status = prepare(&job, light, error);
    if (status == UMB_OK && pthread_mutex_init(&job.lock, NULL) != 0) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "no memory for a mutex");
    }
    if (status == UMB_OK) {
        run(&job);
        (void)pthread_mutex_destroy(&job.lock);
        *result = job.total;
    }
    umb__free(NULL, job.frames);
    return status;
}
