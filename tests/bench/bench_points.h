/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_POINTS_H
#define UMBRAGE_TESTS_BENCH_POINTS_H
/*
 * The points of the query rows, the same for every party: floats relative to the asset's origin,
 * already moved off their surface, so that no measured time includes the bias.
 *
 *   gbuffer
 *       a picture of 1920x1080 pixels from inside the scene: at eye height in a street of the city,
 *       30 m above a slope of the terrain; the visible points that face the sun, in blocks of 4x2
 *       pixels (packets of eight rays are then as coherent as they can be); moved
 *       as the product's automatic bias would move it for `taps`
 *   gbuffer-overview
 *       the same of a camera that has the whole scene in 1280x720 pixels, a dozen voxels apart
 *   random
 *       random surface points outside closed parts that face the sun, moved by the same bias and
 *       up to four voxels more, in random order
 */
#include "bench_scene.h"
#include "study/camera.h"

struct bench_points {
    const char *name; /* "gbuffer", "gbuffer-overview" or "random" */
    size_t count;
    float *at[3]; /* [3 * count] for 1, 9 and 17 taps */
    /* [3 * count] before the bias, for parties that apply the bias themselves */
    float *surface, *normals;
    struct umbt_camera camera; /* of a picture */
};

extern const int bench_taps[3];

enum bench_view {
    BENCH_VIEW_INSIDE,
    BENCH_VIEW_OVERVIEW
};

/* Both need bench_scene_trace. */
void bench_points_gbuffer(const struct bench_scene *scene, enum bench_view view,
                          struct bench_points *points);
void bench_points_random(const struct bench_scene *scene, size_t count,
                         struct bench_points *points);
void bench_points_finish(struct bench_points *points);

#endif
