/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Finds the pages that matter. A walk follows the view through the pages from the roots, cube by
 * cube. A missing page gets the benefit of each cube of which it has the node. So does every page
 * on the way, so that a page is never worth less than a page below it. The walk does not go below a
 * node if all of the node's tree is in one page, since nothing is missing there. A node of which a
 * whole cube was visited is not walked again for a smaller benefit, since everything below the node
 * was found.
 *
 * Pages share nodes, so the unfolded tree may be larger by any factor. Therefore the walk counts
 * the cubes that it visits. Views of scenes take up to 5 cubes for each node held, most of them
 * missing. At STEPS_A_NODE the walk stops and marks the nodes that remain. Then one pass over the
 * nodes, from the top down and each node once, wants everything below the marked nodes. The result
 * may have too many pages, never too few.
 */
#include <float.h>
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/reserved.h"
#include "base/try.h"
#include "partial/partial_parts.h"
#include "partial/partial_space.h"

/* A cube of voxels, and the place of its node or brick. */
struct cube {
    uint32_t level, x, y, z; /* Level, and first voxel */
    struct umb__node_place place;
};

/* Returns the nodes of a page in the last build; NULL: the page is missing there. */
static const struct umb__expanded *nodes_of(const struct umb_partial *p, uint32_t page)
{
    const struct umb__laid *laid = p->pages[page].laid;
    return laid ? laid->nodes : NULL;
}

struct walk {
    struct umb_partial *p;
    const struct umb__sight *sight;
    const struct umb__space *space;
    uint64_t steps; /* Number of cubes that the walk may still visit */
};

/* Limit of the cubes that a walk visits: STEPS_A_NODE for each node held, and STEPS_MIN more. */
enum {
    STEPS_A_NODE = 16,
    STEPS_MIN = 1024,
};

/* Benefit of everything below a root to which the walk does not come; any positive value would
 * do. */
#define ROOT_BENEFIT 1.0

/* Returns whether a walk ends at a node: its page is missing, or has all that is below it. In:
 * nodes: those of the node's page, or NULL. */
static bool ends_at(const struct umb__expanded *nodes, uint32_t level, uint32_t position)
{
    return !nodes || level == UMB_LEVEL_BRICK || nodes->level[level].closed[position];
}

static struct cube part_of(const struct cube *cube, unsigned c, struct umb__node_place place)
{
    const uint32_t half = 1U << (cube->level - 1);
    return (struct cube){cube->level - 1, cube->x + (c & 1 ? half : 0),
                         cube->y + (c & 2 ? half : 0), cube->z + (c & 4 ? half : 0), place};
}

/* Marks a node so that everything below it is wanted, unless it is already marked with this benefit
 * or a greater one. The benefit of a marked node is negated in `seen`. */
static void mark(float *seen, double benefit)
{
    if (!(benefit <= fabs((double)*seen))) {
        *seen = -(float)fmax(fmin(benefit, FLT_MAX), FLT_MIN);
    }
}

/* Wants a node or brick and all below it without a visit. */
static void want_all(struct umb_partial *p, uint32_t level, struct umb__node_place place,
                     double benefit)
{
    const struct umb__expanded *nodes = nodes_of(p, place.page);
    if (ends_at(nodes, level, place.position)) {
        p->pages[place.page].benefit += benefit;
    } else {
        mark(&nodes->seen[level][place.position], benefit);
    }
}

/* Wants the marked nodes of one page and level. A child has half the edge of its parent, so a
 * quarter of its parent's benefit. */
static void want_marked_of(struct umb_partial *p, uint32_t page, const struct umb__expanded *nodes,
                           uint32_t l)
{
    const struct umb__expanded_level *level = &nodes->level[l];
    for (uint32_t node = 0; node < level->count; node++) {
        float *seen = &nodes->seen[l][node];
        if (!(*seen < 0)) {
            continue;
        }
        *seen = -*seen;
        p->want_steps++;
        p->pages[page].benefit += (double)*seen;
        for (uint32_t at = level->first[node]; at < level->first[node + 1]; at++) {
            want_all(p, l - 1, umb__expanded_child(nodes, page, l, level->children[at]),
                     (double)*seen / 4);
        }
    }
}

/* Gives a benefit to everything below the marked nodes, each node once, from the top down. */
static void want_marked(struct umb_partial *p)
{
    for (uint32_t l = UMB_LEVEL_MAX; l > UMB_LEVEL_BRICK; l--) {
        for (uint32_t page = 0; page < p->head.page_count; page++) {
            const struct umb__expanded *nodes = nodes_of(p, page);
            if (nodes) {
                want_marked_of(p, page, nodes, l);
            }
        }
    }
}

