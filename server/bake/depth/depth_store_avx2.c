/* SPDX-License-Identifier: Apache-2.0 */
/* The store with AVX2: integers only, so equal by construction. */
#include "bake/depth/depth_store.h"

#ifdef __AVX2__
#include "bake/depth/lane_extremes.h"

static inline __m256i load(const int32_t *from)
{
    return _mm256_loadu_si256((const __m256i *)(const void *)from);
}

static inline void save(int32_t *to, __m256i value)
{
    _mm256_storeu_si256((__m256i *)(void *)to, value);
}

/* One 8x8 block: decides, stores, reduces. */
static inline void store_square(const int32_t *layers, size_t texels, struct umbb_tile *tile,
                                size_t square)
{
    int32_t *lit_to = tile->lit + square * 64, *end_to = tile->end + square * 64;
    const __m256i background = _mm256_set1_epi32(tile->background);
    __m256i most = _mm256_setzero_si256(), fewest = _mm256_set1_epi32(INT32_MAX);
    for (size_t y = 0; y < 8; y++, layers += 8) {
        __m256i lit = load(layers + UMBB_LAYER_OPEN * texels), end = lit;
        if (end_to != lit_to) {
            const __m256i front = load(layers + UMBB_LAYER_FRONT * texels);
            const __m256i back = load(layers + UMBB_LAYER_BACK * texels);
            lit = _mm256_min_epi32(front, _mm256_min_epi32(back, lit));
            const __m256i inside = _mm256_and_si256(_mm256_cmpeq_epi32(front, lit),
                                                    _mm256_cmpgt_epi32(background, back));
            end = _mm256_blendv_epi8(lit, back, inside);
            save(end_to + 8 * y, end);
        }
        save(lit_to + 8 * y, lit);
        most = _mm256_max_epi32(most, lit);
        fewest = _mm256_min_epi32(fewest, end);
    }
    tile->max_lit[UMB_LEVEL_BRICK][square] = umbb_most_of_8(most);
    tile->min_end[UMB_LEVEL_BRICK][square] = umbb_least_of_8(fewest);
}

static void store(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0, int32_t y0)
{
    const size_t width = (size_t)n, texels = width * width;
    for (int32_t y = 0; y < n; y += 8) {
        for (int32_t x = 0; x < n; x += 8) {
            const size_t square = umbb_tile_index(tile, x0 + x, y0 + y) / 64;
            store_square(layers + (size_t)y * width + 8 * (size_t)x, texels, tile, square);
        }
    }
}

umbb_store_fn umbb_store_avx2(void)
{
    return __builtin_cpu_supports("avx2") ? store : NULL;
}

#else

umbb_store_fn umbb_store_avx2(void)
{
    return NULL;
}

#endif
