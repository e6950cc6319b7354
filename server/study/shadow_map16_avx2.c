/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Queries of the 16-bit shadow map, for AVX2; see shadow_map16.h.
 *
 * A ring holds the texel and the depth of the next points: a block of points is transformed while
 * the texels of the block before are being fetched. The transform does the same operations in the
 * same order as umbrage's own, so both look up the same voxel.
 */
#include "study/shadow_map16.h"

#ifdef __AVX2__
#include <immintrin.h>

#define BLOCK 128U /* points transformed at a time; at least UMBT_MAP16_AHEAD_MAX */
#define RING  (4U * BLOCK)

struct ring {
    int32_t x[RING], y[RING], z[RING]; /* x, y: of the window's centre, padding included */
};

/* Applies row k of the transform to four points. The order of the sum is umbrage's own. */
static __m256d transform(const double m[4], __m256d x, __m256d y, __m256d z)
{
    __m256d sum = _mm256_mul_pd(_mm256_set1_pd(m[0]), x);
    sum = _mm256_add_pd(sum, _mm256_mul_pd(_mm256_set1_pd(m[1]), y));
    sum = _mm256_add_pd(sum, _mm256_mul_pd(_mm256_set1_pd(m[2]), z));
    return _mm256_add_pd(sum, _mm256_set1_pd(m[3]));
}

/* Floor, clamped to low..high, plus add. */
static __m128i cell(__m256d v, double low, double high, int32_t add)
{
    v = _mm256_max_pd(_mm256_min_pd(_mm256_floor_pd(v), _mm256_set1_pd(high)), _mm256_set1_pd(low));
    return _mm_add_epi32(_mm256_cvttpd_epi32(v), _mm_set1_epi32(add));
}

/* Transforms four points, which are twelve floats. */
static void transform_four(const struct umbt_map16 *map, const float *points, struct ring *ring,
                           size_t at)
{
    const __m128 a = _mm_loadu_ps(points), b = _mm_loadu_ps(points + 4);
    const __m128 c = _mm_loadu_ps(points + 8);
    /* a = x0 y0 z0 x1, b = y1 z1 x2 y2, c = z2 x3 y3 z3 */
    const __m128 x23 = _mm_shuffle_ps(b, c, _MM_SHUFFLE(1, 1, 2, 2)); /* x2 x2 x3 x3 */
    const __m128 px = _mm_shuffle_ps(a, x23, _MM_SHUFFLE(2, 0, 3, 0));
    const __m128 y01 = _mm_shuffle_ps(a, b, _MM_SHUFFLE(0, 0, 1, 1)); /* y0 y0 y1 y1 */
    const __m128 y23 = _mm_shuffle_ps(b, c, _MM_SHUFFLE(2, 2, 3, 3)); /* y2 y2 y3 y3 */
    const __m128 py = _mm_shuffle_ps(y01, y23, _MM_SHUFFLE(2, 0, 2, 0));
    const __m128 z01 = _mm_shuffle_ps(a, b, _MM_SHUFFLE(1, 1, 2, 2)); /* z0 z0 z1 z1 */
    const __m128 pz = _mm_shuffle_ps(z01, c, _MM_SHUFFLE(3, 0, 2, 0));
    const __m256d x = _mm256_cvtps_pd(px), y = _mm256_cvtps_pd(py), z = _mm256_cvtps_pd(pz);
    const double border = UMBT_MAP16_PAD / 2, size = (double)map->size;
    /* Windows around the middle of the padding are lit throughout: far points are clamped there. */
    _mm_storeu_si128((__m128i *)(void *)(ring->x + at),
                     cell(transform(map->m[0], x, y, z), -border, size + border, UMBT_MAP16_PAD));
    _mm_storeu_si128((__m128i *)(void *)(ring->y + at),
                     cell(transform(map->m[1], x, y, z), -border, size + border, UMBT_MAP16_PAD));
    _mm_storeu_si128((__m128i *)(void *)(ring->z + at),
                     cell(transform(map->m[2], x, y, z), -1.0, size - 1.0, 0));
}

static void block_transform(const struct umbt_map16_query *query, size_t first, struct ring *ring)
{
    const size_t last = first + BLOCK < query->count ? first + BLOCK : query->count;
    size_t i = first;
    for (; i + 4 <= last; i += 4) {
        transform_four(query->map, query->points + 3 * i, ring, i % RING);
    }
    if (i < last) {
        float rest[12] = {0};
        for (size_t k = 0; k < 3 * (last - i); k++) {
            rest[k] = query->points[3 * i + k];
        }
        transform_four(query->map, rest, ring, i % RING);
    }
}

