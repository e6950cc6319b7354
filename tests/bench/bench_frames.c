/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench-frames measures what shadows cost for each picture, if maps are made anew for each picture
 * (Sintorn et al. 2014, figures 8 and 10).
 *
 * Figure 8: four and eight cascades of 2048 x 2048 16-bit texels, culled and drawn by the product's
 * rasteriser, then one comparison of 2 x 2 texels a point; against windows of 9 and 17 taps of an
 * asset of 16384 voxels a side. Figure 10: maps of 2048 texels a side. A variance map is blurred
 * and asked; the asset of 2048 voxels and a 16-bit map are asked with a window as wide as the blur.
 *
 * One core, CPU time; all parties answer the same points of a picture of 1920 x 1080 pixels. A row
 * is the median over the runs of theirs over ours.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench_arguments.h"
#include "bench_machine.h"
#include "bench_map16.h"
#include "bench_points.h"
#include "bench_report.h"
#include "bench_scene.h"
#include "bake/depth/depth.h"
#include "study/study_math.h"
#include "umbrage/cascades.h"
#include "umbrage/query.h"
#include "vsm_peer.h"

#define BENCH      "frames"
#define LAYER_LOG2 11
#define LAYER_SIDE (1 << LAYER_LOG2)
#define TEXELS     ((size_t)LAYER_SIDE * LAYER_SIDE)
#define WEIGHT     0.5 /* of logarithmic against uniform splits */

/* Cascades of the picture's camera, and their texels. */
struct cascades {
    struct umb_cascade_plan plan;
    struct peer_place places[UMB_CASCADES_MAX];
    uint16_t *texels[UMB_CASCADES_MAX];
    /* Triangles of the scene that touch a layer, with room for all of them */
    double (*corners)[3][3];
    uint8_t *kinds;  /* of them; all open */
    uint8_t *slices; /* [points] */
    size_t drawn;    /* triangles of all layers */
};

struct frame {
    const struct bench_scene *scene;
    const struct bench_points *points;
    float *answers;
};

static void *array_make(size_t count, size_t bytes)
{
    void *array = calloc(count, bytes);
    if (array == NULL) {
        bench_fail("%zu elements: out of memory", count);
    }
    return array;
}

/* Computes a frustum's transform for points that are relative to the scene's origin. */
static struct peer_place place_of(const struct umb_map_frustum *frustum, const double origin[3])
{
    struct peer_place place;
    for (int row = 0; row < 3; row++) {
        const double *m = frustum->world_to_map[row];
        double shift = m[3];
        for (int k = 0; k < 3; k++) {
            place.m[row][k] = (float)m[k];
            shift += m[k] * (origin[k] - frustum->origin[k]);
        }
        place.m[row][3] = (float)shift;
    }
    return place;
}

static double view_depth(const struct frame *frame, size_t i)
{
    double p[3];
    for (int k = 0; k < 3; k++) {
        p[k] = (double)frame->points->surface[3 * i + (size_t)k] + frame->scene->origin[k];
    }
    return umbt_camera_depth(&frame->points->camera, p);
}

/* Plans the cascades between the nearest and the farthest point, and assigns the points to
 * cascades, as a pass over the picture's depths would. */
static void cascades_plan(const struct frame *frame, uint32_t count, struct cascades *c)
{
    struct umb_cascade_settings settings = {
        .count = count, .weight = WEIGHT, .fit = UMB_CASCADE_SCENE};
    struct umb_camera camera = umbt_camera_view(&frame->points->camera, INFINITY, 0.0);
    double to_light[3];
    struct umb_error error;
    for (size_t i = 0; i < frame->points->count; i++) {
        camera.near_m = fmin(camera.near_m, view_depth(frame, i));
        camera.far_m = fmax(camera.far_m, view_depth(frame, i));
    }
    for (int k = 0; k < 3; k++) {
        to_light[k] = -frame->scene->light.direction[k];
    }
    for (uint32_t i = 0; i < count; i++) {
        settings.resolution[i] = LAYER_SIDE;
    }
    bench_must(
        umb_cascades_plan(&camera, to_light, &frame->scene->study.box, &settings, &c->plan, &error),
        &error, "cascades");
    c->slices = array_make(frame->points->count, 1);
    for (size_t i = 0; i < frame->points->count; i++) {
        while (c->slices[i] + 1U < count &&
               view_depth(frame, i) >= c->plan.splits[c->slices[i] + 1]) {
            c->slices[i]++;
        }
    }
    for (uint32_t i = 0; i < count; i++) {
        c->places[i] = place_of(&c->plan.frusta[i], frame->scene->origin);
        c->texels[i] = array_make(TEXELS, sizeof *c->texels[i]);
    }
    c->corners = array_make(frame->scene->study.count, sizeof *c->corners);
    c->kinds = array_make(frame->scene->study.count, 1);
}

