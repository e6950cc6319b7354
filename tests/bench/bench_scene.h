/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_SCENE_H
#define UMBRAGE_TESTS_BENCH_SCENE_H
/*
 * The scenes that the rows name, made in memory, and what a bake makes of them:
 *
 *   terrain  closed fractal land, 2.1 million triangles (scenegen terrain --size 1024)
 *   city     closed city, 730 thousand triangles (scenegen city --size 59)
 *
 * lit by a sun at azimuth 27, elevation 45, light box fitted.
 */
#include "bake/depth/tile.h"
#include "gen.h"
#include "study/study_scene.h"

struct bench_scene {
    const char *name;
    const char *assets;      /* folder where bakes are kept from one program of a run to the next */
    struct gen_mesh mesh;    /* indexed; millimetres */
    struct umbt_scene study; /* corners, parts, box; rays after bench_scene_trace */
    uint8_t *kinds;          /* [study.count] enum umbb_caster */
    double (*voxels)[3][3];  /* [study.count] corners in voxel space */
    struct umb_light_info light;
    struct umb_frustum_info frustum; /* world_to_voxel, voxel_step, log2_size */
    double origin[3];
};

/* In: assets: folder for bakes, empty when the run begins; NULL: every program bakes anew. */
void bench_scene_make(struct bench_scene *scene, const char *name, uint32_t log2_size,
                      const char *assets);
void bench_scene_trace(struct bench_scene *scene); /* builds the rays */
void bench_scene_finish(struct bench_scene *scene);

/* The casters of a bake under a rule. */
struct umbb_casters bench_casters(const struct bench_scene *scene, int closed_rule);

/* An asset, baked (or read, see bench_scene_make), packed and opened in memory. */
struct bench_asset {
    struct umb_asset *asset;
    uint8_t *packed;
    size_t packed_bytes;
    uint64_t mapped_bytes; /* of its mapped form, if asked for */
};

void bench_asset_make(const struct bench_scene *scene, int closed_rule, int measure_mapped,
                      struct bench_asset *asset);
void bench_asset_finish(struct bench_asset *asset);

/* Calls fn for every tile of the map, row by row, with the tile's texels and pyramid filled in. */
typedef void (*bench_tile_fn)(void *user, const struct umbb_tile *tile);
#define BENCH_TILE_LOG2 12U
void bench_tiles(const struct bench_scene *scene, int closed_rule, bench_tile_fn fn, void *user);

/* Reads `lit` and `end` of a texel of such a tile. Texels of background squares are not read from
 * memory. */
void bench_texel(const struct umbb_tile *tile, int32_t size, int32_t x, int32_t y, int32_t *lit,
                 int32_t *end);

#endif