static int row_lanes_sum(__m256i sum, int lanes)
{
    const __m256i lane = _mm256_setr_epi16(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    sum = _mm256_and_si256(sum, _mm256_cmpgt_epi16(_mm256_set1_epi16((int16_t)lanes), lane));
    sum = _mm256_madd_epi16(sum, _mm256_set1_epi16(-1));
    __m128i four = _mm_add_epi32(_mm256_castsi256_si128(sum), _mm256_extracti128_si256(sum, 1));
    four = _mm_add_epi32(four, _mm_shuffle_epi32(four, _MM_SHUFFLE(1, 0, 3, 2)));
    four = _mm_add_epi32(four, _mm_shuffle_epi32(four, _MM_SHUFFLE(2, 3, 0, 1)));
    return _mm_cvtsi128_si32(four);
}

/* Lit texels of a window over rows, from its first texel. */
static inline int rows_count(const uint16_t *texel, size_t side, int taps, int32_t z)
{
    const __m256i depth = _mm256_set1_epi16((int16_t)z);
    __m256i sum = _mm256_setzero_si256();
    int more = 0;
    for (int row = 0; row < taps; row++, texel += side) {
        const __m256i texels = _mm256_loadu_si256((const __m256i *)(const void *)texel);
        sum = _mm256_add_epi16(sum, _mm256_cmpgt_epi16(texels, depth));
        if (taps == 17) {
            more += (int32_t)texel[16] > z;
        }
    }
    return row_lanes_sum(sum, taps) + more;
}

/* Does the work of rows_count in plain C; the compiler turns the inner loop into vectors. */
static inline int plain_count(const uint16_t *texel, size_t side, int taps, int32_t z)
{
    const int16_t depth = (int16_t)z;
    int count = 0;
    for (int row = 0; row < taps; row++, texel += side) {
        int16_t lit = 0;
        for (int column = 0; column < taps; column++) {
            lit = (int16_t)(lit + ((int16_t)texel[column] > depth));
        }
        count += lit;
    }
    return count;
}

/* Returns a mask of the columns of tile `t` within x0 .. x1, as eight lanes of 16 bits. */
static __m128i column_mask(int32_t x0, int32_t x1, int32_t t)
{
    const __m128i column =
        _mm_add_epi16(_mm_setr_epi16(0, 1, 2, 3, 4, 5, 6, 7), _mm_set1_epi16((int16_t)(8 * t)));
    return _mm_and_si128(_mm_cmpgt_epi16(column, _mm_set1_epi16((int16_t)(x0 - 1))),
                         _mm_cmpgt_epi16(_mm_set1_epi16((int16_t)(x1 + 1)), column));
}

/* Counts lit texels of a window from its corner (x, y), over tiles whose rows are eight lanes. */
static inline int tiles_count(const struct umbt_map16 *map, int32_t x, int32_t y, int taps,
                              int32_t z)
{
    const __m128i depth = _mm_set1_epi16((int16_t)z);
    const size_t across = (size_t)map->side >> 3;
    const int32_t first = x & 7, last = first + taps - 1;
    __m128i masks[4];
    const int columns = (last >> 3) + 1; /* tiles that the window crosses: 2 or 3, never 4 */
    for (int t = 0; t < columns; t++) {
        masks[t] = column_mask(first, last, t);
    }
    __m128i sum = _mm_setzero_si128();
    for (int32_t row = y; row < y + taps; row++) {
        const uint16_t *line = map->tiles + (((size_t)row >> 2) * across + ((size_t)x >> 3)) * 32 +
                               ((size_t)row & 3) * 8;
        for (int t = 0; t < columns; t++) {
            const __m128i texels =
                _mm_loadu_si128((const __m128i *)(const void *)(line + 32 * (size_t)t));
            sum = _mm_add_epi16(sum, _mm_and_si128(_mm_cmpgt_epi16(texels, depth), masks[t]));
        }
    }
    return row_lanes_sum(_mm256_inserti128_si256(_mm256_setzero_si256(), sum, 0), 16);
}

static inline const uint16_t *row_texel(const struct umbt_map16 *map, const struct ring *ring,
                                        size_t at, int half)
{
    return map->rows + (size_t)(ring->y[at] - half) * (size_t)map->side +
           (size_t)(ring->x[at] - half);
}

static inline void rows_prefetch(const struct umbt_map16 *map, const struct ring *ring, size_t at,
                                 int taps)
{
    const uint16_t *texel = row_texel(map, ring, at, taps / 2);
    for (int row = 0; row < taps; row++, texel += map->side) {
        _mm_prefetch((const char *)(const void *)texel, _MM_HINT_T0);
        if ((((uintptr_t)(const void *)texel + 2 * (size_t)taps - 1) ^
             (uintptr_t)(const void *)texel) &
            64) {
            _mm_prefetch((const char *)(const void *)(texel + taps - 1), _MM_HINT_T0);
        }
    }
}

static inline void tiles_prefetch(const struct umbt_map16 *map, const struct ring *ring, size_t at,
                                  int taps)
{
    const size_t across = (size_t)map->side >> 3;
    const size_t x = (size_t)(ring->x[at] - taps / 2), y = (size_t)(ring->y[at] - taps / 2);
    for (size_t ty = y >> 2; ty <= (y + (size_t)taps - 1) >> 2; ty++) {
        for (size_t tx = x >> 3; tx <= (x + (size_t)taps - 1) >> 3; tx++) {
            _mm_prefetch((const char *)(const void *)(map->tiles + (ty * across + tx) * 32),
                         _MM_HINT_T0);
        }
    }
}

static inline int window_count(const struct umbt_map16 *map, const struct ring *ring, size_t at,
                               int taps, enum umbt_map16_way way)
{
    const int half = taps / 2;
    if (way == UMBT_MAP16_TILES) {
        return tiles_count(map, ring->x[at] - half, ring->y[at] - half, taps, ring->z[at]);
    }
    const uint16_t *texel = row_texel(map, ring, at, half);
    if (taps == 1) {
        return (int32_t)texel[0] > ring->z[at];
    }
    return way == UMBT_MAP16_PLAIN ? plain_count(texel, (size_t)map->side, taps, ring->z[at])
                                   : rows_count(texel, (size_t)map->side, taps, ring->z[at]);
}

/* Runs a query. Inlined once for each window and way, so that both are constants inside. */
static inline __attribute__((always_inline)) void run(const struct umbt_map16_query *query,
                                                      int taps, enum umbt_map16_way way)
{
    const struct umbt_map16 *map = query->map;
    const float scale = (float)(taps * taps);
    struct ring ring;
    block_transform(query, 0, &ring);
    for (size_t first = 0; first < query->count; first += BLOCK) {
        const size_t last = first + BLOCK < query->count ? first + BLOCK : query->count;
        if (last < query->count) {
            block_transform(query, last, &ring);
        }
        for (size_t i = first; i < last; i++) {
            const size_t next = i + query->ahead;
            if (next < query->count) {
                if (way == UMBT_MAP16_TILES) {
                    tiles_prefetch(map, &ring, next % RING, taps);
                } else {
                    rows_prefetch(map, &ring, next % RING, taps);
                }
            }
            query->answers[i] = (float)window_count(map, &ring, i % RING, taps, way) / scale;
        }
    }
}

#define WAYS(TAPS)                                                                                 \
    case TAPS:                                                                                     \
        if (query->way == UMBT_MAP16_PLAIN) {                                                      \
            run(query, TAPS, UMBT_MAP16_PLAIN);                                                    \
        } else if (query->way == UMBT_MAP16_ROWS) {                                                \
            run(query, TAPS, UMBT_MAP16_ROWS);                                                     \
        } else {                                                                                   \
            run(query, TAPS, UMBT_MAP16_TILES);                                                    \
        }                                                                                          \
        break

void umbt_map16_run(const struct umbt_map16_query *query)
{
    switch (query->taps) {
        WAYS(1);
        WAYS(3);
        WAYS(5);
        WAYS(9);
        WAYS(17);
    default:
        break;
    }
}

int umbt_map16_supported(void)
{
    return __builtin_cpu_supports("avx2") != 0;
}

#else

void umbt_map16_run(const struct umbt_map16_query *query)
{
    (void)query;
}

int umbt_map16_supported(void)
{
    return 0;
}

#endif
