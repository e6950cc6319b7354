/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_MAP16_H
#define UMBRAGE_TESTS_BENCH_MAP16_H
/* The shadow map that the query rows race (study/shadow_map16.h), drawn by the rasteriser. */
#include "bench_scene.h"
#include "study/shadow_map16.h"

/* Draws the map; 1 GiB for 16384 texels a side. */
void bench_map16_make(struct umbt_map16 *map, const struct bench_scene *scene);

#endif
