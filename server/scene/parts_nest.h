/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_PARTS_NEST_H
#define UMBRAGE_SERVER_SCENE_PARTS_NEST_H
/* Test whether a box lies inside one of many boxes, without a comparison with each of them. */
#include <stddef.h>
#include "umbrage/geom.h"

/* Binary tree in the order of `boxes`: the node [first, last) is split at its middle. */
struct umbs_nest {
    struct umb_box *boxes;  /* [count] copies of the boxes, in the order of the tree */
    struct umb_box *unions; /* [count] box around all boxes of the node with that middle */
    size_t count;
};

/*
 * Builds the tree and copies the boxes. Returns 0 if memory is short. Cost: O(count log count), 96
 * bytes a box.
 */
int umbs_nest_init(struct umbs_nest *nest, const struct umb_box *boxes, size_t count);
void umbs_nest_finish(struct umbs_nest *nest);

/* Greatest number of nodes that a query visits. Cities and forests need a few dozen. */
#define UMBS_NEST_STEPS_MAX 4096U

/*
 * Returns 1 if the box lies inside (touching allowed) at least one of the tree's boxes. Also
 * returns 1 if this is not known after UMBS_NEST_STEPS_MAX steps, because then no part is turned
 * around.
 */
int umbs_nest_holds(const struct umbs_nest *nest, const struct umb_box *box);

#endif