/* Visits a cube and, if the view needs finer cells than this cube, its children. Recursion ends at
 * bricks, since levels descend. In: above: benefit of the cube's parent. */
static void walk_cube(struct walk *w, const struct cube *cube, double above)
{
    struct umb_partial *p = w->p;
    if (w->steps == 0) {
        want_all(p, cube->level, cube->place, above / 4);
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
    const struct umb__expanded *nodes = nodes_of(p, cube->place.page);
    const bool end = ends_at(nodes, cube->level, cube->place.position);
    if (!end && seen.whole) {
        /* An earlier walk from another cube of this node found everything below the node. With
         * max_error_rad a cube that appears larger may need finer cells. Without it, only a benefit
         * more than four times as great is worth a second walk. */
        float *best = &nodes->seen[cube->level][cube->place.position];
        const double room = view->max_error_rad > 0 ? 1.0 : 4.0;
        if (seen.benefit <= (double)*best * room) {
            return;
        }
        *best = nextafterf((float)seen.benefit, 0.0F);
    }
    p->pages[cube->place.page].benefit += seen.benefit;
    if (end) {
        return;
    }
    const struct umb__expanded_level *level = &nodes->level[cube->level];
    const uint16_t mask = level->masks[cube->place.position];
    const uint32_t *child = level->children + level->first[cube->place.position];
    for (unsigned c = 0; c < 8; c++) {
        if (umb__mask_state(mask, c) == UMB__NODE_MIXED) {
            const struct cube part = part_of(
                cube, c, umb__expanded_child(nodes, cube->place.page, cube->level, *child++));
            walk_cube(w, &part, seen.benefit);
        }
    }
}

static void walk_roots(struct umb_partial *p, const struct umb__sight *sight)
{
    const struct umb__content *content = &p->canonical.content;
    const uint32_t light = sight->view->light;
    struct umb__space space;
    const uint64_t limit = STEPS_MIN + STEPS_A_NODE * p->node_count;
    struct walk w = {.p = p, .sight = sight, .space = &space, .steps = limit};
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb__packed_root *root = &p->canonical.roots[i];
        if (root->state == UMB__NODE_MIXED &&
            (light == UINT32_MAX || content->frusta[i].light == light)) {
            const struct cube cube = {
                content->frusta[i].log2_size, 0, 0, 0, {root->page, root->position}};
            umb__space_init(&space, content, i, sight->view);
            walk_cube(&w, &cube, ROOT_BENEFIT);
        }
    }
    p->want_steps = limit - w.steps;
    if (w.steps == 0) {
        want_marked(p);
    }
}

static void forget(struct umb_partial *p)
{
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        p->pages[page].benefit = 0;
    }
}

/* Forgets the cubes that earlier walks saw. */
static void forget_cubes(const struct umb_partial *p)
{
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        const struct umb__expanded *nodes = nodes_of(p, page);
        for (size_t l = UMB_LEVEL_BRICK + 1; nodes && l <= UMB_LEVEL_MAX; l++) {
            const size_t count = nodes->level[l].count;
            if (count > 0) {
                memset(nodes->seen[l], 0, count * sizeof *nodes->seen[l]);
            }
        }
    }
}

enum umb_status umb_partial_want(struct umb_partial *p, const struct umb_partial_view *view,
                                 int add, struct umb_error *error)
{
    struct umb__sight sight;
    if (view && UMB__UNKNOWN(view, "view", error)) {
        return UMB_E_ARGUMENT;
    }
    p->heap_fresh = false;
    if (!add) {
        forget(p);
    }
    if (!view) {
        return UMB_OK;
    }
    if (!p->built) {
        return umb_fail(error, UMB_E_STATE, "partial asset: nothing is built yet");
    }
    const struct umb__content *content = &p->canonical.content;
    if (view->light != UINT32_MAX && view->light >= content->light_count) {
        return umb_fail(error, UMB_E_ARGUMENT, UMB__NO_LIGHT, view->light,
                        content->light_count - 1);
    }
    UMB__TRY(umb__sight_init(&sight, view, error));
    forget_cubes(p);
    walk_roots(p, &sight);
    return UMB_OK;
}

