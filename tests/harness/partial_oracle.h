/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_PARTIAL_ORACLE_H
#define UMBRAGE_TESTS_PARTIAL_ORACLE_H
/*
 * The oracle of partial assets: everything made anew from the pages held, in the plainest way. All
 * nodes of the pages become one graph, in which a child in a missing page is UMB__ABSENT | page.
 * The lower and the upper octree are made from it, in which such a child is all shadowed or all
 * lit, and laid out as any asset is. The incremental layout must give the same answers, bounds and
 * marks.
 *
 *     struct oracle oracle = {.part = partial};
 *     oracle_build(&oracle, &error);      from the pages that `partial` holds now
 *     oracle_want(&oracle, &view, 0, &error);      marks: oracle.benefit[page]
 *     oracle_query(&oracle, &settings, &points, 0, &answers, &error);
 *     oracle_finish(&oracle);
 */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "partial_oracle_build.h"
#include "partial/partial_space.h"
#include "query/perspective.h"
#include "query/stages.h"

/* --- wants and look-ups ----------------------------------------------------------------------- */

/* A cube of voxels, and the node of the graph or the missing page that has it. */
struct cube {
    uint32_t level, x, y, z; /* Level, and first voxel */
    uint32_t child;          /* Node of the graph, brick, or UMB__ABSENT | page */
};

struct walk {
    struct oracle *p;
    const struct umb__sight *sight;
    const struct umb__space *space;
    uint64_t steps; /* Number of cubes that the walk may still visit */
};

/* Limit of the cubes that a walk visits: STEPS_A_NODE for each node held, and STEPS_MIN more. */
enum {
    STEPS_A_NODE = 16,
    STEPS_MIN = 1024,
};

/* Benefit of everything below a root that the walk does not reach; any positive value would do. */
#define ROOT_BENEFIT 1.0

static inline void add_benefit(struct oracle *p, uint32_t level, uint32_t child, double benefit)
{
    const uint32_t page =
        child & UMB__ABSENT ? child & ~UMB__ABSENT : oracle_page_of(p, level, child);
    p->benefit[page] += benefit;
}

static inline struct cube part_of(const struct cube *cube, unsigned c, uint32_t child)
{
    const uint32_t half = 1U << (cube->level - 1);
    return (struct cube){cube->level - 1, cube->x + (c & 1 ? half : 0),
                         cube->y + (c & 2 ? half : 0), cube->z + (c & 4 ? half : 0), child};
}

/* Marks a node so that everything below it is wanted, unless it is already marked with this benefit
 * or a greater one. The benefit of a marked node is negated in `seen`. */
static inline void mark(struct oracle *p, uint32_t level, uint32_t node, double benefit)
{
    float *seen = &p->seen[level][node];
    if (!(benefit <= fabs((double)*seen))) {
        *seen = -(float)fmax(fmin(benefit, FLT_MAX), FLT_MIN);
    }
}

/* Returns whether a walk ends at a node. */
static inline bool ends_at(const struct oracle *p, uint32_t level, uint32_t child)
{
    return (child & UMB__ABSENT) || level == UMB_LEVEL_BRICK ||
           (!p->walks_all && p->closed[level][child]);
}

/* Wants a child and all below it without a visit. */
static inline void want_all(struct oracle *p, uint32_t level, uint32_t child, double benefit)
{
    if (ends_at(p, level, child)) {
        add_benefit(p, level, child, benefit);
    } else {
        mark(p, level, child, benefit);
    }
}

/* Gives a benefit to everything below the marked nodes, each node once, from the top down. A child
 * has half the edge of its parent, so a quarter of its parent's benefit. */
static inline void want_marked(struct oracle *p)
{
    for (uint32_t l = UMB_LEVEL_MAX; l > UMB_LEVEL_BRICK; l--) {
        const struct umb__octree_level *level = &p->graph.level[l];
        for (uint32_t node = 0; node < level->count; node++) {
            float *seen = &p->seen[l][node];
            if (!(*seen < 0)) {
                continue;
            }
            *seen = -*seen;
            add_benefit(p, l, node, (double)*seen);
            for (uint32_t at = level->first[node]; at < level->first[node + 1]; at++) {
                want_all(p, l - 1, level->children[at], (double)*seen / 4);
            }
        }
    }
}

/* Visits a cube and, if the view needs more than the cube shows, its children. Recursion ends at
 * bricks, since levels descend. In: above: benefit of the cube's parent. */
