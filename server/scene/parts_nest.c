/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Containment among boxes: an implicit balanced tree by the box centres, with one union box for
 * each node. A query descends only into nodes whose union contains the box asked for. Many small
 * solids side by side (a city) answer in O(log n); boxes that overlap without containing one
 * another cost more, up to a limit: a file could otherwise ask for all pairs of its parts.
 */
#include "scene/parts_nest.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

static int box_inside(const struct umb_box *inner, const struct umb_box *outer)
{
    for (int i = 0; i < 3; i++) {
        if (!(inner->min[i] >= outer->min[i] && inner->max[i] <= outer->max[i])) {
            return 0;
        }
    }
    return 1;
}

static void box_add(struct umb_box *box, const struct umb_box *other)
{
    for (int i = 0; i < 3; i++) {
        box->min[i] = other->min[i] < box->min[i] ? other->min[i] : box->min[i];
        box->max[i] = other->max[i] > box->max[i] ? other->max[i] : box->max[i];
    }
}

static int compare_on_axis(const struct umb_box *a, const struct umb_box *b, int axis)
{
    double ca = 0.5 * a->min[axis] + 0.5 * a->max[axis];
    double cb = 0.5 * b->min[axis] + 0.5 * b->max[axis];
    return (ca > cb) - (ca < cb);
}

static int compare_x(const void *a, const void *b)
{
    return compare_on_axis(a, b, 0);
}

static int compare_y(const void *a, const void *b)
{
    return compare_on_axis(a, b, 1);
}

static int compare_z(const void *a, const void *b)
{
    return compare_on_axis(a, b, 2);
}

/* Sorts [first, last) on the axis of this depth and recurses; the depth is log2(count). */
static void build(struct umbs_nest *nest, size_t first, size_t last, int axis)
{
    static int (*const compare[3])(const void *, const void *) = {compare_x, compare_y, compare_z};
    if (first >= last) {
        return;
    }
    qsort(nest->boxes + first, last - first, sizeof *nest->boxes, compare[axis]);
    size_t middle = first + (last - first) / 2;
    struct umb_box all = nest->boxes[first];
    for (size_t i = first + 1; i < last; i++) {
        box_add(&all, &nest->boxes[i]);
    }
    nest->unions[middle] = all;
    build(nest, first, middle, (axis + 1) % 3);
    build(nest, middle + 1, last, (axis + 1) % 3);
}

static int holds(const struct umbs_nest *nest, size_t first, size_t last, const struct umb_box *box,
                 unsigned *steps)
{
    if (first >= last) {
        return 0;
    }
    if ((*steps)++ == UMBS_NEST_STEPS_MAX) {
        return 1;
    }
    size_t middle = first + (last - first) / 2;
    if (!box_inside(box, &nest->unions[middle])) {
        return 0;
    }
    return box_inside(box, &nest->boxes[middle]) || holds(nest, first, middle, box, steps) ||
           holds(nest, middle + 1, last, box, steps);
}

int umbs_nest_init(struct umbs_nest *nest, const struct umb_box *boxes, size_t count)
{
    *nest = (struct umbs_nest){0};
    if (count == 0) {
        return 1;
    }
    nest->boxes = umb__alloc(NULL, count, sizeof *nest->boxes);
    nest->unions = umb__alloc(NULL, count, sizeof *nest->unions);
    if (nest->boxes == NULL || nest->unions == NULL) {
        umbs_nest_finish(nest);
        return 0;
    }
    memcpy(nest->boxes, boxes, count * sizeof *boxes);
    nest->count = count;
    build(nest, 0, count, 0);
    return 1;
}

void umbs_nest_finish(struct umbs_nest *nest)
{
    umb__free(NULL, nest->boxes);
    umb__free(NULL, nest->unions);
    *nest = (struct umbs_nest){0};
}

int umbs_nest_holds(const struct umbs_nest *nest, const struct umb_box *box)
{
    unsigned steps = 0;
    return holds(nest, 0, nest->count, box, &steps);
}
