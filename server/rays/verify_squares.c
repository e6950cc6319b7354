/* SPDX-License-Identifier: Apache-2.0 */
/* See verify_squares.h. A square is traced first, then walked block by block of 8 x 8 columns from
 * the light on, cube by cube. */
#include "rays/verify_squares.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

#include "base/memory.h"
#include "base/try.h"
#include "query/volume_parts.h"
#include "rays/verify_block.h"
#include "tool/threads.h"

enum {
    BLOCK = 8, /* columns a side of a brick */
    BLOCKS = UMBR_SQUARE / BLOCK,
    SOLIDS_MAX = 32, /* nested solids that a column's ray passes before it gives up */
};

/* Voxels that may be judged one by one, of all squares together. */
#define JUDGED_MAX ((uint64_t)1 << 20)

/* Error of a depth in floats that is tolerated, in voxels. Only voxels that contradict their column
 * by more are judged one by one. */
#define DEPTH_SLACK 1e-3

/* What rays say about the columns of a square, in voxels along the light. */
struct columns {
    double must_lit[UMBR_SQUARE][UMBR_SQUARE];  /* voxels whose centre lies before are lit */
    double must_dark[UMBR_SQUARE][UMBR_SQUARE]; /* voxels whose centre lies behind are shadowed */
    double most_lit[BLOCKS][BLOCKS];            /* greatest must_lit of each block */
    double least_dark[BLOCKS][BLOCKS];          /* least must_dark of each block */
};

struct squares_crew {
    struct umbr_verify_job job;
    const struct umbr_exact *exact; /* NULL: no frustum needs it */
    struct umb_volume volume;
    const struct umbr_square *squares; /* [count] */
    pthread_mutex_t lock;              /* guards total */
    struct umbr_verify_result total;
    atomic_uint_fast64_t judged;
    atomic_int ended; /* 1: a disagreement was found, or too many voxels were judged */
};

/* One square at work. */
struct square_work {
    struct umbr_verify_block block;
    struct squares_crew *crew;
    struct umb__tree tree;
    uint32_t x, y; /* first texel */
    struct columns *columns;
};

/* Finds where the solid ends that a ray entered at hit->distance. Returns the distance, or
 * hit->distance if it has no end. In: from: the ray from the column's start. */
static double solid_end(const struct umbr_verify_block *block, const struct umbr_exact_ray *from,
                        const struct umbr_exact_hit *hit)
{
    const uint8_t *closed = block->job->options->closed;
    const double step =
        block->exact != NULL ? 0x1p-40 * from->far_m : umbr_rays_error_m(block->job->rays);
    double along = hit->distance;
    for (int i = 0; i < SOLIDS_MAX; i++) {
        struct umbr_exact_ray ray = *from;
        struct umbr_exact_hit next;
        along += step;
        ray.far_m = from->far_m - along;
        for (int k = 0; k < 3; k++) {
            ray.from[k] = from->from[k] + along * from->direction[k];
        }
        if (!(ray.far_m > 0)) {
            break;
        }
        umbr_verify_nearest(block, &ray, &next);
        if (next.distance < 0) {
            break;
        }
        along += next.distance;
        if (!closed[next.triangle] || next.leaving) {
            return along;
        }
    }
    return hit->distance;
}

/* Traces column (x, y) of a square. */
static void trace_column(struct square_work *work, int x, int y)
{
    const struct umbr_verify_block *block = &work->block;
    const double size = block->light_frame->size;
    double *must_lit = &work->columns->must_lit[y][x], *must_dark = &work->columns->must_dark[y][x];
    struct umbr_exact_ray ray;
    struct umbr_exact_hit hit;
    double z_first;
    *must_lit = -INFINITY; /* a column behind the lamp: nothing is known */
    *must_dark = INFINITY;
    if (!umbr_verify_column(block, (double)work->x + x + 0.5, (double)work->y + y + 0.5, &ray,
                            &z_first)) {
        return;
    }
    umbr_verify_nearest(block, &ray, &hit);
    if (hit.distance < 0) {
        *must_lit = size;
        return;
    }
    const double voxels_a_metre = (size - z_first) / ray.far_m; /* depth is linear along a column */
    const double first = z_first + voxels_a_metre * hit.distance;
    double end = first;
    if (umbr_has_undefined(block) && block->job->options->closed[hit.triangle] && !hit.leaving) {
        end = z_first + voxels_a_metre * solid_end(block, &ray, &hit);
    }
    *must_lit = first - 1; /* within a voxel of the surface either answer is in the band */
    *must_dark = fmax(first + 1, end + DEPTH_SLACK);
}

