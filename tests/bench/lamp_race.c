/* SPDX-License-Identifier: Apache-2.0 */
/* Lights against suns; see lamp_race.h. */
#include "lamp_race.h"

#include <stdlib.h>
#include <string.h>

#include "bake/analysis/frusta.h"
#include "bake/build/tile_loop.h"
#include "bake/depth/depth.h"
#include "base/page_alloc.h"
#include "bench_machine.h"
#include "bench_report.h"

#define BENCH     "bake"
#define TILE_LOG2 11U
#define RUNS      3

/* A street of bench_scene's city, metres. */
static const double street[3] = {-27.045, -0.019, 8.0};

/* The light's faces. */
struct lamp {
    struct umb_light_info light;
    struct umb_frustum_info *frusta;
    uint32_t count;
};

static void lamp_make(const struct bench_scene *scene, int closed_rule, struct lamp *lamp)
{
    double cone = 0.0;
    struct umb_error error;
    lamp->light = (struct umb_light_info){.kind = UMB_LIGHT_POINT};
    memcpy(lamp->light.position, street, sizeof street);
    struct umbb_light_choice choice = {.lights = &lamp->light, .cones = &cone, .count = 1};
    const struct umbb_frusta_input input = {
        .fit = {(const double(*)[3][3])scene->study.corners, scene->study.count, scene->origin,
                scene->frustum.log2_size},
        .bounds = scene->study.box,
        .closed = closed_rule,
    };
    bench_must(umbb_frusta_fit(&input, &choice, &lamp->frusta, &lamp->count, &error), &error,
               "faces");
}

/* Memory that the frusta of a light share. */
struct memory {
    struct umb__pool pool;
    struct umbb_tile tiles[2];
};

/* Bakes casters into a pool. */
static void casters_bake(const struct umbb_casters *casters, uint32_t log2_size,
                         struct memory *memory, uint32_t *root)
{
    const struct umbb_depth_options depth_options = {.tile_log2 = TILE_LOG2, .threads = 1};
    const struct umbb_bake_options options = {
        .log2_size = log2_size,
        .tile_log2 = TILE_LOG2,
        .threads = 1,
        .closed_rule = casters->closed_rule,
        .octree_max_bytes = SIZE_MAX,
        .tiles = memory->tiles,
    };
    struct umbb_depth depth;
    struct umb_error error;
    bench_must(umbb_depth_raster_create(casters, &depth_options, &depth, &error), &error, "depth");
    bench_must(umbb_bake_into(&depth, &options, &memory->pool, root, NULL, &error), &error, "bake");
    depth.destroy(depth.state);
}

static void face_bake(const struct bench_scene *scene, const struct umbb_casters *world,
                      const struct umb_frustum_info *face, struct memory *memory, uint32_t *root)
{
    struct umbb_projected projected;
    struct umb_error error;
    const struct umbb_eye_view view = {
        .frustum = face,
        .origin = scene->origin,
        .reach = umbb_light_reach(&scene->study.box, street),
        .max_bytes = SIZE_MAX,
    };
    bench_must(umbb_perspective_project(world, &view, &projected, &error), &error, "projection");
    struct umbb_casters casters = *world;
    casters.corners = (const double(*)[3][3])projected.corners;
    casters.kinds = projected.kinds;
    casters.count = projected.count;
    casters.depth_scale = projected.depth_scale;
    casters.depth_offset = projected.depth_offset;
    casters_bake(&casters, face->log2_size, memory, root);
    umbb_projected_finish(&projected);
}

/* CPU seconds of a bake: of the light, or of the sun if `lamp` is NULL. */
static double bake_seconds(const struct bench_scene *scene, int closed_rule,
                           const struct lamp *lamp)
{
    struct umbb_casters casters = bench_casters(scene, closed_rule);
    struct memory memory = {0};
    struct umb__octree octree;
    struct umb_error error;
    uint32_t roots[6] = {UMB__REF_LIT}, levels[6];
    const uint32_t count = lamp == NULL ? 1 : lamp->count;
    const double start = bench_cpu_s();
    umb__pool_init(&memory.pool, &umb__page_alloc, SIZE_MAX);
    for (uint32_t i = 0; i < count; i++) {
        levels[i] = scene->frustum.log2_size;
        if (lamp == NULL) {
            casters_bake(&casters, levels[i], &memory, &roots[i]);
        } else {
            casters.corners = (const double(*)[3][3])scene->study.corners;
            face_bake(scene, &casters, &lamp->frusta[i], &memory, &roots[i]);
        }
    }
    memset(&octree, 0, sizeof octree);
    umbb_tile_finish(&memory.tiles[0]);
    umbb_tile_finish(&memory.tiles[1]);
    bench_must(umb__pool_take(&memory.pool, roots, levels, count, &octree, &error), &error,
               "octree");
    umb__pool_finish(&memory.pool);
    const double seconds = bench_cpu_s() - start;
    umb__octree_finish(&octree);
    return seconds;
}

void lamp_race(const struct bench_scene *scene, int closed_rule, const char *name)
{
    struct bench_samples whole = {0}, face = {0};
    struct lamp lamp;
    lamp_make(scene, closed_rule, &lamp);
    (void)bench_pin(0);
    for (int i = 0; i < RUNS; i++) {
        const double sun = bake_seconds(scene, closed_rule, NULL);
        const double point = bake_seconds(scene, closed_rule, &lamp);
        bench_say("%s: sun %.2f s, point light with %u faces %.2f s", name, sun,
                  (unsigned)lamp.count, point);
        bench_add(&whole, point / sun);
        bench_add(&face, point / sun / lamp.count);
    }
    bench_row(BENCH, name, "point_vs_sun", "lower", &whole);
    bench_row(BENCH, name, "point_face_vs_sun", "lower", &face);
    (void)bench_pin(BENCH_PIN_ALL);
    free(lamp.frusta);
}
