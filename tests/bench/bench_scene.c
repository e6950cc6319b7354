/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes and their bakes; see bench_scene.h. */
#include "bench_scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "bake/analysis/light_frame.h"
#include "tool/threads.h"
#include "bake_frustum.h"
#include "bake/depth/depth.h"
#include "bench_report.h"
#include "common/sha256.h"
#include "format/content.h"

#define SUN_AZIMUTH   27.0
#define SUN_ELEVATION 45.0
#define TERRAIN_SIZE  1024
#define CITY_SIZE     59
#define SEED          1U
#define METRE         1000.0 /* of the mesh's units */

static void corners_make(struct bench_scene *scene)
{
    const struct gen_mesh *mesh = &scene->mesh;
    struct umbt_scene *study = &scene->study;
    study->count = mesh->triangle_count;
    study->corners = calloc(study->count, sizeof *study->corners);
    scene->voxels = calloc(study->count, sizeof *scene->voxels);
    scene->kinds = calloc(study->count, sizeof *scene->kinds);
    if (study->corners == NULL || scene->voxels == NULL || scene->kinds == NULL) {
        bench_fail("%s: out of memory", scene->name);
    }
    for (size_t k = 0; k < 3; k++) {
        study->box.min[k] = INFINITY;
        study->box.max[k] = -INFINITY;
    }
    for (size_t i = 0; i < 9 * study->count; i++) {
        const size_t triangle = i / 9, corner = i / 3 % 3, k = i % 3;
        const double value = mesh->vertices[mesh->triangles[triangle][corner]][k] / METRE;
        study->corners[triangle][corner][k] = value;
        study->box.min[k] = fmin(study->box.min[k], value);
        study->box.max[k] = fmax(study->box.max[k], value);
    }
    study->diagonal_m = 0.0;
    for (size_t k = 0; k < 3; k++) {
        study->diagonal_m = hypot(study->diagonal_m, study->box.max[k] - study->box.min[k]);
        scene->origin[k] = rint(0.5 * study->box.min[k] + 0.5 * study->box.max[k]);
    }
}

static void kinds_make(struct bench_scene *scene)
{
    struct umbt_scene *study = &scene->study;
    struct umb_error error;
    bench_must(
        umbs_parts_find((const double(*)[3][3])study->corners, study->count, &study->parts, &error),
        &error, "parts");
    for (size_t i = 0; i < study->count; i++) {
        const uint32_t part = study->parts.part_of[i];
        if (part >= study->parts.part_count || study->parts.parts[part].flipped) {
            bench_fail("%s: triangle %zu is degenerate or inside out", scene->name, i);
        }
        scene->kinds[i] = study->parts.parts[part].closed ? UMBB_CASTER_CLOSED : UMBB_CASTER_OPEN;
    }
}

void bench_scene_make(struct bench_scene *scene, const char *name, uint32_t log2_size,
                      const char *assets)
{
    struct umb_error error;
    memset(scene, 0, sizeof *scene);
    scene->name = name;
    scene->assets = assets;
    scene->study.path = name;
    if (strcmp(name, "terrain") == 0) {
        gen_terrain(&scene->mesh, TERRAIN_SIZE, SEED);
    } else {
        gen_city(&scene->mesh, CITY_SIZE, SEED);
    }
    if (scene->mesh.failed || scene->mesh.triangle_count == 0) {
        bench_fail("%s: no mesh", name);
    }
    corners_make(scene);
    kinds_make(scene);
    scene->light = (struct umb_light_info){.kind = UMB_LIGHT_DIRECTIONAL, .frustum_count = 1};
    umbb_sun_direction(SUN_AZIMUTH, SUN_ELEVATION, 1, scene->light.direction);
    const struct umbb_fit fit = {(const double(*)[3][3])scene->study.corners, scene->study.count,
                                 scene->origin, log2_size, 1};
    bench_must(umbb_light_frame_fit(&fit, scene->light.direction, &scene->frustum, &error), &error,
               "light frame");
    memcpy(scene->voxels, scene->study.corners, scene->study.count * sizeof *scene->voxels);
    umbb_light_frame_apply(&scene->frustum, scene->origin, scene->voxels, scene->study.count);
    bench_say("%s: %zu triangles, %zu of them closed", name, scene->study.count,
              scene->study.parts.closed_triangles);
}