static void trace_square(struct square_work *work)
{
    struct columns *columns = work->columns;
    for (int by = 0; by < BLOCKS; by++) {
        for (int bx = 0; bx < BLOCKS; bx++) {
            double most = -INFINITY, least = INFINITY;
            for (int i = 0; i < BLOCK * BLOCK; i++) {
                const int x = bx * BLOCK + i % BLOCK, y = by * BLOCK + i / BLOCK;
                trace_column(work, x, y);
                most = fmax(most, columns->must_lit[y][x]);
                least = fmin(least, columns->must_dark[y][x]);
            }
            columns->most_lit[by][bx] = most;
            columns->least_dark[by][bx] = least;
        }
    }
    work->block.result.records += UMBR_SQUARE * UMBR_SQUARE;
}

/* Judges one voxel by its centre. */
static void judge_voxel(struct square_work *work, int x, int y, uint32_t z, uint8_t lit)
{
    struct umbr_sample sample = {
        .voxel = {(double)work->x + x + 0.5, (double)work->y + y + 0.5, z + 0.5}};
    if (atomic_load_explicit(&work->crew->ended, memory_order_relaxed)) {
        return;
    }
    if (atomic_fetch_add_explicit(&work->crew->judged, 1, memory_order_relaxed) >= JUDGED_MAX) {
        atomic_store(&work->crew->ended, 1);
        return;
    }
    if (umbr_verify_place(&work->block, &sample)) {
        (void)umbr_verify_judge_answers(&work->block, &sample, &lit, 1);
        if (work->block.result.outside_band > 0) {
            atomic_store(&work->crew->ended, 1);
        }
    }
}

/* Compares voxels z .. z_end - 1, all lit or all shadowed, with column (x, y). */
static void compare_run(struct square_work *work, int x, int y, uint32_t z, uint32_t z_end, int lit)
{
    const double must_lit = work->columns->must_lit[y][x];
    const double must_dark = work->columns->must_dark[y][x];
    if (lit) {
        if (z + 0.5 < must_dark) {
            z = must_dark + 0.5 < z_end ? (uint32_t)ceil(must_dark - 0.5) : z_end;
        }
        for (; z < z_end; z++) {
            judge_voxel(work, x, y, z, 1);
        }
    } else {
        for (; z < z_end && z + 0.5 < must_lit; z++) {
            judge_voxel(work, x, y, z, 0);
        }
    }
}

/* Compares a uniform cube with a block of columns. */
static void compare_cube(struct square_work *work, int bx, int by, uint32_t z, uint32_t z_end,
                         int lit)
{
    const struct columns *columns = work->columns;
    if (lit ? z_end - 0.5 <= columns->least_dark[by][bx] : z + 0.5 >= columns->most_lit[by][bx]) {
        return;
    }
    for (int i = 0; i < BLOCK * BLOCK; i++) {
        compare_run(work, bx * BLOCK + i % BLOCK, by * BLOCK + i / BLOCK, z, z_end, lit);
    }
}

/* Compares a brick from depth z on. */
static void compare_brick(struct square_work *work, int bx, int by, uint32_t z,
                          const uint64_t brick[8])
{
    const struct columns *columns = work->columns;
    if (z + BLOCK - 0.5 <= columns->least_dark[by][bx] && z + 0.5 >= columns->most_lit[by][bx]) {
        return;
    }
    for (int i = 0; i < BLOCK * BLOCK; i++) {
        for (uint32_t slice = 0; slice < BLOCK; slice++) {
            compare_run(work, bx * BLOCK + i % BLOCK, by * BLOCK + i / BLOCK, z + slice,
                        z + slice + 1, (int)(brick[slice] >> i & 1));
        }
    }
}

/* Compares a block of columns from the light on. */
static void compare_block(struct square_work *work, int bx, int by)
{
    const uint32_t size = 1U << work->tree.log2_size;
    const uint32_t x = work->x + (uint32_t)(bx * BLOCK), y = work->y + (uint32_t)(by * BLOCK);
    struct umb_volume_stats stats = {0};
    for (uint32_t z = 0; z < size;) {
        const struct umb__place place = umb__tree_locate(&work->tree, x, y, z, &stats);
        const uint32_t next = (z | ((1U << place.level) - 1U)) + 1U;
        if (place.brick != NULL) {
            compare_brick(work, bx, by, z, place.brick);
        } else {
            compare_cube(work, bx, by, z, next, place.lit);
        }
        z = next;
    }
}