static void cascades_free(struct cascades *c)
{
    for (uint32_t i = 0; i < c->plan.count; i++) {
        free(c->texels[i]);
    }
    free(c->corners);
    free(c->kinds);
    free(c->slices);
}

/* Moves the triangles that touch a layer to its space; depth 0..1 is 0..LAYER_SIDE there. */
static size_t layer_cull(const struct bench_scene *scene, const struct umb_map_frustum *frustum,
                         double (*out)[3][3])
{
    size_t count = 0;
    for (size_t t = 0; t < scene->study.count; t++) {
        double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
        for (int corner = 0; corner < 3; corner++) {
            double p[3];
            umb__subtract(scene->study.corners[t][corner], frustum->origin, p);
            for (int k = 0; k < 3; k++) {
                out[count][corner][k] = umb__affine(frustum->world_to_map[k], p);
            }
            for (int k = 0; k < 2; k++) {
                low[k] = fmin(low[k], out[count][corner][k]);
                high[k] = fmax(high[k], out[count][corner][k]);
            }
            out[count][corner][2] *= LAYER_SIDE;
        }
        count += low[0] < LAYER_SIDE && low[1] < LAYER_SIDE && high[0] > 0.0 && high[1] > 0.0;
    }
    return count;
}

static void tile_store(const struct umbb_tile *tile, uint16_t *texels)
{
    for (int32_t y = 0; y < LAYER_SIDE; y++) {
        for (int32_t x = 0; x < LAYER_SIDE; x++) {
            int32_t lit, end;
            bench_texel(tile, LAYER_SIDE, x, y, &lit, &end);
            texels[(size_t)y * LAYER_SIDE + (size_t)x] =
                (uint16_t)((uint32_t)lit * 65535U / LAYER_SIDE);
        }
    }
}

/* Draws one layer with the rasteriser of bakes. Its depth has the layer's resolution. */
static void layer_draw(const struct bench_scene *scene, struct cascades *c, uint32_t layer)
{
    const struct umbb_depth_options options = {.tile_log2 = LAYER_LOG2, .threads = 1};
    struct umbb_casters casters = {
        .corners = (const double(*)[3][3])c->corners, .kinds = c->kinds, .size = LAYER_SIDE};
    struct umbb_depth depth;
    struct umbb_tile tile;
    struct umb_error error;
    casters.count = layer_cull(scene, &c->plan.frusta[layer], c->corners);
    c->drawn += casters.count;
    bench_must(umbb_depth_raster_create(&casters, &options, &depth, &error), &error, "depth");
    bench_must(umbb_tile_init(&tile, LAYER_LOG2, 0, &error), &error, "tile");
    tile.x0 = tile.y0 = 0;
    bench_must(depth.begin(depth.state, 0, &tile, &error), &error, "tile");
    const int32_t blocks = tile.size / umbb_tile_block(&tile);
    for (int32_t b = 0; b < blocks * blocks; b++) {
        depth.block(depth.state, 0, 0, &tile, b % blocks, b / blocks);
    }
    umbb_tile_pyramid(&tile);
    tile_store(&tile, c->texels[layer]);
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
}

static double cascades_draw(const struct frame *frame, struct cascades *c)
{
    const double start = bench_cpu_s();
    c->drawn = 0;
    for (uint32_t i = 0; i < c->plan.count; i++) {
        layer_draw(frame->scene, c, i);
    }
    return bench_cpu_s() - start;
}

static double cascades_ask(const struct frame *frame, const struct cascades *c)
{
    const double start = bench_cpu_s();
    for (size_t i = 0; i < frame->points->count; i++) {
        const uint32_t slice = c->slices[i];
        frame->answers[i] = depth16_ask(c->texels[slice], LAYER_SIDE, &c->places[slice],
                                        &frame->points->at[1][3 * i]);
    }
    return bench_cpu_s() - start;
}

static double ours_ask(const struct frame *frame, const struct umb_asset *asset, int t)
{
    const struct umb_query_settings settings = {
        .taps = (uint32_t)bench_taps[t], .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_F32};
    struct umb_points points = {
        .positions = frame->points->at[t], .format = UMB_POINT_F32, .count = frame->points->count};
    struct umb_answers answers = {.values = frame->answers};
    struct umb_query query;
    struct umb_error error;
    memcpy(points.origin, frame->scene->origin, sizeof points.origin);
    bench_must(umb_query_prepare(asset, &settings, &query, &error), &error, "query");
    const double start = bench_cpu_s();
    umb_query_run(&query, &points, 0, points.count, &answers);
    return bench_cpu_s() - start;
}

