/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From counts to nanoseconds, on this machine. Points of two kinds are asked with every setting:
 * easy ones anywhere in the frustum (mostly large uniform cells), hard ones where the light first
 * meets a caster. How hard the points of the curve are, which lie on surfaces, is told by the lines
 * that one tap reads there, counted alike for all three; every setting's cost goes as far from easy
 * to hard. Each timing asks other points, more altogether than a core's own caches hold, since
 * callers' points are spread over the whole asset, too.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "format/asset_parts.h"
#include "query/query_parts.h"
#include "query/voxel_tree.h"
#include "umbrage/curve.h"

enum {
    POINTS = 32768,    /* of each kind */
    SLICE = 4096,      /* of them, asked at a time */
    RUNS = 5,          /* of each row, interleaved; the median counts */
    COLUMN_STEPS = 64, /* cubes looked at along a ray before another ray is tried */
    HARDNESS_MAX = 2,  /* surfaces may be harder than what the light sees of them, but not much */
};

/* Points of one kind, world space relative to the asset's origin. */
struct sample {
    double (*positions)[3];
    double lines; /* that one tap reads, as the curve counts them */
    double seconds[UMB_CURVE_ROWS_MAX][RUNS];
    size_t next; /* slice to be asked */
};

struct job {
    const struct umb_asset *asset;
    const struct umb_frustum_info *frustum;
    uint32_t light, first_frustum;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count;
    struct sample easy, hard;
    float *answers;
    double (*now_s)(void);
};

static double unit(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return (double)((*state * UINT64_C(0x2545f4914f6cdd1d)) >> 11) * 0x1p-53;
}

static struct umb__tree tree_of(const struct job *job)
{
    const struct umb__top *top = &job->asset->view.tops[job->first_frustum];
    return (struct umb__tree){.grid = job->asset->view.grid + top->first_cell,
                              .nodes = job->asset->view.nodes,
                              .bricks = job->asset->view.bricks,
                              .log2_size = job->frustum->log2_size,
                              .grid_log2 = top->grid_log2};
}

/* Depth in voxels where a texel's ray first leaves the light; -1 if it is lit for COLUMN_STEPS. */
static double first_shadow(const struct job *job, uint32_t x, uint32_t y)
{
    const struct umb__tree tree = tree_of(job);
    const uint32_t size = 1U << job->frustum->log2_size;
    struct umb_volume_stats ignored = {0};
    uint32_t z = 0;
    for (int step = 0; step < COLUMN_STEPS && z < size; step++) {
        struct umb__place place = umb__tree_locate(&tree, x, y, z, &ignored);
        if (place.brick ? !umb__brick_voxel(place.brick, x, y, z) : !place.lit) {
            return (double)z;
        }
        z = place.brick ? z + 1 : ((z >> place.level) + 1) << place.level;
    }
    return -1;
}

/* Cache lines of a voxel's look-up as docs/umb-format.md counts them: the smallest uniform cube
 * around it tells which odd levels above are mixed. */
static double lines_at(const struct job *job, const double voxel[3])
{
    const struct umb__tree tree = tree_of(job);
    const uint32_t highest = umb_level_max(job->frustum->log2_size);
    struct umb_volume_stats ignored = {0};
    const struct umb__place place = umb__tree_locate(&tree, (uint32_t)voxel[0], (uint32_t)voxel[1],
                                                     (uint32_t)voxel[2], &ignored);
    const uint32_t lowest = place.brick ? UMB_LEVEL_BRICK : place.level + 2;
    return lowest > highest ? 1 : 2 + (highest - lowest) / 2;
}

/* World position of a place in voxel space, relative to the asset's origin. */
static void to_world(const struct umb_frustum_info *frustum, const double voxel[3], double p[3])
{
    const double(*m)[4] = frustum->world_to_voxel;
    const double(*step)[3] = frustum->voxel_step;
    double d[3], w = 1;
    if (umb__is_perspective(frustum)) {
        /* Depth gives W; then X - m03 and the like are linear again (content_check.c). */
        const double *axis = m[3];
        const double rate = m[2][0] * step[2][0] + m[2][1] * step[2][1] + m[2][2] * step[2][2];
        const double turn = axis[0] * step[2][0] + axis[1] * step[2][1] + axis[2] * step[2][2];
        w = axis[3] + (voxel[2] - m[2][3]) * turn / rate;
        d[2] = (w - axis[3]) / turn;
    } else {
        d[2] = voxel[2] - m[2][3];
    }
    d[0] = voxel[0] * w - m[0][3];
    d[1] = voxel[1] * w - m[1][3];
    for (unsigned k = 0; k < 3; k++) {
        p[k] = d[0] * step[0][k] + d[1] * step[1][k] + d[2] * step[2][k];
    }
}

