/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_VSM_PEER_H
#define UMBRAGE_TESTS_VSM_PEER_H
/*
 * Two shadow maps as a renderer computes them for each picture, in floats with AVX2: a variance
 * shadow map with its separable box blur (Donnelly, Lauritzen 2006), and a 16-bit map that is
 * compared at
 * 2 x 2 texels with bilinear weights, as graphics hardware does.
 *
 * Machine: AVX2.
 */
#include <stddef.h>
#include <stdint.h>

/* Affine transform of a point, less the origin, to texels and depth 0..1. */
struct peer_place {
    float m[3][4];
};

struct vsm_peer {
    int side;
    float *depth;      /* [side * side], 0..1 */
    float *moments[2]; /* [side * side] mean and mean square of depth, blurred */
    float *rows[2];    /* [side * side] blurred along x */
};

/* Makes the moments of all depths and blurs them with a box of `taps` x `taps` texels: 9 or 17. */
void vsm_peer_blur(struct vsm_peer *vsm, int taps);

/* Answers points from bilinear moments by Chebyshev's bound. In: points: float[3 * count]. */
void vsm_peer_ask(const struct vsm_peer *vsm, const struct peer_place *place, const float *points,
                  size_t count, float *answers);

/* Answers points one by one from 16-bit depths, by 2 x 2 comparisons with bilinear weights. In:
 * texels: row by row. */
float depth16_ask(const uint16_t *texels, int side, const struct peer_place *place,
                  const float point[3]);

#endif
