/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_FILTERS_H
#define UMBRAGE_TESTS_BENCH_FILTERS_H
#include "bench_points.h"

/* Races filters of the product against its own boxes, over surface points with normals, and prints
 * the rows: footprints of the overview's pixels over a box of 9 taps; tents over boxes of 9 and of
 * 17 taps. In: name: the case that the rows name. */
void bench_filters_race(const char *name, const struct bench_scene *scene,
                        const struct bench_asset *asset, const struct bench_points *points);

#endif
