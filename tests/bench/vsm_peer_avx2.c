/* SPDX-License-Identifier: Apache-2.0 */
/* See vsm_peer.h. Compiled with -O3: the loops over rows become vectors. */
#include "vsm_peer.h"

#include <immintrin.h>
#include <math.h>
#include <string.h>

#define SIDE_MAX     4096
#define TAPS_MAX     17
#define MIN_VARIANCE 1e-7F

/* Sums `taps` neighbours along a row by doubling: sums of 2, 4, 8 and 16, then one more. The row is
 * padded by the value beyond the map on both sides. */
static void row_blur(const float *from, int side, int taps, float beyond, float *to)
{
    float a[SIDE_MAX + 2 * TAPS_MAX], b[SIDE_MAX + 2 * TAPS_MAX];
    const int half = taps / 2;
    int end = side + 2 * half;
    for (int i = 0; i < half; i++) {
        a[i] = a[side + half + i] = beyond;
    }
    memcpy(a + half, from, (size_t)side * sizeof *a);
    memcpy(b, a, (size_t)end * sizeof *a);
    for (int width = 1; 2 * width < taps; width *= 2) {
        end -= width;
        for (int i = 0; i < end; i++) {
            b[i] += b[i + width]; /* reads ahead of what it writes */
        }
    }
    const float share = 1.0F / (float)taps;
    for (int i = 0; i < side; i++) {
        to[i] = (b[i] + a[i + taps - 1]) * share;
    }
}

/* Adds rows as a running sum down the image. */
static void columns_blur(const float *from, int side, int taps, float beyond, float *to)
{
    float sums[SIDE_MAX];
    const int half = taps / 2;
    const float share = 1.0F / (float)taps;
    for (int x = 0; x < side; x++) {
        sums[x] = beyond * (float)(half + 1);
    }
    for (int y = 0; y < half; y++) {
        for (int x = 0; x < side; x++) {
            sums[x] += from[(size_t)y * (size_t)side + (size_t)x];
        }
    }
    for (int y = 0; y < side; y++) {
        const float *in = y + half < side ? from + (size_t)(y + half) * (size_t)side : NULL;
        const float *out = y > half ? from + (size_t)(y - half - 1) * (size_t)side : NULL;
        float *at = to + (size_t)y * (size_t)side;
        for (int x = 0; x < side; x++) {
            sums[x] += (in != NULL ? in[x] : beyond) - (out != NULL ? out[x] : beyond);
            at[x] = sums[x] * share;
        }
    }
}

void vsm_peer_blur(struct vsm_peer *vsm, int taps)
{
    const size_t side = (size_t)vsm->side;
    float squares[SIDE_MAX];
    for (size_t y = 0; y < side; y++) {
        const float *depth = vsm->depth + y * side;
        for (size_t x = 0; x < side; x++) {
            squares[x] = depth[x] * depth[x];
        }
        row_blur(depth, vsm->side, taps, 1.0F, vsm->rows[0] + y * side);
        row_blur(squares, vsm->side, taps, 1.0F, vsm->rows[1] + y * side);
    }
    columns_blur(vsm->rows[0], vsm->side, taps, 1.0F, vsm->moments[0]);
    columns_blur(vsm->rows[1], vsm->side, taps, 1.0F, vsm->moments[1]);
}

/* Eight moments between four texels each. */
static inline __m256 between(const float *plane, __m256i at, __m256i row, __m256 fx, __m256 fy)
{
    const __m256i below = _mm256_add_epi32(at, row), one = _mm256_set1_epi32(1);
    const __m256 a = _mm256_i32gather_ps(plane, at, 4);
    const __m256 b = _mm256_i32gather_ps(plane, _mm256_add_epi32(at, one), 4);
    const __m256 c = _mm256_i32gather_ps(plane, below, 4);
    const __m256 d = _mm256_i32gather_ps(plane, _mm256_add_epi32(below, one), 4);
    const __m256 ab = _mm256_add_ps(a, _mm256_mul_ps(fx, _mm256_sub_ps(b, a)));
    const __m256 cd = _mm256_add_ps(c, _mm256_mul_ps(fx, _mm256_sub_ps(d, c)));
    return _mm256_add_ps(ab, _mm256_mul_ps(fy, _mm256_sub_ps(cd, ab)));
}