/* Returns the mean of the answers. Parties that draw the same scene must light about the same share
 * of it. */
static double lit_share(const struct frame *frame)
{
    double sum = 0.0;
    for (size_t i = 0; i < frame->points->count; i++) {
        sum += (double)frame->answers[i];
    }
    return sum / (double)frame->points->count;
}

static void cascades_race(const struct frame *frame, const struct umb_asset *asset, uint32_t count,
                          const char *name)
{
    struct cascades c = {0};
    struct bench_samples drawn = {0}, asked = {0}, ours[2] = {0}, ratios[2] = {0};
    cascades_plan(frame, count, &c);
    for (int run = 0; run < BENCH_RUNS; run++) {
        const double draw_s = cascades_draw(frame, &c), ask_s = cascades_ask(frame, &c);
        const double theirs_lit = lit_share(frame);
        bench_add(&drawn, draw_s);
        bench_add(&asked, ask_s);
        for (int t = 0; t < 2; t++) {
            const double seconds = ours_ask(frame, asset, t + 1);
            bench_add(&ours[t], seconds);
            bench_add(&ratios[t], (draw_s + ask_s) / seconds);
        }
        if (fabs(theirs_lit - lit_share(frame)) > 0.15) {
            bench_fail("%s: cascades light %.3f of the points, the asset %.3f", name, theirs_lit,
                       lit_share(frame));
        }
    }
    bench_say("%s, %u cascades: %zu triangles drawn, %.1f ms; asked %.1f ms; ours %.1f and %.1f ms",
              name, count, c.drawn, 1e3 * bench_median(&drawn), 1e3 * bench_median(&asked),
              1e3 * bench_median(&ours[0]), 1e3 * bench_median(&ours[1]));
    bench_row(BENCH, name, bench_text("csm%u_frame_vs_pcf9", count), "higher", &ratios[0]);
    bench_row(BENCH, name, bench_text("csm%u_frame_vs_pcf17", count), "higher", &ratios[1]);
    cascades_free(&c);
}

static void cascades_scene(const char *name, const char *assets)
{
    struct bench_scene scene;
    struct bench_points points;
    bench_scene_make(&scene, name, 14, assets);
    bench_scene_trace(&scene);
    bench_points_gbuffer(&scene, BENCH_VIEW_INSIDE, &points);
    const struct frame frame = {&scene, &points, array_make(points.count, sizeof(float))};
    for (int closed_rule = 1; closed_rule >= 0; closed_rule--) {
        struct bench_asset asset;
        bench_asset_make(&scene, closed_rule, 0, &asset);
        (void)bench_pin(0);
        const char *row = bench_text("%s-16k-%s-street", name, closed_rule ? "closed" : "open");
        cascades_race(&frame, asset.asset, 4, row);
        cascades_race(&frame, asset.asset, 8, row);
        (void)bench_pin(BENCH_PIN_ALL);
        bench_asset_finish(&asset);
    }
    free(frame.answers);
    bench_points_finish(&points);
    bench_scene_finish(&scene);
}

/* ---- figure 10 ---- */

static void vsm_take(void *user, const struct umbb_tile *tile)
{
    float *depth = user;
    for (int32_t y = 0; y < LAYER_SIDE; y++) {
        for (int32_t x = 0; x < LAYER_SIDE; x++) {
            int32_t lit, end;
            bench_texel(tile, LAYER_SIDE, x, y, &lit, &end);
            depth[(size_t)y * LAYER_SIDE + (size_t)x] = (float)lit / (float)LAYER_SIDE;
        }
    }
}

static struct vsm_peer vsm_make(const struct bench_scene *scene)
{
    struct vsm_peer vsm = {.side = LAYER_SIDE};
    vsm.depth = bench_large(TEXELS * sizeof *vsm.depth);
    for (int k = 0; k < 2; k++) {
        vsm.moments[k] = bench_large(TEXELS * sizeof *vsm.depth);
        vsm.rows[k] = bench_large(TEXELS * sizeof *vsm.depth);
    }
    bench_tiles(scene, 0, vsm_take, vsm.depth);
    return vsm;
}

static void vsm_free(struct vsm_peer *vsm)
{
    free(vsm->depth);
    for (int k = 0; k < 2; k++) {
        free(vsm->moments[k]);
        free(vsm->rows[k]);
    }
}

