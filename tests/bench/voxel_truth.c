/* SPDX-License-Identifier: Apache-2.0 */
/* Wrong voxels; see voxel_truth.h. */
#include "voxel_truth.h"

#include <stdlib.h>
#include <string.h>
#include "bench_report.h"
#include "oracle_depth.h"
#include "umbrage/query.h"

#define METRE     1000.0 /* of the mesh's units */
#define NEAR      8
#define PER_TEXEL (4U * NEAR)
#define STEP      5U /* of a row's texels: more rows for the same work */
#define SEED      11U

/* The samples of one row, for one asset. */
struct samples {
    int closed_rule;
    struct umb_query query;
    struct voxel_truth_result result;
    double *points; /* [3 * capacity], world minus origin */
    uint8_t *truth, *answers;
    size_t count;
};

static void scene_copy(const struct gen_mesh *mesh, struct oracle_scene *scene)
{
    *scene = (struct oracle_scene){.vertex_count = mesh->vertex_count,
                                   .triangle_count = mesh->triangle_count};
    scene->vertices = calloc(mesh->vertex_count, sizeof *scene->vertices);
    scene->triangles = calloc(mesh->triangle_count, sizeof *scene->triangles);
    scene->closed = calloc(mesh->triangle_count, 1);
    if (scene->vertices == NULL || scene->triangles == NULL || scene->closed == NULL) {
        bench_fail("oracle: out of memory");
    }
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++) {
        scene->vertices[i / 3][i % 3] = mesh->vertices[i / 3][i % 3] / METRE;
    }
    memcpy(scene->triangles, mesh->triangles, mesh->triangle_count * sizeof *scene->triangles);
    if (!oracle_scene_find_closed(scene)) {
        bench_fail("oracle: out of memory");
    }
}

/* Position, world minus origin, of a voxel's centre. The corner of voxel (0, 0, 0) is at minus the
 * transform's translation, and the frustum's axes start there. */
static void centre_world(const struct bench_scene *scene, const int32_t voxel[3], double point[3])
{
    const struct umb_frustum_info *frustum = &scene->frustum;
    memset(point, 0, 3 * sizeof *point);
    for (int axis = 0; axis < 3; axis++) {
        const double along = (double)voxel[axis] + 0.5 - frustum->world_to_voxel[axis][3];
        for (int k = 0; k < 3; k++) {
            point[k] += along * frustum->voxel_step[axis][k];
        }
    }
}

static void sample_add(const struct bench_scene *scene, struct samples *samples,
                       const struct oracle_texel *texel, const int32_t voxel[3])
{
    const int32_t size = (int32_t)1 << scene->frustum.log2_size;
    const int64_t z = voxel[2];
    const int64_t end = samples->closed_rule ? texel->end : texel->lit;
    if (z < 0 || z >= size || (z >= (int64_t)texel->lit && z < end)) {
        return;
    }
    centre_world(scene, voxel, samples->points + 3 * samples->count);
    samples->truth[samples->count++] = z < (int64_t)texel->lit ? 255 : 0;
}

static void texel_sample(const struct bench_scene *scene, const struct oracle_texel *texel,
                         int32_t x, int32_t y, struct samples *samples)
{
    const int32_t lit = (int32_t)texel->lit;
    const int32_t end = samples->closed_rule ? (int32_t)texel->end : lit;
    for (int32_t z = lit - NEAR; z < end + NEAR; z++) {
        if (z == lit + NEAR && end - NEAR > z) {
            z = end - NEAR; /* what lies far from both */
        }
        const int32_t voxel[3] = {x, y, z};
        sample_add(scene, samples, texel, voxel);
    }
}

static void samples_ask(const struct bench_scene *scene, struct samples *samples)
{
    struct umb_points points = {
        .positions = samples->points, .format = UMB_POINT_F64, .count = samples->count};
    struct umb_answers answers = {.values = samples->answers};
    memcpy(points.origin, scene->origin, sizeof points.origin);
    umb_query_run(&samples->query, &points, 0, points.count, &answers);
    for (size_t i = 0; i < samples->count; i++) {
        samples->result.wrong += samples->answers[i] != samples->truth[i];
    }
    samples->result.samples += samples->count;
    samples->count = 0;
}

static void samples_init(struct samples *samples, const struct bench_asset *asset, int closed_rule,
                         size_t side)
{
    const size_t capacity = PER_TEXEL * (side / STEP + 1);
    const struct umb_query_settings settings = {
        .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    struct umb_error error;
    *samples = (struct samples){.closed_rule = closed_rule,
                                .points = calloc(capacity, 3 * sizeof(double)),
                                .truth = calloc(capacity, 1),
                                .answers = calloc(capacity, 1)};
    if (samples->points == NULL || samples->truth == NULL || samples->answers == NULL) {
        bench_fail("voxel samples: out of memory");
    }
    bench_must(umb_query_prepare(asset->asset, &settings, &samples->query, &error), &error,
               "query");
}

static void samples_finish(struct samples *samples)
{
    free(samples->points);
    free(samples->truth);
    free(samples->answers);
}

/* Compares one row of texels, for the assets from number `first` on. */
static void row_compare(const struct bench_scene *scene, const struct oracle_texel *row, uint32_t y,
                        struct samples samples[2], int first)
{
    const uint32_t side = 1U << scene->frustum.log2_size;
    for (int rule = first; rule < 2; rule++) {
        for (uint32_t x = 0; x < side; x += STEP) {
            samples[rule].result.ties += (uint64_t)(row[x].tie != 0);
            if (!row[x].tie && row[x].lit < side) {
                texel_sample(scene, &row[x], (int32_t)x, (int32_t)y, &samples[rule]);
            }
        }
        samples_ask(scene, &samples[rule]);
    }
}

void voxel_truth_compare(const struct bench_scene *scene, const struct bench_asset assets[2],
                         uint64_t samples_wanted, struct voxel_truth_result results[2])
{
    struct oracle_scene oracle_scene;
    struct oracle_depth depth;
    struct samples samples[2];
    double m[16] = {0};
    struct gen_rng rng = {SEED};
    const uint32_t side = 1U << scene->frustum.log2_size;
    memcpy(m, scene->frustum.world_to_voxel, sizeof m);
    const struct oracle_view view = {.m = m, .origin = scene->origin, .side = side, .closed = 1};
    struct oracle_texel *row = calloc(side, sizeof *row);
    scene_copy(&scene->mesh, &oracle_scene);
    if (row == NULL || !oracle_depth_init(&depth, &oracle_scene, &view)) {
        bench_fail("oracle: out of memory");
    }
    const int first = assets[0].asset == NULL ? 1 : 0; /* the open one may be missing */
    for (int rule = first; rule < 2; rule++) {
        samples_init(&samples[rule], &assets[rule], rule, side);
    }
    while (samples[first].result.samples < samples_wanted ||
           samples[1].result.samples < samples_wanted) {
        const uint32_t y = (uint32_t)gen_range(&rng, 0, (int32_t)side - 1);
        oracle_depth_row(&depth, y, STEP, row);
        row_compare(scene, row, y, samples, first);
    }
    for (int rule = first; rule < 2; rule++) {
        results[rule] = samples[rule].result;
        bench_say("%s %s: %llu voxels compared, %llu wrong, %llu texels left out as ties",
                  scene->name, rule ? "closed" : "open", (unsigned long long)results[rule].samples,
                  (unsigned long long)results[rule].wrong, (unsigned long long)results[rule].ties);
        samples_finish(&samples[rule]);
    }
    free(row);
    oracle_depth_finish(&depth);
    oracle_scene_finish(&oracle_scene);
}