static void add_square(struct squares_crew *crew, const struct umbr_verify_result *result)
{
    (void)pthread_mutex_lock(&crew->lock);
    umbr_verify_result_add(&crew->total, result);
    if (result->has_worst && !crew->total.has_worst) {
        crew->total.has_worst = 1;
        memcpy(crew->total.worst_point, result->worst_point, sizeof crew->total.worst_point);
    }
    (void)pthread_mutex_unlock(&crew->lock);
}

/* Traces and compares one square. */
static enum umb_status compare_square(void *user, size_t number, size_t count,
                                      struct umb_error *error)
{
    struct squares_crew *crew = user;
    const struct umbr_square *square = &crew->squares[number];
    const uint32_t face = square->frustum - crew->job.light.first_frustum;
    const struct umb__volume volume = umb__volume_of(&crew->volume);
    (void)count; /* 1 */
    if (crew->job.options->cancelled != NULL && crew->job.options->cancelled()) {
        return umb_fail(error, UMB_E_CANCELLED, "verification: cancelled");
    }
    if (atomic_load(&crew->ended)) {
        return UMB_OK;
    }
    struct square_work work = {
        .block = {.job = &crew->job, .light_frame = &crew->job.frames[face]},
        .crew = crew,
        .tree = umb__volume_tree(&volume, face),
        .x = square->x,
        .y = square->y,
        .columns = umb__alloc(NULL, 1, sizeof *work.columns),
    };
    if (work.columns == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "verification: memory for a square refused");
    }
    work.block.exact =
        umbr_verify_needs_exact(work.block.light_frame, crew->job.rays) ? crew->exact : NULL;
    trace_square(&work);
    for (int i = 0; i < BLOCKS * BLOCKS; i++) {
        compare_block(&work, i % BLOCKS, i / BLOCKS);
    }
    umb__free(NULL, work.columns);
    add_square(crew, &work.block.result);
    return work.block.status == UMB_OK
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY,
                          "verification: memory for rays in doubles refused");
}

/* Checks that the squares lie in frusta of the light. */
static enum umb_status check_squares(const struct squares_crew *crew, size_t count,
                                     struct umb_error *error)
{
    const struct umb_light_info *light = &crew->job.light;
    for (size_t i = 0; i < count; i++) {
        const struct umbr_square *square = &crew->squares[i];
        const uint32_t face = square->frustum - light->first_frustum;
        if (face >= light->frustum_count || square->x % UMBR_SQUARE != 0 ||
            square->y % UMBR_SQUARE != 0 || square->x >= crew->job.frames[face].size ||
            square->y >= crew->job.frames[face].size) {
            return umb_fail(error, UMB_E_ARGUMENT, "square %zu: texel %u %u of frustum %u: none", i,
                            square->x, square->y, square->frustum);
        }
        if (crew->job.frames[face].size < UMBR_SQUARE) {
            return umb_fail(error, UMB_E_UNSUPPORTED, "frustum %u: less than %d voxels a side",
                            square->frustum, UMBR_SQUARE);
        }
    }
    return UMB_OK;
}

/* Verifies squares with the job opened and the lock made. */
static enum umb_status run_squares(struct squares_crew *crew, uint32_t light, size_t count,
                                   struct umb_error *error)
{
    const unsigned threads = crew->job.options->threads;
    UMB__TRY(check_squares(crew, count, error));
    UMB__TRY(umb_volume_prepare(crew->job.asset, light, &crew->volume, error));
    return umbu_range_run(threads > 0 ? threads : umbu_processor_count(), count, 1, compare_square,
                          crew, error);
}

enum umb_status umbr_verify_squares(const struct umb_asset *asset, uint32_t light,
                                    const struct umbr_rays *rays,
                                    const struct umbr_verify_options *options,
                                    const struct umbr_square *squares, size_t count,
                                    struct umbr_squares_result *result, struct umb_error *error)
{
    struct squares_crew crew = {.job = {.asset = asset, .rays = rays, .options = options},
                                .squares = squares};
    *result = (struct umbr_squares_result){.gave_up = 0};
    atomic_init(&crew.judged, 0);
    atomic_init(&crew.ended, 0);
    enum umb_status status = umbr_verify_job_open(&crew.job, light, &crew.exact, error);
    if (status == UMB_OK && pthread_mutex_init(&crew.lock, NULL) != 0) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "no memory for a mutex");
    } else if (status == UMB_OK) {
        status = run_squares(&crew, light, count, error);
        (void)pthread_mutex_destroy(&crew.lock);
    }
    if (status == UMB_OK) {
        result->found = crew.total;
        result->gave_up = atomic_load(&crew.ended) && crew.total.outside_band == 0;
    }
    umbr_verify_job_close(&crew.job);
    return status;
}
