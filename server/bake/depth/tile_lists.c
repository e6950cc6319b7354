/* SPDX-License-Identifier: Apache-2.0 */
/* Two fillings of bins: the map by tile once, each tile by block. */
#include "bake/depth/tile_lists.h"

static size_t entry_bytes(const struct umbb_bins *bins)
{
    return (size_t)bins->capacity * sizeof *bins->entries;
}

enum umb_status umbb_tile_lists_fill(struct umbb_tile_lists *lists, struct umb_error *error)
{
    const struct umbb_bins_input input = {
        .casters = lists->casters,
        .all = 1,
        .borders = lists->casters->marks != NULL,
        .cell_log2 = lists->tile_log2,
        .cells_x = (uint32_t)lists->casters->size >> lists->tile_log2,
        .max_bytes = lists->max_bytes,
        .workers = lists->workers,
    };
    return umbb_bins_fill(&lists->tiles, &input, error);
}

enum umb_status umbb_tile_lists_begin(struct umbb_tile_lists *lists, int slot,
                                      struct umbb_tile *tile, struct umb_error *error)
{
    const uint32_t tile_log2 = lists->tile_log2;
    const uint32_t block_log2 = tile_log2 < UMBB_BLOCK_LOG2 ? tile_log2 : UMBB_BLOCK_LOG2;
    const size_t others = entry_bytes(&lists->tiles) + entry_bytes(&lists->blocks[!slot]);
    struct umbb_bins_input input = {
        .max_bytes = lists->max_bytes > others ? lists->max_bytes - others : 0,
        .casters = lists->casters,
        .x0 = tile->x0,
        .y0 = tile->y0,
        .cell_log2 = block_log2,
        .cells_x = 1U << (tile_log2 - block_log2),
        .workers = lists->workers,
    };
    input.list = umbb_tile_lists_of_tile(lists, tile->x0, tile->y0, &input.count);
    tile->background = lists->casters->size;
    return umbb_bins_fill(&lists->blocks[slot], &input, error);
}

size_t umbb_tile_lists_allow(struct umbb_tile_lists *lists, size_t max_bytes)
{
    if (lists == NULL) {
        return 0;
    }
    lists->max_bytes = max_bytes;
    return entry_bytes(&lists->tiles) + entry_bytes(&lists->blocks[0]) +
           entry_bytes(&lists->blocks[1]);
}

const uint32_t *umbb_tile_lists_of_tile(const struct umbb_tile_lists *lists, int32_t x0, int32_t y0,
                                        size_t *count)
{
    return umbb_bins_cell(&lists->tiles, x0 >> lists->tile_log2, y0 >> lists->tile_log2, count);
}

void umbb_tile_lists_finish(struct umbb_tile_lists *lists)
{
    umbb_bins_finish(&lists->tiles);
    umbb_bins_finish(&lists->blocks[0]);
    umbb_bins_finish(&lists->blocks[1]);
}