static inline void walk_cube(struct walk *w, const struct cube *cube, double above)
{
    struct oracle *p = w->p;
    if (w->steps == 0) {
        want_all(p, cube->level, cube->child, above / 4);
        return;
    }
    w->steps--;
    const struct umb_partial_view *view = w->sight->view;
    const struct umb__seen_cube seen =
        umb__sight_cube(w->sight, w->space, cube->level, cube->x, cube->y, cube->z);
    if (seen.out || seen.edge_m <= view->max_error_m ||
        seen.edge_m <= view->max_error_rad * seen.distance_m) {
        return;
    }
    const bool end = ends_at(p, cube->level, cube->child);
    if (!end && seen.whole) {
        /* An earlier walk from another cube of this node found everything below the node. With
         * max_error_rad a cube that appears larger may need finer cells. Without it, only a benefit
         * more than four times as great is worth a second walk. */
        float *best = &p->seen[cube->level][cube->child];
        const double room = view->max_error_rad > 0 ? 1.0 : 4.0;
        if (seen.benefit <= (double)*best * room) {
            return;
        }
        *best = nextafterf((float)seen.benefit, 0.0F);
    }
    add_benefit(p, cube->level, cube->child, seen.benefit);
    if (end) {
        return;
    }
    const struct umb__octree_level *level = &p->graph.level[cube->level];
    const uint32_t *child = level->children + level->first[cube->child];
    for (unsigned c = 0; c < 8; c++) {
        if (umb__mask_state(level->masks[cube->child], c) == UMB__NODE_MIXED) {
            const struct cube part = part_of(cube, c, *child++);
            walk_cube(w, &part, seen.benefit);
        }
    }
}

static inline uint64_t oracle_nodes(const struct oracle *p)
{
    uint64_t nodes = p->graph.brick_count;
    for (size_t level = UMB_LEVEL_BRICK + 1; level < UMB__LEVELS; level++) {
        nodes += p->graph.level[level].count;
    }
    return nodes;
}

static inline void walk_roots(struct oracle *p, const struct umb__sight *sight)
{
    const struct umb__content *content = &p->part->canonical.content;
    const uint32_t light = sight->view->light;
    struct umb__space space;
    const uint64_t limit = STEPS_MIN + (p->walks_all ? 64 : STEPS_A_NODE) * oracle_nodes(p);
    struct walk w = {.p = p, .sight = sight, .space = &space, .steps = limit};
    for (uint32_t i = 0; i < p->graph.root_count; i++) {
        const struct umb__octree_root *root = &p->graph.roots[i];
        if (root->state == UMB__NODE_MIXED &&
            (light == UINT32_MAX || content->frusta[i].light == light)) {
            const struct cube cube = {root->level, 0, 0, 0, root->index};
            umb__space_init(&space, content, i, sight->view);
            walk_cube(&w, &cube, ROOT_BENEFIT);
        }
    }
    p->met_bound = w.steps == 0;
    if (w.steps == 0) {
        want_marked(p);
    }
}

static inline void forget(struct oracle *p)
{
    for (uint32_t page = 0; page < p->part->head.page_count; page++) {
        p->benefit[page] = 0;
    }
}

static inline enum umb_status oracle_want(struct oracle *p, const struct umb_partial_view *view,
                                          int add, struct umb_error *error)
{
    struct umb__sight sight;
    if (view && UMB__UNKNOWN(view, "view", error)) {
        return UMB_E_ARGUMENT;
    }
    if (!add) {
        forget(p);
    }
    if (!view) {
        return UMB_OK;
    }
    const struct umb__content *content = &p->part->canonical.content;
    if (view->light != UINT32_MAX && view->light >= content->light_count) {
        return umb_fail(error, UMB_E_ARGUMENT, UMB__NO_LIGHT, view->light,
                        content->light_count - 1);
    }
    UMB__TRY(umb__sight_init(&sight, view, error));
    for (size_t level = UMB_LEVEL_BRICK + 1; level < UMB__LEVELS; level++) {
        memset(p->seen[level], 0, p->graph.level[level].count * sizeof(float));
    }
    walk_roots(p, &sight);
    return UMB_OK;
}

/* A box of voxels during its walk through the graph. */
struct look {
    struct oracle *p;
    const uint32_t *low, *high;
    bool want;
    struct umb__lack lack;
};

static inline double occupancy_of(uint16_t mask)
{
    const unsigned lit = (unsigned)__builtin_popcount(mask & 0x5555U);
    return (lit + 0.5 * umb__mask_mixed_count(mask)) / 8.0;
}

/* In: above: occupancy of the cube's parent node. */
static inline void look_cube(struct look *l, const struct cube *cube, double above)
{
    const uint32_t at[3] = {cube->x, cube->y, cube->z}, last = (1U << cube->level) - 1;
    for (unsigned i = 0; i < 3; i++) {
        if (at[i] > l->high[i] || at[i] + last < l->low[i]) {
            return;
        }
    }
    if (cube->child & UMB__ABSENT) {
        if (cube->level > l->lack.level) {
            l->lack = (struct umb__lack){cube->level, above};
        }
        if (l->want) { /* Without `want`, other threads may read the graph at the same time */
            l->p->benefit[cube->child & ~UMB__ABSENT] += 1;
        }
        return;
    }
    if (cube->level == UMB_LEVEL_BRICK) {
        return;
    }
    const struct umb__octree_level *level = &l->p->graph.level[cube->level];
    const uint16_t mask = level->masks[cube->child];
    const uint32_t *child = level->children + level->first[cube->child];
    for (unsigned c = 0; c < 8; c++) {
        if (umb__mask_state(mask, c) == UMB__NODE_MIXED) {
            const struct cube part = part_of(cube, c, *child++);
            look_cube(l, &part, occupancy_of(mask));
        }
    }
}

