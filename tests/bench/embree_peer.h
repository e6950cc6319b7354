/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_EMBREE_PEER_H
#define UMBRAGE_TESTS_EMBREE_PEER_H
/*
 * The peer of the ray rows: Embree at its best. Indexed triangles in floats about the origin,
 * high-quality tree, no robust mode, denormals flushed, packets filled in the caller's order.
 */
#include "bench_scene.h"

struct embree_peer; /* opaque */

/* In: light_space: 1 builds the triangles in voxel space, where the light travels along +z. */
struct embree_peer *embree_peer_make(const struct bench_scene *scene, int light_space);
void embree_peer_destroy(struct embree_peer *peer);

enum embree_way {
    EMBREE_ONE = 0,          /* rtcOccluded1 */
    EMBREE_EIGHT,            /* rtcOccluded8, incoherent */
    EMBREE_EIGHT_COHERENT,   /* rtcOccluded8, coherent */
    EMBREE_SIXTEEN,          /* rtcOccluded16, incoherent */
    EMBREE_SIXTEEN_COHERENT, /* rtcOccluded16, coherent */
    EMBREE_WAYS,
};

/* Traces a ray from each point towards the light; answers are 1 (lit) or 0. In: float[3 * count],
 * relative to the origin. */
struct embree_query {
    const struct embree_peer *peer;
    const float *points;
    size_t count;
    float to_light[3]; /* unit */
    enum embree_way way;
    float *answers; /* [count] */
};

void embree_run(const struct embree_query *query);

/* Tries the ways whose bits 1 << way are set in `ways`, and chooses the fastest. */
void embree_tune(struct embree_query *query, unsigned ways);

/*
 * Finds the nearest depth of each texel of a window of n x n texels from (x0, y0), with packets of
 * eight coherent rays for 4x2 texels. Rays are traced only where `covered` (n * n bytes) is 1.
 * Returns the number of rays that hit. In: a peer in light space. n: a multiple of 4.
 */
size_t embree_depth_window(const struct embree_peer *peer, int32_t x0, int32_t y0, int32_t n,
                           const uint8_t *covered, float *depth);

#endif
