/* SPDX-License-Identifier: Apache-2.0 */
/* Makes and tunes the 16-bit shadow map; its queries are in shadow_map16_avx2.c. */
#define _GNU_SOURCE /* madvise: no POSIX name for large pages */
#include "study/shadow_map16.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "tool/clock.h"

#define TUNE_POINTS 65536U
#define LARGE_PAGE  ((size_t)2 << 20)

static size_t texels_of(const struct umbt_map16 *map)
{
    return (size_t)map->side * (size_t)map->side;
}

/* Allocates lit texels, in large pages if the system has them. Returns NULL if out of memory. */
static uint16_t *layout_make(const struct umbt_map16 *map)
{
    void *memory = NULL;
    const size_t texels = texels_of(map);
    if (posix_memalign(&memory, LARGE_PAGE, texels * sizeof(uint16_t)) != 0) {
        return NULL;
    }
    (void)madvise(memory, texels * sizeof(uint16_t), MADV_HUGEPAGE); /* a hint */
    uint16_t *layout = memory;
    for (size_t i = 0; i < texels; i++) {
        layout[i] = (uint16_t)map->size;
    }
    return layout;
}

enum umb_status umbt_map16_init(struct umbt_map16 *map, uint32_t log2_size,
                                const double world_to_voxel[3][4], struct umb_error *error)
{
    memset(map, 0, sizeof *map);
    map->size = (int32_t)1 << log2_size;
    map->side = map->size + 2 * UMBT_MAP16_PAD;
    memcpy(map->m, world_to_voxel, sizeof map->m);
    map->rows = layout_make(map);
    map->tiles = layout_make(map);
    if (map->rows == NULL || map->tiles == NULL) {
        umbt_map16_finish(map);
        return umb_fail(error, UMB_E_NO_MEMORY, "a shadow map of %u texels a side does not fit",
                        1U << log2_size);
    }
    return UMB_OK;
}

void umbt_map16_put(struct umbt_map16 *map, uint32_t x, uint32_t y, const int32_t lit[64])
{
    const size_t across = (size_t)map->side >> 3, mx = (size_t)x + UMBT_MAP16_PAD;
    for (size_t row = 0; row < 8; row++) {
        uint16_t texels[8];
        for (size_t k = 0; k < 8; k++) {
            texels[k] = (uint16_t)lit[8 * row + k];
        }
        const size_t my = (size_t)y + UMBT_MAP16_PAD + row;
        memcpy(map->rows + my * (size_t)map->side + mx, texels, sizeof texels);
        memcpy(map->tiles + ((my >> 2) * across + (mx >> 3)) * 32 + (my & 3) * 8, texels,
               sizeof texels);
    }
}

void umbt_map16_drop(struct umbt_map16 *map, int tiles)
{
    uint16_t **layout = tiles ? &map->tiles : &map->rows;
    free(*layout);
    *layout = NULL;
}

uint64_t umbt_map16_bytes(const struct umbt_map16 *map)
{
    const uint64_t layouts = (map->rows != NULL ? 1U : 0U) + (map->tiles != NULL ? 1U : 0U);
    return layouts * texels_of(map) * sizeof(uint16_t);
}

void umbt_map16_finish(struct umbt_map16 *map)
{
    free(map->rows);
    free(map->tiles);
    memset(map, 0, sizeof *map);
}

double umbt_map16_tune(struct umbt_map16_query *query, enum umbt_map16_way way)
{
    static const unsigned distances[] = {2, 4, 8, 16, 32, 64};
    struct umbt_map16_query part = *query;
    double best_s = 1e30;
    part.way = way;
    part.count = query->count < TUNE_POINTS ? query->count : TUNE_POINTS;
    part.points = query->points + 3 * ((query->count - part.count) / 2); /* mid-picture */
    for (size_t d = 0; d < sizeof distances / sizeof distances[0]; d++) {
        part.ahead = distances[d];
        for (int again = 0; again < 2; again++) {
            const double start = umbu_thread_cpu_s();
            umbt_map16_run(&part);
            const double seconds = umbu_thread_cpu_s() - start;
            if (seconds < best_s) {
                best_s = seconds;
                query->ahead = part.ahead;
            }
        }
    }
    query->way = way;
    return best_s / (double)part.count;
}
