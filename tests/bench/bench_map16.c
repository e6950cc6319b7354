/* SPDX-License-Identifier: Apache-2.0 */
/* See bench_map16.h. */
#include "bench_map16.h"

#include "bench_report.h"

static void tile_take(void *user, const struct umbb_tile *tile)
{
    struct umbt_map16 *map = user;
    const uint32_t across = (uint32_t)tile->size >> 3;
    for (uint32_t block = 0; block < across * across; block++) {
        if (tile->min_end[3][block] < map->size) { /* else background, as the map began */
            umbt_map16_put(map, (uint32_t)tile->x0 + 8 * (block % across),
                           (uint32_t)tile->y0 + 8 * (block / across),
                           tile->lit + 64 * (size_t)block);
        }
    }
}

void bench_map16_make(struct umbt_map16 *map, const struct bench_scene *scene)
{
    struct umb_error error;
    if (scene->frustum.log2_size > 14) {
        bench_fail("a 16-bit shadow map holds at most 16384 voxels a side, not %u",
                   1U << scene->frustum.log2_size);
    }
    bench_must(
        umbt_map16_init(map, scene->frustum.log2_size, scene->frustum.world_to_voxel, &error),
        &error, "shadow map");
    bench_tiles(scene, 0, tile_take, map);
    bench_say("%s: shadow map of %zu MiB", scene->name,
              (size_t)umbt_map16_bytes(map) >> 21); /* of one layout */
}
