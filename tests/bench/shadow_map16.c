/* SPDX-License-Identifier: Apache-2.0 */
/* Making and tuning the 16-bit shadow map; its queries are in shadow_map16_avx2.c. */
#include "shadow_map16.h"

#include <stdlib.h>
#include <string.h>
#include "bench_machine.h"
#include "bench_report.h"

#define TUNE_POINTS 65536U

/* Copies an 8x8 block of texels to both layouts. */
static void block_take(const int32_t *lit, size_t mx, size_t my, struct shadow_map *map)
{
    const size_t across = (size_t)map->side >> 3;
    for (size_t row = 0; row < 8; row++) {
        uint16_t texels[8];
        for (size_t k = 0; k < 8; k++) {
            texels[k] = (uint16_t)lit[8 * row + k];
        }
        const size_t y = my + row;
        memcpy(map->rows + y * (size_t)map->side + mx, texels, sizeof texels);
        memcpy(map->tiles + ((y >> 2) * across + (mx >> 3)) * 32 + (y & 3) * 8, texels,
               sizeof texels);
    }
}

static void tile_take(void *user, const struct umbb_tile *tile)
{
    struct shadow_map *map = user;
    const size_t across = (size_t)tile->size >> 3;
    for (size_t block = 0; block < across * across; block++) {
        if (tile->min_end[3][block] < map->size) { /* else background, as the map began */
            block_take(tile->lit + 64 * block,
                       (size_t)tile->x0 + 8 * (block % across) + SHADOW_MAP_PAD,
                       (size_t)tile->y0 + 8 * (block / across) + SHADOW_MAP_PAD, map);
        }
    }
}

void shadow_map_make(struct shadow_map *map, const struct bench_scene *scene)
{
    memset(map, 0, sizeof *map);
    map->size = (int32_t)1 << scene->frustum.log2_size;
    if (map->size > INT16_MAX) {
        bench_fail("a 16-bit shadow map holds at most 16384 voxels a side, not %d", map->size);
    }
    map->side = map->size + 2 * SHADOW_MAP_PAD;
    const size_t texels = (size_t)map->side * (size_t)map->side;
    map->rows = bench_large(texels * sizeof *map->rows);
    map->tiles = bench_large(texels * sizeof *map->tiles);
    for (size_t i = 0; i < texels; i++) {
        map->rows[i] = (uint16_t)map->size;
        map->tiles[i] = (uint16_t)map->size;
    }
    for (int k = 0; k < 3; k++) {
        memcpy(map->m[k], scene->frustum.world_to_voxel[k], sizeof map->m[k]);
    }
    bench_tiles(scene, 0, tile_take, map);
    bench_say("%s: shadow map of %zu MiB", scene->name, texels * sizeof *map->rows >> 20);
}

void shadow_map_finish(struct shadow_map *map)
{
    free(map->rows);
    free(map->tiles);
    memset(map, 0, sizeof *map);
}

double shadow_map_tune(struct shadow_map_query *query, enum shadow_map_way way)
{
    static const unsigned distances[] = {2, 4, 8, 16, 32, 64};
    struct shadow_map_query part = *query;
    double best_s = 1e30;
    part.way = way;
    part.count = query->count < TUNE_POINTS ? query->count : TUNE_POINTS;
    part.points = query->points + 3 * ((query->count - part.count) / 2); /* mid-picture */
    for (size_t d = 0; d < sizeof distances / sizeof distances[0]; d++) {
        part.ahead = distances[d];
        for (int again = 0; again < 2; again++) {
            const double start = bench_cpu_s();
            shadow_map_run(&part);
            const double seconds = bench_cpu_s() - start;
            if (seconds < best_s) {
                best_s = seconds;
                query->ahead = part.ahead;
            }
        }
    }
    query->way = way;
    return best_s / (double)part.count;
}
