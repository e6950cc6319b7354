/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From counts to nanoseconds, on this machine. A setting's cost is nearly a line in what it reads:
 * points anywhere give one end of it (mostly large uniform cells), points where the light first
 * meets a caster the other. The curve's own counts, taken on surfaces, lie between or close by.
 */
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "format/asset_parts.h"
#include "query/query_parts.h"
#include "query/voxel_tree.h"
#include "umbrage/curve.h"

enum {
    POINTS = 4096,    /* of each kind: more than the nearest cache keeps warm */
    RUNS = 5,         /* of each row, interleaved; the fastest counts */
    COLUMN_STEPS = 64 /* cubes looked at along a ray before another ray is tried */
};

/* Points of one kind, world space relative to the asset's origin. */
struct sample {
    double (*positions)[3];
    double lines[UMB_CURVE_ROWS_MAX]; /* read a point, as the kernels count */
    double seconds[UMB_CURVE_ROWS_MAX];
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

/* Depth in voxels where a texel's ray first leaves the light; -1 if it is lit for COLUMN_STEPS. */
static double first_shadow(const struct job *job, uint32_t x, uint32_t y)
{
    const struct umb__top *top = &job->asset->view.tops[job->first_frustum];
    const struct umb__tree tree = {.grid = job->asset->view.grid + top->first_cell,
                                   .nodes = job->asset->view.nodes,
                                   .bricks = job->asset->view.bricks,
                                   .log2_size = job->frustum->log2_size,
                                   .grid_log2 = top->grid_log2};
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
        double voxel[3] = {unit(&state) * size, unit(&state) * size, unit(&state) * size};
        to_world(job->frustum, voxel, job->easy.positions[i]);
        double depth = -1;
        for (int tries = 0; tries < 8 && depth < 0; tries++) {
            voxel[0] = unit(&state) * size;
            voxel[1] = unit(&state) * size;
            depth = first_shadow(job, (uint32_t)voxel[0], (uint32_t)voxel[1]);
        }
        voxel[2] = depth >= 0 ? depth : voxel[2];
        to_world(job->frustum, voxel, job->hard.positions[i]);
    }
}

/* Runs a row on a sample; keeps the fastest. */
static enum umb_status time_row(struct job *job, size_t row, struct sample *sample,
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
    umb_query_run(&query, &points, 0, POINTS, &answers);
    sample->seconds[row] = fmin(sample->seconds[row], job->now_s() - start);
    sample->lines[row] = (double)(answers.stats.nodes + answers.stats.bricks) / POINTS;
    return status;
}

/* Nanoseconds of a row at the curve's counts. */
static double row_ns(const struct job *job, size_t row)
{
    const double scale = 1e9 / POINTS;
    const double easy = job->easy.seconds[row] * scale, hard = job->hard.seconds[row] * scale;
    const double span = job->hard.lines[row] - job->easy.lines[row];
    if (!(span > 0.05) || !(hard > easy)) {
        return fmax(easy, hard);
    }
    const double ns = easy + (hard - easy) / span * (job->rows[row].lines - job->easy.lines[row]);
    return fmax(ns, easy / 2);
}

/* Fills in the costs; one that reads more never costs less. */
static void conclude(const struct job *job, struct umb_calibration *calibration)
{
    calibration->count = job->count;
    for (size_t i = 0; i < job->count; i++) {
        double ns = 0;
        for (size_t k = 0; k < job->count; k++) {
            if (job->rows[k].lines <= job->rows[i].lines) {
                ns = fmax(ns, row_ns(job, k));
            }
        }
        calibration->ns[i] = ns;
    }
}

static enum umb_status time_rows(struct job *job, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (size_t row = 0; row < job->count; row++) {
        job->easy.seconds[row] = job->hard.seconds[row] = INFINITY;
    }
    for (int run = 0; run < RUNS; run++) {
        for (size_t row = 0; row < job->count && status == UMB_OK; row++) {
            status = time_row(job, row, &job->easy, error);
            if (status == UMB_OK) {
                status = time_row(job, row, &job->hard, error);
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
