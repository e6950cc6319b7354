/* SPDX-License-Identifier: Apache-2.0 */
/* See lines_floor.h. */
#include "lines_floor.h"

#include "query/kernel_parts.h"

#define AHEAD 64U

static void note(struct lines_floor *floor, const void *line)
{
    floor->lines[floor->count++] = line;
}

/* Lists the lines that the look-up of one voxel reads, from its column to its brick, in the order
 * of kernel_descent.h. The column itself is left out: columns stay in the cache. */
static void note_way(const struct umb__query *q, const int32_t v[3], struct lines_floor *floor)
{
    uint32_t level = q->column_level;
    uint64_t column;
    memcpy(&column,
           q->columns + ((uint32_t)v[0] >> level) +
               ((uint32_t)v[1] >> level << (q->log2_size - level)),
           sizeof column);
    const uint32_t *value = q->pieces + umb__piece_of(column, (uint32_t)v[2] >> level);
    note(floor, value);
    for (uint32_t mixed = *value >= UMB__CELL_FIRST, number = *value - UMB__CELL_FIRST; mixed;) {
        if (level == UMB_LEVEL_BRICK) {
            note(floor, &q->bricks[number]);
            return;
        }
        const uint64_t *node = q->nodes + number;
        level -= 2;
        const unsigned bit = umb__child_bit(v[0], v[1], v[2], level);
        const uint32_t *child = umb__child_place(node, bit);
        note(floor, node);
        mixed = (uint32_t)(node[0] >> bit & 1);
        if (mixed && (uintptr_t)child / 64 != (uintptr_t)node / 64) {
            note(floor, child);
        }
        number = *child;
    }
}

void lines_floor_note(const struct umb_query *query, const struct umb_points *points,
                      struct lines_floor *floor)
{
    const struct umb__query *q = (const struct umb__query *)(const void *)query->opaque;
    floor->count = 0;
    for (size_t i = 0; i < points->count; i++) {
        struct umb_query_stats stats = {0};
        double p[3], v[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] = points->origin[axis] - q->origin[axis] + umb__coordinate(points, i, axis);
        }
        umb__to_voxel(q, p, v);
        const struct umb__window window = umb__window_at(q, v, &stats);
        if (!window.all_lit) {
            const int32_t at[3] = {window.x0, window.y0, window.z};
            note_way(q, at, floor);
        }
    }
}

unsigned lines_floor_read(const struct lines_floor *floor)
{
    unsigned sum = 0;
    for (size_t i = 0; i < floor->count; i++) {
        if (i + AHEAD < floor->count) {
            __builtin_prefetch(floor->lines[i + AHEAD]);
        }
        sum += *floor->lines[i];
    }
    return sum;
}
