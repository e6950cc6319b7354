/* SPDX-License-Identifier: Apache-2.0 */
/* Explains the answer of one point, step by step, with the same arithmetic as the kernels. */
#include <string.h>

#include "query/perspective.h"
#include "query/stages.h"

static void add_step(struct umb_explanation *e, uint32_t level, uint32_t state, uint64_t index)
{
    if (e->step_count < sizeof e->steps / sizeof e->steps[0]) {
        e->steps[e->step_count].level = level;
        e->steps[e->step_count].state = state;
        e->steps[e->step_count].index = index;
        e->step_count++;
    }
}

/* Walks from the grid to the node that decides the answer of the window's centre, and records each
 * step. */
static void walk(const struct umb__query *q, const int64_t cell[3], struct umb_explanation *e)
{
    const struct umb__tree tree = umb__tree_of(q);
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

/* Fills in the explanation's window, texel by texel, with a look-up for each. */
static void draw_window(const struct umb__query *q, const struct umb__window *window,
                        struct umb_explanation *e)
{
    const struct umb__tree tree = umb__tree_of(q);
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

/* Returns the mean edge in metres of the voxel or cell that a look-up reads. The automatic bias of
 * coarse look-ups uses twice the edges of a cell (query.c, set_bias). */
static double edge_m(const struct umb__query *q)
{
    const double(*step)[3] = q->voxel_step;
    const double edge = (umb__length(step[0]) + umb__length(step[1]) + umb__length(step[2])) / 3;
    if (q->level == 0) {
        return edge;
    }
    return edge * (q->bias_mode == UMB_BIAS_AUTO ? 0.5 : (double)((uint32_t)1 << q->level));
}

/* Fills in the cosine between the point's normal and the light. */
static void add_normal(const struct umb__query *q, const struct umb_points *one,
                       struct umb_explanation *e)
{
    double n[3];
    const double length2 = umb__normal(one, 0, n), length = sqrt(length2);
    e->has_normal = umb__is_normal(length2);
    for (unsigned axis = 0; e->has_normal && axis < 3; axis++) {
        e->cosine -= n[axis] / length * q->direction[axis];
    }
}

/* Runs a stage of the query for one point. Out: the answer after that stage, and the numbers of
 * nodes and bricks that it read. */
static struct umb_query_stats answer_one(const struct umb__query *query, umb__kernel *run,
                                         const struct umb_points *one, struct umb_explanation *e)
{
    struct umb__query q = *query;
    float value = 0;
    struct umb_answers answers = {.values = &value};
    q.format = UMB_ANSWER_F32;
    run(&q, one, 0, 1, &answers);
    e->answer = (double)value;
    e->nodes = (uint32_t)answers.stats.nodes;
    e->bricks = (uint32_t)answers.stats.bricks;
    return answers.stats;
}

/* Explains the answer of opaque casters under parallel light. */
static void explain_parallel(const struct umb__query *q, const struct umb_points *points,
                             size_t index, struct umb_explanation *e)
{
    double start[3], p[3];
    struct umb__lift lift;
    const struct umb_points one = umb__some_points(points, index, 1);
    *e = (struct umb_explanation){.transmittance = 1};
    const struct umb_query_stats stats = answer_one(q, q->kernel, &one, e);
    e->taps = (uint32_t)q->taps;
    e->level = q->level;
    e->outside = stats.outside != 0;
    e->before = stats.before != 0;
    e->behind = stats.behind != 0;
    e->facing_away = stats.facing_away != 0;
    e->undefined =
        q->receiver_mask_cells != NULL && umb__receiver_mask_is_undefined(q, points, index);
    e->frustum = q->frustum;
    e->voxel_size_m = edge_m(q);
    umb__position(q, &one, 0, start);
    memcpy(p, start, sizeof p);
    (void)umb__move(q, &one, 0, p, &lift);
    umb__to_voxel(q, p, e->voxel);
    const double deeper = umb__lift_depth(&lift, e->voxel);
    e->voxel[2] += deeper;
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] += deeper * q->voxel_step[2][axis];
        double d = p[axis] - start[axis];
        e->bias_m += d * d;
        e->moved[axis] = p[axis] + q->origin[axis];
    }
    e->bias_m = sqrt(e->bias_m);
    struct umb_query_stats ignored = {0};
    struct umb__window window = umb__window_at(q, e->voxel, &ignored);
    e->bias_mode = q->bias_mode;
    e->filter = q->filter;
    add_normal(q, &one, e);
    for (unsigned axis = 0; axis < 2; axis++) {
        /* The position is clamped to values beyond any frustum, because the floor of larger doubles
         * would not fit. */
        e->window[axis] = (int64_t)floor(fmax(-1e9, fmin(1e9, e->voxel[axis]))) - q->taps / 2;
    }
    if (q->level > 0) {
        e->lit_taps = e->rows[0] = e->answer > 0.5;
    } else if (!e->facing_away) {
        draw_window(q, &window, e);
    }
    if (!e->facing_away && !e->outside && !e->before) {
        e->cell[0] = (int64_t)e->voxel[0];
        e->cell[1] = (int64_t)e->voxel[1];
        e->cell[2] = window.z;
        walk(q, e->cell, e);
    }
}

/* Explains the answer of opaque casters under a spot or point light. */
static void explain_face(const struct umb__query *q, const struct umb_points *points, size_t index,
                         struct umb_explanation *e)
{
    struct umb__sighting s;
    struct umb__query face_query;
    double p[3];
    umb__perspective_map(q, points, index, &s);
    umb__perspective_face(q, s.face, &face_query);
    const struct umb_points one = {.positions = s.voxel, .format = UMB_POINT_F64, .count = 1};
    explain_parallel(&face_query, &one, 0, e);
    umb__position(q, points, index, p);
    if (s.facing_away) {
        *e = (struct umb_explanation){.facing_away = 1, .taps = e->taps, .transmittance = 1};
        memcpy(s.moved, p, sizeof p);
    }
    e->bias_mode = q->bias_mode;
    e->has_normal = s.has_normal;
    e->cosine = s.cosine;
    for (unsigned axis = 0; axis < 3; axis++) {
        e->moved[axis] = s.moved[axis] + q->origin[axis];
    }
    e->bias_m = s.bias_m;
    e->frustum = q->first_face + s.face;
    e->voxel_size_m = umb__perspective_edge_m(q, s.face, s.moved);
}

void umb_query_explain(const struct umb_query *query, const struct umb_points *points, size_t index,
                       struct umb_explanation *explanation)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    (q.face_count > 0 ? explain_face : explain_parallel)(&q, points, index, explanation);
    if (q.trans != NULL && explanation->answer > 0) {
        explanation->transmittance = umb__transmittance_at(&q, points, index);
        explanation->answer = (double)(float)(explanation->answer * explanation->transmittance);
    }
    const bool is_wide = q.face_count > 0 && q.filter == UMB_FILTER_PENUMBRA;
    if (q.footprint_inner != NULL || is_wide) { /* With this filter, the window is explained as
                                                   without it */
        const struct umb_points one = umb__some_points(points, index, 1);
        (void)answer_one(&q, q.run, &one, explanation);
        explanation->filter = q.filter;
        explanation->footprint_m = is_wide ? 0 : umb__footprint_of(&q, &one, 0);
    }
}
