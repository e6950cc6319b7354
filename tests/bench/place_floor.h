/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_PLACE_FLOOR_H
#define UMBRAGE_TESTS_PLACE_FLOOR_H
/*
 * The least time of any data structure that answers shadows: points are read and moved to voxel
 * space by the product's own steps, and answers are written, but nothing is looked up. What a ray
 * costs over this is the most that any data structure could reach.
 */
#include "umbrage/query.h"

/* One tap, answers as floats; they mean nothing. With AVX2. */
void place_floor_avx2(const struct umb_query *query, const struct umb_points *points,
                      float *answers);

/* The same with AVX-512. */
void place_floor_avx512(const struct umb_query *query, const struct umb_points *points,
                        float *answers);

#endif
