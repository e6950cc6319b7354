/* SPDX-License-Identifier: Apache-2.0 */
/* The answer of one point, told step by step; the same arithmetic as the kernels. */
#include <string.h>

#include "query/perspective.h"
#include "query/query_parts.h"

static void add_step(struct umb_explanation *e, uint32_t level, uint32_t state, uint64_t index)
{
    if (e->step_count < sizeof e->steps / sizeof e->steps[0]) {
        e->steps[e->step_count].level = level;
        e->steps[e->step_count].state = state;
        e->steps[e->step_count].index = index;
        e->step_count++;
    }
}

/* Walks the centre tap from the grid to where its state is known. */
static void walk(const struct umb__query *q, const int64_t cell[3], struct umb_explanation *e)
{
    uint32_t g = q->grid_log2, level = q->log2_size - g;
    uint64_t x = (uint64_t)cell[0], y = (uint64_t)cell[1], z = (uint64_t)cell[2];
    uint64_t index = (x >> level) + ((y >> level) << g) + ((z >> level) << (2 * g));
    uint32_t value = q->grid[index];
    if (value < UMB__CELL_FIRST) {
        add_step(e, level, value, index);
        return;
    }
    uint32_t number = value - UMB__CELL_FIRST;
    add_step(e, level, 2, index);
    while (level > UMB_LEVEL_BRICK) {
        const uint64_t *node = q->nodes + number;
        level -= 2;
        unsigned child =
            (unsigned)((x >> level & 3) | (y >> level & 3) << 2 | (z >> level & 3) << 4);
        if (!(node[0] >> child & 1)) {
            add_step(e, level, node[1] >> child & 1, number);
            return;
        }
        add_step(e, level, 2, number);
        number = umb__wide_child(node, child);
    }
    uint64_t slice = q->bricks[number][z & 7];
    add_step(e, 0, slice >> ((x & 7) + 8 * (y & 7)) & 1, number);
}

void umb_query_explain(const struct umb_query *query, const struct umb_points *points, size_t index,
                       struct umb_explanation *explanation)
{
    struct umb_explanation e = {0};
    struct umb__query q;
    double p[3], start[3], size[3];
    memcpy(&q, query->opaque, sizeof q);
    if (q.face_count > 0) {
        umb__perspective_explain(&q, points, index, explanation);
        return;
    }
    float value = 0;
    struct umb_points one = *points;
    size_t scalar = points->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double);
    one.positions = (const uint8_t *)points->positions + 3 * index * scalar;
    one.normals = points->normals ? (const uint8_t *)points->normals + 12 * index : NULL;
    one.count = 1;
    struct umb_answers answers = {.values = &value};
    q.format = UMB_ANSWER_F32;
    q.kernel(&q, &one, 0, 1, &answers);
    e.taps = (uint32_t)q.taps;
    e.lit_taps = (uint32_t)((double)value * q.taps * q.taps + 0.5);
    e.outside = answers.stats.outside != 0;
    e.before = answers.stats.before != 0;
    e.behind = answers.stats.behind != 0;
    e.facing_away = answers.stats.facing_away != 0;
    e.nodes = (uint32_t)answers.stats.nodes;
    e.bricks = (uint32_t)answers.stats.bricks;
    e.frustum = q.frustum;
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *step = q.voxel_step[axis];
        size[axis] = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
        start[axis] = one.origin[axis] - q.origin[axis] + umb__coordinate(&one, 0, axis);
        p[axis] = start[axis];
    }
    e.voxel_size_m = (size[0] + size[1] + size[2]) / 3;
    (void)umb__move(&q, &one, 0, p);
    umb__to_voxel(&q, p, e.voxel);
    for (unsigned axis = 0; axis < 3; axis++) {
        double d = p[axis] - start[axis];
        e.bias_m += d * d;
        e.moved[axis] = p[axis] + q.origin[axis];
    }
    e.bias_m = sqrt(e.bias_m);
    struct umb_query_stats ignored = {0};
    struct umb__window window = umb__window_at(&q, e.voxel, &ignored);
    if (!e.facing_away && !e.outside && !e.before) {
        e.cell[0] = (int64_t)e.voxel[0];
        e.cell[1] = (int64_t)e.voxel[1];
        e.cell[2] = window.z;
        walk(&q, e.cell, &e);
    }
    *explanation = e;
}