static inline struct umb__lack oracle_look(struct oracle *p, uint32_t frustum,
                                           const uint32_t low[3], const uint32_t high[3], bool want)
{
    struct look l = {.p = p, .low = low, .high = high, .want = want};
    const struct umb__octree_root *root = &p->graph.roots[frustum];
    if (root->state == UMB__NODE_MIXED) {
        const struct cube cube = {root->level, 0, 0, 0, root->index};
        look_cube(&l, &cube, 0.5);
    }
    return l.lack;
}

/* --- queries ---------------------------------------------------------------------------------- */

/* Points that both assets answer at a time, so that the answers stay in the cache. */
#define ORACLE_CHUNK 1024U

/* A query of both assets. */
struct bracket {
    struct oracle *p;
    struct umb_query lower, upper;
    const struct umb_points *points;
    bool want;
    struct umb__query q; /* Content of `lower` */
    struct umb_partial_answers *answers;
};

static inline uint32_t clamp_voxel(double v, double size)
{
    return v >= size ? (uint32_t)size - 1 : v > 0 ? (uint32_t)v : 0; /* NaN: 0 */
}

/* Looks up the window of point i in the graph. Out: error_m: as error_m of struct
 * umb_partial_answers. */
static inline struct umb__lack explain(const struct bracket *b, size_t i, double *error_m)
{
    static const struct umb_partial_view no_view;
    struct umb__space space;
    double voxel[3] = {0};
    uint32_t frustum;
    (void)umb__look_up_at(&b->q, b->points, i, voxel, &frustum);
    const struct umb_frustum_info *f = &b->p->part->canonical.content.frusta[frustum];
    const double size = (double)(1U << f->log2_size), half = b->q.taps / 2;
    uint32_t low[3], high[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        const double reach = axis < 2 ? half : 0;
        low[axis] = clamp_voxel(floor(voxel[axis]) - reach, size);
        high[axis] = clamp_voxel(floor(voxel[axis]) + reach, size);
    }
    const struct umb__lack lack = oracle_look(b->p, frustum, low, high, b->want);
    /* All missing cubes of the window lie at one depth, so the cube of the highest level has the
     * longest edge. */
    umb__space_init(&space, &b->p->part->canonical.content, frustum, &no_view);
    *error_m = umb__space_edge(&space, lack.level, low[2] >> lack.level << lack.level);
    return lack;
}

static inline void settle(const struct bracket *b, size_t i, float low, float high)
{
    struct umb_partial_answers *a = b->answers;
    double error_m = 0;
    float value = low;
    if (low < high) {
        const struct umb__lack lack = explain(b, i, &error_m);
        value = low + (high - low) * (float)lack.occupancy;
    } else {
        a->exact++;
    }
    a->values[i] = value;
    if (a->low) {
        a->low[i] = low;
    }
    if (a->high) {
        a->high[i] = high;
    }
    if (a->error_m) {
        a->error_m[i] = (float)error_m;
    }
    a->worst_error_m = error_m > a->worst_error_m ? error_m : a->worst_error_m;
}

static inline void run_chunk(const struct bracket *b, size_t first, size_t count)
{
    float low[ORACLE_CHUNK], high[ORACLE_CHUNK];
    const struct umb_points points = umb__some_points(b->points, first, count);
    struct umb_answers below = {.values = low, .stats = b->answers->stats};
    struct umb_answers above = {.values = high};
    umb_query_run(&b->lower, &points, 0, count, &below);
    umb_query_run(&b->upper, &points, 0, count, &above);
    b->answers->stats = below.stats;
    for (size_t i = 0; i < count; i++) {
        settle(b, first + i, low[i], high[i]);
    }
}

static inline enum umb_status oracle_query(struct oracle *p,
                                           const struct umb_query_settings *settings,
                                           const struct umb_points *points, int want,
                                           struct umb_partial_answers *answers,
                                           struct umb_error *error)
{
    struct bracket b = {.p = p, .points = points, .want = want != 0, .answers = answers};
    struct umb_query_settings floats = *settings;
    floats.format = UMB_ANSWER_F32;
    answers->exact = 0;
    answers->worst_error_m = 0;
    const char *refusal = umb__filter_of(settings->filter)->partial;
    if (refusal != NULL) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "%s", refusal);
    }
    UMB__TRY(umb_query_prepare(&p->lower, &floats, &b.lower, error));
    UMB__TRY(umb_query_prepare(&p->upper, &floats, &b.upper, error));
    UMB__TRY(umb_points_check(points, error));
    memcpy(&b.q, b.lower.opaque, sizeof b.q);
    for (size_t first = 0; first < points->count; first += ORACLE_CHUNK) {
        const size_t rest = points->count - first;
        run_chunk(&b, first, rest < ORACLE_CHUNK ? rest : ORACLE_CHUNK);
    }
    return UMB_OK;
}

#endif
