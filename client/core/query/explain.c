/* SPDX-License-Identifier: Apache-2.0 */
/* The answer of one point, told step by step; the same arithmetic as the kernels. */
#include <string.h>

#include "query/footprint.h"
#include "query/receiver_mask_stage.h"
#include "query/perspective.h"
#include "query/query_parts.h"
#include "query/transmittance_stage.h"
#include "query/voxel_tree.h"

const char *umb_filter_name(enum umb_filter filter)
{
    static const char *const names[UMB_FILTERS] = {"box", "tent", "penumbra", "footprint"};
    return (unsigned)filter < UMB_FILTERS ? names[filter] : "unknown";
}

const char *umb_bias_mode_name(enum umb_bias_mode mode)
{
    static const char *const names[] = {"auto", "voxels", "metres", "none"};
    return (unsigned)mode < sizeof names / sizeof names[0] ? names[mode] : "unknown";
}

static void add_step(struct umb_explanation *e, uint32_t level, uint32_t state, uint64_t index)
{
    if (e->step_count < sizeof e->steps / sizeof e->steps[0]) {
        e->steps[e->step_count].level = level;
        e->steps[e->step_count].state = state;
        e->steps[e->step_count].index = index;
        e->step_count++;
    }
}

static struct umb__tree tree_of(const struct umb__query *q)
{
    return (struct umb__tree){.grid = q->grid,
                              .nodes = q->nodes,
                              .bricks = q->bricks,
                              .log2_size = q->log2_size,
                              .grid_log2 = q->grid_log2};
}

/* Walks the centre tap from the grid to where its state is known. */
static void walk(const struct umb__query *q, const int64_t cell[3], struct umb_explanation *e)
{
    const struct umb__tree tree = tree_of(q);
    uint32_t g = q->grid_log2, level = umb__tree_cell_level(&tree);
    uint32_t x = (uint32_t)cell[0], y = (uint32_t)cell[1], z = (uint32_t)cell[2];
    uint64_t index = (uint64_t)(x >> level) + ((uint64_t)(y >> level) << g) +
                     ((uint64_t)(z >> level) << (2 * g));
    struct umb__link link = umb__tree_cell(&tree, x >> level, y >> level, z >> level);
    add_step(e, level, link.mixed ? 2 : link.lit, index);
    const uint32_t last = q->level > 0 ? q->level : UMB_LEVEL_BRICK;
    while (link.mixed && level > last) {
        uint32_t number = link.number;
        level -= 2;
        link = umb__tree_child(&tree, number, umb__child_at(level, x, y, z));
        add_step(e, level, link.mixed ? 2 : link.lit, number);
    }
    if (link.mixed && q->level == 0) {
        add_step(e, 0, umb__brick_voxel(q->bricks[link.number], x, y, z), link.number);
    }
}

/* The window texel by texel, each looked up for itself. */
static void draw_window(const struct umb__query *q, const struct umb__window *window,
                        struct umb_explanation *e)
{
    const struct umb__tree tree = tree_of(q);
    int64_t size = (int64_t)1 << q->log2_size;
    struct umb_volume_stats ignored = {0};
    for (int32_t j = 0; j < q->taps; j++) {
        for (int32_t i = 0; i < q->taps; i++) {
            int64_t x = e->window[0] + i, y = e->window[1] + j;
            bool lit = true;
            if (!window->all_lit && x >= 0 && x < size && y >= 0 && y < size) {
                struct umb__place place = umb__tree_locate(&tree, (uint32_t)x, (uint32_t)y,
                                                           (uint32_t)window->z, &ignored);
                lit = place.brick ? umb__brick_voxel(place.brick, (uint32_t)x, (uint32_t)y,
                                                     (uint32_t)window->z)
                                  : place.lit;
            }
            e->rows[j] |= (uint32_t)lit << i;
            e->lit_taps += lit;
        }
    }
}

/* Edges of what answers, voxel or cell, in those that the bias is made of (query.c, widen_steps).
 */
static double cells_in_step(const struct umb__query *q)
{
    if (q->level == 0) {
        return 1;
    }
    return q->bias_mode == UMB_BIAS_AUTO ? 0.5 : (double)((uint32_t)1 << q->level);
}