void bench_scene_trace(struct bench_scene *scene)
{
    struct umb_error error;
    bench_must(umbr_rays_build((const double(*)[3][3])scene->study.corners, scene->study.count,
                               NULL, &scene->study.rays, &error),
               &error, "rays");
}

void bench_scene_finish(struct bench_scene *scene)
{
    gen_mesh_finish(&scene->mesh);
    umbt_scene_finish(&scene->study);
    free(scene->kinds);
    free(scene->voxels);
    memset(scene, 0, sizeof *scene);
}

struct umbb_casters bench_casters(const struct bench_scene *scene, int closed_rule)
{
    return (struct umbb_casters){
        .corners = (const double(*)[3][3])scene->voxels,
        .kinds = scene->kinds,
        .count = scene->study.count,
        .size = (int32_t)1 << scene->frustum.log2_size,
        .closed_rule = closed_rule,
    };
}

/* A growing string of bytes. */
struct bytes {
    uint8_t *data;
    size_t size, capacity;
};

static enum umb_status bytes_append(void *user, const void *data, size_t count)
{
    struct bytes *bytes = user;
    if (bytes->capacity - bytes->size < count) {
        const size_t capacity = 2 * bytes->capacity + count;
        uint8_t *grown = realloc(bytes->data, capacity);
        if (grown == NULL) {
            return UMB_E_NO_MEMORY;
        }
        bytes->data = grown;
        bytes->capacity = capacity;
    }
    memcpy(bytes->data + bytes->size, data, count);
    bytes->size += count;
    return UMB_OK;
}

static enum umb_status bytes_count(void *user, const void *data, size_t count)
{
    (void)data;
    *(uint64_t *)user += count;
    return UMB_OK;
}

static void octree_bake(const struct bench_scene *scene, int closed_rule,
                        struct umb__octree *octree)
{
    const struct umbb_casters casters = bench_casters(scene, closed_rule);
    const unsigned threads = umbu_processor_count();
    const uint32_t size_log2 = scene->frustum.log2_size;
    const uint32_t tile_log2 = size_log2 < BENCH_TILE_LOG2 ? size_log2 : BENCH_TILE_LOG2;
    const struct umbb_depth_options depth_options = {.tile_log2 = tile_log2, .threads = threads};
    const struct umbb_bake_options options = {
        .log2_size = scene->frustum.log2_size,
        .tile_log2 = tile_log2,
        .threads = threads,
        .closed_rule = closed_rule,
        .octree_max_bytes = SIZE_MAX,
    };
    struct umbb_depth depth;
    struct umb_error error;
    bench_must(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), &error, "depth");
    bench_must(bake_frustum(&depth, &options, octree, NULL, &error), &error, "bake");
    depth.destroy(depth.state);
}

/* Bakes a scene into packed bytes. */
static void packed_bake(const struct bench_scene *scene, int closed_rule, struct bytes *bytes)
{
    struct umb__octree octree;
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    char nothing[] = "";
    struct umb_light_info light = scene->light;
    struct umb_frustum_info frustum = scene->frustum;
    const double start = bench_wall_s();
    octree_bake(scene, closed_rule, &octree);
    const double baked = bench_wall_s();
    frustum.closed = closed_rule;
    struct umb__content content = {
        .light_count = 1,
        .frustum_count = 1,
        .lights = &light,
        .frusta = &frustum,
        .bounds = scene->study.box,
        .plan = nothing,
        .settings = nothing,
        .notes = nothing,
    };
    memcpy(content.origin, scene->origin, sizeof content.origin);
    const struct umb_sink sink = {bytes_append, bytes};
    struct umbu_threads *jobs;
    bench_must(umbu_threads_create(umbu_processor_count(), &jobs, &error), &error, "threads");
    const struct umb_workers workers = umbu_threads_workers(jobs);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &umbs_sha256,
                                      .sink = &sink,
                                      .workers = &workers};
    bench_must(umb__pack_run(&job, id, &error), &error, "pack");
    umbu_threads_destroy(jobs);
    umb__octree_finish(&octree);
    bench_say("%s %s: baked in %.2f s, packed to %zu bytes in %.2f s", scene->name,
              closed_rule ? "closed" : "open", baked - start, bytes->size, bench_wall_s() - baked);
}