static inline __m256 coordinate(const struct peer_place *place, int row, const __m256 p[3])
{
    __m256 at = _mm256_set1_ps(place->m[row][3]);
    for (int k = 0; k < 3; k++) {
        at = _mm256_add_ps(at, _mm256_mul_ps(_mm256_set1_ps(place->m[row][k]), p[k]));
    }
    return at;
}

/* Texel and share of an axis, clamped to the map. */
static inline __m256i axis_split(__m256 at, int side, __m256 *share)
{
    const __m256 low = _mm256_setzero_ps(), high = _mm256_set1_ps((float)side - 1.001F);
    at = _mm256_sub_ps(at, _mm256_set1_ps(0.5F));
    at = _mm256_min_ps(_mm256_max_ps(at, low), high);
    const __m256i texel = _mm256_cvttps_epi32(at);
    *share = _mm256_sub_ps(at, _mm256_cvtepi32_ps(texel));
    return texel;
}

static __m256 eight_ask(const struct vsm_peer *vsm, const struct peer_place *place,
                        const float *points)
{
    const __m256i triples = _mm256_setr_epi32(0, 3, 6, 9, 12, 15, 18, 21);
    const __m256 p[3] = {_mm256_i32gather_ps(points, triples, 4),
                         _mm256_i32gather_ps(points + 1, triples, 4),
                         _mm256_i32gather_ps(points + 2, triples, 4)};
    const __m256i row = _mm256_set1_epi32(vsm->side);
    __m256 fx, fy;
    const __m256i x = axis_split(coordinate(place, 0, p), vsm->side, &fx);
    const __m256i y = axis_split(coordinate(place, 1, p), vsm->side, &fy);
    const __m256 depth = coordinate(place, 2, p);
    const __m256i at = _mm256_add_epi32(_mm256_mullo_epi32(y, row), x);
    const __m256 mean = between(vsm->moments[0], at, row, fx, fy);
    const __m256 square = between(vsm->moments[1], at, row, fx, fy);
    const __m256 variance = _mm256_max_ps(_mm256_sub_ps(square, _mm256_mul_ps(mean, mean)),
                                          _mm256_set1_ps(MIN_VARIANCE));
    const __m256 distance = _mm256_max_ps(_mm256_sub_ps(depth, mean), _mm256_setzero_ps());
    return _mm256_div_ps(variance, _mm256_add_ps(variance, _mm256_mul_ps(distance, distance)));
}

void vsm_peer_ask(const struct vsm_peer *vsm, const struct peer_place *place, const float *points,
                  size_t count, float *answers)
{
    size_t i = 0;
    for (; i + 8 <= count; i += 8) {
        _mm256_storeu_ps(answers + i, eight_ask(vsm, place, points + 3 * i));
    }
    if (i < count) {
        float rest[24] = {0}, last[8];
        memcpy(rest, points + 3 * i, 3 * (count - i) * sizeof *rest);
        _mm256_storeu_ps(last, eight_ask(vsm, place, rest));
        memcpy(answers + i, last, (count - i) * sizeof *last);
    }
}

float depth16_ask(const uint16_t *texels, int side, const struct peer_place *place,
                  const float point[3])
{
    float at[3];
    for (int row = 0; row < 3; row++) {
        const float *m = place->m[row];
        at[row] = m[0] * point[0] + m[1] * point[1] + m[2] * point[2] + m[3];
    }
    const float most = (float)side - 1.001F;
    const float x = fminf(fmaxf(at[0] - 0.5F, 0.0F), most);
    const float y = fminf(fmaxf(at[1] - 0.5F, 0.0F), most);
    const int x0 = (int)x, y0 = (int)y;
    const float fx = x - (float)x0, fy = y - (float)y0, depth = at[2] * 65535.0F;
    const uint16_t *t = texels + (size_t)y0 * (size_t)side + (size_t)x0;
    const float a = (float)((float)t[0] >= depth), b = (float)((float)t[1] >= depth);
    const float c = (float)((float)t[side] >= depth), d = (float)((float)t[side + 1] >= depth);
    const float ab = a + fx * (b - a), cd = c + fx * (d - c);
    return ab + fy * (cd - ab);
}