/* How the point's normal stands to the light. */
static void add_normal(const struct umb__query *q, const struct umb_points *one,
                       struct umb_explanation *e)
{
    float n[3] = {0, 0, 0};
    if (one->normals) {
        memcpy(n, one->normals, sizeof n);
    }
    double length = sqrt((double)n[0] * (double)n[0] + (double)n[1] * (double)n[1] +
                         (double)n[2] * (double)n[2]);
    e->has_normal = length > 0 && isfinite(length);
    for (unsigned axis = 0; e->has_normal && axis < 3; axis++) {
        e->cosine -= (double)n[axis] / length * q->direction[axis];
    }
}

/* What opaque casters answer of parallel light. */
static void explain_parallel(const struct umb__query *query, const struct umb_points *points,
                             size_t index, struct umb_explanation *explanation)
{
    struct umb_explanation e = {.transmittance = 1};
    struct umb__query q = *query;
    double p[3], start[3], size[3];
    float value = 0;
    struct umb_points one = umb__some_points(points, index, 1);
    struct umb_answers answers = {.values = &value};
    q.format = UMB_ANSWER_F32;
    q.kernel(&q, &one, 0, 1, &answers);
    e.taps = (uint32_t)q.taps;
    e.level = q.level;
    e.answer = (double)value;
    e.outside = answers.stats.outside != 0;
    e.before = answers.stats.before != 0;
    e.behind = answers.stats.behind != 0;
    e.facing_away = answers.stats.facing_away != 0;
    e.undefined =
        q.receiver_mask_cells != NULL && umb__receiver_mask_is_undefined(&q, points, index);
    e.nodes = (uint32_t)answers.stats.nodes;
    e.bricks = (uint32_t)answers.stats.bricks;
    e.frustum = q.frustum;
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *step = q.voxel_step[axis];
        size[axis] = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
        start[axis] = one.origin[axis] - q.origin[axis] + umb__coordinate(&one, 0, axis);
        p[axis] = start[axis];
    }
    e.voxel_size_m = (size[0] + size[1] + size[2]) / 3 * cells_in_step(&q);
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
    e.bias_mode = q.bias_mode;
    e.filter = q.filter;
    add_normal(&q, &one, &e);
    for (unsigned axis = 0; axis < 2; axis++) {
        /* Beyond any frustum where a double or its floor would not fit. */
        e.window[axis] = (int64_t)floor(fmax(-1e9, fmin(1e9, e.voxel[axis]))) - q.taps / 2;
    }
    if (q.level > 0) {
        e.lit_taps = e.rows[0] = value > 0.5F;
    } else if (!e.facing_away) {
        draw_window(&q, &window, &e);
    }
    if (!e.facing_away && !e.outside && !e.before) {
        e.cell[0] = (int64_t)e.voxel[0];
        e.cell[1] = (int64_t)e.voxel[1];
        e.cell[2] = window.z;
        walk(&q, e.cell, &e);
    }
    *explanation = e;
}

/* The window is told as without a footprint; answer and reads are the footprint's. */
static void explain_footprint(const struct umb__query *q, const struct umb_points *points,
                              size_t index, struct umb_explanation *explanation)
{
    struct umb__query window = *q, whole = *q;
    struct umb_query opaque = {{0}};
    const struct umb_points one = umb__some_points(points, index, 1);
    float value = 0;
    struct umb_answers answers = {.values = &value};
    whole.format = UMB_ANSWER_F32;
    whole.run(&whole, &one, 0, 1, &answers);
    window.filter = UMB_FILTER_BOX;
    memcpy(opaque.opaque, &window, sizeof window);
    umb_query_explain(&opaque, points, index, explanation);
    explanation->filter = UMB_FILTER_FOOTPRINT;
    explanation->footprint_m = umb__footprint_of(q, &one, 0);
    explanation->answer = (double)value;
    explanation->nodes = (uint32_t)answers.stats.nodes;
    explanation->bricks = (uint32_t)answers.stats.bricks;
}

void umb_query_explain(const struct umb_query *query, const struct umb_points *points, size_t index,
                       struct umb_explanation *explanation)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    if (q.filter == UMB_FILTER_FOOTPRINT) {
        explain_footprint(&q, points, index, explanation);
        return;
    }
    if (q.face_count > 0) {
        umb__perspective_explain(&q, points, index, explanation);
    } else {
        explain_parallel(&q, points, index, explanation);
    }
    if (q.trans != NULL && explanation->answer > 0) {
        explanation->transmittance = umb__transmittance_at(&q, points, index);
        explanation->answer = (double)(float)(explanation->answer * explanation->transmittance);
    }
}