/* Returns the benefit per stored byte of a missing page; 0: a held page, or no benefit. */
static double worth(const struct umb_partial *p, uint32_t page)
{
    const struct umb__held *held = &p->pages[page];
    return held->stored || !(held->benefit > 0) || !umb__partial_knows(p, page)
               ? 0
               : held->benefit / (umb__directory_load(&p->head, page).stored_length + 64.0);
}

size_t umb_partial_missing(const struct umb_partial *p, uint32_t *list, size_t room,
                           uint64_t budget_bytes)
{
    size_t count = 0;
    for (uint32_t page = 0; page < p->head.page_count && room > 0; page++) {
        const double value = worth(p, page);
        if (!(value > 0) || (count == room && !(value > worth(p, list[count - 1])))) {
            continue;
        }
        size_t low = 0, high = count; /* First page of less benefit; equal ones keep their order */
        while (low < high) {
            const size_t middle = low + (high - low) / 2;
            if (worth(p, list[middle]) < value) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        count += count < room;
        memmove(list + low + 1, list + low, (count - 1 - low) * sizeof *list);
        list[low] = page;
    }
    uint64_t bytes = 0;
    for (size_t i = 0; i < count && budget_bytes > 0; i++) {
        bytes += umb__directory_load(&p->head, list[i]).stored_length;
        if (bytes > budget_bytes) {
            return i;
        }
    }
    return count;
}

size_t umb_partial_missing_blocks(const struct umb_partial *p, int all, uint32_t *list, size_t room)
{
    size_t count = 0;
    for (uint32_t block = 0; block < p->head.directory_count && count < room; block++) {
        const uint32_t first = block * UMB__BLOCK_PAGES, rest = p->head.page_count - first;
        bool wanted = all != 0;
        for (uint32_t i = 0; i < UMB__BLOCK_PAGES && i < rest && !wanted; i++) {
            wanted = p->pages[first + i].benefit > 0;
        }
        const uint32_t read = wanted && !p->blocks[block] ? umb__spares_before(p, block) : block;
        if (wanted && !p->blocks[read] && (count == 0 || list[count - 1] != read)) {
            list[count++] = read;
        }
    }
    return count;
}

/* A box of voxels during its walk through the graph. */
struct look {
    struct umb_partial *p;
    const uint32_t *low, *high;
    bool want;
    struct umb__lack lack;
};

static double occupancy_of(uint16_t mask)
{
    const unsigned lit = (unsigned)__builtin_popcount(mask & 0x5555U);
    return (lit + 0.5 * umb__mask_mixed_count(mask)) / 8.0;
}

/* In: above: lit share of the cube's parent node. */
static void look_cube(struct look *l, const struct cube *cube, double above)
{
    const uint32_t at[3] = {cube->x, cube->y, cube->z}, last = (1U << cube->level) - 1;
    for (unsigned i = 0; i < 3; i++) {
        if (at[i] > l->high[i] || at[i] + last < l->low[i]) {
            return;
        }
    }
    const struct umb__expanded *nodes = nodes_of(l->p, cube->place.page);
    if (!nodes) {
        if (cube->level > l->lack.level) {
            l->lack = (struct umb__lack){cube->level, above};
        }
        if (l->want) { /* Without `want`, other threads may read the graph at the same time */
            l->p->heap_fresh = false;
            l->p->pages[cube->place.page].benefit += 1;
        }
        return;
    }
    if (cube->level == UMB_LEVEL_BRICK) {
        return;
    }
    const struct umb__expanded_level *level = &nodes->level[cube->level];
    const uint16_t mask = level->masks[cube->place.position];
    const uint32_t *child = level->children + level->first[cube->place.position];
    for (unsigned c = 0; c < 8; c++) {
        if (umb__mask_state(mask, c) == UMB__NODE_MIXED) {
            const struct cube part = part_of(
                cube, c, umb__expanded_child(nodes, cube->place.page, cube->level, *child++));
            look_cube(l, &part, occupancy_of(mask));
        }
    }
}

struct umb__lack umb__partial_look(struct umb_partial *p, uint32_t frustum, const uint32_t low[3],
                                   const uint32_t high[3], bool want)
{
    struct look l = {.p = p, .low = low, .high = high, .want = want};
    const struct umb__packed_root *root = &p->canonical.roots[frustum];
    if (root->state == UMB__NODE_MIXED) {
        const uint32_t level = p->canonical.content.frusta[frustum].log2_size;
        const struct cube cube = {level, 0, 0, 0, {root->page, root->position}};
        look_cube(&l, &cube, 0.5);
    }
    return l.lack;
}
