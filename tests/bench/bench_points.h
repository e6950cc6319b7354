/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_POINTS_H
#define UMBRAGE_TESTS_BENCH_POINTS_H
/*
 * The points of the query rows, the same for every party: floats relative to the asset's origin,
 * already moved off their surface, so that nobody's time has the bias in it.
 *
 *   gbuffer  what a fitted camera of 1280x720 pixels sees and the sun does not shine at from
 *            behind, in blocks of 4x2 pixels (packets of eight rays are then as coherent as they
 *            can be); moved as the product's automatic bias would move it for `taps`
 *   random   random surface points outside closed parts that face the sun, moved by the same bias
 *            and up to four voxels more, in random order
 */
#include "bench_scene.h"

struct bench_points {
    const char *name; /* "gbuffer" or "random" */
    size_t count;
    float *at[3]; /* [3 * count] for 1, 9 and 17 taps */
};

extern const int bench_taps[3];

/* Both need bench_scene_trace. */
void bench_points_gbuffer(const struct bench_scene *scene, struct bench_points *points);
void bench_points_random(const struct bench_scene *scene, size_t count,
                         struct bench_points *points);
void bench_points_finish(struct bench_points *points);

#endif
