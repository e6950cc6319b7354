/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_POISSON_H
#define UMBRAGE_CORE_MAPS_MAP_POISSON_H
#include <stdint.h>

/*
 * Fills `count` points of a disc of radius 1 that keep apart from one another: each is the
 * candidate farthest from those before it. The first n of any count are the same points.
 * The same bits on every machine: integers, products and sums only.
 * Source: Mitchell 1991 (best candidate).
 */
void umb__poisson_disc(double (*points)[2], uint32_t count);

#endif