static void filters_race(const struct frame *frame, const struct umb_asset *asset,
                         struct vsm_peer *vsm, const struct umbt_map16 *map, int t,
                         const char *name)
{
    const int taps = bench_taps[t];
    struct peer_place place;
    struct bench_samples blurred = {0}, asked = {0}, ours = {0}, frames = {0}, still = {0},
                         maps = {0}, map_s = {0};
    struct umbt_map16_query rows = {.map = map,
                                    .points = frame->points->at[t],
                                    .count = frame->points->count,
                                    .taps = taps,
                                    .answers = frame->answers};
    for (int row = 0; row < 3; row++) {
        for (int k = 0; k < 4; k++) {
            place.m[row][k] = (float)(frame->scene->frustum.world_to_voxel[row][k] /
                                      (row == 2 ? (double)LAYER_SIDE : 1.0));
        }
    }
    (void)umbt_map16_tune(&rows, UMBT_MAP16_ROWS);
    for (int run = 0; run < BENCH_RUNS; run++) {
        double start = bench_cpu_s();
        vsm_peer_blur(vsm, taps);
        const double blur_s = bench_cpu_s() - start;
        start = bench_cpu_s();
        vsm_peer_ask(vsm, &place, frame->points->at[t], frame->points->count, frame->answers);
        const double ask_s = bench_cpu_s() - start, vsm_lit = lit_share(frame);
        start = bench_cpu_s();
        umbt_map16_run(&rows);
        const double rows_s = bench_cpu_s() - start;
        const double seconds = ours_ask(frame, asset, t);
        if (vsm_lit < lit_share(frame) - 0.01 || vsm_lit > lit_share(frame) + 0.2) {
            bench_fail("%s: the variance map lights %.3f, the asset %.3f", name, vsm_lit,
                       lit_share(frame)); /* it bounds from above */
        }
        bench_add(&blurred, blur_s);
        bench_add(&asked, ask_s);
        bench_add(&map_s, rows_s);
        bench_add(&ours, seconds);
        bench_add(&frames, (blur_s + ask_s) / seconds);
        bench_add(&still, ask_s / seconds);
        bench_add(&maps, rows_s / seconds);
    }
    bench_say("%s, %d taps: VSM blurred %.2f ms, asked %.2f; 16-bit map %.2f; ours %.2f ms", name,
              taps, 1e3 * bench_median(&blurred), 1e3 * bench_median(&asked),
              1e3 * bench_median(&map_s), 1e3 * bench_median(&ours));
    bench_row(BENCH, name, bench_text("vsm%d_blur_and_ask_vs_pcf%d", taps, taps), "higher",
              &frames);
    bench_row(BENCH, name, bench_text("vsm%d_ask_vs_pcf%d", taps, taps), "higher", &still);
    bench_row(BENCH, name, bench_text("sm16_pcf%d_vs_pcf%d", taps, taps), "higher", &maps);
}

static void filters_scene(const char *name, const char *assets)
{
    struct bench_scene scene;
    struct bench_points points;
    struct umbt_map16 map;
    struct bench_asset asset;
    bench_scene_make(&scene, name, LAYER_LOG2, assets);
    bench_scene_trace(&scene);
    bench_points_gbuffer(&scene, BENCH_VIEW_INSIDE, &points);
    bench_map16_make(&map, &scene);
    struct vsm_peer vsm = vsm_make(&scene);
    bench_asset_make(&scene, 0, 0, &asset);
    const struct frame frame = {&scene, &points, array_make(points.count, sizeof(float))};
    (void)bench_pin(0);
    for (int t = 1; t < 3; t++) {
        filters_race(&frame, asset.asset, &vsm, &map, t, bench_text("%s-2k-open-street", name));
    }
    (void)bench_pin(BENCH_PIN_ALL);
    free(frame.answers);
    bench_asset_finish(&asset);
    vsm_free(&vsm);
    umbt_map16_finish(&map);
    bench_points_finish(&points);
    bench_scene_finish(&scene);
}

static void usage_print(FILE *to)
{
    fputs("usage: bench_frames [--size quick|full] [--scene terrain|city] [--assets DIR]\n"
          "  --size    both are the same\n"
          "  --scene   this scene alone\n"
          "  --assets  read and keep bakes in this folder, which other benchmarks share\n",
          to);
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--size", "--scene", "--assets", NULL};
    static const char *const scenes[] = {"terrain", "city", NULL};
    bench_arguments(argc, argv, options, usage_print);
    const char *size = bench_size(argc, argv);
    const char *only = bench_choice(argc, argv, "--scene", scenes, NULL);
    const char *assets = bench_option(argc, argv, "--assets", NULL);
    if (!umbt_map16_supported()) {
        bench_say("skipped: the peers need AVX2");
        return 0;
    }
    for (size_t i = 0; scenes[i] != NULL; i++) {
        if (only == NULL || strcmp(only, scenes[i]) == 0) {
            filters_scene(scenes[i], assets);
            cascades_scene(scenes[i], assets);
        }
    }
    bench_table(BENCH, size);
    return 0;
}
