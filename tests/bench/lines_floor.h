/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_LINES_FLOOR_H
#define UMBRAGE_TESTS_LINES_FLOOR_H
/*
 * The least time of any kernel that answers single points from the mapped layout: the time to read
 * the cache lines that the points' descents touch. Addresses are known beforehand, lines are
 * prefetched 64 ahead, and nothing is computed. A kernel learns an address from the line before, so
 * it can only be slower; where points share lines, which scattered ones do not, it need not read as
 * many.
 */
#include <stddef.h>
#include "umbrage/query.h"

struct lines_floor {
    const unsigned char **lines; /* [count], in the order of points */
    size_t count;
};

/* Most lines of one point: a piece, two of each node, a brick. */
#define LINES_FLOOR_MAX 20U

/* Lists the cache lines of a batch. In: lines: room for LINES_FLOOR_MAX a point. */
void lines_floor_note(const struct umb_query *query, const struct umb_points *points,
                      struct lines_floor *floor);

/* Reads the lines. Returns an unused value, so that compilers do not drop the reads. */
unsigned lines_floor_read(const struct lines_floor *floor);

#endif