static void draw_points(struct job *job)
{
    const double size = (double)(1U << job->frustum->log2_size);
    uint64_t state = 1;
    for (size_t i = 0; i < POINTS; i++) {
        double voxel[3];
        for (unsigned axis = 0; axis < 3; axis++) { /* one draw a statement: their order is fixed */
            voxel[axis] = unit(&state) * size;
        }
        job->easy.lines += lines_at(job, voxel) / POINTS;
        to_world(job->frustum, voxel, job->easy.positions[i]);
        double depth = -1;
        for (int tries = 0; tries < 8 && depth < 0; tries++) {
            voxel[0] = unit(&state) * size;
            voxel[1] = unit(&state) * size;
            depth = first_shadow(job, (uint32_t)voxel[0], (uint32_t)voxel[1]);
        }
        voxel[2] = depth >= 0 ? depth : voxel[2];
        job->hard.lines += lines_at(job, voxel) / POINTS;
        to_world(job->frustum, voxel, job->hard.positions[i]);
    }
}

/* Asks a slice of a sample with a row's settings. */
static enum umb_status time_row(struct job *job, size_t row, int run, struct sample *sample,
                                struct umb_error *error)
{
    struct umb_query query;
    struct umb_query_settings settings = {
        .light = job->light, .taps = job->rows[row].taps, .level = job->rows[row].level};
    struct umb_points points = {
        .positions = sample->positions, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_answers answers = {.values = job->answers};
    memcpy(points.origin, job->asset->canonical.content.origin, sizeof points.origin);
    enum umb_status status = umb_query_prepare(job->asset, &settings, &query, error);
    if (status != UMB_OK) {
        return status;
    }
    const double start = job->now_s();
    umb_query_run(&query, &points, sample->next, SLICE, &answers);
    sample->seconds[row][run] = job->now_s() - start;
    sample->next = (sample->next + SLICE) % POINTS;
    return status;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median_ns(double seconds[RUNS])
{
    qsort(seconds, RUNS, sizeof *seconds, by_size);
    return seconds[RUNS / 2] * 1e9 / SLICE;
}

/* How far the curve's points are from easy (0) to hard (1). */
static double hardness(const struct job *job)
{
    const double span = job->hard.lines - job->easy.lines;
    size_t plain = 0;
    while (plain + 1 < job->count && (job->rows[plain].level > 0 || job->rows[plain].taps > 1)) {
        plain++;
    }
    const double from_easy = job->rows[plain].lines - job->easy.lines;
    return span > 0.05 ? fmin(fmax(from_easy / span, 0), HARDNESS_MAX) : 1;
}

/* Fills in the costs; one that reads more never costs less. */
static void conclude(struct job *job, struct umb_calibration *calibration)
{
    const double far = hardness(job);
    double row_ns[UMB_CURVE_ROWS_MAX];
    for (size_t i = 0; i < job->count; i++) {
        const double easy = median_ns(job->easy.seconds[i]), hard = median_ns(job->hard.seconds[i]);
        row_ns[i] = hard > easy ? easy + far * (hard - easy) : easy;
    }
    calibration->count = job->count;
    for (size_t i = 0; i < job->count; i++) {
        double ns = 0;
        for (size_t k = 0; k < job->count; k++) {
            if (job->rows[k].lines <= job->rows[i].lines) {
                ns = fmax(ns, row_ns[k]);
            }
        }
        calibration->ns[i] = ns;
    }
}

static enum umb_status time_rows(struct job *job, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (int run = 0; run < RUNS; run++) {
        for (size_t row = 0; row < job->count && status == UMB_OK; row++) {
            status = time_row(job, row, run, &job->easy, error);
            if (status == UMB_OK) {
                status = time_row(job, row, run, &job->hard, error);
            }
        }
    }
    return status;
}

enum umb_status umb_calibrate(const struct umb_asset *asset, uint32_t light, double (*now_s)(void),
                              struct umb_calibration *calibration, struct umb_error *error)
{
    const struct umb_content *content = &asset->canonical.content;
    struct job job = {.asset = asset, .light = light, .now_s = now_s};
    memset(calibration, 0, sizeof *calibration);
    if (light >= content->light_count) {
        return umb_fail(error, UMB_E_NOT_FOUND, "light: %u, the asset has %u", light,
                        content->light_count);
    }
    job.count = umb_curve_get(asset, light, job.rows);
    if (job.count == 0) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "calibration: the asset carries no accuracy curve for light %u", light);
    }
    job.first_frustum = content->lights[light].first_frustum;
    job.frustum = &content->frusta[job.first_frustum];
    job.easy.positions = umb__alloc(asset->alloc, POINTS, sizeof *job.easy.positions);
    job.hard.positions = umb__alloc(asset->alloc, POINTS, sizeof *job.hard.positions);
    job.answers = umb__alloc(asset->alloc, POINTS, sizeof *job.answers);
    enum umb_status status;
    if (job.easy.positions && job.hard.positions && job.answers) {
        draw_points(&job);
        status = time_rows(&job, error);
    } else {
        status =
            umb_fail(error, UMB_E_NO_MEMORY, "calibration: memory for %d points refused", POINTS);
    }
    if (status == UMB_OK) {
        conclude(&job, calibration);
    }
    umb__free(asset->alloc, job.easy.positions);
    umb__free(asset->alloc, job.hard.positions);
    umb__free(asset->alloc, job.answers);
    return status;
}