/* Reads or writes a kept bake; 0 if it is not there to read. */
static int packed_keep(const char *path, const char *mode, struct bytes *bytes)
{
    uint8_t buffer[65536];
    size_t count;
    FILE *file = fopen(path, mode);
    if (file == NULL) {
        return 0;
    }
    if (mode[0] == 'w') {
        count = fwrite(bytes->data, 1, bytes->size, file);
        if (fclose(file) != 0 || count != bytes->size) {
            bench_fail("cannot write %s", path);
        }
        return 1;
    }
    while ((count = fread(buffer, 1, sizeof buffer, file)) > 0) {
        if (bytes_append(bytes, buffer, count) != UMB_OK) {
            bench_fail("%s: out of memory", path);
        }
    }
    (void)fclose(file);
    return bytes->size > 0;
}

void bench_asset_make(const struct bench_scene *scene, int closed_rule, int measure_mapped,
                      struct bench_asset *asset)
{
    struct umb_error error;
    struct bytes bytes = {0};
    const char *path = scene->assets == NULL
                           ? NULL
                           : bench_text("%s/%s-%u-%s.umb", scene->assets, scene->name,
                                        scene->frustum.log2_size, closed_rule ? "closed" : "open");
    memset(asset, 0, sizeof *asset);
    if (path == NULL || !packed_keep(path, "rb", &bytes)) {
        packed_bake(scene, closed_rule, &bytes);
        if (path != NULL && !packed_keep(path, "wb", &bytes)) {
            bench_fail("cannot write %s", path);
        }
    }
    asset->packed = bytes.data;
    asset->packed_bytes = bytes.size;
    bench_must(umb_asset_open_bytes(bytes.data, bytes.size, NULL, &asset->asset, &error), &error,
               "open");
    if (measure_mapped) {
        const struct umb_sink counter = {bytes_count, &asset->mapped_bytes};
        bench_must(umb__mapped_write(asset->asset, &counter, &error), &error, "map");
    }
}

void bench_asset_finish(struct bench_asset *asset)
{
    umb_asset_close(asset->asset);
    free(asset->packed);
    memset(asset, 0, sizeof *asset);
}

void bench_tiles(const struct bench_scene *scene, int closed_rule, bench_tile_fn fn, void *user)
{
    const struct umbb_casters casters = bench_casters(scene, closed_rule);
    const uint32_t log2_size = scene->frustum.log2_size;
    const uint32_t tile_log2 = log2_size < BENCH_TILE_LOG2 ? log2_size : BENCH_TILE_LOG2;
    const struct umbb_depth_options options = {.tile_log2 = tile_log2, .threads = 1};
    struct umbb_depth depth;
    struct umbb_tile tile;
    struct umb_error error;
    bench_must(umbb_depth_raster_create(&casters, &options, &depth, &error), &error, "depth");
    bench_must(umbb_tile_init(&tile, tile_log2, closed_rule, &error), &error, "tile");
    for (int32_t y = 0; y < casters.size; y += tile.size) {
        for (int32_t x = 0; x < casters.size; x += tile.size) {
            tile.x0 = x;
            tile.y0 = y;
            bench_must(depth.begin(depth.state, 0, &tile, &error), &error, "tile");
            const int32_t blocks = tile.size / umbb_tile_block(&tile);
            for (int32_t b = 0; b < blocks * blocks; b++) {
                depth.block(depth.state, 0, 0, &tile, b % blocks, b / blocks);
            }
            umbb_tile_pyramid(&tile);
            fn(user, &tile);
        }
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
}

void bench_texel(const struct umbb_tile *tile, int32_t size, int32_t x, int32_t y, int32_t *lit,
                 int32_t *end)
{
    const size_t block = (size_t)(y >> 3) * (size_t)(tile->size >> 3) + (size_t)(x >> 3);
    if (tile->min_end[3][block] == size && tile->max_lit[3][block] == size) {
        /* The square may never have been written. If it was, min_end says that every `end` is
         * `size`. Then `lit` could be less only where a solid reaches the last voxel, which cannot
         * happen in a fitted box. */
        *lit = size;
        *end = size;
        return;
    }
    const size_t at = umbb_tile_index(tile, x, y);
    *lit = tile->lit[at];
    *end = tile->end[at];
}
